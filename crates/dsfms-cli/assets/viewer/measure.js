// --- Measuring -------------------------------------------------------------------------------
/** Faces within the radius of A along the surface at rest. */
function patch() {
  const [A] = state.picks, r = +$("radius").value;
  if (!A || !(r > 0)) return [];
  const { d } = distances(rest, A);
  return [...Array(faceCount).keys()].filter((f) => mean(corners(f).map((v) => d[v])) <= r);
}
const total = (p, list) => list.reduce((s, f) => s + faceArea(p, f), 0);
/** Everything measured on one surface; `list`: the faces of the patch. */
function measureOn(p, expected, list) {
  const [A, B] = state.picks, out = { area: total(p, list) };
  out.strain = list.length ? mean(list.map((f) => strainNow(p)[f])) : NaN;
  if (B) Object.assign(out, { straight: apart(onFace(p, A), onFace(p, B)), along: alongSurface(p, A, B) });
  if (expected) out.sd = uncertainty(p, expected, list, out);
  return out;
}
const strainKnown = new WeakMap();
const strainNow = (p) => { if (!strainKnown.has(p)) strainKnown.set(p, strain(p)); return strainKnown.get(p); };
/** Measures of every method in the current frame, for tests. */
const measures = () => methods.map((k) => { const s = surface(state.frame, k); return s && measureOn(s.at, s.expectedError, patch()); });
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
  const hit = hitAt(x, y), camera = hit && cameraAt(hit);
  if (camera) go(camera.frame);
  else if (hit && hit.b) pick({ face: hit.face, b: hit.b });
}
