"""Near misses: what bright light reflections come close to, and so might have met.

Within NEAR times the radius of a light a path has come near it, and had it met it, it would have seen so much. That is
what a picture may lack that has not met the light (`film.unmet`); where none comes near, as of a lake that mirrors
another part of the sky, it lacks nothing that matters.
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.rows import mean_column
from raytracer.casting.rays import Hits
from raytracer.film.unmet import NEAR
from raytracer.integrator.bounces import meet_lights
from raytracer.integrator.clamping import clamp_met
from raytracer.integrator.features import NARROW_DENSITY
from raytracer.integrator.integrator import Integrator
from raytracer.integrator.path_passes import PathPasses
from raytracer.integrator.paths import Paths
from raytracer.lecture import dot
from raytracer.lights.glints import Glint
from raytracer.sampling.warps import power_heuristic


def note_near_misses(integrator: Integrator, passes: PathPasses, paths: Paths, hits: Hits) -> None:
    """Note how much each ray's path would have seen of the brightest light that its reflections come near to."""
    if passes.near is None:
        return
    paths = paths.select(np.flatnonzero((paths.density > NARROW_DENSITY) & ~paths.direct))
    for glint in integrator.glints if len(paths) else ():
        some = paths
        if integrator.caustics is not None and glint.light is not None:
            some = paths.select(~integrator.caustics.leaves(glint.light, paths))
        note_near_miss(integrator, glint, passes, some)


def note_near_miss(integrator: Integrator, glint: Glint, passes: PathPasses, paths: Paths) -> None:
    """Note what paths that come near a light would have seen of it: as much as light sampling leaves to them.

    Samples of a light of the radius r at the distance t have the density t^2 / (pi r^2) at least, about its middle.
    """
    offset = np.broadcast_to(glint.centre, (len(paths), 3)) if glint.is_far else glint.centre - paths.scatter_origin
    along = dot(paths.rays.directions, offset)
    square = dot(offset, offset)
    near = (along > 0) & (square - along * along <= (NEAR * glint.radius) ** 2) if np.isfinite(glint.radius) else True
    rows = np.flatnonzero(near & meet_lights(paths.kind, glint.seen_by))
    if not len(rows):
        return
    sampled = square[rows] / (np.pi * glint.radius**2)
    share = power_heuristic(paths.density[rows], sampled)[:, np.newaxis]
    seen = clamp_met(integrator.settings, paths.bounces[rows], paths.throughput[rows] * share * glint.radiance)
    row = paths.row[rows]
    assert passes.near is not None
    passes.near[row] = np.maximum(passes.near[row], mean_column(seen))
