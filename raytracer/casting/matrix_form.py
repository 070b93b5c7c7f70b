"""Candidates among a few dozen triangles: all edge functions of all rays as one matrix product.

With Pluecker coordinates of the ray, (d, m) with moment m = o x d, the edge function of a line through p and q is

    E(p, q) = d . ((p - o) x (q - o)) = d . (p x q) + m . (q - p),

six products a triangle's edge and ray (K. Shoemake, "Pluecker coordinate tutorial", Ray Tracing News, 1998). In
float32, in the scene's frame, coordinates are at most 1 and in every component |p x q| <= 2, |q - p| <= 2, |d| <= 1 and
|m| <= 2 |o|: E is off by at most gamma32(8) (3 * 2 + 3 * 2 * 2 |o|), and what is outside by more is dropped. Distances
of the pairs that are left are float64; a certain hit that is a ray's only candidate is settled, the rest decided by
`search`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats
from raytracer.casting.bvh.tree import make_frame
from raytracer.casting.primitives import Primitives, gather_corners
from raytracer.casting.query import Search
from raytracer.predicates.filtered import UNDERFLOW, cross, dot
from raytracer.predicates.rounding import UNIT_ROUNDOFF, gamma

FLOAT32_ROUNDOFF = 2.0**-24
# Edge functions held at a time: they stay in the cache.
BLOCK_VALUES = 1 << 18
# Candidates offered at a time.
OFFER_PAIRS = 1 << 14


class MatrixForm:
    """Offers a search the triangles that rays may hit, found by a product, and every sphere."""

    def __init__(self, primitives: Primitives) -> None:
        count = primitives.geometry.sphere_id
        self.frame = make_frame(*primitives.bounds)
        corners = gather_corners(primitives, np.arange(count)).reshape(3, 3, count).astype(np.float64, copy=False)
        corners = np.ldexp(corners - self.frame.centre[:, np.newaxis], self.frame.exponent)
        pairs = [(corners[1], corners[2]), (corners[2], corners[0]), (corners[0], corners[1])]
        edges = [np.concatenate([cross(p, q), q - p]).T for p, q in pairs]
        self.edges = np.concatenate(edges).astype(np.float32)  # (3 t, 6)
        self.planes = make_planes(corners)  # (t, 7)
        self.sphere_ids = np.arange(count, primitives.geometry.first_id[-1])

    @np.errstate(all="ignore")
    def __call__(self, search: Search) -> None:
        """Offer a search all primitives that its rays may hit."""
        size = max(256, BLOCK_VALUES // max(1, len(self.edges)))
        rest = [(np.zeros(0, np.intp), np.zeros(0, np.int64))]
        for start in range(0, len(search.rays), size):
            block = slice(start, min(start + size, len(search.rays)))
            if len(self.edges):
                rest.append(self._find_candidates(search, block))
            if len(self.sphere_ids):
                ray = np.arange(block.start, block.stop)
                rest.append((np.repeat(ray, len(self.sphere_ids)), np.tile(self.sphere_ids, len(ray))))
        # Together: a call costs more than the few candidates of a block.
        ray, primitive_id = (np.concatenate(column) for column in zip(*rest, strict=True))
        for start in range(0, len(ray), OFFER_PAIRS):
            search.offer(ray[start : start + OFFER_PAIRS], primitive_id[start : start + OFFER_PAIRS])

    def _find_candidates(self, search: Search, block: slice) -> tuple[NDArray[np.intp], NDArray[np.int64]]:
        """Settle what is certain among the rays of a block; return the other pairs of ray and triangle."""
        origin = np.ldexp(search.rays.origins[block] - self.frame.centre, self.frame.exponent).T
        direction = search.rays.directions[block].T
        length = np.frexp(np.maximum(np.maximum(*np.abs(direction[:2])), np.abs(direction[2])))[1]
        direction = np.ldexp(direction, -length)
        triangle, lane, inside = self._find_pairs(origin, direction)
        if not search.narrows:
            return lane + block.start, triangle
        planes = self.planes.take(triangle, axis=0).T
        t, error = meet_planes(planes, origin.take(lane, axis=1), direction.take(lane, axis=1))
        unit = -(self.frame.exponent + length[lane])
        low, high = np.ldexp(t - error, unit) - UNDERFLOW, np.ldexp(t + error, unit) + UNDERFLOW
        ray = lane + block.start
        possible = np.flatnonzero(~((high < search.t_min[ray]) | (low > search.best[ray])))
        ray, triangle, low, high = ray[possible], triangle[possible], low[possible], high[possible]
        certain = inside[possible] & (low >= search.t_min[ray]) & (high <= search.best[ray])
        if not search.any_hit:
            best = search.best[block].copy()
            np.minimum.at(best, ray[certain] - block.start, high[certain])
            near = np.flatnonzero(~(low > best[ray - block.start]))
            ray, triangle, certain = ray[near], triangle[near], certain[near]
            alone = np.bincount(ray - block.start, minlength=len(best))[ray - block.start] == 1
            certain &= alone & (len(self.sphere_ids) == 0)
        search.settle(ray[certain], triangle[certain])
        rest = np.flatnonzero(~certain & (search.best[ray] > -np.inf))
        return ray[rest], triangle[rest]

    def _find_pairs(self, origin: Floats, direction: Floats) -> tuple[NDArray, NDArray, NDArray]:
        """Triangles and rays, by index, whose line may pass inside, and whether it certainly does."""
        lines = np.concatenate([direction, cross(origin, direction)]).astype(np.float32)
        edges = (self.edges @ lines).reshape(3, -1, lines.shape[1])
        highest = np.maximum(np.maximum(edges[0], edges[1]), edges[2])
        lowest = np.minimum(np.minimum(edges[0], edges[1]), edges[2])
        farthest = np.maximum(np.maximum(*np.abs(origin[:2])), np.abs(origin[2]))
        tolerance = (gamma(9, FLOAT32_ROUNDOFF) * (6 + 12 * farthest)).astype(np.float32)
        pair = np.flatnonzero(~((highest > tolerance) & (lowest < -tolerance)))
        triangle, lane = np.divmod(pair, lines.shape[1])
        tolerance = tolerance[lane]
        inside = (lowest.ravel()[pair] > tolerance) | (highest.ravel()[pair] < -tolerance)
        return triangle, lane, inside


def make_planes(corners: Floats) -> Floats:
    """(t, 7) normal N scaled to a largest component of 1, corner a, and a bound e on the roundings that N brings, of
    corners (3, 3, t) in the frame.

    A corner in the frame is off by u, so a side of at most s by u (2 + s); a component of N, two products of sides and
    their difference, by 8 u s (1 + s), of which 9 covers the second order. Scaling adds u; `meet_planes` adds up to
    5 u |N| where it multiplies by N.
    """
    side_b, side_c = corners[1] - corners[0], corners[2] - corners[0]
    normal = cross(side_b, side_c)
    with np.errstate(all="ignore"):
        size = np.abs(normal).max(axis=0)
        extent = np.maximum(np.abs(side_b).max(axis=0), np.abs(side_c).max(axis=0))
        error = UNIT_ROUNDOFF * (9 * extent * (1 + extent) / size + 7)
        return np.stack([*(normal / size), *corners[0], error], axis=1)


def meet_planes(planes: Floats, origin: Floats, direction: Floats) -> tuple[Floats, Floats]:
    """t = T / D with T = w . N, w = a - o, D = d . N of planes (7, k) in the frame, and a bound on its error; infinite
    where there is none.

    w is off by u (1 + |o|) + u |w|, so T by |w|_1 e + 4 u (1 + |o|), where |.|_1 sums components and |o| is the
    largest; D by 3 e, as |d| <= 1; and the quotient by (e_T + |t| e_D) / (|D| - e_D) + u |t|.
    """
    normal, error = planes[:3], planes[6]
    way = planes[3:6] - origin
    denominator = dot(direction, normal)
    t = dot(way, normal) / denominator
    steps = np.abs(way)
    farthest = np.maximum(np.maximum(*np.abs(origin[:2])), np.abs(origin[2]))
    room = np.abs(denominator) - 3 * error
    bound = (steps[0] + steps[1] + steps[2] + 4 * np.abs(t)) * error + 4 * UNIT_ROUNDOFF * (1 + farthest)
    return t, np.where(room > 0, bound / room, np.inf)
