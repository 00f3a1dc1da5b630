// --- Matches by their residual ----------------------------------------------------------------
// A match is x, y, kept and, where it is known, the place where the surface puts it: x, y.
const RESIDUAL = table(["28d7c0", "ffd23f", "ff5a36"]);
const residualOf = (m) => (m.length > 4 ? Math.hypot(m[3] - m[0], m[4] - m[1]) : NaN);
/** The round number of px that all but a tenth of the kept matches stay below; of the frames that are here. */
const residualLimit = (() => {
  let limit = null;
  return () => {
    if (limit !== null) return limit;
    const all = samples().flatMap((f) => methods.flatMap((k) => {
      const s = surface(f, k);
      return s && k !== data.truth ? s.matches.filter((m) => m[2]).map(residualOf).filter(Number.isFinite) : [];
    })).sort((a, b) => a - b);
    const v = all[Math.floor(0.9 * (all.length - 1))] ?? 0;
    return (limit = [1, 2, 3, 4, 6, 8, 10, 15, 20, 30, 50].find((s) => s >= v) || 100);
  };
})();
const residualColour = (m) => {
  const r = residualOf(m);
  return Number.isFinite(r) ? `rgb(${ramp(RESIDUAL, r / residualLimit()).map(Math.round)})` : "#28dc5a";
};
/** Kept: discs, with a line to where the surface has the point. Refused: crosses. */
function drawMatches(ink, matches, r) {
  const order = [...matches].sort((a, b) => (residualOf(a) || 0) - (residualOf(b) || 0));
  const cross = ([x, y]) => { ink.moveTo(x - 3.5 * r, y - 3.5 * r); ink.lineTo(x + 3.5 * r, y + 3.5 * r); ink.moveTo(x + 3.5 * r, y - 3.5 * r); ink.lineTo(x - 3.5 * r, y + 3.5 * r); };
  for (const m of order) if (!m[2]) {
    ink.beginPath(); cross(m);
    ink.lineWidth = 3.2 * r; ink.strokeStyle = "#000"; ink.stroke(); ink.lineWidth = 1.6 * r; ink.strokeStyle = "#ff66c4"; ink.stroke();
  }
  for (const m of order) if (m[2]) {
    const [x, y] = m;
    if (m.length > 4) {
      ink.beginPath(); ink.moveTo(x, y); ink.lineTo(m[3], m[4]);
      ink.lineWidth = 3 * r; ink.strokeStyle = "#000"; ink.stroke(); ink.lineWidth = 1.5 * r; ink.strokeStyle = residualColour(m); ink.stroke();
    }
    ink.beginPath(); ink.arc(x, y, 2.8 * r, 0, 7);
    ink.fillStyle = residualColour(m); ink.fill(); ink.lineWidth = r; ink.strokeStyle = "#000"; ink.stroke();
  }
}
/** What the colours of the matches mean, beside their box. */
function residualLegend() {
  const known = has((s) => s.matches.some((m) => m.length > 4));
  if (!known) return;
  const stops = RESIDUAL.filter((_, i) => i % 51 === 0).map((c) => `rgb(${c.map(Math.round)})`);
  $("residuals").innerHTML = ` 0<i style="background:linear-gradient(90deg,${stops})"></i>${residualLimit()} px`;
}
