"""Rays prepared for conservative culling in float32: no box that holds an exact hit is ever skipped.

Each ray becomes a *row*: for each axis an origin moved outward by a pad, once for low planes and once for high planes,
and the reciprocal direction; for the triangles of `leaves` the direction of size 1 and a tolerance. For a box
[low, high] of the frame

    t_low  = (low  - (origin + pad)) / direction,      t_high = (high - (origin - pad)) / direction
    entry  = max over axes of min(t_low, t_high),      exit   = min over axes of max(t_low, t_high)

is the slab test of the box grown by the pad on every side, at no cost per node. The pad covers everything that is
absolute: the rounding of the origin to float32, of the frame, of moving the origin towards the scene and, for
instances, of the inverse transform. What is relative (three roundings of t) is covered by SLACK on the exit, as in
T. Ize, "Robust BVH ray traversal" (2013) and pbrt-v4, section 6.8.

Zero directions cannot produce 0 * inf: |1 / direction| is capped, and a padded origin is never on a plane that it
must not miss (the usual alternative is fmin and fmax, which ignore NaN).

A ray's own t is measured in units in which one step is about the size of the scene: t_row = (t - start) 2^exponent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats
from raytracer.casting.bvh.leaves import TOLERANCE
from raytracer.casting.bvh.tree import Frame, round_down
from raytracer.predicates.rounding import gamma

FLOAT32_ROUNDOFF = 2.0**-24
# entry <= exit * SLACK: both sides carry three roundings (pbrt-v4 uses 1 + 2 gamma(3)); as float32, rounded up.
SLACK = np.float32(1 + 2 * gamma(4, FLOAT32_ROUNDOFF))
# Beyond this, 1 / direction is capped: crossing the scene then moves the ray by 2^-60 of its size, far below the pad.
RECIPROCAL_CAP = 2.0**60
# The pad of a ray whose origin is out of range: every box is entered. Finite, so that no infinity meets another.
UNKNOWN = 2.0**100
# Origins farther than this many scene sizes are first moved along the ray to the scene's box.
FAR = 4.0
# They are moved to a box that is larger than the scene's by more than any pad.
BEFORE = 1 + 2.0**-10
# A start below this could lose bits to underflow.
SMALLEST_START = 2.0**-900
# Columns of a row: origin + pad, origin - pad, reciprocal, unit direction, tolerance, t_row per unit of the latter.
ROW_COLUMNS = 14
# Rays whose rows are made together: what they need stays within the cache.
BLOCK = 1 << 13


@dataclass(frozen=True, eq=False)
class CullingRays:
    """n rays in the world frame, near the scene.

    rows : (14, n) float32, see ROW_COLUMNS
    start, exponent : (n,) t_row = (t - start) 2^exponent
    slack : (n,) float64, absolute error of t_row
    origin, direction : (n, 3) float64 in the frame: the moved origin, the direction per unit of t_row
    error : (n,) float64, bound on the error of `origin`
    """

    rows: NDArray[np.float32]
    start: Floats
    exponent: NDArray[np.int32]
    slack: Floats
    origin: Floats
    direction: Floats
    error: Floats


def prepare_rays(frame: Frame, origins: Floats, directions: Floats) -> CullingRays:
    """Bring world rays into a frame.

    Powers of two are exact. Moving the origin costs three roundings, relative to the origin's distance and the way.
    """
    length = np.frexp(largest_component(directions)[:, 0])[1]  # |direction| < 2^length
    direction = np.ldexp(directions, -length[:, None])
    exponent = frame.exponent + length
    with np.errstate(over="ignore", invalid="ignore"):
        origin = np.ldexp(origins - frame.centre, frame.exponent)
        distance = largest_component(origin)[:, 0]
        way = np.zeros(len(origins))
        far = np.flatnonzero(distance > FAR)
        way[far] = way_to_box(origin[far].T, direction[far].T)
        start = np.ldexp(way, -exponent)
        movable = (start > SMALLEST_START) & np.isfinite(start)
        way, start = np.where(movable, way, 0.0), np.where(movable, start, 0.0)
        moved = origin + way[:, None] * direction
        error = gamma(8) * (1 + distance + way)
        slack = gamma(8) * way + 4 * FLOAT32_ROUNDOFF
    rows = make_rows(moved, direction, error[:, None])
    return CullingRays(rows, start, exponent, slack, moved, direction, error)


def largest_component(vectors: Floats) -> Floats:
    """(n, 1) largest absolute component of (n, 3) vectors; a reduction over three columns is slower by far."""
    sizes = np.abs(vectors)
    return np.maximum(np.maximum(sizes[:, 0], sizes[:, 1]), sizes[:, 2])[:, None]


def way_to_box(origin: Floats, direction: Floats) -> Floats:
    """(n,) a t at which rays from afar, (3, n) planes, are before the box [-1, 1]^3; 0 where they pass or leave it."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # The side that comes first; a direction of zero comes to no side: infinity of either sign, or NaN.
        entry = (np.copysign(BEFORE, -direction) - origin) / direction
        np.copyto(entry, -np.inf, where=direction == 0)
        way = np.fmax(np.fmax(entry[0], entry[1]), entry[2])
    return np.where(np.isfinite(way) & (way > 0), way, 0.0)


def make_rows(origin: Floats, direction: Floats, error: Floats) -> NDArray[np.float32]:
    """Return (14, n) columns of rows. `error`, (n, 3) or (n, 1), bounds what is absolute; see `_fill_rows`."""
    rows = np.empty((ROW_COLUMNS, len(origin)), np.float32)
    for start in range(0, len(origin), BLOCK):
        block = slice(start, start + BLOCK)
        _fill_rows(rows[:, block], *(np.ascontiguousarray(part[block].T) for part in (origin, direction, error)))
    return rows


@np.errstate(divide="ignore", over="ignore")
def _fill_rows(rows: NDArray[np.float32], origin: Floats, direction: Floats, error: Floats) -> None:
    """Fill the columns from planes (3, b); out of range, every box is entered."""
    pad = error + 4 * FLOAT32_ROUNDOFF * (1 + np.abs(origin))
    known = np.isfinite(pad) & np.isfinite(origin)
    if not known.all():
        origin, pad = np.where(known, origin, 0.0), np.where(known, pad, UNKNOWN)
    scale = 1 / np.abs(direction).max(axis=0)
    cap = RECIPROCAL_CAP * scale
    np.add(origin, pad, out=rows[:3], casting="same_kind")
    np.subtract(origin, pad, out=rows[3:6], casting="same_kind")
    rows[6:9] = np.clip(1 / direction, -cap, cap)
    np.multiply(direction, scale, out=rows[9:12], casting="same_kind")
    np.multiply(pad.max(axis=0), TOLERANCE, out=rows[12], casting="same_kind")
    rows[13] = scale


def to_row_distance(rays: CullingRays, index: NDArray, t: Floats) -> NDArray[np.float32]:
    """World distances t of the rays `index` as upper bounds in row units, float32."""
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = np.ldexp(t - rays.start[index], rays.exponent[index])
        upper = np.maximum(scaled * (1 + SLACK_OF_DISTANCE), scaled * (1 - SLACK_OF_DISTANCE)) + rays.slack[index]
        return -round_down(-upper)


def to_row_start(rays: CullingRays, t_min: Floats) -> NDArray[np.float32]:
    """World t_min of all rays as lower bounds in row units, at least 0."""
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = np.ldexp(t_min - rays.start, rays.exponent)
        lower = scaled - SLACK_OF_DISTANCE * np.abs(scaled) - rays.slack
        return round_down(np.fmax(lower, 0.0))


# An entry is compared with `best` without SLACK; its four float32 roundings are paid for here.
SLACK_OF_DISTANCE = gamma(8, FLOAT32_ROUNDOFF)
