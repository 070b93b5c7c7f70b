"""How much of what is around a point is open: the rays of the Ambient Occlusion node.

References
----------
Blender, intern/cycles/kernel/svm/ao.h: what the rays are, and where there are none.
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.types import Floats
from raytracer.arrays.vectors import to_world
from raytracer.sampling.sampler import number_branches
from raytracer.sampling.warps import sample_cosine_hemisphere
from raytracer.shading.probes import Probe
from raytracer.surfaces.departing import depart


def find_open(probe: Probe, normal: Floats, reach: Floats, count: int, own: bool) -> Floats:
    """Return the share (n,) of `count` rays, with density cos / pi around a normal, that nothing blocks.

    normal : (n, 3) unit; reach : (n,) metres, 0 or less is open; own : only the point's own object counts
    """
    rows = np.flatnonzero((reach > 0) & normal.any(axis=1))
    surface, blocked = probe.surface.select(rows), np.zeros(len(rows))
    for branch in number_branches(probe.sampler.select(rows), count if len(rows) else 0):
        directions = to_world(sample_cosine_hemisphere(branch.uniform_pair()), normal[rows])
        rays = depart(surface, directions, reach[rows])
        blocked += probe.caster.is_blocked(rays, surface.instance if own else None)
    open_ = np.ones(len(reach))
    open_[rows] -= blocked / count
    return open_
