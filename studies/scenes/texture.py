"""UV atlas and albedo of an organ: mottling, vessels and capillaries painted in 3-D, so that charts have no seams."""

import numpy as np
import trimesh
import xatlas
from scipy import ndimage
from scipy.spatial import cKDTree

from noise import noise, octaves

# sRGB-encoded colours: ground, vessel, dark and pale patches.
HUES = dict(
    pink=((0.78, 0.46, 0.40), (0.52, 0.15, 0.17), (0.62, 0.29, 0.27), (0.90, 0.69, 0.58)),
    liver=((0.60, 0.30, 0.24), (0.36, 0.11, 0.12), (0.46, 0.19, 0.17), (0.76, 0.47, 0.36)),
    purple=((0.58, 0.31, 0.36), (0.36, 0.10, 0.18), (0.44, 0.19, 0.26), (0.72, 0.47, 0.48)),
    green=((0.62, 0.58, 0.42), (0.58, 0.26, 0.20), (0.42, 0.43, 0.30), (0.82, 0.74, 0.52)),
)


def atlas(v, f, size):
    """Chart vertices `index` (into v), wedge faces (m, 3) and uv (k, 2), v up."""
    made = xatlas.Atlas()
    made.add_mesh(v.astype(np.float32), f.astype(np.uint32))
    chart, pack = xatlas.ChartOptions(), xatlas.PackOptions()
    chart.max_iterations = 1
    pack.resolution, pack.padding, pack.bilinear, pack.bruteForce = size, 4, True, False
    made.generate(chart, pack)
    index, wedge, uv = made[0]
    if not (index[wedge] == f).all():
        raise SystemExit("the atlas changed the order of the faces")
    return index.astype(np.int32), wedge.astype(np.int32), uv.astype(float)


def texels(v, f, wedge, uv, size):
    """Mask (size, size) of the texels that charts cover, and their rest positions (k, 3) in mm."""
    px = np.stack([uv[:, 0] * size - 0.5, (1 - uv[:, 1]) * size - 0.5], -1)
    where = np.zeros((size, size, 3), np.float32)
    ok = np.zeros((size, size), bool)
    for i, w in enumerate(wedge):
        a, b, c = px[w]
        x0, y0 = np.maximum(np.floor(np.minimum(np.minimum(a, b), c)).astype(int) - 1, 0)
        x1, y1 = np.minimum(np.ceil(np.maximum(np.maximum(a, b), c)).astype(int) + 1, size - 1)
        det = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
        if abs(det) < 1e-9:
            continue
        x, y = np.arange(x0, x1 + 1)[None, :], np.arange(y0, y1 + 1)[:, None]
        w1 = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / det
        w2 = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / det
        m = (w1 > -0.02) & (w2 > -0.02) & (w1 + w2 < 1.02)
        p, q, r = v[f[i]]
        at = p + w1[..., None] * (q - p) + w2[..., None] * (r - p)
        where[y0 : y1 + 1, x0 : x1 + 1][m] = at[m]
        ok[y0 : y1 + 1, x0 : x1 + 1] |= m
    return ok, where[ok].astype(float)


def vessels(mesh, rng, large=30, small=350):
    """Points (k, 3), radii (k,) in mm and opacities of random curves walked over the surface, all at once."""
    points, face = trimesh.sample.sample_surface(mesh, 60000, seed=int(rng.integers(1 << 30)))
    normals, tree = mesh.face_normals[face], cKDTree(points)
    top = np.where(normals[:, 2] > -0.4)[0]
    start = rng.choice(top, large + small)
    x, d = points[start].copy(), rng.standard_normal((large + small, 3))
    big = np.arange(large + small) < large
    length = np.where(big, rng.uniform(22, 54, len(x)), rng.uniform(4, 13, len(x)))
    radius = np.where(big, np.exp(rng.uniform(np.log(0.14), np.log(0.6), len(x))), rng.uniform(0.07, 0.14, len(x)))
    opacity = np.where(big, 1.0, 0.7)
    walked, turn, step, out = np.zeros(len(x)), np.zeros(len(x)), 0.14, []
    while len(x):
        k = tree.query(x)[1]
        n = normals[k]
        x = x - n * ((x - points[k]) * n).sum(1)[:, None]
        d = d - n * (d * n).sum(1)[:, None]
        d /= np.linalg.norm(d, axis=1)[:, None] + 1e-12
        turn = 0.968 * turn + 0.027 * rng.standard_normal(len(x))
        d = d * np.cos(turn * step)[:, None] + np.cross(n, d) * np.sin(turn * step)[:, None]
        out.append(np.c_[x, radius * (1 - 0.6 * walked / length), opacity])
        x, walked = x + step * d, walked + step
        fork = np.where((radius > 0.14) & (rng.random(len(x)) < 0.017))[0]
        angle = rng.choice([-1, 1], len(fork)) * rng.uniform(0.5, 1.1, len(fork))
        turned = d[fork] * np.cos(angle)[:, None] + np.cross(n[fork], d[fork]) * np.sin(angle)[:, None]
        left = (length - walked)[fork] * rng.uniform(0.4, 0.8, len(fork))
        x, d, turn = np.r_[x, x[fork]], np.r_[d, turned], np.r_[turn, 0 * left]
        walked, length = np.r_[walked, 0 * left], np.r_[length, left]
        radius, opacity = np.r_[radius, radius[fork] * rng.uniform(0.45, 0.7, len(fork))], np.r_[opacity, opacity[fork]]
        go = walked < length
        x, d, turn, walked, length, radius, opacity = (a[go] for a in (x, d, turn, walked, length, radius, opacity))
    out = np.vstack(out)
    return out[:, :3], out[:, 3], out[:, 4]


def albedo(q, mesh, hue, contrast, rng):
    """sRGB-encoded albedo (k, 3) at rest positions q (k, 3)."""
    base, vessel, dark, pale = (np.array(c) for c in HUES[hue])
    seed = int(rng.integers(1 << 30))
    blend = lambda col, to, a: col + np.clip(a, 0, 1)[:, None] * (to - col)
    col = blend(np.tile(base, (len(q), 1)), dark, 0.42 * octaves(q, (7.0, 3.2, 1.5), (0.6, 0.5, 0.35), seed))
    col = blend(col, pale, 0.38 * octaves(q, (5.0, 2.2), (0.6, 0.5), seed + 10))
    col = col * (1 + 0.045 * np.clip(octaves(q, (0.8, 0.45), (0.6, 0.5), seed + 20), -2.5, 2.5))[:, None]
    at, radius, opacity = vessels(mesh, rng)
    dist, k = cKDTree(at).query(q, k=4, distance_upper_bound=2.0)
    k = np.minimum(k, len(at) - 1)
    rel = dist / radius[k]
    col = blend(col, dark, 0.13 * (np.exp(-(np.minimum(rel, 9) ** 2) / 8) * opacity[k]).max(1))
    col = blend(col, vessel, 0.72 * (opacity[k] * np.clip(1.35 - rel, 0, 0.7) / 0.7).max(1))
    mean = col.mean(0)
    return np.clip(mean + contrast * (col - mean), 0.03, 0.97)


def film(q, seed):
    """Slope vectors (k, 3) of the liquid film at q: what tilts the normal that the highlights see."""
    return np.stack([octaves(q, (2.6, 1.1), (0.8, 0.35), seed + 10 * a) for a in range(3)], -1)


def fill(ok, values):
    """Image (size, size, c) with texels outside the charts taken from the nearest one inside."""
    image = np.zeros(ok.shape + values.shape[1:], np.float32)
    image[ok] = values
    near = ndimage.distance_transform_edt(~ok, return_distances=False, return_indices=True)
    return image[tuple(near)]


def wall(spec, low, rng, half=110.0, cells=200, size=800):
    """The cavity the organ lies in: V, F, uv and albedo (size, size, 3); `low` is the organ's lowest z, mm."""
    seed = int(rng.integers(1 << 30))
    axis = np.linspace(-half, half, cells)
    x, y = np.meshgrid(axis, axis)
    p = np.stack([x, y, 0 * x], -1)
    r, turn = np.hypot(x, y), rng.uniform(0, 2 * np.pi)
    across = (x + 7 * noise(p, 30.0, seed)) * np.cos(turn) + (y + 7 * noise(p, 30.0, seed + 1)) * np.sin(turn)
    ridge = np.sin(across * np.pi / rng.uniform(19, 26)) ** 2
    z = low + rng.uniform(1.0, 3.5) + rng.uniform(0.004, 0.008) * np.maximum(r - 12, 0) ** 1.95
    z = z + 6.5 * ridge * np.clip((r - 20) / 25, 0, 1) + 2.0 * noise(p, 16.0, seed + 2) + 0.6 * noise(p, 6.0, seed + 3)
    v = np.stack([x, y, z], -1).reshape(-1, 3)
    i = np.arange(cells * cells).reshape(cells, cells)
    a, b, c, d = i[:-1, :-1].ravel(), i[:-1, 1:].ravel(), i[1:, 1:].ravel(), i[1:, :-1].ravel()
    f = np.vstack([np.c_[a, b, c], np.c_[a, c, d]])
    uv = np.stack([(x + half) / (2 * half), 1 - (y + half) / (2 * half)], -1).reshape(-1, 2)
    t = (np.arange(size) + 0.5) / size * 2 * half - half
    q = np.stack([*np.meshgrid(t, t), np.zeros((size, size))], -1)
    pink, fat, dark = (np.array(k) for k in ((0.72, 0.40, 0.36), (0.80, 0.64, 0.38), (0.50, 0.18, 0.17)))
    col = np.tile(pink, (size, size, 1))
    blend = lambda col, to, a: col + np.clip(a, 0, 0.9)[..., None] * (to - col)
    col = blend(col, fat, rng.uniform(0.4, 1.4) * noise(q, 19.0, seed + 4) - 0.35)
    col = blend(col, dark, 0.8 * octaves(q, (8.0, 3.0), (0.5, 0.4), seed + 5))
    line = np.abs(octaves(q, (9.0, 3.5), (1.0, 0.25), seed + 8))
    col = blend(col, dark, 0.5 * np.clip(1 - line / 0.055, 0, 1))
    col = col * (1 + 0.05 * np.clip(noise(q, 1.1, seed + 12), -2, 2))[..., None]
    mean, keep = col.mean((0, 1)), max(spec.texture, 0.4)
    return v, f, uv, np.clip(mean + keep * (col - mean), 0.03, 0.97), film(q, seed + 20)
