"""What programs of materials, lights and worlds can ask of the rays that lead to them (`light_path`)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from raytracer.arrays.types import Floats
from raytracer.bsdfs.bounce_kinds import describe_kinds
from raytracer.casting.rays import Hits
from raytracer.integrator.integrator import Integrator
from raytracer.integrator.paths import Paths
from raytracer.lecture import length
from raytracer.sampling.sampler import Sampler
from raytracer.shading.light_path import LightPath
from raytracer.shading.probes import Probe
from raytracer.surfaces.surface import Surface


def describe_path(
    integrator: Integrator, paths: Paths, hits: Hits, surface: Surface, sampler: Sampler
) -> LightPath | None:
    """Return what programs of materials can ask of the rays; None where there are no programs.

    sampler : of the batch's rays
    """
    if integrator.materials.computed is None:
        return None
    path = describe_rays(paths, hits.distance)
    if integrator.program_caster is None or integrator.dimensions.programs is None:
        return path
    own = sampler.select(paths.row).skip(integrator.dimensions.programs)
    return replace(path, probe=Probe(surface, integrator.program_caster, own, 1, paths.rarest))


def describe_rays(paths: Paths, distance: Floats | float) -> LightPath:
    """Return what programs can ask of rays that go for a distance (n,), in units of their directions' lengths."""
    unit = length(paths.rays.directions)
    travelled = distance * unit
    return LightPath(
        {
            **describe_kinds(paths.kind, paths.bounces),
            # From the last bounce, or the camera's near clip, also where the ray has passed surfaces straight.
            "length": travelled - paths.rays.t_min * unit,
            "travelled": travelled,
            "transparent_depth": paths.passages.astype(np.float64),
            **({} if paths.portals is None else {"portal_depth": paths.portals.astype(np.float64)}),
        }
    )
