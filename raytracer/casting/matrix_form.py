"""Candidates among a few dozen triangles: all edge functions of all rays as one matrix product.

With Pluecker coordinates of the ray, (d, m) with moment m = o x d, the edge function of a line through p and q is

    E(p, q) = d . ((p - o) x (q - o)) = d . (p x q) + m . (q - p),

six products a triangle's edge and ray (K. Shoemake, "Pluecker coordinate tutorial", Ray Tracing News, 1998). In
float32, in the scene's frame, coordinates are at most 1 and in every component |p x q| <= 2, |q - p| <= 2, |d| <= 1 and
|m| <= 2 |o|: E is off by at most gamma32(8) (3 * 2 + 3 * 2 * 2 |o|), and what is outside by more is dropped. Rays come
divided by that, so that signs are comparisons with one number. What is left is measured by `planes`, which settles most
of it; the rest is decided by `query`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats
from raytracer.casting.bvh.tree import make_frame
from raytracer.casting.dense.packets import cross_triangles
from raytracer.casting.framed import frame_rays, largest_row
from raytracer.casting.geometry import Kind
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


class MatrixForm:
    """Offers a query the triangles that rays may hit, found by a product, and every sphere."""

    def __init__(self, primitives: Primitives) -> None:
        count = primitives.geometry.sphere_id
        self.frame = make_frame(*primitives.bounds)
        corners = gather_corners(primitives, np.arange(count)).reshape(3, 3, count).astype(np.float64, copy=False)
        self.planes = make_planes(corners, self.frame.exponent)  # (t, 8)
        corners = np.ldexp(corners - self.frame.centre[:, np.newaxis], self.frame.exponent)
        pairs = [(corners[1], corners[2]), (corners[2], corners[0]), (corners[0], corners[1])]
        edges = [np.concatenate([cross(p, q), q - p]).T for p, q in pairs]
        self.edges = np.concatenate(edges).astype(np.float32)[np.newaxis]  # (1, 3 t, 6)
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
        """Have the pairs of rays and triangles that may be hits decided."""
        if not self.edges.size:
            return
        size = max(256, BLOCK_VALUES // self.edges.shape[1] // 64 * 64)
        decisions = PlaneDecisions(query, self.planes)
        for start in range(0, len(query.rays), size):
            block = slice(start, min(start + size, len(query.rays)))
            rays = frame_rays(self.frame, query.rays.origins[block], query.rays.directions[block])
            triangle, lane, inside = self._find_pairs(rays.origin, rays.direction)
            decisions.set_rays(block, rays)
            decisions.take_in(lane + start, triangle, inside)
        decisions.finish()

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
