"""How much of a pull or a push is followed, and is what is wrong along the sightline? usage: depth.py SCENES WORK RUN [--half choose|held|drawn|all]

RUN names the folders that score.py left in WORK/SCENE, as `mesh-joint-*` (of several the newest); the rigid pose is that of the newest
`mesh-rigid-*`, or of the road of RUN. Of every deformed frame, over the visible part of the zone of measure.py: the movement along the sightline from the rigid pose,
true and found, the slope of the latter on the former (1: followed whole), and the error along and across the sightline (root mean squares, mm).
A pull comes nearer to the camera by more than 2 mm in the mean, a push goes farther. Needs numpy."""

import numpy as np

from measure import finished, judged, read_ply
from stated import places, read_table, scored_runs

LARGE = 2.0  # mm: smaller movements say little about the share that is followed


def newest(folder, pattern, frame):
    """The surface of a frame in the newest of the folders, or None."""
    runs = sorted(folder.glob(f"{pattern}/out"), key=lambda p: p.stat().st_mtime, reverse=True)
    found = next((r / f"frame_{frame:03d}.ply" for r in runs if (r / f"frame_{frame:03d}.ply").exists()), None)
    return found and places(read_table(found)[0])


def row(scene, work, run, i):
    """Mean true and found movement along the sightline, slope, error along and across it; None where one is missing."""
    visible, zone = judged(scene, i)
    zone = zone & visible
    shape, rigid = (newest(work / scene.name, p, i) for p in (run, f"{run.split('-')[0]}-rigid-*"))
    if shape is None or rigid is None or not zone.any():
        return None
    true = read_ply(scene / f"ground_truth/deformed_meshes_cam/frame_{i:03d}.ply")[0]
    ray = true[zone] / np.linalg.norm(true[zone], axis=1)[:, None]
    along = lambda a, b: ((a - b)[zone] * ray).sum(1)
    moved, found, off = along(true, rigid), along(shape, rigid), along(shape, true)
    across = np.linalg.norm((shape - true)[zone] - off[:, None] * ray, axis=1)
    rms = lambda v: float(np.sqrt((v**2).mean()))
    return moved.mean(), found.mean(), (moved * found).sum() / (moved**2).sum(), rms(off), rms(across)


def main():
    a = scored_runs(__doc__).parse_args()
    rows = []
    for scene in finished(a.scenes, a.half):
        for i in range(1, len(list((scene / "ground_truth/deformed_meshes_cam").glob("frame_*.ply")))):
            if (found := row(scene, a.work, a.run, i)) is not None:
                rows.append((scene.name, i, *found))
    print("| scene | frame | moved, mm | found | share | off along, mm | across |\n" + "| --- " * 7 + "|")
    for name, i, *figures in sorted(rows, key=lambda r: -r[5])[:20]:
        print(f"| {name} | {i} | " + " | ".join(f"{x:.2f}" for x in figures) + " |")
    figures = np.array([r[2:] for r in rows])
    print("\n| frames | | share followed: 10, 25, 50, 75, 90 % | off along, median mm | across |\n" + "| --- " * 5 + "|")
    for name, of in (("pulls", figures[:, 0] < -LARGE), ("pushes", figures[:, 0] > LARGE), ("smaller", abs(figures[:, 0]) <= LARGE)):
        if of.any():
            share = ", ".join(f"{q:.2f}" for q in np.quantile(figures[of, 2], [0.1, 0.25, 0.5, 0.75, 0.9]))
            print(f"| {name} | {of.sum()} | {share} | {np.median(figures[of, 3]):.2f} | {np.median(figures[of, 4]):.2f} |")


if __name__ == "__main__":
    main()
