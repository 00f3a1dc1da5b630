"""Is an `ok` frame of a scene further off than it says? usage: stated.py SCENES WORK RUN [--half choose|held|drawn|all]

RUN names the folders that score.py left in WORK/SCENE, as `mesh-joint-*`. Error of a zone: root mean square over its vertices, mm,
nothing aligned; stated: root mean square of their expected errors; bound: `expected_error.bound` of frame_NNN.json times that
(`scripts/wrong_as_good.py` says why). The zone is that of measure.py: its visible part, or all
of it. Frame 0 is at rest and counts with all that is visible. Needs numpy and scipy."""

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from measure import finished, judged, read_ply

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
from wrong_as_good import places, read_table  # noqa: E402


def zones(scene, i):
    """Vertices that are judged, by name."""
    visible, zone = judged(scene, i)
    # At rest there is no zone. The visible vertex that moved most is always in it.
    return {"seen": zone & visible, "all": zone} if zone.any() else {"seen": visible, "all": visible}


def rows_of(scene, out):
    for told in sorted(out.glob("frame_*.json")):
        i = int(told.stem[-3:])
        report = json.loads(told.read_text())
        row = {"scene": scene.name, "frame": i, "status": report["status"], "reasons": report["reasons"]}
        row["evidence"] = report.get("evidence")
        surface = told.with_suffix(".ply")
        if report["status"] != "failed" and surface.exists():
            table = read_table(surface)[0]
            true = read_ply(scene / f"ground_truth/deformed_meshes_cam/frame_{i:03d}.ply")[0]
            error = np.linalg.norm(places(table) - true, axis=1)
            expected = table["expected_error"].astype(float)
            for name, zone in zones(scene, i).items():
                over = [float(np.sqrt((e[zone] ** 2).mean())) for e in (error, expected)]
                row[name] = {"error": over[0], "stated": over[1], "bound": report["expected_error"]["bound"] * over[1]}
        yield row


def scored_runs(doc):
    """Arguments that name the folders which score.py left of a run: SCENES WORK RUN [--half]."""
    ap = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("scenes", type=Path)
    ap.add_argument("work", type=Path)
    ap.add_argument("run")
    ap.add_argument("--half", default="all", choices=["choose", "held", "drawn", "all"])
    return ap


def main():
    ap = scored_runs(__doc__)
    ap.add_argument("--json", type=Path)
    a = ap.parse_args()
    rows = []
    for scene in finished(a.scenes, a.half):
        for out in sorted(a.work.glob(f"{scene.name}/{a.run}/out")):
            rows += rows_of(scene, out)
    if a.json:
        a.json.write_text(json.dumps(rows, indent=1))
    states = [sum(r["status"] == s for r in rows) for s in ("ok", "degraded", "failed")]
    print(f"{len(rows)} frames: {states[0]} ok, {states[1]} degraded, {states[2]} failed\n")
    print("| half | zone | ok frames | error, mm: median, largest | error over stated: median, 90 %, largest "
          "| above twice the stated | above three times | above the bound |\n" + "| --- " * 8 + "|")
    for half in ("choose", "held", "drawn"):
        for name in ("seen", "all"):
            of = [r for r in rows if r["status"] == "ok" and half in r["scene"] and name in r]
            if not of:
                continue
            error, stated, bound = (np.array([r[name][k] for r in of]) for k in ("error", "stated", "bound"))
            over = error / stated
            print(f"| {half} | {name} | {len(of)} | {np.median(error):.2f}, {error.max():.2f} | {np.median(over):.2f}, "
                  f"{np.quantile(over, 0.9):.2f}, {over.max():.2f} | {(over > 2).sum()} | {(over > 3).sum()} "
                  f"| {(error > bound).sum()} |")
    usual = np.median([r["seen"]["error"] for r in rows if r["status"] == "ok"])
    print(f"\nok, above the bound and three medians ({3 * usual:.2f} mm), visible part of the zone:\n")
    for r in rows:
        if r["status"] == "ok" and r["seen"]["error"] > max(3 * usual, r["seen"]["bound"]):
            print("- {scene} frame {frame}: ".format(**r) + "{error:.2f} mm, stated {stated:.2f}, bound {bound:.2f}".format(**r["seen"]))


if __name__ == "__main__":
    main()
