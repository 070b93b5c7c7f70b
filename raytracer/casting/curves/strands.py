"""The segments of all curves of a scene in packed arrays, as Bezier curves, with a box for each.

A segment between the keys p1 and p2 of a strand is the uniform Catmull-Rom spline of four keys p0 ... p3
(`scene.curves`). Its Bezier points are p1, p1 + (p2 - p0) / 6, p2 - (p3 - p1) / 6, p2: a cubic lies within their hull.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats, Integers
from raytracer.predicates.rounding import gamma
from raytracer.scene.curves import Curves

# Segments whose boxes are found together.
BLOCK = 1 << 14
# A Bezier point, and the sum with a radius, take fewer roundings than this.
BOX_ERROR = gamma(8)


@dataclass(frozen=True, eq=False)
class Strands:
    """Packed curves; segments count from the first group's to the last's.

    keys : (p, 4) float64, x, y, z and radius
    rows : (k, 4) int32, the keys p0, p1, p2, p3 of each segment; it runs from p1 to p2
    strand : (k,) int32, the strand of each segment, counted through all groups
    thick : (k,) bool, True for round segments, False for ribbons
    """

    keys: Floats
    rows: Integers
    strand: Integers
    thick: Booleans

    def __len__(self) -> int:
        return len(self.rows)


def pack_strands(groups: tuple[Curves, ...]) -> Strands:
    """Return the packed segments of groups of curves."""
    keys = np.concatenate([np.zeros((0, 4)), *(np.column_stack([one.points, one.radii]) for one in groups)])
    counts = np.concatenate([np.zeros(0, np.int32), *(np.diff(one.strands) for one in groups)])
    ends = np.cumsum(counts, dtype=np.int64)
    strand = np.repeat(np.arange(len(counts), dtype=np.int32), counts - 1)
    # A segment's first key: all keys but the last of each strand.
    is_start = np.ones(len(keys), dtype=np.bool_)
    is_start[ends - 1] = False
    start = np.flatnonzero(is_start)
    before = np.maximum(start - 1, (ends - counts)[strand])
    after = np.minimum(start + 2, ends[strand] - 1)
    rows = np.stack([before, start, start + 1, after], axis=1).astype(np.int32)
    thick = np.repeat([one.shape == "thick" for one in groups], [one.segment_count for one in groups]).astype(np.bool_)
    return Strands(keys, rows, strand, thick)


def bound_segments(strands: Strands) -> Floats:
    """Return boxes (k, 2, 3) that hold all segments."""
    boxes = np.empty((len(strands), 2, 3))
    for begin in range(0, len(strands), BLOCK):
        part = slice(begin, begin + BLOCK)
        bezier = find_bezier(strands.keys.take(strands.rows[part], axis=0).transpose(2, 1, 0))  # (4, 4, b)
        reach = np.maximum(bezier[3].max(axis=0), 0.0)
        low, high = bezier[:3].min(axis=1) - reach, bezier[:3].max(axis=1) + reach
        slack = BOX_ERROR * (np.abs(bezier[:3]).max(axis=1) + reach)
        boxes[part, 0], boxes[part, 1] = (low - slack).T, (high + slack).T
    return boxes


def find_bezier(keys: NDArray[np.float64]) -> Floats:
    """Return the Bezier points (c, 4 points, k) of segments, whose keys are (c, 4 keys, k)."""
    bezier: Floats = np.empty_like(keys)
    bezier[:, 0], bezier[:, 3] = keys[:, 1], keys[:, 2]
    bezier[:, 1] = keys[:, 1] + (keys[:, 2] - keys[:, 0]) / 6.0
    bezier[:, 2] = keys[:, 2] - (keys[:, 3] - keys[:, 1]) / 6.0
    return bezier
