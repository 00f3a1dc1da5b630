// --- Pictures to keep --------------------------------------------------------------------------------
const SHARP = 2; // canvas px a screen px, at least
function savePicture(canvasOf, name) {
  canvasOf.toBlob((blob) => { if (blob) saveBlob(name, blob); }, "image/png");
}
const pictureName = (what) => `${data.frames[state.frame].name.replace(/[^\w.-]+/g, "_")}_${what}.png`;
/** The 3D view with names, scale bars and the legend. */
function spacePicture() {
  const w = canvas.clientWidth, h = canvas.clientHeight, r = Math.max(SHARP, devicePixelRatio);
  const scaled = !!state.layer.values, foot = scaled ? 46 : 0;
  const out = Object.assign(document.createElement("canvas"), { width: w * r, height: (h + foot) * r }), ink = out.getContext("2d");
  const css = getComputedStyle(document.documentElement), colour = (name) => css.getPropertyValue(name).trim();
  renderer.setPixelRatio(r); renderer.setSize(w, h, false); sized = "";
  render(true);
  ink.fillStyle = colour("--space"); ink.fillRect(0, 0, out.width, out.height);
  ink.drawImage(canvas, 0, 0, w * r, h * r);
  draw(); // the screen gets its own size back
  ink.scale(r, r);
  ink.font = "14px system-ui,sans-serif";
  for (const e of $("labels").children) {
    const box = e.getBoundingClientRect(), from = $("labels").getBoundingClientRect(), x = box.left - from.left, y = box.top - from.top;
    ink.fillStyle = ink.strokeStyle = colour("--fg");
    ink.lineWidth = 1.5;
    if (e.tagName === "B") { ink.beginPath(); ink.moveTo(x, y); ink.lineTo(x, y + 6); ink.lineTo(x + box.width, y + 6); ink.lineTo(x + box.width, y); ink.stroke(); }
    else ink.fillText(e.textContent, x + (e.tagName === "SPAN" ? 7 : 0), y + 16);
  }
  if (scaled) paintLegend(ink, h, colour("--fg"));
  return out;
}
function paintLegend(ink, top, fg) {
  ink.fillStyle = fg;
  const { layer } = state, name = `${data.frames[state.frame].name}, ${layer.name}`;
  ink.fillText(name, 10, top + 18);
  const x = Math.min(ink.measureText(name).width + 26, 420), wide = 220;
  if (layer.flags) { ink.fillStyle = `rgb(${SEEN})`; ink.fillText("■ seen", x, top + 18); ink.fillStyle = `rgb(${HIDDEN})`; ink.fillText("■ hidden or outside", x + 70, top + 18); return; }
  ink.drawImage($("ramp"), x, top + 8, wide, 12);
  const marks = [...$("ticks").children].map((t) => t.textContent);
  marks.forEach((mark, i) => { ink.textAlign = ["left", "center", "right"][i]; ink.fillText(mark, x + (wide * i) / 2, top + 36); });
  ink.textAlign = "left";
}
/** The image at its own size, made larger where it is small, with its overlay. */
function filmPicture() {
  const [w, h] = data.frames[state.frame].size, scale = Math.max(1, Math.round(1600 / w)), { k, s } = overlaid();
  const sheet = () => Object.assign(document.createElement("canvas"), { width: w * scale, height: h * scale });
  const out = sheet(), over = sheet(), ink = out.getContext("2d");
  if ($("photo").complete && $("photo").naturalWidth) ink.drawImage($("photo"), 0, 0, out.width, out.height);
  paintOverlay(over.getContext("2d"), { k, s, kind: $("overlay-kind").value }, scale, [0, 0], Math.max(1, out.width / 900));
  const from = $("wipe").checked ? ((lens.wipe * film.clientWidth - filmMap().shift[0]) / filmMap().scale) * scale : 0, x = Math.min(Math.max(from, 0), out.width - 1);
  ink.drawImage(over, x, 0, out.width - x, out.height, x, 0, out.width - x, out.height);
  return out;
}
function saveBlob(name, blob) {
  const a = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: name });
  a.click();
  setTimeout(() => URL.revokeObjectURL(a.href), 1000);
}
function wireExport() {
  $("space-save").onclick = () => { if (renderer) savePicture(spacePicture(), pictureName("3d")); };
  $("film-save").onclick = () => savePicture(filmPicture(), pictureName("image"));
}
