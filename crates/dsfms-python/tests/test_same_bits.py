"""The module gives the bits of the command line."""

from pathlib import Path

import numpy as np
from conftest import COARSE, Run, first, pixels, ply_vertices

import dsfms


def test_template_from_files(
    program: Run, scene: Path, template: dsfms.Template, tmp_path: Path
) -> None:
    (tmp_path / "options.toml").write_text(COARSE)
    program("template", scene / "exploration", "--camera", scene / "camera.json", "--organ-masks",
            scene / "exploration_masks", "--vertices", 300, "--options", tmp_path / "options.toml", "--no-report",
            "-o", tmp_path / "cli")  # fmt: skip
    template.save(tmp_path / "python")
    for name in ("template.ply", "template.toml", "sparse/images.txt", "sparse/points3D.txt"):
        ours, theirs = (tmp_path / who / name for who in ("python", "cli"))
        assert ours.read_bytes() == theirs.read_bytes(), name
    other = dsfms.Template.load(tmp_path / "cli")
    assert np.array_equal(other.vertices, template.vertices)
    assert np.array_equal(other.albedo_texture(128), template.albedo_texture(128))
    assert np.array_equal(other.sigma, template.sigma)


def test_surface(program: Run, scene: Path, template: dsfms.Template, tmp_path: Path) -> None:
    template.save(tmp_path / "organ")
    path = first(scene / "deformed")
    for method in ("dsfm", "joint"):
        out = tmp_path / method
        program("reconstruct", tmp_path / "organ", path, "--camera", scene / "camera.json", "--method",
                method, "--no-report", "-o", out)  # fmt: skip
        found = dsfms.reconstruct(template, pixels(path), scene / "camera.json", method=method)
        (file,) = out.glob("frame_*.ply")
        theirs = ply_vertices(file)
        assert np.array_equal(found.vertices.astype(theirs.dtype), theirs), method


def test_tracked(program: Run, clip: Path, tmp_path: Path) -> None:
    program("track", clip / "organ.template", clip / "frames", "--camera", clip / "camera.json",
            "--no-report", "-o", tmp_path)  # fmt: skip
    with np.load(tmp_path / "vertices.npz") as arrays:
        theirs = arrays["vertices"]
    tracker = dsfms.Tracker(dsfms.Template.load(clip / "organ.template"), clip / "camera.json")
    ours = np.stack([surface.vertices for surface in tracker.track(clip / "frames")])
    assert np.array_equal(ours.astype(theirs.dtype), theirs, equal_nan=True)
