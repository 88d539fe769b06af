// Plays a replay page of pinfric: meshcat draws, this file moves.
//
// Meshcat's own animator would need its tracks as lists of keys (ten times the size), and would
// know colours only frame by frame. Here the poses are arrays, and what a joint does is looked up
// in its intervals at the exact time shown.
(async function () {
"use strict";
const $ = (id) => document.getElementById(id);
const D = JSON.parse($("data").textContent);
const STATES = ["sliding", "reversal", "sticking", "near", "jammed"];  // later ones win
const LINGER = 0.08;  // s of real time for which a short event stays visible while playing

function problem(text) {
  $("loading").hidden = false;
  $("loading").className = "problem";
  $("loading").append(text);
  $("loading").childNodes[1].textContent = "";
}

async function unpack(id) {
  const packed = Uint8Array.from(atob($(id).textContent), (c) => c.charCodeAt(0));
  $(id).remove();
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return await new Response(stream).arrayBuffer();
}

if (typeof DecompressionStream === "undefined") {
  return problem("This browser cannot unpack the page: use one of 2023 or later.");
}
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
const F = D.frames, nj = D.joints.length, ns = D.sites.length;
const buffer = await unpack("frames");
let at = 0;
function take(kind, count) {
  const array = new kind(buffer, at, count);
  at += array.byteLength;
  return array;
}
const T = take(Float64Array, F);
const POSE = take(Float32Array, F * nj * 7);
const LOWER = take(Float32Array, F * ns), UPPER = take(Float32Array, F * ns);
const USE = take(Float32Array, F * ns), FORCE = take(Float32Array, F * ns * 3);
const balls = D.sites.filter((site) => site.ball);
const SLIP = take(Float32Array, F * balls.length * 3);
const t0 = T[0], t1 = T[F - 1];

const commands = new Uint8Array(await unpack("commands"));
const lengths = new DataView(commands.buffer);
for (let k = 0; k < commands.length;) {
  const n = lengths.getUint32(k, true);
  viewer.handle_command_bytearray(commands.subarray(k + 4, k + 4 + n));
  k += 4 + n;
}
const find = (path) =>
  viewer.scene_tree.find(["meshcat", ...path.split("/")]);
const joints = D.joints.map((path) => find(path).object);

function arrow(node) {
  return {node: node.object, body: node.find(["body"]).object, head: node.find(["head"]).object};
}
const sites = D.sites.map((site) => {
  const node = find(site.path);
  const mesh = (name) => node.find([name, "<object>"]).object;
  return {
    ...site, ball_row: balls.indexOf(site), node: node.object, ring: mesh("ring"), ghost: mesh("ghost"), disc: mesh("disc"),
    disc_group: node.find(["disc"]).object, ring_group: node.find(["ring"]).object,
    ghost_group: node.find(["ghost"]).object,
    plus: arrow(node.find(["arc_plus"])), minus: arrow(node.find(["arc_minus"])),
    plus_mesh: node.find(["arc_plus", "body", "<object>"]).object,
    minus_mesh: node.find(["arc_minus", "body", "<object>"]).object,
    plus_head: node.find(["arc_plus", "head", "<object>"]).object,
    minus_head: node.find(["arc_minus", "head", "<object>"]).object,
    force: arrow(node.find(["force"])), state: "", unit: site.sliding ? "N" : "N m",
  };
});
const cylinders = D.cylinders.map((c) => ({
  ...c, node: find(c.path).object, barrel: find(c.path + "/barrel").object, rod: find(c.path + "/rod").object,
}));
const gears = D.gears.map((g) => ({...g, node: g.path ? find(g.path).object : {}}));
const payloads = D.payloads.map((p) => ({...p, node: find(p.path).object}));

// ---------------------------------------------------------------- what is shown at a time
const shown = {friction: true, forces: false, names: ns <= 12, solid: true};
let now = t0, playing = false, last_tick = 0;

function frame_at(t) {  // the last frame at or before t
  let low = 0, high = F - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (T[middle] <= t) low = middle; else high = middle - 1;
  }
  return low;
}

function meets(spans, from, to) {  // does a span meet [from, to]? spans are sorted and disjoint
  let low = 0, high = spans.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (spans[middle][0] <= to) low = middle + 1; else high = middle;
  }
  return low > 0 && spans[low - 1][1] >= from;
}

function state_of(site, t, since = t) {
  let found = "sliding";
  for (const state of STATES.slice(1)) {
    if (meets(site.times[state], since, t)) found = state;
  }
  return found;
}

const qa = new THREE.Quaternion(), qb = new THREE.Quaternion(), vz = new THREE.Vector3(0, 0, 1);
const direction = new THREE.Vector3();

function pose(t, k) {
  const next = Math.min(k + 1, F - 1);
  const s = next > k ? (t - T[k]) / (T[next] - T[k]) : 0;
  joints.forEach((joint, j) => {
    const a = (k * nj + j) * 7, b = (next * nj + j) * 7;
    joint.position.set(...[0, 1, 2].map((i) => POSE[a + i] + s * (POSE[b + i] - POSE[a + i])));
    qa.set(POSE[a + 3], POSE[a + 4], POSE[a + 5], POSE[a + 6]);
    qb.set(POSE[b + 3], POSE[b + 4], POSE[b + 5], POSE[b + 6]);
    joint.quaternion.copy(qa.slerp(qb, s));
  });
}

const ends = [new THREE.Vector3(), new THREE.Vector3()];
function stretch_cylinders() {  // their nodes lie in "world", as the joints' do
  for (const c of cylinders) {
    [c.a, c.b].forEach(([joint, p], i) => {
      ends[i].set(...p);
      if (joint >= 0) ends[i].applyQuaternion(joints[joint].quaternion).add(joints[joint].position);
    });
    c.node.position.copy(ends[0]);
    const length = direction.copy(ends[1]).sub(ends[0]).length() || 1e-9;
    c.node.quaternion.setFromUnitVectors(vz, direction.divideScalar(length));
    c.rod.scale.set(1, 1, length);
    c.barrel.scale.set(1, 1, D.barrel * length);
  }
}

function stretch(drawn, length, head) {  // an arrow along its z axis, m
  drawn.node.visible = length > 1e-4 * D.size;
  const tip = Math.min(head, length);
  drawn.body.scale.set(1, 1, Math.max(length - tip, 1e-6));
  drawn.head.position.z = length - tip;
  drawn.head.scale.setScalar(tip / head);
}

function bend(drawn, mesh, part, sign, radius) {  // an arc of `part` of the longest
  drawn.node.visible = part > 0.004;
  mesh.geometry.setDrawRange(0, Math.round(part * D.arc.segments) * D.arc.sides * 6);
  const angle = sign * part * D.arc.angle;
  drawn.head.position.set(radius * Math.cos(angle), radius * Math.sin(angle), 0);
  direction.set(-sign * Math.sin(angle), sign * Math.cos(angle), 0);
  drawn.head.quaternion.setFromUnitVectors(vz, direction);
}

function show_site(site, s, k, state) {
  if (state !== site.state) {
    site.state = state;
    const color = D.colors[state], event = state !== "sliding";
    for (const mesh of [site.ring, site.ghost, site.disc, site.plus_mesh, site.minus_mesh,
                        site.plus_head, site.minus_head]) {
      mesh.material.color.set(color);
    }
    site.disc_group.visible = event;
    site.ghost.material.opacity = event ? 0.8 : 0.35;
    const grown = event ? 1.12 : 1;
    for (const group of [site.ring_group, site.ghost_group]) group.scale.setScalar(grown);
    site.row.style.setProperty("--state", color);
    site.label.style.setProperty("--state", color);
    site.label.classList.toggle("event", event);
  }
  const i = k * ns + s, longest = site.sliding ? D.most.push : D.most.turn;
  const plus = shown.friction ? Math.max(UPPER[i], 0) / longest || 0 : 0;
  const minus = shown.friction ? Math.max(-LOWER[i], 0) / longest || 0 : 0;
  if (site.ball) {  // its friction acts about the direction of its slip
    const row = 3 * (k * balls.length + site.ball_row);
    direction.set(SLIP[row], SLIP[row + 1], SLIP[row + 2]);
    for (const arc of [site.plus, site.minus]) {
      arc.node.quaternion.setFromUnitVectors(vz, direction).premultiply(site.inverse);
    }
  }
  if (site.sliding) {
    stretch(site.plus, plus * D.arrow, D.head.friction);
    stretch(site.minus, minus * D.arrow, D.head.friction);
  } else {
    bend(site.plus, site.plus_mesh, plus, 1, site.arc_radius);
    bend(site.minus, site.minus_mesh, minus, -1, site.arc_radius);
  }
  direction.set(FORCE[3 * i], FORCE[3 * i + 1], FORCE[3 * i + 2]);
  const force = direction.length();
  if (shown.forces && force > 0 && isFinite(force)) {
    site.force.node.quaternion.setFromUnitVectors(vz, direction.divideScalar(force))
      .premultiply(site.inverse);
    stretch(site.force, force / D.most.force * D.arrow, D.head.force);
  } else {
    site.force.node.visible = false;
  }
}

const number = (x) => !isFinite(x) ? "∞" : x === 0 ? "0" :
  Math.abs(x) >= 100 ? x.toFixed(0) : Math.abs(x) < 0.001 ? x.toExponential(1) : x.toPrecision(3);

function friction_text(site, s, k) {
  const i = k * ns + s, low = LOWER[i], up = UPPER[i];
  const share = isFinite(USE[i]) ? ` <small>${(100 * USE[i]).toFixed(0)} %</small>` : "";
  const minus = (x) => number(x).replace("-", "−");
  if (isNaN(up)) return "none";  // jammed
  if (!(up - low > 1e-9 * Math.abs(up))) return `${minus(up)} <small>${site.unit}</small>${share}`;
  return -low === up || Math.abs(low + up) < 1e-6 * up ? `±${number(up)} <small>${site.unit}</small>`
    : `${minus(low)} … ${minus(up)} <small>${site.unit}</small>`;
}

function show(t, since = t) {
  now = Math.min(Math.max(t, t0), t1);
  const k = frame_at(now);
  pose(now, k);
  stretch_cylinders();
  sites.forEach((site, s) => {
    show_site(site, s, k, state_of(site, now, Math.min(since, now)));
    site.value.innerHTML = friction_text(site, s, k);
  });
  for (const g of gears) {
    const holds = meets(g.spans, Math.min(since, now), now);
    g.node.visible = holds;
    g.row.style.setProperty("--state", holds ? D.gear_color : "transparent");
    g.value.textContent = holds ? "holds by itself" : "";
  }
  for (const strip of D.strips) {
    const [color, , words] = strip.parts.findLast(([, spans]) => meets(spans, Math.min(since, now), now)) ?? ["transparent", [], ""];
    strip.row.style.setProperty("--state", color);
    strip.value.textContent = words;
  }
  for (const p of payloads) p.node.visible = p.spans.some(([a, b]) => a <= now && (now < b || b === t1));
  $("slider").value = now;
  $("clock").innerHTML = `${now.toFixed(3)} s <small>/ ${t1.toFixed(2)} s</small>`;
  const x = t1 > t0 ? (100 * (now - t0)) / (t1 - t0) : 0;
  for (const head of document.querySelectorAll(".playhead")) head.style.left = x + "%";
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
  for (const site of sites) {
    site.node.getWorldPosition(spot).project(viewer.camera);
    const hidden = spot.z > 1;
    site.label.style.visibility = hidden ? "hidden" : "visible";
    const width = site.label.offsetWidth + 4;
    const x = Math.max(Math.min((0.5 + 0.5 * spot.x) * w + 16, w - width), 0);
    let y = Math.max(Math.min((0.5 - 0.5 * spot.y) * h - 24, h - 22), 0);
    while (taken.some(([a, b, c]) => Math.abs(b - y) < 19 && x < a + c && a < x + width)) y += 19;
    taken.push([x, y, width]);
    site.label.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
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
const speed = () => +$("speed").querySelector("select").value;

function tick(at) {
  requestAnimationFrame(tick);
  const passed = Math.max(at - last_tick, 0) / 1000;
  last_tick = at;
  if (!playing) { if (viewer.needs_render) place_labels(); return; }
  let t = now + passed * speed();
  if (t >= t1) {
    if ($("loop").checked && t1 > t0) t = t0; else { t = t1; pause(); }
  }
  show(t, t - LINGER * speed());
}

function jump(forward) {
  pause();
  const starts = intervals.map((i) => i.start);
  const target = forward ? starts.find((s) => s > now + 1e-9) : starts.findLast((s) => s < now - 1e-9);
  show(target ?? (forward ? t1 : t0));
}

// A soft shadow on the floor tells how high things are.
function cast_shadows() {
  const [x, y, z] = D.points.reduce(([a, b, c], p) => [a + p[0], b + p[1], c + p[2]], [0, 0, 0])
    .map((sum) => sum / D.points.length);
  const reach = Math.max(...D.points.map((p) => Math.hypot(p[0] - x, p[1] - y, p[2] - z)));
  const light = new THREE.DirectionalLight(0xffffff, 0.25);
  light.position.set(x - 0.5 * reach, y - 0.9 * reach, z + 2.5 * reach);
  light.target.position.set(x, y, z);
  light.castShadow = true;
  light.shadow.mapSize.set(1024, 1024);
  light.shadow.radius = 6;
  light.shadow.bias = -0.0015;
  light.shadow.normalBias = 0.004 * reach;
  Object.assign(light.shadow.camera, {
    left: -1.3 * reach, right: 1.3 * reach, top: 1.3 * reach, bottom: -1.3 * reach,
    near: 0.5 * reach, far: 6 * reach + z - D.floor,
  });
  const floor = new THREE.Mesh(
    new THREE.PlaneGeometry(12 * reach, 12 * reach), new THREE.ShadowMaterial({opacity: 0.16}));
  floor.position.set(x, y, D.floor - 0.001 * D.size);
  floor.receiveShadow = true;
  viewer.scene.add(light, light.target, floor);
  for (const site of sites) site.node.traverse((node) => { node.castShadow = false; node.receiveShadow = false; });
}

// Look at all that moves from the front, right and above, as near as it fits.
const LOOK = new THREE.Vector3(1.0, 0.55, 1.25).normalize();  // meshcat's camera: y points up
const POINTS = D.points.map(([x, y, z]) => new THREE.Vector3(x, z, -y));
function fit() {
  const tall = Math.tan((36 / 2) * Math.PI / 180) * 0.86;
  const wide = tall * $("pane").clientWidth / Math.max($("pane").clientHeight, 1);
  const right = new THREE.Vector3(0, 1, 0).cross(LOOK).normalize();
  const up = LOOK.clone().cross(right);
  const limits = (axis, tangent) => {  // where the camera's axis must lie, and how far back
    const plus = Math.max(...POINTS.map((p) => p.dot(axis) + p.dot(LOOK) * tangent));
    const minus = Math.max(...POINTS.map((p) => -p.dot(axis) + p.dot(LOOK) * tangent));
    return [(plus - minus) / 2, (plus + minus) / (2 * tangent)];
  };
  const [x, across] = limits(right, wide), [y, along] = limits(up, tall);
  const far = Math.max(across, along, 0.1 * D.size);
  const depth = POINTS.reduce((sum, p) => sum + p.dot(LOOK), 0) / POINTS.length;
  const at = (z) => right.clone().multiplyScalar(x).addScaledVector(up, y).addScaledVector(LOOK, z);
  Object.assign(viewer.camera, {fov: 36, near: D.size / 50, far: 60 * D.size + far});
  viewer.camera.position.copy(at(far));
  viewer.controls.target.copy(at(depth));
  viewer.controls.update();
  viewer.set_dirty();
}

Object.assign($("slider"), {min: t0, max: t1 > t0 ? t1 : t0 + 1e-9});
$("slider").oninput = () => { pause(); show(+$("slider").value); };
$("play").onclick = () => (playing ? pause() : play());
$("back").onclick = () => jump(false);
$("next").onclick = () => jump(true);
$("fit").onclick = fit;
$("strips").addEventListener("pointerdown", (down) => {
  const canvas = down.target;
  if (canvas.tagName !== "CANVAS" || canvas.closest(".ticks")) return;
  const to = (event) => {
    const box = canvas.getBoundingClientRect();
    pause();
    show(t0 + ((event.clientX - box.left) / box.width) * (t1 - t0));
  };
  canvas.setPointerCapture(down.pointerId);
  canvas.onpointermove = to;
  canvas.onpointerup = () => { canvas.onpointermove = null; };
  to(down);
});
document.addEventListener("keydown", (event) => {
  if (["SELECT", "TEXTAREA"].includes(event.target.tagName) || event.ctrlKey || event.metaKey) return;
  const step = 0.02;
  const action = {
    " ": () => (playing ? pause() : play()), n: () => jump(true), p: () => jump(false), f: fit,
    ArrowRight: () => { pause(); show(now + step); }, ArrowLeft: () => { pause(); show(now - step); },
    Home: () => show(t0), End: () => show(t1),
  }[event.key];
  if (!action || (event.key === " " && event.target.tagName === "BUTTON")) return;
  event.preventDefault();
  action();
});
window.addEventListener("resize", lay_out);
viewer.controls.addEventListener("change", place_labels);

// #t=1.2 opens at that time, #play plays
const wish = new URLSearchParams(location.hash.slice(1));
cast_shadows();
lay_out();
fit();
show(wish.has("t") ? +wish.get("t") : t0);
viewer.render();
place_labels();
$("loading").hidden = true;
requestAnimationFrame(tick);
if (wish.has("play")) play();

window.replay = {
  viewer, play, pause, seek: (t) => { pause(); show(t); viewer.render(); }, time: () => now,
  start: t0, end: t1, show: shown, state: (name) => sites.find((s) => s.name === name).state,
};
document.body.dataset.ready = "1";
})().catch((error) => {
  document.getElementById("loading").textContent = "The replay cannot be shown: " + error.message;
  throw error;
});
