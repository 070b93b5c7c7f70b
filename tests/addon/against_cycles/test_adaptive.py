"""Adaptive subdivision against Cycles, point by point: what is displaced, and what is carried along.

Both engines sample the same limit surface, at other points of it: the finer the dice, the closer the pictures.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from addon import versions
from blend_scenes import building
from tests.addon.against_cycles.node_fixtures import make_material as make_shining
from tests.addon.against_cycles.node_fixtures import render_centres, render_cycles
from tests.addon.against_cycles.test_displacement import BORDER_SHARE, DISPLACEMENTS, SURFACES, place_ball
from tests.addon.against_cycles.test_textures import SAME_FADING

SIZE = (96, 72)
# Normals of triangles half a pixel wide turn by so much where the noise bends most.
DIFFERENCE = 4e-3
# What is linear between vertices half a pixel apart, of values that change by 1 over the picture; those of the monkey
# change by 1 over its polygons, which are a tenth as large. (Both are a quarter of that where edges are 2.5 times
# shorter.)
CARRIED, CARRIED_BY_SMALL_POLYGONS = 1e-3, 1.3e-2

pytestmark = [
    pytest.mark.blender,
    pytest.mark.usefixtures("registered_addon"),
    pytest.mark.skipif(versions.VERSION < (5, 0), reason="adaptive subdivision is experimental, and warned of"),
]


def make_adaptive(thing: Any, pixels: float, **settings: Any) -> Any:
    """Add the modifier, and let renders and the viewport, which is what is read here, ask the same."""
    scene = bpy.context.scene
    scene.cycles.preview_dicing_rate = scene.cycles.dicing_rate = 1.0
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = *SIZE, 100
    modifier = thing.modifiers.new("Subdivision", "SUBSURF")
    modifier.use_adaptive_subdivision, modifier.adaptive_pixel_size = True, pixels
    for name, value in settings.items():
        setattr(modifier, name, value)
    return modifier


def place_cube(moved: str, method: str = "DISPLACEMENT", pixels: float = 0.5, **settings: Any) -> Any:
    """The ball of the tests of displacement as a cage of six polygons."""
    place_ball(SURFACES["diffuse"], DISPLACEMENTS[moved], method)
    ball = bpy.data.objects["Ball"]
    cube = building.make_box("Cube", 2.2, 2.2, 2.2)
    cube.transform(Matrix.Translation((0, 0, -1.1)))
    cube.materials.append(ball.data.materials[0])
    cube.polygons.foreach_set("use_smooth", [True] * 6)
    ball.data = cube
    make_adaptive(ball, pixels, **settings)
    return ball


def assert_points_agree(limit: float = DIFFERENCE) -> None:
    (ours, warnings), cycles = render_centres(*SIZE), render_cycles(*SIZE)
    assert not warnings
    difference = np.abs(ours - cycles).max(axis=2)
    assert np.quantile(difference, 1.0 - 2.0 * BORDER_SHARE) < limit
    assert abs(ours.mean() - cycles.mean()) < 1e-4


@SAME_FADING
@pytest.mark.parametrize("moved", [name for name in DISPLACEMENTS if name != "from another level"])
def test_displacements_agree(moved: str) -> None:
    place_cube(moved)
    assert_points_agree()


@SAME_FADING
@pytest.mark.parametrize("method", ["BOTH", "BUMP"])
def test_bumps_on_the_limit_surface_agree(method: str) -> None:
    place_cube("along the normal", method)
    assert_points_agree()


@SAME_FADING
def test_finer_dice_agree_better() -> None:
    place_cube("along the normal", pixels=0.25)
    assert_points_agree(1e-3)


@SAME_FADING
def test_edges_measured_in_the_object_agree() -> None:
    cube = place_cube("along the normal")
    cube.modifiers[0].adaptive_space, cube.modifiers[0].adaptive_object_edge_length = "OBJECT", 0.015
    assert_points_agree()


@SAME_FADING
def test_uneven_scale_agrees() -> None:
    cube = place_cube("along the normal")
    cube.scale, cube.rotation_euler = (1.0, 0.5, 1.3), (0.3, 0.4, 0.5)
    assert_points_agree(2 * DIFFERENCE)


@SAME_FADING
def test_one_polygon_becomes_a_landscape() -> None:
    """Near the camera a hundred times as fine as far from it."""
    place_ball(SURFACES["diffuse"], DISPLACEMENTS["along the normal"], "DISPLACEMENT")
    bpy.data.objects["Ball"].hide_render = bpy.data.objects["Ball"].hide_viewport = True
    plane = bpy.data.objects["Plane"]
    plane.data.materials[0] = bpy.data.objects["Ball"].data.materials[0]
    make_adaptive(plane, 0.5, subdivision_type="SIMPLE")
    camera = bpy.context.scene.camera
    camera.location = (0, -4.2, 0.8)
    building.aim(camera, (0, 0, 0.2))
    assert_points_agree(4 * DIFFERENCE)


def texture(output: str) -> Callable[[Any], Any]:
    return lambda tree: tree.nodes.new("ShaderNodeTexCoord").outputs[output]


def geometry(output: str) -> Callable[[Any], Any]:
    return lambda tree: tree.nodes.new("ShaderNodeNewGeometry").outputs[output]


def attribute(name: str) -> Callable[[Any], Any]:
    def make(tree: Any) -> Any:
        node = tree.nodes.new("ShaderNodeAttribute")
        node.attribute_name = name
        return node.outputs["Color"]

    return make


CARRIED_VALUES = {
    "UV": texture("UV"),
    "Generated": texture("Generated"),
    "Position": geometry("Position"),
    "Normal": geometry("Normal"),
    "Tangent": geometry("Tangent"),
    "Pointiness": geometry("Pointiness"),
    "Random Per Island": geometry("Random Per Island"),
    "of vertices": attribute("vertex"),
    "of corners": attribute("corner"),
    "of polygons": attribute("polygon"),
}
SHAPES: dict[str, Callable[[], None]] = {
    "cube": bpy.ops.mesh.primitive_cube_add,
    "monkey": bpy.ops.mesh.primitive_monkey_add,
    "prism": lambda: bpy.ops.mesh.primitive_cylinder_add(vertices=5),
}


def place_shining(value: str, shape: str, creases: tuple[float, ...] = (0.0,), **settings: Any) -> None:
    """A shape that shines with what it carries."""
    building.start_scene()
    building.add_camera((2.5, -4, 2.5), (0, 0, 0), 60)
    SHAPES[shape]()
    thing = bpy.context.object
    mesh, random = thing.data, np.random.default_rng(1)
    mesh.materials.append(make_shining("Shining", CARRIED_VALUES[value]))
    mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
    for name, domain, count in (
        ("vertex", "POINT", len(mesh.vertices)),
        ("corner", "CORNER", len(mesh.loops)),
        ("polygon", "FACE", len(mesh.polygons)),
    ):
        mesh.attributes.new(name, "FLOAT", domain).data.foreach_set("value", random.random(count).astype(np.float32))
    sharpness = mesh.attributes.new("crease_edge", "FLOAT", "EDGE")
    sharpness.data.foreach_set("value", np.resize(creases, len(mesh.edges)).astype(np.float32))
    make_adaptive(thing, 0.5, **settings)


@pytest.mark.parametrize("value", CARRIED_VALUES)
def test_what_is_carried_along_the_limit_surface_agrees(value: str) -> None:
    place_shining(value, "cube")
    assert_points_agree(CARRIED)


@pytest.mark.parametrize("value", ["UV", "Normal", "of corners"])
def test_what_is_carried_along_many_polygons_agrees(value: str) -> None:
    place_shining(value, "monkey")
    assert_points_agree(CARRIED_BY_SMALL_POLYGONS)


@pytest.mark.parametrize("value", CARRIED_VALUES)
def test_what_is_carried_over_polygons_agrees(value: str) -> None:
    place_shining(value, "prism", subdivision_type="SIMPLE")
    assert_points_agree(CARRIED)


@pytest.mark.parametrize(
    "rule",
    [
        "NONE",
        "PRESERVE_CORNERS",
        "PRESERVE_CORNERS_AND_JUNCTIONS",
        "PRESERVE_CORNERS_JUNCTIONS_AND_CONCAVE",
        "SMOOTH_ALL",
    ],
)
def test_maps_agree_by_each_rule(rule: str) -> None:
    place_shining("UV", "cube", uv_smooth=rule)
    assert_points_agree(CARRIED)


@pytest.mark.parametrize("creases", [(1.0, 0.0, 0.0), (0.25,), (0.05, 0.3)])
def test_creases_agree(creases: tuple[float, ...]) -> None:
    """Those that fade within three refinements, after which Cycles takes them for smooth, and those that never do."""
    place_shining("Position", "cube", creases)
    assert_points_agree(CARRIED)
