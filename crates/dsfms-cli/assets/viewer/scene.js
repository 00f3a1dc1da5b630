// --- The 3D scene ----------------------------------------------------------------------------
const canvas = $("gl");
/** Whether the processor draws: smooth edges would halve the frame rate there. */
function software() {
  const gl = document.createElement("canvas").getContext("webgl2"), name = gl && gl.getExtension("WEBGL_debug_renderer_info");
  return !!name && /swiftshader|llvmpipe|softpipe|software/i.test(gl.getParameter(name.UNMASKED_RENDERER_WEBGL));
}
let renderer;
try {
  // Opaque, so that nothing is blended where the page is put together: a third of the time of a software renderer.
  const context = canvas.getContext("webgl2", { alpha: false, antialias: !software() }) || undefined;
  renderer = new T.WebGLRenderer({ canvas, context });
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
  if (!source) return null; // none, or the frame is not here
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

const surfaceOf = (more) => material({ sliced: true, side: T.DoubleSide, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1, ...more });
const painted = surfaceOf({ lit: true, painted: true });
const photographed = surfaceOf({});
const bare = surfaceOf({ lit: true, map: albedoTexture || null });
const edgeInk = material({ colour: 0x101418, opacity: 0.35, sliced: true });
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

const geometryOf = (count) => {
  const geometry = new T.BufferGeometry();
  for (const [name, width] of [["position", 3], ["normal", 3], ["color", 3], ["uv", 2]])
    geometry.setAttribute(name, new T.BufferAttribute(new Float32Array(width * count), width));
  return geometry;
};
/** One method's objects. Faces share their vertices, or have corners of their own where a colour belongs to
 * a face or the albedo's charts meet: six times as many, which a software renderer feels. */
const columns = data.methods.map(() => {
  const group = new T.Group(), mesh = new T.Mesh(geometryOf(0), [painted, painted]);
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
