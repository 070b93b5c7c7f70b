"""What addon.ray_cast keeps from call to call, how the package is imported, and the README's examples."""

from __future__ import annotations

import gc
import re
import subprocess
import sys
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Vector

import addon
from addon import ray_cast
from addon.extract.camera import extract_camera
from addon.extract.warnings import WarningList
from addon.scripting import held
from raytracer.film.camera import primary_rays
from tests.addon.scripting.ray_cast_fixtures import (
    aim_down,
    assert_same_as_blender,
    forget_casters,  # noqa: F401  (a fixture, found by its name)
    link,
    make_collection_instance,
    make_quad,
)
from tests.folders import ROOT

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("forget_casters")]


# What is kept -------------------------------------------------------------------------------------------------------


def kept():
    """Return what is held after one more call."""
    assert_same_as_blender()
    return next(reversed(held._held.values()))


def test_nothing_is_built_again_where_nothing_changed(empty_scene):
    bpy.ops.mesh.primitive_monkey_add()
    first = kept()
    bpy.context.object.select_set(False)
    bpy.context.view_layer.update()
    assert kept() is first


def test_only_what_changed_is_read_again(empty_scene):
    quad, other = link("Quad", make_quad()), link("Other", make_quad(2), (0, 0, -1))
    first = kept()
    quad.location.z = 1
    second = kept()
    assert second.shapes == first.shapes
    assert second.caster is not first.caster
    other.data.vertices[0].co.z = 0.5
    other.data.update()
    third = kept()
    key = quad.session_uid, 0
    assert third.shapes[key] is first.shapes[key]
    assert third.shapes[other.session_uid, 0] is not first.shapes[other.session_uid, 0]


def test_of_many_objects_only_the_one_that_moves_is_built_again(empty_scene):
    things = [link(f"Quad {k}", make_quad(0.4), (k - 4, k / 3 - 1, 0)) for k in range(8)]
    assert kept().casters.moving is None
    frames = []
    for z in (0.5, 1.0, 1.5):
        things[2].location.z = z
        frames.append(kept().casters)
    stills = {id(casters.moving._still) for casters in frames}
    assert len(stills) == 1
    assert all(casters._whole is None for casters in frames)


def change_topology(thing):
    """Divide the same square, of the same vertices, otherwise."""
    corners = [tuple(vertex.co) for vertex in thing.data.vertices]
    thing.data.clear_geometry()
    thing.data.from_pydata(corners, [], [(0, 1, 2), (0, 2, 3)])


EDITS = {
    "moved": lambda thing: setattr(thing, "location", (0, 0, 1)),
    "divided otherwise": change_topology,
    "given other data": lambda thing: setattr(thing, "data", make_quad(2)),
    "modified": lambda thing: thing.modifiers.new("Solid", "SOLIDIFY"),
    "deleted": lambda thing: bpy.data.objects.remove(thing),
    "its data deleted": lambda thing: bpy.data.meshes.remove(thing.data),
    "hidden": lambda thing: thing.hide_set(True),
    "replaced by one of its name": lambda thing: (bpy.data.objects.remove(thing), link("Thing", make_quad(0.3))),
    "doubled": lambda thing: link("Double", thing.data, (0, 0, 2)),
    "renamed": lambda thing: setattr(thing, "name", "Another"),
}


@pytest.mark.parametrize("edit", EDITS)
def test_every_edit_is_noticed(empty_scene, edit):
    link("Below", make_quad(3), (0.2, 0.1, -2))
    thing = link("Thing", make_quad())
    assert_same_as_blender()
    EDITS[edit](thing)
    assert_same_as_blender()


def test_corners_shared_out_otherwise_are_noticed(empty_scene):
    """Positions and the corners' vertices stay the same, byte by byte; only which polygon has which differs."""
    places = [(-3, -3, 0), (3, -3, 0), (3, 3, 0), (-3, 3, 0), (-3, 3, 1), (3, 3, 2), (3, -3, 1)]
    thing = link("Thing", bpy.data.meshes.new("Seven"))
    for polygons in ([(0, 1, 2), (3, 4, 5, 6)], [(0, 1, 2, 3), (4, 5, 6)]):
        thing.data.clear_geometry()
        thing.data.from_pydata(places, [], polygons)
        assert_same_as_blender()


def test_animation_is_followed(empty_scene):
    thing = link("Thing", make_quad())
    for frame in (1, 11):
        thing.location.z = frame / 4
        thing.keyframe_insert("location", frame=frame)
    for frame in (1, 6, 11, 1):
        empty_scene.frame_set(frame)
        assert_same_as_blender()


def test_undo_and_redo_are_followed(empty_scene):
    link("Below", make_quad(3), (0.2, 0.1, -2))
    bpy.ops.ed.undo_push(message="one")
    link("Thing", make_quad())
    bpy.ops.ed.undo_push(message="two")
    assert "Thing" in {thing.name for thing in assert_same_as_blender().objects}
    bpy.ops.ed.undo()
    assert "Thing" not in bpy.data.objects
    assert "Thing" not in {thing.name for thing in assert_same_as_blender().objects}
    bpy.ops.ed.redo()
    assert "Thing" in {thing.name for thing in assert_same_as_blender().objects}


def test_new_file_lets_go_of_the_last_one(empty_scene, tmp_path):
    link("Thing", make_quad())
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "quad.blend"))
    assert_same_as_blender()
    assert held._held
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "quad.blend"))
    assert not held._held
    assert_same_as_blender()
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    assert not held._held


def test_only_the_views_used_last_are_kept(empty_scene):
    link("Thing", make_quad())
    layers = [bpy.context.view_layer, *(empty_scene.view_layers.new(f"Layer {k}") for k in range(held.MOST_HELD))]
    for layer in layers:
        layer.update()
        assert ray_cast(layer.depsgraph, *aim_down()).result.any()
    assert [view[1] for view in held._held] == [layer.name for layer in layers[1:]]


def test_nothing_of_blender_is_kept(empty_scene):
    """Walk through all that is reachable from what is held."""
    make_collection_instance()
    cast = assert_same_as_blender()
    pending, seen = [held._held], set()
    while pending:
        item = pending.pop()
        if id(item) not in seen and not isinstance(item, type) and not callable(item):
            seen.add(id(item))
            assert not isinstance(item, bpy.types.bpy_struct | bpy.types.bpy_prop_collection), item
            pending += gc.get_referents(item)
    assert len(seen) > 10
    assert cast.objects


def test_unregister_leaves_no_handler(empty_scene):
    before = list(bpy.app.handlers.load_post)
    link("Thing", make_quad())
    for _ in range(3):
        assert_same_as_blender()
    assert bpy.app.handlers.load_post == [*before, held.forget]
    addon.register()
    addon.unregister()
    assert bpy.app.handlers.load_post == before
    assert not held._held


def test_package_brings_in_nothing_until_asked():
    code = """
import sys, addon
assert not {"numpy", "bpy", "raytracer"} & set(sys.modules)
import addon.scripting.ray_cast
from addon import ray_cast
assert ray_cast is addon.scripting.ray_cast.ray_cast is addon.ray_cast
try:
    addon.no_such_thing
except AttributeError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.stdout.splitlines()[-1] == "module 'addon' has no attribute 'no_such_thing'", done.stderr


# The README's examples ----------------------------------------------------------------------------------------------


def open_still_life():
    """Open the still life, with its object of most vertices active."""
    bpy.ops.wm.open_mainfile(filepath=str(ROOT / "blend_scenes" / "still_life.blend"), load_ui=False)
    meshes = [thing for thing in bpy.context.scene.objects if thing.type == "MESH"]
    bpy.context.view_layer.objects.active = max(meshes, key=lambda thing: len(thing.data.vertices))


def find_blocks(text):
    return re.findall(r"```python\n(.*?)```", text, re.DOTALL)


@pytest.fixture
def examples():
    """Return the README's examples, to be run in order on the still life."""
    section = (ROOT / "README.md").read_text(encoding="utf-8").split("## Many rays at once\n")[1].split("\n## ")[0]
    open_still_life()
    names: dict[str, Any] = {}
    blocks = find_blocks(section)
    assert len(blocks) == 3
    return names, blocks


def test_readme_scans_the_scene(examples):
    names, blocks = examples
    exec(blocks[0], names)
    points = bpy.data.objects["LiDAR"].data
    assert len(points.vertices) > 1000
    away = [(vertex.co - Vector((0, 0, 1.8))).length for vertex in points.vertices]
    np.testing.assert_allclose([item.value for item in points.attributes["distance"].data], away, rtol=1e-5)


def test_the_page_about_scans_runs():
    blocks = find_blocks((ROOT / "addon" / "scripting" / "README.md").read_text(encoding="utf-8"))
    open_still_life()
    names: dict[str, Any] = {}
    for block in blocks:
        exec(block, names)
    assert len(names["values"]["distance"]) > 10_000
    assert "Backdrop" in names["names"].values()
    assert names["depth"].shape == names["instance"].shape == (names["height"], names["width"])
    assert np.isfinite(names["thickness"]).any()
    assert names["within"].any()
    assert not names["within"].all()
    assert names["seen"].any()
    assert not names["seen"].all()
    assert len(names["materials"]) > 3
    assert np.isfinite(names["height_in_object"]).any()


def test_readme_maps_what_the_camera_sees(examples):
    names, blocks = examples
    exec("\n".join(blocks[:2]), names)
    height, width = names["height"], names["width"]
    camera = extract_camera(names["depsgraph"].scene_eval, WarningList())
    row, column = np.mgrid[0:height, 0:width] + 0.5
    rays = primary_rays(camera, width, height, column.ravel(), height - row.ravel())
    ours = names["grid"].reshape(-1, 3) @ names["camera"][:3, :3].T
    unit = [value / np.linalg.norm(value, axis=1, keepdims=True) for value in (ours, rays.directions)]
    np.testing.assert_allclose(*unit, atol=16 * 2.0**-24)  # Blender has the corners of the frame in float32
    assert names["depth"].shape == names["index"].shape == (height, width)
    far = np.isinf(names["depth"])
    np.testing.assert_array_equal(far, names["index"] < 0)
    along = unit[0] @ -names["camera"][:3, 2]
    distance = np.linalg.norm(names["cast"].location - names["camera"][:3, 3], axis=1)
    np.testing.assert_allclose(names["depth"].ravel()[~far.ravel()], (along * distance)[~far.ravel()], rtol=1e-6)
    assert len({names["names"][number] for number in np.unique(names["index"][~far])}) > 3


def test_readme_finds_the_visible_vertices(examples):
    names, blocks = examples
    exec("\n".join(blocks), names)
    visible, depsgraph, scene = names["seen"], names["depsgraph"], bpy.context.scene
    assert 0 < visible.sum() < len(visible)
    # Blender by itself, in float32: nothing hides a vertex up to a thousandth before it.
    eye = names["camera"][:3, 3]
    to_vertex = names["vertices"] - eye
    reach = np.linalg.norm(to_vertex, axis=1) * 0.999
    ways = zip(to_vertex, reach, strict=True)
    hidden = [scene.ray_cast(depsgraph, eye, way, distance=end)[0] for way, end in ways]
    assert not (visible & hidden).any()
