"""The skies of older files, of Preetham and of Hosek and Wilkie, against Cycles: point by point, and as worlds."""

from __future__ import annotations

from itertools import product
from typing import Any

import bpy
import pytest

from addon.versions import find_node_tree
from tests.addon.against_cycles.node_fixtures import Make, add_node, measure_differences
from tests.addon.against_cycles.test_worlds import assert_pictures_agree, make_stage

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]

SUNS = ((0.0, 0.0, 1.0), (0.3, 0.5, 0.8), (-0.7, 0.2, 0.05), (0.5, 0.5, -0.2))
# At turbidity 1 Preetham's sky is of 1e30, which float32 keeps no better.
TOLERANCES = {"PREETHAM": 1e-3, "HOSEK_WILKIE": 1e-4}


def show_sky(kind: str, sun: tuple[float, float, float], turbidity: float, albedo: float) -> Make:
    """Return what shows a sky in the directions above, around and below a small plane."""

    def make(tree: Any) -> Any:
        place = tree.nodes.new("ShaderNodeTexCoord").outputs["Object"]
        inputs = {"Vector": place, "Vector_001": (2.0, 2.0, 1.0), "Vector_002": (0.0, 0.0, 0.2)}
        spread = add_node(tree, "ShaderNodeVectorMath", inputs, operation="MULTIPLY_ADD").outputs[0]
        unit = add_node(tree, "ShaderNodeVectorMath", {"Vector": spread}, operation="NORMALIZE").outputs[0]
        settings = {"sky_type": kind, "turbidity": turbidity, "ground_albedo": albedo, "sun_direction": sun}
        return add_node(tree, "ShaderNodeTexSky", {"Vector": unit}, **settings).outputs[0]

    return make


@pytest.mark.parametrize("kind", TOLERANCES)
def test_daylight_agrees_point_by_point(empty_scene: Any, record_property: Any, kind: str) -> None:
    cases = product(SUNS, (1.0, 2.2, 6.5, 10.0), (0.0, 0.3, 1.0) if kind == "HOSEK_WILKIE" else (0.3,))
    configurations = {str(case): show_sky(kind, *case) for case in cases}
    differences, _, warnings = measure_differences(empty_scene, configurations)
    record_property("largest_difference", max(differences.values()))
    assert not warnings
    assert max(differences.values()) < TOLERANCES[kind]


@pytest.mark.parametrize("kind", TOLERANCES)
def test_daylight_as_a_world_agrees(kind: str) -> None:
    scene = make_stage()
    scene.world = world = bpy.data.worlds.new("Daylight")
    tree = find_node_tree(world)
    if tree is None:
        world.use_nodes, tree = True, world.node_tree
    sky = add_node(tree, "ShaderNodeTexSky", sky_type=kind, turbidity=3.0, sun_direction=(0.5, -0.3, 0.6))
    background = next(node for node in tree.nodes if node.type == "BACKGROUND")
    tree.links.new(sky.outputs[0], background.inputs["Color"])
    background.inputs["Strength"].default_value = 0.2
    assert_pictures_agree(scene)
