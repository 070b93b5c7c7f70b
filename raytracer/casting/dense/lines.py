"""Rays prepared for the tables of `tree`, in float32.

A ray has two rows: for boxes (r, |r|, -o r) of each axis, r = 1 / d; for triangles d and m = o x d over the tolerance

    tolerance = EDGE_ROUNDING (1 + |m|) + ORIGIN_SHARE e,       e a bound on the error of the origin

so that an edge function is positive or negative for certain when its product is above 1 or below -1. With u = 2^-24
and triangles' rows with components of at most 1 (their size s is divided out), |d| < 1:

- Six terms are rounded 8 times each: both factors, the product, five sums. By gamma(8) 3 (1 + |m|) <= 24.01 u (1 + |m|)
  at most; EDGE_ROUNDING = 24.2 u also covers what rounds in float64 here.
- A move w of the origin changes an edge function by (w x d) . (q - p), at most 6 |w| s, and roundings of m by 4 v |o|
  change it by 12 v |o| s, v = 2^-53. Origins are off by v |o|, and where they were moved by `way` by
  v (|o| + way + |o'|) with |o'| <= |o| + way: at most 24 v (|o| + way) together, which is ORIGIN_SHARE e with
  e >= 8 v (1 + |o| + way).
- Corners in the frame are off by v, so p x q and its roundings by 8 v, q - p by 4 v: at most 24 v (1 + |m|) in all. s
  was raised by SMALLEST_ROWS = 2^-28 for that, worth 24.2 u 2^-28 (1 + |m|) > 48 v (1 + |m|).

Origins farther away than FAR are moved along the ray to the scene's box first (`culling`), by `way`: off by
gamma64(8) (1 + |o| + way). The way itself has two roundings, so a start lies behind the box by 3/8 of that at most.
Where the error is more than MOVED, beyond some 10^8 sizes of the scene, every box is entered. A ray that is far away
still passes the scene for certain.

In the frame of an instance (`instances`) corners may be moved by w, the ray's line, near the mesh, by w, and its
direction by w / 2. Where the line meets the triangle in P, no corner is farther from P than s in any component, and the
edge function d . ((p - P) x (q - P)) changes by at most

    12 w s + 6 w^2    by corners: d . (w x (q - P) + (p - P) x w + w x w), three components of two products each
    12 w s            by the line and by the direction, 6 w s each

so by 24 w + 6 w^2 / c < 29 w per unit of s + c, as w <= MOVED and c = SMALLEST_MOVED_ROWS is added to the size s of
those rows. PLACED_SHARE w is added to the tolerance.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats
from raytracer.casting.bvh.culling import FAR, FLOAT32_ROUNDOFF, RECIPROCAL_CAP, way_to_box
from raytracer.casting.bvh.tree import Frame
from raytracer.casting.framed import FramedRays, frame_rays, largest_row
from raytracer.casting.planes import PlaneDecisions
from raytracer.predicates.filtered import cross
from raytracer.predicates.rounding import gamma

EDGE_ROUNDING = 24.2 * FLOAT32_ROUNDOFF
ORIGIN_SHARE = 3.0
MOVED = 12 * FLOAT32_ROUNDOFF
# Added to the size of the rows of triangles that are moved, and what a move then costs.
SMALLEST_MOVED_ROWS = 2.0**-20
PLACED_SHARE = 30.0
# Rays prepared together: what they need fits the cache.
BLOCK = 1 << 12
# Rows of 32 bytes are gathered at twice the speed of others.
SLAB_COLUMNS, EDGE_COLUMNS = 9, 8
# The row that leaves every box at -1, and the one that is in every box at 0.
ENTERS_NOTHING, ENTERS_EVERYTHING = np.array([0, 0, -1] * 3, np.float32), np.zeros(SLAB_COLUMNS, np.float32)


# Takes some of the rays, by place and as they are in the frame.
Fill = Callable[[slice, FramedRays], None]


class DenseRays(NamedTuple):
    """n rays, and a last one that meets nothing.

    slabs : (n + 1, 9) float32, (r, |r|, -o r) of each axis
    lines : (n + 1, 8) float32, d and m over the tolerance
    way : (n,) float64, by how much t of the rows is less; minus infinity where that is unknown
    """

    slabs: NDArray[np.float32]
    lines: NDArray[np.float32]
    way: Floats


def empty_rays(count: int) -> DenseRays:
    """So many rays that are yet to be filled in."""
    slabs, lines = np.empty((count + 1, SLAB_COLUMNS), np.float32), np.empty((count + 1, EDGE_COLUMNS), np.float32)
    slabs[count], lines[count] = ENTERS_NOTHING, np.nan
    return DenseRays(slabs, lines, np.zeros(count))


def prepare_rays(frame: Frame, decisions: PlaneDecisions, fill: Fill | None = None) -> DenseRays:
    """Prepare the rays of a query, also for the decisions, and for what else `fill` makes of them."""
    rays = decisions.query.rays
    count = len(rays)
    prepared = empty_rays(count)
    for start in range(0, count, BLOCK):
        rows = slice(start, min(start + BLOCK, count))
        framed = frame_rays(frame, rays.origins[rows], rays.directions[rows])
        decisions.set_rays(rows, framed)
        if fill is not None:
            fill(rows, framed)
        fill_rows(DenseRays(prepared.slabs[rows], prepared.lines[rows], prepared.way[rows]), framed)
    return prepared


def fill_rows(rows: DenseRays, rays: FramedRays, moved: Floats | float = 0.0) -> None:
    """Fill the rows of rays whose lines, and the triangles' corners, are `moved` by so much at most (`instances`)."""
    origin, direction = rays.origin, rays.direction
    distance = largest_row(np.abs(origin))
    error = gamma(8) * (1 + distance) + moved
    far = np.flatnonzero(~(distance <= FAR))
    if len(far):
        some_origin, some_direction = origin.take(far, axis=1), direction.take(far, axis=1)
        way = way_to_box(some_origin, some_direction)
        some_origin += way * some_direction
        origin = origin.copy()
        origin[:, far] = some_origin
        rows.way[far] = way
        error[far] += gamma(8) * way
    _fill_slabs(rows.slabs, origin, direction)
    _fill_lines(rows.lines, origin, direction, error, moved)
    unknown = np.flatnonzero(~(error <= MOVED))
    passing = far[(largest_row(np.abs(origin.take(far, axis=1))) > FAR) & (error.take(far) <= MOVED)]
    rows.slabs[unknown], rows.way[unknown] = ENTERS_EVERYTHING, -np.inf
    rows.slabs[passing], rows.lines[passing] = ENTERS_NOTHING, np.nan


def _fill_slabs(slabs: NDArray[np.float32], origin: Floats, direction: Floats) -> None:
    """Where a direction is so small that its inverse is capped, crossing the scene moves a ray by less than 2^-55."""
    inverse = 1 / direction
    np.clip(inverse, -RECIPROCAL_CAP, RECIPROCAL_CAP, out=inverse)
    slabs[:, 0::3] = inverse.T
    np.abs(slabs[:, 0::3], out=slabs[:, 1::3])
    slabs[:, 2::3] = (-origin * inverse).T


def _fill_lines(
    lines: NDArray[np.float32], origin: Floats, direction: Floats, error: Floats, moved: Floats | float
) -> None:
    moment = cross(origin, direction)
    tolerance = EDGE_ROUNDING * (1 + largest_row(np.abs(moment))) + ORIGIN_SHARE * error + PLACED_SHARE * moved
    scale = 1 / tolerance
    lines[:, :3], lines[:, 3:6] = (direction * scale).T, (moment * scale).T
    # Nothing is known of what overflows.
    lost = np.flatnonzero(~np.isfinite(tolerance))
    lines[lost] = 0


def to_bounds(t: Floats, way: Floats) -> NDArray[np.float32]:
    """Distances in the frame as upper bounds in float32 for what is measured from moved origins; NaN if decided."""
    rest = t - way
    return (rest + np.abs(rest) * 2.0**-22 + 2.0**-126).astype(np.float32)
