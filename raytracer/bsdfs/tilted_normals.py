"""Shading normals, tilted where a mirror would reflect to below the surface."""

from __future__ import annotations

import numpy as np

from raytracer.arrays.rows import (
    put_rows,
    take_rows,
)
from raytracer.arrays.types import Floats
from raytracer.arrays.vectors import normalize, reflect
from raytracer.lecture import dot


def tilt_to_reflect(normal: Floats, geometric_normal: Floats, outgoing: Floats) -> Floats:
    """Return shading normals (n, 3), turned towards the geometric ones until mirror reflection stays above the surface.

    In the plane of the two normals, with the view at (a, b) across and along the geometric normal, a normal turned by p
    reflects to the height a sin 2p + b cos 2p = |(a, b)| cos(2p - q), q = atan2(a, b). Where that falls below
    t = min(0.9 b, 0.01), Cycles' limit, the p is taken that gives t.
    """
    height = dot(geometric_normal, outgoing)
    limit = np.minimum(0.9 * height, 0.01)
    low = (dot(geometric_normal, reflect(outgoing, normal)) < limit) & (height > 0)
    rows = np.flatnonzero(low)
    if not len(rows):
        return normal
    axis, bent = take_rows(geometric_normal, rows), take_rows(normal, rows)
    aside = normalize(bent - dot(bent, axis)[:, np.newaxis] * axis)
    a, b = dot(take_rows(outgoing, rows), aside), height[rows]
    turn = (np.arctan2(a, b) + np.arccos(np.clip(limit[rows] / np.hypot(a, b), -1.0, 1.0))) / 2.0
    tilted = normal.copy("K")
    put_rows(tilted, rows, np.sin(turn)[:, np.newaxis] * aside + np.cos(turn)[:, np.newaxis] * axis)
    return tilted
