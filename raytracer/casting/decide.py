"""The candidates of one ray, decided in integers: the border between columns of rays and `predicates.exact`."""

from __future__ import annotations

import numpy as np

from raytracer.arrays.types import Floats
from raytracer.casting.geometry import Ids, Kind
from raytracer.casting.passed import Passed
from raytracer.casting.primitives import Primitives, gather_corners, gather_spheres
from raytracer.casting.rays import Rays
from raytracer.predicates import exact


def decide_exactly(
    primitives: Primitives, rays: Rays, t_min: Floats, passed: Passed | None, ray: int, primitive_id: Ids
) -> exact.ExactHit:
    """Return which of a ray's candidates (k,), sorted by key, is the closest hit, and where.

    t_min : (n,) of all rays
    passed : what they have left behind, or None where they start afresh
    """
    is_sphere = ~primitives.geometry.is_kind(primitive_id, Kind.TRIANGLE)
    rank = np.argsort(is_sphere, kind="stable")  # triangles come first there
    primitive_id, triangles = primitive_id[rank], len(rank) - int(is_sphere.sum())
    corners = gather_corners(primitives, primitive_id[:triangles]).T.reshape(-1, 3, 3)
    centre, radius = gather_spheres(primitives, primitive_id[triangles:])
    decision = exact.closest_candidate(
        rays.origins[ray].tolist(),
        rays.directions[ray].tolist(),
        float(t_min[ray]),
        float(rays.t_max[ray]),
        corners,
        np.vstack([centre, radius]).T,
        rank.tolist(),
        exact.NOTHING_BEHIND if passed is None else passed.describe(ray, primitive_id),
    )
    return decision if decision.chosen < 0 else decision._replace(chosen=int(rank[decision.chosen]))
