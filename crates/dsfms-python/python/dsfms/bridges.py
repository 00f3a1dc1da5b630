"""Templates and surfaces in the words of other packages; each needs the extra of its name.

`to_open3d`, `to_pyvista` and `to_trimesh` take a `Template` (template frame) or a `Surface` (camera axes).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._dsfms import Camera, Surface, Template

__all__ = [
    "camera_from_pycolmap",
    "from_pycolmap",
    "to_open3d",
    "to_pycolmap",
    "to_pyvista",
    "to_trimesh",
]


def _extra(name: str, package: str | None = None) -> Any:
    """Import a package of an extra, or say how to get it."""
    import importlib

    try:
        return importlib.import_module(package or name)
    except ImportError as error:
        raise ImportError(f"this needs {name}: pip install 'dsfms[{name}]'") from error


def _template(item: Template | Surface) -> Template:
    return item.template if isinstance(item, Surface) else item


def vertex_colors(item: Template | Surface) -> NDArray[np.uint8] | None:
    """Albedo at the vertices as sRGB, uint8 (n, 3), the brightest value at 255; None without albedo."""
    linear = _template(item).albedo_vertices
    if linear is None:
        return None
    linear = np.clip(linear / max(float(linear.max()), 1e-6), 0, 1)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.round(255 * encoded).astype(np.uint8)


def to_open3d(item: Template | Surface) -> Any:
    """``open3d.geometry.TriangleMesh`` with vertex colours and normals."""
    o3d = _extra("open3d")
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(item.vertices),
        o3d.utility.Vector3iVector(item.faces.astype(np.int32)),
    )
    colors = vertex_colors(item)
    if colors is not None:
        mesh.vertex_colors = o3d.utility.Vector3dVector(colors / 255.0)
    mesh.compute_vertex_normals()
    return mesh


def to_trimesh(item: Template | Surface) -> Any:
    """``trimesh.Trimesh`` with vertex colours; vertex order and faces are kept."""
    trimesh = _extra("trimesh")
    return trimesh.Trimesh(
        item.vertices, item.faces.astype(np.int64), vertex_colors=vertex_colors(item), process=False
    )


def to_pyvista(item: Template | Surface) -> Any:
    """``pyvista.PolyData`` with the point data ``albedo`` and, of a surface, ``visible``,
    ``expected_error`` and ``observed``; the unit is field data."""
    pyvista = _extra("pyvista")
    mesh = pyvista.PolyData.from_regular_faces(item.vertices, item.faces.astype(np.int64))
    colors = vertex_colors(item)
    if colors is not None:
        mesh.point_data["albedo"] = colors
    if isinstance(item, Surface):
        mesh.point_data["visible"] = item.visible.astype(np.uint8)
        if item.expected_error is not None:
            mesh.point_data["expected_error"] = item.expected_error
        if item.observed is not None:
            mesh.point_data["observed"] = item.observed.astype(np.uint8)
    mesh.field_data["unit"] = np.array([_template(item).unit])
    return mesh


_MODELS = {
    "SIMPLE_PINHOLE": "f cx cy",
    "PINHOLE": "fx fy cx cy",
    "SIMPLE_RADIAL": "f cx cy k1",
    "RADIAL": "f cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2",
    "OPENCV_FISHEYE": "fx fy cx cy k1 k2 k3 k4",
}


def camera_from_pycolmap(camera: Any) -> Camera:
    """The `Camera` of a ``pycolmap.Camera``.

    COLMAP's pixel centres lie at half integers, so that its principal point is moved by half a pixel.

    Raises
    ------
    ValueError
        A camera model that dsfms does not have.
    """
    name = camera.model.name
    if name not in _MODELS:
        raise ValueError(f"camera: expected a model of {', '.join(_MODELS)}, found {name}")
    p = dict(zip(_MODELS[name].split(), (float(v) for v in camera.params), strict=True))
    fx, fy = p.get("fx", p.get("f", 0.0)), p.get("fy", p.get("f", 0.0))
    distortion = None
    if name == "OPENCV_FISHEYE":
        distortion = [p["k1"], p["k2"], p["k3"], p["k4"]]
    elif "k1" in p:
        distortion = [p["k1"], p.get("k2", 0.0), p.get("p1", 0.0), p.get("p2", 0.0)]
    return Camera(
        camera.width,
        camera.height,
        fx,
        fy,
        p["cx"] - 0.5,
        p["cy"] - 0.5,
        distortion=distortion,
        model="kannala_brandt" if name == "OPENCV_FISHEYE" else "brown_conrady",
    )


def from_pycolmap(reconstruction: Any) -> tuple[Camera, dict[str, NDArray[np.float64]]]:
    """Camera and poses of a ``pycolmap.Reconstruction``, for `build_template`.

    Returns
    -------
    camera : Camera
        The one camera of all images.
    poses : dict
        ``camera_from_world`` of every image by name, float64 (4, 4).

    Raises
    ------
    ValueError
        Images of more than one camera; a camera model that dsfms does not have.
    """
    cameras = {image.camera_id for image in reconstruction.images.values()}
    if len(cameras) != 1:
        raise ValueError(f"reconstruction: expected images of one camera, found {len(cameras)}")
    poses: dict[str, NDArray[np.float64]] = {}
    for image in reconstruction.images.values():
        pose = np.eye(4)
        pose[:3] = image.cam_from_world().matrix()
        poses[image.name] = pose
    return camera_from_pycolmap(reconstruction.cameras[cameras.pop()]), poses


def to_pycolmap(template: Template) -> Any:
    """``pycolmap.Reconstruction`` of a template's exploration: camera, images, points with colours.

    Raises
    ------
    ValueError
        The template has no camera or no views.
    """
    pycolmap = _extra("pycolmap")
    camera = template.camera
    if camera is None or not template.poses:
        raise ValueError("template: expected one built from frames, found one without views")
    width, height = camera.size
    (fx, _, cx), (_, fy, cy), _ = camera.matrix.tolist()
    k = camera.distortion
    if "k4" in k:
        model, extra = "OPENCV_FISHEYE", [k["k1"], k["k2"], k["k3"], k["k4"]]
    elif k.get("k3", 0.0) != 0.0:
        model = "FULL_OPENCV"
        extra = [k["k1"], k["k2"], k["p1"], k["p2"], k["k3"], 0.0, 0.0, 0.0]
    elif k:
        model, extra = "OPENCV", [k["k1"], k["k2"], k["p1"], k["p2"]]
    else:
        model, extra = "PINHOLE", []
    params = [fx, fy, cx + 0.5, cy + 0.5, *extra]
    result = pycolmap.Reconstruction()
    colmap_camera = pycolmap.Camera(
        model=model, width=width, height=height, params=params, camera_id=1
    )
    result.add_camera_with_trivial_rig(colmap_camera)
    for number, (name, pose) in enumerate(template.poses.items(), start=1):
        image = pycolmap.Image(name=name, camera_id=1, image_id=number)
        result.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pose[:3]))
    for point, color in zip(template.points, template.point_colors, strict=True):
        result.add_point3D(point, pycolmap.Track(), color)
    return result
