// --- Painting a surface ----------------------------------------------------------------------------
const linearOf = Float32Array.from({ length: 256 }, (_, v) => { const s = v / 255; return s <= 0.04045 ? s / 12.92 : ((s + 0.055) / 1.055) ** 2.4; });
const plainOf = (layer) => (layer.id === "image" ? HIDDEN : CLAY);
/** Colour of every corner, 0 to 255; clay or grey where the layer has no values. */
function cornerColours(layer, f, k) {
  const out = new Uint8Array(9 * faceCount), values = layer.values && layer.values(f, k);
  for (let c = 0; c < 3 * faceCount; c++) {
    const v = layer.per === "face" ? Math.floor(c / 3) : faces[c];
    out.set(values ? colourOf(layer, values[v]) : plainOf(layer), 3 * c);
  }
  return out;
}
/** Colour of every vertex of a layer that has a value a vertex or none. */
function vertexColours(layer, f, k) {
  const out = new Uint8Array(3 * data.vertices), values = layer.values && layer.values(f, k);
  for (let v = 0; v < data.vertices; v++) out.set(values ? colourOf(layer, values[v]) : plainOf(layer), 3 * v);
  return out;
}
/** The arrays of one surface: `of` gives the vertex of a place in them. */
function fill(g, count, of, s, colours) {
  const { position, normal, color } = g.attributes, normals = vertexNormals(s.at);
  for (let c = 0; c < count; c++) {
    const v = of(c);
    for (let i = 0; i < 3; i++) { position.array[3 * c + i] = s.at[3 * v + i]; normal.array[3 * c + i] = normals[3 * v + i]; }
  }
  colours.forEach((v, i) => { color.array[i] = linearOf[v]; });
}
/** UV of the places of the image; `of` as in `fill`. */
function fillPhoto(uv, count, of, s, size) {
  for (let c = 0; c < count; c++) {
    const v = of(c);
    uv[2 * c] = (s.pixels[2 * v] + 0.5) / size[0];
    uv[2 * c + 1] = 1 - (s.pixels[2 * v + 1] + 0.5) / size[1];
  }
}
function paint(k) {
  const column = columns[k], s = surface(state.frame, k), layer = state.layer;
  column.group.visible = !!s;
  if (!s) return;
  const shared = layer.per !== "face" && layer.id !== "albedo", count = shared ? data.vertices : 3 * faceCount;
  const of = shared ? (c) => c : (c) => faces[c];
  const g = column.mesh.geometry = column[shared ? "byVertex" : "byCorner"] ??= geometryOf(count);
  fill(g, count, of, s, (shared ? vertexColours : cornerColours)(layer, state.frame, k));
  const photo = layer.id === "image" && s.pixels && s.visible && photoTexture(state.frame);
  if (photo) fillPhoto(g.attributes.uv.array, count, of, s, data.frames[state.frame].size);
  else if (atlas && !shared) g.attributes.uv.array.set(atlas);
  // The part that the image does not show comes last, in grey.
  const seen = [], unseen = [];
  for (let f = 0; f < faceCount; f++) (photo && corners(f).every((v) => s.visible[v]) ? seen : unseen).push(f);
  column.order = seen.concat(unseen);
  const index = new Uint32Array(3 * faceCount);
  column.order.forEach((f, i) => { for (let c = 0; c < 3; c++) index[3 * i + c] = shared ? faces[3 * f + c] : 3 * f + c; });
  if (g.index) { g.index.array.set(index); g.index.needsUpdate = true; } else g.setIndex(new T.BufferAttribute(index, 1));
  g.clearGroups();
  if (seen.length) g.addGroup(0, 3 * seen.length, 0);
  g.addGroup(3 * seen.length, 3 * unseen.length, 1);
  column.photo = photo || null;
  column.mesh.material = [photographed, layer.id === "albedo" ? bare : painted];
  for (const a of Object.values(g.attributes)) a.needsUpdate = true;
  g.computeBoundingSphere();
  paintBeside(column, s);
}
/** Edges, the shape at rest, the truth and what lies inside. */
function paintBeside(column, s) {
  setPoints(column.edges, s.at);
  const truth = data.truth !== undefined && surface(state.frame, data.truth);
  if (truth) setPoints(column.truth, truth.at);
  if (s.pose) setPoints(column.ghost, posed(s.pose, rest));
  column.buried.forEach((mesh, i) => {
    mesh.visible = !!s.structures[i];
    if (!mesh.visible) return;
    mesh.geometry.setAttribute("position", new T.BufferAttribute(s.structures[i].at, 3));
    mesh.geometry.computeVertexNormals();
    mesh.geometry.computeBoundingSphere();
  });
}
const posed = (m, p) => Float32Array.from(p, (_, j) => {
  const v = 3 * Math.floor(j / 3), r = m[j % 3];
  return r[0] * p[v] + r[1] * p[v + 1] + r[2] * p[v + 2] + r[3];
});
