"""What extraction keeps from one state of a scene to the next: what is read again, and that nothing is lost."""

from __future__ import annotations

import pickle
from typing import Any

import bpy
import numpy as np
import pytest

from addon.extract import mesh_table
from addon.extract.kept import Changes, Kept
from addon.extract.scene import extract_scene
from addon.versions import find_node_tree
from tests.addon.engine.engine_fixtures import make_emission
from tests.addon.viewport.viewport_fixtures import make_two_planes, update

pytestmark = pytest.mark.usefixtures("registered_addon")


@pytest.fixture
def stage(empty_scene: Any) -> Any:
    return make_two_planes(empty_scene)


def add_object(stage: Any, name: str, x: float, materials: int = 1) -> Any:
    mesh = bpy.data.meshes.new(name)
    corners = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.5)]
    mesh.from_pydata(corners, [], [(0, 1, 2), (0, 2, 3)])
    for number in range(materials):
        mesh.materials.append(make_emission(f"{name} {number}", (0.1 * number, 0.5, 0.5)))
    mesh.polygons[1].material_index = materials - 1
    mesh.uv_layers.new(name="UV")
    found = bpy.data.objects.new(name, mesh)
    found.location = (x, 0.0, 1.0)
    stage.collection.objects.link(found)
    return found


def describe(extraction: Any) -> bytes:
    """Return all of an extraction as bytes; what is equal need not be the same object."""
    scene = extraction.scene
    parts = [*scene.meshes, *scene.materials, *scene.lights, *scene.spheres, scene.instances, scene.world]
    whole = [pickle.dumps(pickle.loads(pickle.dumps(part))) for part in parts]
    polygons = [rows.tobytes() for rows in extraction.polygons]
    return pickle.dumps(
        (whole, polygons, [tuple(key) for key in extraction.objects], list(map(str, extraction.warnings)))
    )


def announce(*changed: Any, shapes: tuple[Any, ...] = (), kinds: tuple[str, ...] = ("OBJECT",)) -> Changes:
    """Return Changes as Blender would announce them of original data-blocks."""
    ids = frozenset(data.session_uid for data in (*changed, *shapes))
    return Changes(ids, frozenset(data.session_uid for data in shapes), frozenset(kinds))


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the names of the objects whose meshes are read from now on."""
    names: list[str] = []
    extract = mesh_table.extract_geometry

    def extract_and_note(mesh: Any, name: str, *rest: Any) -> Any:
        names.append(name)
        return extract(mesh, name, *rest)

    monkeypatch.setattr(mesh_table, "extract_geometry", extract_and_note)
    return names


def test_what_did_not_change_is_not_read_again(stage: Any, reads: list[str]) -> None:
    for number in range(5):
        add_object(stage, f"Tile {number}", float(number), materials=2)
    kept = Kept()
    first = extract_scene(update(), kept=kept)
    assert len(reads) == 7
    reads.clear()
    bpy.data.objects["Tile 3"].location.z = 2.0
    depsgraph = update()
    kept.changes = announce()
    moved = extract_scene(depsgraph, kept=kept)
    assert reads == []
    assert describe(moved) == describe(extract_scene(depsgraph))
    assert all(one is other for one, other in zip(moved.scene.meshes, first.scene.meshes, strict=True))
    assert all(one is other for one, other in zip(moved.scene.materials, first.scene.materials, strict=True))


def change_shape(stage: Any) -> Changes:
    mesh = bpy.data.meshes["Tile 1"]
    mesh.vertices[0].co.z = 3.0
    mesh.update()
    return announce(shapes=(mesh, bpy.data.objects["Tile 1"]))


def change_material(stage: Any) -> Changes:
    material = bpy.data.materials["Tile 2 1"]
    find_node_tree(material).nodes["Emission"].inputs["Strength"].default_value = 3.0
    return announce(material, kinds=("MATERIAL", "NODETREE"))


def read_attribute(stage: Any) -> Changes:
    """Let a material ask for an attribute that it did not read before."""
    material = bpy.data.materials["Tile 2 1"]
    tree = find_node_tree(material)
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    tree.links.new(coordinates.outputs["UV"], tree.nodes["Emission"].inputs["Color"])
    return announce(material, kinds=("MATERIAL", "NODETREE"))


def assign_material(stage: Any) -> Changes:
    found = bpy.data.objects["Tile 2"]
    found.data.materials[0] = bpy.data.materials["Tile 4 1"]
    return announce(found, shapes=(found.data,))


def remove_first(stage: Any) -> Changes:
    """Change the numbers of all meshes and materials."""
    bpy.data.objects.remove(bpy.data.objects["Red"])
    return announce(kinds=("SCENE", "COLLECTION"))


def add_another(stage: Any) -> Changes:
    found = add_object(stage, "Another", 7.0)
    return announce(found, shapes=(found.data,), kinds=("OBJECT", "MESH", "SCENE", "COLLECTION"))


def hide_from_camera(stage: Any) -> Changes:
    bpy.data.objects["Tile 0"].visible_camera = False
    return announce(bpy.data.objects["Tile 0"])


def hide_wholly(stage: Any) -> Changes:
    bpy.data.objects["Tile 0"].hide_viewport = True
    return announce(bpy.data.objects["Tile 0"], kinds=("OBJECT", "SCENE"))


def share_mesh(stage: Any) -> Changes:
    found = bpy.data.objects.new("Twin", bpy.data.meshes["Tile 3"])
    stage.collection.objects.link(found)
    return announce(found, kinds=("OBJECT", "SCENE"))


def color_vertices(stage: Any) -> Changes:
    mesh = bpy.data.meshes["Tile 2"]
    mesh.uv_layers["UV"].uv[0].vector = (0.25, 0.75)
    mesh.update()
    return announce(shapes=(mesh,))


CHANGES = (
    change_shape,
    change_material,
    read_attribute,
    assign_material,
    remove_first,
    add_another,
    hide_from_camera,
    hide_wholly,
    share_mesh,
    color_vertices,
)


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("announced", [True, False])
def test_after_a_change_all_is_as_if_read_anew(stage: Any, change: Any, announced: bool) -> None:
    for number in range(5):
        add_object(stage, f"Tile {number}", float(number), materials=2)
    if change is color_vertices:
        read_attribute(stage)
    kept = Kept()
    before = extract_scene(update(), kept=kept)
    changes = change(stage)
    depsgraph = update()
    kept.changes = changes if announced else None
    after = extract_scene(depsgraph, kept=kept)
    assert describe(after) == describe(extract_scene(depsgraph))
    assert describe(after) != describe(before)


def test_changes_one_after_the_other_leave_nothing_behind(stage: Any) -> None:
    for number in range(5):
        add_object(stage, f"Tile {number}", float(number), materials=2)
    kept = Kept()
    extract_scene(update(), kept=kept)
    for change in CHANGES:
        changes = change(stage)
        depsgraph = update()
        kept.changes = changes
        assert describe(extract_scene(depsgraph, kept=kept)) == describe(extract_scene(depsgraph)), change.__name__
    assert len(kept.meshes) == len(
        {tile.data for tile in stage.objects if tile.type == "MESH" and not tile.hide_viewport}
    )


def test_material_changes_read_no_mesh(stage: Any, reads: list[str]) -> None:
    add_object(stage, "Tile 2", 0.0, materials=2)
    kept = Kept()
    extract_scene(update(), kept=kept)
    reads.clear()
    changes = change_material(stage)
    depsgraph = update()
    kept.changes = changes
    extract_scene(depsgraph, kept=kept)
    assert reads == []


def test_unannounced_but_unchanged_meshes_stay_the_same_records(stage: Any) -> None:
    kept = Kept()
    first = extract_scene(update(), kept=kept)
    again = extract_scene(update(), kept=kept)
    assert all(one is other for one, other in zip(again.scene.meshes, first.scene.meshes, strict=True))


def test_warnings_are_told_again_for_what_is_not_read_again(stage: Any) -> None:
    tile = add_object(stage, "Tile", 0.0)
    tile.modifiers.new("Hair", "PARTICLE_SYSTEM").particle_system.settings.type = "HAIR"
    tile.data.vertices[0].co.x = float("nan")
    kept = Kept()
    first = extract_scene(update(), kept=kept)
    assert len(first.warnings) >= 2
    kept.changes = announce()
    assert extract_scene(update(), kept=kept).warnings == first.warnings


def test_a_mesh_that_is_edited_is_read_as_it_is(stage: Any) -> None:
    tile = add_object(stage, "Tile", 0.0)
    bpy.context.view_layer.objects.active = tile
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.transform.translate(value=(0.0, 0.0, 2.0))
    edited = extract_scene(update())
    bpy.ops.object.mode_set(mode="OBJECT")
    for tag in ("positions", "triangles"):
        np.testing.assert_array_equal(
            getattr(edited.scene.meshes[-1], tag), getattr(extract_scene(update()).scene.meshes[-1], tag)
        )
    assert edited.scene.meshes[-1].positions[:, 2].min() == 2.0
