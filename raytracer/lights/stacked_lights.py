"""Lights alike as one record: the fields of many, each with a row for each sample.

What samples lights is written for one light, whose fields broadcast against n points; so do fields of n rows.
"""

from __future__ import annotations

import copy
from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats
from raytracer.lights.lights import has_radius
from raytracer.scene.fields import set_field
from raytracer.scene.lights import AreaLight, Light, PointLight, SpotLight

# What may differ between the lights of a record, by kind.
FIELDS: dict[type, tuple[str, ...]] = {
    PointLight: ("position", "power", "radius"),
    SpotLight: ("position", "power", "radius", "world_from_light", "spot_size", "spot_blend"),
    AreaLight: ("position", "axis_u", "axis_v", "power"),
}


def find_stack_key(light: Light) -> Hashable:
    """Return what lights of one record have in common; the light itself for one that has its own.

    Suns have no place, slats narrow the part of an area light that is sampled, and nodes are evaluated by light.
    """
    if light.nodes is None and isinstance(light, PointLight):
        return type(light), light.soft_falloff, has_radius(light)
    if light.nodes is None and isinstance(light, AreaLight) and light.spread >= np.pi:
        return type(light), light.shape
    return light


@dataclass(frozen=True, eq=False)
class LightStack:
    """Lights of one record; fields : of each, by name; empty for a single light."""

    example: Light
    fields: dict[str, Floats]

    def take(self, rows: NDArray[np.integer]) -> Light:
        """Return the record of the lights `rows` (n,), or the single light."""
        if not self.fields:
            return self.example
        record = copy.copy(self.example)
        for name, values in self.fields.items():
            set_field(record, name, values.take(rows, axis=0))
        return record


def stack_lights(lights: Sequence[Light]) -> tuple[list[LightStack], NDArray[np.int64], NDArray[np.int64]]:
    """Return the records of lights, and of each light its record and its row there, (lights,) each."""
    keys = {key: number for number, key in enumerate(dict.fromkeys(map(find_stack_key, lights)))}
    stack = np.array([keys[find_stack_key(light)] for light in lights], np.int64)
    row, stacks = np.zeros(len(lights), np.int64), []
    for number in range(len(keys)):
        members = np.flatnonzero(stack == number)
        row[members] = np.arange(len(members))
        example = lights[members[0]]
        names = FIELDS[type(example)] if len(members) > 1 else ()
        columns = {name: np.array([getattr(lights[k], name) for k in members], np.float64) for name in names}
        stacks.append(LightStack(example, columns))
    return stacks, stack, row
