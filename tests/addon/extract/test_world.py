"""Worlds: a color or a program, and one clear warning for what is not supported."""

from __future__ import annotations

from typing import Any

import bpy
import pytest
from numpy.testing import assert_array_equal

from addon import versions
from addon.extract.world import WORLD_VISIBILITY
from raytracer.scene.fields import SEEN_BY, SEEN_BY_ALL
from raytracer.scene.programs import Register
from tests.addon.extract.shaders.shader_trees import add, clear_nodes, extract, texts

pytestmark = pytest.mark.blender


def test_no_world_is_black(shown: Any) -> None:
    assert bpy.context.scene.world is None
    assert extract().scene.world is None


@pytest.fixture
def world_tree(shown: Any) -> Any:
    bpy.context.scene.world = bpy.data.worlds.new("World")
    return clear_nodes(bpy.context.scene.world, "ShaderNodeOutputWorld")


def test_world_is_background_color_times_strength(world_tree: Any) -> None:
    add(world_tree, "ShaderNodeBackground", Color=(1, 0.5, 0.25, 1), Strength=2)
    assert_array_equal(extract().scene.world.color, (2, 1, 0.5))
    assert not texts()


def test_a_principled_shader_shines_in_a_world_as_far_as_it_emits(world_tree: Any) -> None:
    """As in Cycles; less what its alpha lets through."""
    add(world_tree, "ShaderNodeBsdfPrincipled", Emission_Color=(1, 0.5, 0.25, 1), Emission_Strength=2, Alpha=0.5)
    assert_array_equal(extract().scene.world.color, (1, 0.5, 0.25))
    assert not texts()


def test_world_without_shader_is_black(world_tree: Any) -> None:
    assert extract().scene.world is None


def test_world_that_varies_has_a_program(world_tree: Any) -> None:
    background = add(world_tree, "ShaderNodeBackground", Strength=2)
    coordinate = world_tree.nodes.new("ShaderNodeTexCoord")
    world_tree.links.new(coordinate.outputs["Generated"], background.inputs["Color"])
    world = extract().scene.world
    assert [step.operation for step in world.program.steps] == ["ATTRIBUTE Vector", "VECT_MATH Vector"]
    assert world.color == Register(1, "Vector")
    assert not texts()


def test_world_is_seen_by_the_rays_that_its_visibility_names(world_tree: Any) -> None:
    add(world_tree, "ShaderNodeBackground", Color=(0.25, 0.5, 1, 1))
    assert extract().scene.world.seen_by == SEEN_BY_ALL
    for name, label in WORLD_VISIBILITY.items():
        setattr(bpy.context.scene.world.cycles_visibility, name, False)
        bpy.context.scene.world.update_tag()  # 4.2 does not tell the depsgraph that is there
        world = extract().scene.world
        assert world.seen_by == SEEN_BY_ALL - SEEN_BY[label]
        assert_array_equal(world.color, (0.25, 0.5, 1))
        setattr(bpy.context.scene.world.cycles_visibility, name, True)


def test_world_is_seen_by_all_rays_where_cycles_is_off(without_cycles: None, world_tree: Any) -> None:
    """The properties of its add-on are not there then: every picture under a world was an internal error."""
    add(world_tree, "ShaderNodeBackground", Color=(0.25, 0.5, 1, 1))
    assert extract().scene.world.seen_by == SEEN_BY_ALL
    assert not texts()


def test_node_that_is_not_supported_is_replaced_by_the_sockets_color_and_named(world_tree: Any) -> None:
    background = add(world_tree, "ShaderNodeBackground", Color=(0.25, 0.5, 1, 1))
    unknown = world_tree.nodes.new("ShaderNodeShaderToRGB")
    world_tree.links.new(unknown.outputs[0], background.inputs["Color"])
    assert_array_equal(extract().scene.world.color, (0.25, 0.5, 1))
    (text,) = texts()
    assert text.startswith("world 'World': node 'Shader to RGB'")


@pytest.mark.skipif(versions.VERSION >= (5, 0), reason="worlds always have nodes since Blender 5.0")
def test_world_without_nodes_has_its_color(shown: Any) -> None:
    bpy.context.scene.world = bpy.data.worlds.new("World")
    bpy.context.scene.world.color = (0.25, 0.5, 1)
    assert_array_equal(extract().scene.world.color, (0.25, 0.5, 1))
