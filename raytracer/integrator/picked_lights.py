"""Many lights as a few sources: from each point a few of the lights are aimed at, picked by a `LightTree`.

Where there are few lights every one is a source of its own (`light_sources`), for that leaves the least noise. For many
alike there are a few sources, which pick as many lights for each point (`light_picks`): what matters always, of
all the rest a few. A sample has the density of the light times its chance to be aimed at from there, by which rays that
meet the light are weighed as well.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats, Indices, Integers
from raytracer.integrator.light_sources import ALONE, LIGHT, KeyedSamples, LightSource, ShadingPoints
from raytracer.lights.light_bounds import bound_lights, has_place
from raytracer.lights.light_importance import Receivers
from raytracer.lights.light_linking import LightLinks
from raytracer.lights.light_nodes import ComputedLight, vary_samples
from raytracer.lights.light_picks import Picks, find_chances, pick_lights
from raytracer.lights.light_shapes import LightSamples, divide_rows
from raytracer.lights.light_tree import LightTree, make_light_tree
from raytracer.lights.lights import has_extent, sample_light
from raytracer.lights.stacked_lights import LightStack, stack_lights
from raytracer.scene.fields import ALL_SETS
from raytracer.scene.lights import Light

# More lights than this are picked from; as many as this, or fewer, are all aimed at.
MOST_AIMED_AT = 32
# Sources of a group: at most so many lights are aimed at from each point. With 1000 point lights over a hall the time
# to an error falls by a quarter from 4 to 8, and by a sixth from there to 16.
PICKS = 16


@dataclass(frozen=True, eq=False)
class LightGroup:
    """Many lights alike: they throw shadows or none, are seen by the same rays, and so on.

    tree : of the lights
    stacks : the lights once more, as records; of each light the record is `stack` and its row there `row`
    links : which objects each lights; None where all light all
    computed : what evaluates the nodes of those that have any
    """

    lights: tuple[Light, ...]
    tree: LightTree
    stacks: Sequence[LightStack]
    stack: NDArray[np.int64]
    row: NDArray[np.int64]
    links: LightLinks | None
    computed: Mapping[Light, ComputedLight]

    @property
    def example(self) -> Light:
        """One of the lights; in what makes them alike it stands for all."""
        return self.lights[0]

    @property
    def has_extent(self) -> bool:
        """True where rays can meet any of the lights."""
        return any(map(has_extent, self.lights))

    def describe(self, position: Floats, normal: Floats, instance: Integers) -> Receivers:
        """Return what the tree asks of points (n, 3) with normals (n, 3) on instances (n,)."""
        return describe_receivers(self.links, position, normal, instance)

    def pick(self, points: ShadingPoints, choice: Floats) -> Picks:
        """Return what is aimed at from n points; choice : (n,) uniform numbers."""
        surface = points.surface
        receivers = self.describe(surface.position, points.shading.normal, surface.instance)
        return pick_lights(self.tree, receivers, choice, PICKS)

    def find_chances(self, light: NDArray[np.integer], row: Indices, points: Receivers) -> Floats:
        """Return the probabilities (k,) with which lights (k,) are aimed at from points by their rows (k,)."""
        return find_chances(self.tree, light, row, points, PICKS)


def describe_receivers(links: LightLinks | None, position: Floats, normal: Floats, instance: Integers) -> Receivers:
    """Return what a tree asks of points (n, 3) with normals (n, 3) on instances (n,)."""
    sets = None if links is None else links.light_set[instance]
    return Receivers(np.ascontiguousarray(position.T), np.ascontiguousarray(normal.T), sets)


def split_lights(
    lights: Sequence[Light],
    links: LightLinks | None,
    computed: Mapping[Light, ComputedLight],
    bent: Container[Light] = (),
) -> tuple[list[Light], list[LightGroup]]:
    """Return the lights that are all aimed at, and the groups of those that are picked from: never those whose shadows
    are linked, which are few, nor those that are `bent` to caustics."""
    alike: dict[tuple[bool, bool, int, int | None], list[Light]] = {}
    for light in lights:
        if has_place(light) and light.blockers == ALL_SETS and light not in bent:
            key = (light.cast_shadow, light.shadow_catcher, light.seen_by, light.max_bounces)
            alike.setdefault(key, []).append(light)
    groups = []
    for of_kind in alike.values():
        if len(of_kind) > MOST_AIMED_AT:
            linked = any(light.receivers != ALL_SETS for light in of_kind)
            tree = make_light_tree(bound_lights(tuple(of_kind)))
            groups.append(LightGroup(tuple(of_kind), tree, *stack_lights(of_kind), links if linked else None, computed))
    grouped = {light for group in groups for light in group.lights}
    return [light for light in lights if light not in grouped], groups


@dataclass(frozen=True, eq=False, kw_only=True)
class PickedLight(LightSource):
    """One of the lights of a group: a number to pick by, and a pair for the place.

    number : of the source among the group's, which pick together
    light_groups : (lights,) int32, as of LightSource, of each light; None where nobody asks
    """

    dimension_count: ClassVar[int] = 2
    group: LightGroup
    number: int
    kind: int = LIGHT
    light_groups: Integers | None = None

    def sample(self, points: ShadingPoints) -> KeyedSamples:
        """Return samples of the light that is picked for each point; of density 0 where this source picks none."""
        group, surface = self.group, points.surface
        if group not in points.picks:
            # All sources of the group go by the number of the first.
            points.picks[group] = group.pick(points, points.sampler.uniform(-self.number * self.dimension_count))
        light, chance = (of_sources[self.number] for of_sources in points.picks[group])
        stack = np.where(light >= 0, group.stack[light], -1)
        found, pair = make_no_samples(len(surface)), points.sampler.joined_pair(1)
        for number, of_stack in enumerate(group.stacks):
            rows = np.flatnonzero(stack == number)
            if not len(rows):
                continue
            samples = self._sample_lights(of_stack.take(group.row[light[rows]]), points, rows, pair)
            found.direction[rows], found.distance[rows] = samples.direction, samples.distance
            found.weight[rows] = divide_rows(samples.weight, chance[rows])
            found.density[rows] = samples.density * chance[rows]
        light_group = None if self.light_groups is None else self.light_groups[light]
        return KeyedSamples(found, np.full(len(surface), ALONE, np.int32), light_group=light_group)

    def _sample_lights(self, light: Light, points: ShadingPoints, rows: Indices, pair: Floats) -> LightSamples:
        """Return samples of one light, or of a record of them, from some of the points."""
        position = points.surface.position.take(rows, axis=0)
        samples = sample_light(light, position, pair.take(rows, axis=0))
        computed = self.group.computed.get(light)
        if computed is None:
            return samples
        return vary_samples(computed, position, points.depths.select(rows), samples)


def make_no_samples(count: int) -> LightSamples:
    """Return the record of samples of nothing, to be filled in."""
    return LightSamples(np.zeros((count, 3)), np.zeros(count), np.zeros((count, 3)), np.zeros(count))


def split_by_light(group: LightGroup, light: NDArray[np.integer]) -> Iterator[tuple[Light, Indices]]:
    """Yield each light with the rows of `light` (n,), ascending numbers, that name it."""
    for rows in np.split(np.arange(len(light)), np.flatnonzero(np.diff(light)) + 1) if len(light) else ():
        yield group.lights[light[rows[0]]], rows


def make_picked_sources(group: LightGroup) -> list[PickedLight]:
    """Return the sources of a group of lights."""
    light = group.example
    return [
        PickedLight(
            group=group,
            number=number,
            cast_shadow=light.cast_shadow,
            seen_by=light.seen_by,
            max_bounces=light.max_bounces,
        )
        for number in range(PICKS)
    ]
