"""Where `dsfms template` sees the organ without any mask, against the true masks of generated scenes.

    python parting.py SCENES OUT [--dsfms PROGRAM] [--click] [--also] [--crop SHARE] [scene ...]

Writes one template a scene to OUT and prints, over the frames of each, the intersection over union of
`organ_masks/` (of `organ_masks_a/` where it is open what is meant) with the scene's `masks/exploration`, wall time and
exit code. `--click` clicks on the organ's middle in the first frame, `--also` gives the deformed frames too, `--crop` keeps
that share of the width and height about the middle of every frame: one surface fills them then.
"""

import argparse
import json
import subprocess
import time
from pathlib import Path

import numpy as np
from PIL import Image


def mask(path: Path) -> np.ndarray:
    """A mask file as bool (h, w)."""
    return np.asarray(Image.open(path).convert("L")) > 127


def overlap(found: Path, truth: Path) -> list[float]:
    """Intersection over union of every frame; 0 where the frame was left out."""
    values = []
    for path in sorted(truth.iterdir()):
        number = path.stem.rsplit("_", 1)[-1]
        own = found / f"frame_{number}.png"
        true = mask(path)
        shown = mask(own) if own.exists() else np.zeros_like(true)
        values.append(float((shown & true).sum() / max((shown | true).sum(), 1)))
    return values


def middle(path: Path) -> str:
    """The pixel of the organ that lies farthest inside, roughly: the median of its rows and columns."""
    ys, xs = np.nonzero(mask(path))
    inside = np.argmin(np.hypot(xs - np.median(xs), ys - np.median(ys)))
    return f"{xs[inside]},{ys[inside]}"


def cropped(scene: Path, to: Path, share: float) -> Path:
    """The middle of the exploration frames of a scene, with masks and camera, as a scene of its own."""
    camera = json.loads((scene / "camera.json").read_text())
    size = np.array([camera["width"], camera["height"]])
    low = np.round(size * (1 - share) / 2).astype(int)
    high = size - low
    for folder in ("exploration", "masks/exploration"):
        (to / folder).mkdir(parents=True, exist_ok=True)
        for path in sorted((scene / folder).glob("*.png")):
            Image.open(path).crop((*low, *high)).save(to / folder / path.name)
    camera["width"], camera["height"] = (high - low).tolist()
    camera["cx"] -= float(low[0])
    camera["cy"] -= float(low[1])
    (to / "camera.json").write_text(json.dumps(camera))
    return to


def main() -> None:
    """One row a scene."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--dsfms", default="dsfms")
    parser.add_argument("--click", action="store_true")
    parser.add_argument("--also", action="store_true")
    parser.add_argument("--crop", type=float)
    args = parser.parse_intermixed_args()
    args.out.mkdir(parents=True, exist_ok=True)
    print(f"{'scene':<24}{'median':>8}{'worst':>8}{'s':>8}{'exit':>6}")
    for name in args.names or sorted(p.name for p in args.scenes.iterdir()):
        scene, result = args.scenes / name, args.out / f"{name}.template"
        if args.crop:
            scene = cropped(scene, args.out / f"{name}.cropped", args.crop)
        masks = scene / "masks" / "exploration"
        command = [args.dsfms, "template", scene / "exploration", "--camera", scene / "camera.json", "-o", result]
        if args.click:
            command += ["--organ-click", middle(min(masks.iterdir()))]
        if args.also:
            command += ["--also", args.scenes / name / "deformed"]
        begin = time.monotonic()
        code = subprocess.run([str(c) for c in command] + ["--quiet"], check=False).returncode
        seconds = time.monotonic() - begin
        found = result / "organ_masks"
        values = overlap(found if found.exists() else result / "organ_masks_a", masks)
        print(f"{name:<24}{np.median(values):8.3f}{min(values):8.3f}{seconds:8.0f}{code:6}", flush=True)


if __name__ == "__main__":
    main()
