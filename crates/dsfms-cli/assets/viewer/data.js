// The viewer of report.html: plain functions over the packed data of the page; no network, no storage.
// The parts of this folder are joined, in the order of report/mod.rs, into one function. Lengths are
// in data.unit; surfaces are in camera axes (x right, y down, z forward).
const $ = (id) => document.getElementById(id);
const data = JSON.parse($("data").textContent);
if (!data.frames.some((f) => f.surfaces) || !window.THREE) return;
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

const pixelsOf = (text, size) => Float32Array.from(words(text), (w, i) => (w === 65535 ? NaN : ((3 * w) / 65534 - 1) * size[i % 2]));

const known = new Map();
/** Whether a frame is here: `dsfms view` sends those of long clips when they are asked for. */
const present = (f) => !!data.frames[f].surfaces;
/** Surface of method k in frame f, unpacked once; null where the method failed or the frame is not here. */
function surface(f, k) {
  if (!present(f)) return null;
  const key = f * data.methods.length + k;
  if (known.has(key)) return known.get(key);
  const packed = data.frames[f].surfaces[k];
  const size = data.frames[f].size;
  // Pages of earlier versions call it confidence.
  const expected = packed && (packed.expected_error || packed.confidence);
  const out = packed && {
    at: packed.positions ? cloud(packed.positions) : rest,
    pixels: packed.pixels && pixelsOf(packed.pixels, size),
    visible: packed.visible && bytes(packed.visible),
    expectedError: expected && numbers(expected),
    matches: packed.matches,
    pose: packed.pose,
    structures: (packed.structures || []).map((s) => ({
      at: cloud(s.at), pixels: pixelsOf(s.pixels, size), under: numbers(s.under), halo: s.halo && numbers(s.halo),
    })),
  };
  known.set(key, out);
  return out;
}
