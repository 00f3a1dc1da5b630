#!/usr/bin/env python3
"""Blur, smoke and an organ that leaves the view in a clip of `dsfms synth --video` (240 frames or more).

    dsfms synth --video --organ uterus --seed 21 --frames 240 --frame-format jpeg -o clip
    python3 scripts/disturb_clip.py clip disturbed
    dsfms track disturbed/organ.template disturbed/frames --camera disturbed/camera.json --method joint -o out
    cargo run --release --example video_marks -- disturbed out      # out/marks.csv: error of every frame

Frames 40 to 59: out of focus, up to 4 px. 75 to 84: camera shake, 17 px sideways. 120 to 149: smoke that
drifts and takes up to 70 % of the light, grey. 165 to 204: the picture moves out to the right and back;
the truth of the clip does not follow that, so only its first and last frame can be measured.
Needs numpy and pillow.
"""
import shutil
import sys
from pathlib import Path

import numpy as np
from PIL import Image, ImageFilter

SMOKE = np.array([0.35, 0.35, 0.37])  # linear light
RNG = np.random.default_rng(3)
WAVES = [(RNG.uniform(0.3, 1.5), RNG.uniform(0.3, 1.5), RNG.uniform(0, 6)) for _ in range(4)]


def linear(image):
    a = np.asarray(image, float) / 255.0
    return np.where(a <= 0.04045, a / 12.92, ((a + 0.055) / 1.055) ** 2.4)


def encoded(a):
    a = np.clip(a, 0, 1)
    a = np.where(a <= 0.0031308, a * 12.92, 1.055 * a ** (1 / 2.4) - 0.055)
    return Image.fromarray((a * 255 + 0.5).astype(np.uint8))


def bump(i, first, last):
    return np.sin(np.pi * (i - first) / (last - first))


def density(shape, i):
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]] / 200.0
    clouds = sum(np.sin(fx * x + fy * y + phase + 0.15 * i) for fx, fy, phase in WAVES) / 4
    return 0.7 * bump(i, 120, 149) * np.clip(0.5 + 0.6 * clouds, 0, 1)


def disturbed(image, i):
    if 40 <= i < 60:
        return image.filter(ImageFilter.GaussianBlur(float(4 * bump(i, 40, 59))))
    if 75 <= i < 85:
        return encoded(np.mean([np.roll(linear(image), s, 1) for s in range(-8, 9, 2)], 0))
    if 120 <= i < 150:
        light = linear(image)
        veil = density(light.shape, i)[..., None]
        return encoded(light * (1 - veil) + veil * SMOKE)
    if 165 <= i < 205:
        source, by = np.asarray(image), int(image.width * bump(i, 165, 204))
        moved = np.full_like(source, source[:20, :20].mean((0, 1)).astype(np.uint8))
        moved[:, by:] = source[:, : image.width - by]
        return Image.fromarray(moved)
    return image


def main():
    clip, out = Path(sys.argv[1]), Path(sys.argv[2])
    shutil.copytree(clip, out, ignore=shutil.ignore_patterns("frames", "exploration"))
    (out / "frames").mkdir()
    for path in sorted((clip / "frames").iterdir()):
        i = int(path.stem.split("_")[-1])
        disturbed(Image.open(path).convert("RGB"), i).save(out / "frames" / path.name, quality=92)


if __name__ == "__main__":
    main()
