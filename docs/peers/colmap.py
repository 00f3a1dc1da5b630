"""COLMAP (pycolmap) on the exploration frames of a rendered scene, intrinsics fixed.

    python3 -m venv venv && venv/bin/pip install pycolmap numpy
    taskset -c 0,1 venv/bin/python docs/peers/colmap.py SCENE [--masks]

Prints registered frames, camera centres (RMS mm) and rotations (RMS degrees) after one similarity
of the camera centres, points, mean reprojection error and seconds. The same figures for dsfms come
from `cargo run --release --example template_accuracy`.
"""

import json
import pathlib
import sys
import tempfile
import time

import numpy as np
import pycolmap


def similarity(source, target):
    """Scale, rotation, translation of the least squares `target = s R source + t` (Umeyama)."""
    a, b = source - source.mean(0), target - target.mean(0)
    u, d, vt = np.linalg.svd(b.T @ a)
    sign = np.diag([1, 1, np.sign(np.linalg.det(u @ vt))])
    rotation = u @ sign @ vt
    scale = (d * np.diag(sign)).sum() / (a**2).sum()
    return scale, rotation, target.mean(0) - scale * rotation @ source.mean(0)


def reconstruct(scene, masks, work):
    """The largest model, and seconds."""
    camera = json.loads((scene / "camera.json").read_text())
    # Their pixel centres lie at one half.
    values = [camera["fx"], camera["fy"], camera["cx"] + 0.5, camera["cy"] + 0.5]
    reader = pycolmap.ImageReaderOptions(
        camera_model="PINHOLE", camera_params=",".join(map(str, values))
    )
    if masks:
        folder = work / "masks"
        folder.mkdir()
        for image in sorted((scene / "exploration").glob("*.png")):
            number = image.stem.split("_")[-1]
            mask = scene / "masks/exploration" / f"organ_{number}.png"
            (folder / f"{image.name}.png").symlink_to(mask.resolve())
        reader.mask_path = str(folder)
    database = work / "database.db"
    began = time.time()
    pycolmap.set_random_seed(0)
    pycolmap.extract_features(
        database,
        scene / "exploration",
        camera_mode=pycolmap.CameraMode.SINGLE,
        reader_options=reader,
        device=pycolmap.Device.cpu,
    )
    pycolmap.match_exhaustive(database, device=pycolmap.Device.cpu)
    options = pycolmap.IncrementalPipelineOptions(
        ba_refine_focal_length=False, ba_refine_principal_point=False, ba_refine_extra_params=False
    )
    models = pycolmap.incremental_mapping(database, scene / "exploration", work, options)
    seconds = time.time() - began
    return max(models.values(), key=lambda m: m.num_reg_images(), default=None), seconds


def main():
    scene, masks = pathlib.Path(sys.argv[1]), "--masks" in sys.argv
    with tempfile.TemporaryDirectory() as work:
        model, seconds = reconstruct(scene, masks, pathlib.Path(work))
    truth = json.loads((scene / "ground_truth/poses.json").read_text())["exploration"]
    if model is None:
        print(f"no model, {seconds:.1f} s")
        return
    poses = {i.name: i.cam_from_world() for i in model.images.values() if i.has_pose}
    pairs = [(poses[pathlib.Path(t["image"]).name], t) for t in truth if pathlib.Path(t["image"]).name in poses]
    found = np.array([-p.rotation.matrix().T @ p.translation for p, _ in pairs])
    known = np.array([-np.array(t["R"]).T @ np.array(t["t"]) for _, t in pairs])
    scale, rotation, shift = similarity(found, known)
    centres = np.linalg.norm(scale * found @ rotation.T + shift - known, axis=1)
    turns = [p.rotation.matrix() @ rotation.T @ np.array(t["R"]).T for p, t in pairs]
    angles = [np.degrees(np.arccos(np.clip((np.trace(r) - 1) / 2, -1, 1))) for r in turns]
    rms = lambda x: np.sqrt(np.mean(np.square(x)))
    print(f"| registered frames | {len(pairs)} of {len(truth)} |")
    print(f"| camera centres, rms mm | {rms(centres):.4f} |")
    print(f"| camera rotations, rms degrees | {rms(angles):.4f} |")
    error = model.compute_mean_reprojection_error()
    print(f"| points, mean reprojection error | {model.num_points3D()}, {error:.3f} px |")
    print(f"| seconds | {seconds:.1f} |")


if __name__ == "__main__":
    main()
