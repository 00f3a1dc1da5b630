/** A frame of a video without a surface is lost. */
function statusWord(status) { return status === "failed" && data.video ? "lost" : status; }
// --- Bringing it together --------------------------------------------------------------------
function readout() {
  const frame = data.frames[state.frame];
  const parts = state.shown.map((k) => {
    const s = surface(state.frame, k), name = data.methods[k];
    if (!s) return `${name}: ${[statusWord(frame.status[k]), "no surface", ...((frame.reasons || [])[k] || [])].join(", ")}`;
    const bits = [];
    if (k !== data.truth && frame.status[k] !== "ok") bits.push([statusWord(frame.status[k]), ...((frame.reasons || [])[k] || [])].join(": "));
    if (s.visible) bits.push(`${s.visible.reduce((a, b) => a + b, 0)} of ${data.vertices} vertices seen`);
    const e = k !== data.truth && errors(state.frame, k);
    if (e) {
      const seen = surface(state.frame, data.truth).visible, visible = [...e].filter((_, v) => seen[v]);
      bits.push(`error ${mean(e).toFixed(2)} ${unit} mean, ${mean(visible).toFixed(2)} where seen, ${Math.max(...e).toFixed(1)} at most`);
    }
    return `${name}: ${bits.join(", ")}`;
  });
  $("readout").textContent = `${frame.name}. ${parts.join(". ")}.`;
}
/** The verdict on the shown frame beside its picture: a light, the status, why. */
function light() {
  const { status, reasons } = data.frames[state.frame], k = +$("overlay-method").value;
  const why = reasons && reasons[k], box = $("verdict"), [, word, words] = box.children;
  box.hidden = !why || k === data.truth;
  if (box.hidden) return;
  box.className = status[k] === "ok" || status[k] === "degraded" ? status[k] : "failed";
  word.textContent = statusWord(status[k]);
  words.textContent = why.join("; ");
  box.title = why.join("\n");
}
function refresh() {
  tellFrame();
  light();
  legend(state.layer, $("ramp"), $("ticks"));
  $("legend-name").textContent = state.layer.name; // on paper there is no select
  const scaled = !!state.layer.values && !state.layer.flags;
  $("limit-label").hidden = !scaled;
  if (scaled) { $("limit").value = Number(limitOf(state.layer).toPrecision(3)); $("limit-unit").textContent = state.layer.unit; }
  state.shown.forEach(paint);
  if (data.moving_camera) buildRig();
  readout();
  measured();
  if (!live) drawStatuses();
  changed();
}
function wire_up() {
  const option = (value, name) => Object.assign(document.createElement("option"), { value, textContent: name });
  layers.forEach((l) => $("layer").append(option(l.id, l.name)));
  $("layer").value = state.layer.id;
  data.methods.forEach((m, k) => {
    $("overlay-method").append(option(k, m));
    const label = document.createElement("label"), box = Object.assign(document.createElement("input"), { type: "checkbox", value: k, checked: state.shown.includes(k), name: "method" });
    label.append(box, ` ${m}`);
    $("method-boxes").append(label);
    box.onchange = () => {
      state.shown = methods.filter((j) => $("method-boxes").querySelector(`[value="${j}"]`).checked);
      if (!state.shown.length) { box.checked = true; state.shown = [k]; }
      refresh();
    };
  });
  $("overlay-method").value = data.chosen;
  const single = data.methods.length < 2;
  $("methods-row").hidden = single; document.querySelector(".overlay-method").hidden = single;
  $("time").hidden = data.frames.length < 2;
  $("frame").max = data.frames.length - 1;
  const show = (name, yes) => document.querySelectorAll(name).forEach((e) => { e.hidden = !yes; });
  show(".has-rest", has((s) => s.pose)); show(".has-truth", data.truth !== undefined);
  show(".has-camera", data.camera); show(".has-points", data.points); show(".has-around", data.surroundings); show(".has-structures", data.structures.length);
  show(".has-path", data.camera && posedFrames().length > 1);
  show(".matches", has((s) => s.matches.length)); show("[data-view=all]", data.camera);
  $("image-pane").hidden = !data.frames.some((f) => f.image);
  document.querySelector(".panes").classList.toggle("single", $("image-pane").hidden);
  if (!data.camera) document.querySelector("[data-view=camera]").textContent = "Front";
  pointKinds.forEach(([id, name]) => $("points-by").append(option(id, name)));
  $("speed").value = data.frames.length > 12 ? 10 : 2;
  $("structure-names").innerHTML = data.structures.map((s, i) => `<span><b aria-hidden="true" style="color:${BURIED[i % 4]}">●</b> ${escape(s.name)}</span>`).join("");
  if (data.structures.length) { $("overlay-kind").value = "structures"; $("matches").checked = false; }
  else $("overlay-kind").querySelector("[value=structures]").remove();
  document.querySelectorAll(".unit").forEach((e) => { e.textContent = unit; });
  ["vertex-a", "vertex-b"].forEach((id) => { $(id).max = data.vertices - 1; });
  if (!has((s) => s.pixels)) ["overlay-kind", "opacity", "wipe"].forEach((id) => { $(id).closest("label").hidden = true; });
  residualLegend();

  $("frame").oninput = (e) => go(+e.target.value);
  $("previous").onclick = () => go(state.frame - 1);
  $("next").onclick = () => go(state.frame + 1);
  $("play").onclick = () => play(!state.playing);
  $("speed").onchange = () => { if (state.playing) play(true); changed(); };
  $("turntable").onclick = () => turntable(!turning);
  $("layer").onchange = (e) => { state.layer = layers.find((l) => l.id === e.target.value); refresh(); };
  $("limit").onchange = (e) => { if (+e.target.value > (state.layer.low || 0)) { state.layer.limit = +e.target.value; state.layer.chosen = true; } refresh(); };
  $("flat-layer").onchange = drawFlattening;
  for (const id of ["overlay-kind", "overlay-method", "opacity", "matches"]) $(id).addEventListener("input", () => { drawOverlay(); light(); changed(); });
  for (const id of ["edges", "ghost", "truth", "rig", "path", "points", "around", "solid", "shading", "cut", "cut-axis"]) $(id).addEventListener("input", () => { draw(); changed(); });
  $("points-by").oninput = () => { $("points").checked = true; paintPoints(); changed(); };
  document.querySelectorAll("[data-view]").forEach((b) => { b.onclick = () => { turntable(false); view(b.dataset.view); }; });
  const typed = () => pickVertices(["vertex-a", "vertex-b"].map((id) => ($(id).value === "" ? null : +$(id).value)));
  $("vertex-a").onchange = $("vertex-b").onchange = typed;
  $("radius").onchange = measured;
  $("clear").onclick = () => { state.picks = []; $("vertex-a").value = $("vertex-b").value = ""; measured(); };
  $("csv").onclick = saveCsv;
  let down = null;
  canvas.addEventListener("pointerdown", (e) => { down = [e.clientX, e.clientY]; turntable(false); });
  canvas.addEventListener("pointerup", (e) => {
    if (down && Math.hypot(e.clientX - down[0], e.clientY - down[1]) < 5) pickAt(e.clientX, e.clientY);
    down = null;
  });
  wireFilm(); wireHover(); wireKeys(); wireExport();
  new ResizeObserver(draw).observe(canvas);
  new ResizeObserver(drawStatuses).observe($("statuses"));
  const theme = () => { wallpaper(); buildRig(); drawStatuses(); drawOverlay(); if (renderer) render(); };
  for (const medium of ["(prefers-color-scheme: dark)", "print"]) matchMedia(medium).addEventListener("change", theme);
}
function orbit(yaw, pitch) {
  const d = eye.position.clone().sub(controls.target), r = d.length();
  const level = Math.atan2(d.x, d.z) + yaw, rise = Math.min(Math.max(Math.asin(d.y / r) + pitch, -1.5), 1.5);
  eye.position.set(Math.sin(level) * Math.cos(rise), Math.sin(rise), Math.cos(level) * Math.cos(rise)).multiplyScalar(r).add(controls.target);
  controls.update(); drawMoving();
}
function zoom(factor) { eye.position.sub(controls.target).multiplyScalar(factor).add(controls.target); controls.update(); draw(); changed(); }

/** What must stay as it is for new frames to be taken over in place. */
const kept = (d) => JSON.stringify([d.faces, d.methods, d.unit, d.structures.length,
  !!d.stream,
  ["positions", "pixels", "visible", "expected_error"].map((key) => d.frames.some((f) => f.surfaces && f.surfaces.some((s) => s && s[key])))]);
/** Take over the frames and the texts of a newer page (`dsfms view`); false where it must be loaded anew.
 * Who looks at the last frame goes on to the newest. */
function update(page) {
  const next = JSON.parse(page.getElementById("data").textContent);
  if (kept(next) !== kept(data)) return false;
  for (const id of ["summary", "sections", "curves"]) $(id).innerHTML = page.getElementById(id).innerHTML;
  readCharts();
  const name = data.frames[wanted ?? state.frame].name, follow = state.frame === data.frames.length - 1;
  const shownNow = { ...data.frames[state.frame] };
  data.frames = next.frames;
  known.clear(); held.clear(); own.clear();
  if (live) data.frames.forEach((_, f) => present(f) && own.add(f));
  const same = data.frames.findIndex((f) => f.name === name), f = follow || same < 0 ? data.frames.length - 1 : same;
  // Until its successor is here the shown frame stays.
  if (!present(f)) data.frames[f] = { ...shownNow, name: data.frames[f].name };
  const late = live && !own.has(f);
  state.frame = f;
  layers.forEach((l) => { if (!l.chosen) l.limit = undefined; });
  $("time").hidden = data.frames.length < 2;
  $("frame").max = data.frames.length - 1;
  refresh();
  if (late) { forget(f); wanted = f; bring(); }
  drawStatuses();
  return true;
}

$("tools").hidden = false;
measureScene();
wallpaper();
$("radius").value = Number((0.2 * radius).toPrecision(1));
wire_up();
buildRig();
readCharts();
if (controls) { controls.addEventListener("change", drawMoving); controls.rotateSpeed = 0.9; view("camera"); }
refresh();
paintPoints();
drawStatuses();
// Of a run that goes on the newest frame is looked at, and followed.
if ($("curves").children.length) go(data.frames.length - 1);
restore(location.hash);
addEventListener("hashchange", () => { if (location.hash !== told) restore(location.hash); });
$("viewer").dataset.ready = "yes";
// Text that lies below the stage waits until the stage is drawn.
setTimeout(drawFlattening, 50);
// For tests and the curious.
window.dsfms = { state, data, render, csv, orbit, update, measures, pickVertices, lens, link, go, place: () => eye.position.toArray(), cameraPlace, sharpness: () => coarse };
