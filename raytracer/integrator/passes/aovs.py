"""Passes that shaders write themselves (AOVs): the sum of what surfaces write, up to the first opaque one.

As in Cycles, surfaces that the ray goes straight through write as well, and what is behind them is added, in the share
of light that they let through. (Cycles adds it whole where chance lets a path through, which is the same on average.)
Alpha of a color counts the surfaces that write it. Where the world is seen, it writes, if it is part of the picture.

References
----------
Blender, intern/cycles/kernel/svm/aov.h and film/aov_passes.h.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from raytracer.arrays.rows import mean_column
from raytracer.arrays.types import Floats
from raytracer.casting.rays import Hits
from raytracer.integrator.integrator import Integrator
from raytracer.integrator.path_passes import PathPasses
from raytracer.integrator.paths import Paths
from raytracer.integrator.ray_descriptions import describe_rays
from raytracer.lights.sky_aovs import list_written_by_sky
from raytracer.sampling.dimensions import AOV_BEVEL_DIMENSION, AOV_DIMENSION
from raytracer.sampling.sampler import Sampler
from raytracer.shading.aovs import list_written
from raytracer.shading.computed import bend_normals
from raytracer.shading.light_path import FARTHEST, put_further
from raytracer.shading.probes import Probe
from raytracer.surfaces.surface import Surface


def add_surface_aovs(
    integrator: Integrator, passes: PathPasses, paths: Paths, hits: Hits, surface: Surface, sampler: Sampler
) -> None:
    """Add what surfaces write that paths have met on their straight way; sampler : of the batch's rays."""
    if integrator.aovs is None:
        return
    rows = np.flatnonzero(paths.direct & ~passes.found[paths.row])
    paths, surface = paths.select(rows), surface.select(rows)
    path = describe_rays(paths, hits.distance[rows])
    if integrator.program_caster is not None:
        own = replace(sampler.select(paths.row), dimension=AOV_DIMENSION)
        bevel = AOV_BEVEL_DIMENSION - AOV_DIMENSION
        path = replace(path, probe=Probe(surface, integrator.program_caster, own, bevel, paths.rarest))
    if integrator.materials.computed is not None:
        surface = bend_normals(integrator.materials.computed, surface, path)
    for name, points, values in list_written(integrator.aovs, surface, path):
        add_written(passes, name, paths.select(points), values)


def add_sky_aovs(integrator: Integrator, passes: PathPasses, paths: Paths, hits: Hits) -> None:
    """Add what the world writes where paths that hit nothing see it straight."""
    if integrator.sky_aovs is None or integrator.settings.transparent:
        return
    paths = paths.select(np.flatnonzero(~hits.hit & paths.direct & ~passes.found[paths.row]))
    path = put_further(describe_rays(paths, FARTHEST))
    for name, values in list_written_by_sky(integrator.sky_aovs, paths.rays.directions, path):
        add_written(passes, name, paths, values)


def add_written(passes: PathPasses, name: str, paths: Paths, values: Floats) -> None:
    """Add values (k, 1) or (k, 3) that are written where paths have come to."""
    share = mean_column(paths.throughput)
    passes.add(name, paths.row, values * share[:, np.newaxis])
    if values.shape[1] == 3:
        passes.values[name][paths.row, 3] += share
