"""Bridges to other packages, with the packages themselves."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from conftest import COARSE
import dsfms
import dsfms.rerun
from dsfms import bridges


@pytest.mark.parametrize("which", ["template", "surface"])
def test_trimesh(which: str, request: pytest.FixtureRequest) -> None:
    pytest.importorskip("trimesh")
    item: Any = request.getfixturevalue(which)
    mesh = item.to_trimesh()
    assert np.array_equal(mesh.vertices, item.vertices) and np.array_equal(mesh.faces, item.faces)
    assert mesh.visual.vertex_colors[:, :3].max() == 255
    assert np.array_equal(bridges.to_trimesh(item).faces, mesh.faces)


def test_pyvista(surface: dsfms.Surface, template: dsfms.Template) -> None:
    pytest.importorskip("pyvista", exc_type=ImportError)
    mesh = surface.to_pyvista()
    assert np.array_equal(mesh.points.astype(np.float64), surface.vertices)
    assert np.array_equal(mesh.regular_faces, surface.faces)
    assert mesh["albedo"].shape == surface.vertices.shape
    assert np.array_equal(mesh["visible"].astype(bool), surface.visible)
    assert np.array_equal(mesh["expected_error"], surface.expected_error)
    assert bridges.to_pyvista(template).n_points == len(template.vertices)
    assert template.to_pyvista().field_data["unit"][0] == "template_units"


def test_open3d(surface: dsfms.Surface, template: dsfms.Template) -> None:
    pytest.importorskip("open3d", exc_type=ImportError)
    mesh = surface.to_open3d()
    assert np.array_equal(np.asarray(mesh.vertices), surface.vertices)
    assert np.array_equal(np.asarray(mesh.triangles), surface.faces)
    assert mesh.has_vertex_colors() and mesh.has_vertex_normals()
    assert len(bridges.to_open3d(template).vertices) == len(template.to_open3d().vertices)


def test_pycolmap_and_back(
    template: dsfms.Template, scene: Path, camera: dsfms.Camera, tmp_path: Path
) -> None:
    pycolmap = pytest.importorskip("pycolmap", exc_type=ImportError)
    model = template.to_pycolmap()
    assert len(model.images) == len(template.poses) and len(model.points3D) == len(template.points)
    model.write(str(tmp_path))
    again = pycolmap.Reconstruction(str(tmp_path))
    found, poses = bridges.from_pycolmap(again)
    assert template.camera is not None
    assert np.allclose(found.matrix, template.camera.matrix) and found.size == template.camera.size
    assert poses.keys() == template.poses.keys()
    for name, pose in template.poses.items():
        assert np.allclose(poses[name], pose, atol=1e-9)
    # COLMAP's poses, our surface.
    names = sorted(p.stem for p in (scene / "exploration").iterdir())
    known = [poses.get(name) for name in names]
    built = dsfms.build_template(
        scene / "exploration", found, organ_masks=scene / "exploration_masks", poses=known, vertices=200,
        options=COARSE
    )
    extent = [np.ptp(t.vertices, axis=0).max() for t in (built, template)]
    assert 0.7 < extent[0] / extent[1] < 1.4
    assert bridges.to_pycolmap(built).num_images() == sum(p is not None for p in known)


@pytest.mark.parametrize(
    ("model", "params", "names"),
    [
        ("SIMPLE_RADIAL", [500, 320, 240, -0.1], {"k1": -0.1}),
        ("OPENCV", [500, 510, 320, 240, -0.1, 0.01, 0.001, 0.002], {"k2": 0.01, "p2": 0.002}),
        ("OPENCV_FISHEYE", [500, 510, 320, 240, 0.1, 0.01, 0.001, 0.002], {"k4": 0.002}),
        ("PINHOLE", [500, 510, 320, 240], {}),
    ],
)
def test_cameras_of_pycolmap(model: str, params: list[float], names: dict[str, float]) -> None:
    pycolmap = pytest.importorskip("pycolmap", exc_type=ImportError)
    theirs = pycolmap.Camera(model=model, width=640, height=480, params=params)
    ours = bridges.camera_from_pycolmap(theirs)
    point = np.array([[0.2, -0.1, 1.0]])
    # Pixel centres: half integers there, integers here.
    assert np.allclose(ours.project(point), theirs.img_from_cam(point) - 0.5, atol=1e-6)
    assert all(ours.distortion[name] == value for name, value in names.items())
    with pytest.raises(ValueError, match="camera: expected a model of"):
        bridges.camera_from_pycolmap(pycolmap.Camera(model="FOV", width=9, height=9, params=[9, 9, 4, 4, 0.1]))


def test_rerun(surface: dsfms.Surface, image: NDArray[np.uint8], tmp_path: Path) -> None:
    rr = pytest.importorskip("rerun")
    path = tmp_path / "surface.rrd"
    recording = rr.RecordingStream("dsfms_test")
    recording.save(path)
    dsfms.rerun.log(surface, image, frame=3, recording=recording)
    dsfms.rerun.log(surface, frame=4, recording=recording)
    recording.flush()
    del recording
    rows = read_rrd(path)
    assert {"/camera", "/camera/image", "/camera/surface", "/camera/verdict"} <= rows.keys()
    positions = rows["/camera/surface"]["Mesh3D:vertex_positions"]
    assert np.allclose(np.array(positions[0], dtype=np.float64), surface.vertices, atol=1e-3)
    assert len(rows["/camera/surface"]["Mesh3D:vertex_colors"][0]) == len(surface.vertices)
    assert str(surface.status) in rows["/camera/verdict"]["TextLog:text"][0][0]
    assert rows["/camera/surface"]["frame"] == [3, 4]


def read_rrd(path: Path) -> dict[str, dict[str, list[Any]]]:
    """Columns of every entity of a recording."""
    import pyarrow as pa
    from rerun.chunk import RrdReader

    rows: dict[str, dict[str, list[Any]]] = {}
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        columns = rows.setdefault(str(chunk.entity_path), {})
        for name in batch.schema.names:
            # Nanoseconds are no datetime of Python.
            stamps = pa.types.is_timestamp(batch.schema.field(name).type)
            values = [] if stamps else pa.array(batch.column(name)).to_pylist()
            columns.setdefault(name, []).extend(v for v in values if v is not None)
    return rows


def test_a_missing_package_says_how_to_get_it() -> None:
    with pytest.raises(ImportError, match=r"pip install 'dsfms\[no_such_package\]'"):
        bridges._extra("no_such_package")
