"""Adaptive subdivision as it is read: what decides, what is kept, what moves, and what a file stays."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from mathutils.kdtree import KDTree

from addon import versions
from addon.extract.kept import Kept
from addon.extract.scene import extract_scene
from blend_scenes import building

NEEDS_BASE = pytest.mark.skipif(versions.VERSION < (5, 0), reason="Blender hands out no mesh before its subdivision")
pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]


@pytest.fixture
def box() -> Any:
    """A box of 2 m, 10 m before a camera with 500 pixels to the metre at 1 m, to be diced to eight pixels."""
    scene = building.start_scene(360, 240)
    building.add_camera((0, -10, 0), (0, 0, 0), 50)
    scene.cycles.preview_dicing_rate = 8.0
    scene.cycles.offscreen_dicing_scale = 1.0
    thing = building.link_object("Box", building.make_box("Box", 2, 2, 2))
    make_adaptive(thing)
    return thing


def make_adaptive(thing: Any, **settings: Any) -> Any:
    modifier = thing.modifiers.new("Subdivision", "SUBSURF")
    if hasattr(modifier, "use_adaptive_subdivision"):
        modifier.use_adaptive_subdivision = True
    else:
        thing.cycles.use_adaptive_subdivision = True
    for name, value in settings.items():
        setattr(modifier, name, value)
    return modifier


def read(**options: Any) -> Any:
    return extract_scene(bpy.context.evaluated_depsgraph_get(), **options)


def measure_edges(extraction: Any, number: int = 0) -> Any:
    """The lengths of all edges in the world, as the first instance places them."""
    mesh = extraction.scene.meshes[number]
    matrix = extraction.scene.instances.world_from_object[number]
    corners = mesh.positions[mesh.triangles] @ matrix[:3, :3].T
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)


def longest(**options: Any) -> float:
    return float(measure_edges(read(**options)).max())


@pytest.mark.skipif(versions.VERSION >= (5, 0), reason="Blender has it")
def test_before_blender_5_the_modifiers_levels_are_used(box: Any) -> None:
    (warning,) = read().warnings
    assert str(warning) == (
        "object 'Box': adaptive subdivision needs Blender 5.0 or later, the modifier's own levels are used"
    )
    assert len(read().scene.meshes[0].positions) == 26


@NEEDS_BASE
def test_edges_are_as_long_as_asked_where_the_camera_sees_them(box: Any) -> None:
    """10 m away eight pixels are 16 cm, and the limit surface of the box lies between 9 and 11 m."""
    extraction = read()
    assert not extraction.warnings
    lengths = measure_edges(extraction)
    assert 0.5 * 0.16 < lengths.max() < 1.1 * 0.16
    bpy.context.scene.cycles.preview_dicing_rate = 2.0
    assert longest() < 1.1 * 0.04
    box.modifiers[0].adaptive_pixel_size = 2.0
    assert 0.5 * 0.08 < longest() < 1.1 * 0.08


@NEEDS_BASE
def test_edges_are_as_long_as_asked_in_the_object(box: Any) -> None:
    box.modifiers[0].adaptive_space, box.modifiers[0].adaptive_object_edge_length = "OBJECT", 0.02
    box.scale, bpy.context.scene.cycles.preview_dicing_rate = (3, 3, 3), 4.0
    assert 3 * 0.04 < longest() <= 3 * 0.08 * (1 + 1e-6)


@NEEDS_BASE
@pytest.mark.parametrize("kind", ["ORTHO", "PANO"])
def test_other_cameras_have_pixels_of_their_own(box: Any, kind: str) -> None:
    """Of 360 pixels over 7.2 m eight are 16 cm, as are eight degrees of 360 pixels, 10 m away, 1.4 m: the middle."""
    camera = bpy.context.scene.camera.data
    camera.type, camera.ortho_scale = kind, 7.2
    if kind == "PANO":
        camera.panorama_type = "EQUIRECTANGULAR"
        box.modifiers[0].adaptive_pixel_size = 0.25
    wanted = 0.16 if kind == "ORTHO" else 10 * np.deg2rad(2.0 * 180 / 240)
    assert 0.5 * wanted < longest() < 1.1 * wanted


@NEEDS_BASE
def test_what_is_out_of_sight_is_coarser(box: Any) -> None:
    fine = longest()
    box.location.y = -20.0
    assert longest() == pytest.approx(fine, rel=0.2)
    bpy.context.scene.cycles.offscreen_dicing_scale = 4.0
    assert longest() > 1.8 * fine


@NEEDS_BASE
def test_the_dicing_camera_decides(box: Any) -> None:
    scene = bpy.context.scene
    before, near = longest(), scene.camera.copy()
    near.location.y = -5.0
    scene.collection.objects.link(near)
    scene.cycles.dicing_camera = near
    assert longest() < 0.7 * before


@NEEDS_BASE
def test_the_instance_that_is_seen_largest_decides(box: Any) -> None:
    before, near = len(read().scene.meshes[0].triangles), bpy.data.objects.new("Near", box.data)
    near.location.y = -6.0
    bpy.context.scene.collection.objects.link(near)
    make_adaptive(near)
    extraction = read()
    counts = [len(extraction.scene.meshes[number].triangles) for number in extraction.scene.instances.mesh]
    assert max(counts) > 4 * before
    far = bpy.data.objects.new("Many", None)
    holder = bpy.data.collections.new("Held")
    bpy.context.scene.collection.objects.unlink(near)
    holder.objects.link(box)
    bpy.context.scene.collection.objects.unlink(box)
    far.instance_type, far.instance_collection = "COLLECTION", holder
    bpy.context.scene.collection.objects.link(far)
    assert len(read().scene.meshes[0].triangles) == before
    second = far.copy()
    second.location.y = -6.0
    bpy.context.scene.collection.objects.link(second)
    extraction = read()
    assert len(extraction.scene.meshes) == 1
    assert len(extraction.scene.instances.mesh) == 2
    assert len(extraction.scene.meshes[0].triangles) == max(counts)


@NEEDS_BASE
def test_points_are_those_of_blenders_limit_surface(box: Any) -> None:
    """Of a monkey: the vertices of Blender's own third level are among those of dicing by halves of halves."""
    bpy.ops.mesh.primitive_monkey_add()
    monkey = bpy.context.object
    bpy.data.objects.remove(box)
    make_adaptive(monkey, adaptive_space="OBJECT", adaptive_object_edge_length=1e-3)
    bpy.context.scene.cycles.max_subdivisions = 3
    bpy.context.scene.cycles.preview_dicing_rate = 1.0
    found = read().scene.meshes[0]
    modifier = monkey.modifiers[0]
    modifier.use_adaptive_subdivision, modifier.levels, modifier.quality = False, 3, 6
    expected = read().scene.meshes[0].positions
    assert len(found.positions) == len(expected)
    tree = KDTree(len(expected))
    for number, point in enumerate(expected):
        tree.insert(point, number)
    tree.balance()
    nearest = [tree.find(point) for point in found.positions]
    # Blender's points are float32, of 1 m.
    assert max(distance for _, _, distance in nearest) < 1e-6
    assert len({number for _, number, _ in nearest}) == len(expected)


@NEEDS_BASE
def test_a_file_stays_what_it_is_and_rays_hit_what_blender_has(box: Any) -> None:
    names = [block.name for block in (*bpy.data.meshes, *bpy.data.objects)]
    before = len(box.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.vertices)
    read()
    assert [block.name for block in (*bpy.data.meshes, *bpy.data.objects)] == names
    assert len(box.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.vertices) == before
    for options in ({"geometry_only": True}, {"needs_camera": False}):
        extraction = read(**options)
        assert len(extraction.scene.meshes[0].positions) == before
        assert not extraction.warnings


@NEEDS_BASE
def test_without_a_camera_there_is_one_warning(box: Any) -> None:
    bpy.context.scene.camera = None
    box.modifiers[0].show_viewport = True
    from addon.extract import adaptive

    dicing = adaptive.read_dicing(bpy.context.evaluated_depsgraph_get())
    assert dicing.view is None
    warnings = adaptive.WarningList()
    shown = box.evaluated_get(bpy.context.evaluated_depsgraph_get())
    assert adaptive.read_adaptive(shown, shown, dicing, warnings) is None
    (warning,) = warnings.records
    assert "no camera" in str(warning)


@NEEDS_BASE
def test_a_modifier_that_is_off_or_not_the_last_is_as_before(box: Any) -> None:
    box.modifiers[0].show_viewport = False
    assert len(read().scene.meshes[0].positions) == 8
    box.modifiers[0].show_viewport = True
    box.modifiers.new("Wire", "TRIANGULATE")
    assert len(read().scene.meshes[0].positions) == 26


@NEEDS_BASE
def test_too_many_triangles_are_one_warning(box: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("addon.extract.dicing.MOST_TRIANGLES", 10_000)
    box.modifiers[0].adaptive_pixel_size = 0.1
    extraction = read()
    (warning,) = extraction.warnings
    assert str(warning) == (
        "object 'Box': adaptive subdivision to 0.8 pixels takes more than 10,000 triangles, "
        "its edges have up to 6.4 pixels instead"
    )
    assert 1_250 < len(extraction.scene.meshes[0].triangles) <= 10_000
    assert measure_edges(extraction).max() < 1.1 * 0.128


@NEEDS_BASE
def test_what_does_not_change_is_not_diced_again(box: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = Kept()
    first = read(kept=kept).scene.meshes[0]
    monkeypatch.setattr("addon.extract.dicing.dice_mesh", lambda *_: pytest.fail("diced again"))
    assert read(kept=kept).scene.meshes[0] is first
    monkeypatch.undo()
    box.location.y = -3.0
    assert len(read(kept=kept).scene.meshes[0].triangles) > len(first.triangles)
    box.location.y = 0.0
    box.modifiers[0].adaptive_pixel_size = 2.0
    assert len(read(kept=kept).scene.meshes[0].triangles) < len(first.triangles)
    box.modifiers[0].use_adaptive_subdivision = False
    assert len(read(kept=kept).scene.meshes[0].positions) == 26


@NEEDS_BASE
def test_nothing_of_it_is_asked_where_no_object_has_it(box: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    box.modifiers[0].use_adaptive_subdivision = False
    monkeypatch.setattr("addon.extract.adaptive.read_base", lambda *_: pytest.fail("read"))
    monkeypatch.setattr("addon.extract.scene.dice_meshes", lambda *_: pytest.fail("diced"))
    monkeypatch.setattr(versions, "open_base", lambda *_: pytest.fail("opened"))
    assert len(read().scene.meshes[0].positions) == 26


@NEEDS_BASE
@pytest.mark.parametrize("smooth", [False, True])
def test_a_mesh_that_deforms_moves_as_its_limit_surface(box: Any, smooth: bool) -> None:
    """A key that doubles the box doubles its limit surface; at the shutter's ends it has done so by half."""
    scene = bpy.context.scene
    box.data.polygons.foreach_set("use_smooth", [smooth] * 6)
    box.shape_key_add(name="Basis")
    large = box.shape_key_add(name="Large")
    for point in large.data:
        point.co *= 2.0
    for frame, value in ((1, 0.0), (3, 1.0)):
        large.value = value
        large.keyframe_insert("value", frame=frame)
    for curve in list_curves(box.data.shape_keys):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    scene.frame_set(2)
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, 1.0
    extraction = read(set_frame=lambda frame, subframe: scene.frame_set(frame, subframe=subframe))
    assert not extraction.warnings
    (motion,), (mesh,) = extraction.scene.motion.meshes, extraction.scene.meshes
    assert motion.positions.shape[1:] == mesh.positions.shape
    base = mesh.positions / 1.5
    for step, factor in zip(motion.positions, (1.25, 1.5, 1.75), strict=True):
        np.testing.assert_allclose(step, factor * base, atol=1e-6)
    assert (motion.normals is None) != smooth


@NEEDS_BASE
def test_velocities_carry_a_diced_mesh_with_the_one_it_was_made_of(box: Any) -> None:
    """By metres in a second, of each vertex as much as its place: half a frame before, its limit surface is smaller."""
    scene = bpy.context.scene
    scene.render.fps, scene.render.use_motion_blur, scene.render.motion_blur_shutter = 10, True, 1.0
    velocity = box.data.attributes.new("velocity", "FLOAT_VECTOR", "POINT")
    velocity.data.foreach_set("vector", np.ravel([point.co for point in box.data.vertices]))
    extraction = read(set_frame=lambda frame, subframe: scene.frame_set(frame, subframe=subframe))
    assert not extraction.warnings
    (motion,), (mesh,) = extraction.scene.motion.meshes, extraction.scene.meshes
    for step, factor in zip(motion.positions, (0.95, 1.0, 1.05), strict=True):
        np.testing.assert_allclose(step, factor * mesh.positions, atol=1e-6)


def list_curves(keys: Any) -> list[Any]:
    (layer,) = keys.animation_data.action.layers
    return [curve for bag in layer.strips[0].channelbags for curve in bag.fcurves]


@NEEDS_BASE
def test_creases_count_where_the_modifier_says_so(box: Any) -> None:
    """A box all of whose edges are creased stays a box; its limit surface without them lies well inside."""
    creases = box.data.attributes.new("crease_edge", "FLOAT", "EDGE")
    creases.data.foreach_set("value", [1.0] * 12)
    assert read().scene.meshes[0].positions[:, 0].max() == 1.0
    box.modifiers[0].use_creases = False
    assert read().scene.meshes[0].positions[:, 0].max() < 0.9
