"""Smooth random fields of position, seeded."""

import numpy as np
from scipy import ndimage


def noise(points, scale, seed, order=3):
    """Value noise of unit variance per lattice node at `points` (..., 3), in mm; `scale` is the lattice spacing in mm."""
    lattice = np.random.default_rng(seed).standard_normal((32, 32, 32))
    where = np.moveaxis(np.asarray(points) / scale % 32, -1, 0)
    return ndimage.map_coordinates(lattice, where, order=order, mode="grid-wrap")


def octaves(points, scales, weights, seed):
    """Weighted sum of `noise` at several scales (mm)."""
    return sum(w * noise(points, s, seed + i) for i, (s, w) in enumerate(zip(scales, weights)))
