// --- Sparse points of structure from motion ---------------------------------------------------------
// By their own colour, by error or by the number of frames that saw them, where the template says so.
const pointKinds = [];
if (data.points) {
  const extra = data.point_values || {};
  const spread = (values, share) => Float32Array.from(values).filter(Number.isFinite).sort()[Math.floor(share * (values.length - 1))] || 1;
  const by = (values, low, high) => (i) => ramp(SEQUENTIAL, (values[i] - low) / (high - low || 1));
  if (extra.rgb) { const rgbs = bytes(extra.rgb); pointKinds.push(["rgb", "own colour", (i) => [0, 1, 2].map((c) => rgbs[3 * i + c])]); }
  if (extra.error) { const e = numbers(extra.error), top = spread(e, 0.95); pointKinds.push(["error", `error, 0 to ${text(top, 2)} px`, by(e, 0, top)]); }
  if (extra.track) { const n = numbers(extra.track), top = spread(n, 0.98); pointKinds.push(["track", `frames that saw it, 2 to ${Math.round(top)}`, by(n, 2, top)]); }
  pointKinds.push(["plain", "one colour", () => [224, 123, 0]]);
  const g = new T.BufferGeometry(), at = cloud(data.points);
  g.setAttribute("position", new T.BufferAttribute(at, 3));
  g.setAttribute("color", new T.BufferAttribute(new Float32Array(at.length), 3));
  sparse.add(new T.Points(g, material({ painted: true, dot: Math.min(devicePixelRatio, 2) * 3 })));
}
function paintPoints() {
  const kind = pointKinds.find((k) => k[0] === $("points-by").value) || pointKinds[0];
  if (!kind) return;
  const colour = sparse.children[0].geometry.attributes.color;
  for (let i = 0; i < colour.count; i++) kind[2](i).forEach((v, c) => { colour.array[3 * i + c] = linearOf[Math.round(v)]; });
  colour.needsUpdate = true;
  draw();
}

// --- What lies around the organ, at rest as it is ----------------------------------------------------
const around = new T.Group();
root.add(around);
if (data.surroundings) {
  const g = new T.BufferGeometry();
  g.setAttribute("position", new T.BufferAttribute(cloud(data.surroundings.at), 3));
  g.setIndex(new T.BufferAttribute(new Uint32Array(bytes(data.surroundings.faces).buffer), 1));
  g.computeVertexNormals();
  around.add(new T.Mesh(g, material({ colour: 0x8fa0b0, lit: true, sliced: true, side: T.DoubleSide })));
}
