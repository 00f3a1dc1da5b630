// --- The image's pane: zoom, moving about, wipe -------------------------------------------------
const film = $("film");
/** Zoom against the whole image, and the image's place (0 to 1) that lies in the middle of the pane. */
const lens = { zoom: 1, x: 0.5, y: 0.5, wipe: 0.5 };
const MOST_ZOOM = 40;

/** Pane px of an image px: `at(q) = (q + 0.5) * scale + shift`. */
function filmMap() {
  const [w, h] = data.frames[state.frame].size, wide = film.clientWidth, high = film.clientHeight;
  const scale = Math.min(wide / w, high / h) * lens.zoom;
  return { scale, shift: [wide / 2 - lens.x * w * scale, high / 2 - lens.y * h * scale], wide, high, size: [w, h] };
}
/** Nothing is gained beyond the image's edges. */
function clampLens() {
  lens.zoom = Math.min(Math.max(lens.zoom, 1), MOST_ZOOM);
  const { scale, wide, high, size } = filmMap();
  ["x", "y"].forEach((c, i) => {
    const half = Math.min((i ? high : wide) / (2 * scale * size[i]), 0.5);
    lens[c] = Math.min(Math.max(lens[c], half), 1 - half);
  });
}
function placeFilm() {
  clampLens();
  const { scale, shift, size } = filmMap(), photo = $("photo");
  photo.style.width = `${size[0]}px`; photo.style.height = `${size[1]}px`;
  photo.style.transform = `translate(${shift[0]}px,${shift[1]}px) scale(${scale})`;
  photo.style.imageRendering = scale * devicePixelRatio > 4 ? "pixelated" : "auto";
  film.classList.toggle("near", lens.zoom > 1);
  const times = `${lens.zoom.toFixed(lens.zoom < 10 && lens.zoom > 1 ? 1 : 0)}×`;
  $("film-fit").textContent = times;
  $("film-fit").setAttribute("aria-label", `${times}, show all of the image`);
  placeWiper();
}
let filmDue = false;
function drawFilm() {
  if (filmDue) return;
  filmDue = true;
  requestAnimationFrame(() => { filmDue = false; drawOverlay(); });
}
/** Zoom by a factor about a place in the pane; its middle by default. */
function zoomFilm(factor, x = film.clientWidth / 2, y = film.clientHeight / 2) {
  const before = filmMap(), at = [(x - before.shift[0]) / before.scale, (y - before.shift[1]) / before.scale];
  lens.zoom = Math.min(Math.max(lens.zoom * factor, 1), MOST_ZOOM);
  const { scale, wide, high, size } = filmMap();
  lens.x = (at[0] + (wide / 2 - x) / scale) / size[0];
  lens.y = (at[1] + (high / 2 - y) / scale) / size[1];
  placeFilm(); drawFilm(); changed();
}
function moveFilm(dx, dy) {
  const { scale, size } = filmMap();
  lens.x -= dx / (scale * size[0]); lens.y -= dy / (scale * size[1]);
  placeFilm(); drawFilm(); changed();
}
function wholeFilm() { Object.assign(lens, { zoom: 1, x: 0.5, y: 0.5 }); placeFilm(); drawFilm(); changed(); }

function placeWiper() {
  const on = $("wipe").checked, percent = 100 * lens.wipe;
  $("wiper").hidden = !on;
  $("wiper").style.left = `${percent}%`;
  $("wiper").setAttribute("aria-valuenow", Math.round(percent));
  $("overlay").style.clipPath = on ? `inset(0 0 0 ${percent}%)` : "";
}
function wipeTo(share) { lens.wipe = Math.min(Math.max(share, 0), 1); placeWiper(); changed(); }

/** Pointers on the pane: one moves, two zoom, a double click shows all. */
function wireFilm() {
  const fingers = new Map();
  const local = (e) => { const box = film.getBoundingClientRect(); return [e.clientX - box.left, e.clientY - box.top]; };
  const spread = () => { const [a, b] = [...fingers.values()]; return { x: (a[0] + b[0]) / 2, y: (a[1] + b[1]) / 2, d: Math.hypot(a[0] - b[0], a[1] - b[1]) || 1 }; };
  film.addEventListener("pointerdown", (e) => {
    if (e.button || e.target.closest("#wiper")) return;
    fingers.set(e.pointerId, local(e));
    if (e.pointerType !== "touch" || lens.zoom > 1 || fingers.size > 1) film.setPointerCapture(e.pointerId);
  });
  film.addEventListener("pointermove", (e) => {
    if (!fingers.has(e.pointerId)) return;
    const before = fingers.size === 2 ? spread() : null, [x, y] = fingers.get(e.pointerId), now = local(e);
    fingers.set(e.pointerId, now);
    if (before) { const after = spread(); moveFilm(after.x - before.x, after.y - before.y); zoomFilm(after.d / before.d, after.x, after.y); }
    else if (fingers.size === 1 && lens.zoom > 1) moveFilm(now[0] - x, now[1] - y);
  });
  for (const end of ["pointerup", "pointercancel"]) film.addEventListener(end, (e) => fingers.delete(e.pointerId));
  film.addEventListener("wheel", (e) => {
    e.preventDefault();
    zoomFilm(Math.exp(-Math.max(-60, Math.min(e.deltaY * (e.deltaMode ? 20 : 1), 60)) / 240), ...local(e));
  }, { passive: false });
  film.addEventListener("dblclick", (e) => (lens.zoom > 1 ? wholeFilm() : zoomFilm(3, ...local(e))));
  film.addEventListener("mousedown", (e) => { if (!e.target.closest("#wiper")) e.preventDefault(); });
  film.addEventListener("keydown", (e) => {
    const by = { ArrowLeft: [60, 0], ArrowRight: [-60, 0], ArrowUp: [0, 60], ArrowDown: [0, -60] }[e.key];
    if (!by || lens.zoom === 1 || e.target !== film) return;
    e.preventDefault(); // a frame's step otherwise
    moveFilm(...by);
  });
  const wiper = $("wiper");
  wiper.addEventListener("pointerdown", (e) => { wiper.setPointerCapture(e.pointerId); e.stopPropagation(); });
  wiper.addEventListener("pointermove", (e) => { if (wiper.hasPointerCapture(e.pointerId)) wipeTo(local(e)[0] / film.clientWidth); });
  wiper.addEventListener("keydown", (e) => {
    const by = { ArrowLeft: -0.05, ArrowDown: -0.05, ArrowRight: 0.05, ArrowUp: 0.05, Home: -1, End: 1 }[e.key];
    if (!by) return;
    e.preventDefault(); e.stopPropagation();
    wipeTo(lens.wipe + by);
  });
  wiper.addEventListener("dblclick", (e) => e.stopPropagation());
  $("wipe").oninput = () => { placeWiper(); changed(); };
  $("film-in").onclick = () => zoomFilm(1.5);
  $("film-out").onclick = () => zoomFilm(1 / 1.5);
  $("film-fit").onclick = wholeFilm;
  new ResizeObserver(() => { placeFilm(); drawFilm(); }).observe(film);
}
