#!/usr/bin/env python3
"""Make the pictures of docs/guide/images by the commands of its pages, on what `dsfms demo` wrote. Needs Pillow.

    dsfms demo -o DEMO
    scripts/guide_pictures.py target/release/dsfms DEMO
"""

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

IMAGES = Path(__file__).resolve().parent.parent / "docs/guide/images"


def shrunk(source, name, width=None, colours=None):
    """A picture of at most a width, as JPEG or as PNG of few colours."""
    picture = Image.open(source).convert("RGB")
    if width and picture.width > width:
        picture = picture.resize((width, round(picture.height * width / picture.width)), Image.LANCZOS)
    if colours:
        picture = picture.quantize(colours)
    picture.save(IMAGES / name, quality=82, optimize=True)


def main():
    dsfms, demo = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()
    run = lambda *arguments: subprocess.run([dsfms, *map(str, arguments), "--quiet"], cwd=demo, check=False)
    with tempfile.TemporaryDirectory() as work:
        work = Path(work)
        # Without masks, so that the organ is found.
        run("template", "scene/exploration", "--camera", "scene/camera.json", "--camera-step", "frame_002", "frame_011",
            "93.29mm", "-o", work / "own.template")
        shrunk(work / "own.template/pictures/organ.png", "organ.jpg", 900)
        run("export", work / "own.template", "--pictures", work / "pictures")
        shrunk(work / "pictures/albedo.png", "albedo.jpg", 600)
        run("reconstruct", work / "own.template", "scene/deformed", "--camera", "scene/camera.json", "--instrument-masks",
            "scene/instrument_masks", "-o", work / "out")
        shrunk(work / "out/frame_004_overlay.png", "overlay.jpg")
        run("figure", "dsfms", "joint", "--frame", 3, "--truth", "truth/frame_003.ply", "-o", work / "methods.png")
        shrunk(work / "methods.png", "methods.png", 1000, 96)
        run("figure", work / "out", "--frame", 4, "--turntable", 6, "-o", work / "turntable.png")
        shrunk(work / "turntable.png", "turntable.png", 1200, 128)
        run("synth", "--video", "--frames", 12, "--size", "320x180", "--vertices", 300, "--seed", 3, "-o", work / "clip")
        run("track", work / "clip/organ.template", work / "clip/frames", "--camera", work / "clip/camera.json", "--overlay",
            "-o", work / "tracked")
        shrunk(work / "tracked/overlay/frame_006.png", "tracked.png", colours=128)
        run("figure", work / "tracked/summary.csv", "--y", "residual_px", "--title", "residual, px", "-o", work / "chart.png")
        shrunk(work / "chart.png", "chart.png", 900, 32)


if __name__ == "__main__":
    main()
