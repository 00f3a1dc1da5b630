// --- Cameras, light, sparse points -----------------------------------------------------------
const rig = new T.Group(), sparse = new T.Group();
root.add(rig, sparse);
const centre = new T.Vector3();
let radius = 1;
function measureScene() {
  const k = surface(state.frame, data.chosen) ? data.chosen : methods.find((m) => surface(state.frame, m));
  const p = k === undefined ? rest : surface(state.frame, k).at;
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  p.forEach((v, i) => { low[i % 3] = Math.min(low[i % 3], v); high[i % 3] = Math.max(high[i % 3], v); });
  const mid = low.map((v, i) => 0.5 * (v + high[i]));
  centre.set(mid[0], -mid[1], -mid[2]);
  radius = 0;
  for (let v = 0; v < p.length / 3; v++) radius = Math.max(radius, apart(point(p, v), mid));
  radius = radius || 1;
}
/** Lines of a camera's frustum in its own axes, `depth` long. */
function frustum(depth) {
  const c = data.camera, at = (x, y) => [depth * (x - c.centre[0]) / c.focal[0], depth * (y - c.centre[1]) / c.focal[1], depth];
  const q = [at(0, 0), at(c.size[0], 0), at(c.size[0], c.size[1]), at(0, c.size[1])], o = [0, 0, 0];
  // A small triangle marks the image's upper side.
  const roof = at(c.size[0] / 2, -0.25 * c.size[1]);
  return [o, q[0], o, q[1], o, q[2], o, q[3], q[0], q[1], q[1], q[2], q[2], q[3], q[3], q[0], q[0], roof, roof, q[1]];
}
const inverse = (m, p) => { // of a rigid motion
  const d = [0, 1, 2].map((r) => p[r] - m[r][3]);
  return [0, 1, 2].map((c) => m[0][c] * d[0] + m[1][c] * d[1] + m[2][c] * d[2]);
};
/** Frames whose camera is known, where the camera moves; of a long clip those that are here. */
const posedFrames = () => (data.moving_camera ? data.frames.flatMap((frame, f) => (frame.pose ? [f] : [])) : []);
function segments(list, colour, opacity) {
  const g = new T.BufferGeometry();
  g.setAttribute("position", new T.BufferAttribute(Float32Array.from(list.flat()), 3));
  return new T.LineSegments(g, material({ colour, opacity }));
}
function buildRig() {
  rig.clear();
  if (!data.camera) return;
  const ink = getComputedStyle(document.documentElement).getPropertyValue("--fg").trim();
  const length = data.moving_camera ? 0.22 * radius : 0.4 * Math.max(centre.length() - radius, 0.5 * radius);
  if (!data.moving_camera) {
    const lines = segments(frustum(length), ink, 0.8);
    lines.userData.apex = [0, 0, 0]; // seen from the camera itself it would frame nothing
    rig.add(lines);
  }
  if (data.moving_camera) data.frames.forEach((frame, f) => {
    if (!frame.pose) return;
    const now = f === state.frame;
    const lines = segments(frustum(now ? 2 * length : length).map((p) => inverse(frame.pose, p)), now ? "#d81b60" : ink, now ? 1 : 0.45);
    lines.userData.apex = inverse(frame.pose, [0, 0, 0]);
    rig.add(lines);
  });
  buildPath();
  // A light is rigid on the camera: shown at the current one.
  const pose = data.frames[state.frame].pose;
  for (const at of data.lights) {
    const ball = new T.Mesh(new T.SphereGeometry(0.03 * radius, 16, 12), material({ colour: 0xf2b705 }));
    ball.userData.apex = data.moving_camera && pose ? inverse(pose, at) : at;
    ball.position.set(...ball.userData.apex);
    rig.add(ball);
  }
}
/** What is so near to the eye that it would stand before everything is left out. */
function clearSight() {
  const [x, y, z] = eye.position.toArray(), least = 0.3 * eye.position.distanceTo(controls.target);
  for (const part of rig.children) {
    const apex = part.userData.apex;
    part.visible = (!part.userData.path || $("path").checked) && (!apex || apart([apex[0], -apex[1], -apex[2]], [x, y, z]) > least);
  }
}
/** The way of the camera from frame to frame. */
function buildPath() {
  const places = posedFrames().map((f) => inverse(data.frames[f].pose, [0, 0, 0]));
  if (places.length < 2) return;
  const line = segments(places.slice(1).flatMap((q, i) => [places[i], q]), 0xd07a00, 0.95);
  line.userData.path = true;
  // Seen from the current camera it would be a line across the surface.
  const pose = data.frames[state.frame].pose;
  if (pose) line.userData.apex = inverse(pose, [0, 0, 0]);
  rig.add(line);
}
/** Where a point in surface axes stands in a cell, px; null behind the eye. */
function onCanvas(q, cell) {
  const p = new T.Vector3(q[0], -q[1], -q[2]).project(eye);
  return p.z > 1 ? null : [cell.x + (0.5 + 0.5 * p.x) * cell.w, cell.y + (0.5 - 0.5 * p.y) * cell.h];
}
/** Where the camera of a frame stands on the screen, for tests. */
function cameraPlace(f) {
  const [cell] = cells(), box = canvas.getBoundingClientRect();
  aim(cell);
  const [x, y] = onCanvas(inverse(data.frames[f].pose, [0, 0, 0]), cell);
  return [box.x + x, box.y + y];
}
const REACH = 7; // px from a frustum's lines
/** The camera under a place of the canvas, where no surface is before it. */
function cameraAt({ cell, px, py, distance }) {
  if (!data.camera || !$("rig").checked) return null;
  aim(cell);
  const depth = 0.22 * radius, near = (a, b) => {
    const d = [b[0] - a[0], b[1] - a[1]], t = Math.min(Math.max(((px - a[0]) * d[0] + (py - a[1]) * d[1]) / (d[0] ** 2 + d[1] ** 2 || 1), 0), 1);
    return Math.hypot(px - a[0] - t * d[0], py - a[1] - t * d[1]);
  };
  let best = null;
  for (const f of posedFrames()) {
    const to = (p) => inverse(data.frames[f].pose, p), [x, y, z] = to([0, 0, 0]);
    if (new T.Vector3(x, -y, -z).distanceTo(eye.position) > (distance ?? Infinity)) continue;
    const list = frustum(f === state.frame ? 2 * depth : depth).map((p) => onCanvas(to(p), cell));
    for (let i = 0; i < list.length; i += 2) {
      const away = list[i] && list[i + 1] ? near(list[i], list[i + 1]) : Infinity;
      if (away < REACH && (!best || away < best.away)) best = { frame: f, away };
    }
  }
  return best;
}
