#!/usr/bin/env python3
"""Compare the flattenings of `dsfms template --flatten ...` with libigl's LSCM.

    pip install libigl scipy numpy
    for m in bff lscm spectral; do
        dsfms template --mesh organ.ply --flatten $m -o $m.template
        dsfms export $m.template --mesh $m.obj
    done
    python3 scripts/peer_flattening.py bff.obj lscm.obj spectral.obj

Each OBJ holds a surface with its UV; where UV are torn the surface was cut, and libigl gets that
same cut disc. Its LSCM is pinned at two far vertices of the boundary; "spectral" is the least
eigenvector of its energy matrix against the boundary (scipy).
"""

import sys

import igl
import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import eigsh


def read(path):
    """Vertices and faces of the surface as it is cut, and their UV."""
    v, vt, f, ft = [], [], [], []
    for line in open(path):
        word, *rest = line.split() or [""]
        if word == "v":
            v.append([float(x) for x in rest[:3]])
        elif word == "vt":
            vt.append([float(x) for x in rest[:2]])
        elif word == "f":
            f.append([int(x.split("/")[0]) - 1 for x in rest])
            ft.append([int(x.split("/")[1]) - 1 for x in rest])
    v, vt, f, ft = map(np.array, (v, vt, f, ft))
    keys = np.column_stack([f.ravel(), np.round(vt[ft.ravel()] * 1e6).astype(int)])
    _, first, faces = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return v[f.ravel()[first]], faces.reshape(-1, 3), vt[ft.ravel()[first]]


def distortion(v, f, uv):
    p, q = v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]]
    x = np.linalg.norm(p, axis=1)
    along = (p * q).sum(1) / x
    height = np.linalg.norm(np.cross(p, q), axis=1) / x
    a, b = uv[f[:, 1]] - uv[f[:, 0]], uv[f[:, 2]] - uv[f[:, 0]]
    c0 = a / x[:, None]
    c1 = b / height[:, None] - a * (along / (x * height))[:, None]
    plus = np.hypot(c0[:, 0] + c1[:, 1], c0[:, 1] - c1[:, 0])
    minus = np.hypot(c0[:, 0] - c1[:, 1], c0[:, 1] + c1[:, 0])
    ratio = (plus + minus) / np.abs(plus - minus)
    signed = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    areas = 0.5 * x * height
    log = np.log(np.abs(signed) / areas)
    log -= (log * areas).sum() / areas.sum()
    spread = np.exp(np.quantile(log, 0.99) - np.quantile(log, 0.01))
    return (f"qc median {np.median(ratio):.4f} p95 {np.quantile(ratio, .95):.4f} max {ratio.max():.3f}"
            f" | area p99/p1 {spread:.3f} | area rms {np.sqrt((log**2 * areas).sum() / areas.sum()):.4f}"
            f" | flipped {(signed <= 0).sum()}")


def orient(v, f, uv):
    a, b = uv[f[:, 1]] - uv[f[:, 0]], uv[f[:, 2]] - uv[f[:, 0]]
    return uv if (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum() > 0 else uv * [1, -1]


def main():
    for path in sys.argv[1:]:
        v, f, uv = read(path)
        rim = igl.boundary_loop(f)
        print(f"{path}: {len(v)} vertices, {len(f)} faces, boundary {len(rim)}")
        print(f"  dsfms           {distortion(v, f, uv)}")
        far = lambda k: rim[np.argmax(np.linalg.norm(v[rim] - v[k], axis=1))]
        a = far(rim[0])
        b = far(a)
        ends = np.array([[0.0, 0.0], [np.linalg.norm(v[a] - v[b]), 0.0]])
        flat, energy = igl.lscm(v, f, np.array([a, b]), ends)
        print(f"  libigl lscm     {distortion(v, f, orient(v, f, flat))}")
        n = len(v)
        on = np.zeros(n)
        on[rim] = 1.0
        b = sparse.diags(np.concatenate([on, on]) + 1e-12)
        _, u = eigsh(energy.tocsc() + 1e-9 * sparse.identity(2 * n), k=6, M=b, sigma=-1e-6)
        # The two translations come first, then a pair that differs by a quarter turn.
        best = min((np.column_stack([u[:n, k], u[n:, k]]) for k in range(6)),
                   key=lambda m: 1e9 if m[rim].std(0).min() < 1e-3 * np.abs(m).max() else 0)
        print(f"  libigl spectral {distortion(v, f, orient(v, f, best))}")


if __name__ == "__main__":
    main()
