"""Score `dsfms track` over the deformed frames of generated scenes, in their order. usage: video.py SCENES [--half choose|held|all] [--frames]

A hard video: 9 or 10 frames that are far apart, so that the surface jumps between them, and nothing is given but template and
camera. Per scene: frames ok, degraded and lost; over the ok frames after the first the mean error in mm in zone, visible and
hidden, and the largest visible error; frame 0's visible error; median seconds of a followed frame. Templates are those of
score.py. Needs numpy and scipy."""

import argparse
import csv
import shutil
from pathlib import Path

import numpy as np

from measure import frame_errors
from score import chosen, digest, run, template

STATES = ("ok", "degraded", "lost")
HEAD = f"{'scene':26} ok/deg/lost   zone   vis   hid | worst vis | rest vis | followed s"


def track(a, scene):
    """Folder of the tracked frames; cached by binary and options."""
    made = template(a, scene, "mesh")
    out = a.work / scene.name / f"video-{a.method}-{digest(a.binary, a.options or '')}"
    if not (out / "vertices.npz").exists():
        shutil.rmtree(out, ignore_errors=True)
        frames = sorted((scene / "deformed").glob("frame_*"))
        command = [a.binary, "track", made, *frames, "--camera", scene / "camera.json", "--method", a.method]
        command += ["--options", a.options] if a.options else []
        command += ["--no-report", "-q", "--threads", a.threads, "-o", out]
        run(command, out.with_suffix(".log"))
    return out


def rows_of(out, scene):
    """Status, way, reasons, seconds and errors of every frame."""
    surfaces = np.load(out / "vertices.npz")["vertices"]
    found = []
    for i, row in enumerate(csv.DictReader((out / "summary.csv").open())):
        errors = frame_errors(scene, i, surfaces[i].astype(float)) if row["status"] != "lost" else {}
        keep = {k: row[k] for k in ("status", "way", "reasons")}
        found.append(dict(frame=i, seconds=float(row["ms"]) / 1000, **keep, **errors))
    return found


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("scenes", type=Path)
    ap.add_argument("--half", default="choose", choices=["choose", "held", "all"])
    ap.add_argument("--only", default="", help="scenes whose name contains one of these words, comma separated")
    ap.add_argument("--method", default="joint", choices=["dsfm", "joint"])
    ap.add_argument("--binary", type=Path, required=True)
    ap.add_argument("--options", type=Path, help="TOML for track --options")
    ap.add_argument("--template-key", default="a")
    ap.add_argument("--threads", default="2")
    ap.add_argument("--frames", action="store_true", help="a line for every frame")
    ap.add_argument("--work", type=Path, default=Path("/tmp/dsfms-score"))
    a = ap.parse_args()
    print(HEAD, flush=True)
    for scene in chosen(a):
        rows = rows_of(track(a, scene), scene)
        good = [r for r in rows[1:] if r["status"] == "ok"]
        mean = lambda k: np.mean([r[k] for r in good if r[k] is not None]) if good else np.nan
        counts = "/".join(str(sum(r["status"] == s for r in rows)) for s in STATES)
        worst = max((r["visible"] for r in good), default=np.nan)
        times = [r["seconds"] for r in rows if r["way"] == "followed"]
        cells = f"{mean('zone'):6.2f}{mean('visible'):6.2f}{mean('hidden'):6.2f} |{worst:10.2f} |"
        cells += f"{rows[0].get('visible', np.nan):9.2f} |{np.median(times) if times else np.nan:7.2f}"
        print(f"{scene.name:26}{counts:>12} {cells}", flush=True)
        for r in rows if a.frames else ():
            errors = "".join(f"{r[k]:7.2f}" if r.get(k) is not None else "      -" for k in ("zone", "visible", "hidden"))
            print(f"  {r['frame']:3} {r['status']:9}{r['way']:9}{errors}{r['seconds']:7.2f} s  {r['reasons']}")


if __name__ == "__main__":
    main()
