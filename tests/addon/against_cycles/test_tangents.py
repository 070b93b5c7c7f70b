"""Tangents and normal maps on meshes without UV maps, against Cycles, point by point."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bmesh
import bpy
import numpy as np
import pytest

from addon.extract.scene import extract_scene
from raytracer.shading.site_tables import UNDEFORMED
from tests.addon.against_cycles.node_fixtures import add_node, make_material, render_centres, render_cycles

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]

SIZE = 48
# Points next to an edge may lie on its other side for Cycles, which places rays in float32.
EDGE_SHARE = 0.01


def make_mesh(add: Callable[[Any], Any], smooth: bool) -> Any:
    mesh, shape = bpy.data.meshes.new("Mesh"), bmesh.new()
    add(shape)
    shape.to_mesh(mesh)
    shape.free()
    mesh.polygons.foreach_set("use_smooth", [smooth] * len(mesh.polygons))
    return mesh


def add_ball(shape: Any) -> None:
    """No vertex lies on the axis, where tangents from all around cancel, and what is left is rounding."""
    bmesh.ops.create_uvsphere(shape, u_segments=16, v_segments=8, radius=0.8)
    bmesh.ops.translate(shape, vec=(0.17, -0.05, 0.0), verts=shape.verts)


def add_lump(shape: Any) -> None:
    """A ball around another point than the origin, which longitude and latitude are counted around."""
    bmesh.ops.create_icosphere(shape, subdivisions=2, radius=0.7)
    for vertex in shape.verts:
        vertex.co = (vertex.co.x + 0.2, vertex.co.y * 1.3 - 0.1, vertex.co.z * 0.9 + 0.1 * vertex.co.x)


def add_cube(shape: Any) -> None:
    bmesh.ops.create_cube(shape, size=1.0)


SHAPES = {
    "ball": (add_ball, True),
    "lump": (add_lump, True),
    "flat lump": (add_lump, False),
    "cube": (add_cube, False),
    "stretched lump": (add_lump, True),
}


def bend(space: str, **settings: Any) -> Callable[[Any], Any]:
    inputs = {"Color": (0.8, 0.4, 0.7, 1.0), "Strength": 0.8}
    return lambda tree: add_node(tree, "ShaderNodeNormalMap", inputs, space=space, **settings).outputs[0]


def tangent(**settings: Any) -> Callable[[Any], Any]:
    return lambda tree: add_node(tree, "ShaderNodeTangent", direction_type="UV_MAP", **settings).outputs[0]


NODES: dict[str, Callable[[Any], Any]] = {
    "tangent": tangent(),
    "tangent of a map by name": tangent(uv_map="missing"),
    "normal map": bend("TANGENT"),
    "normal map by name": bend("TANGENT", uv_map="missing"),
}


def stage(scene: Any, name: str, make: Callable[[Any], Any]) -> Any:
    add, smooth = SHAPES[name]
    mesh = make_mesh(add, smooth)
    mesh.materials.append(make_material("Shown", make))
    shown = bpy.data.objects.new("Shown", mesh)
    shown.rotation_euler, shown.scale = (0.3, 0.2, 0.1), (0.9, 0.9, -0.9)
    if name.startswith("stretched"):
        deform = shown.modifiers.new("Deform", "SIMPLE_DEFORM")
        deform.deform_method, deform.factor = "TAPER", 0.5
    scene.collection.objects.link(shown)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale = "ORTHO", 2.2
    camera.location, camera.rotation_euler = (0.0, -5.0, 0.0), (np.pi / 2, 0.0, 0.0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    return shown


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("node", NODES)
def test_tangents_without_uv_maps_run_along_the_equator_as_in_cycles(empty_scene: Any, node: str, shape: str) -> None:
    stage(empty_scene, shape, NODES[node])
    (ours, warnings), cycles = render_centres(SIZE, SIZE), render_cycles(SIZE, SIZE)
    assert not warnings
    assert np.quantile(np.abs(ours - cycles).max(axis=2), 1.0 - EDGE_SHARE) < 1e-3


def test_undeformed_places_are_read_only_in_place_of_a_uv_map(empty_scene: Any) -> None:
    shown = stage(empty_scene, "lump", NODES["tangent"])
    read = lambda: extract_scene(bpy.context.evaluated_depsgraph_get()).scene.meshes[0].attributes  # noqa: E731
    assert set(read()) == {UNDEFORMED}
    shown.data.uv_layers.new(name="UVMap")
    assert set(read()) == {"uv"}
    shown.data.materials[0] = make_material("Other", tangent(uv_map="UVMap"))
    assert set(read()) == {"UVMap"}
