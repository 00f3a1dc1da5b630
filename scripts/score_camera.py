#!/usr/bin/env python3
"""How well `dsfms track` tells the camera of a clip of known truth by what lies around the organ.

    dsfms synth --video --organ uterus --seed 21 --frames 240 --frame-format jpeg -o clip
    dsfms template clip/exploration --camera clip/camera.json -o organ.template
    dsfms track organ.template clip/frames --camera clip/camera.json -o out
    python3 scripts/score_camera.py clip organ.template out

The template is of an unknown place and unit: a similarity lays the centres of its exploration cameras on the true ones. Prints in
how many frames the camera is told, and over these how far it is off, and how far the organ at rest is where it puts it (mean
over vertices), mm: median, 90 % and largest. Needs numpy and Python 3.11.
"""
import csv
import json
import sys
import tomllib
from pathlib import Path

import numpy as np


def quaternion(q):
    """Rotation of (x, y, z, w)."""
    x, y, z, w = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def similarity(a, b):
    """s, R, t with s R a + t nearest to b (Umeyama)."""
    (ma, mb), n = (a.mean(0), b.mean(0)), len(a)
    u, d, v = np.linalg.svd((b - mb).T @ (a - ma) / n)
    sign = np.diag([1, 1, np.sign(np.linalg.det(u @ v))])
    r = u @ sign @ v
    s = np.trace(np.diag(d) @ sign) / ((a - ma) ** 2).sum(1).mean()
    return s, r, mb - s * r @ ma


def poses(entries):
    """R and t by the stem of the image's name."""
    return {Path(p["image"]).stem: (np.array(p["R"]), np.array(p["t"])) for p in entries}


def rest(path):
    """Vertices of a PLY of doubles."""
    data = path.read_bytes()
    end = data.index(b"end_header") + 11
    count = int(data[:end].decode().split("element vertex ")[1].split()[0])
    return np.frombuffer(data, "<f8", 3 * count, end).reshape(-1, 3)


def centre(pose):
    return -pose[0].T @ pose[1]


def main(clip, template, out):
    truth = json.loads((clip / "truth/poses.json").read_text())
    explored, deformed = poses(truth["exploration"]), poses(truth["deformed"])
    views = tomllib.loads((template / "template.toml").read_text())["views"]
    own = {}
    for view in views:
        pose = view["camera_from_template"]
        own[Path(view["name"]).stem] = (quaternion(pose["rotation"]), np.array(pose["translation"]))
    names = sorted(own.keys() & explored.keys())
    s, r, t = similarity(*(np.array([centre(p[n]) for n in names]) for p in (own, explored)))
    organ = rest(clip / "rest.ply")
    found = poses(json.loads((out / "camera_poses.json").read_text()))
    away, off = [], []
    for name, (rotation, translation) in found.items():
        true = deformed[name]
        away.append(np.linalg.norm(s * r @ centre((rotation, translation)) + t - centre(true)))
        placed = s * ((organ - t) @ r / s @ rotation.T + translation)
        off.append(np.linalg.norm(placed - (organ @ true[0].T + true[1]), axis=1).mean())
    rows = list(csv.DictReader(open(out / "summary.csv")))
    stated = [s * float(row["camera_open"]) for row in rows if row["camera_open"]]
    print(f"camera told in {len(found)} of {len(rows)} frames")
    for what, values in (("camera off", away), ("organ at rest off", off), ("stated for the organ", stated)):
        print(f"{what}: {np.median(values):.3f}, {np.quantile(values, 0.9):.3f}, {max(values):.3f} mm")


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*map(Path, sys.argv[1:]))
