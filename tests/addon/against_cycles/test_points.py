"""Attributes of point clouds that Attribute nodes read, against Cycles."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest

from tests.addon.against_cycles.node_fixtures import CELL, add_node, make_material, render_centres, render_cycles
from tests.addon.extract.test_instances import add_nodes_modifier

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]

# Cycles holds values, and the color v - LOWEST that shines, in float32: a few roundings of numbers up to 16.
TOLERANCE = 16 * 4 * float(np.finfo(np.float32).eps)
COUNT = 4  # points of a cloud, each in a cell of a row
# Blender's types of attributes: the field of their values, and numbers per value.
KINDS = {
    "FLOAT": ("value", 1),
    "INT": ("value", 1),
    "INT8": ("value", 1),
    "BOOLEAN": ("value", 1),
    "FLOAT2": ("vector", 2),
    "FLOAT_VECTOR": ("vector", 3),
    "FLOAT_COLOR": ("color", 4),
    "BYTE_COLOR": ("color", 4),
}
OUTPUTS = ("Color", "Vector", "Fac", "Alpha")


def make_values(kind: str) -> np.ndarray:
    """Return a value of each point, flat, that a type can hold."""
    width = KINDS[kind][1]
    values = np.random.default_rng(5).uniform(0.0, 1.0, COUNT * width)
    if kind in ("INT", "INT8"):
        return np.arange(-1, COUNT - 1)
    return values > 0.5 if kind == "BOOLEAN" else values.astype(np.float32)


def read(name: str, output: str) -> Any:
    return lambda tree: add_node(tree, "ShaderNodeAttribute", attribute_name=name).outputs[output]


def add_cloud(scene: Any, row: int, kind: str, make: Any) -> Any:
    """Add a row of points of different attributes, made from vertices; return the object."""
    mesh = bpy.data.meshes.new("Row")
    mesh.from_pydata([(column + 0.5, row + 0.5, 0.0) for column in range(COUNT)], [], [])
    attribute = mesh.attributes.new("grade", kind, "POINT")
    attribute.data.foreach_set(KINDS[kind][0], make_values(kind))
    cloud = bpy.data.objects.new("Cloud", mesh)
    scene.collection.objects.link(cloud)
    points, material = add_nodes_modifier(cloud, "GeometryNodeMeshToPoints", "GeometryNodeSetMaterial")
    points.inputs["Radius"].default_value = 0.45
    material.inputs["Material"].default_value = make_material("Points", make)
    return cloud


def add_camera(scene: Any) -> None:
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.ortho_scale, camera.clip_end = "ORTHO", COUNT, 100.0
    holder = bpy.data.objects.new("Camera", camera)
    holder.location = (COUNT / 2, COUNT / 2, 10.0)
    scene.collection.objects.link(holder)
    scene.camera = holder


def agree() -> np.ndarray:
    """Return what our engine sees in the middle of each cell, after comparing it with Cycles."""
    size = COUNT * CELL
    ours, warnings = render_centres(size, size)
    assert not warnings
    middle = np.s_[CELL // 2 :: CELL, CELL // 2 :: CELL]
    np.testing.assert_allclose(ours[middle], render_cycles(size, size)[middle], atol=TOLERANCE)
    return ours[middle]


@pytest.mark.parametrize("kind", KINDS)
def test_attributes_of_points_are_those_of_cycles(empty_scene: Any, kind: str) -> None:
    for row, output in enumerate(OUTPUTS):
        add_cloud(empty_scene, row, kind, read("grade", output))
    add_camera(empty_scene)
    assert np.ptp(agree()[-1, :, 0]) > 0.3, "the points of the lowest row have colors of their own"


@pytest.mark.parametrize("name", ["position", "radius", "missing", "", "UVMap"])
def test_built_in_and_missing_attributes_of_points_are_those_of_cycles(empty_scene: Any, name: str) -> None:
    for row, output in enumerate(OUTPUTS):
        add_cloud(empty_scene, row, "FLOAT", read(name, output))
    add_camera(empty_scene)
    agree()


def test_a_point_cloud_beside_a_mesh_has_its_own_attribute_of_one_name(empty_scene: Any) -> None:
    make = read("grade", "Color")
    add_cloud(empty_scene, 0, "FLOAT", make)
    add_cloud(empty_scene, 1, "FLOAT_COLOR", make)
    plane = bpy.data.meshes.new("Plane")
    plane.from_pydata([(0.0, 2.0, 0.0), (4.0, 2.0, 0.0), (4.0, 4.0, 0.0), (0.0, 4.0, 0.0)], [], [(0, 1, 2, 3)])
    plane.attributes.new("grade", "FLOAT_VECTOR", "POINT").data.foreach_set("vector", np.linspace(0, 1, 12))
    plane.materials.append(make_material("Plane", make))
    empty_scene.collection.objects.link(bpy.data.objects.new("Plane", plane))
    add_camera(empty_scene)
    agree()
