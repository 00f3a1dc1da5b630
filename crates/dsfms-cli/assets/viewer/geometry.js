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

/** Of a face, the principal stretch that differs most from 1, minus 1, in per cent. */
function faceStrain(p, f) {
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
}
const strain = (p) => Float32Array.from({ length: faceCount }, (_, f) => faceStrain(p, f));
