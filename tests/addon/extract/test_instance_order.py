"""Instances are numbered by what they are, not by when their objects were made; pictures do not tell."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import permutations
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Matrix

import raytracer
from addon.extract.instance_order import SIZES_PER_OCTAVE, measure_sizes, summarize, summarize_mesh
from addon.extract.scene import extract_scene
from raytracer.scene.materials import Closure, Material
from tests.addon.engine.engine_fixtures import make_emission
from tests.addon.extract.shaders.shader_trees import give_nodes

pytestmark = pytest.mark.blender

RED, GREEN = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)


def add_square(name: str, size: float, color: tuple[float, float, float], corner: float = 0.0) -> Any:
    """Add a square in the plane z = -1, which shines; Blender numbers names that are there already."""
    mesh = bpy.data.meshes.new(name)
    corners = [(corner, 0, -1), (corner + size, 0, -1), (corner + size, size, -1), (corner, size, -1)]
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    mesh.materials.append(make_emission(name, color))
    shown = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(shown)
    return shown


def add_glass(name: str, size: float, ior: float) -> None:
    shown = add_square(name, size, RED)
    nodes = give_nodes(shown, name)
    glass = nodes.nodes.new("ShaderNodeBsdfGlass")
    glass.inputs["IOR"].default_value, glass.inputs["Roughness"].default_value = ior, 0.0
    nodes.links.new(glass.outputs[0], nodes.nodes["Material Output"].inputs["Surface"])


def extract(geometry_only: bool = False) -> Any:
    return extract_scene(bpy.context.evaluated_depsgraph_get(), geometry_only=geometry_only)


def look_at_orders(makers: Sequence[Callable[[], Any]]) -> list[Any]:
    """Return a picture for each order in which objects can be made."""
    pictures = []
    for order in permutations(makers):
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
        camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
        camera.location = 0.5, 0.5, 1.0
        bpy.context.scene.collection.objects.link(camera)
        bpy.context.scene.camera = camera
        for make in order:
            make()
        pictures.append(raytracer.render(extract().scene, 8, 8, samples=1)["Combined"])
    return pictures


TWINS = {
    "a label and its bottle": [lambda: add_square("A", 2.0, RED), lambda: add_square("B", 1.0, GREEN)],
    "twins by name": [lambda: add_square("A", 1.0, RED), lambda: add_square("B", 1.0, GREEN)],
    "twins of one name": [lambda: add_square("A", 1.0, RED), lambda: add_square("A", 1.0, GREEN)],
    "three of one name": [
        *(lambda color=color: add_square("A", 1.0, color) for color in (RED, GREEN)),
        lambda: add_square("A", 1.0, GREEN, 0.5),
    ],
    "panes of glass": [
        *(lambda ior=ior: add_glass("A", 1.0, ior) for ior in (1.2, 1.6)),
        lambda: add_square("C", 9.0, GREEN, -3.0),
    ],
}


@pytest.mark.parametrize("name", TWINS)
def test_the_order_in_which_objects_were_made_does_not_change_the_picture(name: str) -> None:
    first, *others = look_at_orders(TWINS[name])
    assert first[..., :3].any()
    for picture in others:
        np.testing.assert_array_equal(picture, first)


def test_the_smaller_of_two_surfaces_is_seen(scene_with_camera: Any) -> None:
    scene_with_camera.camera.location = 0.5, 0.5, 1.0
    add_square("A", 40.0, RED, -20.0)
    add_square("B", 0.5, GREEN, 0.25).location.y = 0.25
    picture = raytracer.render(extract().scene, 9, 9, samples=1)["Combined"]
    np.testing.assert_array_equal(picture[4, 4, :3], GREEN)
    np.testing.assert_array_equal(picture[2, 0, :3], RED)


def test_all_that_belongs_to_an_instance_goes_with_it(scene_with_camera: Any) -> None:
    sizes = [3.0, 1.0, 2.0, 8.0]
    for number, size in enumerate(sizes):
        add_square(f"Square {number}", size, RED).pass_index = number
    extraction = extract()
    instances = extraction.scene.instances
    assert instances.pass_index.tolist() == [1, 2, 0, 3]
    assert [key.name for key in extraction.objects] == [f"Square {number}" for number in (1, 2, 0, 3)]
    widths = [np.ptp(extraction.scene.meshes[mesh].positions[:, 0]) for mesh in instances.mesh]
    assert widths == [1.0, 2.0, 3.0, 8.0]


def test_rays_that_scripts_cast_meet_instances_in_blenders_order(scene_with_camera: Any) -> None:
    for number, size in enumerate((3.0, 1.0, 2.0)):
        add_square(f"Square {number}", size, RED).pass_index = number
    assert extract(geometry_only=True).scene.instances.pass_index.tolist() == [0, 1, 2]


def measure(matrices: Sequence[Any]) -> Any:
    return measure_sizes(np.array(matrices), np.array([(2.0, 1.0, 0.0)] * len(matrices)))


def test_sizes_are_those_of_scaled_boxes_and_do_not_change_as_objects_turn() -> None:
    turned = [Matrix.Rotation(angle, 4, (1, 2, 3)) for angle in np.linspace(0, 6, 50)]
    assert len(set(measure([np.float32(matrix) for matrix in turned]))) == 1
    one, two, nothing = measure([np.diag([s, s, s, 1.0]) for s in (1.0, 2.0, 0.0)])
    assert nothing < one == two - SIZES_PER_OCTAVE


def test_marks_tell_contents_and_neither_names_nor_numbers() -> None:
    red, other = Material((Closure("diffuse", color=RED),), name="A"), Material((Closure("glossy"),))
    again = Material((Closure("diffuse", color=RED),), name="B")
    assert summarize(red) == summarize(again) != summarize(other)
    quad = {"positions": [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], "triangles": [(0, 1, 2), (0, 2, 3)]}
    first = summarize_mesh(raytracer.Mesh(**quad, material=[0, 1]), [red, other])
    assert first == summarize_mesh(raytracer.Mesh(**quad, material=[2, 0], name="A"), [other, other, again])
    assert first != summarize_mesh(raytracer.Mesh(**quad, material=[1, 0]), [red, other])
    assert first != summarize_mesh(raytracer.Mesh(**quad), [red, other])
