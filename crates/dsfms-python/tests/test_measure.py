"""`dsfms.calibrate`, `dsfms.evaluate`, `dsfms.synthesize`."""

import numpy as np
import pytest
from numpy.typing import NDArray

import dsfms


def board(camera: dsfms.Camera, pose: NDArray[np.float64], corners: tuple[int, int]) -> NDArray[np.uint8]:
    """A chessboard of 3 mm squares before a camera, each pixel the mean of nine samples."""
    width, height = camera.size
    offsets = [(x, y) for x in (-1 / 3, 0, 1 / 3) for y in (-1 / 3, 0, 1 / 3)]
    total = np.zeros((height, width))
    rows, columns = np.mgrid[:height, :width]
    for dx, dy in offsets:
        rays = camera.unproject(np.stack([columns.ravel() + dx, rows.ravel() + dy], axis=1))
        r, t = pose[:3, :3], pose[:3, 3]
        depth = (r[:, 2] @ t) / (rays @ r[:, 2])
        place = (rays * depth[:, None] - t) @ r / 3.0
        inside = ((place > -1.0) & (place < [corners[0], corners[1], 1e9]))[:, :2].all(axis=1)
        dark = (np.floor(place[:, 0]) + np.floor(place[:, 1])) % 2 == 0
        total += np.where(inside & dark, 30.0, 220.0).reshape(height, width)
    return np.repeat(np.round(total / 9)[..., None], 3, axis=2).astype(np.uint8)


def views(camera: dsfms.Camera, corners: tuple[int, int]) -> list[NDArray[np.uint8]]:
    images = []
    for ax, ay, az in [(0.3, 0.1, 0.0), (-0.3, 0.2, 0.2), (0.1, -0.35, -0.2), (0.25, 0.3, 0.4), (-0.2, -0.2, 0.1)]:
        cx, sx, cy, sy, cz, sz = np.cos(ax), np.sin(ax), np.cos(ay), np.sin(ay), np.cos(az), np.sin(az)
        r = (
            np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
            @ np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
            @ np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
        )
        pose = np.eye(4)
        pose[:3, :3] = r
        pose[:3, 3] = np.array([0, 0, 36.0]) - r @ np.array([1.5 * (corners[0] - 1), 1.5 * (corners[1] - 1), 0])
        images.append(board(camera, pose, corners))
    return images


def test_calibration_finds_the_camera() -> None:
    camera = dsfms.Camera(320, 240, 300, 300, 160, 118)
    found = dsfms.calibrate(views(camera, (8, 6)), (8, 6), 3.0)
    assert isinstance(found, dsfms.Calibration)
    assert abs(found.intrinsics["fx"] - 300) < 3 and abs(found.intrinsics["cy"] - 118) < 3
    assert found.rms_px < 0.3 and found.covariance.shape == (9, 9) and found.deviations["fx"] > 0
    assert len(found.poses) + len(found.rejected) == 5
    assert found.camera.size == (320, 240) and found.corners.keys() == found.view_rms_px.keys()


def test_what_cannot_be_calibrated() -> None:
    grey = [np.full((240, 320, 3), 128, np.uint8)] * 3
    with pytest.raises(dsfms.CalibrationError):
        dsfms.calibrate(grey, (8, 6), 3.0)
    with pytest.raises(ValueError, match="board: expected"):
        dsfms.calibrate(grey, (1, 6), 3.0)
    with pytest.raises(ValueError, match="square: expected"):
        dsfms.calibrate(grey, (8, 6), -1.0)


def test_errors_by_hand() -> None:
    case = dsfms.synthesize(vertices=120)
    assert isinstance(case, dsfms.Case)
    moved = case.truth + [0, 0, 2.0]
    found = dsfms.evaluate(moved, case.truth, case.template.faces, visible=case.visible, zone=case.zone,
                           camera=case.camera)  # fmt: skip
    assert isinstance(found, dsfms.Evaluation) and isinstance(found.all, dsfms.ErrorStats)
    assert abs(found.all.rms - 2) < 1e-12 and found.all.count == len(case.truth)
    assert found.zone is not None and found.zone.count == case.zone.sum()
    assert found.visible is not None and found.visible.count == case.visible.sum()
    assert found.reprojection_px is not None and found.to_surface.max <= 2 + 1e-9
    rigid = dsfms.evaluate(moved, case.truth, case.template.faces, align="rigid")
    assert rigid.all is not None and rigid.all.max < 1e-9
    rest = dsfms.evaluate(moved, case.truth, case.template.faces, rest=case.template.vertices)
    assert rest.zone is not None


def test_a_surface_is_compared_with_its_own_faces() -> None:
    case = dsfms.synthesize(vertices=150, matches=120, everywhere=True, extension=5)
    surface = dsfms.reconstruct(case.template, case.image, case.camera, matches=case.matches)
    error = dsfms.evaluate(surface, case.truth, visible=case.visible)
    assert error.visible is not None and error.visible.rms < 1.5


def test_what_cannot_be_compared() -> None:
    case = dsfms.synthesize(vertices=120)
    with pytest.raises(ValueError, match="found: expected"):
        dsfms.evaluate(case.truth[:-1], case.truth, case.template.faces)
    with pytest.raises(ValueError, match="visible: expected bool"):
        dsfms.evaluate(case.truth, case.truth, case.template.faces, visible=[1, 2])
    with pytest.raises(ValueError, match="faces: expected"):
        dsfms.evaluate(case.truth, case.truth)
    with pytest.raises(ValueError, match="align: expected"):
        dsfms.evaluate(case.truth, case.truth, case.template.faces, align="affine")  # type: ignore[arg-type]
    with pytest.raises(dsfms.EvaluationError):
        dsfms.evaluate(np.zeros_like(case.truth), case.truth, case.template.faces, align="similarity")


def test_synthesis_is_the_same_every_time() -> None:
    a, b = (dsfms.synthesize(vertices=120, index=1, seed=7) for _ in range(2))
    assert np.array_equal(a.image, b.image) and np.array_equal(a.truth, b.truth)
    assert a.image.shape == (576, 720, 3) and a.zone.any() and a.displacement.shape == (len(a.truth),)
    other = dsfms.synthesize(vertices=120, index=2, seed=7)
    assert other.truth.shape != a.truth.shape or not np.array_equal(other.truth, a.truth)
    for arguments, word in [
        ({"extension": 500.0}, "extension"),
        ({"vertices": 3}, "vertices"),
        ({"light": "sun"}, "light"),
        ({"organ": "spleeen"}, "spleeen"),
        ({"noise": -1.0}, "noise"),
    ]:
        with pytest.raises(ValueError, match=word):
            dsfms.synthesize(**arguments)  # type: ignore[arg-type]
