"""Where `dsfms template` sees the organ without any mask, against the true masks of generated scenes.

    python parting.py SCENES OUT [--dsfms PROGRAM] [--click] [scene ...]

Writes one template a scene to OUT and prints, over the frames of each, the intersection over union of
`organ_masks/` with the scene's `masks/exploration`, wall time and exit code. `--click` clicks on the organ's middle in
the first frame.
"""

import argparse
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


def main() -> None:
    """One row a scene."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--dsfms", default="dsfms")
    parser.add_argument("--click", action="store_true")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    print(f"{'scene':<24}{'median':>8}{'worst':>8}{'s':>8}{'exit':>6}")
    for name in args.names or sorted(p.name for p in args.scenes.iterdir()):
        scene, result = args.scenes / name, args.out / f"{name}.template"
        masks = scene / "masks" / "exploration"
        command = [args.dsfms, "template", scene / "exploration", "--camera", scene / "camera.json", "-o", result]
        if args.click:
            command += ["--organ-click", middle(min(masks.iterdir()))]
        begin = time.monotonic()
        code = subprocess.run([str(c) for c in command] + ["--quiet"], check=False).returncode
        seconds = time.monotonic() - begin
        values = overlap(result / "organ_masks", masks)
        print(f"{name:<24}{np.median(values):8.3f}{min(values):8.3f}{seconds:8.0f}{code:6}", flush=True)


if __name__ == "__main__":
    main()
