"""Reconstruct a deforming organ in 3D from a monocular laparoscope.

Template-based conformal shape from motion and shading. The way of the data::

    camera = dsfms.read_camera("camera.json")
    template = dsfms.build_template("exploration/", camera, organ_masks="masks/")
    surface = dsfms.reconstruct(template, image, camera)
    surface.vertices        # float64 (n, 3), camera axes

Conventions everywhere: OpenCV camera axes (x right, y down, z forward), pixel centres at integers, RGB,
lengths in mm where the scale is known, else in template units.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

from . import _dsfms as _native
from ._dsfms import (
    BuildError,
    CalibrationError,
    Camera,
    DsfmsError,
    DsfmsWarning,
    EvaluationError,
    FileError,
    Frames,
    ReconstructionError,
    Surface,
    Template,
    Tracker,
    Tracking,
    TrackingError,
    __version__,
    build_template,
    frame_count,
    read_camera,
    reconstruct,
)
from ._types import Calibration, Case, ErrorStats, Evaluation, Reason, ReasonKind, Region, Status
from ._types import Method as Method

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ._dsfms import ArrayLike, PathLike

__all__ = [
    "BuildError",
    "Calibration",
    "CalibrationError",
    "Camera",
    "Case",
    "DsfmsError",
    "DsfmsWarning",
    "ErrorStats",
    "Evaluation",
    "EvaluationError",
    "FileError",
    "Frames",
    "Reason",
    "ReasonKind",
    "Region",
    "ReconstructionError",
    "Status",
    "Surface",
    "Template",
    "Tracker",
    "Tracking",
    "TrackingError",
    "__version__",
    "build_template",
    "calibrate",
    "evaluate",
    "frame_count",
    "read_camera",
    "reconstruct",
    "synthesize",
]


def calibrate(
    images: PathLike | Sequence[PathLike] | Sequence[ArrayLike],
    board: tuple[int, int],
    square: float,
    *,
    third_radial: bool = False,
    tangential: bool = True,
    partial: bool = False,
) -> Calibration:
    """Intrinsics from images of a chessboard.

    Parameters
    ----------
    images : path, or list of paths or of arrays (h, w, 3)
        At least three, 10 or more with tilt are advised.
    board : (int, int)
        Inner corners along the two sides, each at least 3.
    square : float
        Side of a square, mm.
    third_radial, tangential : bool
        Estimate k3; estimate p1 and p2.
    partial : bool
        Accept boards of which a part is hidden.

    Raises
    ------
    ValueError
        An argument of the wrong kind, shape or value.
    FileError
        An image that cannot be read.
    CalibrationError
        Fewer than three boards found, or boards that do not fix the intrinsics.
    """
    camera, values = _native._calibrate(images, board, square, third_radial, tangential, partial)
    return Calibration(camera=camera, **values)


def evaluate(
    found: Surface | ArrayLike,
    truth: ArrayLike,
    faces: ArrayLike | None = None,
    *,
    visible: ArrayLike | None = None,
    zone: ArrayLike | None = None,
    rest: ArrayLike | None = None,
    camera: Camera | None = None,
    align: Literal["none", "rigid", "similarity"] = "none",
) -> Evaluation:
    """Errors of a surface against its truth.

    Parameters
    ----------
    found : Surface or array (n, 3)
        Camera axes.
    truth : array (n, 3)
        The true places, in the same order, axes and unit.
    faces : integer array (m, 3), optional
        Faces; default those of a given `Surface`.
    visible, zone : bool array (n,), optional
        Vertices that the camera sees; vertices of the deformed zone.
    rest : array (n, 3), optional
        The rest shape, from which the zone is found where it is not given: what moved by at least half
        of the largest visible displacement.
    camera : Camera, optional
        For errors in the image.
    align : {"none", "rigid", "similarity"}
        Motion that is taken out first.

    Raises
    ------
    ValueError
        An argument of the wrong kind, shape or value.
    EvaluationError
        Vertices that are not finite, or meshes that cannot be aligned.
    """
    if isinstance(found, Surface):
        faces = found.faces if faces is None else faces
        found = found.vertices
    if faces is None:
        raise ValueError("faces: expected an integer array (m, 3), found None")
    values = _native._evaluate(found, truth, faces, visible, zone, rest, camera, align)
    return Evaluation._of(values)


def synthesize(
    organ: str = "patch",
    extension: float = 10.0,
    *,
    noise: float = 0.0,
    vertices: int = 334,
    light: Literal["distant", "near", "ring"] = "distant",
    matches: int = 25,
    everywhere: bool = False,
    index: int = 0,
    seed: int = 0,
) -> Case:
    """A synthetic case of known truth (paper, section 8.1), the one of ``dsfms synth``.

    Parameters
    ----------
    organ : str
        "patch", an embedded organ ("uterus", "liver", ...) or a mesh file.
    extension : float
        Largest change of edge lengths in the deformed zone, percent, 0 to 100.
    noise : float
        Standard deviation of the matches, px.
    vertices : int
        Vertices of the template, 50 to 50,000.
    light : {"distant", "near", "ring"}
        Along the optical axis, or a point at the camera with inverse-square fall-off.
    matches : int
        Number of matches.
    everywhere : bool
        Matches also in the deformed zone.
    index, seed : int
        Case of the series, and seed of the series.

    Raises
    ------
    ValueError
        An argument out of range, an organ that is not known.
    """
    values: dict[str, Any] = _native._synthesize(
        organ, extension, noise, vertices, light, matches, everywhere, index, seed
    )
    return Case(**values)
