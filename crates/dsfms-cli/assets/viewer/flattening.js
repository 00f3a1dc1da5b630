// --- Legends, flattening ---------------------------------------------------------------------
function legend(layer, bar, ticks) {
  bar.parentElement.hidden = !layer.values;
  if (!layer.values) return;
  if (layer.flags) {
    bar.hidden = true;
    ticks.innerHTML = `<span><b aria-hidden="true" style="color:rgb(${SEEN})">■</b> seen</span><span><b aria-hidden="true" style="color:rgb(${HIDDEN})">■</b> hidden or outside</span>`;
    return;
  }
  bar.hidden = false;
  bar.width = 256;
  const ink = bar.getContext("2d"), limit = limitOf(layer), low = layer.signed ? -limit : layer.low || 0;
  for (let x = 0; x < 256; x++) { ink.fillStyle = `rgb(${colourOf(layer, low + ((limit - low) * x) / 255)})`; ink.fillRect(x, 0, 1, 12); }
  const sign = (v) => (layer.signed && v > 0 ? "+" : "") + text(v, layer.low ? 3 : 2);
  ticks.innerHTML = [0, 0.5, 1].map((t, i) => `<span>${sign(low + t * (limit - low))}${i === 2 && layer.unit ? ` ${layer.unit}` : ""}</span>`).join("");
}
/** Every pixel whose centre lies in the triangle or within half a pixel of it: neighbours leave no gap. */
function fillTriangle(picture, q, colour) {
  const area = (q[1][0] - q[0][0]) * (q[2][1] - q[0][1]) - (q[2][0] - q[0][0]) * (q[1][1] - q[0][1]);
  if (!area) return;
  const sides = [0, 1, 2].map((i) => {
    const a = q[i], b = q[(i + 1) % 3], n = [(a[1] - b[1]) * Math.sign(area), (b[0] - a[0]) * Math.sign(area)], l = Math.hypot(...n) || 1;
    return [n[0] / l, n[1] / l, -(n[0] * a[0] + n[1] * a[1]) / l];
  });
  const span = (c, most) => [Math.max(Math.floor(Math.min(...q.map((p) => p[c])) - 1), 0), Math.min(Math.ceil(Math.max(...q.map((p) => p[c])) + 1), most - 1)];
  const [x0, x1] = span(0, picture.width), [y0, y1] = span(1, picture.height);
  for (let y = y0; y <= y1; y++) for (let x = x0; x <= x1; x++) {
    const beyond = ([a, b, c]) => a * (x + 0.5) + b * (y + 0.5) + c < -0.5;
    if (beyond(sides[0]) || beyond(sides[1]) || beyond(sides[2])) continue;
    const k = 4 * (y * picture.width + x);
    for (let c = 0; c < 3; c++) picture.data[k + c] = colour[c];
    picture.data[k + 3] = 255;
  }
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
  const picture = new ImageData(1000, tall);
  for (let f = 0; f < faceCount; f++) {
    const q = [0, 1, 2].map((c) => [scale * (atlas[6 * f + 2 * c] - low[0]), scale * (high[1] - atlas[6 * f + 2 * c + 1])]);
    fillTriangle(picture, q, colourOf(layer, values[f]));
  }
  $("chart").getContext("2d").putImageData(picture, 0, 0);
  $("albedo-figure").hidden = !albedoImage;
  if (albedoImage) albedoImage.decode().then(() => {
    $("chart-albedo").getContext("2d").drawImage(albedoImage, -scale * low[0], -scale * (1 - high[1]), scale, scale);
  }).catch(() => {});
}
