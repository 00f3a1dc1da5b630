// --- The 3D scene ----------------------------------------------------------------------------
const canvas = $("gl");
/** Whether the processor draws: smooth edges would halve the frame rate there. */
function software() {
  const gl = document.createElement("canvas").getContext("webgl2"), name = gl && gl.getExtension("WEBGL_debug_renderer_info");
  return !!name && /swiftshader|llvmpipe|softpipe|software/i.test(gl.getParameter(name.UNMASKED_RENDERER_WEBGL));
}
let renderer;
try {
  renderer = new T.WebGLRenderer({ canvas, antialias: !software() });
} catch (error) {
  canvas.replaceWith("This browser has no WebGL; the 3D view is left out.");
}
const scene = new T.Scene();
const root = new T.Group();
root.rotation.x = Math.PI; // camera axes (y down, z forward) to the viewer's (y up, z backward)
scene.add(root);
const eye = new T.PerspectiveCamera(40, 1, 0.1, 1000);
scene.add(eye);

const texture = (image, mipmaps) => {
  const t = new T.Texture(image);
  t.generateMipmaps = mipmaps; t.minFilter = 1006; // LinearFilter
  image.decode().then(() => { t.needsUpdate = true; draw(); }).catch(() => {});
  return t;
};
const picture = (source) => Object.assign(new Image(), { src: source });
// Of many frames only those that were looked at last are held.
const photoTextures = new Map(), MOST_PHOTOS = 32;
const photoTexture = (f) => {
  const source = data.frames[f].image;
  if (!source) return null;
  const known = photoTextures.get(source) || texture(picture(source), false);
  photoTextures.delete(source);
  photoTextures.set(source, known);
  for (const [key, old] of photoTextures) {
    if (photoTextures.size <= MOST_PHOTOS) break;
    old.dispose(); photoTextures.delete(key);
  }
  return known;
};
const albedoImage = data.albedo && picture(data.albedo);
const albedoTexture = albedoImage && texture(albedoImage, false);

const surfaceOf = (more) => material({ side: T.DoubleSide, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1, ...more });
const painted = surfaceOf({ lit: true, painted: true });
const photographed = surfaceOf({});
const bare = surfaceOf({ lit: true, map: albedoTexture || null });
const edgeInk = material({ colour: 0x101418, opacity: 0.35 });
const ghostInk = material({ colour: 0x2b6cb0, opacity: 0.55 });
const truthInk = material({ colour: 0x1f8a55, opacity: 0.7 });
// Transparent, so that they are drawn after all other lines.
const pathInk = material({ colour: 0xe91e78, depthTest: false, transparent: true });
const pinInk = material({ colour: 0xe91e78, depthTest: false, transparent: true });
const BURIED = ["#f2a900", "#3f7fd0", "#6fbf73", "#c86fc9"];
const buried = BURIED.map((c) => material({ colour: c, lit: true, side: T.DoubleSide }));

const edgeList = (() => {
  const seen = new Map();
  for (let f = 0; f < faceCount; f++) corners(f).forEach((a, i, vs) => {
    const b = vs[(i + 1) % 3], key = Math.min(a, b) * data.vertices + Math.max(a, b);
    if (!seen.has(key)) seen.set(key, [Math.min(a, b), Math.max(a, b)]);
    seen.get(key).push(vs[(i + 2) % 3]); // the vertex opposite, one per face
  });
  return [...seen.values()];
})();
const lineIndex = new T.BufferAttribute(Uint32Array.from(edgeList.flatMap((e) => [e[0], e[1]])), 1);
const wire = (ink) => {
  const g = new T.BufferGeometry();
  g.setAttribute("position", new T.BufferAttribute(new Float32Array(3 * data.vertices), 3));
  g.setIndex(lineIndex);
  return new T.LineSegments(g, ink);
};
const setPoints = (object, p) => {
  object.geometry.attributes.position.array.set(p);
  object.geometry.attributes.position.needsUpdate = true;
  object.geometry.computeBoundingSphere();
};

/** One method's objects. Faces have corners of their own, so that a colour can belong to a face. */
const columns = data.methods.map(() => {
  const geometry = new T.BufferGeometry();
  for (const [name, width] of [["position", 3], ["normal", 3], ["color", 3], ["uv", 2]])
    geometry.setAttribute(name, new T.BufferAttribute(new Float32Array(3 * width * faceCount), width));
  const group = new T.Group(), mesh = new T.Mesh(geometry, [painted, painted]);
  const pins = ["A", "B"].map(() => new T.Mesh(new T.SphereGeometry(1, 16, 12), pinInk));
  const path = new T.LineSegments(new T.BufferGeometry(), pathInk);
  const column = { group, mesh, pins, path, edges: wire(edgeInk), ghost: wire(ghostInk), truth: wire(truthInk), buried: [] };
  column.buried = data.structures.map((_, i) => {
    const g = new T.BufferGeometry();
    g.setIndex(new T.BufferAttribute(structureFaces[i], 1));
    return new T.Mesh(g, buried[i % buried.length]);
  });
  pins.concat(path).forEach((o) => { o.renderOrder = 2; o.visible = false; });
  group.add(mesh, column.edges, column.ghost, column.truth, path, ...pins, ...column.buried);
  root.add(group);
  return column;
});

const linearOf = Float32Array.from({ length: 256 }, (_, v) => { const s = v / 255; return s <= 0.04045 ? s / 12.92 : ((s + 0.055) / 1.055) ** 2.4; });
/** Colour of every corner, 0 to 255; clay or grey where the layer has no values. */
function cornerColours(layer, f, k) {
  const out = new Uint8Array(9 * faceCount);
  const values = layer.values && layer.values(f, k);
  const hidden = layer.id === "image" ? HIDDEN : CLAY;
  for (let c = 0; c < 3 * faceCount; c++) {
    const v = layer.per === "face" ? Math.floor(c / 3) : faces[c];
    out.set(values ? colourOf(layer, values[v]) : hidden, 3 * c);
  }
  return out;
}

function paint(k) {
  const column = columns[k], s = surface(state.frame, k), layer = state.layer;
  column.group.visible = !!s;
  if (!s) return;
  const g = column.mesh.geometry, normals = vertexNormals(s.at);
  const position = g.attributes.position.array, normal = g.attributes.normal.array, uv = g.attributes.uv.array;
  faces.forEach((v, c) => {
    for (let i = 0; i < 3; i++) { position[3 * c + i] = s.at[3 * v + i]; normal[3 * c + i] = normals[3 * v + i]; }
  });
  cornerColours(layer, state.frame, k).forEach((v, i) => { g.attributes.color.array[i] = linearOf[v]; });
  const photo = layer.id === "image" && s.pixels && s.visible && photoTexture(state.frame);
  const size = data.frames[state.frame].size;
  if (photo) faces.forEach((v, c) => {
    uv[2 * c] = (s.pixels[2 * v] + 0.5) / size[0];
    uv[2 * c + 1] = 1 - (s.pixels[2 * v + 1] + 0.5) / size[1];
  });
  else if (atlas) uv.set(atlas);
  // The part that the image does not show comes last, in grey.
  const seen = photo ? [] : null, unseen = [];
  for (let f = 0; f < faceCount; f++)
    (photo && corners(f).every((v) => s.visible[v]) ? seen : unseen).push(3 * f, 3 * f + 1, 3 * f + 2);
  const order = (seen || []).concat(unseen);
  g.setIndex(new T.BufferAttribute(Uint32Array.from(order), 1));
  g.clearGroups();
  const first = seen ? seen.length : 0;
  if (first) g.addGroup(0, first, 0);
  g.addGroup(first, order.length - first, 1);
  column.photo = photo || null;
  column.mesh.material = [photographed, layer.id === "albedo" ? bare : painted];
  for (const a of Object.values(g.attributes)) a.needsUpdate = true;
  g.computeBoundingSphere();
  setPoints(column.edges, s.at);
  const truth = data.truth !== undefined && surface(state.frame, data.truth);
  if (truth) setPoints(column.truth, truth.at);
  if (s.pose) setPoints(column.ghost, posed(s.pose, rest));
  column.buried.forEach((mesh, i) => {
    mesh.visible = !!s.structures[i];
    if (!mesh.visible) return;
    mesh.geometry.setAttribute("position", new T.BufferAttribute(s.structures[i].at, 3));
    mesh.geometry.computeVertexNormals();
    mesh.geometry.computeBoundingSphere();
  });
}
const posed = (m, p) => Float32Array.from(p, (_, j) => {
  const v = 3 * Math.floor(j / 3), r = m[j % 3];
  return r[0] * p[v] + r[1] * p[v + 1] + r[2] * p[v + 2] + r[3];
});
