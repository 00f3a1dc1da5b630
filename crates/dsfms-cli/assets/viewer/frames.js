// --- Frames: which is shown, playing, those that are sent on demand -------------------------------
// `dsfms view` gives `dsfmsLive.frame(name)`; a page that stands alone holds all its frames.
const MOST_HELD = 96, AHEAD = 6, MOST_LOADING = 3;
const live = data.stream ? window.dsfmsLive : null;
const held = new Map(), loading = new Map();
/** Frames that came with the page stay. */
const own = new Set(live ? data.frames.flatMap((_, f) => (present(f) ? [f] : [])) : []);

/** Bring a frame; what was looked at longest ago goes. */
function load(f) {
  if (present(f)) return Promise.resolve(true);
  const name = data.frames[f].name;
  if (loading.has(name)) return loading.get(name);
  const job = live.frame(name).then((frame) => {
    loading.delete(name);
    // The list may have been replaced meanwhile.
    const place = data.frames.findIndex((other) => other.name === name);
    if (place < 0 || !frame) return false;
    Object.assign(data.frames[place], frame, { name });
    hold(place);
    return true;
  }).catch(() => { loading.delete(name); return false; });
  loading.set(name, job);
  return job;
}
function hold(f) {
  if (!live || own.has(f)) return;
  held.delete(f);
  held.set(f, true);
  for (const old of held.keys()) {
    if (held.size <= MOST_HELD) break;
    if (old === state.frame) continue;
    forget(old);
  }
}
function forget(f) {
  held.delete(f);
  const { name, status } = data.frames[f];
  data.frames[f] = { name, status };
  for (const k of methods) known.delete(f * data.methods.length + k);
}
/** What comes next is brought before it is asked for. */
function ahead() {
  if (!live || !state.playing) return;
  for (let i = 1; i <= AHEAD && loading.size < MOST_LOADING; i++) load((state.frame + i) % data.frames.length);
}

let wanted = null; // the frame that is waited for
function go(f) {
  f = (f + data.frames.length) % data.frames.length;
  if (present(f)) { wanted = null; hold(f); state.frame = f; refresh(); ahead(); return; }
  const waiting = wanted !== null;
  wanted = f;
  tellFrame();
  if (!waiting) bring();
}
/** The newest wish, one at a time: who drags the slider asks for more frames than can come. */
async function bring() {
  while (wanted !== null) {
    const f = wanted, came = await load(f);
    if (wanted !== f) continue;
    wanted = null;
    if (came) { state.frame = f; refresh(); ahead(); } else tellFrame("cannot be read");
  }
}
const step = (n) => go(Math.min(Math.max((wanted ?? state.frame) + n, 0), data.frames.length - 1));

function play(on) {
  clearInterval(state.playing);
  state.playing = on ? setInterval(() => { if (wanted === null) go(state.frame + 1); }, 1000 / +$("speed").value) : 0;
  $("play").setAttribute("aria-pressed", String(on));
  $("play").textContent = on ? "Pause" : "Play";
  $("readout").setAttribute("aria-live", on ? "off" : "polite"); // a reader cannot follow the film
  ahead();
}

/** Name and place under the panes. */
function tellFrame(note) {
  const f = wanted ?? state.frame, { name } = data.frames[f];
  $("frame").value = f;
  $("frame").setAttribute("aria-valuetext", name);
  const words = note || (wanted === null ? `${f + 1} of ${data.frames.length}` : "…");
  const [first, second] = $("frame-name").children;
  first.textContent = name; second.textContent = words;
  $("frame-name").classList.toggle("waiting", wanted !== null || !!note);
  cursors(f);
}
const WORST = { ok: 0, degraded: 1 };
/** The worst status of the shown methods; of a frame that is not here that of the page's strip. */
function statusOf(f) {
  const list = data.frames[f].status;
  if (!list) return stripStatus(data.frames[f].name);
  const worst = state.shown.filter((k) => k !== data.truth).map((k) => list[k]);
  return worst.sort((a, b) => (WORST[b] ?? 2) - (WORST[a] ?? 2))[0] || "ok";
}
/** Where the frames are that are not ok, under the slider. */
function drawStatuses() {
  const canvas = $("statuses"), wide = Math.max(canvas.clientWidth, 1), ink = canvas.getContext("2d");
  canvas.width = wide * Math.min(devicePixelRatio, 2);
  const n = data.frames.length, style = getComputedStyle(document.documentElement);
  const colour = { ok: "--good", degraded: "--warn" }, w = canvas.width / n, tall = { ok: 2, degraded: 4 };
  for (let f = 0; f < n; f++) {
    const status = statusOf(f);
    if (!status) continue;
    ink.fillStyle = style.getPropertyValue(colour[status] || "--bad").trim();
    ink.fillRect(f * w, 6 - (tall[status] || 6), Math.max(w - (w > 4 ? 1 : 0), 1), tall[status] || 6);
  }
}
