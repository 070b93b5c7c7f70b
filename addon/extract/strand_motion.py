"""What is read of strands in motion: they move as wholes, and whether they do not is asked the first of each.

References
----------
Blender, intern/cycles/blender/curves.cpp: which strands move.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .strands import Strands, list_hair, list_particles, read_paths

# Metres that points of particles may be off their place, which Blender knows in world space: Cycles' number.
SAME_PLACE = 1e-5


@dataclass(frozen=True)
class PlacedStrands:
    """Strands: the placement that they are, themselves in their own space, and the matrix (4, 4) that places them."""

    row: int
    strands: Strands
    world_from_object: NDArray[np.float64]


def read_first_strands(source: Any) -> list[NDArray[np.float64]]:
    """Return the points (1, steps, 3) of the first strand of each particle system of an object, in its space."""
    systems = [system for _, system in list_hair(source, True)]
    shown = [(system, list_particles(system, True)[:1]) for system in systems]
    return [read_paths(source, system, first, True) for system, first in shown if first]


def change_shape(shapes: list[list[NDArray[np.float64]]]) -> bool:
    """Return whether first strands of systems, at several times, differ: by more than rounding makes of them."""
    return any(not is_alike(one, other) for shape in shapes for one, other in zip(shapes[0], shape, strict=False))


def is_alike(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Return whether strands have the same points."""
    return one.shape == other.shape and bool(np.abs(one - other).max() <= SAME_PLACE)
