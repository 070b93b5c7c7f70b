"""Ambient Occlusion: the share of what is around a surface that is open, as far as a distance.

One ray of density cos / pi about the normal of a surface's diffuse parts, from each surface that the camera sees, in
the share that it covers; surfaces that are transparent let some of it through, as they do shadow rays.

References
----------
Blender, intern/cycles/kernel/integrator/shade_surface.h: integrate_surface_ao; surface_shader.h: surface_shader_ao.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from raytracer.arrays.rows import take_rows
from raytracer.arrays.vectors import to_world
from raytracer.casting.rays import Rays
from raytracer.integrator.bounces import find_closed, find_finished
from raytracer.integrator.integrator import Integrator, find_lift
from raytracer.integrator.path_passes import PathPasses
from raytracer.integrator.paths import Wave
from raytracer.integrator.shadow_rays import Shadows
from raytracer.sampling.dimensions import OCCLUSION_DIMENSION
from raytracer.sampling.sampler import Sampler
from raytracer.sampling.warps import sample_cosine_hemisphere
from raytracer.scene.fields import SEEN_BY
from raytracer.shading.light_path import Depths
from raytracer.surfaces.departing import depart


def add_open_share(integrator: Integrator, passes: PathPasses, wave: Wave, sampler: Sampler) -> None:
    """Add what is open around surfaces that paths may go on from; sampler : of the wave's paths."""
    if "Ambient Occlusion" not in passes.values:
        return
    ended = find_finished(integrator, wave.paths) | find_closed(integrator, wave.paths)
    rows = np.flatnonzero(wave.paths.direct & ~ended)
    if not len(rows):
        return
    numbers = replace(sampler.select(rows), shared=None, dimension=OCCLUSION_DIMENSION)
    paths = wave.paths.select(rows)
    shadows = Shadows(
        aim_around(integrator, wave, rows, numbers),
        Depths(paths.passages, paths.bounces if integrator.tells_paths else None),
        np.zeros(len(rows), dtype=np.bool_),
        np.full(len(rows), SEEN_BY["shadow"], dtype=np.uint8),
    )
    covered = paths.throughput * (1.0 - take_rows(wave.shading.passage, rows))
    passes.add("Ambient Occlusion", paths.row, covered * integrator.visibility(shadows))


def aim_around(integrator: Integrator, wave: Wave, rows: np.ndarray, sampler: Sampler) -> Rays:
    """Return a ray from each surface at `rows`, which start where shadow rays to a light there would."""
    shading, surface = wave.shading, wave.surface.select(rows)
    around = take_rows(shading.average_diffuse_normal(), rows)
    direction = to_world(sample_cosine_hemisphere(sampler.uniform_pair()), around)
    lift = find_lift(integrator)
    if lift is not None:
        normal, geometric = take_rows(shading.normal, rows), take_rows(shading.geometric_normal, rows)
        lifted = lift(surface, slice(None), normal, geometric, direction)
        position = surface.position.copy("K")
        position[lifted.rows] += lifted.offset
        surface = replace(surface, position=position)
    return depart(surface, direction, np.full(len(rows), integrator.settings.occlusion_distance))
