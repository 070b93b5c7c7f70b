"""Ray portals against Cycles: what they show, alone and mixed, seen straight, in a mirror and by diffuse bounces."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import pytest

from addon.compare.cycles.comparison import compare_passes
from blend_scenes import building
from tests.addon.against_cycles.node_fixtures import add_node
from tests.addon.against_cycles.test_pictures import (
    LAMPS,
    SMALL_SIZE,
    add_lamp,
    assert_pictures_agree,
    make_grey,
    make_stage,
)
from tests.addon.against_cycles.test_textures import checker, make_material, mix, shader

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]

ELSEWHERE = (0.0, 0.0, 20.0)


def portal(tree: Any, moved: bool = True, turned: bool = False) -> Any:
    """Return a portal to what stands above, and one that turns rays aside."""
    node = add_node(tree, "ShaderNodeBsdfRayPortal", {"Color": (0.9, 0.7, 0.5, 1.0)})
    geometry = tree.nodes.new("ShaderNodeNewGeometry")
    if moved:
        shift = add_node(tree, "ShaderNodeVectorMath", {"Vector_001": ELSEWHERE}, operation="ADD")
        tree.links.new(geometry.outputs["Position"], shift.inputs[0])
        tree.links.new(shift.outputs[0], node.inputs["Position"])
    if turned:
        turn = add_node(tree, "ShaderNodeVectorMath", {"Vector_001": (-1.0, 1.0, -1.0)}, operation="MULTIPLY")
        tree.links.new(geometry.outputs["Incoming"], turn.inputs[0])
        tree.links.new(turn.outputs[0], node.inputs["Direction"])
    return node.outputs[0]


def depth(tree: Any) -> Any:
    """Return a share that grows with the number of portals on the way."""
    path = tree.nodes.new("ShaderNodeLightPath")
    share = add_node(tree, "ShaderNodeMath", {"Value_001": 0.4}, operation="MULTIPLY")
    tree.links.new(path.outputs["Portal Depth"], share.inputs[0])
    return share.outputs[0]


SHADERS: dict[str, Callable[[Any], Any]] = {
    "straight on": lambda tree: portal(tree, moved=False),
    "elsewhere": portal,
    "turned": lambda tree: portal(tree, moved=False, turned=True),
    "mixed with diffuse": lambda tree: mix(tree, checker(tree), portal(tree), shader(tree, "Diffuse")),
    "two": lambda tree: mix(tree, checker(tree), portal(tree, turned=True), portal(tree, moved=False)),
    "fading": lambda tree: mix(tree, depth(tree), portal(tree), shader(tree, "Diffuse")),
}


@pytest.mark.parametrize("name", SHADERS)
def test_portals_agree(name: str) -> None:
    scene = make_stage()
    wall = building.make_plane("Wall", 2, 2)
    building.link_object("Wall", wall, (0, 0.5, 1.0), rotation=(80, 0, 0), materials=[make_material(SHADERS[name])])
    bpy.data.objects["Plane"].data.materials[0] = building.make_shader("Mirror", "Glossy", (0.9, 0.9, 0.9), roughness=0)
    building.link_object("Roof", building.make_plane("Roof", 8, 8), (0, 0, 4), materials=[make_grey()])
    red = building.make_shader("Red", "Diffuse", (0.8, 0.2, 0.1))
    building.link_object("Room", building.make_plane("Room", 3, 3), (0.3, 3, 21), rotation=(70, 0, 0), materials=[red])
    add_lamp(*LAMPS["point"])
    lamp = add_lamp(*LAMPS["point"], location=(0.5, 1.0, 22.0))
    lamp.data.color = (0.4, 0.7, 1.0)
    building.set_world((0.05, 0.06, 0.08), 1.0)
    assert_pictures_agree(scene, samples=16, max_bounces=1)


@pytest.mark.parametrize("make", [portal, lambda tree: shader(tree, "Transparent")], ids=["portal", "clear"])
def test_passes_of_what_shows_the_background_are_the_backgrounds(make: Callable[[Any], Any]) -> None:
    """A plane that half of the picture sees, before the world."""
    scene = make_stage()
    plane = bpy.data.objects["Plane"]
    plane.data.materials.clear()
    plane.data.materials.append(make_material(make))
    plane.pass_index, plane.location.y = 3, 4.0
    passes = compare_passes(scene, bpy.context.view_layer, *SMALL_SIZE)
    assert {name: item.share for name, item in passes.items() if item.share} == {}
    assert (passes["Depth"].ours == 1e10).all()
