#!/usr/bin/env python3
"""Turn a point-track set with 3D truth (ToTem-NRSfM, Apache-2.0) into files that dsfms reads.

    python3 scripts/convert_totem.py DATA_DIR OUT

DATA_DIR: the repository's Data/ with data_NAME.mat and intrinsics_NAME.txt. Written for every set
found: OUT/NAME/camera.json, rest.ply (first view, Delaunay in the image, long boundary edges
trimmed, normals towards the camera), truth/view_NN.ply (same faces) and matches/view_NN.csv (every
track, at a vertex of the template). Needs numpy and scipy.
"""
import json
import sys
from pathlib import Path

import numpy as np
import scipy.io
from scipy.spatial import Delaunay

# Boundary triangles with an edge longer than this many median edges are trimmed.
TRIM = 3.5


def load(folder, name):
    data = scipy.io.loadmat(folder / f"data_{name}.mat", struct_as_record=False, squeeze_me=True)
    truth = np.array([view.P.T for view in data["Pgth"]], float)
    pixels = np.array([view.p[:2].T for view in data["p"]], float)
    if not np.all(data["v"]):
        sys.exit(f"{name}: some tracks are not visible in every view; such sets are not supported")
    text = (folder / f"intrinsics_{name}.txt").read_text().replace(",", " ")
    return truth, pixels, np.array(text.split(), float).reshape(3, 3)


def pixel_origin(truth, pixels, k):
    """1 where pixels count from 1 (MATLAB) and K from 0, else 0: seen as a constant offset."""
    seen = truth @ k.T
    offset = np.median(pixels - seen[..., :2] / seen[..., 2:], axis=(0, 1))
    return 1.0 if np.all(np.abs(offset - 1) < 0.25) else 0.0


def triangulate(points, pixels):
    # Delaunay is counter-clockwise with y up; with y down that order gives N.z < 0 when swapped.
    faces = Delaunay(pixels).simplices
    a, b, c = (pixels[faces[:, k]] for k in range(3))
    (x1, y1), (x2, y2) = (b - a).T, (c - a).T
    swap = x1 * y2 - x2 * y1 > 0
    faces[swap] = faces[swap][:, [0, 2, 1]]
    while True:
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
        length = np.linalg.norm(points[edges[..., 0]] - points[edges[..., 1]], axis=2)
        _, which, uses = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True, return_counts=True)
        boundary = uses[which].reshape(-1, 3) == 1
        bad = (boundary & (length > TRIM * np.median(length))).any(axis=1)
        used = np.bincount(faces.ravel(), minlength=len(points))
        bad &= (used[faces] > 1).all(axis=1)  # never the last face of a point
        if not bad.any():
            return faces
        worst = np.argmax(np.where(bad, length.max(axis=1), 0))
        faces = np.delete(faces, worst, axis=0)


def write_ply(path, points, faces):
    head = ["ply", "format ascii 1.0", "comment unit mm", f"element vertex {len(points)}"]
    head += [f"property double {axis}" for axis in "xyz"]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    rows = [" ".join(repr(float(v)) for v in p) for p in points]
    rows += [" ".join(str(v) for v in (3, *f)) for f in faces]
    path.write_text("\n".join(head + rows) + "\n")


def write_matches(path, pixels, faces):
    rows = ["face,b1,b2,b3,x,y"]
    for v, (x, y) in enumerate(pixels):
        face, corner = np.argwhere(faces == v)[0]
        b = ["0"] * 3
        b[corner] = "1"
        rows.append(",".join([str(face), *b, f"{x:.4f}", f"{y:.4f}"]))
    path.write_text("\n".join(rows) + "\n")


def convert(folder, name, out):
    truth, pixels, k = load(folder, name)
    origin = pixel_origin(truth, pixels, k)
    pixels = pixels - origin
    # Only the first of coincident tracks is kept.
    _, first = np.unique(truth[0].round(6), axis=0, return_index=True)
    keep = np.sort(first)
    truth, pixels = truth[:, keep], pixels[:, keep]
    faces = triangulate(truth[0], pixels[0])
    for part in ("truth", "matches"):
        (out / name / part).mkdir(parents=True, exist_ok=True)
    size = [int(round(2 * c)) for c in k[:2, 2]]
    camera = {"width": size[0], "height": size[1], "fx": k[0, 0], "fy": k[1, 1], "cx": k[0, 2], "cy": k[1, 2]}
    (out / name / "camera.json").write_text(json.dumps(camera, indent=1) + "\n")
    write_ply(out / name / "rest.ply", truth[0], faces)
    for view in range(1, len(truth)):
        write_ply(out / name / "truth" / f"view_{view + 1:02}.ply", truth[view], faces)
        write_matches(out / name / "matches" / f"view_{view + 1:02}.csv", pixels[view], faces)
    print(f"{name}: {len(truth)} views, {len(keep)} points, {len(faces)} faces, pixels counted from {origin:.0f}")


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    folder, out = map(Path, sys.argv[1:])
    names = sorted(p.stem.removeprefix("data_") for p in folder.glob("data_*.mat"))
    if not names:
        sys.exit(f"no data_NAME.mat in {folder}")
    for name in names:
        convert(folder, name, out)


main()
