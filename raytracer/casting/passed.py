"""What rays have left behind, and which candidates count nevertheless.

Most candidates lie beyond all that beyond doubt, and no more than a comparison is spent on them. Of the others, what
shares a corner, an edge or a plane with what was met last lies at exactly the same distance and is told apart by its
key; the rest is left to integers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.casting.geometry import Ids, join_id, split_id
from raytracer.casting.order import STOPPING, Order, SortKeys, no_departure
from raytracer.casting.primitives import Primitives, gather_corners, gather_spheres
from raytracer.casting.rays import Hits, Rays
from raytracer.predicates import exact


class Verdict(NamedTuple):
    """Of k candidates: which certainly do not count, and which are in doubt."""

    out: Booleans
    doubtful: Booleans


class Passed:
    """What n rays have met last, and the places that they start from.

    met : (n,) int64, the primitive met last; -1 where none
    low, high : (n,) float64, certified interval around its distance; -inf where none
    gate : (n,) float64, what certainly lies beyond counts
    """

    def __init__(self, primitives: Primitives, rays: Rays, order: Order | None) -> None:
        self.primitives = primitives
        self.rays = rays
        self.order = order
        count = len(rays)
        self.met = np.full(count, -1, np.int64)
        self.low, self.high = np.full(count, -np.inf), np.full(count, -np.inf)
        if rays.after is not None:
            rows = np.flatnonzero(rays.after.hit)
            hits = rays.after.select(rows)
            self.met[rows] = join_id(primitives.geometry, hits.instance, hits.primitive)
            self.low[rows], self.high[rows] = bound_distances(hits)
        self.departure = rays.departure or no_departure(count)
        self.gate = np.maximum(self.high, self.departure.reach)

    def leave_out_met(self, ray: Indices, primitive_id: Ids) -> tuple[Indices, Ids]:
        """Return the candidates but for the triangles that their rays have met last: a line meets each once."""
        fresh = (primitive_id != self.met.take(ray)) | (primitive_id >= self.primitives.geometry.sphere_id)
        index = np.flatnonzero(fresh)
        return ray.take(index), primitive_id.take(index)

    def find_keys(self, ray: Indices, primitive_id: Ids) -> SortKeys:
        """Return the keys (k,) of primitives as rays meet them."""
        return find_keys(self.primitives, self.order, self.rays.directions.take(ray, axis=0), primitive_id)

    def find_later(self, ray: Indices, primitive_id: Ids) -> Booleans:
        """Return (k,) True for candidates that, at the same distance, come after what was met last."""
        return self.find_keys(ray, primitive_id) > self.find_keys(ray, self.met[ray])

    def find_barred(self, ray: Indices, primitive_id: Ids) -> Booleans:
        """Return (k,) True for candidates that do not count at the place where their ray starts."""
        if self.order is None:
            return np.ones(len(ray), dtype=np.bool_)
        directions = self.rays.directions.take(ray, axis=0)
        where = split_id(self.primitives.geometry, primitive_id)
        key = self.order.find_keys(directions, *where)
        barred = key <= self.departure.key[ray]
        stopping = np.flatnonzero(key >= STOPPING)
        approach = self.departure.approach.take(ray[stopping], axis=0)
        instance, primitive = (part[stopping] for part in where)
        barred[stopping] = ~self.order.find_crossed(directions[stopping], approach, instance, primitive)
        return barred

    def judge(self, ray: Indices, primitive_id: Ids, low: Floats, high: Floats, level: Booleans | None) -> Verdict:
        """Judge k candidates that may lie before the gate.

        low, high : (k,) interval of their distance; a point in plain precisions
        level : (k,) True where the distance is exactly that of what was met last; None where numbers tell
        """
        if level is None:
            level = low == self.high[ray]
            out, doubtful = low < self.low[ray], np.zeros(len(ray), dtype=np.bool_)
        else:
            out, doubtful = high < self.low[ray], ~level & (low <= self.high[ray])
        rows = np.flatnonzero(level)
        if len(rows):
            out[rows] |= ~self.find_later(ray[rows], primitive_id[rows])
        rows = np.flatnonzero(low <= self.departure.reach[ray])
        if len(rows):
            barred = self.find_barred(ray[rows], primitive_id[rows])
            here = high[rows] <= self.departure.reach[ray[rows]]
            out[rows] |= barred & here
            doubtful[rows] |= barred & ~here
        return Verdict(out, doubtful)

    def find_left(self, ray: Indices, primitive_id: Ids, near: Floats, error: Floats, far: Floats) -> Booleans:
        """Return (k,) True for spheres whose near root does not count, so that the far one is next."""
        own = primitive_id == self.met[ray]
        left = own & (near - error <= self.high[ray]) & ~(far - error <= self.high[ray])
        if self.primitives.precision != "certified":
            left |= near < self.low[ray]
            rows = np.flatnonzero(near == self.high[ray])
            left[rows] |= ~self.find_later(ray[rows], primitive_id[rows])
        rows = np.flatnonzero(near + error <= self.departure.reach[ray])
        left[rows] |= self.find_barred(ray[rows], primitive_id[rows])
        return left

    def describe(self, ray: int, primitive_id: Ids) -> exact.Behind:
        """Return what lies behind one ray, for its candidates."""
        rays = np.full(len(primitive_id), ray)
        reach, last = float(self.departure.reach[ray]), self.met[ray : ray + 1]
        corners, spheres, later = np.zeros((0, 3, 3)), np.zeros((0, 4)), np.zeros(len(rays), dtype=np.bool_)
        if 0 <= last[0] < self.primitives.geometry.sphere_id:
            corners = gather_corners(self.primitives, last).T.reshape(-1, 3, 3).astype(np.float64)
        elif last[0] >= 0:
            centre, radius = gather_spheres(self.primitives, last)
            spheres = np.vstack([centre, radius]).T.astype(np.float64)
        if last[0] >= 0:
            later = self.find_later(rays, primitive_id)
        barred = self.find_barred(rays, primitive_id) if reach >= 0 else later
        return exact.Behind(
            corners, spheres, float(self.high[ray]), later.tolist(), reach, barred.tolist() if reach >= 0 else ()
        )


def find_keys(primitives: Primitives, order: Order | None, directions: Floats, primitive_id: Ids) -> SortKeys:
    """Return the keys (k,) of primitives as rays of directions (k, 3) meet them: without an order, their ids."""
    if order is None:
        return primitive_id
    return order.find_keys(directions, *split_id(primitives.geometry, primitive_id))


def bound_distances(hits: Hits) -> tuple[Floats, Floats]:
    """Return the least and the largest t (n,) that hits may have; in plain precisions both are what was computed."""
    error = hits.distance_error
    low = np.where(np.isnan(error), hits.distance, np.nextafter(hits.distance - error, -np.inf))
    high = np.where(np.isnan(error), hits.distance, np.nextafter(hits.distance + error, np.inf))
    return low, high
