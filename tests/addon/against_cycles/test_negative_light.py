"""Light below 0, which takes light away, against Cycles: lamps, surfaces and worlds."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import pytest

from addon.versions import find_node_tree
from blend_scenes import building
from tests.addon.against_cycles.node_fixtures import add_node
from tests.addon.against_cycles.test_pictures import LAMPS, add_lamp, assert_pictures_agree, make_stage
from tests.addon.against_cycles.test_textures import make_material

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]


def emission(tree: Any, strength: Any) -> Any:
    inputs = {"Color": (1.0, 0.5, 0.2, 1.0), "Strength": strength}
    return add_node(tree, "ShaderNodeEmission", inputs).outputs[0]


def principled(tree: Any, strength: Any) -> Any:
    inputs = {"Emission Color": (1.0, 0.5, 0.2, 1.0), "Emission Strength": strength}
    return add_node(tree, "ShaderNodeBsdfPrincipled", inputs).outputs[0]


def slope(tree: Any) -> Any:
    """Return a number that is below 0 on one side."""
    place = tree.nodes.new("ShaderNodeTexCoord").outputs["Object"]
    return add_node(tree, "ShaderNodeSeparateXYZ", {"Vector": place}).outputs["X"]


SURFACES: dict[str, Callable[[Any], Any]] = {
    "emission": lambda tree: emission(tree, -1.0),
    "computed emission": lambda tree: emission(tree, slope(tree)),
    "principled": lambda tree: principled(tree, -1.0),  # none, as in Cycles
    "computed principled": lambda tree: principled(tree, slope(tree)),
}


@pytest.mark.parametrize("name", SURFACES)
def test_surfaces_that_take_light_agree(name: str) -> None:
    scene = make_stage()
    building.set_world((0.5, 0.5, 0.5), 1.0)
    sheet = building.make_plane("Sheet", 1.5, 1.5)
    building.link_object("Sheet", sheet, (0, 0.2, 0.8), materials=[make_material(SURFACES[name])])
    assert_pictures_agree(scene, samples=32, max_bounces=1)


@pytest.mark.parametrize("name", ["point", "ball", "spot with size", "wide sun", "rectangle"])
def test_lamps_that_take_light_agree(name: str) -> None:
    scene = make_stage()
    building.set_world((0.5, 0.5, 0.5), 1.0)
    kind, settings = LAMPS[name]
    add_lamp(kind, settings, power=-1.0 if kind == "SUN" else -60.0)
    assert_pictures_agree(scene, samples=16)


@pytest.mark.parametrize("is_computed", [False, True])
def test_worlds_that_take_light_agree(is_computed: bool) -> None:
    scene = make_stage()
    add_lamp(*LAMPS["point"])
    building.set_world((0.5, 0.4, 0.2), 1.0)
    tree = find_node_tree(bpy.context.scene.world)
    background = next(node for node in tree.nodes if node.type == "BACKGROUND")
    if is_computed:
        place = tree.nodes.new("ShaderNodeTexCoord").outputs["Generated"]
        height = add_node(tree, "ShaderNodeSeparateXYZ", {"Vector": place}).outputs["Y"]
        tree.links.new(height, background.inputs["Strength"])
    else:
        background.inputs["Strength"].default_value = -1.0
    assert_pictures_agree(scene, samples=32)
