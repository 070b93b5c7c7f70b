"""Zones, closures and menus in shader nodes: as the nodes that Blender makes of them."""

from __future__ import annotations

from typing import Any

import bpy
import pytest
from numpy.testing import assert_allclose

from addon import versions
from tests.addon.extract.shaders.shader_trees import add, clear_nodes, extract, extract_closure, extract_material, texts

pytestmark = [
    pytest.mark.blender,
    pytest.mark.skipif(versions.VERSION < (5, 0), reason="shader nodes have none of these"),
]


def repeat_gamma(tree: Any, start: Any) -> Any:
    """Return what Gamma makes of a color three times over."""
    first, last = tree.nodes.new("GeometryNodeRepeatInput"), tree.nodes.new("GeometryNodeRepeatOutput")
    first.pair_with_output(last)
    last.repeat_items.new("RGBA", "Color")
    first.inputs["Iterations"].default_value = 3
    gamma = tree.nodes.new("ShaderNodeGamma")
    gamma.inputs["Gamma"].default_value = 2.0
    tree.links.new(start, first.inputs["Color"])
    tree.links.new(first.outputs["Color"], gamma.inputs["Color"])
    tree.links.new(gamma.outputs["Color"], last.inputs["Color"])
    return last.outputs["Color"]


def test_a_repeat_zone_repeats(tree: Any) -> None:
    emission = add(tree, "ShaderNodeEmission")
    tree.links.new(repeat_gamma(tree, tree.nodes.new("ShaderNodeUVMap").outputs[0]), emission.inputs["Color"])
    program = extract_material().program
    assert [step.operation for step in program.steps] == ["ATTRIBUTE Vector", "GAMMA", "GAMMA", "GAMMA"]
    assert not texts()


def test_a_menu_within_a_group_chooses_a_shader(tree: Any) -> None:
    group = bpy.data.node_groups.new("Group", "ShaderNodeTree")
    group.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    choice, end = group.nodes.new("GeometryNodeMenuSwitch"), group.nodes.new("NodeGroupOutput")
    choice.data_type = "SHADER"
    for kind, socket in (("ShaderNodeEmission", choice.inputs[1]), ("ShaderNodeBsdfDiffuse", choice.inputs[2])):
        group.links.new(group.nodes.new(kind).outputs[0], socket)
    group.links.new(choice.outputs[0], end.inputs[0])
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = group
    tree.links.new(node.outputs[0], tree.nodes[0].inputs["Surface"])
    for name, kind in (("A", "emission"), ("B", "diffuse")):
        choice.inputs[0].default_value = name
        assert extract_closure().kind == kind
    assert not texts()


@pytest.mark.parametrize("shines", ["world", "light"])
def test_worlds_and_lights_have_zones_as_well(shown: Any, shines: str) -> None:
    if shines == "world":
        owner = bpy.context.scene.world = bpy.data.worlds.new("World")
    else:
        owner = bpy.data.lights.new("Light", "POINT")
        owner.energy, owner.use_nodes = 1.0, True
        bpy.context.scene.collection.objects.link(bpy.data.objects.new("Light", owner))
    tree = clear_nodes(owner, f"ShaderNodeOutput{shines.capitalize()}")
    emission, color = add(tree, "ShaderNodeEmission"), tree.nodes.new("ShaderNodeRGB")
    color.outputs[0].default_value = (0.5, 1.0, 1.0, 1.0)
    tree.links.new(repeat_gamma(tree, color.outputs[0]), emission.inputs["Color"])
    scene = extract().scene
    found = scene.world.color if shines == "world" else scene.lights[0].power
    assert_allclose(found, (0.5**8, 1.0, 1.0))
    assert not texts()
