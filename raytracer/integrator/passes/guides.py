"""How far the paths of rays are from the surface that tells a denoiser what is seen (`denoising`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from raytracer.arrays.types import Booleans, Floats


@dataclass(eq=False)
class Guides:
    """Of n rays, the way to the first surface that is not like a mirror.

    searching : (n,) bool, True until the path has met that surface
    share : (n, 3) float64, the product of the colors of what it has met before
    """

    searching: Booleans
    share: Floats


def start_guides(count: int) -> Guides:
    """Return the record of n rays that have met nothing."""
    return Guides(np.ones(count, dtype=np.bool_), np.ones((count, 3)))
