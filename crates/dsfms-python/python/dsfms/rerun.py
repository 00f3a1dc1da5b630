"""Surfaces on a timeline of the Rerun viewer (extra ``rerun``)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ._dsfms import Surface
from ._types import Status
from .bridges import _extra, vertex_colors

if TYPE_CHECKING:
    from ._dsfms import ArrayLike

__all__ = ["log"]

_LEVEL = {Status.OK: "INFO", Status.DEGRADED: "WARN", Status.LOST: "ERROR"}


def log(
    surface: Surface,
    image: ArrayLike | None = None,
    *,
    frame: int | None = None,
    path: str = "camera",
    timeline: str = "frame",
    recording: Any = None,
) -> None:
    """Log a surface: its mesh with albedo, the camera, the image and the verdict.

    Parameters
    ----------
    surface : Surface
        What is shown, in camera axes. A lost one clears the mesh.
    image : array (h, w, 3), optional
        The frame, uint8.
    frame : int, optional
        Time on the timeline; default none, which leaves the current time of the recording.
    path : str
        Entity under which ``image``, ``surface`` and ``verdict`` lie.
    timeline : str
        Name of the timeline.
    recording : rerun.RecordingStream, optional
        Default the global one.

    Raises
    ------
    ImportError
        rerun-sdk is not installed.
    """
    rr = _extra("rerun")
    if frame is not None:
        rr.set_time(timeline, sequence=frame, recording=recording)
    width, height = surface.camera.size
    rr.log(
        path,
        rr.Pinhole(
            image_from_camera=surface.camera.matrix,
            resolution=[width, height],
            camera_xyz=rr.ViewCoordinates.RDF,
        ),
        recording=recording,
    )
    if image is not None:
        rr.log(f"{path}/image", rr.Image(np.asarray(image)).compress(), recording=recording)
    if surface.status is Status.LOST:
        rr.log(f"{path}/surface", rr.Clear(recursive=False), recording=recording)
    else:
        mesh = rr.Mesh3D(
            vertex_positions=surface.vertices,
            triangle_indices=surface.faces,
            vertex_colors=vertex_colors(surface),
        )
        rr.log(f"{path}/surface", mesh, recording=recording)
    why = "; ".join(str(reason) for reason in surface.reasons)
    text = f"{surface.frame} {surface.status}" + (f": {why}" if why else "")
    rr.log(f"{path}/verdict", rr.TextLog(text, level=_LEVEL[surface.status]), recording=recording)
