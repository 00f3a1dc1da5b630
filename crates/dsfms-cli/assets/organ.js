// The page on which the organ is drawn (`dsfms view TEMPLATE`): strokes go to this server, which answers with the part of
// all frames that they say is the organ. Places are px of the frames, centres at integers.
"use strict";
const $ = (id) => document.getElementById(id);
const state = { frames: [], size: [1, 1], frame: 0, strokes: [], parts: new Map(), pending: false, again: false, unsaved: false };
const OWN = "#56b4e9", OTHER = "#f0912b", SURE = [0, 200, 145], UNSURE = [235, 60, 40];
const LEAST_STEP = 2; // px of the frame between two corners of a stroke
const photos = new Map();

async function ask(path, body) {
  const how = body && { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) };
  const answer = await fetch(path, how);
  const text = await answer.text();
  if (!answer.ok) throw new Error(text || `${answer.status}`);
  return JSON.parse(text);
}
function tell(text, kind = "") { $("told").textContent = text; $("told").className = kind; }

// --- The part of a frame, as pixels ---------------------------------------------------------------
/** Dark where no organ is; the outline from green to red as it is marked. Made once a part. */
function veil(part) {
  if (part.veil) return part.veil;
  const [w, h] = state.size, mask = new Uint8Array(w * h);
  let at = 0;
  part.runs.forEach((run, k) => { if (k % 2) mask.fill(1, at, at + run); at += run; });
  const canvas = Object.assign(document.createElement("canvas"), { width: w, height: h }), ink = canvas.getContext("2d");
  const image = ink.createImageData(w, h), half = Math.max(1, Math.round(0.002 * w));
  for (let i = 0; i < w * h; i++) if (!mask[i]) image.data[4 * i + 3] = 140;
  const colour = marks(part.border);
  for (let y = 0; y < h; y++) for (let x = 0; x < w; x++) {
    const i = y * w + x;
    if (!mask[i] || (x > 0 && mask[i - 1] && x < w - 1 && mask[i + 1] && y > 0 && mask[i - w] && y < h - 1 && mask[i + w])) continue;
    const c = colour(x, y);
    for (let v = Math.max(y - half, 0); v <= Math.min(y + half, h - 1); v++)
      for (let u = Math.max(x - half, 0); u <= Math.min(x + half, w - 1); u++)
        image.data.set([c[0], c[1], c[2], 255], 4 * (v * w + u));
  }
  ink.putImageData(image, 0, 0);
  return (part.veil = canvas);
}
/** Colour of the outline at a pixel: that of the place of the border that is nearest. */
function marks(border) {
  return (x, y) => {
    let best = Infinity, sure = 1;
    for (const [u, v, c] of border) {
      const d = (u - x) ** 2 + (v - y) ** 2;
      if (d < best) { best = d; sure = c; }
    }
    return SURE.map((s, k) => Math.round(sure * s + (1 - sure) * UNSURE[k]));
  };
}

// --- Drawing ----------------------------------------------------------------------------------------
/** A frame with its part and its strokes into a canvas whose px are `scale` times those of the frame. */
function paint(ink, f, scale, shift) {
  const [w, h] = state.size, name = state.frames[f], photo = photos.get(f), part = state.parts.get(name);
  ink.setTransform(1, 0, 0, 1, 0, 0);
  ink.clearRect(0, 0, ink.canvas.width, ink.canvas.height);
  ink.setTransform(scale, 0, 0, scale, ...shift);
  if (photo && photo.complete && photo.naturalWidth) ink.drawImage(photo, 0, 0, w, h);
  if (state.parts.size) {
    if (part) ink.drawImage(veil(part), 0, 0);
    else { ink.fillStyle = "rgba(0,0,0,.55)"; ink.fillRect(0, 0, w, h); }
  }
  ink.lineCap = ink.lineJoin = "round";
  for (const stroke of state.strokes) if (stroke.frame === name) trace(ink, stroke, Math.max(1.5, 7 / scale));
}
function trace(ink, stroke, wide) {
  const way = () => {
    ink.beginPath();
    stroke.px.forEach(([x, y], k) => ink[k ? "lineTo" : "moveTo"](x + 0.5, y + 0.5));
    if (stroke.px.length === 1) ink.lineTo(stroke.px[0][0] + 0.51, stroke.px[0][1] + 0.5);
    ink.stroke();
  };
  ink.setLineDash([]);
  ink.strokeStyle = "#fff"; ink.lineWidth = wide * 1.5; way();
  ink.strokeStyle = stroke.organ ? OWN : OTHER; ink.lineWidth = wide; way();
  if (stroke.organ) return;
  // Not by colour alone.
  ink.setLineDash([0.2, 2 * wide]); ink.strokeStyle = "#000"; ink.lineWidth = 0.6 * wide; way();
  ink.setLineDash([]);
}
/** Canvas px per frame px, and where the frame begins. */
function sheet() {
  const canvas = $("frame"), [w, h] = state.size, ratio = devicePixelRatio || 1;
  const wide = canvas.clientWidth * ratio, high = canvas.clientHeight * ratio, scale = Math.min(wide / w, high / h);
  return { wide, high, scale, ratio, shift: [(wide - scale * w) / 2, (high - scale * h) / 2] };
}
function draw() {
  const canvas = $("frame"), { wide, high, scale, shift } = sheet();
  if (canvas.width !== Math.round(wide) || canvas.height !== Math.round(high)) { canvas.width = Math.round(wide); canvas.height = Math.round(high); }
  paint(canvas.getContext("2d"), state.frame, scale, shift);
}
const HIGH = 180; // px of a small picture
function drawStrip(only) {
  [...$("strip").children].forEach((button, f) => {
    button.setAttribute("aria-current", String(f === state.frame));
    const drawn = state.strokes.filter((s) => s.frame === state.frames[f]).length, count = button.querySelector("i");
    count.hidden = !drawn; count.textContent = drawn;
    if (only === undefined || only === f) paint(button.firstChild.getContext("2d"), f, HIGH / state.size[1], [0, 0]);
  });
}
function show(f) {
  state.frame = (f + state.frames.length) % state.frames.length;
  $("strip").children[state.frame].scrollIntoView({ block: "nearest", inline: "nearest" });
  drawStrip(-1); draw();
}

// --- Strokes ----------------------------------------------------------------------------------------
function place(e) {
  const box = $("frame").getBoundingClientRect(), { scale, shift, ratio } = sheet(), [w, h] = state.size;
  const at = [(e.clientX - box.left) * ratio, (e.clientY - box.top) * ratio].map((v, c) => (v - shift[c]) / scale - 0.5);
  return at.every((v, c) => v > -0.5 && v < [w, h][c] - 0.5) ? at.map((v) => Math.round(10 * v) / 10) : null;
}
let drawing = null;
function wire() {
  const canvas = $("frame");
  canvas.addEventListener("pointerdown", (e) => {
    const at = place(e);
    if (e.button || !at || drawing) return;
    canvas.setPointerCapture(e.pointerId);
    drawing = { frame: state.frames[state.frame], organ: $("own").checked, px: [at] };
    state.strokes.push(drawing); draw();
  });
  canvas.addEventListener("pointermove", (e) => {
    const at = drawing && place(e);
    if (!at) return;
    const [x, y] = drawing.px[drawing.px.length - 1];
    if (Math.hypot(at[0] - x, at[1] - y) < LEAST_STEP) return;
    drawing.px.push(at); draw();
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { if (drawing) { drawing = null; changed(); } });
  $("undo").onclick = () => { if (!drawing && state.strokes.pop()) changed(); };
  $("clear").onclick = () => { if (state.strokes.length) { state.strokes = []; changed(); } };
  $("save").onclick = save;
  addEventListener("keydown", (e) => {
    if (e.ctrlKey && e.key !== "z" || e.metaKey && e.key !== "z" || e.altKey) return;
    const act = { o: () => { $("own").checked = true; }, n: () => { $("other").checked = true; }, z: () => $("undo").click() }[e.key];
    const by = e.target.type === "radio" ? 0 : { ArrowLeft: -1, ArrowRight: 1 }[e.key];
    if (!act && !by) return;
    e.preventDefault();
    if (act) act(); else show(state.frame + by);
  });
  addEventListener("beforeunload", (e) => { if (state.unsaved) e.preventDefault(); });
  new ResizeObserver(draw).observe(canvas);
}
function changed() {
  state.unsaved = state.strokes.length > 0;
  draw(); drawStrip(state.frame); buttons(); part();
}
function buttons() {
  $("undo").disabled = $("clear").disabled = $("save").disabled = !state.strokes.length;
}

// --- The server ------------------------------------------------------------------------------------
/** The part that the strokes say; one question at a time, the last of those that wait. */
async function part() {
  if (state.pending) { state.again = true; return; }
  state.pending = true;
  tell("the outline is made anew …", "busy");
  try {
    const found = await ask("organ/part", { strokes: state.strokes });
    state.parts = new Map(found.frames.map((frame) => [frame.name, frame]));
    const n = state.strokes.length, said = n ? `by ${n} stroke${n > 1 ? "s" : ""}` : "nothing is drawn: what the frames look at";
    const seen = found.frames.length < state.frames.length ? `, seen in ${found.frames.length} of ${state.frames.length} frames` : "";
    tell(`${said}; ${Math.round(100 * found.marked)} % of the outline is marked${seen} (${found.seconds.toFixed(1)} s)`);
  } catch (error) {
    tell(error.message, "bad");
  }
  state.pending = false;
  drawStrip(); draw();
  if (state.again) { state.again = false; part(); }
}
async function save() {
  try {
    const { path } = await ask("organ/save", { strokes: state.strokes });
    state.unsaved = false;
    tell(`saved; the same dsfms template command as before with --organ-scribbles ${path} builds this organ`);
  } catch (error) {
    tell(error.message, "bad");
  }
}

async function begin() {
  const scene = await ask("organ/scene");
  Object.assign(state, { frames: scene.frames, size: scene.size, strokes: scene.strokes });
  const wide = Math.round((HIGH * state.size[0]) / state.size[1]);
  state.frames.forEach((name, f) => {
    const button = Object.assign(document.createElement("button"), { type: "button", title: name }), small = document.createElement("canvas");
    Object.assign(small, { width: wide, height: HIGH });
    button.setAttribute("aria-label", `frame ${name}`);
    button.append(small, document.createElement("i"));
    button.onclick = () => show(f);
    $("strip").append(button);
    const photo = Object.assign(new Image(), { src: `organ/photo/${f}` });
    photo.onload = () => { drawStrip(f); if (f === state.frame) draw(); };
    photos.set(f, photo);
  });
  // Strokes without a frame are on the first.
  state.strokes.forEach((stroke) => { stroke.frame ??= state.frames[0]; });
  wire(); buttons(); show(0);
  await part();
  document.body.dataset.ready = "yes";
}
begin().catch((error) => tell(error.message, "bad"));
// For tests and the curious.
window.organ = { state, show };
