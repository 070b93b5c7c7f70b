"""Rays that certainly pass the box around a scene, which no accelerator needs to look at.

Along axis k the ray is between the box's sides from t = (low_k - o_k) / d_k to (high_k - o_k) / d_k, or the other way
round: it enters the box at the largest of the smaller three, and leaves it at the smallest of the larger three. Each
quotient has three roundings, the product with an inverse included, and the right sign. So a ray that meets the box at
0 <= t, entry <= exit, has a computed exit that is not negative and a computed

    entry <= entry (1 + gamma(3)) <= exit (1 + gamma(3)) <= exit (1 + gamma(3)) / (1 - gamma(3)) < exit SLACK,

where SMALLEST covers what underflows. A direction of 0 along an axis gives infinities of the right signs, or NaN on a
side itself, which `maximum` and `minimum` pass on and which never passes. Rays with numbers out of LARGEST are taken to
meet the box.
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.predicates.rounding import gamma

SLACK, SMALLEST, LARGEST = 1 + gamma(8), 2.0**-900, 2.0**500
# Rays looked at first, to see whether it is worth while to look at all, and the least share that must pass: to look at
# a ray costs 25 ns, to pick one 16; one that is left out saves 190, for its preparation and the root's boxes.
TRIED_RAYS, LEAST_SHARE = 512, 0.25
# Rays looked at together: what they need fits the cache.
BLOCK = 1 << 12


def find_meeting(box: Floats, origins: Floats, directions: Floats) -> Indices | None:
    """Return the ascending rows of rays (n, 3) that may meet a box (2, 3) at t >= 0, directions not zero; None where
    nearly all may."""
    step = len(origins) // TRIED_RAYS + 1
    if np.mean(may_meet(box, origins[::step], directions[::step])) > 1 - LEAST_SHARE:
        return None
    parts = [slice(start, start + BLOCK) for start in range(0, len(origins), BLOCK)]
    return np.concatenate([may_meet(box, origins[part], directions[part]) for part in parts]).nonzero()[0]


@np.errstate(all="ignore")
def may_meet(box: Floats, origins: Floats, directions: Floats) -> Booleans:
    """(n,) False for rays (n, 3), n >= 1, that certainly pass a box (2, 3)."""
    inverse = 1 / directions.T
    low, high = ((side[:, np.newaxis] - origins.T) * inverse for side in box)
    entry, leave = np.minimum(low, high), np.maximum(low, high)
    first = np.maximum(np.maximum(entry[0], entry[1]), entry[2])
    last = np.minimum(np.minimum(leave[0], leave[1]), leave[2])
    passes = first > last * SLACK + SMALLEST
    passes |= last < 0
    size = np.abs(inverse)
    if max(np.abs(box).max(), np.abs(origins).max(), size.max()) > LARGEST or size.min() < 1 / LARGEST:
        extreme = ((size > LARGEST) & (directions.T != 0)) | (size < 1 / LARGEST) | (np.abs(origins.T) > LARGEST)
        passes &= ~extreme.any(axis=0) & (np.abs(box).max() <= LARGEST)
    return ~passes
