// Plays a replay page of pinfric: meshcat's animation moves the robot; here is the friction.
//
// What a joint does is looked up in its intervals at the exact time shown: meshcat's animator would
// know its colours only frame by frame.
(async function () {
"use strict";
const $ = (id) => document.getElementById(id);
const D = JSON.parse($("data").textContent);
const STATES = ["sliding", "reversal", "sticking", "near", "jammed"];  // later ones win
const LINGER = 0.08;  // s of real time for which a short event stays visible while playing

const problem = (text) => Object.assign($("loading"), {className: "problem", textContent: text});

async function unpack(id) {
  const text = atob($(id).textContent), packed = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) packed[i] = text.charCodeAt(i);
  $(id).remove();
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return await new Response(stream).arrayBuffer();
}

if (typeof DecompressionStream === "undefined") {
  return problem("This browser cannot unpack the page: use one of 2023 or later.");
}
const library = document.createElement("script");
library.textContent = new TextDecoder().decode(await unpack("meshcat"));
document.head.append(library);  // runs at once
let viewer;
try {
  viewer = new MeshCat.Viewer($("pane"));
} catch (error) {
  return problem("This browser shows no 3D graphics (WebGL): " + error.message);
}
const THREE = MeshCat.THREE;
const size_of_window = viewer.set_3d_pane_size;
viewer.set_3d_pane_size = () =>
  size_of_window.call(viewer, $("pane").clientWidth, $("pane").clientHeight);
window.onload = null;

// ---------------------------------------------------------------- data
const F = D.frames, ns = D.sites.length, balls = D.sites.filter((site) => site.ball);
const buffer = await unpack("frames");
let at = 0;
function take(kind, count) {
  const array = new kind(buffer, at, count);
  at += array.byteLength;
  return array;
}
const T = take(Float64Array, F);
const LOWER = take(Float32Array, F * ns), UPPER = take(Float32Array, F * ns);
const USE = take(Float32Array, F * ns), FORCE = take(Float32Array, F * ns * 3);
const SLIP = take(Float32Array, F * balls.length * 3);
const t0 = T[0], t1 = T[F - 1];

const commands = new Uint8Array(await unpack("commands"));
const lengths = new DataView(commands.buffer);
for (let k = 0; k < commands.length;) {
  const n = lengths.getUint32(k, true);
  viewer.handle_command_bytearray(commands.subarray(k + 4, k + 4 + n));
  k += 4 + n;
}
viewer.animator.pause();

const sites = D.sites.map((site) => {
  const node = viewer.scene_tree.find(["meshcat", ...site.path.split("/")]);
  const object = (...path) => node.find(path).object;
  const arrow = (name) => ({
    node: object(name), body: object(name, "body"), head: object(name, "head"),
    mesh: object(name, "body", "<object>"), tip: object(name, "head", "<object>"),
  });
  return {
    ...site, node: node.object, state: "", ball_row: balls.indexOf(site),
    ring: object("ring", "<object>"), ghost: object("ghost", "<object>"), disc: object("disc", "<object>"),
    inverse: new THREE.Quaternion(...site.turn),  // from the wrench's axes to the marker's
    plus: arrow("arc_plus"), minus: arrow("arc_minus"), force: arrow("force"),
  };
});

// ---------------------------------------------------------------- what is shown at a time
const shown = {friction: true, forces: false, names: ns <= 12, solid: true};
let now = t0, playing = false, last_tick = 0;

function last(array, holds) {  // index of the last one that holds, where all before it do, too; or -1
  let low = -1, high = array.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (holds(array[middle])) low = middle; else high = middle - 1;
  }
  return low;
}

function meets(spans, from, to) {  // does a span meet [from, to]? spans are sorted and disjoint
  const k = last(spans, ([begin]) => begin <= to);
  return k >= 0 && spans[k][1] >= from;
}

const vz = new THREE.Vector3(0, 0, 1), direction = new THREE.Vector3();

function stretch(drawn, length, head) {  // an arrow along its z axis, m
  drawn.node.visible = length > 1e-4 * D.size;
  const tip = Math.min(head, length);
  drawn.body.scale.set(1, 1, Math.max(length - tip, 1e-6));
  drawn.head.position.z = length - tip;
  drawn.head.scale.setScalar(tip / head);
}

function bend(drawn, part, sign, radius) {  // an arc of `part` of the longest
  drawn.node.visible = part > 0.004;
  drawn.mesh.geometry.setDrawRange(0, Math.round(part * D.arc.segments) * D.arc.sides * 6);
  const angle = sign * part * D.arc.angle;
  drawn.head.position.set(radius * Math.cos(angle), radius * Math.sin(angle), 0);
  direction.set(-sign * Math.sin(angle), sign * Math.cos(angle), 0);
  drawn.head.quaternion.setFromUnitVectors(vz, direction);
}

function paint(site, state) {
  if (state === site.state) return;
  site.state = state;
  const color = D.colors[state], event = state !== "sliding";
  for (const mesh of [site.ring, site.ghost, site.disc, site.plus.mesh, site.minus.mesh,
                      site.plus.tip, site.minus.tip]) mesh.material.color.set(color);
  site.disc.parent.visible = event;
  site.ghost.material.opacity = event ? 0.8 : 0.35;
  for (const mesh of [site.ring, site.ghost]) mesh.parent.scale.setScalar(event ? 1.12 : 1);
  site.row.style.setProperty("--state", color);
  site.tag.style.setProperty("--state", color);
  site.tag.classList.toggle("event", event);
}

function show_site(site, s, k, since) {
  paint(site, STATES.findLast((state) => state === "sliding" || meets(site.times[state], since, now)));
  const i = k * ns + s, longest = site.sliding ? D.most.push : D.most.turn;
  if (site.ball) {  // its friction acts about the direction of its slip
    direction.fromArray(SLIP, 3 * (k * balls.length + site.ball_row));
    for (const arc of [site.plus, site.minus]) {
      arc.node.quaternion.setFromUnitVectors(vz, direction).premultiply(site.inverse);
    }
  }
  for (const [arc, sign, value] of [[site.plus, 1, UPPER[i]], [site.minus, -1, -LOWER[i]]]) {
    const part = shown.friction ? Math.max(value, 0) / longest || 0 : 0;
    if (site.sliding) stretch(arc, part * D.arrow, D.head.friction);
    else bend(arc, part, sign, site.arc_radius);
  }
  const force = direction.fromArray(FORCE, 3 * i).length();
  const seen = shown.forces && force > 0 && isFinite(force);
  if (seen) {
    site.force.node.quaternion.setFromUnitVectors(vz, direction.divideScalar(force))
      .premultiply(site.inverse);
  }
  stretch(site.force, seen ? force / D.most.force * D.arrow : 0, D.head.force);
}

const number = (x) => !isFinite(x) ? "∞" : x === 0 ? "0" : (Math.abs(x) >= 100 ? x.toFixed(0)
  : Math.abs(x) < 0.001 ? x.toExponential(1) : x.toPrecision(3)).replaceAll("-", "−");

function friction_text(site, i) {
  const low = LOWER[i], up = UPPER[i], unit = `<small>${site.unit}</small>`;
  if (isNaN(up)) return "none";  // jammed
  if (!(up - low > 1e-9 * Math.abs(up))) {
    return `${number(up)} ${unit}` + (isFinite(USE[i]) ? ` <small>${(100 * USE[i]).toFixed(0)} %</small>` : "");
  }
  return (-low === up || Math.abs(low + up) < 1e-6 * up ? `±${number(up)} ` : `${number(low)} … ${number(up)} `) + unit;
}

function show(t, since = t) {
  now = Math.min(Math.max(t, t0), t1);
  since = Math.min(since, now);
  const k = Math.max(last(T, (time) => time <= now), 0);
  viewer.animator.seek(now - t0);
  sites.forEach((site, s) => {
    show_site(site, s, k, since);
    site.value.innerHTML = friction_text(site, k * ns + s);
  });
  for (const row of D.rows) {
    const [color, , words] = row.parts.findLast(([, spans]) => meets(spans, since, now)) ?? ["transparent", [], ""];
    row.row.style.setProperty("--state", color);
    row.value.textContent = words;
  }
  $("slider").value = now;
  $("clock").innerHTML = `${now.toFixed(3)} s <small>/ ${t1.toFixed(2)} s</small>`;
  $("strips").style.setProperty("--now", (t1 > t0 ? (100 * (now - t0)) / (t1 - t0) : 0) + "%");
  for (const b of interval_buttons) {
    b.classList.toggle("now", b.interval.start <= now && now <= b.interval.end);
  }
  viewer.set_dirty();
  place_labels();
}

// ---------------------------------------------------------------- names beside the markers
const spot = new THREE.Vector3();
function place_labels() {
  $("labels").hidden = !shown.names;
  if (!shown.names) return;
  viewer.scene.updateMatrixWorld();
  viewer.camera.updateMatrixWorld();
  const w = $("pane").clientWidth, h = $("pane").clientHeight, taken = [];
  for (const {node, tag} of sites) {
    node.getWorldPosition(spot).project(viewer.camera);
    tag.style.visibility = spot.z > 1 ? "hidden" : "visible";
    const width = tag.offsetWidth + 4;
    const x = Math.max(Math.min((0.5 + 0.5 * spot.x) * w + 16, w - width), 0);
    let y = Math.max(Math.min((0.5 - 0.5 * spot.y) * h - 24, h - 22), 0);
    while (taken.some(([a, b, c]) => Math.abs(b - y) < 19 && x < a + c && a < x + width)) y += 19;
    taken.push([x, y, width]);
    tag.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
  }
  for (const {tip, tag} of poles) {  // the world's axes
    spot.copy(tip).applyMatrix4(poles.node.matrixWorld).project(viewer.camera);
    tag.style.transform = `translate(${(0.5 + 0.5 * spot.x) * w - 4}px, ${(0.5 - 0.5 * spot.y) * h - 8}px)`;
  }
}

{{timeline}}
// ---------------------------------------------------------------- playing
const ICONS = {play: "M7 4v16l13-8z", pause: "M6 5h4v14H6zM14 5h4v14h-4z"};
function set_playing(on) {
  playing = on;
  last_tick = performance.now();
  $("play").querySelector("path").setAttribute("d", on ? ICONS.pause : ICONS.play);
}
function play() { if (now >= t1) show(t0); set_playing(true); }
function pause() { set_playing(false); }
function go(t) { pause(); show(t); }
const toggle = () => (playing ? pause() : play());

function tick(at) {
  requestAnimationFrame(tick);
  const speed = +$("speed").querySelector("select").value;
  let t = now + speed * Math.max(at - last_tick, 0) / 1000;
  last_tick = at;
  if (!playing) { if (viewer.needs_render) place_labels(); return; }
  if (t >= t1) {
    if ($("loop").checked && t1 > t0) t = t0; else { t = t1; pause(); }
  }
  show(t, t - LINGER * speed);
}

function jump(forward) {
  const starts = intervals.map((i) => i.start);
  const target = forward ? starts.find((s) => s > now + 1e-9) : starts.findLast((s) => s < now - 1e-9);
  go(target ?? (forward ? t1 : t0));
}

function fit() {  // look from the front, right and above at all that moves
  const [x, y, z] = D.middle;  // meshcat's camera: y points up
  const far = D.distance / Math.min(1, $("pane").clientWidth / Math.max($("pane").clientHeight, 1));
  Object.assign(viewer.camera, {fov: D.view, near: far / 50, far: 60 * far});
  viewer.controls.target.set(x, z, -y);
  viewer.camera.position.set(1.0, 0.55, 1.25).setLength(far).add(viewer.controls.target);
  viewer.controls.update();
  viewer.set_dirty();
}

Object.assign($("slider"), {min: t0, max: t1 > t0 ? t1 : t0 + 1e-9});
$("slider").oninput = () => go(+$("slider").value);
$("play").onclick = toggle;
$("back").onclick = () => jump(false);
$("next").onclick = () => jump(true);
$("fit").onclick = fit;
$("strips").addEventListener("pointerdown", (down) => {
  const canvas = down.target;
  if (canvas.tagName !== "CANVAS" || canvas.closest(".ticks")) return;
  const to = (event) => {
    const box = canvas.getBoundingClientRect();
    go(t0 + ((event.clientX - box.left) / box.width) * (t1 - t0));
  };
  canvas.setPointerCapture(down.pointerId);
  canvas.onpointermove = to;
  canvas.onpointerup = () => { canvas.onpointermove = null; };
  to(down);
});
document.addEventListener("keydown", (event) => {
  if (["SELECT", "TEXTAREA"].includes(event.target.tagName) || event.ctrlKey || event.metaKey) return;
  const action = {
    " ": toggle, n: () => jump(true), p: () => jump(false), f: fit,
    ArrowRight: () => go(now + 0.02), ArrowLeft: () => go(now - 0.02), Home: () => show(t0), End: () => show(t1),
  }[event.key];
  if (!action || (event.key === " " && event.target.tagName === "BUTTON")) return;
  event.preventDefault();
  action();
});
let turned = false;  // by hand: then a new size of the window leaves the view as it is
viewer.controls.addEventListener("start", () => { turned = true; });
window.addEventListener("resize", () => { lay_out(); if (!turned) fit(); });
viewer.controls.addEventListener("change", place_labels);

// #t=1.2 opens at that time, #play plays
const wish = new URLSearchParams(location.hash.slice(1));
lay_out();
fit();
show(wish.has("t") ? +wish.get("t") : t0);
viewer.render();
place_labels();
$("loading").hidden = true;
requestAnimationFrame(tick);
if (wish.has("play")) play();

window.replay = {
  viewer, play, pause, seek: (t) => { go(t); viewer.render(); }, time: () => now,
  start: t0, end: t1, show: shown, state: (name) => sites.find((s) => s.name === name).state,
};
document.body.dataset.ready = "1";
})().catch((error) => {
  document.getElementById("loading").textContent = "The replay cannot be shown: " + error.message;
  throw error;
});
