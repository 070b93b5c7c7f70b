"""Holdout shaders, alone and mixed, straight and in a mirror, against Cycles."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import pytest

from blend_scenes import building
from tests.addon.against_cycles.node_fixtures import add_node
from tests.addon.against_cycles.test_pictures import LAMPS, add_lamp, assert_pictures_agree, make_grey, make_stage
from tests.addon.against_cycles.test_textures import checker, make_material, mix, shader

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]


def holdout(tree: Any) -> Any:
    return tree.nodes.new("ShaderNodeHoldout").outputs[0]


def constant(tree: Any) -> Any:
    node = tree.nodes.new("ShaderNodeValue")
    node.outputs[0].default_value = 0.3
    return node.outputs[0]


SHADERS: dict[str, Callable[[Any], Any]] = {
    "alone": holdout,
    "mixed": lambda tree: mix(tree, constant(tree), holdout(tree), shader(tree, "Diffuse")),
    "mixed by a texture": lambda tree: mix(tree, checker(tree), shader(tree, "Diffuse"), holdout(tree)),
    "over transparent": lambda tree: mix(tree, checker(tree), shader(tree, "Transparent"), holdout(tree)),
    "added to emission": lambda tree: mix(
        tree, constant(tree), holdout(tree), add_node(tree, "ShaderNodeEmission", {"Strength": 0.5}).outputs[0]
    ),
}


@pytest.mark.parametrize("transparent", [True, False], ids=["film transparent", "film opaque"])
@pytest.mark.parametrize("name", SHADERS)
def test_holdout_shaders_agree(name: str, transparent: bool) -> None:
    scene = make_stage()
    scene.render.film_transparent = transparent
    wall = building.make_plane("Wall", 2, 2)
    building.link_object("Wall", wall, (0, 0.5, 1.0), rotation=(80, 0, 0), materials=[make_material(SHADERS[name])])
    bpy.data.objects["Plane"].data.materials[0] = building.make_shader("Mirror", "Glossy", (0.9, 0.9, 0.9), roughness=0)
    building.link_object("Roof", building.make_plane("Roof", 8, 8), (0, 0, 4), materials=[make_grey()])
    add_lamp(*LAMPS["point"])
    assert_pictures_agree(scene, samples=16, max_bounces=1)
