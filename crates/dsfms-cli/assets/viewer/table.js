// --- The table of measurements, and its CSV ------------------------------------------------------
const percent = (v, sd) => {
  if (!Number.isFinite(v)) return "–";
  const shown = Math.abs(v).toFixed(1);
  return `${shown === "0.0" ? "" : v > 0 ? "+" : "−"}${shown}${Number.isFinite(sd) ? ` ± ${sd.toFixed(1)}` : ""} %`;
};

function measured() {
  const list = patch(), reference = state.picks.length ? measureOn(rest, null, list) : {};
  const rows = state.picks.length ? methods.flatMap((k) => {
    const s = surface(state.frame, k);
    return s ? [[data.methods[k], measureOn(s.at, s.expectedError, list), k]] : [];
  }) : [];
  const table = $("measured"), B = state.picks.length > 1, expected = rows.some((r) => r[1].sd);
  const against = data.moving_camera ? "" : `; change and strain against ${data.reference}`;
  const title = `${B ? "Between A and B" : "Around A; pick a second point for distances"}, ${data.frames[state.frame].name}${against}`;
  table.caption.textContent = state.picks.length ? title : "Pick two points to measure";
  const head = ["", ...(B ? [`straight, ${unit}`, `along the surface, ${unit}`, "change"] : []), `patch area, ${unit}²`, "change", "mean strain"];
  table.tHead.innerHTML = state.picks.length ? `<tr>${head.map((h) => (h ? `<th scope="col">${h}</th>` : "<td></td>")).join("")}</tr>` : "";
  const line = (name, m, change) => {
    const c = (a, b) => (change ? percent(100 * (a / b - 1)) : "");
    const sd = m.sd || {}, give = (v, s) => (Number.isFinite(s) ? `${text(v, 4)} ± ${text(s, 2)}` : text(v, 4));
    const two = B ? [give(m.straight, sd.straight), give(m.along.length, sd.along), c(m.along.length, reference.along.length)] : [];
    const bent = change ? percent(m.strain, sd.strain) : "";
    const cellsOf = [...two, list.length ? give(m.area, sd.area) : "–", list.length ? c(m.area, reference.area) : "", bent];
    return `<tr><th scope="row">${escape(name)}</th>${cellsOf.map((v) => `<td>${v}</td>`).join("")}</tr>`;
  };
  const resting = state.picks.length && !data.moving_camera ? line(data.reference, reference, false) : "";
  table.tBodies[0].innerHTML = resting + rows.map((r) => line(r[0], r[1], !data.moving_camera)).join("");
  $("uncertainty").textContent = expected ? " ± one standard deviation, from the expected error of the vertices: measured again under random smooth errors of that size." : "";
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
/** The rows of the CSV: `head`, and those `of` a frame. */
function csvRows() {
  const list = patch(), [A, B] = state.picks;
  const place = (s) => (s ? [s.face, ...s.b.map((v) => v.toFixed(6))] : ["", "", "", ""]);
  const u = unit === "mm" ? "mm" : "units";
  const header = ["frame", "method", "status", "a_face", "a_b1", "a_b2", "a_b3", "b_face", "b_b1", "b_b2", "b_b3", `straight_${u}`, `straight_sd_${u}`, `along_surface_${u}`, `along_surface_sd_${u}`, `patch_radius_${u}`, `patch_area_${u}2`, `patch_area_sd_${u}2`, "patch_mean_strain_percent", "patch_mean_strain_sd_percent"];
  const number = (v) => (Number.isFinite(v) ? v.toPrecision(7) : "");
  const quoted = (v) => (/[",\n]/.test(v) ? `"${String(v).replace(/"/g, '""')}"` : v);
  const row = (frame, name, status, p, expected) => {
    const m = measureOn(p, expected, list), sd = m.sd || {};
    const cells = [frame, name, status, ...place(A), ...place(B), number(m.straight), number(sd.straight), number(m.along && m.along.length), number(sd.along), $("radius").value, list.length ? number(m.area) : "", number(sd.area), number(m.strain), number(sd.strain)];
    return `${cells.map(quoted).join(",")}\n`;
  };
  const of = (f) => (A ? methods : []).map((k) => {
    const s = surface(f, k);
    return s ? row(data.frames[f].name, data.methods[k], data.frames[f].status[k], s.at, s.expectedError) : "";
  }).join("");
  return { head: `${header.join(",")}\n${A && !data.moving_camera ? row("", data.reference, "", rest, null) : ""}`, of };
}
/** Of the frames that are here. */
function csv() {
  const { head, of } = csvRows();
  return head + data.frames.map((_, f) => of(f)).join("");
}
let saving = false;
/** Of all frames; those of a long clip are brought one by one, and a second press ends it. */
async function saveCsv() {
  const button = $("csv"), label = button.textContent;
  if (saving) { saving = false; return; }
  const { head, of } = csvRows(), parts = [head];
  saving = true;
  for (let f = 0; f < data.frames.length && saving; f++) {
    if (present(f)) parts.push(of(f));
    else { await load(f); parts.push(of(f)); button.textContent = `${f + 1} of ${data.frames.length}; stop`; }
  }
  button.textContent = label;
  if (saving) saveBlob("measurements.csv", new Blob(parts, { type: "text/csv" }));
  saving = false;
}
