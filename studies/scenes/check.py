"""Check the files of scenes against each other. usage: check.py SCENE [SCENE ...]; exit code 1 where something is off.

Meshes against poses, correspondences against meshes and camera (written here anew from camera.json), depth and masks against
correspondences, number of sparse matches, rest in frame 0, change of volume of closed meshes."""

import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image
from scipy import ndimage

from measure import read_ply


def project(camera, p):
    """Pixels of camera-frame points by Brown-Conrady, as OpenCV has it."""
    d, x, y = camera["distortion"], p[:, 0] / p[:, 2], p[:, 1] / p[:, 2]
    r2 = x * x + y * y
    g = 1 + d["k1"] * r2 + d["k2"] * r2 * r2
    u = x * g + 2 * d["p1"] * x * y + d["p2"] * (r2 + 2 * x * x)
    v = y * g + d["p1"] * (r2 + 2 * y * y) + 2 * d["p2"] * x * y
    return np.stack([camera["fx"] * u + camera["cx"], camera["fy"] * v + camera["cy"]], -1)


def volume(v, f):
    """Signed volume under a closed surface."""
    return np.einsum("ij,ij->i", v[f[:, 0]], np.cross(v[f[:, 1]], v[f[:, 2]])).sum() / 6


def check(scene):
    """Worst deviations of a scene, and what is out of bounds."""
    truth, camera = scene / "ground_truth", json.loads((scene / "camera.json").read_text())
    rest, f = read_ply(truth / "rest_world.ply")
    edges = np.sort(np.vstack([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]]), 1)
    closed = (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    worst = dict(
        cam_mm=0.0,
        csv_px=0.0,
        depth_mm=0.0,
        off_mask=0.0,
        volume_pct=0.0,
        rest_mm=0.0,
        sparse_short=0,
        max_move_mm=0.0,
        tool=0.0,
    )
    for p in json.loads((truth / "poses.json").read_text())["deformed"]:
        i = p["frame"]
        v, g = read_ply(truth / f"deformed_meshes_cam/frame_{i:03d}.ply")
        w, _ = read_ply(truth / f"deformed_meshes_world/frame_{i:03d}.ply")
        assert (g == f).all()
        r = np.genfromtxt(truth / f"correspondences/frame_{i:03d}.csv", delimiter=",", names=True)
        at = (v[f[r["face"].astype(int)]] * np.stack([r["b1"], r["b2"], r["b3"]], -1)[:, :, None]).sum(1)
        px, seen = np.stack([r["x"], r["y"]], -1), r["visible"] > 0
        depth = np.load(truth / f"deformed_depth/frame_{i:03d}.npz")["depth"]
        mask = np.array(Image.open(scene / f"masks/deformed/organ_{i:03d}.png")) > 0
        k = np.clip(np.round(px[seen]).astype(int), 0, [camera["width"] - 1, camera["height"] - 1])
        z = ndimage.map_coordinates(depth, [px[seen, 1], px[seen, 0]], order=1, mode="nearest")
        rows = len((truth / f"correspondences/frame_{i:03d}_sparse25.csv").read_text().splitlines()) - 1
        now = dict(
            cam_mm=np.abs(w @ np.array(p["R"]).T + p["t"] - v).max(),
            csv_px=np.abs(project(camera, at) - px).max(),
            depth_mm=np.quantile(np.abs(z - at[seen, 2]), 0.9),
            off_mask=1 - mask[k[:, 1], k[:, 0]].mean(),
            sparse_short=25 - rows,
            volume_pct=100 * abs(volume(w, f) / volume(rest, f) - 1) if closed else 0.0,
            rest_mm=np.abs(w - rest).max() if i == 0 else 0.0,
            max_move_mm=p["max_displacement_mm"],
            tool=p["instrument_fraction"],
        )
        worst = {n: max(worst[n], float(now[n])) for n in worst}
    bounds = dict(
        cam_mm=1e-3,
        csv_px=0.01,
        depth_mm=0.15,
        off_mask=0.03,
        volume_pct=3.0,
        rest_mm=1e-5,
        sparse_short=0,
        max_move_mm=14.0,
        tool=0.25,
    )
    return len(rest), closed, worst, [n for n in worst if worst[n] > bounds[n]]


def main():
    bad = False
    for path in map(Path, sys.argv[1:]):
        vertices, closed, worst, off = check(path)
        bad |= bool(off)
        print(
            path.name,
            vertices,
            "closed" if closed else "open",
            " ".join(f"{n} {x:.3g}" for n, x in worst.items()),
            "OFF: " + ", ".join(off) if off else "ok",
            flush=True,
        )
    sys.exit(bad)


if __name__ == "__main__":
    main()
