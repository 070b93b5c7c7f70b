"""Geometry > Random Per Island, against Cycles: meshes of several parts, joined and modified."""

from __future__ import annotations

from typing import Any

import bmesh
import bpy
import numpy as np
import pytest
from mathutils import Matrix

from addon.extract.scene import extract_scene
from tests.addon.against_cycles.node_fixtures import make_material, render_centres, render_cycles

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]

SIZE = 64
# Points on the outline of a part may be on another for Cycles, which casts in float32.
OUTLINE_SHARE = 0.005


@pytest.mark.parametrize("modifier", ["", "SUBSURF", "ARRAY"])
def test_each_island_has_the_random_number_of_cycles(empty_scene: Any, modifier: str) -> None:
    mesh, shape = bpy.data.meshes.new("Parts"), bmesh.new()
    for row in range(3):
        for column in range(3):
            place = Matrix.Translation((column, row, 0.0)) @ Matrix.Rotation(column + row, 4, "X")
            bmesh.ops.create_icosphere(shape, subdivisions=1 + column, radius=0.4, matrix=place)
    shape.to_mesh(mesh)
    shape.free()
    output = "Random Per Island"
    mesh.materials.append(make_material("Random", lambda tree: tree.nodes.new("ShaderNodeNewGeometry").outputs[output]))
    parts = bpy.data.objects.new("Parts", mesh)
    if modifier:
        parts.modifiers.new("Modifier", modifier)
    empty_scene.collection.objects.link(parts)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale, camera.location = "ORTHO", 6.0, (2.0, 1.0, 10.0)
    empty_scene.collection.objects.link(camera)
    empty_scene.camera = camera
    ours, warnings = render_centres(SIZE, SIZE)
    assert not warnings
    assert len(np.unique(ours[..., 0].round(4))) > 6
    differs = np.abs(ours - render_cycles(SIZE, SIZE)).max(axis=2) > 1e-5
    assert differs.mean() <= OUTLINE_SHARE


def test_islands_are_looked_for_only_where_a_material_asks(empty_scene: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = bpy.data.meshes.new("Plain")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])
    mesh.materials.append(
        make_material("Plain", lambda tree: tree.nodes.new("ShaderNodeNewGeometry").outputs["Normal"])
    )
    empty_scene.collection.objects.link(bpy.data.objects.new("Plain", mesh))
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    empty_scene.collection.objects.link(camera)
    empty_scene.camera = camera
    monkeypatch.setattr("addon.extract.attributes.read_islands", lambda *_: pytest.fail("islands were looked for"))
    assert extract_scene(bpy.context.evaluated_depsgraph_get()).scene.meshes
