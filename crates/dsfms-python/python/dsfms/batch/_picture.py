"""Small pictures without another package."""

from __future__ import annotations

import struct
import zlib
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from dsfms import Surface

COLORS = {"ok": (60, 160, 80), "degraded": (225, 160, 30), "lost": (200, 60, 50)}


def png(image: NDArray[np.uint8]) -> bytes:
    """An RGB image as PNG."""
    height, width, _ = image.shape

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = np.concatenate([np.zeros((height, 1), np.uint8), image.reshape(height, -1)], axis=1)
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    data = zlib.compress(rows.tobytes(), 9)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def thumbnail(image: NDArray[np.uint8], surface: Surface, width: int = 240) -> bytes:
    """The frame, about `width` px wide, with the seen vertices in the colour of its status, as PNG."""
    step = max(1, round(image.shape[1] / width))
    small = image[::step, ::step].copy()
    pixels = surface.camera.project(surface.vertices[surface.visible]) / step
    columns, rows = np.round(pixels[np.isfinite(pixels).all(axis=1)]).astype(np.int64).T
    inside = (columns >= 0) & (rows >= 0) & (columns < small.shape[1]) & (rows < small.shape[0])
    small[rows[inside], columns[inside]] = COLORS[surface.status.value]
    return png(small)
