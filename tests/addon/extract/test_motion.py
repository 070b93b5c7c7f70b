"""What is read of motion: the right frames, the right things, and nothing of what stands still."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest

from addon import versions
from addon.extract import motion, shutter
from addon.extract.scene import extract_scene
from raytracer.scene.moments import find_moment
from tests.addon.extract.test_instances import add_nodes_modifier

pytestmark = pytest.mark.usefixtures("registered_addon")

FRAME = 10


@pytest.fixture
def stage(shown: Any) -> Any:
    """The scene of one triangle and a camera, blurred over a frame."""
    scene = bpy.context.scene
    scene.frame_set(FRAME)
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, 1.0
    return scene


def key(thing: Any, path: str, *values: Any) -> None:
    """Give a property values at the frames around FRAME, with linear motion between them."""
    for frame, value in zip(range(FRAME - 1, FRAME + 2), values, strict=True):
        setattr(thing, path, value)
        thing.keyframe_insert(path, frame=frame)
    bpy.context.scene.frame_set(FRAME)


def move(thing: Any, path: str = "location") -> None:
    """Let a thing go along x, by 1 for a frame, evenly."""
    place = np.array(getattr(thing, path))
    key(thing, path, *(tuple(place + np.array([step, 0.0, 0.0])) for step in (-1.0, 0.0, 1.0)))
    for curve in list_curves(thing):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"


def list_curves(thing: Any) -> list[Any]:
    action = thing.animation_data.action
    if hasattr(action, "fcurves"):
        return list(action.fcurves)
    return [
        curve for layer in action.layers for strip in layer.strips for bag in strip.channelbags for curve in bag.fcurves
    ]


def read(stage: Any, *passes: str, **options: Any) -> tuple[Any, list[float]]:
    """Return the extraction, with options of its function, and the frames that it asked for."""
    for thing in stage.objects:
        thing.update_tag()  # a property of Cycles alone is not told to the depsgraph that is there
    asked: list[float] = []

    def set_frame(frame: int, subframe: float) -> None:
        asked.append(frame + subframe)
        stage.frame_set(frame, subframe=subframe)

    found = extract_scene(bpy.context.evaluated_depsgraph_get(), ("Combined", *passes), set_frame=set_frame, **options)
    assert stage.frame_current_final == FRAME
    return found, asked


def places(found: Any) -> list[float]:
    return found.scene.motion.instances[0].world_from_object[:, 0, 0, 3].tolist()


def test_a_moving_object_is_read_at_its_steps(stage: Any, shown: Any) -> None:
    move(shown)
    found, asked = read(stage)
    assert asked == [FRAME - 0.5, FRAME + 0.5, FRAME]
    assert places(found) == [-0.5, 0.0, 0.5]
    assert found.scene.motion.camera is None
    assert found.scene.motion.meshes == ()
    assert found.scene.motion.shutter is None
    assert found.scene.motion.rolling_shutter is None


@pytest.mark.parametrize(("position", "first"), [("START", 0.0), ("CENTER", -0.5), ("END", -1.0)])
def test_the_shutter_opens_where_it_is_set_to(stage: Any, shown: Any, position: str, first: float) -> None:
    move(shown)
    stage.render.motion_blur_position = position
    found, _ = read(stage)
    assert places(found) == [first, first + 0.5, first + 1.0]
    assert found.scene.instances.world_from_object[0, 0, 3] == first + 0.5


def test_a_camera_in_place_of_the_scenes_is_seen_through_at_all_steps(stage: Any, shown: Any) -> None:
    """Viewports and strips may have one of their own: it was ignored."""
    other = bpy.data.objects.new("Other", bpy.data.cameras.new("Other"))
    other.location.y = 3.0
    stage.collection.objects.link(other)
    move(other)
    found, _ = read(stage, seen_from=other)
    assert found.scene.camera.world_from_camera[:3, 3].tolist() == [0.0, 3.0, 0.0]
    assert found.scene.motion.camera.world_from_camera[:, 0, 3].tolist() == [-0.5, 0.0, 0.5]


def test_more_steps_follow_the_path_more_finely(stage: Any, shown: Any) -> None:
    move(shown)
    shown.cycles.motion_steps = 3
    found, asked = read(stage)
    assert places(found) == [step / 8 - 0.5 for step in range(9)]
    assert len(asked) == 9


def test_objects_without_motion_blur_stand_still(stage: Any, shown: Any) -> None:
    move(shown)
    shown.cycles.use_motion_blur = False
    assert read(stage)[0].scene.motion is None


def test_an_instance_stands_still_where_its_instancer_does(stage: Any, shown: Any) -> None:
    move(shown)
    collection = bpy.data.collections.new("Collection")
    stage.collection.objects.unlink(shown)
    collection.objects.link(shown)
    instancer = bpy.data.objects.new("Instancer", None)
    instancer.instance_type, instancer.instance_collection = "COLLECTION", collection
    stage.collection.objects.link(instancer)
    assert places(read(stage)[0]) == [-0.5, 0.0, 0.5]
    instancer.cycles.use_motion_blur = False
    assert read(stage)[0].scene.motion is None


@pytest.mark.parametrize("by_layer", [False, True])
def test_nothing_is_read_where_nothing_shall_be_blurred(
    stage: Any, shown: Any, monkeypatch: Any, by_layer: bool
) -> None:
    move(shown)
    (bpy.context.view_layer if by_layer else stage.render).use_motion_blur = False
    monkeypatch.setattr(motion, "count_steps", None)
    found, asked = read(stage)
    assert (found.scene.motion, asked) == (None, [])


def test_a_scene_that_stands_still_has_no_motion(stage: Any) -> None:
    assert read(stage)[0].scene.motion is None


def test_shapes_of_rigid_objects_are_not_read(stage: Any, shown: Any, monkeypatch: Any) -> None:
    move(shown)
    monkeypatch.setattr(motion, "read_shape", None)
    assert places(read(stage)[0]) == [-0.5, 0.0, 0.5]


def add_shape(shown: Any) -> Any:
    """A shape key that lifts the last corner by 2 in two frames, evenly."""
    shown.shape_key_add(name="Basis")
    lifted = shown.shape_key_add(name="Lifted")
    lifted.data[2].co.z = 2.0
    keys = shown.data.shape_keys
    for frame, value in ((FRAME - 1, 0.0), (FRAME + 1, 1.0)):
        lifted.value = value
        lifted.keyframe_insert("value", frame=frame)
    for curve in list_curves(keys):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    bpy.context.scene.frame_set(FRAME)
    return lifted


@pytest.mark.parametrize("smooth", [False, True])
def test_a_mesh_that_deforms_has_its_corners_and_normals_at_each_step(stage: Any, shown: Any, smooth: bool) -> None:
    shown.data.polygons.foreach_set("use_smooth", [smooth])
    add_shape(shown)
    found, _ = read(stage)
    (part,) = found.scene.motion.meshes
    assert found.scene.motion.instances == ()
    assert np.allclose(part.positions[:, 2, 2], [0.5, 1.0, 1.5], atol=1e-6)
    assert np.array_equal(part.positions[1], found.scene.meshes[0].positions)
    if not smooth:
        assert part.normals is None
        return
    normals = np.cross(part.positions[:, 1] - part.positions[:, 0], part.positions[:, 2] - part.positions[:, 0])
    expected = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    assert np.allclose(part.normals.reshape(3, -1, 3), expected[:, np.newaxis], atol=1e-4)


def test_deformation_can_be_left_out(stage: Any, shown: Any) -> None:
    add_shape(shown)
    shown.cycles.use_deform_motion = False
    assert read(stage)[0].scene.motion is None


def test_a_mesh_that_changes_its_vertices_stands_still(stage: Any, shown: Any) -> None:
    """As in Cycles, which cannot tell which are which."""
    add_shape(shown)
    array = shown.modifiers.new("Array", "ARRAY")
    key(shown, "pass_index", 0, 1, 2)
    driver = array.driver_add("count").driver
    variable = driver.variables.new()
    variable.targets[0].id, variable.targets[0].data_path = shown, "pass_index"
    driver.expression = "frame"
    bpy.context.scene.frame_set(FRAME)
    found, _ = read(stage)
    counts = {len(mesh.positions) for mesh in found.scene.meshes}
    assert counts == {3 * FRAME}
    moved = found.scene.motion
    assert moved is None or all(part.positions.shape[1] == 3 * FRAME for part in moved.meshes)
    assert ["number of vertices changes" in str(warning) for warning in found.warnings] == [True]


def add_velocity(shown: Any, velocity: Any) -> None:
    shown.data.attributes.new("velocity", "FLOAT_VECTOR", "POINT").data.foreach_set("vector", np.ravel(velocity))


def test_a_mesh_with_velocities_goes_straight_on(stage: Any, shown: Any, monkeypatch: Any) -> None:
    """By metres in a second: half a frame before and half a one behind; shapes at other frames are not read."""
    monkeypatch.setattr(motion, "read_shape", None)
    add_shape(shown)
    shown.data.polygons.foreach_set("use_smooth", [True])
    stage.render.fps, stage.render.fps_base = 10, 2.0
    velocity = np.arange(9, dtype=np.float32).reshape(3, 3)
    add_velocity(shown, velocity)
    found = read(stage)[0].scene
    (part,), middle = found.motion.meshes, found.meshes[0]
    assert np.allclose(part.positions, middle.positions + velocity * np.reshape([-0.1, 0.0, 0.1], (3, 1, 1)), atol=1e-6)
    assert np.array_equal(part.normals, [middle.normals] * 3)
    stage.render.use_motion_blur = False
    (part,) = read(stage, "Vector")[0].scene.neighbors.meshes
    assert np.allclose(part.positions[2] - part.positions[0], velocity * 0.4, atol=1e-6)


def test_velocities_that_are_not_finite_are_named(stage: Any, shown: Any) -> None:
    add_velocity(shown, [np.nan] * 9)
    found = read(stage)[0]
    assert found.scene.motion is None
    assert "velocities of others, or that are not finite: it keeps" in str(found.warnings[0])


def test_velocities_of_what_shall_not_deform_are_not_read(stage: Any, shown: Any, monkeypatch: Any) -> None:
    add_velocity(shown, np.ones(9))
    shown.cycles.use_deform_motion = False
    monkeypatch.setattr(motion, "read_velocity", None)
    assert read(stage)[0].scene.motion is None


def test_a_camera_that_moves_and_zooms(stage: Any) -> None:
    camera = stage.camera
    move(camera)
    for frame, lens in ((FRAME - 1, 20.0), (FRAME + 1, 60.0)):
        camera.data.lens = lens
        camera.data.keyframe_insert("lens", frame=frame)
    for curve in list_curves(camera.data):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    stage.frame_set(FRAME)
    found, _ = read(stage)
    moving = found.scene.motion.camera
    assert moving.world_from_camera[:, 0, 3].tolist() == [-0.5, 0.0, 0.5]
    assert np.allclose(moving.extent, [40 / 30, 1.0, 40 / 50], rtol=1e-6)


def test_curve_and_rolling_shutter_are_read(stage: Any, shown: Any) -> None:
    move(shown)
    curve = stage.render.motion_blur_shutter_curve
    for point, height in zip(curve.curves[0].points, (0.0, 1.0, 0.0), strict=True):
        point.location.y = height
        point.handle_type = "VECTOR"
    curve.update()
    stage.cycles.rolling_shutter_type, stage.cycles.rolling_shutter_duration = "TOP", 0.25
    moving = read(stage)[0].scene.motion
    assert moving.rolling_shutter == 0.25
    expected = 1.0 - np.abs(2.0 * np.linspace(0.0, 1.0, shutter.CURVE_SIZE) - 1.0)
    assert np.abs(moving.shutter - expected).max() < 0.02


def test_an_error_leaves_the_scene_at_its_frame(stage: Any, shown: Any, monkeypatch: Any) -> None:
    move(shown)

    def fail(*_: Any) -> None:
        raise ValueError("broken")

    monkeypatch.setattr(motion, "make_instance_motion", fail)
    with pytest.raises(ValueError, match="broken"):
        read(stage)
    assert stage.frame_current_final == FRAME


def scatter(shown: Any) -> None:
    """Let nodes make points of an object's corners."""
    add_nodes_modifier(shown, "GeometryNodeMeshToPoints")


def test_point_clouds_move_with_their_object(stage: Any, shown: Any) -> None:
    scatter(shown)
    move(shown)
    found = read(stage)[0]
    assert not found.warnings
    (motion,) = found.scene.motion.spheres
    assert motion.group == 0
    np.testing.assert_array_equal(motion.world_from_object[:, 0, 3], [-0.5, 0.0, 0.5])
    np.testing.assert_allclose(find_moment(found.scene, 0.5).spheres[0].centres, found.scene.spheres[0].centres)


@pytest.mark.parametrize("passes", [(), ("Vector",)])
@pytest.mark.parametrize("velocity", [None, 1.0])
def test_point_clouds_are_named_where_they_change_and_no_more(
    stage: Any, shown: Any, passes: tuple[str, ...], velocity: float | None
) -> None:
    """Nodes may change a shape at any time; whether they do is seen in the points, or their velocities."""
    scatter(shown)
    stage.render.use_motion_blur = not passes
    assert not read(stage, *passes)[0].warnings
    if velocity is None:
        add_shape(shown)
    else:
        add_velocity(shown, np.full(9, velocity))
    (warning,) = read(stage, *passes)[0].warnings
    assert str(warning).startswith("object 'Object': " + ("the Vector pass of" if passes else "motion blur of"))


def test_point_clouds_that_move_are_named_where_vectors_are_asked_for(stage: Any, shown: Any) -> None:
    scatter(shown)
    move(shown)
    stage.render.use_motion_blur = False
    assert any("point clouds" in str(warning) for warning in read(stage, "Vector")[0].warnings)


def test_the_vector_pass_reads_the_frames_around_whatever_is_blurred(stage: Any, shown: Any) -> None:
    move(shown)
    shown.cycles.use_motion_blur, shown.cycles.motion_steps = False, 4
    stage.render.use_motion_blur, stage.render.motion_blur_position = False, "END"
    found, asked = read(stage, "Vector")
    assert asked == [FRAME - 1, FRAME + 1, FRAME]
    assert found.scene.motion is None
    assert found.scene.neighbors.instances[0].world_from_object[:, 0, 0, 3].tolist() == [-1.0, 0.0, 1.0]
    assert not found.warnings


def test_the_vector_pass_is_empty_where_the_picture_is_blurred(stage: Any, shown: Any) -> None:
    move(shown)
    found, _ = read(stage, "Vector")
    assert found.scene.neighbors is None
    assert places(found) == [-0.5, 0.0, 0.5]
    assert any("Vector" in str(warning) for warning in found.warnings)


@pytest.mark.parametrize("smooth", [False, True])
def test_a_displaced_mesh_is_displaced_at_each_step_as_in_the_middle(stage: Any, shown: Any, smooth: bool) -> None:
    """As in Cycles (scene/mesh_displace.cpp): by a tenth along x, by a constant vector."""
    shown.data.polygons.foreach_set("use_smooth", [smooth])
    add_shape(shown)
    material = bpy.data.materials.new("Material")
    if versions.find_node_tree(material) is None:
        material.use_nodes = True
    material.displacement_method = "DISPLACEMENT"
    nodes, links = versions.find_node_tree(material).nodes, versions.find_node_tree(material).links
    vector = nodes.new("ShaderNodeCombineXYZ")
    vector.inputs[0].default_value = 0.1
    output = versions.find_output_node(versions.find_node_tree(material))
    links.new(vector.outputs[0], output.inputs["Displacement"])
    shown.data.materials.append(material)
    (part,) = read(stage)[0].scene.motion.meshes
    assert np.allclose(part.positions[:, 0], (0.1, 0.0, 0.0), atol=1e-6)
    assert np.allclose(part.positions[:, 2, 2], [0.5, 1.0, 1.5], atol=1e-6)
