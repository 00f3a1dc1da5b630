#!/usr/bin/env python3
"""How many frames live tracking needs to find an organ again after the picture was black.

    python3 scripts/recovery.py organ.template frames --dsfms target/release/dsfms other/dsfms --first 0:20 --then 60:85

Two stretches of the frames in turn, six times, each followed by 15 black frames, go through `dsfms track --realtime
--rate 25`. For every return of the picture: the frame that has a surface again, counted from 1; those at the end of the
clip that never do are `-`. Those found at once were followed across the gap. The first figure is the start of the video.
What it does not know goes to `dsfms track`, `--no-report` for one. Needs pillow.
"""
import argparse
import csv
import subprocess
import tempfile
from pathlib import Path

from PIL import Image

BLACK = 15
ROUNDS = 6


def stretch(text):
    first, end = (int(n) for n in text.split(":"))
    return slice(first, end)


def make(frames, stretches, folder):
    """Links to the frames and to a black one; returns the ranges in which the picture is there."""
    kind = frames[0].suffix
    black = folder / f"black{kind}"
    Image.new("RGB", Image.open(frames[0]).size).save(black)
    clip, seen = [], []
    for _ in range(ROUNDS):
        for part in stretches:
            seen.append(range(len(clip), len(clip) + len(frames[part])))
            clip += frames[part] + [black] * BLACK
    (folder / "frames").mkdir()
    for i, frame in enumerate(clip):
        (folder / "frames" / f"frame_{i:04}{kind}").symlink_to(frame.resolve())
    return seen


def found_after(summary, seen):
    with open(summary) as file:
        there = {int(r["frame"]) for r in csv.DictReader(file) if r["status"] in ("ok", "degraded")}
    first = [next((k - part[0] + 1 for k in part if k in there), None) for part in seen]
    return " ".join("-" if n is None else str(n) for n in first)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("template")
    parser.add_argument("frames", type=Path)
    parser.add_argument("--dsfms", nargs="+", default=["dsfms"])
    parser.add_argument("--camera", help="of the frames, where it is not the template's")
    parser.add_argument("--first", type=stretch, default="0:20", metavar="A:B")
    parser.add_argument("--then", type=stretch, default="60:85", metavar="A:B")
    args, more = parser.parse_known_args()
    frames = sorted(p for p in args.frames.iterdir() if p.suffix.lower() in (".png", ".jpg", ".jpeg"))
    with tempfile.TemporaryDirectory() as folder:
        seen = make(frames, [args.first, args.then], Path(folder))
        for run, program in enumerate(args.dsfms):
            out = Path(folder) / f"out{run}"
            command = [program, "track", args.template, f"{folder}/frames", "--realtime", "--rate", "25", "-q"]
            command += ["--camera", args.camera] if args.camera else []
            subprocess.run([*command, *more, "-o", out], check=False)
            print(f"{program}: {found_after(out / 'summary.csv', seen)}", flush=True)


if __name__ == "__main__":
    main()
