"""Path tracing of one frame: wet coat and diffuse base, light on the camera, two bounces between all surfaces.

Mitsuba 3 (LLVM, Embree) finds the hits; the shading is written out here so that the radiometry is exactly what camera.json says."""

import drjit as dr
import mitsuba as mi
import numpy as np
from scipy import ndimage

mi.set_variant("llvm_ad_rgb")

LIGHT = np.array([1.0, 0.97, 0.93])
RING = [(3.6 * np.cos(a), 3.6 * np.sin(a), 0.0) for a in np.deg2rad([-150, -90, -30])]
OFFSETS = dict(colocated=[(0.0, 0.0, 0.0)], offset=[(0.0, -3.0, 0.0)], ring=RING)
ETA = 1.42
TOOL_F0, TOOL_ALPHA, WALL_ALPHA = 0.30, 0.24, 0.16


def atleast(a, low):
    """max(a, low) without the instruction that some versions of LLVM cannot lower."""
    return dr.select(a > low, a, low)


def atmost(a, high):
    """min(a, high), likewise."""
    return dr.select(a < high, a, high)


def arccos(x):
    """Arc cosine of 0 <= x <= 1, radians (Abramowitz and Stegun 4.4.46, error 2e-8)."""
    series = (
        1.5707963050,
        -0.2145988016,
        0.0889789874,
        -0.0501743046,
        0.0308918810,
        -0.0170881256,
        0.0066700901,
        -0.0012624911,
    )
    total = 0
    for a in reversed(series):
        total = total * x + a
    return dr.sqrt(atleast(1 - x, 0)) * total


class Camera:
    """Pinhole with Brown-Conrady distortion (k1, k2, p1, p2); pixel centres at integers."""

    def __init__(self, width, height, f, c, dist):
        self.width, self.height, self.f, self.c, self.dist = width, height, f, c, dist

    def ideal(self, x, y):
        """Undistorted normalised coordinates of pixels; works on numpy and drjit arrays."""
        xn, yn = (x - self.c[0]) / self.f[0], (y - self.c[1]) / self.f[1]
        k1, k2, p1, p2 = self.dist
        if not any(self.dist):
            return xn, yn
        a, b = xn, yn
        for _ in range(12):
            r2 = a * a + b * b
            g = 1 + r2 * (k1 + r2 * k2)
            a, b = (xn - 2 * p1 * a * b - p2 * (r2 + 2 * a * a)) / g, (yn - p1 * (r2 + 2 * b * b) - 2 * p2 * a * b) / g
        return a, b

    def project(self, p, pose):
        """Pixels (n, 2) and depths (n,) of world points under pose (R, t)."""
        q = p @ pose[0].T + pose[1]
        x, y = q[:, 0] / q[:, 2], q[:, 1] / q[:, 2]
        k1, k2, p1, p2 = self.dist
        r2 = x * x + y * y
        g = 1 + r2 * (k1 + r2 * k2)
        x, y = x * g + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * g + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        return np.stack([self.f[0] * x + self.c[0], self.f[1] * y + self.c[1]], -1), q[:, 2]


def mesh(v, f, n=None, uv=None):
    """Mitsuba mesh; uv with v up."""
    m = mi.Mesh("m", len(v), len(f), has_vertex_normals=n is not None, has_vertex_texcoords=uv is not None)
    q = mi.traverse(m)
    q["vertex_positions"] = np.ascontiguousarray(v, np.float32).ravel()
    q["faces"] = np.ascontiguousarray(f, np.uint32).ravel()
    if n is not None:
        q["vertex_normals"] = np.ascontiguousarray(n, np.float32).ravel()
    if uv is not None:
        q["vertex_texcoords"] = np.ascontiguousarray(uv, np.float32).ravel()
    q.update()
    return m


def linear(srgb):
    """sRGB decoding (IEC 61966-2-1)."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def encode(x):
    """sRGB encoding."""
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.power(np.maximum(x, 1e-9), 1 / 2.4) - 0.055)


def texture(albedo8, film):
    """Bilinear texture of linear albedo (from 8-bit sRGB) and film slopes, six channels."""
    return mi.Texture2f(mi.TensorXf(np.concatenate([linear(albedo8 / 255.0), film], -1).astype(np.float32)))


def trace(scene, origin, directions):
    """Distance in units of `directions` (n, 3) to the first hit, inf where none, and the index of the face hit."""
    ray = mi.Ray3f(mi.Point3f(*map(float, origin)), mi.Vector3f(*np.ascontiguousarray(directions.T, np.float32)))
    hit = scene.ray_intersect_preliminary(ray)
    return np.array(hit.t), np.array(hit.prim_index)


class Stage:
    """Organ, wall and tools of one frame. `parts`: three tuples (V, F, N, uv) in world mm.

    `without`: effects that are left out, of "gloss" (what the coat mirrors) and "bounced" (light between surfaces)."""

    def __init__(self, parts, textures, alpha, film, without=()):
        v, f, n, uv, at, first = [], [], [], [], 0, [0]
        for pv, pf, pn, puv in parts:
            v, f, n, uv = v + [pv], f + [pf + at], n + [pn], uv + [puv]
            at += len(pv)
            first.append(first[-1] + len(pf))
        self.first = first
        self.scene = mi.load_dict(dict(type="scene", m=mesh(np.vstack(v), np.vstack(f), np.vstack(n), np.vstack(uv))))
        self.organ = mi.load_dict(dict(type="scene", m=mesh(*parts[0][:2])))
        self.textures, self.alpha, self.film, self.without = textures, alpha, film, without
        self.bounds = [dr.opaque(mi.UInt32, k) for k in first[1:3]]

    def surface(self, si):
        """Base albedo, roughness, normal reflectance and the normal of the film at hits."""
        organ, tool = si.prim_index < self.bounds[0], si.prim_index >= self.bounds[1]
        uv = mi.Point2f(si.uv.x, 1 - si.uv.y)
        a, b = (
            self.textures[0].eval(uv, si.is_valid() & organ),
            self.textures[1].eval(uv, si.is_valid() & ~organ & ~tool),
        )
        t = [dr.select(organ, p, q) for p, q in zip(a, b)]
        base = dr.select(tool, mi.Color3f(0.07), mi.Color3f(*t[:3]))
        f0 = ((ETA - 1) / (ETA + 1)) ** 2
        n = dr.select(dr.dot(si.sh_frame.n, si.to_world(si.wi)) < 0, -si.sh_frame.n, si.sh_frame.n)
        slope = mi.Vector3f(*t[3:]) * dr.select(tool, 0.0, self.film)
        wet = dr.normalize(n + slope - n * dr.dot(n, slope))
        alpha = dr.select(tool, TOOL_ALPHA, dr.select(organ, self.alpha, WALL_ALPHA))
        return base, alpha, dr.select(tool, mi.Float(TOOL_F0), mi.Float(f0)), n, wet

    def lit(self, si, lights, axis, active, coat):
        """Radiance towards si.wi from the lights; the diffuse base alone, or with the coat."""
        base, alpha, f0, n, wet = self.surface(si)
        fresnel = lambda c: f0 + (1 - f0) * (1 - c) ** 5
        view = si.to_world(si.wi)
        total = mi.Color3f(0.0)
        for light in lights:
            d = light - si.p
            dist = dr.norm(d)
            w = d / dist
            cos_i, cos_o = atleast(dr.dot(n, w), 0), atleast(dr.dot(n, view), 1e-3)
            angle = dr.rad2deg(arccos(-dr.dot(w, axis)))
            spot = atmost(atleast((52 - angle) / 42, 0), 1)
            seen = active & (cos_i > 0) & (spot > 0)
            seen &= ~self.scene.ray_test(si.spawn_ray_to(light), seen)
            through = (1 - fresnel(cos_i)) * ((1 - fresnel(cos_o)) if coat else (1 - f0)) / (1 - f0) ** 2
            radiance = base * (through / dr.pi)
            if coat and "gloss" not in self.without:
                h = dr.normalize(w + view)
                ch, a2 = atleast(dr.dot(wet, h), 0), alpha * alpha
                ggx = a2 / (dr.pi * dr.square(ch * ch * (a2 - 1) + 1))
                ni, no = atleast(dr.dot(wet, w), 1e-3), atleast(dr.dot(wet, view), 1e-3)
                g = lambda c: 2 * c / (c + dr.sqrt(a2 + (1 - a2) * c * c))
                radiance = radiance + ggx * g(ni) * g(no) * fresnel(atleast(dr.dot(h, w), 0)) / (4 * ni * no)
            total += dr.select(seen, radiance * (cos_i * spot / (dist * dist)), 0)
        return total / len(lights)

    def render(self, cam, pose, kind, seed, direct=4, bounced=4):
        """Linear image (H, W, 3) per unit of light intensity, mm^-2 folded to 1 at 60 mm."""
        w, h = cam.width, cam.height
        opaque = lambda v: dr.opaque(mi.Float, float(v))
        r, t = pose
        eye = -r.T @ t
        rot = [mi.Vector3f(*[opaque(x) for x in row]) for row in r]
        origin = mi.Point3f(*[opaque(x) for x in eye])
        lights = [mi.Point3f(*[opaque(x) for x in eye + r.T @ np.array(o)]) for o in OFFSETS[kind]]

        def rays(samples, salt, coarse):
            rng = mi.PCG32(size=w * h * samples // coarse**2, initstate=dr.opaque(mi.UInt64, seed * 8 + salt))
            i = dr.arange(mi.UInt32, w * h * samples // coarse**2)
            p, s = i // samples, i % samples
            x = (mi.Float(p % (w // coarse)) + (mi.Float(s % 2) + rng.next_float32()) * 0.5) * coarse - 0.5
            y = (mi.Float(p // (w // coarse)) + (mi.Float(s // 2 % 2) + rng.next_float32()) * 0.5) * coarse - 0.5
            xn, yn = cam.ideal(x, y)
            return mi.Ray3f(origin, dr.normalize(rot[0] * xn + rot[1] * yn + rot[2])), rng

        def means(values, samples, coarse):
            """Mean over the samples of every pixel, all in one kernel: arrays (h, w, channels)."""
            dr.eval(values)
            sums = [[dr.block_sum(c, samples) / samples for c in v] for v in values]
            return [np.stack([np.array(c) for c in v], -1).reshape(h // coarse, w // coarse, -1) for v in sums]

        ray, _ = rays(direct, 0, 1)
        si = self.scene.ray_intersect(ray)
        image, base, normal, depth = means(
            [self.lit(si, lights, rot[2], si.is_valid(), True), self.surface(si)[0], si.sh_frame.n, [si.t]], direct, 1
        )
        if "bounced" in self.without:
            return image * LIGHT * 3600
        fine = guide(normal, depth)
        ray, rng = rays(bounced, 1, 2)  # bounced light is smooth: half the resolution carries it
        si = self.scene.ray_intersect(ray)
        first = [si.sh_frame.n, [si.t]]
        gathered, weight = mi.Color3f(0.0), mi.Color3f(1.0)
        for _ in range(2):
            away = dr.select(dr.dot(si.sh_frame.n, si.to_world(si.wi)) < 0, -si.sh_frame.n, si.sh_frame.n)
            angle, lift = 2 * dr.pi * rng.next_float32(), rng.next_float32()
            sine, cosine = dr.sincos(angle)
            turn = mi.Vector3f(dr.sqrt(lift) * cosine, dr.sqrt(lift) * sine, dr.sqrt(1 - lift))
            si = self.scene.ray_intersect(si.spawn_ray(mi.Frame3f(away).to_world(turn)), si.is_valid())
            gathered += weight * atmost(self.lit(si, lights, rot[2], si.is_valid(), False), 4e-4)
            weight *= dr.select(si.is_valid(), self.surface(si)[0], 0)
        light, normal, depth = means([gathered, *first], bounced, 2)
        coarse = guide(normal, depth)
        image = image + base * enlarge(smooth(light, coarse), coarse, fine)
        return image * LIGHT * 3600

    def depths(self, cam, pose):
        """z of the first hit and of the organ alone (0 = none) at pixel centres, organ mask and tool mask."""
        x, y = np.meshgrid(np.arange(cam.width, dtype=float), np.arange(cam.height, dtype=float))
        xn, yn = cam.ideal(x, y)
        d = np.stack([xn, yn, np.ones_like(xn)], -1).reshape(-1, 3) @ pose[0]
        eye = -pose[0].T @ pose[1]
        z, face = trace(self.scene, eye, d)
        zo, _ = trace(self.organ, eye, d)
        hit = np.isfinite(z)
        shape = lambda a: a.reshape(cam.height, cam.width)
        clean = lambda a: shape(np.where(np.isfinite(a), np.round(a * 64) / 64, 0).astype(np.float32))
        return clean(z), clean(zo), shape(hit & (face < self.first[1])), shape(hit & (face >= self.first[2]))

    def visible(self, p, n, pose, slack=0.15):
        """Which world points with normals n face the camera and are first hits within `slack` mm."""
        eye = -pose[0].T @ pose[1]
        d = p - eye
        length = np.linalg.norm(d, axis=1)
        t, _ = trace(self.scene, eye, d)
        return ((-d / length[:, None] * n).sum(1) > 0.05) & ((1 - t) * length < slack)


def guide(normal, depth):
    """Unit normals, depth and its slope per pixel (H, W, 5): what filters of the bounced light stop at."""
    normal = normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-6)
    depth = depth[..., 0]
    if not np.isfinite(depth).all():  # a ray can slip between two triangles
        depth = np.where(np.isfinite(depth), depth, ndimage.median_filter(depth, 5))
        depth = np.where(np.isfinite(depth), depth, 500.0)
    slope = np.hypot(*[ndimage.sobel(depth, a) / 8 for a in (0, 1)])
    return np.concatenate([normal, depth[..., None], slope[..., None]], -1).astype(np.float32)


def likeness(a, b, reach):
    """Weight in 0 to 1 of pixels with guides a and b, `reach` pixels apart, lying on the same smooth piece."""
    step = np.abs(a[..., 3] - b[..., 3]) / (0.3 + 2.0 * b[..., 4] * reach)
    return np.clip((a[..., :3] * b[..., :3]).sum(-1), 0, 1) ** 16 * np.exp(-np.minimum(step, 20))


def smooth(light, own, levels=4):
    """A-trous filter of the bounced light (no albedo in it) within smooth pieces: takes the grain off."""
    h, w = own.shape[:2]
    light = light.astype(np.float32)
    for level in range(levels):
        k = 1 << level
        padded, others = (np.pad(a, ((k, k), (k, k), (0, 0)), mode="edge") for a in (light, own))
        total, weights = light.copy(), np.ones((h, w), np.float32)
        for dy in (-k, 0, k):
            for dx in (-k, 0, k):
                if dx or dy:
                    part = np.s_[k + dy : k + dy + h, k + dx : k + dx + w]
                    wt = likeness(others[part], own, k) * (0.25 if dx and dy else 0.5)
                    total += wt[..., None] * padded[part]
                    weights += wt
        light = total / weights[..., None]
    return light


def enlarge(light, coarse, fine):
    """Twice the resolution: every pixel from the four coarse ones around it that lie on its piece."""
    h, w = fine.shape[:2]
    total, weights = np.zeros((h, w, 3), np.float32), np.full((h, w), 1e-6, np.float32)
    y, x = np.arange(h), np.arange(w)
    for dy in (0, 1):
        for dx in (0, 1):
            yi, xi = np.clip((y - 1) // 2 + dy, 0, h // 2 - 1), np.clip((x - 1) // 2 + dx, 0, w // 2 - 1)
            share = np.where((y % 2 == 0) == (dy == 1), 0.75, 0.25)[:, None] * np.where(
                (x % 2 == 0) == (dx == 1), 0.75, 0.25
            )
            part = np.ix_(yi, xi)
            wt = share * (likeness(coarse[part], fine, 1) + 1e-4)
            total += wt[..., None] * light[part]
            weights += wt
    return total / weights[..., None]
