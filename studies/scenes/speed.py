"""How long one frame of a generated scene takes, stage by stage. usage: speed.py SCENES [--half choose|held|drawn|all] [--binary DSFMS]

Closed organs of 3,000 to 48,000 vertices, true rest mesh and poses, 25 given matches and instrument masks: the road `mesh` of score.py, whose
templates are used (--work, --template-key). Every frame is a command of its own with --threads threads, so nothing is left from one frame to
the next; ms of wall by the stages of frame_NNN.json, the median over the frames. Descriptors are matched beside the given matches (`matching`);
--given leaves that out. `frame`: from the decoded picture to the judged surface. `setup`: control mesh and volume, made once for a template,
and reading of template, picture and masks; the rest of the command. Run it with nothing else on the machine."""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from measure import finished, read_ply
from score import given, template

COLUMNS = {
    "matching": ["matching"],
    "pose": ["pose"],
    "eq. 3": ["register (eq. 3)"],
    "joint": ["outline", "joint", "matching again", "finer control mesh"],
}


def timed(a, scene, made, frame, out):
    """Milliseconds by column of one frame as a user reconstructs it."""
    words = [a.binary, "reconstruct", made, frame, "--camera", scene / "camera.json", *given(a, scene)]
    if a.given:
        options = out / "given.toml"
        options.write_text("find_beside_given = false\n")
        words += ["--options", options]
    words += ["--no-report", "-q", "--threads", a.threads, "-o", out / "out"]
    start = time.perf_counter()
    done = subprocess.run([str(w) for w in words], capture_output=True, text=True)
    wall = time.perf_counter() - start
    told = out / f"out/{frame.stem}.json"
    if not told.exists():
        sys.exit(f"{scene.name} {frame.name}: exit {done.returncode}\n{done.stderr}")
    report = json.loads(told.read_text())
    spent = lambda names: 1e3 * sum(s["seconds"] for s in report["stages"] if s["name"] in names)
    found = {column: spent(names) for column, names in COLUMNS.items()}
    found["frame"] = 1e3 * sum(s["seconds"] for s in report["stages"])
    return dict(found, setup=1e3 * wall - found["frame"])


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("scenes", type=Path, help="folder that make.py filled")
    ap.add_argument("--half", default="all", choices=["choose", "held", "drawn", "all"])
    ap.add_argument("--binary", type=Path, default=Path(__file__).resolve().parents[2] / "target/release/dsfms")
    ap.add_argument("--frames", default="3,5,7")
    ap.add_argument("--threads", default="2")
    ap.add_argument("--given", action="store_true", help="the given matches alone")
    ap.add_argument("--template-key", default="a")
    ap.add_argument("--work", type=Path, default=Path("/tmp/dsfms-score"), help="cache of templates, as of score.py")
    a = ap.parse_args()
    columns = [*COLUMNS, "frame", "setup"]
    print("| scene | vertices | " + " | ".join(columns) + " |\n" + "| --- " * (len(columns) + 2) + "|")
    for scene in finished(a.scenes, a.half):
        made = template(a, scene, "mesh")
        rows = []
        for number in map(int, a.frames.split(",")):
            frame = next((scene / "deformed").glob(f"frame_{number:03d}.*"))
            with tempfile.TemporaryDirectory() as out:
                rows.append(timed(a, scene, made, frame, Path(out)))
        vertices = len(read_ply(scene / "ground_truth/rest_world.ply")[0])
        cells = [f"{np.median([row.get(c, np.nan) for row in rows]):.0f}" for c in columns]
        print(f"| {scene.name} | {vertices} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
