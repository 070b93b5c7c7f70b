"""Displacement as a bump, and of geometry, against Cycles, point by point."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
import pytest

from addon.extract.kept import Changes, Kept
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


def noise_at(tree: Any, kind: str, output: str) -> Any:
    place = tree.nodes.new(kind).outputs[output]
    return add_node(tree, "ShaderNodeTexNoise", {"Vector": place, "Scale": 1.5, "Detail": 1.0}).outputs["Fac"]


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
    "of where the surface was": lambda tree: displacement(tree, Height=noise_at(tree, "ShaderNodeTexCoord", "Object")),
    "of where it was in the world": lambda tree: displacement(
        tree, Height=noise_at(tree, "ShaderNodeNewGeometry", "Position")
    ),
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


def assert_tiles_agree() -> None:
    """Cycles takes slopes of what moves and bends where the surface was, ours where it is: pixels differ, not tiles."""
    (ours, warnings), cycles = render_centres(96, 72), render_cycles(96, 72)
    assert not warnings
    difference = np.abs((ours - cycles).reshape(9, 8, 12, 8, 3).mean(axis=(1, 3)))
    assert difference.max() < 0.01 * ours.max()
    assert abs(ours.mean() - cycles.mean()) < 2e-3 * ours.mean()


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


@SAME_FADING
@pytest.mark.parametrize("moved", DISPLACEMENTS)
def test_geometry_that_a_displacement_moves_agrees(moved: str) -> None:
    place_ball(SURFACES["diffuse"], DISPLACEMENTS[moved], "DISPLACEMENT")
    assert_points_agree()


@SAME_FADING
@pytest.mark.parametrize("smooth", [True, False], ids=["smooth", "flat"])
@pytest.mark.parametrize("moved", [name for name in DISPLACEMENTS if name != "a bare color"])
def test_geometry_that_moves_and_is_bent_agrees(moved: str, smooth: bool) -> None:
    """Not where the ball moves by half its size, and slopes here and there differ by 3% of the light in a tile."""
    place_ball(SURFACES["diffuse"], DISPLACEMENTS[moved], "BOTH")
    ball = bpy.data.objects["Ball"]
    ball.data.polygons.foreach_set("use_smooth", [smooth] * len(ball.data.polygons))
    assert_tiles_agree()


@pytest.mark.parametrize("smooth", [True, False], ids=["smooth", "flat"])
def test_moved_meshes_keep_their_flat_faces(smooth: bool) -> None:
    """A ball that is scaled and turned, with a second material that moves nothing on some of its faces."""
    place_ball(SURFACES["diffuse"], displacement, "DISPLACEMENT")
    ball = bpy.data.objects["Ball"]
    ball.scale, ball.rotation_euler = (1.1, 1.1, 1.1), (0.4, 0.3, 0.2)
    ball.data.materials.append(building.make_shader("Still", "Diffuse", (0.2, 0.6, 0.8)))
    polygons = ball.data.polygons
    polygons.foreach_set("use_smooth", [smooth] * len(polygons))
    polygons.foreach_set("material_index", [int(k % 7 == 0) for k in range(len(polygons))])
    assert_points_agree()


def test_a_constant_displacement_moves_geometry_and_bends_nothing() -> None:
    """In world space, though the object is turned and scaled."""
    material = place_ball(
        SURFACES["diffuse"], lambda tree: add_node(tree, "ShaderNodeCombineXYZ", {"X": 0.5}).outputs[0]
    )
    before = extract_scene(bpy.context.evaluated_depsgraph_get()).scene
    material.displacement_method = "DISPLACEMENT"
    ball = bpy.data.objects["Ball"]
    ball.rotation_euler, ball.scale = (0.3, 0.2, 0.9), (1.0, 2.0, 1.0)
    extraction = extract_scene(bpy.context.evaluated_depsgraph_get())
    assert not extraction.warnings
    number = next(k for k, mesh in enumerate(extraction.scene.meshes) if mesh.name == "Ball")
    (row,) = np.flatnonzero(extraction.scene.instances.mesh == number)
    linear = extraction.scene.instances.world_from_object[row, :3, :3]
    moved = extraction.scene.meshes[number].positions - before.meshes[number].positions
    np.testing.assert_allclose(moved @ linear.T, np.broadcast_to((0.5, 0.0, 0.0), moved.shape), atol=1e-12)
    np.testing.assert_array_equal(extraction.scene.meshes[number].attributes.keys(), [])


def test_what_does_not_change_is_not_moved_again(monkeypatch: pytest.MonkeyPatch) -> None:
    material = place_ball(SURFACES["diffuse"], displacement, "DISPLACEMENT")
    kept = Kept()
    first = extract_scene(bpy.context.evaluated_depsgraph_get(), kept=kept).scene
    kept.changes = Changes()
    bpy.data.objects["Ball"].location.x += 0.0
    monkeypatch.setattr("addon.extract.displacing.displace", lambda *_: pytest.fail("moved again"))
    second = extract_scene(bpy.context.evaluated_depsgraph_get(), kept=kept).scene
    assert all(one is other for one, other in zip(first.meshes, second.meshes, strict=True))
    monkeypatch.undo()
    next(node for node in material.node_tree.nodes if node.type == "DISPLACEMENT").inputs["Scale"].default_value = 0.1
    third = extract_scene(bpy.context.evaluated_depsgraph_get(), kept=Kept()).scene
    assert any(one is not other for one, other in zip(first.meshes, third.meshes, strict=True))


def test_a_displacement_that_nothing_computes_bends_nothing() -> None:
    material = place_ball(SURFACES["diffuse"], lambda tree: add_node(tree, "ShaderNodeRGB").outputs[0])
    extraction = extract_scene(bpy.context.evaluated_depsgraph_get())
    found = next(record for record in extraction.scene.materials if record.name == material.name)
    assert found.normal is None
    assert found.program is None
    assert not extraction.warnings
