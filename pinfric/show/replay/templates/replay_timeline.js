// Part of replay.js: strips and ticks below the view, and the panel beside it.

// ---------------------------------------------------------------- timeline
const element = (kind, name, html = "") =>
  Object.assign(document.createElement(kind), {className: name, innerHTML: html});
const plain = (text) =>
  text.replace(/[&<>"]/g, (c) => ({"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;"}[c]));

// "panda_joint1", "panda_joint2": without what all names begin with, up to a "_" before a letter
const together = ns < 2 ? "" : sites.reduce((common, {name}) => {
  let n = 0;
  while (n < common.length && common[n] === name[n]) n++;
  return common.slice(0, n);
}, sites[0].name);
let cut = together.lastIndexOf("_") + 1;
while (cut > 0 && sites.some(({name}) => !/[A-Za-z]/.test(name[cut]))) {
  cut = together.lastIndexOf("_", cut - 2) + 1;
}
// and without "_joint" at the end, where all have it
const tail = "_joint", end = ns && sites.every(({name}) => name.endsWith(tail) && name.length > cut + tail.length)
  ? -tail.length : undefined;
const short = (name) => plain(name.length > cut ? name.slice(cut, end) : name);

function add_row(owner, mark = "", of = "", kind = "row") {
  owner.row = element("div", kind, `<span class="name" title="${of}${plain(owner.name)}"><i></i>${mark}${short(owner.name)}</span>` +
    `<div class="track"><canvas></canvas><div class="playhead"></div></div><span class="value"></span>`);
  [owner.canvas, owner.value] = [owner.row.querySelector("canvas"), owner.row.querySelector(".value")];
  $("strips").append(owner.row);
}
sites.forEach((site) => {
  site.inverse = new THREE.Quaternion(...site.turn);  // from the wrench's axes to the marker's
  add_row(site);
  site.label = $("labels").appendChild(element("span", "", short(site.name)));
});
// strips of gears that hold a joint without their motor, below those of the joints' friction
gears.forEach((gear) => add_row(gear, "⚙ ", "gear of ", "row gear"));
// strips of logged efforts that miss the computed ones, and of limits that hold the motion back
D.strips.forEach((strip) => add_row(strip, strip.mark + " ", strip.of + " "));
const ticks = element("div", "row ticks", `<span></span><div class="track"><canvas></canvas></div><span></span>`);
$("strips").append(ticks);

function sized(canvas) {
  const ratio = window.devicePixelRatio || 1;
  canvas.width = canvas.clientWidth * ratio;
  canvas.height = canvas.clientHeight * ratio;
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  return [context, canvas.clientWidth, canvas.clientHeight];
}

function thinned(values) {  // of one pixel: the first, the whole range, the last
  if (values.length < 3) return values;
  const [first, last] = [values[0], values[values.length - 1]];
  const low = Math.min(...values.map((p) => p.low)), up = Math.max(...values.map((p) => p.up));
  return [first, {x: 0.5 * (first.x + last.x), low, up}, last];
}

function draw_band(c, part, y) {  // between the least and the greatest friction, edges drawn
  const edge = (name, points) => points.map((p) => [p.x, y(p[name])]);
  const [up, low] = [edge("up", part), edge("low", part)];
  const trace = (points) => {
    c.beginPath();
    points.forEach(([a, b], n) => (n ? c.lineTo(a, b) : c.moveTo(a, b)));
  };
  c.fillStyle = "rgba(255, 255, 255, .30)";
  trace([...up, ...low.reverse()]);
  c.fill();
  c.strokeStyle = "rgba(20, 38, 60, .80)";
  c.lineWidth = 1.2;
  for (const points of part.some((p) => y(p.low) - y(p.up) > 1) ? [up, low] : [up]) {
    trace(points);
    c.stroke();
  }
}

function draw_spans(canvas, parts) {  // parts: [colour, spans, least width in pixels], later ones win
  const [c, w, h] = sized(canvas);
  const x = (t) => (t1 > t0 ? (w * (t - t0)) / (t1 - t0) : 0);
  c.fillStyle = "#e8edf2";
  c.beginPath();
  c.roundRect(0, 0, w, h, 4);
  c.fill();
  c.save();
  c.clip();
  for (const [color, spans, least] of parts) {
    c.fillStyle = color;
    for (const [a, b] of spans) {
      const left = Math.min(x(a), w - 2);
      c.fillRect(left, 0, Math.max(x(b) - left, least), h);
    }
  }
  return [c, x, h];
}

function draw_strip(site, s) {
  const [c, x, h] = draw_spans(site.canvas, STATES.slice(1).map((state) =>
    [D.colors[state], site.times[state], state === "near" ? 1 : 2]));
  let most = 0;
  for (let k = 0; k < F; k++) most = Math.max(most, UPPER[k * ns + s] || 0, -LOWER[k * ns + s] || 0);
  if (most > 0) {  // friction over time: its least and greatest value in each pixel
    const y = (value) => h / 2 - (value / most) * (h / 2 - 2);
    let part = [];
    for (let k = 0; k <= F; k++) {
      const i = k * ns + s;
      if (k < F && isFinite(UPPER[i])) {
        const value = {x: x(T[k]), low: LOWER[i], up: UPPER[i]}, last = part[part.length - 1];
        if (last && value.x - last[0].x < 1) last.push(value); else part.push([value]);
      } else if (part.length) {  // a jam has no friction to draw
        draw_band(c, part.flatMap(thinned), y);
        part = [];
      }
    }
  }
  c.restore();
}

function draw_ticks() {
  const [c, w, h] = sized(ticks.querySelector("canvas"));
  const span = t1 - t0;
  if (!(span > 0)) return;
  const rough = span / Math.max(w / 90, 1), power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((m) => m * power).find((m) => m >= rough);
  c.fillStyle = "#66717e";
  c.font = "10.5px system-ui, sans-serif";
  for (let n = Math.ceil(t0 / step - 1e-9); n * step <= t1 + 1e-9 * span; n++) {
    const x = (w * (n * step - t0)) / span;
    c.fillRect(Math.min(x, w - 1), 0, 1, 3);
    const text = `${+(n * step).toPrecision(6)}${n * step + step > t1 ? " s" : ""}`;
    const half = c.measureText(text).width / 2;
    c.fillText(text, Math.min(Math.max(x - half, 0), w - 2 * half), h - 1);
  }
}

function lay_out() {
  viewer.set_3d_pane_size();
  sites.forEach(draw_strip);
  gears.forEach((gear) => draw_spans(gear.canvas, [[D.gear_color, gear.spans, 2]]));
  D.strips.forEach((strip) => draw_spans(strip.canvas, strip.parts.map(([color, spans]) => [color, spans, 1])));
  draw_ticks();
  place_labels();
}

// ---------------------------------------------------------------- panel
const ring = (state) =>
  `<li style="--state:${D.colors[state]}"><span class="ring${state === "sliding" ? "" : " full"}"></span>${D.meanings[state]}</li>`;
const used = STATES.filter((s) => s === "sliding" || s === "sticking" || sites.some((x) => x.times[s].length));
$("legend").innerHTML = (ns ? used.map(ring).join("") : "<li>no joint has friction</li>") +
  (ns ? `<li style="--state:#46525f"><span class="mark">↻</span>friction of the parent on the child${D.simulated ? "; at rest with its share of the limit" : "; at rest both ways: all it can be"}</li>` : "") +
  (ns ? `<li style="--state:${D.force_color}"><span class="mark">↑</span>force of the parent on the child</li>` : "") +
  (gears.length ? `<li style="--state:${D.gear_color}"><span class="mark">⚙</span>${D.gear_meaning}</li>` : "") +
  D.strip_meanings.map(([mark, color, words]) => `<li style="--state:${color}"><span class="mark">${mark}</span>${words}</li>`).join("") +
  (D.drives ? `<li style="--state:${D.drive_color}"><span class="box"></span>cylinder or force that drives</li>` : "") +
  payloads.map((p) => `<li style="--state:${D.payload_color}"><span class="box"></span>${plain(p.name)}, while carried</li>`).join("");
$("about").textContent = D.about;

for (const [key, text] of [["friction", "friction"], ["forces", "forces"], ["names", "names"], ["solid", "solid robot"]]) {
  const label = element("label", "check", `<input type="checkbox">${text}`);
  const box = label.firstChild;
  box.id = "show-" + key;
  box.checked = shown[key];
  box.onchange = () => {
    shown[key] = box.checked;
    if (key === "solid") see_through(!box.checked);
    show(now);
  };
  $("toggles").append(label);
}

const drawn_of_robot = [];
find("world").object.traverse((node) => {
  for (let up = node; up; up = up.parent) if (up.name.startsWith("site ") || up.name === "axes") return;
  if (node.isMesh) drawn_of_robot.push(...[node.material].flat());
});
function see_through(on) {
  for (const material of drawn_of_robot) {
    material.was = material.was ?? {opacity: material.opacity, transparent: material.transparent, depthWrite: material.depthWrite};
    Object.assign(material, on ? {opacity: 0.3 * material.was.opacity, transparent: true, depthWrite: false} : material.was);
    material.needsUpdate = true;
  }
}

const lasting = (s) => s >= 0.0995 ? s.toFixed(2) + " s" : s >= 0.00995 ? (1e3 * s).toFixed(0) + " ms"
  : s >= 0.0000995 ? (1e3 * s).toPrecision(2) + " ms" : (1e6 * s).toPrecision(2) + " µs";

const MOST_ROWS = 1000;
const intervals = sites.flatMap((site) =>
  site.times.sticking.map(([start, end]) => ({site: site.name, start, end})));
intervals.sort((a, b) => a.start - b.start);
$("count").textContent = intervals.length || "";
for (const interval of intervals.slice(0, MOST_ROWS)) {
  const length = interval.end - interval.start;
  const usual = t1 - t0 < 100 ? 3 : 2;  // more where begin and end would read alike
  const digits = length > 0 && length < 2e-3 ? Math.min(Math.ceil(1 - Math.log10(length)), 6) : usual;
  const span = length > 0 ? `${interval.start.toFixed(digits)} – ${interval.end.toFixed(digits)}` : interval.start.toFixed(digits);
  const button = element("button", "", `<b>${short(interval.site)}</b><span>${span} s</span>` +
    `<em>${length > 0 ? lasting(length) : "passes"}</em>`);
  button.interval = interval;
  button.title = `${interval.site}: go to the beginning of this interval`;
  button.onclick = () => { pause(); show(interval.start); };
  $("intervals").appendChild(element("li", "")).append(button);
}
const interval_buttons = [...$("intervals").querySelectorAll("button")];
if (!intervals.length) $("intervals").append(element("li", "none", "no joint sticks"));
if (intervals.length > MOST_ROWS) $("intervals").append(element("li", "none", `and ${intervals.length - MOST_ROWS} more`));
