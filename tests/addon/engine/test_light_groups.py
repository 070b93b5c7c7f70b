"""Light groups of what instancers show."""

from __future__ import annotations

from typing import Any

import bpy
import pytest

from addon.engine.light_groups import give_groups
from addon.extract.scene import extract_scene
from raytracer.film.passes import LIGHT_GROUP

pytestmark = pytest.mark.blender


@pytest.mark.parametrize("own", ["", "fill", "another"])
def test_what_is_in_no_group_is_in_its_instancer_s(scene_with_camera: Any, own: str) -> None:
    """As in Cycles; a group that the view layer does not name is one all the same."""
    collection, instancer = bpy.data.collections.new("Set"), bpy.data.objects.new("Instancer", None)
    scene_with_camera.collection.objects.link(instancer)
    instancer.instance_type, instancer.instance_collection, instancer.lightgroup = "COLLECTION", collection, "key"
    mesh, light = bpy.data.meshes.new("Mesh"), bpy.data.lights.new("Light", "POINT")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])
    light.energy = 1.0
    for data in (mesh, light):
        thing = bpy.data.objects.new(data.name, data)
        thing.lightgroup = own
        collection.objects.link(thing)
    extraction = extract_scene(bpy.context.evaluated_depsgraph_get())
    scene = give_groups(extraction.scene, extraction, None, (LIGHT_GROUP + "key", LIGHT_GROUP + "fill"))
    expected = {"": 0, "fill": 1, "another": -1}[own]
    assert (scene.light_groups.lights.tolist(), scene.light_groups.objects.tolist()) == ([expected], [expected])
