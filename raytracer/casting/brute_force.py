"""Every triangle and sphere as a candidate of every ray: the slow twin that every accelerator is tested against."""

from __future__ import annotations

import numpy as np

from raytracer.casting.geometry import Kind
from raytracer.casting.query import Query

# Pairs per block: a few megabytes of corners, within the cache of one core.
BLOCK_PAIRS = 1 << 16


def offer_all(query: Query) -> None:
    """Offer all triangles and spheres to all rays, in blocks of rays."""
    ids = np.arange(query.primitives.geometry.kind_range(Kind.SPHERE)[1])
    if not len(ids):
        return
    step = max(1, BLOCK_PAIRS // len(ids))
    for start in range(0, len(query.rays), step):
        rays = np.arange(start, min(start + step, len(query.rays)))
        query.offer(np.repeat(rays, len(ids)), np.tile(ids, len(rays)))
