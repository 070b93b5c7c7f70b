"""Many emissive objects: a tree of them, by which a few are aimed at from each point, as of many lights.

Object o is aimed at with its chance c_o, then one of its primitives with probability p / P_o, p the primitive's share
of the power of all emitters and P_o the object's. So all densities are those of `emitters` times c_o / P_o.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats, Indices, Integers
from raytracer.casting.geometry import Kind
from raytracer.casting.primitives import instance_bounds
from raytracer.lights.emitter_table import Emitters, Numbers, find_spheres, locate_emitters
from raytracer.lights.emitters import pick_emitters
from raytracer.lights.light_bounds import LightBounds
from raytracer.lights.light_importance import Receivers
from raytracer.lights.light_linking import LightLinks
from raytracer.lights.light_picks import find_chances
from raytracer.lights.light_tree import LightTree, make_light_tree
from raytracer.scene.fields import ALL_SETS


@dataclass(frozen=True, eq=False)
class EmitterGroup:
    """Emissive objects, instances and groups of spheres, in rising order.

    tree : of the objects
    record : (objects,) int32, as `instance` in Hits
    number : (instances + groups,) intp, of each record its row among the objects; -1 of others
    begin, share : (objects,) float64, the object's part of the power of all emitters, and P_o
    """

    tree: LightTree
    record: Integers
    number: Indices
    begin: Floats
    share: Floats

    def pick_primitives(self, emitters: Emitters, row: Indices, choice: Floats) -> Numbers:
        """Return the numbers (k,) of emitters of objects by their rows (k,), by power, for uniform numbers (k,)."""
        begin, end = self.begin.take(row), self.begin.take(row) + self.share.take(row)
        return pick_emitters(emitters, np.clip(begin + choice * (end - begin), begin, np.nextafter(end, 0.0)))

    def find_factors(self, instance: Integers, points: Receivers, count: int) -> Floats:
        """Return c_o / P_o (n,) of instances (n,), 1 of those that do not shine, from n points that aim at `count`."""
        factors, row = np.ones(len(instance)), self.number.take(instance)
        rows = np.flatnonzero(row >= 0)
        row = row.take(rows)
        chances = find_chances(self.tree, row, np.arange(len(rows)), points.select(rows), count)
        factors[rows] = chances / self.share.take(row)
        return factors


def group_emitters(emitters: Emitters, links: LightLinks | None, fewest: int) -> EmitterGroup | None:
    """Return emitters by object; None where there are not more than `fewest`."""
    units = np.arange(len(emitters.cumulative)) if emitters.number is None else emitters.number
    records, first = np.unique(locate_emitters(emitters, units)[0], return_index=True)
    if len(records) <= fewest:
        return None
    end = emitters.cumulative[np.append(first[1:], len(units)) - 1]
    begin = np.append(0.0, end[:-1])
    share = end - begin
    shines = share > 0  # what is lost in the sum is never picked
    records, begin, share = records[shines], begin[shines], share[shines]
    number = np.full(len(emitters.tables.material_first), -1)
    number[records] = np.arange(len(records))
    receivers = np.full(len(records), ALL_SETS) if links is None else links.receivers[records]
    tree = make_light_tree(_bound_objects(emitters, records, share, receivers))
    return EmitterGroup(tree, records, number, begin, share)


def _bound_objects(emitters: Emitters, records: Integers, share: Floats, receivers: NDArray[np.int64]) -> LightBounds:
    """Return the boxes of emissive objects, which shine in all directions."""
    count, geometry = len(records), emitters.tables.geometry
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    row = np.searchsorted(records, emitters.instance).clip(max=count - 1)
    listed = np.flatnonzero(records[row] == emitters.instance)
    reach = np.zeros(len(listed))
    corners = emitters.corners[listed]
    round_ = np.flatnonzero(geometry.belongs_to_kind(emitters.instance[listed], Kind.SPHERE))
    sphere = find_spheres(emitters.tables, emitters.instance[listed[round_]], emitters.primitive[listed[round_]])
    corners[round_], reach[round_] = geometry.centres[sphere][:, np.newaxis], geometry.radii[sphere]
    np.minimum.at(low, row[listed], corners.min(axis=1) - reach[:, np.newaxis])
    np.maximum.at(high, row[listed], corners.max(axis=1) + reach[:, np.newaxis])
    whole = np.flatnonzero(np.isinf(low[:, 0]))
    boxes = instance_bounds(geometry, records[whole])
    low[whole], high[whole] = boxes[:, 0], boxes[:, 1]
    axis = np.tile((0.0, 0.0, 1.0), (count, 1))
    return LightBounds(low, high, share, axis, np.full(count, np.pi), np.zeros(count), receivers)
