#!/usr/bin/env python3
"""How well `dsfms track` holds on to the organ of a clip of known truth that scripts/disturb_clip.py disturbed.

    dsfms synth --video --organ uterus --seed 21 --frames 240 --frame-format jpeg -o clip
    python3 scripts/disturb_clip.py clip hard hard
    dsfms track hard/organ.template hard/frames --camera hard/camera.json --method joint -o out
    dsfms track clip/organ.template clip/frames --camera clip/camera.json --method joint -o plain
    python3 scripts/score_track.py clip clean=plain hard=out

Counts ok, degraded and lost frames while at least half of what is ever seen of the organ at once is in view: vertices
that the camera sees, not under an instrument nor under the rod of the cases `tool` and `hard`. Errors are means over
these vertices, mm, absolute. Where the rod presses the picture moves and the truth does not: vertices within a quarter
of the picture's width about its tip are left out of the errors. `dent`: where vertices are drawn by more than 3 px, how
far the mesh goes with them, from where the track of the undisturbed clip (`clean`) has it, of the pull: 1 is all; the
tenth, the median and the ninth tenth over the frames. Writes OUT/marks.csv. Needs numpy and pillow.
"""
import csv
import sys
from pathlib import Path

import numpy as np

import disturb_clip
from wrong_as_good import Clip

STATUS = ["ok", "degraded", "lost"]


def seen(clip, k, name):
    """Vertices in view, and those of them whose truth holds."""
    pixels, visible = clip.pixels(k), clip.visible[k].copy()
    if name not in ("tool", "hard") or not disturb_clip.TOOL[0] <= k < disturb_clip.TOOL[1]:
        return visible, visible
    w, h = clip.camera["width"], clip.camera["height"]
    x, y = np.clip(pixels.round().astype(int), 0, [w - 1, h - 1]).T
    visible &= np.isnan(disturb_clip.rod(k, w, h)[y, x])
    far = np.linalg.norm(pixels - disturb_clip.tip(k, w, h), axis=1)
    return visible, visible & (far > 0.25 * w)


def dents(clip, shapes, plain):
    """Part of the rod's pull that the mesh follows, in each frame in which it presses fully or nearly."""
    w, h = clip.camera["width"], clip.camera["height"]
    found = []
    for k in range(disturb_clip.TOOL[0] + 30, len(shapes["status"])):
        if max(shapes["status"][k], plain["status"][k]) > 1:
            continue
        start, end = (clip.project(s["vertices"][k].astype(float)) for s in (plain, shapes))
        towards = disturb_clip.tip(k, w, h) - start
        away = np.linalg.norm(towards, axis=1)
        pull = disturb_clip.pull(k, away, w)
        x, y = np.clip(start.round().astype(int), 0, [w - 1, h - 1]).T
        m = clip.visible[k] & np.isnan(disturb_clip.rod(k, w, h)[y, x]) & (pull > 3)
        if m.sum() >= 10:
            along = ((end - start) * towards / away[:, None]).sum(1)
            found.append((along[m] * pull[m]).sum() / (pull[m] ** 2).sum())
    return ", ".join(f"{d:.2f}" for d in np.quantile(found, [0.1, 0.5, 0.9]))


def score(clip, name, out, plain):
    shapes = np.load(Path(out) / "vertices.npz")
    most = max(v.sum() for v in clip.visible)
    rows = []
    for k, (shape, status) in enumerate(zip(shapes["vertices"], shapes["status"])):
        visible, held = seen(clip, k, name)
        error = np.linalg.norm(shape.astype(float) - clip.vertices[k], axis=1)
        told = status < 2 and held.any()
        rows.append([k, STATUS[int(status)], visible.sum() / most, error[held].mean() if told else np.nan])
    with open(Path(out) / "marks.csv", "w", newline="") as file:
        csv.writer(file).writerows([["frame", "status", "in_view", "error_mm"], *rows])
    half = [r for r in rows if r[2] >= 0.5]
    count = [sum(r[1] == s for r in half) for s in STATUS]
    ok = np.array([r[3] for r in half if r[1] == "ok"] or [np.nan])
    rest = np.array([r[3] for r in half if r[1] == "degraded"] or [np.nan])
    print(f"| {name} | {len(half)} | {count[0]} / {count[1]} / {count[2]} | {count[2] / len(half):.0%} | "
          f"{np.nanmedian(ok):.2f}, {np.nanmax(ok):.2f} | {np.nanmedian(rest):.2f}, {np.nanmax(rest):.2f} | "
          f"{dents(clip, shapes, plain) if plain and name in ('tool', 'hard') else ''} |")


def main():
    clip = Clip(sys.argv[1])
    print("| clip | frames, half in view | ok / degraded / lost | lost | error of the ok ones, mm: median, largest "
          "| of the degraded ones | dent |\n" + "| --- " * 7 + "|")
    outs = dict(word.split("=", 1) for word in sys.argv[2:])
    plain = np.load(Path(outs["clean"]) / "vertices.npz") if "clean" in outs else None
    for name, out in outs.items():
        score(clip, name, out, plain)


if __name__ == "__main__":
    main()
