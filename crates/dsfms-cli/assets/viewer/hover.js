// --- Values under the pointer -----------------------------------------------------------------------
/** Put a text beside a place of a pane; nothing takes it away. */
function tip(box, lines, x, y) {
  box.hidden = !lines.length;
  if (!lines.length) return;
  box.textContent = lines.join("\n");
  const pane = box.parentElement, right = x > pane.clientWidth * 0.6, low = y > pane.clientHeight * 0.7;
  Object.assign(box.style, { left: right ? "" : `${x + 14}px`, right: right ? `${pane.clientWidth - x + 14}px` : "", top: low ? "" : `${y + 14}px`, bottom: low ? `${pane.clientHeight - y + 14}px` : "" });
}
const withUnit = (v, u, digits = 3) => `${text(v, digits)}${u === "%" ? " %" : u ? ` ${u}` : ""}`;
/** The values of a layer on one surface, asked for once. */
const lastValues = new Map();
function valuesOf(layer, s, k) {
  const last = lastValues.get(layer.id);
  if (last && last.s === s) return last.values;
  const values = layer.values(state.frame, k);
  lastValues.set(layer.id, { s, values });
  return values;
}
/** What is known of a point of a surface: the vertex next to it, and the values there. */
function about(k, face, b) {
  const s = surface(state.frame, k), vs = corners(face), own = vs[b.indexOf(Math.max(...b))];
  const between = (values) => vs.reduce((t, v, i) => t + b[i] * values[v], 0);
  const lines = [`vertex ${own}, face ${face}`], layer = state.layer, told = new Set();
  const give = (l) => {
    const values = l.values && valuesOf(l, s, k);
    if (!values || told.has(l.id)) return;
    told.add(l.id);
    if (l.flags) lines.push(values[own] ? "seen" : "hidden or outside the image");
    else lines.push(`${l.name.split(" (")[0]}: ${withUnit(l.per === "face" ? values[face] : between(values), l.unit)}`);
  };
  give(layer);
  const moved = data.moving_camera ? [] : ["error", "expected_error", "depth", "seen"];
  for (const id of moved) { const l = layers.find((other) => other.id === id); if (l && !(id === "error" && k === data.truth)) give(l); }
  s.structures.forEach((structure, i) => {
    const q = onFace(s.at, { face, b });
    let least = Infinity;
    for (let v = 0; v < structure.at.length / 3; v++) least = Math.min(least, apart(q, point(structure.at, v)));
    lines.push(`${data.structures[i].name}: ${withUnit(least, unit)} away`);
  });
  return lines;
}
/** The face of the overlaid surface at an image px, the one next to the camera. */
function faceInImage(s, x, y) {
  let best = null;
  for (let f = 0; f < faceCount; f++) {
    const [i, j, k] = corners(f), q = s.pixels;
    const x0 = q[2 * i] - x, y0 = q[2 * i + 1] - y, x1 = q[2 * j] - x, y1 = q[2 * j + 1] - y, x2 = q[2 * k] - x, y2 = q[2 * k + 1] - y;
    const a = x1 * y2 - x2 * y1, b = x2 * y0 - x0 * y2, c = x0 * y1 - x1 * y0;
    if (!((a >= 0 && b >= 0 && c >= 0) || (a <= 0 && b <= 0 && c <= 0))) continue;
    const sum = a + b + c || 1, depth = (a * s.at[3 * i + 2] + b * s.at[3 * j + 2] + c * s.at[3 * k + 2]) / sum;
    if (!best || depth < best.depth) best = { face: f, b: [a / sum, b / sum, c / sum], depth };
  }
  return best;
}
function aboutImage(px, py) {
  const { k, s } = overlaid(), { scale, shift, size } = filmMap(), x = (px - shift[0]) / scale - 0.5, y = (py - shift[1]) / scale - 0.5;
  if (x < -0.5 || y < -0.5 || x > size[0] || y > size[1]) return [];
  const lines = [`pixel ${Math.round(x)}, ${Math.round(y)}`];
  if (!s || !s.pixels) return lines;
  const near = $("matches").checked ? s.matches.map((m) => [Math.hypot(m[0] - x, m[1] - y), m]).sort((a, b) => a[0] - b[0])[0] : null;
  if (near && near[0] * scale < 9) {
    const r = residualOf(near[1]);
    return [...lines, `match, ${near[1][2] ? "kept" : "refused"}${Number.isFinite(r) ? `: ${withUnit(r, "px", 2)} from the surface` : ""}`];
  }
  const found = faceInImage(s, x, y);
  return found ? lines.concat(about(k, found.face, found.b)) : lines;
}
/** At most one look a screen refresh. */
function onceARefresh(work) {
  let event = null;
  return (e) => {
    if (event) { event = e; return; }
    event = e;
    requestAnimationFrame(() => { const last = event; event = null; work(last); });
  };
}
function wireHover() {
  const hide = (box) => { box.hidden = true; };
  canvas.addEventListener("pointermove", onceARefresh((e) => {
    if (!renderer || e.buttons || turning) { hide($("tip")); return; }
    const hit = hitAt(e.clientX, e.clientY), camera = hit && cameraAt(hit);
    canvas.style.cursor = camera ? "pointer" : "";
    const lines = camera ? [`camera of ${data.frames[camera.frame].name}`, "click: go to this frame"] : hit && hit.b ? about(hit.cell.k, hit.face, hit.b) : [];
    tip($("tip"), lines, hit ? hit.px : 0, hit ? hit.py : 0);
  }));
  film.addEventListener("pointermove", onceARefresh((e) => {
    if (e.buttons || e.target.closest("#wiper")) { hide($("film-tip")); return; }
    const box = film.getBoundingClientRect(), x = e.clientX - box.left, y = e.clientY - box.top;
    tip($("film-tip"), aboutImage(x, y), x, y);
  }));
  canvas.addEventListener("pointerleave", () => hide($("tip")));
  film.addEventListener("pointerleave", () => hide($("film-tip")));
}
