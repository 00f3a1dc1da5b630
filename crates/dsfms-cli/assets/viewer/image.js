// --- The image's overlay -----------------------------------------------------------------------
/** The method whose surface lies over the image, and that surface. */
const overlaid = () => { const k = +$("overlay-method").value || 0; return { k, s: surface(state.frame, k) }; };
function drawOverlay() {
  const frame = data.frames[state.frame], { k, s } = overlaid();
  const image = $("photo"), out = $("overlay"), kind = $("overlay-kind").value;
  if ($("image-pane").hidden || !present(state.frame)) return;
  const source = frame.image || "";
  if (image.getAttribute("src") !== source) { if (source) image.src = source; else image.removeAttribute("src"); }
  image.alt = `Image of ${frame.name}`;
  placeFilm();
  const { scale, shift, wide, high } = filmMap(), ratio = Math.min(devicePixelRatio, 2);
  out.width = wide * ratio; out.height = high * ratio;
  const ink = out.getContext("2d");
  paintOverlay(ink, { k, s, kind }, scale * ratio, shift.map((v) => v * ratio), ratio);
}
/** Draw into a canvas where image px q stands at (q + 0.5) * scale + shift; `fine`: canvas px of a line. */
function paintOverlay(ink, { k, s, kind }, scale, shift, fine) {
  const out = ink.canvas;
  // Pixel centres are at integers; the image has its origin at a corner.
  ink.setTransform(scale, 0, 0, scale, shift[0] + 0.5 * scale, shift[1] + 0.5 * scale);
  if (!s || !s.pixels) return;
  const seen = (v) => (!s.visible || s.visible[v]) && Number.isFinite(s.pixels[2 * v]);
  const at = (v) => [s.pixels[2 * v], s.pixels[2 * v + 1]];
  ink.globalAlpha = $("opacity").value / 100;
  if (kind === "structures") drawBuried(ink, s, out);
  else if (kind === "colours" && !state.layer.texture) {
    // Opaque on a sheet of its own, so that faces that meet show no seam.
    const sheet = Object.assign(document.createElement("canvas"), { width: out.width, height: out.height }), pen = sheet.getContext("2d");
    pen.setTransform(ink.getTransform());
    fillFaces(pen, s, k, seen, at, fine / scale);
    ink.save(); ink.setTransform(1, 0, 0, 1, 0, 0); ink.drawImage(sheet, 0, 0); ink.restore();
  }
  else if (kind !== "none") {
    const picture = new ImageData(out.width, out.height), pixel = (v) => at(v).map((x, c) => (x + 0.5) * scale + shift[c]);
    for (const [a, b] of edgeList) if (seen(a) && seen(b)) thinLine(picture, pixel(a), pixel(b), [90, 210, 255], 255 * ink.globalAlpha);
    ink.putImageData(picture, 0, 0);
  }
  ink.globalAlpha = 1;
  const r = (fine / scale) * Math.min(Math.max(Math.min(out.width, out.height) / (420 * fine), 0.7), 1.6);
  if ($("matches").checked) drawMatches(ink, s.matches, r);
  drawPins(ink, s, r);
}
function fillFaces(ink, s, k, seen, at, line) {
  const colours = cornerColours(state.layer, state.frame, k);
  // Far faces first, so that folds hide what is behind them.
  const order = [...Array(faceCount).keys()].filter((f) => corners(f).every(seen));
  const depth = (f) => corners(f).reduce((z, v) => z + s.at[3 * v + 2], 0);
  order.sort((a, b) => depth(b) - depth(a));
  for (const f of order) {
    const c = [0, 1, 2].map((i) => Math.round((colours[9 * f + i] + colours[9 * f + 3 + i] + colours[9 * f + 6 + i]) / 3));
    ink.fillStyle = ink.strokeStyle = `rgb(${c})`;
    ink.lineWidth = line;
    ink.beginPath();
    corners(f).forEach((v, i) => (i ? ink.lineTo(...at(v)) : ink.moveTo(...at(v))));
    ink.closePath(); ink.fill(); ink.stroke();
  }
}
/** A line one pixel wide with soft sides: along its longer axis, the two pixels across share the opacity.
 * A canvas would take seconds for thousands of lines where there is no graphics processor. */
function thinLine(picture, from, to, colour, opacity) {
  const steep = Math.abs(to[1] - from[1]) > Math.abs(to[0] - from[0]), [u, v] = steep ? [1, 0] : [0, 1];
  const [a, b] = from[u] <= to[u] ? [from, to] : [to, from], slope = (b[v] - a[v]) / (b[u] - a[u] || 1);
  const size = [picture.width, picture.height], pixels = picture.data;
  for (let s = Math.max(Math.round(a[u]), 0); s <= Math.min(Math.round(b[u]), size[u] - 1); s++) {
    const across = a[v] + slope * (s - a[u]), first = Math.floor(across);
    for (const t of [first, first + 1]) {
      if (t < 0 || t >= size[v]) continue;
      const k = 4 * (steep ? s * size[0] + t : t * size[0] + s), alpha = opacity * (1 - Math.abs(across - t));
      if (alpha <= pixels[k + 3]) continue;
      pixels[k] = colour[0]; pixels[k + 1] = colour[1]; pixels[k + 2] = colour[2]; pixels[k + 3] = alpha;
    }
  }
}
/** The structures: fainter the deeper they lie, each in a halo as wide as its expected error. */
function drawBuried(ink, s, out) {
  const sheet = () => {
    const canvas = Object.assign(document.createElement("canvas"), { width: out.width, height: out.height }), pen = canvas.getContext("2d");
    pen.setTransform(ink.getTransform());
    return [canvas, pen];
  };
  /** Lay one drawing over another instead of mixing the two. */
  const replace = (pen, canvas, alpha) => {
    pen.save(); pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.globalAlpha = 1; pen.globalCompositeOperation = "destination-out"; pen.drawImage(canvas, 0, 0);
    pen.globalAlpha = alpha; pen.globalCompositeOperation = "source-over"; pen.drawImage(canvas, 0, 0);
    pen.restore();
  };
  s.structures.forEach((structure, i) => {
    const colour = BURIED[i % BURIED.length], list = structureFaces[i], q = structure.pixels;
    const inside = (v) => Number.isFinite(q[2 * v]), [layer, pen] = sheet();
    for (const [share, alpha] of structure.halo ? [[1, 0.22], [0.66, 0.36], [0.33, 0.55]] : []) {
      const [ring, brush] = sheet();
      brush.fillStyle = colour;
      structure.halo.forEach((r, v) => { if (inside(v)) { brush.beginPath(); brush.arc(q[2 * v], q[2 * v + 1], share * r, 0, 7); brush.fill(); } });
      replace(pen, ring, alpha);
    }
    const [solid, brush] = sheet();
    const depth = (f) => [0, 1, 2].reduce((z, c) => z + structure.at[3 * list[f + c] + 2], 0);
    const order = Array.from({ length: list.length / 3 }, (_, f) => 3 * f).filter((f) => [0, 1, 2].every((c) => inside(list[f + c])));
    order.sort((a, b) => depth(b) - depth(a));
    for (const f of order) {
      const vs = [list[f], list[f + 1], list[f + 2]], c = vs.map((v) => point(structure.at, v));
      const facing = Math.abs(unitOf(cross(sub(c[1], c[0]), sub(c[2], c[0])))[2]);
      const fade = Math.exp((-1.5 * mean(vs.map((v) => structure.under[v]))) / radius);
      brush.fillStyle = brush.strokeStyle = `rgb(${rgb(colour.slice(1)).map((v) => Math.round(v * (0.35 + 0.25 * fade + 0.4 * facing)))})`;
      brush.lineWidth = 0.5;
      brush.beginPath();
      vs.forEach((v, j) => (j ? brush.lineTo(q[2 * v], q[2 * v + 1]) : brush.moveTo(q[2 * v], q[2 * v + 1])));
      brush.closePath(); brush.fill(); brush.stroke();
    }
    replace(pen, solid, 0.85);
    ink.save(); ink.setTransform(1, 0, 0, 1, 0, 0); ink.drawImage(layer, 0, 0); ink.restore();
  });
}
function drawPins(ink, s, r) {
  state.picks.forEach((pick, i) => {
    const q = [0, 1].map((c) => corners(pick.face).reduce((t, v, j) => t + pick.b[j] * s.pixels[2 * v + c], 0));
    ink.fillStyle = "#d81b60"; ink.strokeStyle = "#fff"; ink.lineWidth = 1.5 * r;
    ink.beginPath(); ink.arc(...q, 4.5 * r, 0, 7); ink.fill(); ink.stroke();
    ink.font = `700 ${16 * r}px system-ui,sans-serif`; ink.lineWidth = 3 * r;
    ink.strokeText("AB"[i], q[0] + 7 * r, q[1] - 6 * r); ink.fillText("AB"[i], q[0] + 7 * r, q[1] - 6 * r);
  });
}
