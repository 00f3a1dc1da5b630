// --- Legends, flattening ---------------------------------------------------------------------
function legend(layer, bar, ticks) {
  if (!layer.values) { bar.hidden = true; ticks.innerHTML = ""; return; }
  if (layer.flags) {
    bar.hidden = true;
    ticks.innerHTML = `<span><b style="color:rgb(${SEEN})">■</b> seen</span><span><b style="color:rgb(${HIDDEN})">■</b> hidden or outside</span>`;
    return;
  }
  bar.hidden = false;
  bar.width = 256;
  const ink = bar.getContext("2d"), limit = limitOf(layer), low = layer.signed ? -limit : layer.low || 0;
  for (let x = 0; x < 256; x++) { ink.fillStyle = `rgb(${colourOf(layer, low + ((limit - low) * x) / 255)})`; ink.fillRect(x, 0, 1, 12); }
  const sign = (v) => (layer.signed && v > 0 ? "+" : "") + text(v, layer.low ? 3 : 2);
  ticks.innerHTML = [0, 0.5, 1].map((t, i) => `<span>${sign(low + t * (limit - low))}${i === 2 && layer.unit ? ` ${layer.unit}` : ""}</span>`).join("");
}
function drawFlattening() {
  $("flat").hidden = !atlas;
  if (!atlas) return;
  const layer = layers.find((l) => l.id === $("flat-layer").value), values = layer.values();
  // Only the part of the unit square that is used.
  const low = [1, 1], high = [0, 0];
  atlas.forEach((v, i) => { low[i % 2] = Math.min(low[i % 2], v); high[i % 2] = Math.max(high[i % 2], v); });
  const scale = 1000 / Math.max(high[0] - low[0], 1e-6), tall = Math.ceil(scale * (high[1] - low[1]));
  for (const id of ["chart", "chart-albedo"]) { $(id).width = 1000; $(id).height = tall; }
  legend(layer, $("flat-ramp"), $("flat-ticks"));
  const ink = $("chart").getContext("2d");
  for (let f = 0; f < faceCount; f++) {
    ink.fillStyle = ink.strokeStyle = `rgb(${colourOf(layer, values[f]).map(Math.round)})`;
    ink.beginPath();
    for (let c = 0; c < 3; c++) ink[c ? "lineTo" : "moveTo"](scale * (atlas[6 * f + 2 * c] - low[0]), scale * (high[1] - atlas[6 * f + 2 * c + 1]));
    ink.closePath(); ink.fill(); ink.lineWidth = 0.6; ink.stroke();
  }
  $("albedo-figure").hidden = !albedoImage;
  if (albedoImage) albedoImage.decode().then(() => {
    $("chart-albedo").getContext("2d").drawImage(albedoImage, -scale * low[0], -scale * (1 - high[1]), scale, scale);
  }).catch(() => {});
}
