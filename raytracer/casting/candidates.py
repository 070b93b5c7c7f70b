"""Candidates of rays, as records of columns, and runs of those that belong to one ray."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.casting.geometry import Ids


class Candidates(NamedTuple):
    """k candidates with what is known of them.

    t : (k,) the distance as computed; low : (k,) certainly no more than the exact one
    certain : (k,) bool, the primitive is hit within the ray's range beyond doubt
    """

    ray: Indices
    primitive_id: Ids
    t: Floats
    low: Floats
    certain: Booleans

    def select(self, index: Indices | Booleans | slice) -> Candidates:
        """Return some of the candidates."""
        return Candidates(
            self.ray[index], self.primitive_id[index], self.t[index], self.low[index], self.certain[index]
        )


def join_candidates(parts: list[Candidates]) -> Candidates:
    """Return several records as one, in order."""
    return Candidates(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def find_runs(sorted_values: Indices) -> NDArray[np.intp]:
    """(g, 2) start and stop of each run of equal values."""
    if not len(sorted_values):
        return np.zeros((0, 2), np.intp)
    starts = np.flatnonzero(np.concatenate([[True], sorted_values[1:] != sorted_values[:-1]]))
    return np.stack([starts, np.append(starts[1:], len(sorted_values))], axis=1)
