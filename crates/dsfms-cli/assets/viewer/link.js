// --- The view in the address: a link shows what its sender saw --------------------------------------
const LINK = "#view:";
const TOGGLES = ["edges", "shading", "ghost", "truth", "rig", "path", "points", "around", "matches", "wipe"];
const CHOICES = ["overlay-kind", "opacity", "solid", "cut-axis", "cut", "points-by", "speed"];
const short = (v) => Number(v.toPrecision(5));

/** The present view as text. */
function link() {
  const parts = new URLSearchParams();
  parts.set("frame", data.frames[state.frame].name);
  parts.set("layer", state.layer.id);
  if (state.layer.chosen) parts.set("limit", short(state.layer.limit));
  parts.set("methods", state.shown.map((k) => data.methods[k]).join("|"));
  parts.set("over", data.methods[+$("overlay-method").value] || "");
  parts.set("on", TOGGLES.filter((id) => $(id).checked).join("."));
  for (const id of CHOICES) parts.set(id, $(id).value);
  if (controls) parts.set("eye", [...eye.position.toArray(), ...controls.target.toArray(), fit].map(short).join(","));
  parts.set("lens", [lens.zoom, lens.x, lens.y, lens.wipe].map(short).join(","));
  if (state.picks.length) parts.set("picks", state.picks.map((p) => [p.face, ...p.b.map(short)].join(",")).join("|"));
  return LINK + parts.toString();
}
let telling = 0, told = "";
/** Something has changed: the address follows when it has come to rest. */
function changed() {
  clearTimeout(telling);
  telling = setTimeout(() => {
    if (state.playing || turning) return;
    told = link();
    try { history.replaceState(null, "", told); } catch { /* a page that may not: its address stays */ }
  }, 400);
}
const listed = (textOf, count, separator = ",") => {
  const list = (textOf || "").split(separator).map(Number);
  return list.length === count && list.every(Number.isFinite) ? list : null;
};
/** Take over the view of a link; what it names that is not here is left as it is. */
function restore(hash) {
  if (!hash.startsWith(LINK)) return false;
  const parts = new URLSearchParams(hash.slice(LINK.length)), get = (key) => parts.get(key);
  const set = (id, value) => {
    const field = $(id);
    if (field.tagName === "SELECT" && ![...field.options].some((o) => o.value === value)) return;
    field.value = value;
  };
  // Links of earlier versions call the expected error confidence.
  const named = get("layer") === "confidence" ? "expected_error" : get("layer");
  const layer = layers.find((l) => l.id === named);
  if (layer) { state.layer = layer; $("layer").value = layer.id; }
  if (+get("limit") > (state.layer.low || 0)) Object.assign(state.layer, { limit: +get("limit"), chosen: true });
  const names = (get("methods") || "").split("|"), shown = methods.filter((k) => names.includes(data.methods[k]));
  if (shown.length) state.shown = shown;
  for (const box of $("method-boxes").querySelectorAll("input")) box.checked = state.shown.includes(+box.value);
  if (data.methods.includes(get("over"))) $("overlay-method").value = data.methods.indexOf(get("over"));
  if (get("on") !== null) for (const id of TOGGLES) $(id).checked = get("on").split(".").includes(id);
  for (const id of CHOICES) if (get(id) !== null) set(id, get(id));
  const [zoom, x, y, wipe] = listed(get("lens"), 4) || [lens.zoom, lens.x, lens.y, lens.wipe];
  Object.assign(lens, { zoom, x, y, wipe: Math.min(Math.max(wipe, 0), 1) });
  const place = listed(get("eye"), 7);
  if (place && controls && place[6] > 0 && place[6] < 3) {
    eye.position.set(...place.slice(0, 3)); controls.target.set(...place.slice(3, 6)); fit = place[6];
    controls.update();
  }
  const picks = (get("picks") || "").split("|").map((p) => listed(p, 4)).filter((p) => p && p[0] >= 0 && p[0] < faceCount);
  state.picks = picks.slice(0, 2).map(([face, ...b]) => ({ face: Math.floor(face), b }));
  paintPoints();
  placeFilm();
  const f = data.frames.findIndex((frame) => frame.name === get("frame"));
  go(f < 0 ? state.frame : f);
  return true;
}
