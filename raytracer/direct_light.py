"""Light that arrives at surface points straight from its sources, with shadow rays.

Every source of a scene becomes one function, a LightStage, that samples a direction from each point; what a scene lacks
is not among them. A source that reflected rays can also meet is sampled in both ways, weighed by the power heuristic.
Imports `emitters`, `lights`, `materials`, `scatter`, `surface`, `sampling`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from raytracer.accelerate import Caster
from raytracer.closures import Shading
from raytracer.emitters import Emitters, sample_emitters
from raytracer.frames import to_world
from raytracer.lecture import dot
from raytracer.light_shapes import LightSamples
from raytracer.lights import sample_light
from raytracer.materials import MaterialTable
from raytracer.rays import Booleans, Floats, Rays, Surface, join_rays
from raytracer.sampling import PixelSamples, sample_cosine_hemisphere
from raytracer.scatter import evaluate_scattering, power_heuristic
from raytracer.scene import Light
from raytracer.surface import SurfaceTables, make_surface, spawn_origin

# A stack of more transparent surfaces than this stops the light; it bounds the loops through them.
MAX_PASSAGES = 128

# Shadow rays of different sources are cast together, for big batches cost less a ray, up to this many.
SHADOW_BATCH = 1 << 16

Indices = NDArray[np.intp]
LightStage = Callable[[Surface, Shading, PixelSamples, int], LightSamples]
Visibility = Callable[[Rays], Floats]


@dataclass(frozen=True, eq=False, slots=True)
class DirectLight:
    """Direct light at n points: (n, 3) float64 as it arrives, and as if nothing were in the way."""

    arriving: Floats
    unshadowed: Floats


@dataclass(frozen=True, eq=False, slots=True)
class ShadowCast:
    """Shadow rays of one source: (k,) the points they start from, (k, 3) the light if nothing is in the way."""

    row: Indices
    value: Floats
    rays: Rays


@dataclass(frozen=True, eq=False)
class LightSource:
    """A source of light: the stage that samples it, how many numbered dimensions that takes, and whether it throws
    shadows."""

    sample: LightStage
    dimensions: int
    cast_shadow: bool = True


def lamp_source(light: Light) -> LightSource:
    """A lamp: one pair of numbers."""

    def sample(surface: Surface, shading: Shading, samples: PixelSamples, dimension: int) -> LightSamples:
        return sample_light(light, surface.position, samples.uniform_pair(dimension))

    return LightSource(sample, 1, light.cast_shadow)


def emitter_source(emitters: Emitters) -> LightSource:
    """All emissive geometry: a number to choose by, and a pair for the place."""

    def sample(surface: Surface, shading: Shading, samples: PixelSamples, dimension: int) -> LightSamples:
        choice, pair = samples.uniform(dimension), samples.uniform_pair(dimension + 1)
        return sample_emitters(emitters, surface, choice, pair)

    return LightSource(sample, 2)


def world_source(color: Floats) -> LightSource:
    """The constant world: directions around the shading normal with density cos / pi."""

    def sample(surface: Surface, shading: Shading, samples: PixelSamples, dimension: int) -> LightSamples:
        direction = to_world(sample_cosine_hemisphere(samples.uniform_pair(dimension)), shading.normal)
        density = world_density(shading.normal, direction)
        weight = np.where(density > 0, 1.0 / np.where(density > 0, density, 1.0), 0.0)[:, np.newaxis] * color
        return LightSamples(direction, np.full(len(surface), np.inf), weight, density)

    return LightSource(sample, 1)


def world_density(normal: Floats, direction: Floats) -> Floats:
    """Return the density per solid angle (n,) with which the world is sampled in unit directions (n, 3)."""
    return np.maximum(dot(normal, direction), 0.0) / np.pi


def add_direct_light(
    sources: tuple[LightSource, ...],
    visibility: Visibility,
    surface: Surface,
    shading: Shading,
    probabilities: Floats,
    wanted: Booleans,
    samples: PixelSamples,
    dimension: int,
) -> DirectLight:
    """Return the light that all sources send by way of n points, one sample each.

    Parameters
    ----------
    probabilities : (n, options) float64, of `scatter.option_probabilities`
    wanted : (n,) bool, False skips the point
    dimension : the first of the numbered dimensions of `samples` to use
    """
    arriving, unshadowed = np.zeros((len(surface), 3)), np.zeros((len(surface), 3))
    waiting: list[ShadowCast] = []
    for source in sources:
        light = source.sample(surface, shading, samples, dimension)
        dimension += source.dimensions
        scattering = evaluate_scattering(shading, probabilities, light.direction)
        share = power_heuristic(light.density, scattering.density)[:, np.newaxis]
        value = (scattering.diffuse + scattering.specular * share) * light.weight
        rows = np.flatnonzero(wanted & (light.density > 0) & (value > 0).any(axis=1))
        unshadowed[rows] += value[rows]
        if source.cast_shadow:
            waiting.append(ShadowCast(rows, value[rows], _shadow_rays(surface, light, rows)))
        else:
            arriving[rows] += value[rows]
        if sum(len(cast.row) for cast in waiting) >= SHADOW_BATCH:
            _cast_shadows(visibility, waiting, arriving)
    _cast_shadows(visibility, waiting, arriving)
    return DirectLight(arriving, unshadowed)


def _cast_shadows(visibility: Visibility, waiting: list[ShadowCast], arriving: Floats) -> None:
    """Cast the shadow rays of several sources together, add the light they let through, and empty the list."""
    rays = join_rays([cast.rays for cast in waiting])
    seen = visibility(rays) if len(rays) else np.zeros((0, 1))
    start = 0
    for cast in waiting:
        stop = start + len(cast.row)
        arriving[cast.row] += cast.value * seen[start:stop]
        start = stop
    waiting.clear()


def _shadow_rays(surface: Surface, light: LightSamples, rows: np.ndarray) -> Rays:
    direction = light.direction[rows]
    origins = spawn_origin(surface.select(rows), direction)
    return Rays(origins, direction, np.zeros(len(rows)), light.distance[rows])


def opaque_visibility(caster: Caster) -> Visibility:
    """Shadow rays where every surface stops the light: (n, 1), 1 or 0."""

    def see(rays: Rays) -> Floats:
        blocked = caster.any_hit(rays.origins, rays.directions, rays.t_min, rays.t_max)
        return np.where(blocked, 0.0, 1.0)[:, np.newaxis]

    return see


def transparent_visibility(caster: Caster, tables: SurfaceTables, materials: MaterialTable) -> Visibility:
    """Shadow rays that pass through transparent surfaces: (n, 3), the share of light that is left."""
    return partial(_see_through, caster, tables, materials)


def _see_through(caster: Caster, tables: SurfaceTables, materials: MaterialTable, rays: Rays) -> Floats:
    left = np.ones((len(rays), 3))
    rows = np.arange(len(rays))
    for _ in range(MAX_PASSAGES):
        hits = caster.closest_hit(rays.origins, rays.directions, rays.t_min, rays.t_max)
        met = np.flatnonzero(hits.hit)
        rays, hits, rows = rays.select(met), hits.select(met), rows[met]
        if not len(rows):
            return left
        surface = make_surface(tables, rays, hits)
        left[rows] *= materials.transparency[surface.material]
        open_ = np.flatnonzero((left[rows] > 0).any(axis=1))
        rays, surface, rows = rays.select(open_), surface.select(open_), rows[open_]
        reach = rays.t_max - hits.distance[open_]
        rays = Rays(spawn_origin(surface, rays.directions), rays.directions, np.zeros(len(rows)), np.maximum(reach, 0))
    left[rows] = 0.0
    return left
