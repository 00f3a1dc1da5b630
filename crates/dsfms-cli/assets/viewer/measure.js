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
/** Shortest way from A to B: its length, its points, and the vertices that it passes. */
function alongSurface(p, A, B) {
  const end = onFace(p, B), start = onFace(p, A);
  if (A.face === B.face) return { length: apart(start, end), path: [start, end], passed: [] };
  const { d, before } = distances(p, A);
  const total = (v) => d[v] + apart(point(p, v), end);
  let v = corners(B.face).reduce((a, b) => (total(b) < total(a) ? b : a));
  const result = { length: total(v), passed: [] };
  for (; v >= 0; v = before[v]) result.passed.unshift(v);
  result.path = [start, ...result.passed.map((v) => point(p, v)), end];
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
/** Everything measured on one surface; `list`: the faces of the patch. */
function measureOn(p, confidence, list) {
  const [A, B] = state.picks, out = { area: total(p, list) };
  out.strain = list.length ? mean(list.map((f) => strainNow(p)[f])) : NaN;
  if (B) Object.assign(out, { straight: apart(onFace(p, A), onFace(p, B)), along: alongSurface(p, A, B) });
  if (confidence) out.sd = uncertainty(p, confidence, list, out);
  return out;
}
const strainKnown = new WeakMap();
const strainNow = (p) => { if (!strainKnown.has(p)) strainKnown.set(p, strain(p)); return strainKnown.get(p); };
/** Measures of every method in the current frame, for tests. */
const measures = () => methods.map((k) => { const s = surface(state.frame, k); return s && measureOn(s.at, s.confidence, patch()); });
function pick(place) {
  state.picks = state.picks.length > 1 ? [place] : [...state.picks, place];
  const own = (i) => { const s = state.picks[i]; return s ? corners(s.face)[s.b.indexOf(Math.max(...s.b))] : ""; };
  $("vertex-a").value = own(0); $("vertex-b").value = own(1);
  measured();
}
/** Vertices by number; null = none. */
function pickVertices(vertices) {
  const places = vertices.map((v) => (v === null ? null : atVertex(v)));
  state.picks = places[0] ? places.filter(Boolean) : [];
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
