// Part of replay.js: strips and ticks below the view, and the panel beside it.

// ---------------------------------------------------------------- timeline
const element = (kind, name, html = "") =>
  Object.assign(document.createElement(kind), {className: name, innerHTML: html});
const plain = (text) =>
  text.replace(/[&<>"]/g, (c) => ({"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;"}[c]));

for (const owner of [...sites, ...D.rows]) {  // joints; drives: gears, logged efforts, limits
  owner.row = $("strips").appendChild(element("div", "row",
    `<span class="name" title="${plain((owner.of ? owner.of + " " : "") + owner.name)}"><i></i>${owner.mark ? owner.mark + " " : ""}${plain(owner.label)}</span>` +
    `<div class="track"><canvas></canvas><div class="playhead"></div></div><span class="value"></span>`));
  [owner.canvas, owner.value] = [owner.row.querySelector("canvas"), owner.row.querySelector(".value")];
}
for (const site of sites) site.tag = $("labels").appendChild(element("span", "", plain(site.label)));
const poles = [["x", "#c62828"], ["y", "#2e7d32"], ["z", "#1d4ed8"]].map(([name, color], k) => {
  const tag = Object.assign(element("em", "", name), {style: `color:${color}`});
  $("labels").prepend(tag);  // below the joints' names
  return {tag, tip: new THREE.Vector3().setComponent(k, 0.55)};
});
poles.node = viewer.scene_tree.find(["Axes"]).object;
poles.node.traverse((node) => { if (node.material) [node.material.depthTest, node.renderOrder] = [false, 9]; });
const ticks = element("div", "row ticks", `<span class="head">time, s</span><div class="track"><canvas></canvas></div><span></span>`);
$("strips").append(ticks);

function sized(canvas) {
  const ratio = window.devicePixelRatio || 1;
  canvas.width = canvas.clientWidth * ratio;
  canvas.height = canvas.clientHeight * ratio;
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  return [context, canvas.clientWidth, canvas.clientHeight];
}

function draw_spans(canvas, parts) {  // parts: [colour, spans, least width in pixels], later ones win
  const [c, w, h] = sized(canvas);
  const x = (t) => (t1 > t0 ? (w * (t - t0)) / (t1 - t0) : 0);
  c.fillStyle = "#e8edf2";
  c.beginPath();
  c.roundRect(0, 0, w, h, 4);
  c.fill();
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

function draw_strip(site, s) {  // and friction over time: a band at rest
  const [c, x, h] = draw_spans(site.canvas, STATES.slice(1).map((state) =>
    [D.colors[state], site.times[state], state === "near" ? 1 : 2]));
  let most = 1e-300;
  for (let i = s; i < F * ns; i += ns) most = Math.max(most, UPPER[i] || 0, -LOWER[i] || 0);
  const y = (value) => h / 2 - (value / most) * (h / 2 - 2);
  const columns = [[]];  // of each half pixel: the first friction, the range of the rest; none of a jam
  for (let k = 0, i = s; k < F; k++, i += ns) {
    const part = columns.at(-1), left = Math.round(2 * x(T[k])) / 2, end = part.at(-1);
    if (!isFinite(UPPER[i])) columns.push([]);
    else if (part.at(-2)?.x === left) Object.assign(end, {low: Math.min(end.low, LOWER[i]), up: Math.max(end.up, UPPER[i])});
    else part.push({x: left, low: LOWER[i], up: UPPER[i]});
  }
  c.fillStyle = "rgba(255, 255, 255, .30)";
  c.strokeStyle = "rgba(20, 38, 60, .80)";
  for (const part of columns) {
    const upper = new Path2D(), lower = new Path2D();
    for (const p of part) upper.lineTo(p.x, y(p.up));
    for (const p of part.reverse()) lower.lineTo(p.x, y(p.low));
    const band = new Path2D(upper);
    for (const p of part) band.lineTo(p.x, y(p.low));
    c.fill(band);
    c.stroke(upper);
    if (part.some((p) => y(p.low) - y(p.up) > 1)) c.stroke(lower);
  }
}

function draw_ticks() {
  const [c, w, h] = sized(ticks.querySelector("canvas"));
  const span = t1 - t0;
  if (!(span > 0)) return;
  const rough = span / Math.max(w / 60, 2), power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((m) => m * power).find((m) => m >= rough);
  c.fillStyle = "#66717e";
  c.font = "10.5px system-ui, sans-serif";
  for (let n = Math.ceil(t0 / step - 1e-9); n * step <= t1 + 1e-9 * span; n++) {
    const x = (w * (n * step - t0)) / span;
    c.fillRect(Math.min(x, w - 1), 0, 1, 3);
    const text = `${+(n * step).toPrecision(6)}`;
    const half = c.measureText(text).width / 2;
    c.fillText(text, Math.min(Math.max(x - half, 0), w - 2 * half), h - 1);
  }
}

function lay_out() {
  viewer.set_3d_pane_size();
  sites.forEach(draw_strip);
  for (const {canvas, parts} of D.rows) draw_spans(canvas, parts.map(([color, spans]) => [color, spans, 1]));
  draw_ticks();
  place_labels();
}

// ---------------------------------------------------------------- panel
$("legend").innerHTML = D.legend.map(([mark, color, words]) => `<li style="--state:${color}">` + (
  /^(ring|box)/.test(mark) ? `<span class="${mark}"></span>` : `<span class="mark">${mark}</span>`) + plain(words) + "</li>").join("");
$("about").textContent = D.about;

for (const [key, text] of [["friction", "friction"], ["forces", "forces"], ["names", "names"], ["solid", "solid robot"]]) {
  const label = $("toggles").appendChild(element("label", "check", `<input id="show-${key}" type="checkbox">${text}`));
  label.firstChild.checked = shown[key];
  label.firstChild.onchange = (event) => {
    shown[key] = event.target.checked;
    if (key === "solid") see_through(!shown.solid);
    show(now);
  };
}

function see_through(on) {  // meshes of the robot, not those of its markers
  viewer.scene_tree.find(["meshcat", "world"]).object.traverse((node) => {
    if (!node.isMesh || !/^(visual|body|line)_/.test(node.parent.name)) return;
    const material = node.material;
    material.solid = material.solid ?? material.opacity;
    Object.assign(material, {opacity: (on ? 0.3 : 1) * material.solid, transparent: on || material.solid < 1, depthWrite: !on});
    material.needsUpdate = true;
  });
}

const lasting = (s) => s >= 0.0995 ? s.toFixed(2) + " s" : s >= 0.00995 ? (1e3 * s).toFixed(0) + " ms"
  : s >= 0.0000995 ? (1e3 * s).toPrecision(2) + " ms" : (1e6 * s).toPrecision(2) + " µs";

const MOST_ROWS = 1000;
const intervals = sites.flatMap((site) => site.times.sticking.map(([start, end]) => ({site, start, end})));
intervals.sort((a, b) => a.start - b.start);
$("count").textContent = intervals.length || "";
for (const interval of intervals.slice(0, MOST_ROWS)) {
  const {site, start, end} = interval, length = end - start;
  const usual = t1 - t0 < 100 ? 3 : 2;  // more where begin and end would read alike
  const digits = length > 0 && length < 2e-3 ? Math.min(Math.ceil(1 - Math.log10(length)), 6) : usual;
  const span = length > 0 ? `${start.toFixed(digits)} – ${end.toFixed(digits)}` : start.toFixed(digits);
  const button = element("button", "", `<b>${plain(site.label)}</b><span>${span} s</span><em>${length > 0 ? lasting(length) : "passes"}</em>`);
  Object.assign(button, {interval, title: `${site.name}: go to the beginning of this interval`, onclick: () => go(start)});
  $("intervals").appendChild(element("li", "")).append(button);
}
const interval_buttons = [...$("intervals").querySelectorAll("button")];
if (!intervals.length) $("intervals").append(element("li", "none", "no joint sticks"));
if (intervals.length > MOST_ROWS) $("intervals").append(element("li", "none", `and ${intervals.length - MOST_ROWS} more`));
