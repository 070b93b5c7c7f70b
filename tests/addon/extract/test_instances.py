"""Instances, point clouds, visibility and linked libraries against Blender's object instances."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from numpy.testing import assert_allclose, assert_array_equal

from addon.extract.scene import Extraction, extract_scene
from raytracer.scene.fields import SEEN_BY, SEEN_BY_ALL

pytestmark = pytest.mark.blender


def extract(geometry_only: bool = False) -> Extraction:
    return extract_scene(bpy.context.evaluated_depsgraph_get(), geometry_only=geometry_only)


def add_cube(collection: Any, name: str = "Cube") -> Any:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 1)], [], [(0, 1, 2), (0, 2, 3)])
    shown = bpy.data.objects.new(name, mesh)
    collection.objects.link(shown)
    return shown


def add_instancer(scene: Any, collection: Any, matrix: Matrix, name: str = "Instancer") -> Any:
    instancer = bpy.data.objects.new(name, None)
    instancer.instance_type, instancer.instance_collection = "COLLECTION", collection
    instancer.matrix_world = matrix
    scene.collection.objects.link(instancer)
    return instancer


def add_nodes_modifier(shown: Any, *kinds: str) -> list[Any]:
    """Add a geometry-nodes modifier that leads through nodes of these kinds, and return the nodes."""
    tree = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    nodes = [tree.nodes.new(kind) for kind in ("NodeGroupInput", *kinds, "NodeGroupOutput")]
    for before, after in pairwise(nodes):
        tree.links.new(before.outputs[0], after.inputs[0])
    shown.modifiers.new("Nodes", "NODES").node_group = tree
    return nodes[1:-1]


def test_collection_instances_share_one_mesh(scene_with_camera: Any) -> None:
    collection = bpy.data.collections.new("Collection")
    add_cube(collection)
    matrices = [Matrix.Translation((3 * row, 0, 0)) @ Matrix.Rotation(row, 4, "X") for row in range(5)]
    for matrix in matrices:
        add_instancer(scene_with_camera, collection, matrix)
    extraction = extract()
    assert len(extraction.scene.meshes) == 1
    assert extraction.scene.instances.mesh.tolist() == [0] * 5
    expected = [
        np.array(item.matrix_world)
        for item in bpy.context.evaluated_depsgraph_get().object_instances
        if item.object.type == "MESH"
    ]
    assert_array_equal(extraction.scene.instances.world_from_object, expected)
    assert {key.name for key in extraction.objects} == {"Cube"}


def test_world_vertices_under_shear_and_mirror_equal_blenders(scene_with_camera: Any) -> None:
    parent = bpy.data.objects.new("Parent", None)
    parent.scale, parent.rotation_euler = (3.0, 1.0, -0.5), (0.2, 0.5, 0.1)
    scene_with_camera.collection.objects.link(parent)
    child = add_cube(scene_with_camera.collection)
    child.parent, child.rotation_euler, child.scale = parent, (0.7, 0.3, 0.9), (-1.0, 2.0, 1.0)
    extraction = extract()
    evaluated = child.evaluated_get(bpy.context.evaluated_depsgraph_get())
    axes = np.array(evaluated.matrix_world)[:3, :3]
    assert abs(axes[:, 0] @ axes[:, 1]) > 0.1  # a shear
    matrix = extraction.scene.instances.world_from_object[0]
    world = extraction.scene.meshes[0].positions @ matrix[:3, :3].T + matrix[:3, 3]
    expected = [tuple(evaluated.matrix_world @ vertex.co) for vertex in evaluated.data.vertices]
    # mathutils rounds to float32: three products and three sums.
    assert_allclose(world, expected, rtol=0, atol=6 * np.finfo(np.float32).eps * np.abs(expected).max())


def test_geometry_nodes_instances_share_one_mesh(scene_with_camera: Any) -> None:
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=3, y_subdivisions=3)
    nodes = add_nodes_modifier(bpy.context.object, "GeometryNodeInstanceOnPoints")
    cone = nodes[0].id_data.nodes.new("GeometryNodeMeshCone")
    nodes[0].id_data.links.new(cone.outputs["Mesh"], nodes[0].inputs["Instance"])
    extraction = extract()
    assert len(extraction.scene.meshes) == 1
    assert len(extraction.scene.instances) == 16
    assert len(np.unique(extraction.scene.instances.world_from_object[:, :3, 3], axis=0)) == 16


def test_objects_with_other_materials_share_the_mesh_arrays(scene_with_camera: Any) -> None:
    first = add_cube(scene_with_camera.collection)
    first.data.materials.append(bpy.data.materials.new("of the data"))
    second = bpy.data.objects.new("Second", first.data)
    scene_with_camera.collection.objects.link(second)
    second.material_slots[0].link = "OBJECT"
    second.material_slots[0].material = bpy.data.materials.new("of the object")
    scene = extract().scene
    names = [scene.materials[scene.meshes[mesh].material].name for mesh in scene.instances.mesh]
    assert names == ["of the data", "of the object"]
    assert np.shares_memory(scene.meshes[0].positions, scene.meshes[1].positions)
    assert np.shares_memory(scene.meshes[0].triangles, scene.meshes[1].triangles)


def test_points_are_spheres_in_world_space(scene_with_camera: Any) -> None:
    bpy.ops.mesh.primitive_cube_add(location=(1, 2, 3), rotation=(0.5, 0, 0))
    shown = bpy.context.object
    shown.scale = (2, 2, 2)
    shown.pass_index = 7
    add_nodes_modifier(shown, "GeometryNodeMeshToPoints")[0].inputs["Radius"].default_value = 0.25
    extraction = extract()
    (spheres,) = extraction.scene.spheres
    expected = [tuple(shown.matrix_world @ vertex.co) for vertex in shown.data.vertices]
    assert_allclose(spheres.centres, expected, rtol=4 * np.finfo(np.float32).eps, atol=0)
    assert_allclose(spheres.radii, 0.5, rtol=4 * np.finfo(np.float32).eps)
    assert spheres.pass_index == 7
    assert [key.name for key in extraction.objects] == [shown.name]
    assert not extraction.warnings


def test_points_under_uneven_scale_keep_their_volume_and_warn(scene_with_camera: Any) -> None:
    bpy.ops.mesh.primitive_cube_add()
    bpy.context.object.scale = (1, 2, 4)
    add_nodes_modifier(bpy.context.object, "GeometryNodeMeshToPoints")[0].inputs["Radius"].default_value = 0.25
    extraction = extract()
    assert_allclose(extraction.scene.spheres[0].radii, 0.5, rtol=4 * np.finfo(np.float32).eps)
    assert ["equal volume" in warning.text for warning in extraction.warnings] == [True]


def test_hidden_instancer_shows_its_instances_only(scene_with_camera: Any) -> None:
    collection = bpy.data.collections.new("Collection")
    add_cube(collection, "Instanced")
    shown = add_cube(scene_with_camera.collection, "Instancer")
    shown.instance_type = "VERTS"
    child = add_cube(scene_with_camera.collection, "Child")
    child.parent = shown
    shown.modifiers.new("Particles", "PARTICLE_SYSTEM")  # what has particles is walked, even if not shown itself
    shown.show_instancer_for_viewport = False
    walked = [(item.object.name, item.show_self) for item in bpy.context.evaluated_depsgraph_get().object_instances]
    assert ("Instancer", False) in walked
    assert {key.name for key in extract().objects} == {"Child"}


def test_holdout_of_object_and_collection(scene_with_camera: Any) -> None:
    add_cube(scene_with_camera.collection, "Plain")
    add_cube(scene_with_camera.collection, "Object").is_holdout = True
    collection = bpy.data.collections.new("Held")
    scene_with_camera.collection.children.link(collection)
    add_cube(collection, "InCollection")
    bpy.context.view_layer.layer_collection.children["Held"].holdout = True
    extraction = extract()
    held = dict(zip((key.name for key in extraction.objects), extraction.scene.instances.holdout.tolist(), strict=True))
    assert held == {"Plain": False, "Object": True, "InCollection": True}


def test_shadow_catchers_and_the_lamps_of_their_footage(scene_with_camera: Any) -> None:
    add_cube(scene_with_camera.collection, "Plain")
    add_cube(scene_with_camera.collection, "Ground").is_shadow_catcher = True
    hidden = bpy.data.collections.new("Instanced")
    add_cube(hidden, "Inside")
    instancer = bpy.data.objects.new("Instancer", None)
    instancer.instance_type, instancer.instance_collection = "COLLECTION", hidden
    instancer.is_shadow_catcher = True
    scene_with_camera.collection.objects.link(instancer)
    for name in ("Real", "Added"):
        lamp = bpy.data.objects.new(name, bpy.data.lights.new(name, "POINT"))
        scene_with_camera.collection.objects.link(lamp)
    lamp.is_shadow_catcher = False
    extraction = extract()
    names = [key.name for key in extraction.objects]
    catches = dict(zip(names, extraction.scene.instances.shadow_catcher.tolist(), strict=True))
    assert catches == {"Plain": False, "Ground": True, "Inside": True}
    assert {light.name: light.shadow_catcher for light in extraction.scene.lights} == {"Real": True, "Added": False}
    assert not extraction.warnings


def test_indices_for_passes(scene_with_camera: Any) -> None:
    shown = add_cube(scene_with_camera.collection)
    shown.pass_index = 5
    shown.data.materials.append(bpy.data.materials.new("Material"))
    shown.data.materials[0].pass_index = 9
    scene = extract().scene
    assert scene.instances.pass_index.tolist() == [5]
    assert [material.pass_index for material in scene.materials] == [9]


def test_ray_visibility_is_kept_or_leaves_out(scene_with_camera: Any) -> None:
    add_cube(scene_with_camera.collection, "NoCamera").visible_camera = False
    nothing = add_cube(scene_with_camera.collection, "Nothing")
    for kind in ("camera", "diffuse", "glossy", "transmission", "shadow", "volume_scatter"):
        setattr(nothing, f"visible_{kind}", False)
    collection = bpy.data.collections.new("Indirect")
    scene_with_camera.collection.children.link(collection)
    add_cube(collection, "IndirectOnly")
    bpy.context.view_layer.layer_collection.children["Indirect"].indirect_only = True
    extraction = extract()
    assert {key.name for key in extraction.objects} == {"NoCamera", "IndirectOnly"}
    assert extraction.scene.instances.seen_by.tolist() == [SEEN_BY_ALL - SEEN_BY["camera"]] * 2
    assert not extraction.warnings


def test_what_cannot_be_shown_is_named_once_and_left_out(scene_with_camera: Any) -> None:
    volume = bpy.data.objects.new("Fog", bpy.data.volumes.new("Fog"))
    volume.data.filepath = "//missing.vdb"
    scene_with_camera.collection.objects.link(volume)
    extraction = extract()
    assert not extraction.objects
    assert [warning.object for warning in extraction.warnings] == ["Fog"]


def test_matrix_that_is_not_finite_is_left_out(scene_with_camera: Any) -> None:
    add_cube(scene_with_camera.collection, "Broken").location = (float("nan"), 0, 0)
    add_cube(scene_with_camera.collection, "Flat").scale = (0, 1, 1)
    extraction = extract()
    assert [key.name for key in extraction.objects] == ["Flat"]
    assert [warning.object for warning in extraction.warnings] == ["Broken"]


def test_projective_part_of_a_parents_inverse_is_dropped_as_in_cycles(scene_with_camera: Any) -> None:
    parent = bpy.data.objects.new("Parent", None)
    scene_with_camera.collection.objects.link(parent)
    child = add_cube(scene_with_camera.collection)
    inverse = Matrix()
    inverse[3][0] = 0.5
    child.parent, child.matrix_parent_inverse = parent, inverse
    assert_array_equal(extract().scene.instances.world_from_object[0], np.eye(4))


def test_empty_scene_has_nothing(scene_with_camera: Any) -> None:
    extraction = extract()
    assert (extraction.objects, extraction.polygons, extraction.warnings) == ((), (), ())
    assert extraction.scene.instance_count == 0


def test_geometry_only_needs_no_camera_and_reads_no_material(empty_scene: Any) -> None:
    add_cube(empty_scene.collection).data.materials.append(bpy.data.materials.new("Material"))
    scene = extract(geometry_only=True).scene
    assert scene.camera is None
    assert [material.name for material in scene.materials] == ["default"]


@pytest.fixture
def file_with_linked_cube(tmp_path: Path, empty_scene: Any) -> Path:
    """Return a .blend that links the object 'Cube' from library.blend beside it."""
    library, path = tmp_path / "library.blend", tmp_path / "main.blend"
    bpy.data.libraries.write(str(library), {add_cube(empty_scene.collection)})
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(str(library), link=True) as (_, linked):
        linked.objects = ["Cube"]
    bpy.context.scene.collection.objects.link(linked.objects[0])
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def test_linked_object_is_extracted_under_its_full_name(file_with_linked_cube: Path) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(file_with_linked_cube))
    extraction = extract(geometry_only=True)
    assert [key.name for key in extraction.objects] == ["Cube [library.blend]"]
    assert not extraction.warnings


def test_missing_library_is_named(file_with_linked_cube: Path) -> None:
    (file_with_linked_cube.parent / "library.blend").unlink()
    bpy.ops.wm.open_mainfile(filepath=str(file_with_linked_cube))
    extraction = extract(geometry_only=True)
    assert extraction.objects == ()
    (warning,) = extraction.warnings
    assert "'Cube'" in warning.text
    assert "library.blend" in warning.text


class ProbeEngine(bpy.types.RenderEngine):
    """Extracts the depsgraph that Blender gives to a final render."""

    bl_idname = "EXTRACTION_PROBE"
    bl_label = "Extraction Probe"
    extraction: Extraction | None = None

    def render(self, depsgraph: Any) -> None:
        type(self).extraction = extract_scene(depsgraph)


def test_final_render_sees_render_settings(scene_with_camera: Any) -> None:
    add_cube(scene_with_camera.collection, "HiddenInRender").hide_render = True
    add_cube(scene_with_camera.collection, "HiddenInViewport").hide_viewport = True
    refined = add_cube(scene_with_camera.collection, "Refined")
    modifier = refined.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels, modifier.render_levels = 0, 2
    bpy.utils.register_class(ProbeEngine)
    try:
        scene_with_camera.render.engine = ProbeEngine.bl_idname
        bpy.ops.render.render()
    finally:
        scene_with_camera.render.engine = "CYCLES"
        bpy.utils.unregister_class(ProbeEngine)
    extraction = ProbeEngine.extraction
    assert extraction is not None
    counts = {
        key.name: len(extraction.scene.meshes[mesh].triangles)
        for key, mesh in zip(extraction.objects, extraction.scene.instances.mesh, strict=True)
    }
    assert counts == {"HiddenInViewport": 2, "Refined": 2 * 3 * 4 * 2}
