"""Spheres in blocks below levels of boxes, as triangles are (`tree`): which of them lines may meet, in float64.

The line o + t d passes the center c at |(c - o) x d| / |d| (the lecture's "Distance between point to a line"), and
meets the sphere where that is not more than r. Squared, and with m = o x d, it does where f <= 0,

    f = |c x d - m|^2 - r^2 |d|^2
      = (c_y^2 + c_z^2 - r^2) d_x^2 + ... - 2 c_x c_y d_x d_y - ... - 2 c . (d x m) + |m|^2,

ten numbers of the sphere times ten of the ray: one product for all pairs of a packet of rays and a block of spheres. In
float32 the squares would hide spheres below a thousandth of the scene; float64 is as quick here as float32 with centers
relative to their block (a lane with 24 spheres 23 to 50 ns against 40 to 70: the ray's ten numbers have to be made anew
there).

Why no sphere is missed. In the frame |c_i|, r, |d_i| <= 1; let m and o be the largest |m_i| and |o_i|, v = 2^-53.

- Centers and origins are off by v and v o when they are placed, and m by 2 v o when it is computed: c x d - m is off by
  h = v (2 + 6 o) in each component at most, by g = sqrt(3) h in all. A line that meets the sphere has
  |c x d - m| <= r |d| + g as computed, so f <= 2 sqrt(3) g + g^2 = 6 h + 3 h^2, as r <= 1 and |d| <= sqrt(3).
- A term of f is rounded 3 times at most in either factor, once as a product, and 9 times in sums, whatever their order;
  the last one once more, when the tolerance is subtracted: gamma(16) of the sum of all terms' absolute values, which is

      9  d_i^2, three coefficients of three squares each
      6  d_i d_j, three of 2
      12 m  c_i, three of 2 times two products of m each
      3 m^2

The tolerance 6 h + 3 h^2 + gamma(16) (15 + 12 m + 3 m^2) is subtracted from the ray's last number, so that f <= 0 for
all that may be met. It hides nothing down to 1e-7 of the scene: f of a line that passes next to the sphere's center is
-r^2 |d|^2. What is then met, and where, `query` decides.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats, Indices, Integers
from raytracer.casting.bvh.clustering import half_surface
from raytracer.casting.bvh.hierarchy import bound_spheres
from raytracer.casting.bvh.tree import Frame, to_bounds
from raytracer.casting.dense.lines import DenseRays
from raytracer.casting.dense.lines import to_bounds as to_ray_bounds
from raytracer.casting.dense.split import split_evenly
from raytracer.casting.dense.tree import LARGE_SHARE, Blocks, make_levels
from raytracer.casting.dense.walk import Walk
from raytracer.casting.framed import FramedRays, largest_row, times_power
from raytracer.casting.geometry import Geometry
from raytracer.casting.planes import PlaneDecisions
from raytracer.predicates.filtered import cross, dot
from raytracer.predicates.rounding import UNIT_ROUNDOFF, gamma

# Spheres of a block, within a factor of the square root of two; from 9 to 34 rays take within 3% as long.
BLOCK_SPHERES = 17
# Numbers of a sphere and of a ray, whose product is f.
QUADRIC_COLUMNS = 10
# Shares of the tolerance: h = PLACED (1 + 3 o), 2 v with what rounds here; and of all terms of f.
PLACED, TERMS = 2.02 * UNIT_ROUNDOFF, gamma(17)


@dataclass(frozen=True, eq=False)
class SphereBlocks(Blocks):
    """Spheres in b blocks of up to k, items being their rows in `Geometry.centres`.

    rows : (b, k, 10) float64, numbers of the spheres; NaN where there are fewer
    """

    rows: Floats


def build_spheres(geometry: Geometry, frame: Frame) -> list[SphereBlocks]:
    """Return the trees of s >= 1 spheres within the frame: of small ones, and of large ones, whose boxes most rays
    enter anyway."""
    boxes = bound_spheres(geometry)
    bounds = to_bounds(frame, boxes)
    surface = half_surface(bounds)
    large = surface > LARGE_SHARE * half_surface(bounds.min(axis=1))
    parts = [np.flatnonzero(part).astype(np.int32) for part in (~large, large)]
    return [_build_blocks(geometry, frame, boxes, bounds, part) for part in parts if len(part)]


def _build_blocks(geometry: Geometry, frame: Frame, boxes: Floats, bounds: NDArray, some: Integers) -> SphereBlocks:
    """The tree of the spheres `some`, (k,), of which there is one at least."""
    level_count = int(np.log2(len(some) / BLOCK_SPHERES * np.sqrt(2))) if len(some) > BLOCK_SPHERES else 0
    order, starts = split_evenly(bounds.take(some, axis=1), level_count)
    count = np.diff(starts)
    slot = np.minimum(np.arange(count.max()), count[:, np.newaxis] - 1)
    items = some.take(order).take(starts[:-1, np.newaxis] + slot)  # (b, k)
    rows = pack_quadrics(
        frame.place(geometry.centres.take(items, axis=0)), times_power(geometry.radii.take(items), frame.exponent)
    )
    rows[count < items.shape[1], -1] = np.nan  # blocks differ in size by one at most
    placed = frame.place(boxes).take(items, axis=0)  # (b, k, 2, 3)
    return SphereBlocks(make_levels(placed[:, :, 0].min(axis=1), placed[:, :, 1].max(axis=1)), items, rows)


def pack_quadrics(centre: Floats, radius: Floats) -> Floats:
    """Rows (..., 10) of spheres (..., 3) and (...) in the frame."""
    x, y, z = np.moveaxis(centre, -1, 0)
    square = radius * radius
    columns = [y * y + z * z - square, z * z + x * x - square, x * x + y * y - square]
    columns += [-2 * y * z, -2 * z * x, -2 * x * y, -2 * x, -2 * y, -2 * z, np.ones_like(x)]
    return np.stack(columns, axis=-1)


class SphereRays:
    """What n rays and a last one, that meets nothing, have for spheres.

    rows : (n + 1, 10) float64
    """

    def __init__(self, count: int) -> None:
        self.rows = np.empty((count + 1, QUADRIC_COLUMNS))
        self.rows[count] = np.nan

    def fill(self, part: slice, rays: FramedRays) -> None:
        """Fill in the rows of some rays."""
        direction, moment = rays.direction, cross(rays.origin, rays.direction)
        rows = self.rows[part]
        rows[:, :3] = (direction * direction).T
        for column, (j, k) in enumerate(((1, 2), (2, 0), (0, 1)), start=3):
            np.multiply(direction[j], direction[k], out=rows[:, column])
        rows[:, 6:9] = cross(direction, moment).T
        size = largest_row(np.abs(moment))
        moved = PLACED * (1 + 3 * largest_row(np.abs(rays.origin)))
        tolerance = 6 * moved + 3 * moved * moved + TERMS * (15 + 12 * size + 3 * size * size)
        rows[:, 9] = dot(moment, moment) - tolerance
        # Nothing is known of what overflows: all may be met.
        rows[~np.isfinite(tolerance)] = (0, 0, 0, 0, 0, 0, 0, 0, 0, -1)


def meet_spheres(spheres: Floats, rays: Floats) -> NDArray[np.intp]:
    """Which spheres lines may meet, as places in (p, k, l), of rows (p, k, 10) and (p, l, 10)."""
    # False for NaN: what fills up is never met.
    return np.flatnonzero(np.matmul(spheres, rays.transpose(0, 2, 1)) <= 0)


def walk_spheres(
    tree: SphereBlocks, spheres: SphereRays, rays: DenseRays, best: NDArray[np.float32], decisions: PlaneDecisions
) -> None:
    """Offer the query all spheres of a tree that rays may meet; lowers `best`."""

    def decide(ray: Indices, sphere: Indices, inside: Booleans) -> None:
        changed = decisions.offer(ray, sphere + decisions.query.primitives.geometry.sphere_id)
        best[changed] = to_ray_bounds(decisions.best.take(changed), rays.way.take(changed))

    meet = partial(_meet_blocks, tree, spheres)
    walk = Walk(tree, rays, best, decisions.query.any_hit, meet, decide)
    walk.run(walk.enter_root())


def _meet_blocks(
    tree: SphereBlocks, rays: SphereRays, node: Indices, ray: Indices
) -> tuple[NDArray[np.intp], Booleans]:
    index = meet_spheres(tree.rows.take(node, axis=0), rays.rows.take(ray, axis=0))
    return index, np.zeros(len(index), bool)
