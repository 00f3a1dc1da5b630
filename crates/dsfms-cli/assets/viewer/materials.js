// --- Materials -------------------------------------------------------------------------------
// One small program draws everything: a software renderer takes seconds to compile the general ones.
const VERTEX = `precision highp float;
uniform mat4 modelMatrix, modelViewMatrix, projectionMatrix;
uniform mat3 normalMatrix;
uniform float dot_size;
uniform vec4 cut;
in vec3 position, normal, color;
in vec2 uv;
out vec3 facing, paint;
out vec2 place;
out float beyond;
void main() {
  // Matrix by vector twice: by matrix first would be four times the work for every vertex.
  beyond = dot(cut.xyz, (modelMatrix * vec4(position, 1.0)).xyz) - cut.w;
  facing = normalMatrix * normal; paint = color; place = uv;
  gl_Position = projectionMatrix * (modelViewMatrix * vec4(position, 1.0));
  gl_PointSize = dot_size;
}`;
// Light from a little above and left of the eye, so that relief shows; colours are mixed in linear light.
const FRAGMENT = `precision highp float;
uniform vec3 tint;
uniform float opacity, lit, painted, pictured;
uniform sampler2D map;
in vec3 facing, paint;
in vec2 place;
in float beyond;
out vec4 ink;
vec3 linear(vec3 s) { return mix(s / 12.92, pow((s + 0.055) / 1.055, vec3(2.4)), step(0.04045, s)); }
vec3 shown(vec3 l) { return mix(12.92 * l, 1.055 * pow(l, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, l)); }
void main() {
  if (beyond > 0.0) discard;
  vec3 base = painted > 0.5 ? paint : tint;
  if (pictured > 0.5) base = linear(texture(map, place).rgb);
  if (lit > 0.5) {
    vec3 n = normalize(gl_FrontFacing ? facing : -facing);
    base *= 0.54 + 0.54 * max(dot(n, normalize(vec3(-0.35, 0.5, 1.0))), 0.0);
  }
  ink = vec4(shown(min(base, 1.0)), opacity);
}`;
/** What every cut surface shares: points with cut.xyz * x > cut.w are left out. */
const cut = { value: [0, 0, 0, 1] }, uncut = { value: [0, 0, 0, 1] };
/** A material: `colour`, or `painted` by the corners, or `map`; `lit` or flat; `opacity`; the rest is
 * three.js's own. */
function material({ colour = 0xffffff, opacity = 1, lit = false, painted = false, map = null, sliced = false, dot = 2, ...more }) {
  const tint = new T.Color(colour), value = (v) => ({ value: v });
  return new T.RawShaderMaterial({
    vertexShader: VERTEX, fragmentShader: FRAGMENT, glslVersion: "300 es", transparent: opacity < 1, ...more,
    uniforms: { tint: value(tint), opacity: value(opacity), lit: value(+lit), painted: value(+painted), pictured: value(+!!map), map: value(map), cut: sliced ? cut : uncut, dot_size: value(dot) },
  });
}
