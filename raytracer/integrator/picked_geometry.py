"""Many emissive objects as a few sources: from each point a few are aimed at, picked by a tree of them."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np

from raytracer.arrays.types import Floats, Integers
from raytracer.integrator.emissive_source import EmissiveGeometry
from raytracer.integrator.light_sources import ALONE, KeyedSamples, ShadingPoints
from raytracer.integrator.paths import Paths
from raytracer.integrator.picked_lights import MOST_AIMED_AT, describe_receivers, make_no_samples
from raytracer.lights.emitter_groups import EmitterGroup, group_emitters
from raytracer.lights.emitters import sample_picked
from raytracer.lights.light_linking import LightLinks
from raytracer.lights.light_picks import pick_lights
from raytracer.lights.light_shapes import divide_rows

# Sources of emissive geometry where there are many objects: at most so many are aimed at from each point. With 1000
# small ones in a hall the time to an error halves from 2 to 4, falls by a third from there to 8, and no further to 16.
PICKS = 8


@dataclass(frozen=True, eq=False, kw_only=True)
class PickedGeometry(EmissiveGeometry):
    """One of the emissive objects of a group: a number to pick by, a pair for the place, a number for the primitive.

    number : of the source among the group's, which pick together
    """

    dimension_count: ClassVar[int] = 3
    group: EmitterGroup
    number: int

    def sample(self, points: ShadingPoints) -> KeyedSamples:
        """Return samples of the object that is picked for each point; of density 0 where this source picks none."""
        group, surface, sampler = self.group, points.surface, points.sampler
        if group not in points.picks:
            receivers = describe_receivers(self.links, surface.position, points.shading.normal, surface.instance)
            # All sources of the group go by the number of the first.
            choice = sampler.uniform(-self.number * self.dimension_count)
            points.picks[group] = pick_lights(group.tree, receivers, choice, PICKS)
        row, chance = (of_sources[self.number] for of_sources in points.picks[group])
        found, rows = make_no_samples(len(surface)), np.flatnonzero(row >= 0)
        if len(rows):
            own, row = sampler.select(rows), row.take(rows)
            factor = chance.take(rows) / group.share.take(row)
            picked = group.pick_primitives(self.emitters, row, own.uniform(2))
            depths = points.depths.select(rows)
            light = sample_picked(self.emitters, surface.select(rows), picked, own.joined_pair(1), depths)
            found.direction[rows], found.distance[rows] = light.direction, light.distance
            found.weight[rows], found.density[rows] = divide_rows(light.weight, factor), light.density * factor
        instance = group.record[points.picks[group].light[self.number]]
        by_object = (self.seen_by_object, self.light_groups, self.blockers_by_object)
        tables = (None if table is None else table[instance] for table in by_object)
        return KeyedSamples(found, np.full(len(surface), ALONE, np.int32), *tables)


def pick_geometry(source: EmissiveGeometry) -> list[EmissiveGeometry]:
    """Return the sources of emissive geometry: one, or those of a group of many objects."""
    group = group_emitters(source.emitters, source.links, MOST_AIMED_AT)
    if group is None:
        return [source]
    known: dict[str, Any] = {field.name: getattr(source, field.name) for field in fields(source)}
    return [PickedGeometry(**known, group=group, number=number) for number in range(PICKS)]


def find_emitter_factors(group: EmitterGroup, links: LightLinks | None, paths: Paths, instance: Integers) -> Floats:
    """Return by what (n,) the density of samples of emissive instances (n,) that paths meet differs from that by
    power."""
    points = describe_receivers(links, paths.scatter_origin, paths.scatter_normal, paths.scatterer)
    return group.find_factors(instance, points, PICKS)
