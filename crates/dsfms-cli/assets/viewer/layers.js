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
const has = (test) => data.frames.some((frame) => frame.surfaces && frame.surfaces.some((s) => s && test(s, frame)));
/** Distance of every vertex from its true place; null where the truth is not known. */
const errors = (f, k) => {
  const s = surface(f, k), t = data.truth === undefined ? null : surface(f, data.truth);
  if (!s || !t) return null;
  return (s.errors ??= Float32Array.from({ length: data.vertices }, (_, v) => apart(point(s.at, v), point(t.at, v))));
};
const depths = (p) => Float32Array.from({ length: p.length / 3 }, (_, v) => p[3 * v + 2]);
const layers = [];
const add = (present, layer) => present && layers.push(layer);
add(has((s, frame) => s.pixels && s.visible && frame.image), { id: "image", name: "image (grey: not seen)", texture: true });
add(data.albedo && atlas, { id: "albedo", name: "albedo", texture: true });
add(true, { id: "shape", name: "shape" });
add(data.truth !== undefined, { id: "error", name: "error", unit, per: "vertex", values: errors });
add(has((s) => s.expected_error || s.confidence), { id: "expected_error", name: "expected error", unit, per: "vertex", values: (f, k) => surface(f, k).expectedError });
add(has((s) => s.positions), { id: "strain", name: `strain against ${data.reference} (largest stretch of a face)`, unit: "%", per: "face", signed: true, least: 2, values: (f, k) => strainNow(surface(f, k).at) });
add(has((s) => s.positions), { id: "depth", name: "depth from the camera", unit, per: "vertex", ranged: true, values: (f, k) => depths(surface(f, k).at) });
add(has((s) => s.visible), { id: "seen", name: "seen or hidden", per: "vertex", flags: true, values: (f, k) => surface(f, k).visible });
data.scalars.forEach((s) => layers.push({ id: s.name, name: s.name.toLowerCase(), unit: s.unit, per: "vertex", values: () => numbers(s.values) }));
if (data.flattening) {
  const angle = numbers(data.flattening.quasi_conformal);
  layers.push({ id: "angle", name: "angle distortion of the flattening", unit: "", per: "face", low: 1, values: () => angle });
  const area = numbers(data.flattening.log_area).map((v) => 100 * (Math.exp(v) - 1));
  layers.push({ id: "area", name: "area distortion of the flattening", unit: "%", per: "face", signed: true, values: () => area });
}

/** Of the frames that are here, some, evenly spaced. */
function samples() {
  const here = data.frames.flatMap((_, f) => (present(f) ? [f] : [])), step = Math.ceil(here.length / 24);
  return here.filter((_, i) => i % step === 0);
}
/** The least value of a layer, rounded down. */
function nearest(layer) {
  let least = Infinity;
  samples().forEach((f) => estimated.forEach((k) => { if (surface(f, k)) for (const v of layer.values(f, k)) least = Math.min(least, v); }));
  const step = 10 ** Math.floor(Math.log10(Math.max(Math.abs(least), 1e-6)));
  return Number.isFinite(least) ? (Math.floor((10 * least) / step) * step) / 10 : 0;
}
/** A round number that covers all but the extreme of a layer's values. Of errors: that of the better
 * half of the methods, so that one that went astray does not drown the others. */
function usualLimit(layer) {
  if (layer.ranged) layer.low = nearest(layer);
  const base = layer.low || 0; // the flattening's ratios start at 1
  const reach = estimated.map((k) => {
    const all = [];
    samples().forEach((f) => {
      if (!surface(f, k)) return;
      for (const v of layer.values(f, k) || []) if (Number.isFinite(v)) all.push(Math.abs(v) - base);
    });
    return Float64Array.from(all).sort()[Math.floor(0.95 * (all.length - 1))];
  }).filter(Number.isFinite).sort((a, b) => a - b);
  const v = Math.max(reach[layer.signed ? reach.length - 1 : (reach.length - 1) >> 1] ?? 1, layer.least || 1e-6), decade = 10 ** Math.floor(Math.log10(v));
  return Number((base + [1, 1.5, 2, 3, 4, 5, 6, 8, 10].find((s) => s * decade >= v * 0.999) * decade).toPrecision(6));
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
const state = { frame: Math.max(data.frames.findIndex((f) => f.surfaces), 0), layer: layers[0], shown: [data.chosen], picks: [], playing: 0 };
// A template is not one image's: its own albedo first.
if (data.moving_camera || !has((s, frame) => frame.image)) state.layer = layers.find((l) => l.id === "albedo") || state.layer;
