// --- Charts by frame: values under the pointer, the current frame, a click that goes to one -------
// A chart says in its attributes where it lies (data-box: left, right, top, floor, in its own units),
// what its places mean (data-places: their names, or nothing where they are numbers; data-span: first
// and last place) and every line's points (data-points: place:value).
const numberIn = (name) => { const d = /(\d+)\D*$/.exec(name); return d ? Number(d[1]) : NaN; };
/** Which frame a place's name means: that of the same name, else of the same number. */
const frameNamed = (name) => {
  const same = data.frames.findIndex((f) => f.name === name);
  return same >= 0 ? same : data.frames.findIndex((f) => numberIn(f.name) === numberIn(name));
};
/** The frame next to a number; of a report that holds some of a clip's. */
const frameNear = (name) => {
  const exact = frameNamed(name), n = numberIn(name);
  if (exact >= 0 || !Number.isFinite(n)) return exact;
  const away = data.frames.map((f) => Math.abs(numberIn(f.name) - n));
  return away.indexOf(Math.min(...away));
};
let charts = [];
function readCharts() {
  charts = [...document.querySelectorAll("svg[data-box]")].map((svg) => {
    const [left, right, top, floor] = svg.dataset.box.split(",").map(Number), [first, last] = svg.dataset.span.split(",").map(Number);
    const names = svg.dataset.places ? JSON.parse(svg.dataset.places) : null;
    const series = [...svg.querySelectorAll("[data-points]")].map((line) => ({
      label: line.dataset.label, points: line.dataset.points.split(" ").filter(Boolean).map((p) => p.split(":").map(Number)),
    }));
    const runs = (svg.dataset.runs || "").split(" ").filter(Boolean).map((r) => r.split(":"));
    const chart = { svg, left, right, top, floor, first, last, names, series, runs, byFrame: svg.dataset.by === "frame" };
    chart.name = (x) => (names ? names[Math.round(x)] ?? "" : String(Math.round(x)));
    chart.step = Math.max((last - first) / Math.max(...series.map((s) => s.points.length), 1), names ? 0.5 : 0);
    chart.at = (x) => left + ((right - left) * (x - first)) / (last - first || 1);
    wireChart(chart);
    return chart;
  });
  stripKnown = null;
  cursors(state.frame);
}
function chartLine(chart, kind) {
  const line = document.createElementNS(chart.svg.namespaceURI, "line");
  line.setAttribute("class", `cursor ${kind}`);
  line.setAttribute("y1", chart.top); line.setAttribute("y2", chart.floor);
  chart.svg.append(line);
  return line;
}
function stand(line, x) {
  line.style.display = x === null ? "none" : "";
  if (x !== null) for (const end of ["x1", "x2"]) line.setAttribute(end, x.toFixed(1));
}
/** The place of a frame in a chart; null where it has none. */
function placeOf(chart, f) {
  if (!chart.byFrame) return null;
  const { name } = data.frames[f], n = numberIn(name);
  if (!chart.names) return Number.isFinite(n) ? n : null;
  const same = chart.names.indexOf(name), place = same >= 0 ? same : chart.names.findIndex((other) => numberIn(other) === n);
  return place < 0 ? null : place;
}
/** Every chart's line stands at the shown frame. */
function cursors(f) {
  for (const chart of charts) {
    const x = placeOf(chart, f);
    chart.now ??= chartLine(chart, "now");
    stand(chart.now, x === null || x < chart.first || x > chart.last ? null : chart.at(x + (chart.runs.length ? 0.5 : 0)));
  }
}
/** What a chart says at a place: the nearest point of every line, or the status of the frame there. */
function chartLines(chart, x) {
  if (chart.runs.length) {
    let n = Math.floor(x);
    for (const [status, count] of chart.runs) { if (n < +count) return [`${chart.byFrame ? "frame " : ""}${chart.name(Math.floor(x))}: ${status}`]; n -= +count; }
    return [];
  }
  const near = chart.series.map(({ label, points }) => [label, points.reduce((a, b) => (!a || Math.abs(b[0] - x) < Math.abs(a[0] - x) ? b : a), null)]);
  const place = near.map((n) => n[1]).filter(Boolean).sort((a, b) => Math.abs(a[0] - x) - Math.abs(b[0] - x))[0];
  if (!place) return [];
  const against = chart.svg.dataset.against;
  return [`${against.split(",")[0]} ${chart.names ? chart.name(place[0]) : place[0]}${against.split(",")[1] || ""}`,
    ...near.filter(([, p]) => p && Math.abs(p[0] - place[0]) <= chart.step).map(([label, p]) => `${label ? `${label}: ` : ""}${p[1] && Math.abs(p[1]) < 1e-3 ? p[1].toExponential(1) : text(p[1], 3)}`)];
}
function wireChart(chart) {
  const { svg } = chart, figure = svg.parentElement, box = Object.assign(document.createElement("div"), { className: "tip", hidden: true });
  const hover = chartLine(chart, "hover");
  box.setAttribute("aria-hidden", "true");
  figure.append(box);
  stand(hover, null);
  const placed = (e) => {
    const frame = svg.getBoundingClientRect(), x = ((e.clientX - frame.left) / frame.width) * svg.viewBox.baseVal.width;
    const inside = x >= chart.left - 6 && x <= chart.right + 6;
    return inside ? Math.min(Math.max(chart.first + ((x - chart.left) / (chart.right - chart.left)) * (chart.last - chart.first), chart.first), chart.last - (chart.runs.length ? 1e-6 : 0)) : null;
  };
  svg.addEventListener("pointermove", (e) => {
    const x = placed(e), lines = x === null ? [] : chartLines(chart, x), outer = figure.getBoundingClientRect();
    stand(hover, lines.length ? chart.at(x) : null);
    tip(box, lines, e.clientX - outer.left, e.clientY - outer.top);
  });
  svg.addEventListener("pointerleave", () => { box.hidden = true; stand(hover, null); });
  if (chart.byFrame) svg.addEventListener("click", (e) => {
    const x = placed(e), f = x === null ? -1 : frameNear(chart.name(chart.runs.length ? Math.floor(x) : x));
    if (f >= 0) go(f);
  });
}
let stripKnown = null;
/** The status that the page's strip gives a frame. */
function stripStatus(name) {
  if (!stripKnown) {
    stripKnown = new Map();
    const strip = charts.find((c) => c.runs.length && c.byFrame);
    let n = 0;
    for (const [status, count] of strip ? strip.runs : []) for (let i = 0; i < +count; i++, n++) stripKnown.set(numberIn(strip.name(n)), status);
  }
  return stripKnown.get(numberIn(name));
}
