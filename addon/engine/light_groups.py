"""Light groups: which of a view layer's groups its lights, its objects and its world belong to.

References
----------
Blender, intern/cycles/blender/object.cpp, light.cpp and shader.cpp: an instance belongs to the group of the object that
it shows, and where that is in none to its instancer's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import bpy

import raytracer
from raytracer.film.passes import LIGHT_GROUP, list_light_groups
from raytracer.scene.light_groups import NO_GROUP

from ..extract.scene import Extraction


def give_groups(scene: raytracer.Scene, extraction: Extraction, world: Any, passes: Sequence[str]) -> raytracer.Scene:
    """Return the scene with the groups that passes ask for; as it is where none does.

    world : the world that is shown, or None
    """
    names = [name.removeprefix(LIGHT_GROUP) for name in list_light_groups(passes)]
    if not names:
        return scene
    known = {thing.session_uid: thing.lightgroup for thing in bpy.data.objects}

    def find(keys: Sequence[Any], instancers: Sequence[int]) -> list[int]:
        pairs = zip(keys, instancers, strict=True)
        return [find_number(known.get(key.session_uid, "") or known.get(shows, ""), names) for key, shows in pairs]

    of_world = NO_GROUP if world is None else find_number(world.lightgroup, names)
    lights = find(extraction.lights, extraction.light_instancers)
    groups = raytracer.LightGroups(names, lights, find(extraction.objects, extraction.instancers), of_world)
    return replace(scene, light_groups=groups)


def find_number(name: str, names: Sequence[str]) -> int:
    """Return the number of a group, NO_GROUP for what belongs to none of them."""
    return names.index(name) if name in names else NO_GROUP
