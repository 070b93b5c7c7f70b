"""Sources of light: each samples a direction from every shading point; a scene has those that it needs, no others.

A source that reflected rays can also meet is sampled in both ways, weighed by the power heuristic.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from raytracer.arrays.types import Booleans, Counts, Integers, Keys
from raytracer.bsdfs.closures import Shading
from raytracer.lights.emitters import (
    Emitters,
    pick_emitters,
    place_on_triangles,
    sample_picked,
    sample_placed,
    vary_radiance,
)
from raytracer.lights.environment import (
    Environment,
    WorldSampler,
    environment_density,
    evaluate_environment,
    list_world_samplers,
)
from raytracer.lights.light_linking import LightLinks
from raytracer.lights.light_shapes import LightSamples
from raytracer.lights.lights import has_extent, sample_light
from raytracer.lights.shared_points import is_near, is_shareable, sample_shared, share_points
from raytracer.sampling.sampler import Sampler
from raytracer.scene.fields import ALL_SETS, SEEN_BY_ALL
from raytracer.scene.lights import Light
from raytracer.surfaces.surface import Surface

# The key of shadow rays that share nothing.
ALONE = -1
# The kinds that Cycles picks between: lights (a textured world counts as one) and emissive meshes; a constant world is
# never picked.
LIGHT, WORLD, GEOMETRY, OTHER = range(4)


@dataclass(frozen=True, eq=False, slots=True)
class ShadingPoints:
    """n points that wait for light.

    passages : (n,) int32, straight passages of the paths that led there
    """

    surface: Surface
    shading: Shading
    passages: Counts
    sampler: Sampler


@dataclass(frozen=True, eq=False, slots=True)
class KeyedSamples:
    """Where n points look for a light: a sample each, and the key (n,) of the point or direction that they share with
    all others of the same key; ALONE where with none."""

    light: LightSamples
    key: Keys


LightStage = Callable[[ShadingPoints], KeyedSamples]


@dataclass(frozen=True, eq=False)
class LightSource:
    """A source of light: the stage that samples it, how many numbered dimensions that takes, whether it throws shadows,
    the classes of rays that see it, which are the ways in which its light is reflected, whether its light passes
    transparent surfaces that stop that of others, how many numbered dimensions before its own nobody takes, its kind
    and chance among what Cycles would choose from (`taming`), and which (n,) of n instances and groups of spheres it
    lights; None for all, or where `sample` has told them apart."""

    sample: LightStage
    dimensions: int
    cast_shadow: bool = True
    seen_by: int = SEEN_BY_ALL
    unstopped: bool = False
    skipped: int = 0
    kind: int = LIGHT
    chance: float = 1.0
    find_lit: Callable[[Integers], Booleans] | None = None


def leave_out(sources: Sequence[LightSource], present: Sequence[bool]) -> tuple[LightSource, ...]:
    """Return the sources that are present; each takes the same random numbers as if all were."""
    kept, skipped = [], 0
    for source, stays in zip(sources, present, strict=True):
        if stays:
            kept.append(replace(source, skipped=source.skipped + skipped))
        skipped = 0 if stays else skipped + source.dimensions
    return tuple(kept)


def set_chances(sources: Sequence[LightSource]) -> tuple[LightSource, ...]:
    """Return all the sources that there are with the chances that Cycles would choose them with."""
    kinds = [source.kind for source in sources]
    chances = find_chances(kinds.count(LIGHT) + (WORLD in kinds), GEOMETRY in kinds)
    return tuple(replace(source, chance=chances.get(source.kind, 1.0)) for source in sources)


def find_chances(lights: int, geometry: bool) -> dict[int, float]:
    """Return the chances that Cycles picks one of so many lights, or emissive geometry: a half for either kind, where
    there are both."""
    every = 0.5 if lights and geometry else 1.0
    return {LIGHT: every / max(lights, 1), WORLD: every / max(lights, 1), GEOMETRY: every}


def light_source(light: Light, weigh: bool, links: LightLinks | None = None) -> LightSource:
    """A light: two pairs of numbers at most.

    weigh : False where no reflected ray can meet the light
    """
    # Without extent all shadow rays of a light end at one point, or run in one direction.
    key_of_own = ALONE if has_extent(light) else 0
    shareable = is_shareable(light)

    def sample(points: ShadingPoints) -> KeyedSamples:
        shared = points.sampler.shared
        if shareable and shared is not None:
            targets = share_points(light, shared, points.sampler.dimension).take(shared.key, axis=0)
            aim = KeyedSamples(
                sample_shared(light, points.surface.position, targets, weigh), shared.key.astype(np.int32)
            )
            _replace_near(light, points, aim)
            return aim
        pair = points.sampler.uniform_pair()
        return KeyedSamples(sample_light(light, points.surface.position, pair), _fill_keys(points, key_of_own))

    find_lit = partial(links.find_lit, light.receivers) if links is not None and light.receivers != ALL_SETS else None
    return LightSource(sample, 2, light.cast_shadow, light.seen_by, find_lit=find_lit)


def _replace_near(light: Light, points: ShadingPoints, aim: KeyedSamples) -> None:
    """Give points near a light a sample of their own."""
    rows = np.flatnonzero(is_near(light, points.surface.position))
    if not len(rows):
        return
    position = points.surface.position[rows]
    own = sample_light(light, position, points.sampler.select(rows).uniform_pair())
    for name in ("direction", "distance", "weight", "density"):
        getattr(aim.light, name)[rows] = getattr(own, name)
    if aim.light.target is not None and aim.light.reach is not None:
        aim.light.target[rows] = position + own.direction
        aim.light.reach[rows] = own.distance
    aim.key[rows] = ALONE


def _fill_keys(points: ShadingPoints, key: int) -> Keys:
    return np.full(len(points.surface), key, dtype=np.int32)


def emitter_source(emitters: Emitters, links: LightLinks | None = None) -> LightSource:
    """All emissive geometry: a number to choose by, and a pair for the place."""
    shareable = not emitters.has_spheres

    def sample(points: ShadingPoints) -> KeyedSamples:
        dimension, shared = points.sampler.dimension, points.sampler.shared
        if shareable and shared is not None:
            picked, pair = pick_emitters(emitters, shared.uniform(dimension)), shared.uniform_pair(dimension + 1)
            places = place_on_triangles(emitters, picked, pair).select(shared.key)
            light = sample_placed(places, points.surface)
            picked, pair, key = picked[shared.key], pair[shared.key], shared.key.astype(np.int32)
            vary_radiance(emitters, picked, pair, points.surface, light)
        else:
            picked, pair = pick_emitters(emitters, points.sampler.uniform(0)), points.sampler.uniform_pair(1)
            light, key = sample_picked(emitters, points.surface, picked, pair), _fill_keys(points, ALONE)
        if links is not None:
            lit = links.find_lit(links.receivers[emitters.instance[picked]], points.surface.instance)
            light.weight[~lit] = 0.0
        return KeyedSamples(light, key)

    return LightSource(sample, 2, kind=GEOMETRY)


def world_sources(environment: Environment) -> list[LightSource]:
    """The world: directions around the shading normal, and to where it is bright.

    Cycles looks for the light of an even world with paths alone, which go on behind all that is transparent.
    """

    def sample(way: WorldSampler, points: ShadingPoints) -> KeyedSamples:
        normal = points.shading.normal
        direction = way(normal, points.sampler.uniform_pair())
        density = environment_density(environment, normal, direction)
        share = np.where(density > 0, 1.0 / np.where(density > 0, density, 1.0), 0.0)
        weight = share[:, np.newaxis] * evaluate_environment(environment, direction)
        light = LightSamples(direction, np.full(len(direction), np.inf), weight, density)
        return KeyedSamples(light, _fill_keys(points, ALONE))

    even = environment.program is None
    kind = OTHER if even else WORLD
    return [LightSource(partial(sample, way), 1, unstopped=even, kind=kind) for way in list_world_samplers(environment)]
