"""Sources of light: each samples a direction from every shading point; a scene has those that it needs, no others.

Three kinds answer the same question: a light (`SampledLight`), all emissive geometry (`emissive_source`), the world
(`SampledWorld`). A source that reflected rays can also meet is sampled in both ways, weighed by the power heuristic.

Who sees what, by source and kind of ray, as in Cycles:

    source                sampled: reflected by the parts  its rays meet the objects   met by the rays
    light                 that see the light               that shadow rays see        that see the light
    emissive geometry     that see the object              that shadow rays see        that see the object
    world that varies     that see the world               that shadow rays see        that see the world
    world that is even    whose rays would bring it        that those rays see         that see the world

Diffuse transmission is a part that sees by the flag for diffuse rays; its rays see objects by that for transmission,
lights and the world by both. A part that reflects and transmits sees by either flag. To programs a ray to any source
but an even world is of no kind; to one, it is of the kind whose place it takes. A reflected ray that meets a source is
of its own kind, to programs and to objects: how much of a source's light comes by which, see `told_apart`.

References
----------
Blender, intern/cycles/kernel/integrator/surface_shader.h: _surface_shader_exclude; light/common.h:
is_light_shader_visible_to_path; integrator/path_state.h: path_state_ray_visibility; svm/light_path.h.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Container, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import scale_vectors, take_rows
from raytracer.arrays.types import Counts, Indices, Integers, Keys, Masks
from raytracer.bsdfs.bounce_kinds import DIFFUSE, GLOSSY
from raytracer.bsdfs.closures import Shading
from raytracer.lights.environment import (
    Environment,
    WorldSampler,
    environment_density,
    evaluate_environment,
    list_world_samplers,
)
from raytracer.lights.light_linking import LightLinks
from raytracer.lights.light_nodes import ComputedLight, vary_samples
from raytracer.lights.light_picks import Picks
from raytracer.lights.light_shapes import LightSamples
from raytracer.lights.lights import has_extent, sample_light
from raytracer.lights.shared_points import is_near, is_shareable, sample_shared, share_points
from raytracer.sampling.sampler import Sampler
from raytracer.scene.fields import ALL_SETS, SEEN_BY, SEEN_BY_ALL
from raytracer.scene.light_groups import NO_GROUP
from raytracer.scene.lights import Light
from raytracer.shading.light_path import FARTHEST, Depths, LightPath, describe_reflected, describe_sampling, put_further
from raytracer.surfaces.surface import Surface
from raytracer.surfaces.terminator import Lift

# The key of shadow rays that share nothing.
ALONE = -1
# The kinds that Cycles picks between: lights (a textured world counts as one) and emissive meshes; a constant world is
# never picked.
LIGHT, WORLD, GEOMETRY, OTHER = range(4)


@dataclass(frozen=True, eq=False, slots=True)
class ShadingPoints:
    """n points that wait for light.

    depths : of the paths that led there
    sampler : begins with the wave's dimensions
    lift : tells which shadow rays start higher (`terminator`); None where none do
    bounces : (n,) the bounces of all kinds of the paths; None where no light asks
    picks : by group of lights, those that its sources aim at: the first of them picks for all
    """

    surface: Surface
    shading: Shading
    depths: Depths
    sampler: Sampler
    lift: Lift | None = None
    bounces: Counts | None = None
    picks: dict[Any, Picks] = field(default_factory=dict)

    def select(self, rows: Indices) -> ShadingPoints:
        """Return some of the points, in their order."""
        return ShadingPoints(
            self.surface.select(rows),
            self.shading.select(rows),
            self.depths.select(rows),
            self.sampler.select(rows),
            self.lift,
            None if self.bounces is None else self.bounces[rows],
        )


@dataclass(frozen=True, eq=False, slots=True)
class KeyedSamples:
    """A sample of a light from each of n points, and the key (n,) of the point or direction that it shares with all
    others of the same key; ALONE where with none.

    seen_by : (n,) uint8, bits of SEEN_BY, the ways in which each is reflected; None where that is the source's
    light_group : (n,) int32, and blockers : (n,) int64, likewise
    """

    light: LightSamples
    key: Keys
    seen_by: Masks | None = None
    light_group: Integers | None = None
    blockers: NDArray[np.int64] | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class LightSource(ABC):
    """A source of light.

    dimension_count : how many numbered dimensions a sample takes
    dimension : the first of them, within a wave
    kind : what Cycles would choose it as
    chance : with which Cycles would choose it, see `clamping`
    share : of its density that counts in the weights of samples and reflected rays: its chance where they are told
        apart (`told_apart`)
    cast_shadow : False for a light that throws no shadows
    seen_by : bits of SEEN_BY, the classes of rays that see it, which are the ways in which its light is reflected
    unstopped : True where its light passes transparent surfaces that stop that of others
    cast_as : the class of its shadow rays, which tells what objects they meet
    max_bounces : it lights nothing that a path has bounced to more often; None without limit
    light_group : number of the group that its light belongs to, among those that passes ask for; -1 for none
    blockers : the sets of objects that shadow its light, as bits
    """

    dimension_count: ClassVar[int]
    kind: int
    dimension: int = 0
    chance: float = 1.0
    share: float = 1.0
    cast_shadow: bool = True
    seen_by: int = SEEN_BY_ALL
    unstopped: bool = False
    cast_as: int = SEEN_BY["shadow"]
    max_bounces: int | None = None
    light_group: int = NO_GROUP
    blockers: int = ALL_SETS

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
            targets = take_rows(share_points(self.light, shared, points.sampler.dimension), shared.key)
            samples = sample_shared(self.light, position, targets, self.weigh)
            found = KeyedSamples(samples, shared.key.astype(np.int32))
            _replace_near(self.light, points, found)
        else:
            # Without extent all shadow rays of a light end at one point, or run in one direction.
            key = ALONE if has_extent(self.light) else 0
            found = KeyedSamples(
                sample_light(self.light, position, points.sampler.joined_pair()), fill_key(points, key)
            )
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
        light = vary_samples(self.computed, points.surface.position, points.depths, found.light)
        return replace(found, light=light)


@dataclass(frozen=True, eq=False, kw_only=True)
class SampledWorld(LightSource):
    """The world, by one of its samplers: directions around the shading normal, or to where it is bright.

    Cycles looks for the light of an even world with paths alone, which go on behind all that is transparent, see the
    objects that reflected rays see, and are told what kind of ray they are. Where that makes a difference, such a world
    is a source for diffuse and one for glossy reflection.

    reflected : the kind of reflection, of `bounce_kinds`, that its light comes by; None where that is all the same
    """

    dimension_count: ClassVar[int] = 1
    environment: Environment
    sampler: WorldSampler
    reflected: int | None = None

    def sample(self, points: ShadingPoints) -> KeyedSamples:
        """Return samples of density that of all the world's samplers together."""
        normal = points.shading.normal
        direction = self.sampler(normal, points.sampler.joined_pair())
        density = environment_density(self.environment, normal, direction)
        share = np.where(density > 0, 1.0 / np.where(density > 0, density, 1.0), 0.0)
        path = None if self.environment.program is None else self._describe(points.depths)
        weight = scale_vectors(evaluate_environment(self.environment, direction, path), share)
        light = LightSamples(direction, np.full(len(direction), np.inf), weight, density)
        return KeyedSamples(light, fill_key(points, ALONE))

    def _describe(self, depths: Depths) -> LightPath:
        """Return what a program can ask of the rays that bring its light."""
        count = len(depths.passages)
        length = np.full(count, FARTHEST)
        if self.reflected is None:
            return describe_sampling(length, depths)
        return put_further(describe_reflected(np.full(count, self.reflected, np.uint8), length, depths))


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
        "blockers": light.blockers,
    }
    return SampledLight(**fields) if computed is None else SampledLightWithNodes(**fields, computed=computed)


def make_world_sources(environment: Environment, tells_rays_apart: bool) -> list[LightSource]:
    """Return the world as sources: one for each of its samplers, or for each kind of reflection.

    tells_rays_apart : True where objects are hidden from some of the rays that look for it, or ask how they came
    """
    if not environment.is_even:
        return [
            SampledWorld(
                environment=environment,
                sampler=sampler,
                kind=WORLD,
                seen_by=environment.seen_by,
                max_bounces=environment.max_bounces,
            )
            for sampler in list_world_samplers(environment)
        ]
    (sampler,) = list_world_samplers(environment)
    whole = SampledWorld(environment=environment, sampler=sampler, kind=OTHER, unstopped=True)
    hidden = SEEN_BY_ALL - environment.seen_by
    if environment.program is None and not tells_rays_apart and not hidden & (SEEN_BY["diffuse"] | SEEN_BY["glossy"]):
        return [whole]
    return [
        replace(whole, reflected=kind, seen_by=SEEN_BY[name], cast_as=SEEN_BY[name])
        for name, kind in (("diffuse", DIFFUSE), ("glossy", GLOSSY))
        if not hidden & SEEN_BY[name]
    ]


def set_chances(sources: Sequence[LightSource], told_apart: Container[int] = ()) -> tuple[LightSource, ...]:
    """Return all the sources that there are with the chances that Cycles would choose them with.

    told_apart : the kinds of those whose samples are weighed by these chances
    """
    kinds = [source.kind for source in sources]
    chances = find_chances(kinds.count(LIGHT) + (WORLD in kinds), GEOMETRY in kinds)
    found = [chances.get(source.kind, 1.0) for source in sources]
    return tuple(
        replace(source, chance=chance, share=chance if source.kind in told_apart else 1.0)
        for source, chance in zip(sources, found, strict=True)
    )


def find_chances(lights: int, geometry: bool) -> dict[int, float]:
    """Return the chances that Cycles picks one of so many lights, or emissive geometry: a half for either kind, where
    there are both. So it does without its light tree; with it the chances differ from place to place."""
    every = 0.5 if lights and geometry else 1.0
    return {LIGHT: every / max(lights, 1), WORLD: every / max(lights, 1), GEOMETRY: every}


def _replace_near(light: Light, points: ShadingPoints, shared: KeyedSamples) -> None:
    """Give points near a light a sample of their own."""
    rows = np.flatnonzero(is_near(light, points.surface.position))
    if not len(rows):
        return
    position = points.surface.position[rows]
    own = sample_light(light, position, points.sampler.select(rows).joined_pair())
    for name in ("direction", "distance", "weight", "density"):
        getattr(shared.light, name)[rows] = getattr(own, name)
    if shared.light.target is not None and shared.light.reach is not None:
        shared.light.target[rows] = position + own.direction
        shared.light.reach[rows] = own.distance
    shared.key[rows] = ALONE


def fill_key(points: ShadingPoints, key: int) -> Keys:
    """Return one key (n,) for all points."""
    return np.full(len(points.surface), key, dtype=np.int32)
