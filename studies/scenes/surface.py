"""How far a template's surface is from the true one. usage: surface.py SCENE TEMPLATE [TEMPLATE ...]

The similarity that brings the camera centres onto the true ones is taken out. Prints, in mm: what it leaves of the
centres (root mean square); distances of the template's vertices from the true surface; the share of true vertices that
two frames or more see within 0.5 mm of the template's surface; the share of the template's vertices that no depth map
vouches for.
"""

import json
import sys
from pathlib import Path

import numpy as np
import trimesh

from measure import Surface


def centre(rotation, translation):
    """Centre of projection of X_cam = R X_world + t."""
    return -np.asarray(rotation).T @ np.ravel(translation)


def rotation(w, x, y, z):
    """Of a unit quaternion."""
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def true_centres(scene: Path) -> dict:
    poses = json.loads((scene / "ground_truth" / "poses.json").read_text())["exploration"]
    return {Path(pose["image"]).stem: centre(pose["R"], pose["t"]) for pose in poses}


def found_centres(template: Path) -> dict:
    centres = {}
    for line in (template / "sparse" / "images.txt").read_text().splitlines():
        row = line.split()
        if len(row) == 10 and not line.startswith("#"):
            q, t = map(float, row[1:5]), [float(x) for x in row[5:8]]
            centres[Path(row[9]).stem] = centre(rotation(*q), t)
    return centres


def similarity(found, true):
    """x -> s R x + t that brings found onto true with least squares (Umeyama 1991)."""
    a, b = found.mean(0), true.mean(0)
    u, singular, vt = np.linalg.svd((true - b).T @ (found - a))
    sign = np.diag([1, 1, np.linalg.det(u @ vt)])
    r = u @ sign @ vt
    s = (singular * np.diag(sign)).sum() / ((found - a) ** 2).sum()
    return lambda points: s * (points - a) @ r.T + b


def main() -> None:
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    scene = Path(sys.argv[1])
    true = true_centres(scene)
    rest = trimesh.load(scene / "ground_truth" / "rest_world.ply", process=False)
    near = Surface(rest.vertices, rest.faces)
    seen = rest.vertices[np.load(scene / "ground_truth" / "rest_vertex_seen_count.npy") >= 2]
    print("| template | cameras | median | rms | 95th percentile | worst | complete | unmeasured |\n" + "| --- " * 8 + "|")
    for template in map(Path, sys.argv[2:]):
        found = found_centres(template)
        names = sorted(set(found) & set(true))
        found, wanted = (np.array([centres[name] for name in names]) for centres in (found, true))
        align = similarity(found, wanted)
        off = np.sqrt(((align(found) - wanted) ** 2).sum(1).mean())
        mesh = trimesh.load(template / "template.ply", process=False)
        vertices = align(mesh.vertices)
        d = near.closest(vertices)[0]
        complete = (Surface(vertices, mesh.faces).closest(seen)[0] < 0.5).mean()
        sigma = np.load(template / "sigma.npz")
        open_share = (~np.isfinite(sigma[sigma.files[0]])).mean()
        figures = [off, np.median(d), np.sqrt((d**2).mean()), np.percentile(d, 95), d.max()]
        print(f"| {template.stem} | " + " | ".join(f"{x:.3f}" for x in figures), end=" | ")
        print(f"{100 * complete:.1f} % | {100 * open_share:.0f} % |")


if __name__ == "__main__":
    main()
