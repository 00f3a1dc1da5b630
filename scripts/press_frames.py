#!/usr/bin/env python3
"""Frames of a real operation as another, worse recording shows them, with a rod that pulls at the tissue.

    ffmpeg -i endo.mp4 frames/%04d.png
    python3 scripts/press_frames.py make organ.template frames low
    python3 scripts/press_frames.py make organ.template frames pulled --pull 50
    dsfms track organ.template low/frames --camera low/camera.json -o out-low
    dsfms track organ.template pulled/frames --camera pulled/camera.json -o out-pulled
    python3 scripts/press_frames.py score low out-low pulled out-pulled

`make`: grey, with the tone of another camera, every frame mixed with the two before, a third of the size, JPEG of
quality 60; `camera.json` is the template's camera at that size. With `--pull` a grey rod comes in from the right, from
frame 30 on and to the tenth before the last, and draws the picture around its tip, in the middle of the frame, to the
lower left by up to so many px (of the frames as they were), with a shadow there.
`score`: no truth is known, so what is told is how far the mesh of the second track goes with the picture from where
that of the first has it: where it is drawn by more than half of the most, of the pull (1 is all), and how far off it
is, px of the small frames. Needs numpy and pillow.
"""
import argparse
import json
import tomllib
from pathlib import Path

import numpy as np
from PIL import Image

import disturb_clip

SMALLER = 3
RADIUS = 0.18  # of the pull, of the width
TOWARDS = np.array([-0.8, 0.6])


def share(i, count):
    """Of the whole pull, in frame `i` of `count`."""
    return max(0.0, min(1.0, (i - 30) / 30, (count - 11 - i) / 30))


def tip(i, size):
    w, h = size
    return np.array([w * (0.5 + 0.03 * np.sin(0.05 * i)), h * (0.5 + 0.04 * np.sin(0.037 * i))])


def drawn(at, i, count, size, pull):
    """How far the picture is drawn at places `at`, along TOWARDS, px."""
    away = np.linalg.norm(at - tip(i, size), axis=-1) / (RADIUS * size[0])
    return pull * share(i, count) * np.exp(-(away**2))


def pulled(image, i, count, pull):
    if pull == 0 or share(i, count) == 0:
        return image
    a = np.asarray(image, float)
    h, w = a.shape[:2]
    y, x = np.mgrid[0:h, 0:w].astype(float)
    by = drawn(np.stack([x, y], -1), i, count, (w, h), pull)
    sx = np.clip(x - by * TOWARDS[0], 0, w - 1).round().astype(int)
    sy = np.clip(y - by * TOWARDS[1], 0, h - 1).round().astype(int)
    a = a[sy, sx] * (1 - 0.25 * (by / pull) ** 4)[..., None]
    disturb_clip.draw_rod(a, disturb_clip.across_rod(tip(i, (w, h)), w, h, 0.04))
    return Image.fromarray(np.clip(a, 0, 255).astype(np.uint8))


def small_camera(template):
    camera = tomllib.loads((template / "template.toml").read_text())["camera"]
    w, h = (n // SMALLER for n in camera["size"])
    # Pixel centres are integers.
    cx, cy = ((c + 0.5) / SMALLER - 0.5 for c in camera["centre"])
    fx, fy = (f / SMALLER for f in camera["focal"])
    lens = camera["lens"]["brown_conrady"]
    k1, k2, k3 = lens["k"]
    p1, p2 = lens["p"]
    return dict(width=w, height=h, fx=fx, fy=fy, cx=cx, cy=cy, k1=k1, k2=k2, p1=p1, p2=p2, k3=k3)


def make(a):
    (a.out / "frames").mkdir(parents=True)
    (a.out / "camera.json").write_text(json.dumps(small_camera(a.template)))
    paths, before = sorted(a.frames.iterdir()), []
    (a.out / "pull.json").write_text(json.dumps(dict(pull=a.pull, count=len(paths))))
    for i, path in enumerate(paths):
        image = pulled(Image.open(path).convert("RGB"), i, len(paths), a.pull)
        before = [image, *before[:2]]
        image = disturb_clip.grey(disturb_clip.ghosted(before))
        image = image.resize([n // SMALLER for n in image.size], Image.Resampling.BOX)
        image.save(a.out / "frames" / f"frame_{i:03d}.jpg", quality=60)


def projected(track, camera):
    v = np.load(track / "vertices.npz")["vertices"]
    x, y = v[..., 0] / v[..., 2], v[..., 1] / v[..., 2]
    r2 = x * x + y * y
    by = 1 + camera["k1"] * r2 + camera["k2"] * r2**2 + camera["k3"] * r2**3
    return np.stack([camera["fx"] * x * by + camera["cx"], camera["fy"] * y * by + camera["cy"]], -1)


def score(a):
    camera = json.loads((a.pulled / "camera.json").read_text())
    said = json.loads((a.pulled / "pull.json").read_text())
    plain, found = projected(a.plain_track, camera), projected(a.pulled_track, camera)
    size, pull = (camera["width"], camera["height"]), said["pull"] / SMALLER
    followed, off = [], []
    for i, (was, now) in enumerate(zip(plain, found)):
        if np.isnan(was).any() or np.isnan(now).any() or share(i, said["count"]) < 1:
            continue
        there = was.copy()
        for _ in range(20):  # the pull is told where the picture comes to lie
            there = was + drawn(there, i, said["count"], size, pull)[:, None] * TOWARDS
        want = np.linalg.norm(there - was, axis=1)
        zone = want > 0.5 * want.max()
        followed.append(((now - was) @ TOWARDS)[zone].sum() / want[zone].sum())
        off.append(np.linalg.norm(now - there, axis=1)[zone].mean())
    tenths = lambda v: ", ".join(f"{x:.2f}" for x in np.percentile(v, [10, 50, 90]))
    print(f"{len(off)} frames under the whole pull of {pull:.1f} px; tenth, median, ninth tenth")
    print(f"of the pull: {tenths(followed)}; off, px: {tenths(off)}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    one = commands.add_parser("make")
    one.add_argument("template", type=Path)
    one.add_argument("frames", type=Path)
    one.add_argument("out", type=Path)
    one.add_argument("--pull", type=float, default=0.0, help="px of the frames as they are")
    one.set_defaults(run=make)
    one = commands.add_parser("score")
    for name in ("plain", "plain_track", "pulled", "pulled_track"):
        one.add_argument(name, type=Path)
    one.set_defaults(run=score)
    a = parser.parse_args()
    a.run(a)


if __name__ == "__main__":
    main()
