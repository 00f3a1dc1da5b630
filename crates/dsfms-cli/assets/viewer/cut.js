// --- The cut: what lies before a plane is left out --------------------------------------------------
// The structures inside stay whole: they are what one cuts for.
/** The plane in the viewer's axes; called before every drawing, since one of them follows the eye. */
function placeCut() {
  const axis = $("cut-axis").value;
  $("cut-label").hidden = !axis;
  if (!axis) { cut.value = [0, 0, 0, 1]; return; }
  const normal = { x: [-1, 0, 0], y: [0, 1, 0], z: [0, 0, 1] }[axis] || eye.position.clone().sub(controls.target).normalize().toArray();
  const at = dot(normal, centre.toArray()), t = +$("cut").value / 100;
  // 0: nothing is left out; 100: all is.
  cut.value = [...normal, at + radius * (1.02 - 2.04 * t)];
}
const isCut = (p) => dot(cut.value, [p.x, p.y, p.z]) > cut.value[3];

/** The first point of the surface on the ray through a place of the canvas; null beside it. */
function hitAt(x, y) {
  const box = canvas.getBoundingClientRect(), px = x - box.left, py = y - box.top;
  const cell = cells().find((c) => px >= c.x && px < c.x + c.w && py >= c.y && py < c.y + c.h);
  if (!cell) return null;
  const found = { cell, px, py };
  if (!surface(state.frame, cell.k)) return found;
  aim(cell);
  const ray = new T.Raycaster(), mesh = columns[cell.k].mesh;
  ray.setFromCamera(new T.Vector2((2 * (px - cell.x)) / cell.w - 1, 1 - (2 * (py - cell.y)) / cell.h), eye);
  const hit = ray.intersectObject(mesh).find((h) => !isCut(h.point));
  if (!hit) return found;
  const face = columns[cell.k].order[hit.faceIndex], q = mesh.worldToLocal(hit.point.clone()).toArray(), p = surface(state.frame, cell.k).at;
  const c = corners(face).map((v) => point(p, v)), n = cross(sub(c[1], c[0]), sub(c[2], c[0])), nn = dot(n, n);
  const b1 = dot(cross(sub(c[2], c[1]), sub(q, c[1])), n) / nn, b2 = dot(cross(sub(c[0], c[2]), sub(q, c[2])), n) / nn;
  return { ...found, face, b: [b1, b2, 1 - b1 - b2], distance: hit.distance };
}
