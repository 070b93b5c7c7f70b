"""Volumes of voxels: what Blender's nodes put into a grid comes out of it, voxel by voxel, at its place."""

from __future__ import annotations

import errno
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from addon.extract import volume_objects
from addon.extract.kept import Changes, Kept
from addon.extract.scene import Extraction, extract_scene
from addon.own_blender import command
from addon.versions import VERSION
from addon.voxels import process, sampling
from raytracer import Grid
from tests.addon.against_cycles.node_fixtures import add_node
from tests.addon.extract.shaders.shader_trees import clear_nodes

pytestmark = pytest.mark.blender

LOW, HIGH, SIZE = (0.5, -1.0, -2.0), (1.0, 1.0, 1.0), (6, 4, 3)
# Of a value that nodes compute from positions in float32.
ROUNDING = 16 * float(np.finfo(np.float32).eps)


def make_cloud(scene: Any, name: str = "Cloud", density: float | None = None) -> Any:
    """Return an object of voxels as many as SIZE in the box from LOW to HIGH, of density x + y^2 or a constant."""
    tree = bpy.data.node_groups.new("Voxels", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    resolution = dict(zip(("Resolution X", "Resolution Y", "Resolution Z"), SIZE, strict=True))
    cube = add_node(tree, "GeometryNodeVolumeCube", {"Min": LOW, "Max": HIGH, **resolution})
    if density is None:
        place = add_node(tree, "GeometryNodeInputPosition")
        split = add_node(tree, "ShaderNodeSeparateXYZ", {"Vector": place.outputs[0]})
        square = add_node(
            tree, "ShaderNodeMath", {"Value": split.outputs[1], "Value_001": split.outputs[1]}, operation="MULTIPLY"
        )
        total = add_node(tree, "ShaderNodeMath", {"Value": split.outputs[0], "Value_001": square.outputs[0]})
        tree.links.new(total.outputs[0], cube.inputs["Density"])
    else:
        cube.inputs["Density"].default_value = density
    add_node(tree, "NodeGroupOutput", {tree.interface.items_tree[0].identifier: cube.outputs[0]})
    shown = bpy.data.objects.new(name, bpy.data.meshes.new(name))
    shown.modifiers.new("Voxels", "NODES").node_group = tree
    scene.collection.objects.link(shown)
    return shown


def save_cloud(scene: Any, folder: Any) -> Any:
    """Return the file of a cloud's voxels."""
    make_cloud(scene)
    volume = next(each.object.data for each in bpy.context.evaluated_depsgraph_get().object_instances if
                  each.object.type == "VOLUME")  # fmt: skip
    path = folder / "cloud.vdb"
    volume.grids.save(filepath=str(path))
    return path


def extract(kept: Kept | None = None) -> Extraction:
    return extract_scene(bpy.context.evaluated_depsgraph_get(), kept=kept)


def find_grid(extraction: Extraction, name: str = "density") -> Grid:
    (mesh,) = extraction.scene.meshes
    return mesh.grids[name]


def locate(grid: Grid) -> np.ndarray:
    """Return the places (x, y, z, 3) of a grid's voxels in object space."""
    numbers = np.moveaxis(np.indices(grid.values.shape[:3]), 0, -1)
    return numbers @ grid.object_from_index[:3, :3].T + grid.object_from_index[:3, 3]


def test_voxels_are_those_of_the_nodes(scene_with_camera: Any) -> None:
    make_cloud(scene_with_camera)
    extraction = extract()
    grid = find_grid(extraction)
    assert grid.values.shape == SIZE
    where = np.moveaxis(
        np.meshgrid(*(np.linspace(*ends) for ends in zip(LOW, HIGH, SIZE, strict=True)), indexing="ij"), 0, -1
    )
    assert_allclose(grid.values, where[..., 0] + where[..., 1] ** 2, rtol=ROUNDING, atol=ROUNDING)
    if VERSION >= (5, 0):  # before, Blender put the cube's voxels half of one lower than it computed them for
        assert_allclose(locate(grid), where, rtol=ROUNDING, atol=ROUNDING)
    assert not extraction.warnings
    (material,) = extraction.scene.materials
    assert material.only_volume, "Blender's default: a Principled Volume"


def test_a_box_surrounds_all_voxels(scene_with_camera: Any) -> None:
    make_cloud(scene_with_camera)
    extraction = extract()
    (mesh,) = extraction.scene.meshes
    places = locate(mesh.grids["density"]).reshape(-1, 3)
    step = np.diag(mesh.grids["density"].object_from_index)[:3]
    assert_allclose(mesh.positions.min(axis=0), places.min(axis=0) - step, rtol=ROUNDING, atol=ROUNDING)
    assert_allclose(mesh.positions.max(axis=0), places.max(axis=0) + step, rtol=ROUNDING, atol=ROUNDING)
    a, b, c = (mesh.positions[mesh.triangles[:, corner]] for corner in range(3))
    volume = np.einsum("ij,ij", np.cross(a, b), c) / 6.0
    assert_allclose(volume, np.prod(np.ptp(mesh.positions, axis=0)), rtol=1e-12, err_msg="normals point outwards")


def test_density_of_object_space_heeds_the_scale(scene_with_camera: Any) -> None:
    make_cloud(scene_with_camera).scale = (1, 2, 2)
    assert_allclose(extract().scene.instances.volume_density, 1 / np.sqrt(3))


def test_slabs_make_the_same_grid(scene_with_camera: Any, tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """A grid that takes several passes of the nodes is the same."""
    path = save_cloud(scene_with_camera, tmp_path)
    whole = sampling.read_file(path, ["density"])["density"]
    monkeypatch.setattr(sampling, "SLAB", 2 * whole.values[0].size)
    parts = sampling.read_file(path, ["density"])["density"]
    assert_array_equal(parts.values, whole.values)
    assert whole.values.shape == SIZE
    monkeypatch.setattr(sampling, "MOST_VOXELS", 10)
    with pytest.raises(ValueError, match="voxels, more than 10"):
        sampling.read_file(path, ["density"])


def test_an_empty_grid_is_one_voxel(scene_with_camera: Any) -> None:
    make_cloud(scene_with_camera, density=0.0)
    assert find_grid(extract()).values.tolist() == [[[0.0]]]


def test_only_what_changed_is_read_again(scene_with_camera: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    make_cloud(scene_with_camera)
    kept = Kept()
    before = extract(kept).scene.meshes
    again = extract(kept).scene.meshes  # Blender announced nothing: read, and found to be the same
    assert again[0] is before[0]
    kept.changes = Changes()
    monkeypatch.setattr(volume_objects, "read_geometry", None)
    monkeypatch.setattr(process.VoxelReader, "read", None)
    assert extract(kept).scene.meshes[0] is before[0]


def test_a_material_without_volume_shows_nothing(scene_with_camera: Any) -> None:
    shown = make_cloud(scene_with_camera)
    material = bpy.data.materials.new("Surface")
    clear_nodes(material)
    node = shown.modifiers[0].node_group.nodes.new("GeometryNodeSetMaterial")
    node.inputs["Material"].default_value = material
    tree = node.id_data
    output = next(each for each in tree.nodes if each.type == "GROUP_OUTPUT")
    tree.links.new(output.inputs[0].links[0].from_socket, node.inputs[0])
    tree.links.new(node.outputs[0], output.inputs[0])
    assert not extract().scene.meshes


def test_a_scene_without_voxels_starts_no_process(scene_with_camera: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process, "start_blender", None)
    bpy.ops.mesh.primitive_cube_add()
    assert len(extract().scene.meshes) == 1
    make_cloud(scene_with_camera)
    with pytest.raises(TypeError):
        extract()


def test_a_layer_without_volumes_leaves_them_out(scene_with_camera: Any) -> None:
    make_cloud(scene_with_camera)
    scene_with_camera.view_layers[0].use_volumes = False
    assert not extract().scene.meshes


@pytest.mark.parametrize(("grid", "expected"), [("velocity", 1), ("force", 0)])
@pytest.mark.skipif(VERSION < (5, 0), reason="no nodes make grids of vectors before Blender 5.0")
def test_voxels_whose_velocities_blur_nothing_are_named(scene_with_camera: Any, grid: str, expected: int) -> None:
    shown = make_cloud(scene_with_camera)
    tree = shown.modifiers[0].node_group
    cube, output = tree.nodes["Volume Cube"], tree.nodes["Group Output"]
    stored = add_node(
        tree, "GeometryNodeStoreNamedGrid", {"Name": grid, "Volume": cube.outputs[0]}, data_type="VECTOR_FLOAT"
    )
    tree.links.new(stored.outputs[0], output.inputs[0])
    scene_with_camera.render.use_motion_blur = True
    found = extract_scene(
        bpy.context.evaluated_depsgraph_get(),
        set_frame=lambda frame, part: scene_with_camera.frame_set(frame, subframe=part),
    )
    assert sum("velocities of voxels" in str(warning) for warning in found.warnings) == expected, found.warnings


def test_what_cannot_be_read_is_named(scene_with_camera: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    make_cloud(scene_with_camera)
    monkeypatch.setattr(command, "CHILD", command.CHILD.with_name("none.py"))
    extraction = extract()
    assert not extraction.scene.meshes
    (text,) = [str(warning) for warning in extraction.warnings]
    assert "Cloud" in text
    assert "cannot be read, it is left out: the process that reads its voxels ended unexpectedly" in text


@pytest.mark.parametrize("place", ["OwnedFolder", "start_blender"])
def test_a_volume_without_room_for_files_or_processes_is_left_out(
    scene_with_camera: Any, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    """It ended the whole render with an internal error."""

    def fail(*_: Any, **__: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", "/tmp/x")

    make_cloud(scene_with_camera)
    monkeypatch.setattr(process, place, fail)
    (text,) = [str(warning) for warning in extract().warnings]
    assert "cannot be read, it is left out: /tmp/x: No space left on device" in text


class Stored(list):
    """An array property of Blender's: `foreach_get` copies it."""

    def foreach_get(self, values: np.ndarray) -> None:
        values[:] = self


def make_domain(**grids: Any) -> Any:
    empty = {field: Stored() for field, _ in volume_objects.DOMAIN_GRIDS.values()}
    return SimpleNamespace(domain_resolution=(2, 3, 4), use_noise=True, noise_scale=2, **(empty | grids))


def test_cells_of_smoke_lie_in_the_texture_space() -> None:
    """x runs fastest; a value is that of a cell's middle; noise refines all but heat and velocity."""
    density, velocity = np.arange(8 * 24.0), np.arange(3 * 24.0)
    domain = make_domain(density_grid=Stored(density), velocity_grid=Stored(velocity))
    mesh = SimpleNamespace(texspace_size=(1.0, 1.5, 2.0), texspace_location=(0.0, 0.0, 2.0))
    shown = SimpleNamespace(data=mesh)
    found = volume_objects.read_domain(domain, shown, ("density", "velocity", "flame"))
    assert found.keys() == {"density", "velocity"}
    values, matrix = found["density"]
    assert values.shape == (4, 6, 8)
    assert values[1, 0, 0] == 1.0
    assert values[0, 1, 0] == 4.0
    assert_allclose(matrix @ (0, 0, 0, 1), (-0.75, -1.25, 0.25, 1))
    assert_allclose(matrix @ (3, 5, 7, 1), (0.75, 1.25, 3.75, 1))
    values, matrix = found["velocity"]
    assert values.shape == (2, 3, 4, 3)
    assert values[1, 0, 0].tolist() == [3, 4, 5]


def test_colors_of_smoke_keep_their_alpha() -> None:
    domain = make_domain(color_grid=Stored(np.arange(8 * 24 * 4.0)))
    shown = SimpleNamespace(data=SimpleNamespace(texspace_size=(1, 1, 1), texspace_location=(0, 0, 0)))
    values, _ = volume_objects.read_domain(domain, shown, ("color",))["color"]
    assert values.shape == (4, 6, 8, 4)
    assert values[1, 0, 0].tolist() == [4, 5, 6, 7]
