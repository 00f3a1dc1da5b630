// --- Viewing ---------------------------------------------------------------------------------
const controls = renderer && new T.OrbitControls(eye, canvas);
let fit = 0.7; // full angle that must fit into a cell, rad
function view(kind) {
  if (!controls) return;
  // From the camera's place where there is one outside the surface, else from three radii before it.
  const pose = data.moving_camera && data.frames[state.frame].pose, [cx, cy, cz] = pose ? inverse(pose, [0, 0, 0]) : [0, 0, 0];
  const place = new T.Vector3(cx, -cy, -cz), own = place.distanceTo(centre);
  const inCamera = (data.camera || !data.moving_camera) && own > 1.15 * radius;
  const whole = kind === "all" && data.camera;
  const target = whole ? centre.clone().lerp(place, 0.5) : centre.clone();
  const back = inCamera ? place.sub(centre).divideScalar(own) : new T.Vector3(0, 0, 1);
  const [yaw, pitch] = { camera: [0, 0], left: [-65, 0], right: [65, 0], top: [0, 65], all: [-55, 25] }[kind].map((d) => (d * Math.PI) / 180);
  const level = Math.atan2(back.x, back.z) + yaw, rise = Math.min(Math.asin(back.y) + pitch, 1.5);
  const reach = whole ? 0.5 * own + radius : radius;
  const away = whole ? 3.2 * reach : inCamera ? own : 3 * radius;
  fit = 2 * Math.asin(Math.min(reach / away, 0.9)) * 1.04;
  eye.position.set(Math.sin(level) * Math.cos(rise), Math.sin(rise), Math.cos(level) * Math.cos(rise)).multiplyScalar(away).add(target);
  eye.near = radius / 100; eye.far = 40 * (radius + own);
  controls.target.copy(target);
  controls.update();
  draw(); changed();
}

let turning = 0;
/** A full turn in twelve seconds. */
function turntable(on) {
  cancelAnimationFrame(turning);
  turning = 0;
  $("turntable").setAttribute("aria-pressed", String(on));
  let last = performance.now();
  const step = (now) => {
    orbit(((now - last) / 12000) * 2 * Math.PI, 0);
    last = now;
    turning = requestAnimationFrame(step);
  };
  if (on && controls) turning = requestAnimationFrame(step);
}

let due = false;
/** Ask for one drawing at the next screen refresh. */
function draw() {
  if (due || !renderer) return;
  due = true;
  requestAnimationFrame(() => { due = false; render(false); });
}
// Where a slow machine turns the view, it draws fewer pixels until it keeps up, and all of them again
// when the view comes to rest.
let coarse = 1, moving = false, resting = 0, before = 0, slow = 0;
let finest = 1, raised = false; // what proved too fine is not tried again before the view rests
const SLOW_MS = 19, QUICK_MS = 17.2, REST_MS = 180, COARSEST = 0.4;
function drawMoving() {
  const now = performance.now(), took = now - before;
  before = now;
  if (moving) slow += took > SLOW_MS ? 1 : took < QUICK_MS ? -0.05 : 0;
  if (slow > 3) { coarse = Math.max(0.75 * coarse, COARSEST); slow = 0; if (raised) finest = coarse; }
  if (slow < -3) { raised = coarse < finest; coarse = Math.min(coarse / 0.75, finest); slow = 0; }
  moving = true;
  clearTimeout(resting);
  resting = setTimeout(() => { moving = raised = false; finest = 1; if (coarse < 1) draw(); }, REST_MS);
  draw(); changed();
}
/** The grid in which n cells are largest. */
function grid(n, w, h) {
  let best = { columns: 1, rows: n, size: 0 };
  for (let c = 1; c <= n; c++) {
    const r = Math.ceil(n / c), size = Math.min(w / c, h / r);
    if (size > best.size * 1.02) best = { columns: c, rows: r, size };
  }
  return best;
}
function cells() {
  const w = canvas.clientWidth, h = canvas.clientHeight, g = grid(state.shown.length, w, h);
  return state.shown.map((k, i) => ({ k, x: ((i % g.columns) * w) / g.columns, y: (Math.floor(i / g.columns) * h) / g.rows, w: w / g.columns, h: h / g.rows }));
}
function aim(cell) {
  eye.aspect = cell.w / cell.h;
  const half = Math.tan(fit / 2) / Math.min(eye.aspect, 1);
  eye.fov = (2 * Math.atan(half) * 180) / Math.PI;
  eye.updateProjectionMatrix();
  eye.updateMatrixWorld(); // who asks before the next drawing sees where it is
}
let labelled = "", sized = "";
/** A new drawing buffer only where the size has changed. */
function fitCanvas(w, h) {
  const ratio = Math.min(devicePixelRatio, 2) * (moving ? coarse : 1), size = `${w} ${h} ${ratio}`;
  if (size === sized) return;
  sized = size;
  renderer.setPixelRatio(ratio);
  renderer.setSize(w, h, false);
  // Where few pixels are drawn they are not blended either.
  canvas.style.imageRendering = moving && coarse < 0.5 ? "pixelated" : "";
}
/** The background, asked of the style sheet when the theme or the medium changes. */
function wallpaper() {
  if (renderer) renderer.setClearColor(getComputedStyle(document.documentElement).getPropertyValue("--space").trim(), 1);
}
/** `asIs`: into a drawing buffer whose size was set by the caller. */
function render(asIs) {
  const w = canvas.clientWidth, h = canvas.clientHeight;
  if (!w || !h) return;
  if (!asIs) fitCanvas(w, h);
  // A grid may have a cell too many.
  renderer.setScissorTest(false);
  renderer.clear();
  renderer.setScissorTest(true);
  const solid = data.structures.length ? $("solid").value / 100 : 1;
  for (const m of [painted, photographed, bare]) { m.uniforms.opacity.value = solid; m.transparent = solid < 1; m.depthWrite = solid === 1; }
  for (const m of [painted, bare]) m.uniforms.lit.value = +$("shading").checked;
  placeCut();
  const labels = [];
  clearSight();
  for (const cell of cells()) {
    aim(cell);
    const photo = columns[cell.k].photo;
    photographed.uniforms.map.value = photo; photographed.uniforms.pictured.value = +!!photo;
    columns.forEach((c, k) => {
      c.group.visible = k === cell.k && !!surface(state.frame, k);
      c.edges.visible = $("edges").checked;
      c.ghost.visible = $("ghost").checked && !!(surface(state.frame, k) || {}).pose;
      c.truth.visible = $("truth").checked && data.truth !== undefined && k !== data.truth;
    });
    rig.visible = $("rig").checked; sparse.visible = $("points").checked; around.visible = $("around").checked;
    renderer.setViewport(cell.x, h - cell.y - cell.h, cell.w, cell.h);
    renderer.setScissor(cell.x, h - cell.y - cell.h, cell.w, cell.h);
    renderer.render(scene, eye);
    labels.push(cellLabel(cell));
  }
  const html = labels.join("");
  if (html !== labelled) $("labels").innerHTML = labelled = html;
}
const escape = (t) => t.replace(/[&<>"]/g, (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" }[c]));
function cellLabel(cell) {
  const status = data.frames[state.frame].status[cell.k];
  const name = data.methods.length > 1 || !data.moving_camera ? escape(data.methods[cell.k]) : "";
  const note = surface(state.frame, cell.k) ? summaryOf(cell.k) : "no surface";
  const mark = status === "ok" ? "" : ` <b class="${status}" style="position:static;border:0">${statusWord(status)}</b>`;
  let html = name ? `<span style="left:${cell.x}px;top:${cell.y}px;max-width:${cell.w}px">${name}${mark} ${note}</span>` : "";
  columns[cell.k].pins.forEach((pin, i) => {
    if (!pin.visible || !columns[cell.k].group) return;
    const p = pin.getWorldPosition(new T.Vector3()).project(eye);
    html += `<i style="left:${cell.x + (0.5 + 0.5 * p.x) * cell.w}px;top:${cell.y + (0.5 - 0.5 * p.y) * cell.h}px">${"AB"[i]}</i>`;
  });
  // All cells are drawn alike: one bar serves them.
  return cell.k === state.shown[state.shown.length - 1] ? html + scaleBar(cell) : html;
}
/** A length at the distance of the orbit's centre. */
function scaleBar(cell) {
  const perPixel = (2 * Math.tan((eye.fov * Math.PI) / 360) * eye.position.distanceTo(controls.target)) / cell.h;
  const wanted = 0.28 * cell.w * perPixel, decade = 10 ** Math.floor(Math.log10(wanted));
  const long = [5, 2, 1].find((s) => s * decade <= wanted) * decade, wide = long / perPixel;
  const x = cell.x + cell.w - wide - 12, y = cell.y + cell.h - 16;
  return `<b style="left:${x}px;top:${y}px;width:${wide}px"></b><u style="right:${canvas.clientWidth - cell.x - cell.w + 12}px;top:${y - 20}px">${text(long, 1)} ${unit}</u>`;
}
const mean = (a) => a.reduce((s, v) => s + v, 0) / a.length;
function summaryOf(k) {
  if (data.truth === undefined || k === data.truth || state.layer.id !== "error") return "";
  return `${mean(errors(state.frame, k)).toFixed(2)} ${unit} mean`;
}
