"""The light loop: what every source sends to shading points, and what they reflect of it, before shadow rays are cast.

`light_sources` samples the sources, `shadow_rays` casts. A source that reflected rays can also meet is sampled in both
ways, weighed by the power heuristic.
"""

from __future__ import annotations

import dataclasses
from dataclasses import replace

import numpy as np

from raytracer.arrays.rows import any_column, take_rows
from raytracer.arrays.types import Floats, Indices
from raytracer.bsdfs.bsdf import evaluate_bsdf, evaluate_diffuse, evaluate_lobes, includes_diffuse
from raytracer.bsdfs.closures import Shading
from raytracer.casting.rays import Rays
from raytracer.integrator.light_sources import LightSource, ShadingPoints
from raytracer.integrator.shadow_rays import ShadowRays
from raytracer.lights.light_shapes import LightSamples
from raytracer.sampling.warps import power_heuristic
from raytracer.scene.fields import SEEN_BY, SEEN_BY_ALL
from raytracer.surfaces.surface import Surface, spawn_origin


def sample_lights(
    sources: tuple[LightSource, ...],
    points: ShadingPoints,
    probabilities: Floats,
    throughput: Floats,
    row: Indices,
    all_rays: bool = False,
) -> list[ShadowRays]:
    """The light loop: return shadow rays from n points to one sample of every source, with the light they would bring.

    Parameters
    ----------
    probabilities : (n, lobes) float64, of `bsdf.lobe_probabilities`
    throughput : (n, 3) float64, what light from these points counts; 0 leaves a point out
    row : (n,) int64, the points' rows of the batch
    all_rays : True for rays to sources that throw no shadows, too
    """
    shadow_rays = []
    for source in sources:
        found = source.sample(replace(points, sampler=points.sampler.skip(source.dimension)))
        light = reflect_light(points.shading, probabilities, found.light, source.seen_by) * throughput
        if source.max_bounces is not None:
            assert points.bounces is not None
            light[points.bounces > source.max_bounces] = 0.0
        lit = np.flatnonzero((found.light.density > 0) & any_column(light != 0))
        rays = _aim(points.surface, found.light, lit) if source.cast_shadow or all_rays else None
        passages, key = points.passages[lit], found.key[lit]
        light = take_rows(light, lit)
        shadow_rays.append(ShadowRays(row[lit], light, key, passages, rays, source.unstopped, source.chance))
    return shadow_rays


def _aim(surface: Surface, light: LightSamples, rows: Indices) -> Rays:
    """Return shadow rays from some of the points: to the light's target, if it has one, so that rays which share it end
    at the same point to the last place."""
    direction, reach = light.direction.take(rows, axis=0), light.distance.take(rows)
    origins = spawn_origin(surface.select(rows), direction)
    if light.target is not None and light.reach is not None:
        direction, reach = light.target.take(rows, axis=0) - origins, light.reach.take(rows)
    return Rays(origins, direction, np.zeros(len(rows)), reach)


# The classes of rays that no surface reflects.
UNREFLECTED = SEEN_BY["camera"] | SEEN_BY["shadow"]


def reflect_light(shading: Shading, probabilities: Floats, light: LightSamples, seen_by: int = SEEN_BY_ALL) -> Floats:
    """Return (n, 3) what each point of `shading` sends back of its sample of a light, in the share that reflected rays
    leave to light sampling.

    seen_by : bits of SEEN_BY, the ways in which the light is reflected
    """
    if (seen_by | UNREFLECTED) != SEEN_BY_ALL:
        shading, probabilities = _leave_out_hidden(shading, probabilities, seen_by)
    if includes_diffuse(shading, probabilities):
        value, density = evaluate_bsdf(shading, probabilities, light.direction)
        value *= power_heuristic(light.density, density)[:, np.newaxis]
    else:
        value = evaluate_diffuse(shading, light.direction)
        if shading.lobes:
            specular, density = evaluate_lobes(shading, probabilities, light.direction)
            value += specular * power_heuristic(light.density, density)[:, np.newaxis]
    value *= light.weight
    return value


def _leave_out_hidden(shading: Shading, probabilities: Floats, seen_by: int) -> tuple[Shading, Floats]:
    """Return only the parts that belong to the classes of rays in `seen_by`, and how often they are taken.

    A part that both reflects and transmits goes only where neither is left, as in Cycles.
    """
    probabilities, first = probabilities.copy(), 1 + len(shading.lobes)
    kept = []
    for column, lobes in enumerate(shading.lobes, start=1):
        glossy = any_column(lobes.reflection > 0) & bool(seen_by & SEEN_BY["glossy"])
        through = any_column(lobes.transmission > 0) & bool(seen_by & SEEN_BY["transmission"])
        kept.append(lobes.select(np.flatnonzero(glossy | through)))
        probabilities[lobes.hit[~(glossy | through)], column] = 0.0
    diffuse, tilted = shading.diffuse, []
    if not seen_by & SEEN_BY["diffuse"]:
        diffuse = np.zeros_like(diffuse)
        probabilities[:, first : first + 1] = 0.0
    for column, part in enumerate(shading.tilted, start=first + 1):
        if not seen_by & SEEN_BY["transmission" if part.transmits else "diffuse"]:
            part = dataclasses.replace(part, albedo=np.zeros_like(part.albedo))
            probabilities[:, column : column + 1] = 0.0
        tilted.append(part)
    shading = dataclasses.replace(shading, lobes=tuple(kept), diffuse=diffuse, tilted=tuple(tilted))
    return shading, probabilities
