"""Shadow caustics that were asked for and cannot be had, named in warnings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

import raytracer
from raytracer.caustics.casters import find_casters
from raytracer.integrator.features import derive_features
from raytracer.lights.bent_light import can_bend

from .. import versions
from .parts import ObjectEntry, ObjectKey
from .warnings import WarningList

INSTEAD = "its light comes through glass as paths find it"


def warn_caustics(
    scene: raytracer.Scene,
    objects: Sequence[ObjectKey],
    light_objects: Sequence[ObjectKey],
    parts: Sequence[ObjectEntry],
    world: Any,
    warnings: WarningList,
) -> None:
    """Name the lights and objects whose shadow caustics are left out; where none are asked for, nothing is named.

    objects, light_objects : of the scene's instances and groups, and of its lights
    parts : what the scene was made from
    world : bpy.types.World, or None
    """
    casts, receives = (any(part.caustics[number] for part in parts) for number in range(2))
    from_world = world is not None and scene.world is not None and versions.makes_caustics(world)
    if not (casts and receives and (from_world or any(light.caustics for light in scene.lights))):
        return
    if from_world:
        warnings.add(f"world '{world.name}': shadow caustics of the world are not supported: {INSTEAD}")
    features = derive_features(scene)
    for light, key in zip(scene.lights, light_objects, strict=True):
        if light.caustics and not (can_bend(light) and light.cast_shadow):
            what = "nodes, without shadows, or with a spread of 0"
            warnings.add(f"lights with {what} make no shadow caustics: {INSTEAD}", key.name)
        elif light.caustics and features.media:
            warnings.add(f"where there are volumes no light makes shadow caustics: {INSTEAD}", key.name)
    for part in parts:
        if part.mesh is None and any(part.caustics):
            warnings.add("only meshes cast or receive shadow caustics: light comes as paths find it", part.object.name)
    asked = scene.instances.caustics_caster if scene.instances is not None else None
    for row in np.flatnonzero(asked & ~find_casters(scene)) if asked is not None else ():
        warnings.add(
            "casts no shadow caustics, which need smooth shading and clear glass of roughness 0, without bumps or "
            "transparency: light comes through it as paths find it",
            objects[row].name,
        )
