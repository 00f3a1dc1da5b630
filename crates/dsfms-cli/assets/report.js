// The viewer of report.html. Plain functions over the packed data of the page; no network, no
// storage. Lengths are in data.unit; surfaces are in camera axes (x right, y down, z forward).
"use strict";
// Text and tables are painted before the viewer is built.
requestAnimationFrame(() => setTimeout(() => {
const $ = (id) => document.getElementById(id);
const data = JSON.parse($("data").textContent);
if (!data.frames.length || !window.THREE) return;
const T = window.THREE;
const unit = data.unit;

// --- Unpacking -------------------------------------------------------------------------------
const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
const words = (text) => new Uint16Array(bytes(text).buffer);
const cloud = (c) => Float32Array.from(words(c.codes), (w, i) => c.origin[i % 3] + c.step * w);
const numbers = (n) => Float32Array.from(words(n.codes), (w) => (w === 65535 ? NaN : n.low + n.step * w));
const faces = new Uint32Array(bytes(data.faces).buffer);
const faceCount = faces.length / 3;
const rest = cloud(data.rest);
const atlas = data.flattening && Float32Array.from(words(data.flattening.uv), (w) => w / 65535);
const structureFaces = data.structures.map((s) => new Uint32Array(bytes(s.faces).buffer));

const known = new Map();
/** Surface of method k in frame f, unpacked once; null where the method failed. */
function surface(f, k) {
  const key = f * data.methods.length + k;
  if (known.has(key)) return known.get(key);
  const packed = data.frames[f].surfaces[k];
  const size = data.frames[f].size;
  const out = packed && {
    at: packed.positions ? cloud(packed.positions) : rest,
    pixels: packed.pixels && Float32Array.from(words(packed.pixels),
      (w, i) => (w === 65535 ? NaN : ((3 * w) / 65534 - 1) * size[i % 2])),
    visible: packed.visible && bytes(packed.visible),
    confidence: packed.confidence && numbers(packed.confidence),
    matches: packed.matches,
    pose: packed.pose,
    structures: (packed.structures || []).map(cloud),
  };
  known.set(key, out);
  return out;
}

// --- Small geometry --------------------------------------------------------------------------
const point = (p, v) => [p[3 * v], p[3 * v + 1], p[3 * v + 2]];
const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const length = (a) => Math.sqrt(dot(a, a));
const apart = (a, b) => length(sub(a, b));
const corners = (f) => [faces[3 * f], faces[3 * f + 1], faces[3 * f + 2]];
const onFace = (p, s) => { // a point given by face and barycentrics
  const c = corners(s.face).map((v) => point(p, v));
  return [0, 1, 2].map((i) => s.b[0] * c[0][i] + s.b[1] * c[1][i] + s.b[2] * c[2][i]);
};
const faceArea = (p, f) => {
  const [a, b, c] = corners(f).map((v) => point(p, v));
  return 0.5 * length(cross(sub(b, a), sub(c, a)));
};

function vertexNormals(p) {
  const n = new Float32Array(p.length);
  for (let f = 0; f < faceCount; f++) {
    const vs = corners(f), [a, b, c] = vs.map((v) => point(p, v));
    const w = cross(sub(b, a), sub(c, a));
    for (const v of vs) for (let i = 0; i < 3; i++) n[3 * v + i] += w[i];
  }
  for (let v = 0; v < n.length; v += 3) {
    const s = Math.hypot(n[v], n[v + 1], n[v + 2]) || 1;
    n[v] /= s; n[v + 1] /= s; n[v + 2] /= s;
  }
  return n;
}

/** Per face, the principal stretch that differs most from 1, minus 1, in per cent. */
function strain(p) {
  return Float32Array.from({ length: faceCount }, (_, f) => {
    const vs = corners(f);
    const edges = (q) => [sub(point(q, vs[1]), point(q, vs[0])), sub(point(q, vs[2]), point(q, vs[0]))];
    const [e, g] = edges(rest), [d, h] = edges(p);
    const l = length(e) || 1e-12, x = dot(e, g) / l, y = Math.sqrt(Math.max(dot(g, g) - x * x, 1e-24));
    // Deformed edges in the rest frame's orthonormal axes: F's columns u and w.
    const u = d.map((v) => v / l), w = [0, 1, 2].map((i) => (h[i] - u[i] * x) / y);
    const a = dot(u, u), b = dot(u, w), c = dot(w, w);
    const mean = 0.5 * (a + c), gap = Math.sqrt(0.25 * (a - c) ** 2 + b * b);
    const large = Math.sqrt(mean + gap) - 1, small = Math.sqrt(Math.max(mean - gap, 0)) - 1;
    return 100 * (Math.abs(large) >= Math.abs(small) ? large : small);
  });
}

// --- Layers ----------------------------------------------------------------------------------
const CIVIDIS = ["00224e", "123570", "3b496c", "575d6d", "707173", "8a8678", "a59c74", "c3b369", "e1cc55", "fee838"];
const DIVERGING = ["053061", "2f79b5", "8ec2dd", "f2efee", "f0a582", "c43b3c", "67001f"];
const rgb = (hex) => [0, 2, 4].map((i) => parseInt(hex.slice(i, i + 2), 16));
const UNKNOWN = [150, 150, 150], CLAY = [214, 180, 168], HIDDEN = [128, 132, 138], SEEN = [46, 134, 171];
/** 256 colours through the stops. */
const table = (stops) => Array.from({ length: 256 }, (_, i) => {
  const x = (i / 255) * (stops.length - 1), k = Math.min(Math.floor(x), stops.length - 2), b = rgb(stops[k + 1]);
  return rgb(stops[k]).map((v, c) => v + (b[c] - v) * (x - k));
});
const SEQUENTIAL = table(CIVIDIS), SIGNED = table(DIVERGING);
const ramp = (colours, t) => colours[Math.round(255 * Math.min(Math.max(t, 0), 1))];

const methods = data.methods.map((_, k) => k);
const estimated = methods.filter((k) => k !== data.truth);
// Asked of the packed surfaces, so that nothing is unpacked before it is shown.
const has = (test) => data.frames.some((frame) => frame.surfaces.some((s) => s && test(s, frame)));
/** Distance of every vertex from its true place; null where the truth is not known. */
const errors = (f, k) => {
  const s = surface(f, k), t = data.truth === undefined ? null : surface(f, data.truth);
  if (!s || !t) return null;
  return (s.errors ??= Float32Array.from({ length: data.vertices }, (_, v) => apart(point(s.at, v), point(t.at, v))));
};
const layers = [];
const add = (present, layer) => present && layers.push(layer);
add(has((s, frame) => s.pixels && s.visible && frame.image), { id: "image", name: "image (grey: not seen)", texture: true });
add(data.albedo && atlas, { id: "albedo", name: "albedo", texture: true });
add(true, { id: "shape", name: "shape" });
add(data.truth !== undefined, { id: "error", name: "error", unit, per: "vertex", values: errors });
add(has((s) => s.confidence), { id: "confidence", name: "expected error", unit, per: "vertex", values: (f, k) => surface(f, k).confidence });
add(has((s) => s.positions), { id: "strain", name: `strain against ${data.reference} (largest stretch of a face)`, unit: "%", per: "face", signed: true, least: 2, values: (f, k) => strain(surface(f, k).at) });
add(has((s) => s.visible), { id: "seen", name: "seen or hidden", per: "vertex", flags: true, values: (f, k) => surface(f, k).visible });
data.scalars.forEach((s) => layers.push({ id: s.name, name: s.name.toLowerCase(), unit: s.unit, per: "vertex", values: () => numbers(s.values) }));
if (data.flattening) {
  const angle = numbers(data.flattening.quasi_conformal);
  layers.push({ id: "angle", name: "angle distortion of the flattening", unit: "", per: "face", low: 1, values: () => angle });
  const area = numbers(data.flattening.log_area).map((v) => 100 * (Math.exp(v) - 1));
  layers.push({ id: "area", name: "area distortion of the flattening", unit: "%", per: "face", signed: true, values: () => area });
}

/** A round number that covers all but the extreme of a layer's values. Of errors: that of the better
 * half of the methods, so that one that went astray does not drown the others. */
function usualLimit(layer) {
  const base = layer.low || 0; // the flattening's ratios start at 1
  const reach = estimated.map((k) => {
    const all = [];
    data.frames.forEach((_, f) => {
      if (surface(f, k)) for (const v of layer.values(f, k) || []) if (Number.isFinite(v)) all.push(Math.abs(v) - base);
    });
    return Float64Array.from(all).sort()[Math.floor(0.95 * (all.length - 1))];
  }).filter(Number.isFinite).sort((a, b) => a - b);
  const v = Math.max(reach[layer.signed ? reach.length - 1 : (reach.length - 1) >> 1] ?? 1, layer.least || 1e-6), decade = 10 ** Math.floor(Math.log10(v));
  return base + [1, 1.5, 2, 3, 4, 5, 6, 8, 10].find((s) => s * decade >= v * 0.999) * decade;
}
const limitOf = (layer) => (layer.limit ??= usualLimit(layer));
function colourOf(layer, v) {
  if (layer.flags) return v ? SEEN : HIDDEN;
  if (!Number.isFinite(v)) return UNKNOWN;
  const limit = limitOf(layer), low = layer.low || 0;
  return layer.signed ? ramp(SIGNED, 0.5 + (0.5 * v) / limit) : ramp(SEQUENTIAL, (v - low) / (limit - low));
}
const text = (v, digits = 3) => {
  if (!Number.isFinite(v)) return "–";
  return v === 0 ? "0" : v.toFixed(Math.min(Math.max(digits - 1 - Math.floor(Math.log10(Math.abs(v))), 0), 4)).replace("-", "−");
};

// --- State -----------------------------------------------------------------------------------
const state = { frame: 0, layer: layers[0], shown: [data.chosen], picks: [], playing: 0 };
// A template is not one image's: its own albedo first.
if (data.moving_camera || !has((s, frame) => frame.image)) state.layer = layers.find((l) => l.id === "albedo") || state.layer;

// --- The 3D scene ----------------------------------------------------------------------------
const canvas = $("gl");
/** Whether the processor draws: smooth edges would halve the frame rate there. */
function software() {
  const gl = document.createElement("canvas").getContext("webgl2"), name = gl && gl.getExtension("WEBGL_debug_renderer_info");
  return !!name && /swiftshader|llvmpipe|softpipe|software/i.test(gl.getParameter(name.UNMASKED_RENDERER_WEBGL));
}
let renderer;
try {
  renderer = new T.WebGLRenderer({ canvas, antialias: !software(), preserveDrawingBuffer: true });
} catch (error) {
  canvas.replaceWith("This browser has no WebGL; the 3D view is left out.");
}
const scene = new T.Scene();
const root = new T.Group();
root.rotation.x = Math.PI; // camera axes (y down, z forward) to the viewer's (y up, z backward)
scene.add(root, new T.AmbientLight(0xffffff, 1.7));
const lamp = new T.DirectionalLight(0xffffff, 1.7);
const eye = new T.PerspectiveCamera(40, 1, 0.1, 1000);
eye.add(lamp, lamp.target);
lamp.position.set(-0.35, 0.5, 1); // a little above and left, so that relief shows
scene.add(eye);

const texture = (image, mipmaps) => {
  const t = new T.Texture(image);
  t.colorSpace = T.SRGBColorSpace;
  t.generateMipmaps = mipmaps; t.minFilter = 1006; // LinearFilter
  image.decode().then(() => { t.needsUpdate = true; draw(); }).catch(() => {});
  return t;
};
const picture = (source) => Object.assign(new Image(), { src: source });
const photos = data.frames.map((f) => f.image && picture(f.image));
const photoTextures = [];
const photoTexture = (f) => photos[f] && (photoTextures[f] ??= texture(photos[f], false));
const albedoImage = data.albedo && picture(data.albedo);
const albedoTexture = albedoImage && texture(albedoImage, false);

const side = T.DoubleSide;
const painted = new T.MeshLambertMaterial({ vertexColors: true, side, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 });
const photographed = new T.MeshBasicMaterial({ side, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 });
const bare = new T.MeshLambertMaterial({ side, map: albedoTexture || null, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 });
const edgeInk = new T.LineBasicMaterial({ color: 0x101418, transparent: true, opacity: 0.35 });
const ghostInk = new T.LineBasicMaterial({ color: 0x2b6cb0, transparent: true, opacity: 0.55 });
const truthInk = new T.LineBasicMaterial({ color: 0x1f8a55, transparent: true, opacity: 0.7 });
// Transparent, so that they are drawn after all other lines.
const pathInk = new T.LineBasicMaterial({ color: 0xe91e78, depthTest: false, transparent: true });
const pinInk = new T.MeshBasicMaterial({ color: 0xe91e78, depthTest: false, transparent: true });
const BURIED = ["#f2a900", "#3f7fd0", "#6fbf73", "#c86fc9"];
const buried = BURIED.map((c) => new T.MeshLambertMaterial({ color: c, side }));

const edgeList = (() => {
  const seen = new Map();
  for (let f = 0; f < faceCount; f++) corners(f).forEach((a, i, vs) => {
    const b = vs[(i + 1) % 3], key = Math.min(a, b) * data.vertices + Math.max(a, b);
    if (!seen.has(key)) seen.set(key, [Math.min(a, b), Math.max(a, b)]);
    seen.get(key).push(vs[(i + 2) % 3]); // the vertex opposite, one per face
  });
  return [...seen.values()];
})();
const lineIndex = new T.BufferAttribute(Uint32Array.from(edgeList.flatMap((e) => [e[0], e[1]])), 1);
const wire = (ink) => {
  const g = new T.BufferGeometry();
  g.setAttribute("position", new T.BufferAttribute(new Float32Array(3 * data.vertices), 3));
  g.setIndex(lineIndex);
  return new T.LineSegments(g, ink);
};
const setPoints = (object, p) => {
  object.geometry.attributes.position.array.set(p);
  object.geometry.attributes.position.needsUpdate = true;
  object.geometry.computeBoundingSphere();
};

/** One method's objects. Faces have corners of their own, so that a colour can belong to a face. */
const columns = data.methods.map(() => {
  const geometry = new T.BufferGeometry();
  for (const [name, width] of [["position", 3], ["normal", 3], ["color", 3], ["uv", 2]])
    geometry.setAttribute(name, new T.BufferAttribute(new Float32Array(3 * width * faceCount), width));
  const group = new T.Group(), mesh = new T.Mesh(geometry, [painted, painted]);
  const pins = ["A", "B"].map(() => new T.Mesh(new T.SphereGeometry(1, 16, 12), pinInk));
  const path = new T.LineSegments(new T.BufferGeometry(), pathInk);
  const column = { group, mesh, pins, path, edges: wire(edgeInk), ghost: wire(ghostInk), truth: wire(truthInk), buried: [] };
  column.buried = data.structures.map((_, i) => {
    const g = new T.BufferGeometry();
    g.setIndex(new T.BufferAttribute(structureFaces[i], 1));
    return new T.Mesh(g, buried[i % buried.length]);
  });
  pins.concat(path).forEach((o) => { o.renderOrder = 2; o.visible = false; });
  group.add(mesh, column.edges, column.ghost, column.truth, path, ...pins, ...column.buried);
  root.add(group);
  return column;
});

const linearOf = Float32Array.from({ length: 256 }, (_, v) => { const s = v / 255; return s <= 0.04045 ? s / 12.92 : ((s + 0.055) / 1.055) ** 2.4; });
/** Colour of every corner, 0 to 255; clay or grey where the layer has no values. */
function cornerColours(layer, f, k) {
  const out = new Uint8Array(9 * faceCount);
  const values = layer.values && layer.values(f, k);
  const hidden = layer.id === "image" ? HIDDEN : CLAY;
  for (let c = 0; c < 3 * faceCount; c++) {
    const v = layer.per === "face" ? Math.floor(c / 3) : faces[c];
    out.set(values ? colourOf(layer, values[v]) : hidden, 3 * c);
  }
  return out;
}

function paint(k) {
  const column = columns[k], s = surface(state.frame, k), layer = state.layer;
  column.group.visible = !!s;
  if (!s) return;
  const g = column.mesh.geometry, normals = vertexNormals(s.at);
  const position = g.attributes.position.array, normal = g.attributes.normal.array, uv = g.attributes.uv.array;
  faces.forEach((v, c) => {
    for (let i = 0; i < 3; i++) { position[3 * c + i] = s.at[3 * v + i]; normal[3 * c + i] = normals[3 * v + i]; }
  });
  cornerColours(layer, state.frame, k).forEach((v, i) => { g.attributes.color.array[i] = linearOf[v]; });
  const photo = layer.id === "image" && s.pixels && s.visible && photoTexture(state.frame);
  const size = data.frames[state.frame].size;
  if (photo) faces.forEach((v, c) => {
    uv[2 * c] = (s.pixels[2 * v] + 0.5) / size[0];
    uv[2 * c + 1] = 1 - (s.pixels[2 * v + 1] + 0.5) / size[1];
  });
  else if (atlas) uv.set(atlas);
  // The part that the image does not show comes last, in grey.
  const seen = photo ? [] : null, unseen = [];
  for (let f = 0; f < faceCount; f++)
    (photo && corners(f).every((v) => s.visible[v]) ? seen : unseen).push(3 * f, 3 * f + 1, 3 * f + 2);
  const order = (seen || []).concat(unseen);
  g.setIndex(new T.BufferAttribute(Uint32Array.from(order), 1));
  g.clearGroups();
  const first = seen ? seen.length : 0;
  if (first) g.addGroup(0, first, 0);
  g.addGroup(first, order.length - first, 1);
  photographed.map = photo || null;
  photographed.needsUpdate = true;
  column.mesh.material = [photographed, layer.id === "albedo" ? bare : painted];
  for (const a of Object.values(g.attributes)) a.needsUpdate = true;
  g.computeBoundingSphere();
  setPoints(column.edges, s.at);
  const truth = data.truth !== undefined && surface(state.frame, data.truth);
  if (truth) setPoints(column.truth, truth.at);
  if (s.pose) setPoints(column.ghost, posed(s.pose, rest));
  column.buried.forEach((mesh, i) => {
    mesh.visible = !!s.structures[i];
    if (!mesh.visible) return;
    mesh.geometry.setAttribute("position", new T.BufferAttribute(s.structures[i], 3));
    mesh.geometry.computeVertexNormals();
    mesh.geometry.computeBoundingSphere();
  });
}
const posed = (m, p) => Float32Array.from(p, (_, j) => {
  const v = 3 * Math.floor(j / 3), r = m[j % 3];
  return r[0] * p[v] + r[1] * p[v + 1] + r[2] * p[v + 2] + r[3];
});

// --- Cameras, light, sparse points -----------------------------------------------------------
const rig = new T.Group(), sparse = new T.Group();
root.add(rig, sparse);
const centre = new T.Vector3();
let radius = 1;
function measureScene() {
  const k = surface(state.frame, data.chosen) ? data.chosen : methods.find((m) => surface(state.frame, m));
  const p = k === undefined ? rest : surface(state.frame, k).at;
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  p.forEach((v, i) => { low[i % 3] = Math.min(low[i % 3], v); high[i % 3] = Math.max(high[i % 3], v); });
  const mid = low.map((v, i) => 0.5 * (v + high[i]));
  centre.set(mid[0], -mid[1], -mid[2]);
  radius = 0;
  for (let v = 0; v < p.length / 3; v++) radius = Math.max(radius, apart(point(p, v), mid));
  radius = radius || 1;
}
/** Lines of a camera's frustum in its own axes, `depth` long. */
function frustum(depth) {
  const c = data.camera, at = (x, y) => [depth * (x - c.centre[0]) / c.focal[0], depth * (y - c.centre[1]) / c.focal[1], depth];
  const q = [at(0, 0), at(c.size[0], 0), at(c.size[0], c.size[1]), at(0, c.size[1])], o = [0, 0, 0];
  // A small triangle marks the image's upper side.
  const roof = at(c.size[0] / 2, -0.25 * c.size[1]);
  return [o, q[0], o, q[1], o, q[2], o, q[3], q[0], q[1], q[1], q[2], q[2], q[3], q[3], q[0], q[0], roof, roof, q[1]];
}
const inverse = (m, p) => { // of a rigid motion
  const d = [0, 1, 2].map((r) => p[r] - m[r][3]);
  return [0, 1, 2].map((c) => m[0][c] * d[0] + m[1][c] * d[1] + m[2][c] * d[2]);
};
function segments(list, colour, opacity) {
  const g = new T.BufferGeometry();
  g.setAttribute("position", new T.BufferAttribute(Float32Array.from(list.flat()), 3));
  return new T.LineSegments(g, new T.LineBasicMaterial({ color: colour, transparent: true, opacity }));
}
function buildRig() {
  rig.clear();
  if (!data.camera) return;
  const ink = getComputedStyle(document.documentElement).getPropertyValue("--fg").trim();
  const length = data.moving_camera ? 0.22 * radius : 0.4 * Math.max(centre.length() - radius, 0.5 * radius);
  if (!data.moving_camera) rig.add(segments(frustum(length), ink, 0.8));
  else data.frames.forEach((frame, f) => {
    if (!frame.pose) return;
    const now = f === state.frame;
    rig.add(segments(frustum(now ? 2 * length : length).map((p) => inverse(frame.pose, p)), now ? "#d81b60" : ink, now ? 1 : 0.45));
  });
  // A light is rigid on the camera: shown at the current one.
  const pose = data.frames[state.frame].pose;
  for (const at of data.lights) {
    const ball = new T.Mesh(new T.SphereGeometry(0.03 * radius, 16, 12), new T.MeshBasicMaterial({ color: 0xf2b705 }));
    ball.position.set(...(data.moving_camera && pose ? inverse(pose, at) : at));
    rig.add(ball);
  }
}
if (data.points) {
  const g = new T.BufferGeometry();
  g.setAttribute("position", new T.BufferAttribute(cloud(data.points), 3));
  sparse.add(new T.Points(g, new T.PointsMaterial({ color: 0xe07b00, size: 2, sizeAttenuation: false })));
}

// --- Viewing ---------------------------------------------------------------------------------
const controls = renderer && new T.OrbitControls(eye, canvas);
let fit = 0.7; // full angle that must fit into a cell, rad
function view(kind) {
  if (!controls) return;
  // From the camera's place where there is one outside the surface, else from three radii before it.
  const pose = data.moving_camera && data.frames[state.frame].pose, [cx, cy, cz] = pose ? inverse(pose, [0, 0, 0]) : [0, 0, 0];
  const place = new T.Vector3(cx, -cy, -cz), own = place.distanceTo(centre);
  const inCamera = (data.camera || !data.moving_camera) && own > 1.15 * radius;
  const whole = kind === "all" && data.camera;
  const target = whole ? centre.clone().lerp(place, 0.5) : centre.clone();
  const back = inCamera ? place.sub(centre).divideScalar(own) : new T.Vector3(0, 0, 1);
  const [yaw, pitch] = { camera: [0, 0], left: [-65, 0], right: [65, 0], top: [0, 65], all: [-55, 25] }[kind].map((d) => (d * Math.PI) / 180);
  const level = Math.atan2(back.x, back.z) + yaw, rise = Math.min(Math.asin(back.y) + pitch, 1.5);
  const reach = whole ? (data.moving_camera ? 1 : 0.5) * (own + radius) : radius;
  const away = whole ? 3.2 * reach : inCamera ? own : 3 * radius;
  fit = 2 * Math.asin(Math.min(reach / away, 0.9)) * 1.04;
  eye.position.set(Math.sin(level) * Math.cos(rise), Math.sin(rise), Math.cos(level) * Math.cos(rise)).multiplyScalar(away).add(target);
  eye.near = radius / 100; eye.far = 40 * (radius + own);
  controls.target.copy(target);
  controls.update();
  draw();
}

let due = false;
/** Ask for one drawing at the next screen refresh. */
function draw() {
  if (due || !renderer) return;
  due = true;
  requestAnimationFrame(() => { due = false; render(); });
}
/** The grid in which n cells are largest. */
function grid(n, w, h) {
  let best = { columns: 1, rows: n, size: 0 };
  for (let c = 1; c <= n; c++) {
    const r = Math.ceil(n / c), size = Math.min(w / c, h / r);
    if (size > best.size * 1.02) best = { columns: c, rows: r, size };
  }
  return best;
}
function cells() {
  const w = canvas.clientWidth, h = canvas.clientHeight, g = grid(state.shown.length, w, h);
  return state.shown.map((k, i) => ({ k, x: ((i % g.columns) * w) / g.columns, y: (Math.floor(i / g.columns) * h) / g.rows, w: w / g.columns, h: h / g.rows }));
}
function aim(cell) {
  eye.aspect = cell.w / cell.h;
  const half = Math.tan(fit / 2) / Math.min(eye.aspect, 1);
  eye.fov = (2 * Math.atan(half) * 180) / Math.PI;
  eye.updateProjectionMatrix();
}
function render() {
  const w = canvas.clientWidth, h = canvas.clientHeight;
  if (!w || !h) return;
  renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
  renderer.setSize(w, h, false);
  renderer.setScissorTest(true);
  const solid = data.structures.length ? $("solid").value / 100 : 1;
  for (const m of [painted, photographed, bare]) { m.opacity = solid; m.transparent = solid < 1; m.depthWrite = solid === 1; }
  const labels = [];
  for (const cell of cells()) {
    aim(cell);
    columns.forEach((c, k) => {
      c.group.visible = k === cell.k && !!surface(state.frame, k);
      c.edges.visible = $("edges").checked;
      c.ghost.visible = $("ghost").checked && !!(surface(state.frame, k) || {}).pose;
      c.truth.visible = $("truth").checked && data.truth !== undefined && k !== data.truth;
    });
    rig.visible = $("rig").checked; sparse.visible = $("points").checked;
    renderer.setViewport(cell.x, h - cell.y - cell.h, cell.w, cell.h);
    renderer.setScissor(cell.x, h - cell.y - cell.h, cell.w, cell.h);
    renderer.setClearColor(getComputedStyle(document.documentElement).getPropertyValue("--space").trim(), 1);
    renderer.render(scene, eye);
    labels.push(cellLabel(cell));
  }
  $("labels").innerHTML = labels.join("");
}
const escape = (t) => t.replace(/[&<>"]/g, (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" }[c]));
function cellLabel(cell) {
  const status = data.frames[state.frame].status[cell.k];
  const name = data.methods.length > 1 || !data.moving_camera ? escape(data.methods[cell.k]) : "";
  const note = surface(state.frame, cell.k) ? summaryOf(cell.k) : "no surface";
  const mark = status === "ok" ? "" : ` <b class="${status}" style="position:static;border:0">${status}</b>`;
  let html = name ? `<span style="left:${cell.x}px;top:${cell.y}px">${name}${mark} ${note}</span>` : "";
  columns[cell.k].pins.forEach((pin, i) => {
    if (!pin.visible || !columns[cell.k].group) return;
    const p = pin.getWorldPosition(new T.Vector3()).project(eye);
    html += `<i style="left:${cell.x + (0.5 + 0.5 * p.x) * cell.w}px;top:${cell.y + (0.5 - 0.5 * p.y) * cell.h}px">${"AB"[i]}</i>`;
  });
  return html + scaleBar(cell);
}
/** A length at the distance of the orbit's centre. */
function scaleBar(cell) {
  const perPixel = (2 * Math.tan((eye.fov * Math.PI) / 360) * eye.position.distanceTo(controls.target)) / cell.h;
  const wanted = 0.28 * cell.w * perPixel, decade = 10 ** Math.floor(Math.log10(wanted));
  const long = [5, 2, 1].find((s) => s * decade <= wanted) * decade, wide = long / perPixel;
  const x = cell.x + cell.w - wide - 12, y = cell.y + cell.h - 16;
  return `<b style="left:${x}px;top:${y}px;width:${wide}px"></b><u style="right:${canvas.clientWidth - cell.x - cell.w + 12}px;top:${y - 20}px">${text(long, 1)} ${unit}</u>`;
}
const mean = (a) => a.reduce((s, v) => s + v, 0) / a.length;
function summaryOf(k) {
  if (data.truth === undefined || k === data.truth || state.layer.id !== "error") return "";
  return `${mean(errors(state.frame, k)).toFixed(2)} ${unit} mean`;
}

// --- The image -------------------------------------------------------------------------------
function drawOverlay() {
  const frame = data.frames[state.frame], k = +$("overlay-method").value || 0, s = surface(state.frame, k);
  const image = $("photo"), out = $("overlay"), kind = $("overlay-kind").value;
  $("image-pane").hidden = !data.frames.some((f) => f.image);
  document.querySelector(".panes").classList.toggle("single", $("image-pane").hidden);
  if ($("image-pane").hidden) return;
  const source = frame.image || "";
  if (image.getAttribute("src") !== source) { if (source) image.src = source; else image.removeAttribute("src"); }
  image.alt = `Image of ${frame.name}`;
  image.width = frame.size[0]; image.height = frame.size[1];
  const scale = Math.max(1, 960 / frame.size[0]); // fine lines on small images
  out.width = frame.size[0] * scale; out.height = frame.size[1] * scale;
  const ink = out.getContext("2d");
  // Pixel centres are at integers; the canvas has its origin at a corner.
  ink.setTransform(scale, 0, 0, scale, 0.5 * scale, 0.5 * scale);
  if (!s || !s.pixels || kind === "none") return;
  const seen = (v) => (!s.visible || s.visible[v]) && Number.isFinite(s.pixels[2 * v]);
  const at = (v) => [s.pixels[2 * v], s.pixels[2 * v + 1]];
  ink.globalAlpha = $("opacity").value / 100;
  if (kind === "colours" && !state.layer.texture) fillFaces(ink, s, k, seen, at);
  else {
    ink.strokeStyle = "#5ad2ff"; ink.lineWidth = 1;
    ink.beginPath();
    for (const [a, b] of edgeList) if (seen(a) && seen(b)) { ink.moveTo(...at(a)); ink.lineTo(...at(b)); }
    ink.stroke();
  }
  ink.globalAlpha = 1;
  if ($("matches").checked) drawMatches(ink, s.matches, frame.size[0] / 640);
  drawPins(ink, s, frame.size[0] / 640);
}
function fillFaces(ink, s, k, seen, at) {
  const colours = cornerColours(state.layer, state.frame, k);
  // Far faces first, so that folds hide what is behind them.
  const order = [...Array(faceCount).keys()].filter((f) => corners(f).every(seen));
  const depth = (f) => corners(f).reduce((z, v) => z + s.at[3 * v + 2], 0);
  order.sort((a, b) => depth(b) - depth(a));
  for (const f of order) {
    const c = [0, 1, 2].map((i) => Math.round((colours[9 * f + i] + colours[9 * f + 3 + i] + colours[9 * f + 6 + i]) / 3));
    ink.fillStyle = ink.strokeStyle = `rgb(${c})`;
    ink.lineWidth = 0.4;
    ink.beginPath();
    corners(f).forEach((v, i) => (i ? ink.lineTo(...at(v)) : ink.moveTo(...at(v))));
    ink.closePath(); ink.fill();
  }
}
/** Kept: discs. Refused: crosses. */
function drawMatches(ink, matches, r) {
  for (const [x, y, kept] of matches) {
    ink.lineWidth = 1.2 * r; ink.strokeStyle = "#000";
    ink.beginPath();
    if (kept) {
      ink.fillStyle = "#28dc5a"; ink.arc(x, y, 3 * r, 0, 7); ink.fill(); ink.stroke();
      continue;
    }
    ink.moveTo(x - 4 * r, y - 4 * r); ink.lineTo(x + 4 * r, y + 4 * r); ink.moveTo(x + 4 * r, y - 4 * r); ink.lineTo(x - 4 * r, y + 4 * r);
    ink.lineWidth = 3.4 * r; ink.stroke(); ink.lineWidth = 1.8 * r; ink.strokeStyle = "#ff5050"; ink.stroke();
  }
}
function drawPins(ink, s, r) {
  state.picks.forEach((pick, i) => {
    const q = [0, 1].map((c) => corners(pick.face).reduce((t, v, j) => t + pick.b[j] * s.pixels[2 * v + c], 0));
    ink.fillStyle = "#d81b60"; ink.strokeStyle = "#fff"; ink.lineWidth = 1.5 * r;
    ink.beginPath(); ink.arc(...q, 4.5 * r, 0, 7); ink.fill(); ink.stroke();
    ink.font = `700 ${16 * r}px system-ui,sans-serif`; ink.lineWidth = 3 * r;
    ink.strokeText("AB"[i], q[0] + 7 * r, q[1] - 6 * r); ink.fillText("AB"[i], q[0] + 7 * r, q[1] - 6 * r);
  });
}

// --- Measuring -------------------------------------------------------------------------------
// Neighbours of every vertex: over an edge, and straight across the edge between two faces.
const ways = (() => {
  const out = Array.from({ length: data.vertices }, () => []);
  for (const [a, b, c, d] of edgeList) {
    out[a].push([b]); out[b].push([a]);
    if (d !== undefined) { out[c].push([d, a, b]); out[d].push([c, a, b]); }
  }
  return out;
})();
function wayLength(p, from, [to, a, b]) {
  const [s, t] = [point(p, from), point(p, to)];
  if (a === undefined) return apart(s, t);
  // Unfold both faces about the edge a-b; the way is usable where it crosses that edge.
  const o = point(p, a), e = sub(point(p, b), o), l = length(e);
  const flat = (q) => { const d = sub(q, o), x = dot(d, e) / l; return [x, Math.sqrt(Math.max(dot(d, d) - x * x, 0))]; };
  const [x1, y1] = flat(s), [x2, y2] = flat(t), x = x1 + ((x2 - x1) * y1) / (y1 + y2 || 1);
  return x >= 0 && x <= l ? Math.hypot(x1 - x2, y1 + y2) : Infinity;
}
/** Distances along the surface p from the point A, and the vertex before each (-1 at the start). */
function distances(p, A) {
  const d = new Float64Array(data.vertices).fill(Infinity), before = new Int32Array(data.vertices).fill(-1);
  const heap = [], start = onFace(p, A);
  const up = (i) => { while (i && heap[i][0] < heap[(i - 1) >> 1][0]) { const j = (i - 1) >> 1; [heap[i], heap[j]] = [heap[j], heap[i]]; i = j; } };
  const push = (v, t) => { heap.push([t, v]); up(heap.length - 1); };
  const pop = () => {
    const top = heap[0], last = heap.pop();
    if (heap.length) {
      heap[0] = last;
      for (let i = 0; ;) {
        let m = i;
        for (const j of [2 * i + 1, 2 * i + 2]) if (j < heap.length && heap[j][0] < heap[m][0]) m = j;
        if (m === i) break;
        [heap[i], heap[m]] = [heap[m], heap[i]]; i = m;
      }
    }
    return top;
  };
  for (const v of corners(A.face)) { d[v] = apart(start, point(p, v)); push(v, d[v]); }
  while (heap.length) {
    const [t, v] = pop();
    if (t > d[v]) continue;
    for (const way of ways[v]) {
      const next = t + wayLength(p, v, way);
      if (next < d[way[0]]) { d[way[0]] = next; before[way[0]] = v; push(way[0], next); }
    }
  }
  return { d, before };
}
function alongSurface(p, A, B) {
  const end = onFace(p, B), start = onFace(p, A);
  if (A.face === B.face) return { length: apart(start, end), path: [start, end] };
  const { d, before } = distances(p, A);
  const total = (v) => d[v] + apart(point(p, v), end);
  let v = corners(B.face).reduce((a, b) => (total(b) < total(a) ? b : a));
  const result = { length: total(v), path: [end] };
  for (; v >= 0; v = before[v]) result.path.push(point(p, v));
  result.path.push(start);
  return result;
}
/** Faces within the radius of A along the surface at rest. */
function patch() {
  const [A] = state.picks, r = +$("radius").value;
  if (!A || !(r > 0)) return [];
  const { d } = distances(rest, A);
  return [...Array(faceCount).keys()].filter((f) => mean(corners(f).map((v) => d[v])) <= r);
}
const total = (p, list) => list.reduce((s, f) => s + faceArea(p, f), 0);
const interpolated = (values, s) => corners(s.face).reduce((t, v, j) => t + s.b[j] * values[v], 0);
/** Everything measured on one surface. */
function measureOn(p, confidence, list) {
  const [A, B] = state.picks, out = { area: total(p, list) };
  out.strain = list.length ? mean(list.map((f) => strainNow(p)[f])) : NaN;
  if (B) {
    out.straight = apart(onFace(p, A), onFace(p, B));
    Object.assign(out, { along: alongSurface(p, A, B) });
    if (confidence) out.expected = Math.hypot(interpolated(confidence, A), interpolated(confidence, B));
  }
  return out;
}
const strainKnown = new WeakMap();
const strainNow = (p) => { if (!strainKnown.has(p)) strainKnown.set(p, strain(p)); return strainKnown.get(p); };
const percent = (v) => {
  if (!Number.isFinite(v)) return "–";
  const shown = Math.abs(v).toFixed(1);
  return `${shown === "0.0" ? "" : v > 0 ? "+" : "−"}${shown} %`;
};

function measured() {
  const list = patch(), reference = state.picks.length ? measureOn(rest, null, list) : {};
  const rows = state.picks.length ? methods.flatMap((k) => {
    const s = surface(state.frame, k);
    return s ? [[data.methods[k], measureOn(s.at, s.confidence, list), k]] : [];
  }) : [];
  const table = $("measured"), B = state.picks.length > 1, expected = rows.some((r) => r[1].expected !== undefined);
  const against = data.moving_camera ? "" : `; change and strain against ${data.reference}`;
  const title = `${B ? "Between A and B" : "Around A; pick a second point for distances"}, ${data.frames[state.frame].name}${against}`;
  table.caption.textContent = state.picks.length ? title : "Pick two points to measure";
  const head = ["", ...(B ? [`straight, ${unit}`, `along the surface, ${unit}`, "change"] : []), ...(expected && B ? [`expected error, ${unit}`] : []), `patch area, ${unit}²`, "change", "mean strain"];
  table.tHead.innerHTML = state.picks.length ? `<tr>${head.map((h) => `<th scope="col">${h}</th>`).join("")}</tr>` : "";
  const line = (name, m, change) => {
    const c = (a, b) => (change ? percent(100 * (a / b - 1)) : "");
    const two = B ? [text(m.straight, 4), text(m.along.length, 4), c(m.along.length, reference.along.length), ...(expected ? [text(m.expected, 2)] : [])] : [];
    const cellsOf = [...two, list.length ? text(m.area, 4) : "–", list.length ? c(m.area, reference.area) : "", change ? percent(m.strain) : ""];
    return `<tr><th scope="row">${escape(name)}</th>${cellsOf.map((v) => `<td>${v}</td>`).join("")}</tr>`;
  };
  const resting = state.picks.length && !data.moving_camera ? line(data.reference, reference, false) : "";
  table.tBodies[0].innerHTML = resting + rows.map((r) => line(r[0], r[1], !data.moving_camera)).join("");
  $("uncertainty").textContent = expected ? " Expected error: the two points' own, taken as independent." : "";
  columns.forEach((column, k) => placePins(column, surface(state.frame, k), rows.find((r) => r[2] === k)));
  drawOverlay(); draw();
}
function placePins(column, s, row) {
  column.pins.forEach((pin, i) => {
    pin.visible = !!s && i < state.picks.length;
    if (!pin.visible) return;
    pin.position.set(...onFace(s.at, state.picks[i]));
    pin.scale.setScalar(0.014 * radius);
  });
  column.path.visible = !!(row && row[1].along);
  if (!column.path.visible) return;
  const way = row[1].along.path, list = way.slice(1).flatMap((q, i) => [...way[i], ...q]);
  column.path.geometry.dispose();
  column.path.geometry = new T.BufferGeometry();
  column.path.geometry.setAttribute("position", new T.BufferAttribute(Float32Array.from(list), 3));
}
function csv() {
  const list = patch(), [A, B] = state.picks;
  const place = (s) => (s ? [s.face, ...s.b.map((v) => v.toFixed(6))] : ["", "", "", ""]);
  const u = unit === "mm" ? "mm" : "units";
  const rows = [["frame", "method", "status", "a_face", "a_b1", "a_b2", "a_b3", "b_face", "b_b1", "b_b2", "b_b3", `straight_${u}`, `along_surface_${u}`, `expected_error_${u}`, `patch_radius_${u}`, `patch_area_${u}2`, "patch_mean_strain_percent"]];
  const number = (v) => (Number.isFinite(v) ? v.toPrecision(7) : "");
  const push = (frame, name, status, p, confidence) => {
    const m = measureOn(p, confidence, list);
    rows.push([frame, name, status, ...place(A), ...place(B), number(m.straight), number(m.along && m.along.length), number(m.expected), $("radius").value, list.length ? number(m.area) : "", number(m.strain)]);
  };
  if (A) {
    if (!data.moving_camera) push("", data.reference, "", rest, null);
    data.frames.forEach((frame, f) => methods.forEach((k) => {
      const s = surface(f, k);
      if (s) push(frame.name, data.methods[k], frame.status[k], s.at, s.confidence);
    }));
  }
  const quoted = (v) => (/[",\n]/.test(v) ? `"${String(v).replace(/"/g, '""')}"` : v);
  return rows.map((r) => r.map(quoted).join(",")).join("\n") + "\n";
}
function save(name, content) {
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(new Blob([content], { type: "text/csv" })), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
function pick(place) {
  state.picks = state.picks.length > 1 ? [place] : [...state.picks, place];
  const own = (i) => { const s = state.picks[i]; return s ? corners(s.face)[s.b.indexOf(Math.max(...s.b))] : ""; };
  $("vertex-a").value = own(0); $("vertex-b").value = own(1);
  measured();
}
const atVertex = (v) => {
  const c = faces.indexOf(v);
  return c < 0 ? null : { face: Math.floor(c / 3), b: [0, 1, 2].map((i) => (i === c % 3 ? 1 : 0)) };
};
function pickAt(x, y) {
  const box = canvas.getBoundingClientRect(), px = x - box.left, py = y - box.top;
  const cell = cells().find((c) => px >= c.x && px < c.x + c.w && py >= c.y && py < c.y + c.h);
  if (!cell || !surface(state.frame, cell.k)) return;
  aim(cell);
  const ray = new T.Raycaster(), mesh = columns[cell.k].mesh;
  ray.setFromCamera(new T.Vector2((2 * (px - cell.x)) / cell.w - 1, 1 - (2 * (py - cell.y)) / cell.h), eye);
  const hit = ray.intersectObject(mesh)[0];
  if (!hit) return;
  const face = Math.floor(hit.face.a / 3), q = mesh.worldToLocal(hit.point.clone()).toArray(), p = surface(state.frame, cell.k).at;
  const c = corners(face).map((v) => point(p, v)), n = cross(sub(c[1], c[0]), sub(c[2], c[0])), nn = dot(n, n);
  const b1 = dot(cross(sub(c[2], c[1]), sub(q, c[1])), n) / nn, b2 = dot(cross(sub(c[0], c[2]), sub(q, c[2])), n) / nn;
  pick({ face, b: [b1, b2, 1 - b1 - b2] });
}

// --- Legends, flattening ---------------------------------------------------------------------
function legend(layer, bar, ticks) {
  if (!layer.values) { bar.hidden = true; ticks.innerHTML = ""; return; }
  if (layer.flags) {
    bar.hidden = true;
    ticks.innerHTML = `<span><b style="color:rgb(${SEEN})">■</b> seen</span><span><b style="color:rgb(${HIDDEN})">■</b> hidden or outside</span>`;
    return;
  }
  bar.hidden = false;
  bar.width = 256;
  const ink = bar.getContext("2d"), limit = limitOf(layer), low = layer.signed ? -limit : layer.low || 0;
  for (let x = 0; x < 256; x++) { ink.fillStyle = `rgb(${colourOf(layer, low + ((limit - low) * x) / 255)})`; ink.fillRect(x, 0, 1, 12); }
  const sign = (v) => (layer.signed && v > 0 ? "+" : "") + text(v, layer.low ? 3 : 2);
  ticks.innerHTML = [0, 0.5, 1].map((t, i) => `<span>${sign(low + t * (limit - low))}${i === 2 && layer.unit ? ` ${layer.unit}` : ""}</span>`).join("");
}
function drawFlattening() {
  $("flat").hidden = !atlas;
  if (!atlas) return;
  const layer = layers.find((l) => l.id === $("flat-layer").value), values = layer.values();
  // Only the part of the unit square that is used.
  const low = [1, 1], high = [0, 0];
  atlas.forEach((v, i) => { low[i % 2] = Math.min(low[i % 2], v); high[i % 2] = Math.max(high[i % 2], v); });
  const scale = 1000 / Math.max(high[0] - low[0], 1e-6), tall = Math.ceil(scale * (high[1] - low[1]));
  for (const id of ["chart", "chart-albedo"]) { $(id).width = 1000; $(id).height = tall; }
  legend(layer, $("flat-ramp"), $("flat-ticks"));
  const ink = $("chart").getContext("2d");
  for (let f = 0; f < faceCount; f++) {
    ink.fillStyle = ink.strokeStyle = `rgb(${colourOf(layer, values[f]).map(Math.round)})`;
    ink.beginPath();
    for (let c = 0; c < 3; c++) ink[c ? "lineTo" : "moveTo"](scale * (atlas[6 * f + 2 * c] - low[0]), scale * (high[1] - atlas[6 * f + 2 * c + 1]));
    ink.closePath(); ink.fill(); ink.lineWidth = 0.6; ink.stroke();
  }
  $("albedo-figure").hidden = !albedoImage;
  if (albedoImage) albedoImage.decode().then(() => {
    $("chart-albedo").getContext("2d").drawImage(albedoImage, -scale * low[0], -scale * (1 - high[1]), scale, scale);
  }).catch(() => {});
}

// --- Bringing it together --------------------------------------------------------------------
function readout() {
  const frame = data.frames[state.frame];
  const parts = state.shown.map((k) => {
    const s = surface(state.frame, k), name = data.methods[k];
    if (!s) return `${name}: ${frame.status[k]}, no surface`;
    const bits = [];
    if (k !== data.truth && frame.status[k] !== "ok") bits.push(frame.status[k]);
    if (s.visible) bits.push(`${s.visible.reduce((a, b) => a + b, 0)} of ${data.vertices} vertices seen`);
    const e = k !== data.truth && errors(state.frame, k);
    if (e) {
      const seen = surface(state.frame, data.truth).visible, visible = [...e].filter((_, v) => seen[v]);
      bits.push(`error ${mean(e).toFixed(2)} ${unit} mean, ${mean(visible).toFixed(2)} where seen, ${Math.max(...e).toFixed(1)} at most`);
    }
    return `${name}: ${bits.join(", ")}`;
  });
  $("readout").textContent = `${frame.name}. ${parts.join(". ")}.`;
}
function refresh() {
  $("frame").value = state.frame;
  $("frame").setAttribute("aria-valuetext", data.frames[state.frame].name);
  $("frame-name").textContent = `${data.frames[state.frame].name} (${state.frame + 1} of ${data.frames.length})`;
  legend(state.layer, $("ramp"), $("ticks"));
  const scaled = !!state.layer.values && !state.layer.flags;
  $("limit-label").hidden = !scaled;
  if (scaled) { $("limit").value = Number(limitOf(state.layer).toPrecision(3)); $("limit-unit").textContent = state.layer.unit; }
  state.shown.forEach(paint);
  if (data.moving_camera) buildRig();
  readout();
  measured();
}
function go(f) { state.frame = (f + data.frames.length) % data.frames.length; refresh(); }
function play(on) {
  clearInterval(state.playing);
  state.playing = on ? setInterval(() => go(state.frame + 1), 700) : 0;
  $("play").setAttribute("aria-pressed", String(on));
  $("play").textContent = on ? "Pause" : "Play";
  $("readout").setAttribute("aria-live", on ? "off" : "polite"); // a reader cannot follow the film
}
function wire_up() {
  const option = (value, name) => Object.assign(document.createElement("option"), { value, textContent: name });
  layers.forEach((l) => $("layer").append(option(l.id, l.name)));
  $("layer").value = state.layer.id;
  data.methods.forEach((m, k) => {
    $("overlay-method").append(option(k, m));
    const label = document.createElement("label"), box = Object.assign(document.createElement("input"), { type: "checkbox", value: k, checked: state.shown.includes(k), name: "method" });
    label.append(box, ` ${m}`);
    $("method-boxes").append(label);
    box.onchange = () => {
      state.shown = methods.filter((j) => $("method-boxes").querySelector(`[value="${j}"]`).checked);
      if (!state.shown.length) { box.checked = true; state.shown = [k]; }
      refresh();
    };
  });
  $("overlay-method").value = data.chosen;
  const single = data.methods.length < 2;
  $("methods-row").hidden = single; document.querySelector(".overlay-method").hidden = single;
  $("time").hidden = data.frames.length < 2;
  $("frame").max = data.frames.length - 1;
  const show = (name, yes) => document.querySelectorAll(name).forEach((e) => { e.hidden = !yes; });
  show(".has-rest", has((s) => s.pose)); show(".has-truth", data.truth !== undefined);
  show(".has-camera", data.camera); show(".has-points", data.points); show(".has-structures", data.structures.length);
  show(".matches", has((s) => s.matches.length)); show("[data-view=all]", data.camera);
  if (!data.camera) document.querySelector("[data-view=camera]").textContent = "Front";
  $("structure-names").innerHTML = data.structures.map((s, i) => `<span><b style="color:${BURIED[i % 4]}">●</b> ${escape(s.name)}</span>`).join("");
  document.querySelectorAll(".unit").forEach((e) => { e.textContent = unit; });
  ["vertex-a", "vertex-b"].forEach((id) => { $(id).max = data.vertices - 1; });
  if (!has((s) => s.pixels)) document.querySelector("#image-pane figcaption").hidden = true;

  $("frame").oninput = (e) => go(+e.target.value);
  $("previous").onclick = () => go(state.frame - 1);
  $("next").onclick = () => go(state.frame + 1);
  $("play").onclick = () => play(!state.playing);
  $("layer").onchange = (e) => { state.layer = layers.find((l) => l.id === e.target.value); refresh(); };
  $("limit").onchange = (e) => { if (+e.target.value > (state.layer.low || 0)) state.layer.limit = +e.target.value; refresh(); };
  $("flat-layer").onchange = drawFlattening;
  for (const id of ["overlay-kind", "overlay-method", "opacity", "matches"]) $(id).addEventListener("input", drawOverlay);
  for (const id of ["edges", "ghost", "truth", "rig", "points", "solid"]) $(id).addEventListener("input", draw);
  document.querySelectorAll("[data-view]").forEach((b) => { b.onclick = () => view(b.dataset.view); });
  const typed = () => {
    const places = ["vertex-a", "vertex-b"].map((id) => ($(id).value === "" ? null : atVertex(+$(id).value)));
    state.picks = places[0] ? places.filter(Boolean) : [];
    measured();
  };
  $("vertex-a").onchange = $("vertex-b").onchange = typed;
  $("radius").onchange = measured;
  $("clear").onclick = () => { state.picks = []; $("vertex-a").value = $("vertex-b").value = ""; measured(); };
  $("csv").onclick = () => save("measurements.csv", csv());
  let down = null;
  canvas.addEventListener("pointerdown", (e) => { down = [e.clientX, e.clientY]; });
  canvas.addEventListener("pointerup", (e) => {
    if (down && Math.hypot(e.clientX - down[0], e.clientY - down[1]) < 5) pickAt(e.clientX, e.clientY);
    down = null;
  });
  canvas.addEventListener("keydown", (e) => {
    const turn = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[e.key];
    if (turn) orbit(turn[0] * 0.12, turn[1] * 0.12);
    else if (e.key === "+" || e.key === "=") zoom(0.9);
    else if (e.key === "-") zoom(1 / 0.9);
    else if (e.key === "," || e.key === ".") go(state.frame + (e.key === "." ? 1 : -1));
    else return;
    e.preventDefault();
  });
  new ResizeObserver(draw).observe(canvas);
  const theme = () => { buildRig(); draw(); };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", theme);
  addEventListener("beforeprint", () => renderer && render());
}
function orbit(yaw, pitch) {
  const d = eye.position.clone().sub(controls.target), r = d.length();
  const level = Math.atan2(d.x, d.z) + yaw, rise = Math.min(Math.max(Math.asin(d.y / r) + pitch, -1.5), 1.5);
  eye.position.set(Math.sin(level) * Math.cos(rise), Math.sin(rise), Math.cos(level) * Math.cos(rise)).multiplyScalar(r).add(controls.target);
  controls.update(); draw();
}
function zoom(factor) { eye.position.sub(controls.target).multiplyScalar(factor).add(controls.target); controls.update(); draw(); }

$("viewer").hidden = false;
measureScene();
$("radius").value = Number((0.2 * radius).toPrecision(1));
wire_up();
buildRig();
refresh();
drawFlattening();
if (controls) { controls.addEventListener("change", draw); controls.rotateSpeed = 0.9; view("camera"); }
$("viewer").dataset.ready = "yes";
// For tests and the curious.
window.dsfms = { state, data, render, csv, orbit };
}));
