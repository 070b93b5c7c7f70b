"""Lights whose nodes vary, and lights that light what few bounces lead to, against Cycles."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import pytest

from addon import versions
from blend_scenes import building
from tests.addon.against_cycles.node_fixtures import add_node
from tests.addon.against_cycles.test_pictures import LAMPS, add_lamp, assert_pictures_agree, make_grey, make_stage

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]


def set_nodes(data: Any, make: Callable[[Any], Any], socket: str = "Color") -> None:
    """Link what `make` returns, raised above 0, to the light's own Emission node."""
    if versions.VERSION < (5, 1):
        data.use_nodes = True
    tree = data.node_tree
    emission = next(node for node in tree.nodes if node.type == "EMISSION")
    if socket == "Strength":
        tree.links.new(make(tree), emission.inputs[socket])
        return
    inputs = {"Vector": make(tree), "Vector_001": [0.3] * 3, "Vector_002": [0.6] * 3}
    raised = add_node(tree, "ShaderNodeVectorMath", inputs, operation="MULTIPLY_ADD")
    tree.links.new(raised.outputs[0], emission.inputs[socket])


def read(kind: str, output: str) -> Callable[[Any], Any]:
    return lambda tree: tree.nodes.new(kind).outputs[output]


def fall_off(output: str, smooth: float = 0.0) -> Callable[[Any], Any]:
    inputs = {"Strength": 0.7, "Smooth": smooth}
    return lambda tree: add_node(tree, "ShaderNodeLightFalloff", inputs).outputs[output]


NODES: dict[str, Callable[[Any], Any]] = {
    "uv": read("ShaderNodeTexCoord", "UV"),
    "normal": read("ShaderNodeTexCoord", "Normal"),
    "object": read("ShaderNodeTexCoord", "Object"),
    "random": read("ShaderNodeObjectInfo", "Random"),
}
KINDS = ("point", "ball", "spot with size", "sun", "wide sun", "rectangle", "disk")


# A ball's object coordinates are left out: means agree to 1e-4, but one tile's difference of as much is not noise.
CASES = [(kind, node) for kind in KINDS for node in NODES if (kind, node) != ("ball", "object")]
QUICK = (*((kind, "uv") for kind in KINDS), ("point", "random"), ("rectangle", "object"))


@pytest.mark.parametrize(
    ("kind", "node"), [pytest.param(*case, marks=() if case in QUICK else pytest.mark.slow) for case in CASES]
)
def test_lights_colored_by_nodes_agree(kind: str, node: str) -> None:
    scene = make_stage()
    lamp = add_lamp(*LAMPS[kind])
    if kind != "ball":  # which Cycles stretches, as none of ours is
        lamp.scale = (1.3, 0.8, 1.0)
    set_nodes(lamp.data, NODES[node])
    assert_pictures_agree(scene, samples=16)


@pytest.mark.parametrize("smooth", [0.0, 3.0])
@pytest.mark.parametrize("output", ["Quadratic", "Linear", "Constant"])
@pytest.mark.parametrize("kind", ["point", pytest.param("ball", marks=pytest.mark.slow), "wide sun"])
def test_light_falloff_agrees(kind: str, output: str, smooth: float) -> None:
    scene = make_stage()
    set_nodes(add_lamp(*LAMPS[kind]).data, fall_off(output, smooth), "Strength")
    assert_pictures_agree(scene, samples=16)


@pytest.mark.parametrize("node", ["uv", "depth", "length", "camera"])
@pytest.mark.parametrize(
    "kind", ["ball", *(pytest.param(k, marks=pytest.mark.slow) for k in ("spot with size", "disk"))]
)
def test_lights_that_are_seen_show_what_their_nodes_say(kind: str, node: str) -> None:
    """By the camera, and in a glossy floor; what kind of ray it is, no light is told."""
    nodes = NODES | {
        "depth": read("ShaderNodeLightPath", "Ray Depth"),
        "length": read("ShaderNodeLightPath", "Ray Length"),
        "camera": read("ShaderNodeLightPath", "Is Camera Ray"),
    }
    scene = make_stage()
    floor = building.make_shader("Glossy", "Anisotropic", (0.8, 0.8, 0.8))
    next(node for node in floor.node_tree.nodes if "Roughness" in node.inputs).inputs["Roughness"].default_value = 0.4
    bpy.data.objects["Plane"].data.materials[0] = floor
    lamp = add_lamp(*LAMPS[kind], location=(0.4, 1.0, 1.2), target=(0, -2, 0.6))
    lamp.visible_camera = True
    set_nodes(lamp.data, nodes[node])
    assert_pictures_agree(scene, samples=32, max_bounces=1)


@pytest.mark.parametrize("output", ["Ray Depth", "Diffuse Depth", "Glossy Depth", "Transparent Depth"])
def test_nodes_of_a_light_know_how_far_paths_have_come(output: str) -> None:
    """Light that has been scattered by a wall, by a glossy floor, and has passed a clear pane."""
    scene = make_stage()
    floor = building.make_shader("Glossy", "Glossy", (0.9, 0.9, 0.9), roughness=0.4)
    bpy.data.objects["Plane"].data.materials[0] = floor
    wall, pane = building.make_plane("Wall", 6, 3), building.make_plane("Pane", 2, 1)
    building.link_object("Wall", wall, (0, 1.5, 1.0), rotation=(80, 0, 0), materials=[make_grey()])
    clear = building.make_shader("Clear", "Transparent", (0.9, 0.9, 0.9))
    building.link_object("Pane", pane, (-1.5, -1.5, 1.0), rotation=(60, 0, 0), materials=[clear])
    set_nodes(add_lamp(*LAMPS["point"]).data, read("ShaderNodeLightPath", output))
    scene.reference_raytracer.integrator = "PATH"
    assert_pictures_agree(scene, samples=16, max_bounces=3)


def read_property(kind: str) -> Callable[[Any], Any]:
    def read_tint(tree: Any) -> Any:
        node = tree.nodes.new("ShaderNodeAttribute")
        node.attribute_type, node.attribute_name = kind, "tint"
        return node.outputs["Color"]

    return read_tint


@pytest.mark.parametrize("kind", ["OBJECT", "INSTANCER"])
def test_properties_of_objects_and_instancers_color_their_lights(kind: str) -> None:
    scene = make_stage()
    lamp = add_lamp(*LAMPS["point"])
    lamp["tint"] = (0.2, 0.5, 0.9)
    set_nodes(lamp.data, read_property(kind))
    collection = bpy.data.collections.new("Lamps")
    scene.collection.objects.unlink(lamp)
    collection.objects.link(lamp)
    for place, tint in enumerate(((0.9, 0.1, 0.1), (0.1, 0.2, 0.9))):
        instancer = bpy.data.objects.new("Instancer", None)
        instancer.instance_type, instancer.instance_collection = "COLLECTION", collection
        instancer.location, instancer["tint"] = (place, 0, 0), tint
        scene.collection.objects.link(instancer)
    assert_pictures_agree(scene, samples=16, max_bounces=0)


@pytest.mark.parametrize("limit", [0, 1])
def test_limits_of_bounces_agree(limit: int) -> None:
    """A second light, without a limit, goes on lighting what the first does not."""
    scene = make_stage()
    wall = building.make_plane("Wall", 6, 3)
    building.link_object("Wall", wall, (0, 1.5, 1.0), rotation=(80, 0, 0), materials=[make_grey()])
    add_lamp(*LAMPS["point"]).data.cycles.max_bounces = limit
    add_lamp(*LAMPS["point"], location=(-1.5, -1, 2), power=20.0)
    scene.reference_raytracer.integrator = "PATH"
    assert_pictures_agree(scene, samples=16, max_bounces=3)
