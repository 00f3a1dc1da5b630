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
  if (!data.moving_camera) rig.add(segments(frustum(length), ink, 0.8));
  else data.frames.forEach((frame, f) => {
    if (!frame.pose) return;
    const now = f === state.frame;
    const lines = segments(frustum(now ? 2 * length : length).map((p) => inverse(frame.pose, p)), now ? "#d81b60" : ink, now ? 1 : 0.45);
    if (!now) lines.userData.apex = inverse(frame.pose, [0, 0, 0]);
    rig.add(lines);
  });
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
    part.visible = !apex || apart([apex[0], -apex[1], -apex[2]], [x, y, z]) > least;
  }
}
if (data.points) {
  const g = new T.BufferGeometry();
  g.setAttribute("position", new T.BufferAttribute(cloud(data.points), 3));
  sparse.add(new T.Points(g, material({ colour: 0xe07b00 })));
}
