// --- Keys, full screen ---------------------------------------------------------------------------------
let over = "space"; // the pane under the pointer, or with the focus
function fullScreen() {
  const stage = $("stage");
  if (document.fullscreenElement) { document.exitFullscreen(); return; }
  if (stage.classList.contains("full")) { stage.classList.remove("full"); tellFull(); return; }
  // Where the browser will not, the stage covers the page.
  const cover = () => { stage.classList.add("full"); tellFull(); };
  if (stage.requestFullscreen) stage.requestFullscreen().catch(cover); else cover();
}
function tellFull() {
  const on = !!document.fullscreenElement || $("stage").classList.contains("full");
  $("full").setAttribute("aria-pressed", String(on));
}
function showKeys() { if ($("keys").open) $("keys").close(); else $("keys").showModal(); }
const press = (id) => () => { const e = $(id); if (e.offsetParent !== null) e.click(); };
function nextLayer(n) {
  const i = (layers.indexOf(state.layer) + n + layers.length) % layers.length;
  state.layer = layers[i];
  $("layer").value = state.layer.id;
  refresh();
}
function nextCut() {
  const select = $("cut-axis");
  select.selectedIndex = (select.selectedIndex + 1) % select.options.length;
  draw(); changed();
}
const zoomPane = (factor) => (over === "film" ? zoomFilm(factor) : zoom(1 / factor));
const VIEWS = ["camera", "left", "right", "top", "all"];
const KEYS = {
  " ": () => { if (data.frames.length > 1) play(!state.playing); },
  ArrowLeft: () => step(-1), ArrowRight: () => step(1), ",": () => go(state.frame - 1), ".": () => go(state.frame + 1),
  PageUp: () => step(-10), PageDown: () => step(10), Home: () => go(0), End: () => go(data.frames.length - 1),
  f: fullScreen, "?": showKeys, t: press("turntable"), e: press("edges"), s: press("shading"), m: press("matches"), w: press("wipe"),
  c: nextCut, "[": () => nextLayer(-1), "]": () => nextLayer(1), p: press("space-save"), i: press("film-save"),
  "+": () => zoomPane(1.2), "=": () => zoomPane(1.2), "-": () => zoomPane(1 / 1.2), 0: () => (over === "film" ? wholeFilm() : view("camera")),
};
VIEWS.forEach((v, i) => { KEYS[i + 1] = () => { const b = document.querySelector(`[data-view=${v}]`); if (!b.hidden) b.click(); }; });
/** Whether a key belongs to what has the focus. */
function taken(e) {
  const t = e.target;
  if (e.ctrlKey || e.metaKey || e.altKey || $("keys").open) return true;
  // The slider of the frames moves by arrows itself; all other keys are the page's.
  if (t.id === "frame") return /^(Arrow|Page|Home|End)/.test(e.key);
  if (t.matches("input,select,textarea,[contenteditable]")) return true;
  if (e.key === " ") return t.matches("button,summary,a[href]");
  // Below the stage these keys move the page.
  return /^(Page|Home|End)/.test(e.key) && window.scrollY > 0.5 * $("stage").offsetHeight && !document.fullscreenElement;
}
function wireKeys() {
  document.addEventListener("keydown", (e) => {
    if (e.defaultPrevented || taken(e) || !KEYS[e.key]) return;
    e.preventDefault();
    KEYS[e.key]();
  });
  canvas.addEventListener("keydown", (e) => {
    const turn = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[e.key];
    if (!turn || !controls || e.ctrlKey || e.metaKey || e.altKey) return;
    orbit(turn[0] * 0.12, turn[1] * 0.12);
    e.preventDefault();
  });
  // A click does not give the canvas the focus: arrows go on stepping frames.
  canvas.addEventListener("mousedown", (e) => e.preventDefault());
  for (const [id, pane] of [["image-pane", "film"], ["space", "space"]]) for (const kind of ["pointerenter", "focusin"]) $(id).addEventListener(kind, () => { over = pane; });
  $("full").onclick = fullScreen;
  $("help").onclick = showKeys;
  document.addEventListener("fullscreenchange", tellFull);
  document.addEventListener("keydown", (e) => { if (e.key === "Escape" && $("stage").classList.contains("full")) fullScreen(); });
}
