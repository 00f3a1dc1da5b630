"""Errors of one reconstructed frame against a scene's ground truth, in mm, camera axes of the frame."""

import numpy as np
from scipy.spatial import cKDTree

SIZES = {
    "char": "i1",
    "uchar": "u1",
    "int8": "i1",
    "uint8": "u1",
    "short": "<i2",
    "ushort": "<u2",
    "int": "<i4",
    "int32": "<i4",
    "uint": "<u4",
    "uint32": "<u4",
    "float": "<f4",
    "float32": "<f4",
    "double": "<f8",
    "float64": "<f8",
}


def read_ply(path):
    """Vertices (n, 3) and triangles (m, 3) of a little-endian binary PLY."""
    raw = path.read_bytes()
    end = raw.index(b"end_header\n") + 11
    elements = []
    for words in (w.split() for w in raw[:end].decode().splitlines()):
        if words[0] == "format" and words[1] != "binary_little_endian":
            raise SystemExit(f"{path}: not a little-endian binary PLY")
        if words[0] == "element":
            elements.append((words[1], int(words[2]), []))
        if words[0] == "property":
            kind = (
                [("n", SIZES[words[2]]), (words[4], SIZES[words[3]], 3)]
                if words[1] == "list"
                else [(words[2], SIZES[words[1]])]
            )
            elements[-1][2].extend(kind)
    found = {}
    for name, count, kind in elements:
        found[name] = np.frombuffer(raw, kind, count, end)
        end += found[name].nbytes
    v = found["vertex"]
    lists = [n for n in found["face"].dtype.names if n.startswith("vertex_ind")]
    return np.stack([v["x"], v["y"], v["z"]], -1).astype(float), found["face"][lists[0]].astype(int)


def finished(folder, half="all"):
    """Folders of the scenes that make.py finished, in order; `half` is a word of their names, or `all`."""
    return sorted(done.parent for done in folder.glob("*/DONE") if half == "all" or half in done.parent.name)


def nearest_on_triangle(p, a, b, c):
    """Closest points of triangles (a, b, c) to points p, all (n, 3)."""
    n = np.cross(b - a, c - a)
    n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-12)
    best = p - ((p - a) * n).sum(1, keepdims=True) * n
    inside = np.ones(len(p), bool)
    for s, t in ((a, b), (b, c), (c, a)):
        inside &= (np.cross(t - s, best - s) * n).sum(1) >= 0
    far = np.where(inside, ((p - best) ** 2).sum(1), np.inf)
    for s, t in ((a, b), (b, c), (c, a)):
        d = t - s
        q = s + np.clip(((p - s) * d).sum(1) / np.maximum((d**2).sum(1), 1e-12), 0, 1)[:, None] * d
        e = ((p - q) ** 2).sum(1)
        best = np.where((e < far)[:, None], q, best)
        far = np.minimum(far, e)
    return best


class Surface:
    """Closest points of a triangle mesh: candidates by samples spread over it, then exact."""

    def __init__(self, v, f, count=60000):
        self.v, self.f = v, f
        a, b, c = v[f[:, 0]], v[f[:, 1]], v[f[:, 2]]
        area, rng = np.linalg.norm(np.cross(b - a, c - a), axis=1), np.random.default_rng(0)
        self.face = rng.choice(len(f), count, p=area / area.sum())
        r, s = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
        self.tree = cKDTree(a[self.face] * (1 - r) + b[self.face] * (r * (1 - s)) + c[self.face] * (r * s))

    def closest(self, p, candidates=6):
        """Distance (n,) and closest point (n, 3)."""
        near = self.tree.query(p, candidates)[1]
        best, far = p.copy(), np.full(len(p), np.inf)
        for k in self.face[near].T:
            q = nearest_on_triangle(p, *(self.v[self.f[k, i]] for i in range(3)))
            e = np.linalg.norm(p - q, axis=1)
            best, far = np.where((e < far)[:, None], q, best), np.minimum(far, e)
        return far, best


def to_surface(true, visible, v, f):
    """Distance of true vertices from the surface (v, f) times the one scale about the camera centre that fits the visible ones."""
    found, scale = Surface(v, f), np.median(true[visible, 2]) / np.median(v[:, 2])
    seen = true[visible][:: max(1, visible.sum() // 3000)]
    for _ in range(40):
        d, q = found.closest(seen / scale)
        near = d <= np.quantile(d, 0.9)
        before, scale = scale, (q[near] * seen[near]).sum() / (q[near] ** 2).sum()
        if abs(scale / before - 1) < 1e-6:
            break
    return found.closest(true / scale)[0] * scale


def judged(scene, i):
    """Vertices that are seen, and the deformed zone: what moved by at least half of what the visible vertex that moved most did; nothing at rest."""
    info = np.load(scene / f"ground_truth/deformed_meshes_cam/frame_{i:03d}_vertices.npz")
    visible, moved = info["visible"], info["displacement"]
    largest = moved[visible].max()
    return visible, (moved >= 0.5 * largest) & (largest > 0.1)


def frame_errors(scene, i, v, rigid=None, faces=None):
    """Mean errors of vertices `v` in zone, visible and hidden (None where empty); with `rigid` vertices, the deviation from that pose too.

    `faces`: distances to the surface (v, faces) after one scale, for a template of other vertices; of the zone the visible part alone."""
    true, _ = read_ply(scene / f"ground_truth/deformed_meshes_cam/frame_{i:03d}.ply")
    visible, zone = judged(scene, i)
    if faces is not None:
        zone &= visible
    error = to_surface(true, visible, v, faces) if faces is not None else np.linalg.norm(v - true, axis=1)
    mean = lambda e, m: float(e[m].mean()) if m.any() else None
    out = dict(zone=mean(error, zone), visible=mean(error, visible), hidden=mean(error, ~visible))
    if rigid is not None:
        away = np.linalg.norm(v - rigid, axis=1)
        seen = visible if faces is None else np.ones(len(v), bool)
        out.update(rest_seen=mean(away, seen), rest_hidden=mean(away, ~seen))
    return out
