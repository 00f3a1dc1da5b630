// --- How sure a measurement is -------------------------------------------------------------------
// The expected error of a vertex is a length. What a measurement makes of it depends on how errors of
// neighbours go together: the measurement is repeated on surfaces moved by random smooth errors, mostly
// along the lines of sight. Shares and smoothness are measured (docs/results/report.md).
const ALONG_SIGHT = 1.15, ACROSS_SIGHT = 0.25; // standard deviations, of the expected error
const SMOOTH = 0.35; // correlation length, of the surface's radius
const COMMON = 0.3; // variance of what all vertices share
const DRAWS = 24, WAVES = 32;

function seeded(seed) { // mulberry32
  return () => {
    seed = (seed + 0x6d2b79f5) | 0;
    let t = Math.imul(seed ^ (seed >>> 15), 1 | seed);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  };
}
/** Smooth Gaussian fields of unit variance, the same in every call: DRAWS times three of them. */
const errorFields = (() => {
  const uniform = seeded(1), normal = () => Math.sqrt(-2 * Math.log(1 - uniform())) * Math.cos(2 * Math.PI * uniform());
  const wave = () => [normal(), normal(), normal(), 2 * Math.PI * uniform()];
  const field = () => ({ common: normal(), waves: Array.from({ length: WAVES }, wave) });
  return Array.from({ length: DRAWS }, () => [field(), field(), field()]);
})();
function fieldAt(field, q) {
  const k = 1 / (SMOOTH * radius);
  let sum = 0;
  for (const [x, y, z, phase] of field.waves) sum += Math.cos(k * (x * q[0] + y * q[1] + z * q[2]) + phase);
  return Math.sqrt(COMMON) * field.common + Math.sqrt(((1 - COMMON) * 2) / WAVES) * sum;
}
const unitOf = (a) => { const l = length(a) || 1; return a.map((v) => v / l); };

/** Standard deviations of everything in `measured` on the surface p. */
function uncertainty(p, expected, list, measured) {
  const [A, B] = state.picks, passed = measured.along ? measured.along.passed : [];
  const used = new Set([...list.flatMap(corners), ...passed.flatMap(([a, b]) => [a, b]), ...(A ? corners(A.face) : []), ...(B ? corners(B.face) : [])]);
  const places = [...used].map((v) => {
    const q = point(p, v), ray = unitOf(q), x = unitOf(cross(ray, Math.abs(ray[1]) < 0.9 ? [0, 1, 0] : [1, 0, 0]));
    return { v, q, e: expected[v], axes: [ray, x, cross(ray, x)] };
  });
  const chords = (s) => {
    const way = [onFace(s, A), ...passed.map((e) => onEdge(s, e)), onFace(s, B)];
    return way.slice(1).reduce((sum, q, i) => sum + apart(way[i], q), 0);
  };
  const moved = Float32Array.from(p), sums = { straight: 0, along: 0, area: 0, strain: 0 };
  const add = (key, difference) => { sums[key] += difference ** 2 / DRAWS; };
  const chord = B && chords(p);
  for (const fields of errorFields) {
    for (const { v, q, e, axes } of places) {
      const u = fields.map((field, i) => e * (i ? ACROSS_SIGHT : ALONG_SIGHT) * fieldAt(field, q));
      for (let c = 0; c < 3; c++) moved[3 * v + c] = q[c] + u[0] * axes[0][c] + u[1] * axes[1][c] + u[2] * axes[2][c];
    }
    if (B) {
      add("straight", apart(onFace(moved, A), onFace(moved, B)) - measured.straight);
      // The way itself stays: to first order a shortest way does not gain by moving aside.
      add("along", (chords(moved) / (chord || 1) - 1) * measured.along.length);
    }
    if (list.length) {
      add("area", total(moved, list) - measured.area);
      add("strain", mean(list.map((f) => faceStrain(moved, f))) - measured.strain);
    }
  }
  const sd = (key, present) => (present ? Math.sqrt(sums[key]) : NaN);
  return { straight: sd("straight", B), along: sd("along", B), area: sd("area", list.length), strain: sd("strain", list.length) };
}
