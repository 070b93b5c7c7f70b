"""Shadow caustics: Cycles' settings of objects and lights, and what is named where they cannot be had."""

from __future__ import annotations

from typing import Any

import bpy
import pytest
from numpy.testing import assert_array_equal

from addon.extract.scene import Extraction, extract_scene
from blend_scenes import building

pytestmark = pytest.mark.blender


def extract() -> Extraction:
    return extract_scene(bpy.context.evaluated_depsgraph_get())


@pytest.fixture
def asked_for(scene_with_camera: Any) -> dict[str, Any]:
    """Return a ball of glass over a floor under a lamp, of which caustics are asked for."""
    glass = building.make_shader("Glass", "Glass", (1, 1, 1), roughness=0.0, ior=1.45)
    floor = building.link_object("Floor", building.make_plane("Floor", 8, 8))
    ball = building.link_object("Ball", building.make_sphere("Ball", 0.5, 8), (0, 0, 1), materials=[glass])
    lamp = building.add_light("Lamp", "POINT", 100.0, (0, 0, 4), (0, 0, 0))
    floor.cycles.is_caustics_receiver = ball.cycles.is_caustics_caster = True
    lamp.data.cycles.is_caustics_light = True
    return {"floor": floor, "ball": ball, "lamp": lamp, "glass": glass}


def list_warned() -> list[tuple[str, str]]:
    """Return the objects that are named, with the first words of what is said of them."""
    return [(warning.object, " ".join(warning.text.split()[:3])) for warning in extract().warnings]


def test_settings_of_objects_and_lights_are_read(asked_for: dict[str, Any]) -> None:
    found = extract()
    names = [key.name for key in found.objects]
    instances = found.scene.instances
    assert instances is not None
    assert_array_equal(instances.caustics_caster, [name == "Ball" for name in names])
    assert_array_equal(instances.caustics_receiver, [name == "Floor" for name in names])
    assert [light.caustics for light in found.scene.lights] == [True]
    assert not found.warnings


def test_what_is_not_asked_for_is_not_there(asked_for: dict[str, Any]) -> None:
    asked_for["ball"].cycles.is_caustics_caster = asked_for["floor"].cycles.is_caustics_receiver = False
    asked_for["lamp"].data.cycles.is_caustics_light = False
    found = extract()
    instances = found.scene.instances
    assert instances is not None
    assert instances.caustics_caster is instances.caustics_receiver is None
    assert [light.caustics for light in found.scene.lights] == [False]


def test_rough_glass_and_flat_shading_are_named(asked_for: dict[str, Any]) -> None:
    said = [("Ball", "casts no shadow")]
    nodes = asked_for["glass"].node_tree.nodes
    socket = next(node for node in nodes if node.bl_idname == "ShaderNodeBsdfGlass").inputs["Roughness"]
    socket.default_value = 0.2
    assert list_warned() == said
    socket.default_value = 0.0
    assert not list_warned()
    for polygon in asked_for["ball"].data.polygons:
        polygon.use_smooth = False
    assert list_warned() == said


def test_lights_that_cannot_be_bent_are_named(asked_for: dict[str, Any]) -> None:
    lamp = asked_for["lamp"].data
    lamp.use_shadow = False
    assert list_warned() == [("Lamp", "lights with nodes,")]
    lamp.use_shadow = True
    lamp.type = "AREA"
    bpy.data.lights["Lamp"].spread = 0.0
    assert list_warned() == [("Lamp", "lights with nodes,")]


def test_the_world_and_volumes_are_named(asked_for: dict[str, Any]) -> None:
    building.set_world((0.5, 0.5, 0.5))
    bpy.context.scene.world.cycles.is_caustics_light = True
    (warning,) = extract().warnings
    assert warning.text.startswith("world 'Constant sky': shadow caustics of the world are not supported")
    tree = bpy.context.scene.world.node_tree
    scatter = tree.nodes.new("ShaderNodeVolumeScatter")
    output = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeOutputWorld")
    tree.links.new(scatter.outputs["Volume"], output.inputs["Volume"])
    assert ("Lamp", "where there are") in list_warned()


def test_nothing_is_named_where_a_setting_alone_does_nothing(asked_for: dict[str, Any]) -> None:
    for polygon in asked_for["ball"].data.polygons:
        polygon.use_smooth = False
    asked_for["floor"].cycles.is_caustics_receiver = False
    assert not list_warned()
