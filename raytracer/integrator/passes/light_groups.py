"""Light groups: Combined as each group of lights alone makes it, whatever path the light has taken.

Every light, the world, and every object that shines belongs to one group or to none; what comes from it is added to the
pass of its group besides, so that all groups, and what is in none, add up to Combined.

References
----------
Blender, intern/cycles/kernel/film/light_passes.h.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from raytracer.arrays.types import Integers
from raytracer.film.passes import LIGHT_GROUP, list_light_groups
from raytracer.integrator.emissive_source import EmissiveGeometry
from raytracer.integrator.light_sources import LightSource, SampledLight
from raytracer.integrator.picked_lights import PickedLight
from raytracer.scene.light_groups import NO_GROUP
from raytracer.scene.lights import Light
from raytracer.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class GroupedLight:
    """The number, among the passes of groups that are asked for, of what shines; NO_GROUP for what is in none of them.

    of_objects : (instances + groups of spheres,) int32
    """

    of_lights: Mapping[Light, int]
    of_objects: Integers
    of_world: int


def group_light(scene: Scene, passes: Sequence[str]) -> GroupedLight | None:
    """Return the groups of what shines in a scene; None where no pass asks, or there are none."""
    asked, groups = list_light_groups(passes), scene.light_groups
    if not asked or groups is None:
        return None
    number = np.array([find_number(LIGHT_GROUP + name, asked) for name in groups.names] + [NO_GROUP], dtype=np.int32)
    of_lights = dict(zip(scene.lights, number[groups.lights].tolist(), strict=True))
    return GroupedLight(of_lights, number[groups.objects], int(number[groups.world]))


def find_number(name: str, asked: Sequence[str]) -> int:
    """Return the place of a pass among those that are asked for."""
    return asked.index(name) if name in asked else NO_GROUP


def group_source(source: LightSource, grouped: GroupedLight) -> LightSource:
    """Return a source that says which group its light belongs to."""
    if isinstance(source, SampledLight):
        return replace(source, light_group=grouped.of_lights[source.light])
    if isinstance(source, PickedLight):
        of_lights = [grouped.of_lights[light] for light in source.group.lights]
        return replace(source, light_groups=np.array(of_lights, dtype=np.int32))
    if isinstance(source, EmissiveGeometry):
        return replace(source, light_groups=grouped.of_objects)
    return replace(source, light_group=grouped.of_world)
