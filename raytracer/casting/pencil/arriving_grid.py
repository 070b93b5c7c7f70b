"""Rays that arrive at one point, drawn on as if they left it: shadow rays to a point, of which any hit will do.

A ray from o towards the point c passes it at a distance of at most `spread` in every coordinate. Seen from c, where it
is at h_z it is beside its image point by no more than 2^-22 of the image as long as h_z is not below `View.blurred`:
that counts as an error of the ray. No hit is nearer than that where no triangle comes near the point (`come_near`), for
a ray's point with a smaller h_z is within half of that radius.

Along the ray h_z falls from `depth` at the origin to 0. A triangle of nearness w, inside whose image the ray stays, is
met between them beyond doubt if

    1 / depth  <  w  <  1 / max(h_z(t_max), blurred)

at all its points, for then the ray is behind its plane at its start and before it at the other end. h_z(t) is off by a
few u of the depth and by |A| spread, together by less than 2^-22 of what is not below `blurred`, 2^-28 of the depth.
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.types import Floats
from raytracer.casting.pencil.clusters import Clusters
from raytracer.casting.pencil.grids import RANGE_SLACK, limit_nearness
from raytracer.casting.pencil.pencil import View
from raytracer.casting.pencil.strip_grid import StripGrid

# How far rays are beside their image points, as a share of half the image, where they are not blurred.
BESIDE = 2.0**-22


class ArrivingGrid(StripGrid):
    """As StripGrid, of rays that begin at t = 0.

    depth : (n,) float64, h_z of each ray's origin
    blurred : least h_z that a hit may have
    """

    def __init__(self, view: View) -> None:
        super().__init__(view)
        self.depth, self.blurred = view.depth, view.blurred
        self.ray_error += BESIDE * max(self.wide, self.high) / 2

    def set_ranges(self, t_min: Floats, best: Floats) -> None:
        with np.errstate(all="ignore"):
            limit = limit_nearness(self.depth, np.ones(len(best)))
            self.limit = self.spread(np.where(best < t_min, np.float32(np.inf), limit))
            end = np.maximum(self.depth + self.step * best, self.blurred)
            self.ceiling = self.spread(((1 - RANGE_SLACK) / end).astype(np.float32))


def come_near(clusters: Clusters, view: View) -> bool:
    """True if a triangle's box comes so near to the point of an arriving pencil that rays may be blurred there.

    A ray's point p with h_z below `blurred` has |h| below that and a share more: |p - c| <= |A^-1| |h|. Twice that
    covers the share and the roundings of both.
    """
    radius = 2.0 * view.blurred * float(np.abs(np.linalg.inv(view.matrix)).sum(axis=1).max())
    near = np.flatnonzero((np.abs(clusters.centre - view.centre) <= clusters.half + radius).all(axis=1))
    corners = clusters.vertices[:, clusters.corners[near]] - view.centre[:, np.newaxis, np.newaxis, np.newaxis]
    low, high = corners.min(axis=2), corners.max(axis=2)  # (3, k, CLUSTER)
    return bool(((low <= radius) & (high >= -radius)).all(axis=0).any())
