"""A CT of usual size carried along by one frame: time, and both files as nibabel reads them.

    pip install nibabel numpy
    python scripts/volume_speed.py target/release/dsfms WORK

An ellipsoid of 160 x 100 x 120 mm lies in 256 x 256 x 150 voxels. It is bent, 400 matches show it to a camera 300 mm away, and
`dsfms reconstruct --method dsfm --volume` runs without the volume and with both of its files. WORK must not exist.
"""

import json
import subprocess
import sys
import time
from pathlib import Path

import nibabel
import numpy as np

SIZE, SIDES = np.array([256, 256, 150]), np.array([0.9, 0.9, 1.2])
CENTRE, RADII = np.array([-20.0, 30.0, 40.0]), np.array([80.0, 50.0, 60.0])  # mm, LPS
LPS_FROM_RAS = np.array([-1.0, -1.0, 1.0])
FOCAL, MIDDLE = 700.0, np.array([319.5, 239.5])  # px


def sphere(rings: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit vertices, n x 3, and faces, m x 3."""
    theta = np.linspace(0, np.pi, rings + 1)[1:-1]
    phi = np.linspace(0, 2 * np.pi, columns, endpoint=False)
    t, p = (x.ravel() for x in np.meshgrid(theta, phi, indexing="ij"))
    ring = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=1)
    vertices = np.concatenate([[[0, 0, 1]], ring, [[0, 0, -1]]])
    at = lambda i, j: 1 + i * columns + j % columns
    last = len(vertices) - 1
    caps = [[0, at(0, j), at(0, j + 1)] for j in range(columns)]
    caps += [[last, at(rings - 2, j + 1), at(rings - 2, j)] for j in range(columns)]
    cells = [(i, j) for i in range(rings - 2) for j in range(columns)]
    sides = [[at(i, j), at(i + 1, j), at(i + 1, j + 1)] for i, j in cells]
    sides += [[at(i, j), at(i + 1, j + 1), at(i, j + 1)] for i, j in cells]
    return vertices, np.array(caps + sides)


def write_mesh(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    head = f"ply\nformat ascii 1.0\ncomment units mm\nelement vertex {len(vertices)}\n"
    head += "".join(f"property double {c}\n" for c in "xyz")
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [f"{x:.9f} {y:.9f} {z:.9f}\n" for x, y, z in vertices]
    path.write_text(head + "".join(rows + [f"3 {a} {b} {c}\n" for a, b, c in faces]))


def volume() -> tuple[np.ndarray, np.ndarray]:
    """Hounsfield-like voxels and their affine map (RAS, mm)."""
    affine = np.diag([-SIDES[0], SIDES[1], SIDES[2], 1.0])
    affine[:3, 3] = CENTRE * LPS_FROM_RAS - affine[:3, :3] @ (SIZE - 1) / 2
    place = np.stack(np.meshgrid(*map(np.arange, SIZE), indexing="ij"), axis=-1)
    lps = (place @ affine[:3, :3].T + affine[:3, 3]) * LPS_FROM_RAS
    inside = (((lps - CENTRE) / RADII) ** 2).sum(axis=-1) < 1
    values = 60 + 20 * np.sin(lps[..., 0] / 7) + 20 * np.cos(lps[..., 2] / 9)
    return np.where(inside, values, -1000).astype(np.int16), affine


def matches(unit: np.ndarray, faces: np.ndarray) -> str:
    """Centres of 400 faces that are seen, of the bent ellipsoid before the camera."""
    rest = unit * RADII
    bent = rest + np.stack([0 * rest[:, 0], 0 * rest[:, 0], 10 * np.sin(rest[:, 0] / 53)], axis=1)
    cos, sin = np.cos(2.6), np.sin(2.6)
    turn = np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])
    posed = bent @ turn.T + [3, -5, 300]
    towards = -((unit / RADII) @ turn.T * posed).sum(axis=1)
    seen = [k for k in range(len(faces)) if (towards[faces[k]] > 1.5).all()]
    random = np.random.default_rng(0)
    rows = ["face,b1,b2,b3,x,y\n"]
    for face in random.choice(seen, 400, replace=False):
        x, y, z = posed[faces[face]].mean(axis=0)
        pixel = FOCAL * np.array([x, y]) / z + MIDDLE + 0.1 * random.normal(size=2)
        rows.append(f"{face},0.333333333,0.333333333,0.333333334,{pixel[0]},{pixel[1]}\n")
    return "".join(rows)


def main() -> None:
    program, work = Path(sys.argv[1]).resolve(), Path(sys.argv[2])
    work.mkdir(parents=True)
    (work / "tracks").mkdir()
    unit, faces = sphere(60, 90)
    write_mesh(work / "ct.ply", unit * RADII + CENTRE, faces)
    (work / "tracks/frame_000.csv").write_text(matches(unit, faces))
    camera = {"width": 640, "height": 480, "fx": FOCAL, "fy": FOCAL, "cx": MIDDLE[0], "cy": MIDDLE[1]}
    (work / "camera.json").write_text(json.dumps(camera))
    values, affine = volume()
    image = nibabel.Nifti1Image(values, affine)
    image.header.set_xyzt_units("mm")
    nibabel.save(image, work / "ct.nii.gz")

    def run(name: str, *line: str) -> None:
        start = time.perf_counter()
        subprocess.run([program, *line, "--no-report", "--quiet"], cwd=work, check=True)
        print(f"{name}: {time.perf_counter() - start:.2f} s")

    run("template", "template", "--mesh", "ct.ply", "-o", "organ.template")
    line = ["reconstruct", "organ.template", "--matches", "tracks", "--method", "dsfm", "--camera", "camera.json"]
    run("without a volume", *line, "-o", "plain")
    run("with both files", *line, "--volume", "ct.nii.gz", "--volume-out", "both", "-o", "out")

    warped = nibabel.load(work / "out/volume/frame_000_warped.nii.gz")
    field = nibabel.load(work / "out/volume/frame_000_displacement.nii.gz")
    assert warped.get_data_dtype() == np.int16 and np.allclose(warped.affine, affine)
    assert field.shape == (*SIZE, 1, 3) and field.header.get_intent()[0] == "vector"
    moved = np.linalg.norm(np.asarray(field.dataobj), axis=-1).max()
    organ = [int((np.asarray(v) > -1000).sum()) for v in (values, warped.dataobj)]
    print(f"voxels of the organ: {organ[0]}, deformed {organ[1]}; largest displacement {moved:.1f} mm")


if __name__ == "__main__":
    main()
