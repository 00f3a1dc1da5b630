"""`dsfms.Camera` and `dsfms.read_camera`."""

from pathlib import Path

import numpy as np
import pytest

import dsfms


def test_projection_by_hand() -> None:
    camera = dsfms.Camera(640, 480, 500, 510, 320, 240)
    found = camera.project([[0.1, -0.2, 2.0], [0, 0, -1]])
    assert np.allclose(found[0], [320 + 500 * 0.05, 240 - 510 * 0.1])
    assert np.isnan(found[1]).all()
    assert camera.matrix.tolist() == [[500, 0, 320], [0, 510, 240], [0, 0, 1]]
    assert camera.size == (640, 480)
    assert camera.distortion == {}


@pytest.mark.parametrize(
    ("model", "k"),
    [("brown_conrady", [-0.1, 0.02, 0.001, -0.002, 0.003]), ("kannala_brandt", [0.01, 0.0, 0.002, 0.0])],
)
def test_unproject_inverts_project(model: str, k: list[float], tmp_path: Path) -> None:
    camera = dsfms.Camera(640, 480, 500, 510, 320, 240, distortion=k, model=model, tone="linear")  # type: ignore[arg-type]
    pixels = np.array([[10.0, 20.0], [320.0, 240.0], [600.0, 400.0]])
    assert np.abs(camera.project(camera.unproject(pixels)) - pixels).max() < 1e-6
    camera.save(tmp_path / "camera.json")
    assert dsfms.read_camera(tmp_path / "camera.json") == camera
    assert sorted(camera.distortion.values()) == sorted(k)


def test_what_does_not_fit_is_named() -> None:
    for arguments, word in [
        ({"distortion": [1.0]}, "distortion"),
        ({"model": "fov"}, "model"),
        ({"tone": -1.0}, "tone"),
        ({"vignetting": 5.0}, "vignetting"),
    ]:
        with pytest.raises(ValueError, match=f"{word}: expected .*found"):
            dsfms.Camera(640, 480, 500, 510, 320, 240, **arguments)
    with pytest.raises(ValueError, match="fx"):
        dsfms.Camera(640, 480, float("nan"), 510, 320, 240)
    with pytest.raises(dsfms.FileError, match="nowhere"):
        dsfms.read_camera("nowhere.json")


def test_light_of_the_scene(camera: dsfms.Camera) -> None:
    assert camera.light is None or camera.light
