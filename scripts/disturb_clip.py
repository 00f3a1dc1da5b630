#!/usr/bin/env python3
"""Blur, smoke and an organ that leaves the view in a clip of `dsfms synth --video` (240 frames or more).

    dsfms synth --video --organ uterus --seed 21 --frames 240 --frame-format jpeg -o clip
    python3 scripts/disturb_clip.py clip disturbed
    dsfms track disturbed/organ.template disturbed/frames --camera disturbed/camera.json --method joint -o out
    cargo run --release --example video_marks -- disturbed out      # out/marks.csv: error of every frame

Frames 40 to 59: out of focus, up to 4 px. 75 to 84: camera shake, 17 px sideways. 120 to 149: smoke that
drifts and takes up to 70 % of the light, grey. 165 to 204: the picture moves out to the right and back;
the truth of the clip does not follow that, so only its first and last frame can be measured.

A third argument makes one of these of the whole clip instead (the template stays that of the sharp, coloured clip):

    low      a third of the resolution, enlarged again, JPEG of quality 60
    grey     grey, with the tone of another camera (contrast 0.8, lifted blacks)
    ghosted  every frame mixed with the two before, as an interlaced recording that was converted
    tool     a grey rod over a third of the organ from frame 40 to 340, which presses: the picture around its tip
             is drawn towards it by up to 14 px (the truth of the clip does not follow that)
    hard     low, grey, ghosted and the tool together

Needs numpy and pillow.
"""
import shutil
import sys
from pathlib import Path

import numpy as np
from PIL import Image, ImageFilter

CASES = ("low", "grey", "ghosted", "tool", "hard")
TOOL = 40, 340  # frames of the rod
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


def low(image):
    small = image.resize((image.width // 3, image.height // 3), Image.Resampling.BOX)
    return small.resize(image.size, Image.Resampling.BICUBIC)


def grey(image):
    a = np.asarray(image.convert("L"), float)
    a = 24 + 0.8 * a
    return Image.fromarray(np.repeat(a[..., None], 3, 2).astype(np.uint8))


def ghosted(images):
    weights = [0.6, 0.25, 0.15][: len(images)]
    mixed = sum(w * linear(image) for w, image in zip(weights, images)) / sum(weights)
    return encoded(mixed)


def tip(i, w, h):
    return np.array([w * (0.52 + 0.04 * np.sin(0.05 * i)), h * (0.5 + 0.05 * np.sin(0.037 * i))])


def pull(i, away, w):
    """How far the picture is drawn towards the tip, px, at so many px from it."""
    press = min(1.0, (i - TOOL[0]) / 30, (TOOL[1] - 1 - i) / 30)
    far = away / (0.12 * w)
    return press * 14 * np.exp(-(far**2)) * np.minimum(far, 1)


def across_rod(at, w, h, half):
    """How far across a rod from `at` to the right edge each pixel lies, of its half width `half` (of the height); NaN
    beside it."""
    y, x = np.mgrid[0:h, 0:w].astype(float)
    along = np.array([w + 10.0, h * 0.62]) - at
    along /= np.linalg.norm(along)
    d = (x - at[0]) * along[0] + (y - at[1]) * along[1]
    across = ((x - at[0]) * -along[1] + (y - at[1]) * along[0]) / (half * h)
    return np.where((d > 0) & (np.abs(across) < 1), across, np.nan)


def draw_rod(a, across):
    """Grey, shaded across, onto the picture `a`."""
    on = ~np.isnan(across)
    a[on] = (70 + 110 * np.sqrt(np.clip(1 - across[on] ** 2, 0, 1)))[:, None]


def rod(i, w, h):
    """How far across the rod of frame `i` each pixel lies, of its half width; NaN beside it."""
    there = TOOL[0] <= i < TOOL[1]
    return across_rod(tip(i, w, h), w, h, 0.055) if there else np.full((h, w), np.nan)


def tool(image, i):
    """A rod from the right edge to the middle, and what it presses on drawn towards its tip."""
    if not TOOL[0] <= i < TOOL[1]:
        return image
    a = np.asarray(image, float)
    h, w = a.shape[:2]
    at = tip(i, w, h)
    y, x = np.mgrid[0:h, 0:w].astype(float)
    away = np.maximum(np.hypot(x - at[0], y - at[1]), 1e-6)
    by = pull(i, away, w)
    sx = np.clip(x + by * (x - at[0]) / away, 0, w - 1).round().astype(int)
    sy = np.clip(y + by * (y - at[1]) / away, 0, h - 1).round().astype(int)
    a = a[sy, sx]
    draw_rod(a, rod(i, w, h))
    return Image.fromarray(a.astype(np.uint8))


def case(name, images, i):
    """Frame `i` of a case; `images`: it and up to two before, the newest first."""
    if name == "hard":
        return low(grey(ghosted([tool(image, i - k) for k, image in enumerate(images)])))
    one = {"low": low, "grey": grey}
    if name in one:
        return one[name](images[0])
    return ghosted(images) if name == "ghosted" else tool(images[0], i)


def main():
    if len(sys.argv) not in (3, 4) or (len(sys.argv) == 4 and sys.argv[3] not in CASES):
        sys.exit(__doc__)
    clip, out = Path(sys.argv[1]), Path(sys.argv[2])
    name = sys.argv[3] if len(sys.argv) == 4 else None
    shutil.copytree(clip, out, ignore=shutil.ignore_patterns("frames", "exploration"))
    (out / "frames").mkdir()
    before = []
    for path in sorted((clip / "frames").iterdir()):
        i = int(path.stem.split("_")[-1])
        image = Image.open(path).convert("RGB")
        before = [image, *before[:2]]
        made = disturbed(image, i) if name is None else case(name, before, i)
        quality = 60 if name in ("low", "hard") else 92
        made.save(out / "frames" / path.name, quality=quality)


if __name__ == "__main__":
    main()
