"""Displacement that is shown as a bump, against Cycles, point by point."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
import pytest

from addon.extract.scene import extract_scene
from blend_scenes import building
from tests.addon.against_cycles.node_fixtures import add_node, render_centres, render_cycles
from tests.addon.against_cycles.test_pictures import add_lamp, make_stage
from tests.addon.against_cycles.test_textures import (
    SAME_FADING,
    bump,
    make_material,
    mix,
    noise,
    shader,
)

# Points at borders of shadows; there Cycles' float32 also rounds heights a tenth of a pixel apart to others.
BORDER_SHARE = 0.005

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]


def displacement(tree: Any, space: str = "OBJECT", **inputs: Any) -> Any:
    values = {"Height": noise(tree, 3.0), "Scale": 0.3, **inputs}
    return add_node(tree, "ShaderNodeDisplacement", values, space=space).outputs[0]


def freely(tree: Any, space: str) -> Any:
    inputs = {"Vector": noise(tree, 3.0, "Color"), "Midlevel": 0.4, "Scale": 0.3}
    return add_node(tree, "ShaderNodeVectorDisplacement", inputs, space=space).outputs[0]


def fresnel(tree: Any) -> Any:
    return add_node(tree, "ShaderNodeFresnel").outputs[0]


DISPLACEMENTS: dict[str, Callable[[Any], Any]] = {
    "along the normal": displacement,
    "in the world": lambda tree: displacement(tree, "WORLD"),
    "from another level": lambda tree: displacement(tree, Midlevel=noise(tree, 5.0)),
    "a bare color": lambda tree: noise(tree, 2.0, "Color"),
    "a vector of the object": lambda tree: freely(tree, "OBJECT"),
    "a vector of the world": lambda tree: freely(tree, "WORLD"),
}
SURFACES: dict[str, Callable[[Any], Any]] = {
    "diffuse": lambda tree: shader(tree, "Diffuse"),
    "principled": lambda tree: shader(tree, "Principled", Roughness=0.5),
    "glossy with a bump of its own": lambda tree: shader(tree, "Anisotropic", Roughness=0.5, Normal=bump(tree, 0.05)),
    "mixed by what the normal says": lambda tree: mix(
        tree, fresnel(tree), shader(tree, "Diffuse"), shader(tree, "Diffuse", Color=(0.1, 0.2, 0.9, 1.0))
    ),
}


def place_ball(surface: Callable[[Any], Any], moved: Callable[[Any], Any], method: str = "BUMP") -> Any:
    make_stage()
    add_lamp("POINT", {"shadow_soft_size": 0.0}, location=(2.5, -2.5, 3.0), power=300.0)
    material = make_material(surface)
    tree = material.node_tree
    output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    tree.links.new(moved(tree), output.inputs["Displacement"])
    material.displacement_method = method
    ball = building.make_sphere("Ball", 1.2, 64)
    building.link_object("Ball", ball, (0, 0.2, 1.2), materials=[material])
    return material


def assert_points_agree() -> None:
    (ours, warnings), cycles = render_centres(96, 72), render_cycles(96, 72)
    assert not warnings
    difference = np.abs(ours - cycles).max(axis=2)
    assert np.quantile(difference, 1.0 - BORDER_SHARE) < 2e-3
    assert abs(ours.mean() - cycles.mean()) < 1e-4


@SAME_FADING
@pytest.mark.parametrize("moved", DISPLACEMENTS)
def test_a_displacement_that_is_only_a_bump_agrees(moved: str) -> None:
    place_ball(SURFACES["diffuse"], DISPLACEMENTS[moved])
    assert_points_agree()


@SAME_FADING
@pytest.mark.parametrize("surface", SURFACES)
def test_all_of_the_surface_is_bent_by_its_displacement(surface: str) -> None:
    """Closures without normals of their own, and nodes that read the normal."""
    place_ball(SURFACES[surface], displacement)
    assert_points_agree()


@pytest.mark.parametrize("method", ["DISPLACEMENT", "BOTH"])
def test_geometry_that_should_move_is_shown_as_a_bump_and_named(method: str) -> None:
    place_ball(SURFACES["diffuse"], displacement, method)
    extraction = extract_scene(bpy.context.evaluated_depsgraph_get())
    assert ["shown as a bump" in warning.text for warning in extraction.warnings] == [True]
    assert [material.normal is not None for material in extraction.scene.materials].count(True) == 1


def test_a_displacement_that_nothing_computes_bends_nothing() -> None:
    material = place_ball(SURFACES["diffuse"], lambda tree: add_node(tree, "ShaderNodeRGB").outputs[0])
    extraction = extract_scene(bpy.context.evaluated_depsgraph_get())
    found = next(record for record in extraction.scene.materials if record.name == material.name)
    assert found.normal is None
    assert found.program is None
    assert not extraction.warnings
