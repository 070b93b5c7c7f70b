"""Sources of light: each samples a direction from every shading point; a scene has those that it needs, no others.

Three kinds answer the same question: a light (`SampledLight`), all emissive geometry (`EmissiveGeometry`), the world
(`SampledWorld`). A source that reflected rays can also meet is sampled in both ways, weighed by the power heuristic.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from raytracer.arrays.types import Counts, Keys
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
from raytracer.lights.light_nodes import ComputedLight, vary_samples
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
    sampler : begins with the wave's dimensions
    bounces : (n,) the bounces of all kinds of the paths; None where no light asks
    """

    surface: Surface
    shading: Shading
    passages: Counts
    sampler: Sampler
    bounces: Counts | None = None


@dataclass(frozen=True, eq=False, slots=True)
class KeyedSamples:
    """A sample of a light from each of n points, and the key (n,) of the point or direction that it shares with all
    others of the same key; ALONE where with none."""

    light: LightSamples
    key: Keys


@dataclass(frozen=True, eq=False, kw_only=True)
class LightSource(ABC):
    """A source of light.

    dimension_count : how many numbered dimensions a sample takes
    dimension : the first of them, within a wave
    kind : what Cycles would choose it as
    chance : with which Cycles would choose it, see `clamping`
    cast_shadow : False for a light that throws no shadows
    seen_by : bits of SEEN_BY, the classes of rays that see it, which are the ways in which its light is reflected
    unstopped : True where its light passes transparent surfaces that stop that of others
    max_bounces : it lights nothing that a path has bounced to more often; None without limit
    """

    dimension_count: ClassVar[int]
    kind: int
    dimension: int = 0
    chance: float = 1.0
    cast_shadow: bool = True
    seen_by: int = SEEN_BY_ALL
    unstopped: bool = False
    max_bounces: int | None = None

    @abstractmethod
    def sample(self, points: ShadingPoints) -> KeyedSamples:
        """Return a sample from each point; of weight 0 where light linking keeps its light away.

        points : their sampler begins with this source's dimensions
        """


@dataclass(frozen=True, eq=False, kw_only=True)
class SampledLight(LightSource):
    """One light.

    weigh : False where no reflected ray can meet the light
    links : which objects it lights; None for all
    """

    dimension_count: ClassVar[int] = 2
    light: Light
    weigh: bool
    links: LightLinks | None
    kind: int = LIGHT

    def sample(self, points: ShadingPoints) -> KeyedSamples:
        """Return samples at a point that sets of pixels share, or at points of their own."""
        shared, position = points.sampler.shared, points.surface.position
        if is_shareable(self.light) and shared is not None:
            targets = share_points(self.light, shared, points.sampler.dimension).take(shared.key, axis=0)
            samples = sample_shared(self.light, position, targets, self.weigh)
            found = KeyedSamples(samples, shared.key.astype(np.int32))
            _replace_near(self.light, points, found)
        else:
            # Without extent all shadow rays of a light end at one point, or run in one direction.
            key = ALONE if has_extent(self.light) else 0
            found = KeyedSamples(sample_light(self.light, position, points.sampler.uniform_pair()), _fill(points, key))
        if self.links is not None:
            found.light.weight[~self.links.find_lit(self.light.receivers, points.surface.instance)] = 0.0
        return found


@dataclass(frozen=True, eq=False, kw_only=True)
class SampledLightWithNodes(SampledLight):
    """One light whose nodes weigh the samples."""

    computed: ComputedLight

    def sample(self, points: ShadingPoints) -> KeyedSamples:
        """Return samples as of any light, each weighed."""
        found = SampledLight.sample(self, points)
        light = vary_samples(self.computed, points.surface.position, points.bounces, found.light)
        return replace(found, light=light)


@dataclass(frozen=True, eq=False, kw_only=True)
class EmissiveGeometry(LightSource):
    """All emissive geometry: a number to choose by, and a pair for the place."""

    dimension_count: ClassVar[int] = 2
    emitters: Emitters
    links: LightLinks | None
    kind: int = GEOMETRY

    def sample(self, points: ShadingPoints) -> KeyedSamples:
        """Return samples on primitives picked by power: one that sets of pixels share, or each point's own."""
        emitters, sampler, shared = self.emitters, points.sampler, points.sampler.shared
        if shared is not None and not emitters.has_spheres:
            picked = pick_emitters(emitters, shared.uniform(sampler.dimension))
            pair = shared.uniform_pair(sampler.dimension + 1)
            light = sample_placed(place_on_triangles(emitters, picked, pair).select(shared.key), points.surface)
            picked, pair, key = picked[shared.key], pair[shared.key], shared.key.astype(np.int32)
            vary_radiance(emitters, picked, pair, points.surface, light)
        else:
            picked, pair = pick_emitters(emitters, sampler.uniform(0)), sampler.uniform_pair(1)
            light, key = sample_picked(emitters, points.surface, picked, pair), _fill(points, ALONE)
        if self.links is not None:
            receivers = self.links.receivers[emitters.instance[picked]]
            light.weight[~self.links.find_lit(receivers, points.surface.instance)] = 0.0
        return KeyedSamples(light, key)


@dataclass(frozen=True, eq=False, kw_only=True)
class SampledWorld(LightSource):
    """The world, by one of its samplers: directions around the shading normal, or to where it is bright.

    Cycles looks for the light of an even world with paths alone, which go on behind all that is transparent.
    """

    dimension_count: ClassVar[int] = 1
    environment: Environment
    sampler: WorldSampler

    def sample(self, points: ShadingPoints) -> KeyedSamples:
        """Return samples of density that of all the world's samplers together."""
        normal = points.shading.normal
        direction = self.sampler(normal, points.sampler.uniform_pair())
        density = environment_density(self.environment, normal, direction)
        share = np.where(density > 0, 1.0 / np.where(density > 0, density, 1.0), 0.0)
        weight = share[:, np.newaxis] * evaluate_environment(self.environment, direction)
        light = LightSamples(direction, np.full(len(direction), np.inf), weight, density)
        return KeyedSamples(light, _fill(points, ALONE))


def make_light_source(
    light: Light, weigh: bool, links: LightLinks | None = None, computed: ComputedLight | None = None
) -> LightSource:
    """Return a light as a source; arguments as in `SampledLight`.

    computed : what evaluates its nodes, or None for a light without
    """
    fields: dict[str, Any] = {
        "light": light,
        "weigh": weigh,
        "links": None if light.receivers == ALL_SETS else links,
        "cast_shadow": light.cast_shadow,
        "seen_by": light.seen_by,
        "max_bounces": light.max_bounces,
    }
    return SampledLight(**fields) if computed is None else SampledLightWithNodes(**fields, computed=computed)


def make_world_sources(environment: Environment) -> list[LightSource]:
    """Return the world as sources, one for each of its samplers."""
    even = environment.program is None
    return [
        SampledWorld(environment=environment, sampler=sampler, kind=OTHER if even else WORLD, unstopped=even)
        for sampler in list_world_samplers(environment)
    ]


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


def _replace_near(light: Light, points: ShadingPoints, shared: KeyedSamples) -> None:
    """Give points near a light a sample of their own."""
    rows = np.flatnonzero(is_near(light, points.surface.position))
    if not len(rows):
        return
    position = points.surface.position[rows]
    own = sample_light(light, position, points.sampler.select(rows).uniform_pair())
    for name in ("direction", "distance", "weight", "density"):
        getattr(shared.light, name)[rows] = getattr(own, name)
    if shared.light.target is not None and shared.light.reach is not None:
        shared.light.target[rows] = position + own.direction
        shared.light.reach[rows] = own.distance
    shared.key[rows] = ALONE


def _fill(points: ShadingPoints, key: int) -> Keys:
    return np.full(len(points.surface), key, dtype=np.int32)
