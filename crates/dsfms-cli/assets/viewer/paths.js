// --- Ways along the surface ------------------------------------------------------------------
/** Items by rising keys. */
class Heap {
  items = [];
  push(item, key) {
    const h = this.items;
    h.push([key, item]);
    for (let i = h.length - 1, j; i && h[i][0] < h[(j = (i - 1) >> 1)][0]; i = j) [h[i], h[j]] = [h[j], h[i]];
  }
  /** Key and item. */
  pop() {
    const h = this.items, top = h[0], last = h.pop();
    if (!h.length) return top;
    h[0] = last;
    for (let i = 0; ;) {
      let m = i;
      for (const j of [2 * i + 1, 2 * i + 2]) if (j < h.length && h[j][0] < h[m][0]) m = j;
      if (m === i) return top;
      [h[i], h[m]] = [h[m], h[i]]; i = m;
    }
  }
}
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
  const heap = new Heap(), start = onFace(p, A), push = (v, t) => heap.push(v, t);
  for (const v of corners(A.face)) { d[v] = apart(start, point(p, v)); push(v, d[v]); }
  while (heap.items.length) {
    const [t, v] = heap.pop();
    if (t > d[v]) continue;
    for (const way of ways[v]) {
      const next = t + wayLength(p, v, way);
      if (next < d[way[0]]) { d[way[0]] = next; before[way[0]] = v; push(way[0], next); }
    }
  }
  return { d, before };
}
const facesOf = (() => {
  const out = Array.from({ length: data.vertices }, () => []);
  faces.forEach((v, c) => out[v].push(Math.floor(c / 3)));
  return out;
})();
/** A point on an edge, or a vertex (t = 0). */
const onEdge = (p, [a, b, t]) => [0, 1, 2].map((i) => (1 - t) * p[3 * a + i] + t * p[3 * b + i]);
const STEPS = 5; // parts of an edge between which a way may cross it
/** Shortest way from A to B over the faces about a first way through `vertices`: the edges that it crosses. */
function straightened(p, A, B, vertices) {
  const strip = new Set([...vertices, ...corners(A.face), ...corners(B.face)].flatMap((v) => facesOf[v]));
  const nodes = [], known = new Map(), ofFace = new Map();
  const node = (key, place, q) => {
    if (!known.has(key)) { known.set(key, nodes.length); nodes.push({ place, q, faces: [], d: Infinity, before: -1 }); }
    return known.get(key);
  };
  const join = (i, f) => { nodes[i].faces.push(f); ofFace.get(f).push(i); };
  for (const f of strip) {
    ofFace.set(f, []);
    corners(f).forEach((v, i, vs) => {
      join(node(`${v}`, [v, v, 0], point(p, v)), f);
      const a = Math.min(v, vs[(i + 1) % 3]), b = Math.max(v, vs[(i + 1) % 3]);
      for (let k = 1; k < STEPS; k++) join(node(`${a} ${b} ${k}`, [a, b, k / STEPS], onEdge(p, [a, b, k / STEPS])), f);
    });
  }
  const start = node("A", null, onFace(p, A)), end = node("B", null, onFace(p, B));
  join(start, A.face); join(end, B.face);
  const heap = new Heap();
  nodes[start].d = 0;
  heap.push(start, 0);
  while (heap.items.length) {
    const [d, i] = heap.pop();
    if (i === end) break;
    if (d > nodes[i].d) continue;
    for (const f of nodes[i].faces) for (const j of ofFace.get(f)) {
      const next = d + apart(nodes[i].q, nodes[j].q);
      if (next < nodes[j].d) { nodes[j].d = next; nodes[j].before = i; heap.push(j, next); }
    }
  }
  const passed = [];
  for (let i = nodes[end].before; i !== start && i >= 0; i = nodes[i].before) passed.unshift(nodes[i].place);
  return { length: nodes[end].d, passed };
}
/** Move every crossing along its edge to where the way is straight when both faces are unfolded about it. */
function tighten(p, passed, path) {
  for (let sweep = 0; sweep < 40; sweep++) passed.forEach((place, i) => {
    const [a, b] = place;
    if (a === b) return;
    const o = point(p, a), e = sub(point(p, b), o), l = length(e) || 1;
    const flat = (q) => { const d = sub(q, o), x = dot(d, e) / l; return [x, Math.sqrt(Math.max(dot(d, d) - x * x, 0))]; };
    const [x1, y1] = flat(path[i]), [x2, y2] = flat(path[i + 2]);
    if (y1 + y2 < 1e-12) return;
    place[2] = Math.min(Math.max((x1 + ((x2 - x1) * y1) / (y1 + y2)) / l, 0), 1);
    path[i + 1] = onEdge(p, place);
  });
}
/** Shortest way from A to B: its length, its points, and where it crosses edges. */
function alongSurface(p, A, B) {
  const end = onFace(p, B), start = onFace(p, A);
  if (A.face === B.face) return { length: apart(start, end), path: [start, end], passed: [] };
  const { d, before } = distances(p, A);
  const total = (v) => d[v] + apart(point(p, v), end);
  let v = corners(B.face).reduce((a, b) => (total(b) < total(a) ? b : a));
  if (!Number.isFinite(total(v))) return { length: NaN, path: [start, end], passed: [] }; // another piece
  const vertices = [];
  for (; v >= 0; v = before[v]) vertices.push(v);
  // The first way may lie beside the shortest: the strip follows it until nothing is gained.
  let way = straightened(p, A, B, vertices);
  for (let k = 0; k < 6; k++) {
    const next = straightened(p, A, B, [...vertices, ...way.passed.flatMap(([a, b]) => [a, b])]);
    const gained = next.length < 0.9995 * way.length;
    way = next;
    if (!gained) break;
  }
  const path = [start, ...way.passed.map((e) => onEdge(p, e)), end];
  tighten(p, way.passed, path);
  return { passed: way.passed, path, length: path.slice(1).reduce((sum, q, i) => sum + apart(path[i], q), 0) };
}
