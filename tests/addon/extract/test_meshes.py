"""Meshes against Blender's own evaluated data: positions, polygons, normals, uvs, materials of triangles."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from addon import versions
from addon.extract import meshes
from addon.extract.scene import Extraction, extract_scene

pytestmark = pytest.mark.blender


def extract(passes: tuple[str, ...] = ("Combined",)) -> Extraction:
    return extract_scene(bpy.context.evaluated_depsgraph_get(), passes, geometry_only=True)


def add_mesh(vertices: Any, faces: Any, name: str = "Mesh") -> Any:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], faces)
    shown = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(shown)
    return shown


def find_evaluated(shown: Any) -> Any:
    return shown.evaluated_get(bpy.context.evaluated_depsgraph_get())


def test_blender_copies_memory_into_all_buffers(empty_scene: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    bpy.ops.mesh.primitive_monkey_add()
    bpy.context.object.data.attributes.new("count", "INT", "FACE")
    made = np.empty
    letters: list[str] = []

    def note(*arguments: Any, **keywords: Any) -> Any:
        array = made(*arguments, **keywords)
        letters.append(array.dtype.char)
        return array

    monkeypatch.setattr(meshes.np, "empty", note)
    extract()
    monkeypatch.undo()
    assert "I" in letters
    assert not {"l", "L"} & set(letters)  # C's long: what np.int32 and np.uint32 are on Windows


def test_positions_equal_evaluated_vertices_of_modified_mesh(empty_scene: Any) -> None:
    bpy.ops.mesh.primitive_monkey_add(location=(1, 2, 3), rotation=(0.3, 0.2, 0.1), scale=(1, -2, 0.5))
    shown = bpy.context.object
    shown.modifiers.new("Subdivision", "SUBSURF").levels = 2
    extraction = extract()
    evaluated = find_evaluated(shown)
    expected = [tuple(vertex.co) for vertex in evaluated.data.vertices]
    assert len(expected) > len(shown.data.vertices)
    assert_array_equal(extraction.scene.meshes[0].positions, expected)
    assert_array_equal(extraction.scene.instances.world_from_object[0], np.array(evaluated.matrix_world))


@pytest.mark.parametrize("kind", ["text", "curve", "metaball", "surface"])
def test_what_becomes_a_mesh_is_extracted_once(empty_scene: Any, kind: str) -> None:
    if kind == "text":
        bpy.ops.object.text_add()
    elif kind == "curve":
        bpy.ops.curve.primitive_bezier_circle_add()
        bpy.context.object.data.bevel_depth = 0.1
    elif kind == "metaball":
        bpy.ops.object.metaball_add()
    else:
        bpy.ops.surface.primitive_nurbs_surface_sphere_add()
    shown = bpy.context.object
    extraction = extract()
    expected = find_evaluated(shown).to_mesh()
    expected.calc_loop_triangles()
    assert [key.name for key in extraction.objects] == [shown.name]
    assert len(extraction.scene.meshes[0].triangles) == len(expected.loop_triangles) > 0


def test_triangles_hit_the_polygon_that_ray_cast_reports(empty_scene: Any) -> None:
    bpy.ops.mesh.primitive_uv_sphere_add(segments=7, ring_count=5, location=(2, 0, 1), scale=(1, 2, -1))
    bpy.ops.mesh.primitive_cone_add(vertices=9, end_fill_type="NGON", location=(-3, 0, 0))
    depsgraph = bpy.context.evaluated_depsgraph_get()
    extraction = extract()
    uids = {shown.session_uid: shown for shown in empty_scene.objects}
    for index, key in enumerate(extraction.objects):
        mesh_index = extraction.scene.instances.mesh[index]
        mesh = extraction.scene.meshes[mesh_index]
        matrix = extraction.scene.instances.world_from_object[index]
        corners = mesh.positions[mesh.triangles] @ matrix[:3, :3].T + matrix[:3, 3]  # (t, 3, 3)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True) * np.sign(np.linalg.det(matrix[:3, :3]))
        origins = corners.mean(axis=1) + 0.01 * normals  # outside the solid, just above the triangle
        for origin, normal, polygon in zip(origins, normals, extraction.polygons[mesh_index], strict=True):
            hit, _, _, hit_polygon, shown, _ = empty_scene.ray_cast(depsgraph, origin, -normal)
            assert hit
            assert (shown, hit_polygon) == (uids[key.session_uid], polygon)


def test_flat_mesh_has_no_normals(empty_scene: Any) -> None:
    bpy.ops.mesh.primitive_cube_add()
    assert extract().scene.meshes[0].normals is None


def test_smooth_mesh_has_blenders_vertex_normals(empty_scene: Any) -> None:
    bpy.ops.mesh.primitive_ico_sphere_add()
    bpy.ops.object.shade_smooth()
    expected = [tuple(normal.vector) for normal in find_evaluated(bpy.context.object).data.vertex_normals]
    assert_array_equal(extract().scene.meshes[0].normals, expected)


@pytest.mark.parametrize("how", ["one flat face", "custom"])
def test_mixed_normals_are_blenders_corner_normals(empty_scene: Any, how: str) -> None:
    bpy.ops.mesh.primitive_cube_add()
    bpy.ops.object.shade_smooth()
    mesh = bpy.context.object.data
    if how == "custom":
        mesh.normals_split_custom_set([(0.6, 0.0, 0.8)] * len(mesh.loops))
    else:
        mesh.polygons[0].use_smooth = False
    normals = extract().scene.meshes[0].normals
    evaluated = find_evaluated(bpy.context.object).data
    evaluated.calc_loop_triangles()
    corners = [tuple(normal.vector) for normal in evaluated.corner_normals]
    assert_array_equal(normals, [[corners[loop] for loop in triangle.loops] for triangle in evaluated.loop_triangles])


def test_uvs_are_read_only_for_the_uv_pass(empty_scene: Any) -> None:
    bpy.ops.mesh.primitive_cube_add()
    mesh = bpy.context.object.data
    second = mesh.uv_layers.new(name="second")
    second.uv.foreach_set("vector", np.linspace(0, 1, 2 * len(mesh.loops), dtype=np.float32))
    second.active_render = True
    assert extract().scene.meshes[0].uvs is None
    uvs = extract(("Combined", "UV")).scene.meshes[0].uvs
    evaluated = find_evaluated(bpy.context.object).data
    evaluated.calc_loop_triangles()
    layer = evaluated.uv_layers["second"].uv
    expected = [[tuple(layer[loop].vector) for loop in triangle.loops] for triangle in evaluated.loop_triangles]
    assert_array_equal(uvs, expected)


def test_mesh_without_uv_map_has_no_uvs(empty_scene: Any) -> None:
    add_mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    assert extract(("UV",)).scene.meshes[0].uvs is None


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("smooth", [False, True])
def test_vertex_that_is_not_finite_takes_its_triangles_along(empty_scene: Any, value: float, smooth: bool) -> None:
    shown = add_mesh(
        [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 2, value)], [(0, 1, 2), (2, 3, 4), (0, 2, 3)], "Broken"
    )
    shown.data.shade_smooth() if smooth else shown.data.shade_flat()
    extraction = extract(("UV",))
    assert extraction.polygons[0].tolist() == [0, 2]
    assert extraction.scene.meshes[0].triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert [(warning.object, "1 vertices" in warning.text) for warning in extraction.warnings] == [("Broken", True)]
    if smooth:
        mesh = extraction.scene.meshes[0]
        corners = mesh.normals if mesh.normals.ndim == 3 else mesh.normals[mesh.triangles]
        lengths = np.linalg.norm(corners, axis=-1)
        np.testing.assert_allclose(lengths, 1.0, rtol=4 * np.finfo(np.float32).eps)


@pytest.mark.skipif(versions.VERSION < (5, 0), reason="free custom normals came after Blender 4.2")
def test_custom_normal_that_is_not_finite_is_replaced_by_its_faces_own(empty_scene: Any) -> None:
    shown = add_mesh([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 0, 0)], [(0, 2, 1), (0, 1, 3)])
    custom = np.tile(np.float32((0.6, 0, 0.8)), (6, 1))
    custom[[1, 4]] = (np.nan, 0, 0), (0, np.inf, 0)
    shown.data.attributes.new("custom_normal", "FLOAT_VECTOR", "CORNER").data.foreach_set("vector", custom.ravel())
    extraction = extract()
    custom[[1, 4]] = (0, 0, -1), (0, 0, 1)  # the second triangle has no area: Blender's (0, 0, 1)
    assert_array_equal(extraction.scene.meshes[0].normals.reshape(-1, 3), custom)
    assert ["custom normals" in warning.text for warning in extraction.warnings] == [True]


def test_faces_without_area_stay(empty_scene: Any) -> None:
    add_mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0), (2, 0, 0)], [(0, 1, 2), (0, 1, 3)])
    extraction = extract()
    assert extraction.polygons[0].tolist() == [0, 1]
    assert not extraction.warnings


@pytest.mark.parametrize(
    ("vertices", "faces"), [([], []), ([(0, 0, 0), (1, 0, 0)], []), ([(np.nan,) * 3] * 3, [(0, 1, 2)])]
)
def test_mesh_without_triangles_is_left_out(empty_scene: Any, vertices: Any, faces: Any) -> None:
    add_mesh(vertices, faces)
    extraction = extract()
    assert extraction.objects == ()
    assert extraction.scene.meshes == ()
    assert extraction.scene.instance_count == 0
