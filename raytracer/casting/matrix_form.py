"""Candidates among a few dozen triangles: all edge functions of all rays as one matrix product.

With Pluecker coordinates of the ray, (d, m) with moment m = o x d, the edge function of a line through p and q is

    E(p, q) = d . ((p - o) x (q - o)) = d . (p x q) + m . (q - p),

six products a triangle's edge and ray (K. Shoemake, "Pluecker coordinate tutorial", Ray Tracing News, 1998). In
float32, in the scene's frame, coordinates are at most 1 and in every component |p x q| <= 2, |q - p| <= 2, |d| <= 1 and
|m| <= 2 |o|: E is off by at most gamma32(8) (3 * 2 + 3 * 2 * 2 |o|), and what is outside by more is dropped. Rays come
divided by that, so that signs are comparisons with one number. What is left is measured by `planes`, which settles most
of it; the rest is decided by `query`. Where rays meet many triangles, most are settled before that, without a list of
what is left (`matrix_certain`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import take_rows
from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.casting.bvh.tree import make_frame
from raytracer.casting.dense.packets import cross_triangles
from raytracer.casting.framed import FramedRays, frame_rays, largest_row
from raytracer.casting.geometry import Kind
from raytracer.casting.matrix_certain import CertainForm
from raytracer.casting.planes import OFFER_PAIRS, PlaneDecisions, make_planes
from raytracer.casting.primitives import Primitives, gather_corners
from raytracer.casting.query import Query
from raytracer.predicates.filtered import cross
from raytracer.predicates.rounding import gamma

FLOAT32_ROUNDOFF = 2.0**-24
# Edge functions held at a time: they stay in the cache.
BLOCK_VALUES = 1 << 19
# Rays of a product: libraries share larger ones among threads, that wait for each other busily: 1.4 times the work.
PACKET = 256
# Rays brought to the frame together.
BLOCK_RAYS = 1 << 13
# What is certain of all pairs is looked at first (`matrix_certain`) with as many rays, if their lines meet so large a
# share of the triangles and planes: a pair less in the list saves 60 ns, each triangle or plane costs 1.3.
FEWEST_RAYS, MET_SHARE = 4096, 0.021


class MatrixForm:
    """Offers a query the triangles that rays may hit, found by a product, and every sphere."""

    def __init__(self, primitives: Primitives) -> None:
        count = primitives.geometry.sphere_id
        self.frame = make_frame(*primitives.bounds)
        corners = gather_corners(primitives, np.arange(count)).reshape(3, 3, count).astype(np.float64, copy=False)
        self.planes = make_planes(corners, self.frame.exponent)  # (t, 8)
        placed = np.ldexp(corners - self.frame.centre[:, np.newaxis], self.frame.exponent)
        pairs = [(placed[1], placed[2]), (placed[2], placed[0]), (placed[0], placed[1])]
        edges = [np.concatenate([cross(p, q), q - p]).T for p, q in pairs]
        self.edges = np.concatenate(edges).astype(np.float32)[np.newaxis]  # (1, 3 t, 6)
        sure = count and primitives.precision == "certified"
        self.certain = CertainForm(self.edges[0], corners, self.frame, self.planes) if sure else None
        self.sphere_ids = np.arange(*primitives.geometry.kind_range(Kind.SPHERE))

    @np.errstate(all="ignore")
    def __call__(self, query: Query) -> None:
        """Offer a query all primitives that its rays may hit."""
        # A triangle that is certainly hit may be settled if no sphere is left. In plain precisions nothing is certain
        # of spheres: what lies behind them still counts.
        steps = [self._offer_spheres, self._offer_triangles]
        for step in steps if query.certified else reversed(steps):
            step(query)

    def _offer_spheres(self, query: Query) -> None:
        """Offer all spheres to all rays."""
        size = OFFER_PAIRS // max(1, len(self.sphere_ids))
        for start in range(0, len(query.rays) if len(self.sphere_ids) else 0, size):
            ray = np.arange(start, min(start + size, len(query.rays)))
            query.offer(np.repeat(ray, len(self.sphere_ids)), np.tile(self.sphere_ids, len(ray)))

    def _offer_triangles(self, query: Query) -> None:
        """Settle what is certain; have the other pairs of rays and triangles that may be hits decided."""
        if not self.edges.size:
            return
        decisions = PlaneDecisions(query, self.planes, self.frame.exponent)
        size = max(256, BLOCK_VALUES // self.edges.shape[1] // 64 * 64)
        certain = self.certain
        if certain is None or not self._suits_certain(certain, query):
            for block in _cut(len(query.rays), size):
                self._decide(decisions, block)
        elif query.any_hit:
            for block in _cut(len(query.rays), BLOCK_RAYS):
                self._settle_any(certain, decisions, block)
        else:
            left = [self._settle_nearest(certain, decisions, block) for block in _cut(len(query.rays), BLOCK_RAYS)]
            index = np.flatnonzero(np.concatenate(left))
            for block in _cut(len(index), size):
                self._decide(decisions, index[block])
        decisions.finish()

    def _suits_certain(self, certain: CertainForm, query: Query) -> bool:
        """Whether looking at all pairs at once may be done, and is quicker than a list: by how many pairs some rays
        have."""
        if not query.narrows or query.passed is not None or query.t_min.any():
            return False
        if len(query.rays) < FEWEST_RAYS:
            return False
        some = np.arange(0, len(query.rays), len(query.rays) // PACKET)
        origins, directions = (rows.take(some, axis=0) for rows in (query.rays.origins, query.rays.directions))
        rays = frame_rays(self.frame, origins, directions)
        pairs = len(self._find_pairs(rays.origin, rays.direction)[0])
        return pairs > MET_SHARE * len(some) * (certain.count + len(certain.side_columns))

    def _settle_nearest(self, certain: CertainForm, decisions: PlaneDecisions, block: slice) -> Booleans:
        """Settle rays whose nearest hit is certain; return (k,) those that are to be decided."""
        query = decisions.query
        rays = frame_rays(self.frame, query.rays.origins[block], query.rays.directions[block])
        nearest = certain.find_nearest(rays, query.best[block] * rays.unit)
        settled = nearest.certain & decisions.are_usual(rays)
        left = ~(settled | nearest.free)
        for offered in query.pool:
            left[offered.ray[(offered.ray >= block.start) & (offered.ray < block.stop)] - block.start] = True
        settled &= ~left
        lane = np.flatnonzero(settled)
        decisions.settle(lane + block.start, nearest.row.take(lane))
        return left

    def _settle_any(self, certain: CertainForm, decisions: PlaneDecisions, block: slice) -> None:
        """Settle rays that certainly hit a triangle; have what is left of the others decided."""
        query = decisions.query
        rays = frame_rays(self.frame, query.rays.origins[block], query.rays.directions[block])
        occlusion = certain.find_any(rays, query.best[block] * rays.unit)
        ray = np.flatnonzero(occlusion.met)
        query.settle(ray + block.start, np.zeros(len(ray), np.int64))  # which of them stops the ray, nobody asks
        lane = np.flatnonzero(np.bincount(occlusion.lane, minlength=1))
        decisions.set_rays(lane + block.start, FramedRays(*(column.take(lane, axis=-1) for column in rays)))
        decisions.take_in(occlusion.lane + block.start, occlusion.row, occlusion.inside)

    def _decide(self, decisions: PlaneDecisions, ray: Indices | slice) -> None:
        """Have pairs of some of the query's rays decided."""
        some = decisions.query.rays
        rays = frame_rays(self.frame, take_rows(some.origins, ray), take_rows(some.directions, ray))
        triangle, lane, inside = self._find_pairs(rays.origin, rays.direction)
        decisions.set_rays(ray, rays)
        decisions.take_in(lane + ray.start if isinstance(ray, slice) else ray.take(lane), triangle, inside)

    def _find_pairs(self, origin: Floats, direction: Floats) -> tuple[NDArray, NDArray, Booleans]:
        """Triangles and rays, by index, whose line may pass inside, and whether it certainly does."""
        farthest = largest_row(np.abs(origin))
        scale = 1 / (gamma(9, FLOAT32_ROUNDOFF) * (6 + 12 * farthest))
        count = len(scale)
        lines = np.full((6, -(-count // PACKET) * PACKET), np.nan, np.float32)  # what fills up is never met
        np.multiply(direction, scale, out=lines[:3, :count], casting="same_kind")
        np.multiply(cross(origin, direction), scale, out=lines[3:, :count], casting="same_kind")
        index, inside = cross_triangles(self.edges, lines.T.reshape(-1, PACKET, 6))
        place, lane = np.divmod(index, PACKET)
        packet, triangle = np.divmod(place, self.edges.shape[1] // 3)
        return triangle, packet * PACKET + lane, inside


def _cut(count: int, size: int) -> list[slice]:
    return [slice(start, min(start + size, count)) for start in range(0, count, size)]
