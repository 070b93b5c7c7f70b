"""Velocities of the points of meshes and Curves: they go straight on while the shutter is open.

Points P with velocities v go from P - v s / 2 to P + v s / 2 in the s seconds that the shutter is open, whatever their
object's steps are, and whatever they are at other times.

References
----------
Blender, intern/cycles/blender/mesh.cpp, curves.cpp: attr_create_motion_from_velocity.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .meshes import read_array


def read_velocity(data: Any) -> NDArray[np.float64] | None:
    """Return how fast points of a mesh or of Curves move, (p, 3) metres per second in its space; None if none tell."""
    attribute = data.attributes.get("velocity")
    if attribute is None or (attribute.domain, attribute.data_type) != ("POINT", "FLOAT_VECTOR"):
        return None
    return read_array(attribute.data, "vector", np.float32, 3).astype(np.float64)


def move_points(
    points: NDArray[np.float64], velocity: NDArray[np.float64], seconds: float
) -> list[NDArray[np.float64]] | None:
    """Return points (p, 3) at the first, the middle and the last of some seconds; [] where they stand still, None where
    their velocities (p, 3), metres per second, are others' or not finite."""
    if len(velocity) != len(points) or not np.isfinite(velocity).all():
        return None
    way = velocity * (seconds / 2.0)
    return [points - way, points, points + way] if way.any() else []
