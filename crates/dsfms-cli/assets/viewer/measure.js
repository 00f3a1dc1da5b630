// --- Measuring -------------------------------------------------------------------------------
// Neighbours of every vertex: over an edge, and straight across the edge between two faces.
const ways = (() => {
  const out = Array.from({ length: data.vertices }, () => []);
  for (const [a, b, c, d] of edgeList) {
    out[a].push([b]); out[b].push([a]);
    if (d !== undefined) { out[c].push([d, a, b]); out[d].push([c, a, b]); }
  }
  return out;
})();
function wayLength(p, from, [to, a, b]) {
  const [s, t] = [point(p, from), point(p, to)];
  if (a === undefined) return apart(s, t);
  // Unfold both faces about the edge a-b; the way is usable where it crosses that edge.
  const o = point(p, a), e = sub(point(p, b), o), l = length(e);
  const flat = (q) => { const d = sub(q, o), x = dot(d, e) / l; return [x, Math.sqrt(Math.max(dot(d, d) - x * x, 0))]; };
  const [x1, y1] = flat(s), [x2, y2] = flat(t), x = x1 + ((x2 - x1) * y1) / (y1 + y2 || 1);
  return x >= 0 && x <= l ? Math.hypot(x1 - x2, y1 + y2) : Infinity;
}
/** Distances along the surface p from the point A, and the vertex before each (-1 at the start). */
function distances(p, A) {
  const d = new Float64Array(data.vertices).fill(Infinity), before = new Int32Array(data.vertices).fill(-1);
  const heap = [], start = onFace(p, A);
  const up = (i) => { while (i && heap[i][0] < heap[(i - 1) >> 1][0]) { const j = (i - 1) >> 1; [heap[i], heap[j]] = [heap[j], heap[i]]; i = j; } };
  const push = (v, t) => { heap.push([t, v]); up(heap.length - 1); };
  const pop = () => {
    const top = heap[0], last = heap.pop();
    if (heap.length) {
      heap[0] = last;
      for (let i = 0; ;) {
        let m = i;
        for (const j of [2 * i + 1, 2 * i + 2]) if (j < heap.length && heap[j][0] < heap[m][0]) m = j;
        if (m === i) break;
        [heap[i], heap[m]] = [heap[m], heap[i]]; i = m;
      }
    }
    return top;
  };
  for (const v of corners(A.face)) { d[v] = apart(start, point(p, v)); push(v, d[v]); }
  while (heap.length) {
    const [t, v] = pop();
    if (t > d[v]) continue;
    for (const way of ways[v]) {
      const next = t + wayLength(p, v, way);
      if (next < d[way[0]]) { d[way[0]] = next; before[way[0]] = v; push(way[0], next); }
    }
  }
  return { d, before };
}
function alongSurface(p, A, B) {
  const end = onFace(p, B), start = onFace(p, A);
  if (A.face === B.face) return { length: apart(start, end), path: [start, end] };
  const { d, before } = distances(p, A);
  const total = (v) => d[v] + apart(point(p, v), end);
  let v = corners(B.face).reduce((a, b) => (total(b) < total(a) ? b : a));
  const result = { length: total(v), path: [end] };
  for (; v >= 0; v = before[v]) result.path.push(point(p, v));
  result.path.push(start);
  return result;
}
/** Faces within the radius of A along the surface at rest. */
function patch() {
  const [A] = state.picks, r = +$("radius").value;
  if (!A || !(r > 0)) return [];
  const { d } = distances(rest, A);
  return [...Array(faceCount).keys()].filter((f) => mean(corners(f).map((v) => d[v])) <= r);
}
const total = (p, list) => list.reduce((s, f) => s + faceArea(p, f), 0);
const interpolated = (values, s) => corners(s.face).reduce((t, v, j) => t + s.b[j] * values[v], 0);
/** Everything measured on one surface. */
function measureOn(p, confidence, list) {
  const [A, B] = state.picks, out = { area: total(p, list) };
  out.strain = list.length ? mean(list.map((f) => strainNow(p)[f])) : NaN;
  if (B) {
    out.straight = apart(onFace(p, A), onFace(p, B));
    Object.assign(out, { along: alongSurface(p, A, B) });
    if (confidence) out.expected = Math.hypot(interpolated(confidence, A), interpolated(confidence, B));
  }
  return out;
}
const strainKnown = new WeakMap();
const strainNow = (p) => { if (!strainKnown.has(p)) strainKnown.set(p, strain(p)); return strainKnown.get(p); };
const percent = (v) => {
  if (!Number.isFinite(v)) return "–";
  const shown = Math.abs(v).toFixed(1);
  return `${shown === "0.0" ? "" : v > 0 ? "+" : "−"}${shown} %`;
};

function measured() {
  const list = patch(), reference = state.picks.length ? measureOn(rest, null, list) : {};
  const rows = state.picks.length ? methods.flatMap((k) => {
    const s = surface(state.frame, k);
    return s ? [[data.methods[k], measureOn(s.at, s.confidence, list), k]] : [];
  }) : [];
  const table = $("measured"), B = state.picks.length > 1, expected = rows.some((r) => r[1].expected !== undefined);
  const against = data.moving_camera ? "" : `; change and strain against ${data.reference}`;
  const title = `${B ? "Between A and B" : "Around A; pick a second point for distances"}, ${data.frames[state.frame].name}${against}`;
  table.caption.textContent = state.picks.length ? title : "Pick two points to measure";
  const head = ["", ...(B ? [`straight, ${unit}`, `along the surface, ${unit}`, "change"] : []), ...(expected && B ? [`expected error, ${unit}`] : []), `patch area, ${unit}²`, "change", "mean strain"];
  table.tHead.innerHTML = state.picks.length ? `<tr>${head.map((h) => `<th scope="col">${h}</th>`).join("")}</tr>` : "";
  const line = (name, m, change) => {
    const c = (a, b) => (change ? percent(100 * (a / b - 1)) : "");
    const two = B ? [text(m.straight, 4), text(m.along.length, 4), c(m.along.length, reference.along.length), ...(expected ? [text(m.expected, 2)] : [])] : [];
    const cellsOf = [...two, list.length ? text(m.area, 4) : "–", list.length ? c(m.area, reference.area) : "", change ? percent(m.strain) : ""];
    return `<tr><th scope="row">${escape(name)}</th>${cellsOf.map((v) => `<td>${v}</td>`).join("")}</tr>`;
  };
  const resting = state.picks.length && !data.moving_camera ? line(data.reference, reference, false) : "";
  table.tBodies[0].innerHTML = resting + rows.map((r) => line(r[0], r[1], !data.moving_camera)).join("");
  $("uncertainty").textContent = expected ? " Expected error: the two points' own, taken as independent." : "";
  columns.forEach((column, k) => placePins(column, surface(state.frame, k), rows.find((r) => r[2] === k)));
  drawOverlay(); draw();
}
function placePins(column, s, row) {
  column.pins.forEach((pin, i) => {
    pin.visible = !!s && i < state.picks.length;
    if (!pin.visible) return;
    pin.position.set(...onFace(s.at, state.picks[i]));
    pin.scale.setScalar(0.014 * radius);
  });
  column.path.visible = !!(row && row[1].along);
  if (!column.path.visible) return;
  const way = row[1].along.path, list = way.slice(1).flatMap((q, i) => [...way[i], ...q]);
  column.path.geometry.dispose();
  column.path.geometry = new T.BufferGeometry();
  column.path.geometry.setAttribute("position", new T.BufferAttribute(Float32Array.from(list), 3));
}
function csv() {
  const list = patch(), [A, B] = state.picks;
  const place = (s) => (s ? [s.face, ...s.b.map((v) => v.toFixed(6))] : ["", "", "", ""]);
  const u = unit === "mm" ? "mm" : "units";
  const rows = [["frame", "method", "status", "a_face", "a_b1", "a_b2", "a_b3", "b_face", "b_b1", "b_b2", "b_b3", `straight_${u}`, `along_surface_${u}`, `expected_error_${u}`, `patch_radius_${u}`, `patch_area_${u}2`, "patch_mean_strain_percent"]];
  const number = (v) => (Number.isFinite(v) ? v.toPrecision(7) : "");
  const push = (frame, name, status, p, confidence) => {
    const m = measureOn(p, confidence, list);
    rows.push([frame, name, status, ...place(A), ...place(B), number(m.straight), number(m.along && m.along.length), number(m.expected), $("radius").value, list.length ? number(m.area) : "", number(m.strain)]);
  };
  if (A) {
    if (!data.moving_camera) push("", data.reference, "", rest, null);
    data.frames.forEach((frame, f) => methods.forEach((k) => {
      const s = surface(f, k);
      if (s) push(frame.name, data.methods[k], frame.status[k], s.at, s.confidence);
    }));
  }
  const quoted = (v) => (/[",\n]/.test(v) ? `"${String(v).replace(/"/g, '""')}"` : v);
  return rows.map((r) => r.map(quoted).join(",")).join("\n") + "\n";
}
function save(name, content) {
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(new Blob([content], { type: "text/csv" })), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
function pick(place) {
  state.picks = state.picks.length > 1 ? [place] : [...state.picks, place];
  const own = (i) => { const s = state.picks[i]; return s ? corners(s.face)[s.b.indexOf(Math.max(...s.b))] : ""; };
  $("vertex-a").value = own(0); $("vertex-b").value = own(1);
  measured();
}
const atVertex = (v) => {
  const c = faces.indexOf(v);
  return c < 0 ? null : { face: Math.floor(c / 3), b: [0, 1, 2].map((i) => (i === c % 3 ? 1 : 0)) };
};
function pickAt(x, y) {
  const box = canvas.getBoundingClientRect(), px = x - box.left, py = y - box.top;
  const cell = cells().find((c) => px >= c.x && px < c.x + c.w && py >= c.y && py < c.y + c.h);
  if (!cell || !surface(state.frame, cell.k)) return;
  aim(cell);
  const ray = new T.Raycaster(), mesh = columns[cell.k].mesh;
  ray.setFromCamera(new T.Vector2((2 * (px - cell.x)) / cell.w - 1, 1 - (2 * (py - cell.y)) / cell.h), eye);
  const hit = ray.intersectObject(mesh)[0];
  if (!hit) return;
  const face = Math.floor(hit.face.a / 3), q = mesh.worldToLocal(hit.point.clone()).toArray(), p = surface(state.frame, cell.k).at;
  const c = corners(face).map((v) => point(p, v)), n = cross(sub(c[1], c[0]), sub(c[2], c[0])), nn = dot(n, n);
  const b1 = dot(cross(sub(c[2], c[1]), sub(q, c[1])), n) / nn, b2 = dot(cross(sub(c[0], c[2]), sub(q, c[2])), n) / nn;
  pick({ face, b: [b1, b2, 1 - b1 - b2] });
}
