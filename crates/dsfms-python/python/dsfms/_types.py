"""Plain values that calls return: enums and data classes."""

from __future__ import annotations

import json
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ._dsfms import Camera, Template

__all__ = [
    "Calibration",
    "Case",
    "ErrorStats",
    "Evaluation",
    "Reason",
    "ReasonKind",
    "Region",
    "Status",
]


Method = Literal["rigid", "sfs", "dsfm", "dsfms", "joint"]
"""What `reconstruct` does."""


class Status(str, Enum):
    """Whether a surface can be trusted."""

    OK = "ok"
    DEGRADED = "degraded"
    LOST = "lost"

    def __str__(self) -> str:
        return self.value


class Region(IntEnum):
    """What is known of a vertex, as in `Surface.regions` and in the files."""

    HIDDEN = 0
    OBSERVED = 1
    UNOBSERVED = 2
    CONTRADICTED = 3
    FOLDED = 4


class ReasonKind(str, Enum):
    """What speaks against a surface; the names of the library's `Reason`."""

    NO_SURFACE = "no_surface"
    INPUT = "input"
    NOT_FINITE = "not_finite"
    BLACK = "black"
    NOTHING_VISIBLE = "nothing_visible"
    FEW_MATCHES = "few_matches"
    REPEATED_MATCHES = "repeated_matches"
    MATCHES_DISAGREE = "matches_disagree"
    RESIDUAL = "residual"
    POSE_UNCERTAIN = "pose_uncertain"
    DEPTH = "depth"
    TINY = "tiny"
    FAR_FROM_RIGID = "far_from_rigid"
    DEPTH_UNCERTAIN = "depth_uncertain"
    FEW_PLACES = "few_places"
    UNLIKE = "unlike"
    STRUCTURE = "structure"
    FAINT = "faint"
    BRIGHTNESS = "brightness"
    COVERED = "covered"
    UNCOMPARED = "uncompared"
    REGION_CONTRADICTED = "region_contradicted"
    REGION_UNOBSERVED = "region_unobserved"
    NO_SHADING = "no_shading"
    GAIN = "gain"
    STRAIN = "strain"
    FOLDED = "folded"
    JUMP = "jump"
    CAMERA_UNCONFIRMED = "camera_unconfirmed"
    CAMERA_CONTRADICTED = "camera_contradicted"

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True)
class Reason:
    """One doubt: its kind, the sentence, and the figures it rests on.

    >>> str(Reason(ReasonKind.RESIDUAL, "median residual 3.1 px", {"px": 3.1}))
    'median residual 3.1 px'
    """

    kind: ReasonKind
    text: str
    figures: dict[str, Any]

    def __str__(self) -> str:
        return self.text


def reasons(found: list[tuple[str, str]]) -> tuple[Reason, ...]:
    """Reasons of the library: sentence, and kind and figures as JSON."""

    def of(text: str, figures: dict[str, Any]) -> Reason:
        return Reason(ReasonKind(figures.pop("reason")), text, figures)

    return tuple(of(text, json.loads(figures)) for text, figures in found)


@dataclass(frozen=True)
class ErrorStats:
    """Statistics of absolute errors, in the unit of the errors."""

    count: int
    rms: float
    mean: float
    median: float
    p90: float
    max: float

    @classmethod
    def _of(cls, values: dict[str, Any] | None) -> ErrorStats | None:
        return None if values is None else cls(**values)


@dataclass(frozen=True)
class Evaluation:
    """Errors of a surface against its truth, lengths in the unit of the input.

    A part is None where it is unknown or empty. `all` to `visible_zone`: distance of a vertex to its true
    place; `reprojection_px`: the same in the image; `to_surface` and `from_surface`: distance of every
    found vertex to the true surface, and of every true one to the found surface.
    """

    all: ErrorStats | None
    visible: ErrorStats | None
    hidden: ErrorStats | None
    zone: ErrorStats | None
    visible_zone: ErrorStats | None
    edge_length_rms: float | None
    reprojection_px: ErrorStats | None
    to_surface: ErrorStats
    from_surface: ErrorStats
    scale: float

    @classmethod
    def _of(cls, values: dict[str, Any]) -> Evaluation:
        parts = values["vertices"] or {}
        stats = ErrorStats._of
        return cls(
            all=stats(parts.get("all")),
            visible=stats(parts.get("visible")),
            hidden=stats(parts.get("hidden")),
            zone=stats(parts.get("zone")),
            visible_zone=stats(parts.get("visible_zone")),
            edge_length_rms=values["edge_length_rms"],
            reprojection_px=stats(values["reprojection_px"]),
            to_surface=ErrorStats(**values["found_to_truth"]),
            from_surface=ErrorStats(**values["truth_to_found"]),
            scale=values["scale"],
        )


@dataclass(frozen=True)
class Calibration:
    """Intrinsics from images of a chessboard.

    Attributes
    ----------
    camera : Camera
        The intrinsics.
    rms_px : float
        Root mean square distance of all corners from their projections, px.
    intrinsics, deviations : dict
        Every intrinsic and its standard deviation (0 where it was held): fx fy cx cy k1 k2 p1 p2 k3.
    covariance : float64 (9, 9)
        Of the intrinsics in that order.
    poses : dict
        ``camera_from_board`` of every image, float64 (4, 4), mm.
    corners : dict
        Corners found in every image, float64 (k, 2), px.
    view_rms_px : dict
        Root mean square residual of every image, px.
    rejected : dict
        Images that were left out, and why.
    """

    camera: Camera
    rms_px: float
    intrinsics: dict[str, float]
    deviations: dict[str, float]
    covariance: NDArray[np.float64]
    poses: dict[str, NDArray[np.float64]]
    corners: dict[str, NDArray[np.float64]]
    view_rms_px: dict[str, float]
    rejected: dict[str, str]


@dataclass(frozen=True)
class Case:
    """A deformed organ before a laparoscope, with its exact truth; lengths in mm.

    Attributes
    ----------
    template : Template
        The rest shape with exact albedo and light.
    image : uint8 (h, w, 3)
        sRGB.
    camera : Camera
        Camera of the image, with the light.
    matches : float64 (k, 6)
        Face, three barycentrics, x and y in px.
    truth : float64 (n, 3)
        True vertices in camera axes.
    visible, zone : bool (n,)
        Seen by the camera; moved by more than a tenth of the largest displacement.
    displacement : float64 (n,)
        Distance of every vertex from its place at rest.
    """

    template: Template
    image: NDArray[np.uint8]
    camera: Camera
    matches: NDArray[np.float64]
    truth: NDArray[np.float64]
    visible: NDArray[np.bool_]
    zone: NDArray[np.bool_]
    displacement: NDArray[np.float64]
