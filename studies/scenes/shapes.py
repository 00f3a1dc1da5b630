"""Rest shapes: signed distance on a grid (mm, negative inside) and a uniform surface mesh of it.

World frame: millimetres, +z towards the laparoscope, the organ near the origin."""

import fast_simplification
import numpy as np
import trimesh
from scipy import ndimage
from skimage import measure

from noise import octaves

VOXEL = 0.9


class Sdf:
    """Signed distance `grid` (mm) whose node (0, 0, 0) lies at `low`."""

    def __init__(self, grid, low):
        self.grid, self.low = grid, np.asarray(low, float)
        self.gradient = np.stack(np.gradient(grid, VOXEL), -1)

    def __call__(self, points):
        where = np.moveaxis((points - self.low) / VOXEL, -1, 0)
        return ndimage.map_coordinates(self.grid, where, order=1, mode="nearest")


def smooth_min(a, b, k):
    """Polynomial smooth minimum: the union of two solids with a fillet of about `k` mm."""
    h = np.clip(0.5 + 0.5 * (b - a) / k, 0, 1)
    return b * (1 - h) + a * h - k * h * (1 - h)


def box(half):
    """Grid points (nx, ny, nz, 3) of a box of half extents `half` mm."""
    axes = [np.arange(-h, h + VOXEL, VOXEL) for h in half]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1), np.array([a[0] for a in axes])


def ellipsoid(q, centre, radii):
    """Approximate signed distance to an ellipsoid."""
    return (np.linalg.norm((q - centre) / radii, axis=-1) - 1) * min(radii)


def bumps(rng, sdf, g, count, half, radius):
    """Grow `count` round knobs out of the upper side of a solid."""
    for _ in range(count):
        c = rng.uniform(-0.75, 0.75, 3) * half
        c[2] = abs(c[2])
        c = c * 0.8
        sdf = smooth_min(sdf, np.linalg.norm(g - c, axis=-1) - rng.uniform(*radius), 6.0)
    return sdf


def pear(rng, size):
    """A body wide at one end with knobs, in the manner of a uterus."""
    s = size / 50
    g, low = box(np.array([48, 48, 34]) * s)
    q = g / s
    t = np.clip((q[..., 1] + 28) / 52, 0, 1)
    rx, rz = 10 + rng.uniform(13, 16) * t**1.4, 9 + rng.uniform(6, 9) * t
    body = np.sqrt((q[..., 0] / rx) ** 2 + (q[..., 2] / rz) ** 2 + (np.maximum(np.abs(q[..., 1]) - 16, 0) / 13) ** 2)
    sdf = (body - 1) * np.minimum(rx, rz) * 0.9 * s
    return bumps(rng, sdf, g, 4, np.array([16, 24, 12]) * s, (5 * s, 7 * s)), g, low


def bean(rng, size):
    """A bent ellipsoid, in the manner of a kidney or a spleen."""
    s = size / 60
    g, low = box(np.array([46, 46, 34]) * s)
    q = g / s
    bend = rng.uniform(0.008, 0.014)
    y = q[..., 1] - bend * q[..., 0] ** 2 + 5
    sdf = ellipsoid(np.stack([q[..., 0], y, q[..., 2]], -1), 0, (31, rng.uniform(15, 18), rng.uniform(13, 16))) * s
    return bumps(rng, sdf, g, 2, np.array([20, 10, 10]) * s, (5 * s, 7 * s)), g, low


def lobe(rng, size):
    """A flat wide body with a sharp rim, in the manner of a lobe of the liver."""
    s = size / 80
    g, low = box(np.array([56, 48, 30]) * s)
    q = g / s
    z = q[..., 2] + 0.004 * q[..., 0] ** 2 - 0.05 * q[..., 0]
    thick = rng.uniform(13, 16)
    sdf = ellipsoid(np.stack([q[..., 0], q[..., 1], z], -1), 0, (42, rng.uniform(28, 33), thick)) * s
    notch = np.linalg.norm(np.stack([q[..., 0] - 6, (q[..., 1] + 36) / 2, q[..., 2] / 3], -1), axis=-1) - 7
    return -smooth_min(-sdf, notch * s, 8.0), g, low


def sac(rng, size):
    """A long smooth body, in the manner of a gallbladder or a loop of bowel."""
    s = size / 65
    g, low = box(np.array([48, 36, 34]) * s)
    q = g / s
    y = q[..., 1] - rng.uniform(4, 7) * np.sin(q[..., 0] / 16)
    t = np.clip((q[..., 0] + 30) / 60, 0, 1)
    r = rng.uniform(8, 10) + 8 * t
    axis = np.sqrt(y**2 + q[..., 2] ** 2 + np.maximum(np.abs(q[..., 0]) - 19, 0) ** 2)
    return (axis - r) * 0.9 * s, g, low


def blob(rng, size):
    """A union of random balls."""
    s = size / 60
    g, low = box(np.array([46, 46, 36]) * s)
    sdf = ellipsoid(g / s, 0, (20, 18, 13)) * s
    for k in range(5):
        a = 2 * np.pi * (k + rng.uniform(-0.25, 0.25)) / 5
        c = np.array([np.cos(a) * 16, np.sin(a) * 14, rng.uniform(-2, 6)]) * s
        sdf = smooth_min(sdf, np.linalg.norm(g - c, axis=-1) - rng.uniform(8, 12) * s, 7.0)
    return sdf, g, low


def from_mesh(meshes, size):
    """Close and smooth the union of `meshes` (any unit): longest extent `size` mm along x, flat side down."""
    p = np.vstack([trimesh.sample.sample_surface(m, 60000, seed=1)[0] for m in meshes])
    p = (p - p.mean(0)) @ np.linalg.svd((p - p.mean(0))[::20], full_matrices=False)[2].T
    p = (p - p.min(0)) * (size / np.ptp(p[:, 0]))
    low = p.min(0) - 8 * VOXEL
    shape = np.ceil((p.max(0) + 8 * VOXEL - low) / VOXEL).astype(int)
    g = np.stack(np.meshgrid(*[low[i] + VOXEL * np.arange(n) for i, n in enumerate(shape)], indexing="ij"), -1)
    shell = np.zeros(shape, bool)
    shell[tuple(np.round((p - low) / VOXEL).astype(int).T)] = True
    gap = ndimage.distance_transform_edt(~shell) * VOXEL
    outside, _ = ndimage.label(gap > 2.0)
    solid = outside != outside[0, 0, 0]
    sdf = (ndimage.distance_transform_edt(~solid) - ndimage.distance_transform_edt(solid)) * VOXEL + 2.0
    return ndimage.gaussian_filter(sdf, 2.0), g, low


HRA = {
    "uterus": (
        "VH_F_Uterus.glb",
        ("body_of_uterus", "fundus", "cornua", "lower_uterine", "anterior_wall", "posterior_wall"),
    ),
    "gallbladder": ("VH_F_Gallbladder.glb", ("gallbladder",)),
    "kidney": ("VH_F_Kidney_L.glb", ("kidney_capsule", "hilum", "outer_cortex", "renal_column")),
    "spleen": ("VH_F_Spleen.glb", ("spleen",)),
    "bladder": ("VH_F_Urinary_Bladder.glb", ("fundus_of_urinary",)),
}
PROCEDURAL = dict(pear=pear, bean=bean, lobe=lobe, sac=sac, blob=blob)


def organ_sdf(spec, data, rng):
    """Signed distance of the organ of a spec; `data` is the folder with organs_hra and organs_ucl."""
    if spec.organ in PROCEDURAL:
        sdf, g, low = PROCEDURAL[spec.organ](rng, spec.size)
    elif spec.organ in HRA:
        name, parts = HRA[spec.organ]
        scene = trimesh.load(data / "organs_hra" / name)
        chosen = [m for m in scene.dump() if any(k in m.metadata["name"] for k in parts)]
        sdf, g, low = from_mesh(chosen, spec.size)
    else:  # liver-ucl
        sdf, g, low = from_mesh([trimesh.load(data / "organs_ucl/liver.ply")], spec.size)
    seed = int(rng.integers(1 << 30))
    sdf = sdf + 0.5 * octaves(g, (11.0, 5.0), (0.8, 0.25), seed)
    return Sdf(ndimage.gaussian_filter(sdf, 1.2).astype(np.float64), low)


def rotate_sdf(sdf, rng, tilt=15.0):
    """The same solid turned at random about z and tilted by up to `tilt` degrees, centred on its volume."""
    a, t, az = rng.uniform(0, 2 * np.pi), np.deg2rad(rng.uniform(0, tilt)), rng.uniform(0, 2 * np.pi)
    turn = trimesh.transformations.rotation_matrix(a, [0, 0, 1])[:3, :3]
    turn = trimesh.transformations.rotation_matrix(t, [np.cos(az), np.sin(az), 0])[:3, :3] @ turn
    inside = np.argwhere(sdf.grid < 0) * VOXEL + sdf.low
    centre = inside.mean(0)
    half = np.abs((inside - centre) @ turn.T).max(0) + 6
    g, low = box(half)
    where = np.moveaxis((g @ turn + centre - sdf.low) / VOXEL, -1, 0)
    return Sdf(ndimage.map_coordinates(sdf.grid, where, order=1, mode="nearest"), low)


def relax(sdf, v, f, rounds=8):
    """Even out the triangles: every vertex half way to the mean of its neighbours, then back onto the surface."""
    edges = np.vstack([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]])
    edges = np.vstack([edges, edges[:, ::-1]])
    count = np.bincount(edges[:, 0], minlength=len(v))[:, None]
    for _ in range(rounds):
        mean = np.stack([np.bincount(edges[:, 0], v[edges[:, 1], a], len(v)) for a in range(3)], -1) / count
        v = onto(sdf, 0.5 * (v + mean), 1)
    return onto(sdf, v)


def surface(sdf, vertices):
    """Closed mesh of about `vertices` vertices: V (n, 3) mm, F (m, 3), outward; and whether it is to be subdivided once."""
    v, f, _, _ = measure.marching_cubes(sdf.grid, 0.0, spacing=(VOXEL,) * 3)
    mesh = max(trimesh.Trimesh(v + sdf.low, f).split(only_watertight=False), key=lambda m: len(m.faces))
    fine = vertices > 14000
    wanted = 2 * (vertices // 4 if fine else vertices)
    v, f = np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces, np.int32)
    for aggressive in (3, 7):
        if len(f) > 1.05 * wanted:
            v, f = fast_simplification.simplify(v, f, target_count=wanted, agg=aggressive)
    mesh = trimesh.Trimesh(relax(sdf, v.astype(float), f), f, process=False)
    mesh.fix_normals()
    if not mesh.is_watertight:
        raise SystemExit("the simplified organ is not closed")
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int32), fine


def onto(sdf, v, rounds=3):
    """Move points (n, 3) onto the zero level of the distance along its gradient."""
    for _ in range(rounds):
        where = (v - sdf.low).T / VOXEL
        g = np.stack([ndimage.map_coordinates(sdf.gradient[..., a], where, order=1) for a in range(3)], -1)
        v = v - (sdf(v) / np.maximum((g**2).sum(1), 0.2))[:, None] * g
    return v


def cut_open(v, f, level):
    """Faces whose centre lies above z = `level` mm: an open mesh; unused vertices are dropped."""
    f = f[v[f].mean(1)[:, 2] > level]
    part = max(trimesh.Trimesh(v, f, process=False).split(only_watertight=False), key=lambda m: len(m.faces))
    return np.asarray(part.vertices, float), np.asarray(part.faces, np.int32)
