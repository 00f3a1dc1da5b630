// --- The image -------------------------------------------------------------------------------
function drawOverlay() {
  const frame = data.frames[state.frame], k = +$("overlay-method").value || 0, s = surface(state.frame, k);
  const image = $("photo"), out = $("overlay"), kind = $("overlay-kind").value;
  $("image-pane").hidden = !data.frames.some((f) => f.image);
  document.querySelector(".panes").classList.toggle("single", $("image-pane").hidden);
  if ($("image-pane").hidden) return;
  const source = frame.image || "";
  if (image.getAttribute("src") !== source) { if (source) image.src = source; else image.removeAttribute("src"); }
  image.alt = `Image of ${frame.name}`;
  image.width = frame.size[0]; image.height = frame.size[1];
  const scale = Math.max(1, 960 / frame.size[0]); // fine lines on small images
  out.width = frame.size[0] * scale; out.height = frame.size[1] * scale;
  const ink = out.getContext("2d");
  // Pixel centres are at integers; the canvas has its origin at a corner.
  ink.setTransform(scale, 0, 0, scale, 0.5 * scale, 0.5 * scale);
  if (!s || !s.pixels || kind === "none") return;
  const seen = (v) => (!s.visible || s.visible[v]) && Number.isFinite(s.pixels[2 * v]);
  const at = (v) => [s.pixels[2 * v], s.pixels[2 * v + 1]];
  ink.globalAlpha = $("opacity").value / 100;
  if (kind === "colours" && !state.layer.texture) fillFaces(ink, s, k, seen, at);
  else {
    ink.strokeStyle = "#5ad2ff"; ink.lineWidth = 1;
    ink.beginPath();
    for (const [a, b] of edgeList) if (seen(a) && seen(b)) { ink.moveTo(...at(a)); ink.lineTo(...at(b)); }
    ink.stroke();
  }
  ink.globalAlpha = 1;
  if ($("matches").checked) drawMatches(ink, s.matches, frame.size[0] / 640);
  drawPins(ink, s, frame.size[0] / 640);
}
function fillFaces(ink, s, k, seen, at) {
  const colours = cornerColours(state.layer, state.frame, k);
  // Far faces first, so that folds hide what is behind them.
  const order = [...Array(faceCount).keys()].filter((f) => corners(f).every(seen));
  const depth = (f) => corners(f).reduce((z, v) => z + s.at[3 * v + 2], 0);
  order.sort((a, b) => depth(b) - depth(a));
  for (const f of order) {
    const c = [0, 1, 2].map((i) => Math.round((colours[9 * f + i] + colours[9 * f + 3 + i] + colours[9 * f + 6 + i]) / 3));
    ink.fillStyle = ink.strokeStyle = `rgb(${c})`;
    ink.lineWidth = 0.4;
    ink.beginPath();
    corners(f).forEach((v, i) => (i ? ink.lineTo(...at(v)) : ink.moveTo(...at(v))));
    ink.closePath(); ink.fill();
  }
}
/** Kept: discs. Refused: crosses. */
function drawMatches(ink, matches, r) {
  for (const [x, y, kept] of matches) {
    ink.lineWidth = 1.2 * r; ink.strokeStyle = "#000";
    ink.beginPath();
    if (kept) {
      ink.fillStyle = "#28dc5a"; ink.arc(x, y, 3 * r, 0, 7); ink.fill(); ink.stroke();
      continue;
    }
    ink.moveTo(x - 4 * r, y - 4 * r); ink.lineTo(x + 4 * r, y + 4 * r); ink.moveTo(x + 4 * r, y - 4 * r); ink.lineTo(x - 4 * r, y + 4 * r);
    ink.lineWidth = 3.4 * r; ink.stroke(); ink.lineWidth = 1.8 * r; ink.strokeStyle = "#ff5050"; ink.stroke();
  }
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
