#!/usr/bin/env python3
"""Make the demo scene that is embedded in the binary from the full rendered scene (CC0 1.0).

    python3 scripts/make_demo_scene.py SCENE_DIR crates/dsfms-cli/data/demo

Frames become JPEG (quality 97, no chroma subsampling; the mean linear brightness of the organ
changes by less than 0.2 %, which is printed); masks, camera, meshes and sparse matches are kept
as they are; of the truth per vertex, visibility and displacement are kept, of the poses R and t.
Needs numpy and pillow.
"""
import json
import shutil
import sys
from pathlib import Path

import numpy as np
from PIL import Image

QUALITY = 97


def linear(path):
    a = np.asarray(Image.open(path).convert("RGB"), float) / 255.0
    return np.where(a <= 0.04045, a / 12.92, ((a + 0.055) / 1.055) ** 2.4).mean(2)


def frame(source, target, mask):
    Image.open(source).convert("RGB").save(target, "JPEG", quality=QUALITY, subsampling=0, optimize=True)
    organ = np.asarray(Image.open(mask).convert("L")) > 127
    return linear(target)[organ].mean() / linear(source)[organ].mean() - 1.0


def copy(source, target):
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, target)


def main(scene, out):
    for folder in ("exploration", "deformed", "exploration_masks", "deformed_masks", "instrument_masks", "matches", "truth"):
        (out / folder).mkdir(parents=True, exist_ok=True)
    truth = scene / "ground_truth"
    bias = []
    for phase in ("exploration", "deformed"):
        for source in sorted((scene / phase).glob("frame_*.png")):
            number = source.stem[-3:]
            mask = scene / "masks" / phase / f"organ_{number}.png"
            bias.append(frame(source, out / phase / f"{source.stem}.jpg", mask))
            copy(mask, out / f"{phase}_masks" / f"{source.stem}.png")
    for source in sorted((scene / "deformed").glob("instrument_mask_*.png")):
        copy(source, out / "instrument_masks" / f"frame_{source.stem[-3:]}.png")
    copy(scene / "camera.json", out / "camera.json")
    copy(truth / "rest_world.ply", out / "truth" / "rest_world.ply")
    for source in sorted((truth / "deformed_meshes_cam").glob("frame_*.ply")):
        copy(source, out / "truth" / source.name)
        full = np.load(source.with_name(f"{source.stem}_vertices.npz"))
        np.savez_compressed(
            out / "truth" / f"{source.stem}_vertices.npz",
            visible=full["visible"],
            displacement=full["displacement"].round(3).astype(np.float32),
        )
        copy(truth / "correspondences" / f"{source.stem}_sparse25.csv", out / "matches" / f"{source.stem}.csv")
    poses = json.loads((truth / "poses.json").read_text())
    kept = {"convention": poses["convention"], "K": poses["K"]}
    for phase in ("exploration", "deformed"):
        kept[phase] = [
            {"frame": p["frame"], "image": str(Path(p["image"]).with_suffix(".jpg")), "R": p["R"], "t": p["t"]}
            for p in poses[phase]
        ]
    (out / "truth" / "poses.json").write_text(json.dumps(kept))
    size = sum(p.stat().st_size for p in out.rglob("*") if p.is_file())
    print(f"{size / 1e6:.2f} MB; brightness changed by {np.mean(bias):+.2%} in the mean, {np.abs(bias).max():.2%} at most")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), Path(sys.argv[2]))
