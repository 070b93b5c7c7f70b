"""Strands in motion: with their object, in shape, by velocities; what is read at a step is what a still shows then."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from numpy.testing import assert_allclose, assert_array_equal

from addon.extract import motion
from addon.extract.scene import extract_scene
from addon.extract.strand_motion import fit, resample
from addon.extract.strands import Strands
from addon.extract.velocities import move_points
from raytracer.scene.moments import find_moment

from .test_instances import add_instancer, add_nodes_modifier
from .test_strands import POINTS, add_curves, add_furry_square, extract

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]

# Of places in metres that Blender keeps in float32, after a change of space: Cycles' own number.
SAME_PLACE = 1e-5
FRAMES = {0: 0.0, 1: 0.5, 2: 1.0}  # and the times of the shutter


def extract_motion(scene: Any, *passes: str) -> Any:
    """Extract with the shutter open from frame 0 to frame 2; without one for passes."""
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = not passes, 2.0
    scene.frame_set(1)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return extract_scene(depsgraph, passes, set_frame=lambda frame, part: scene.frame_set(frame, subframe=part))


def move(shown: Any) -> None:
    """Key the place of an object, one metre further along x each frame."""
    for frame in (0, 1, 2):
        shown.location.x = frame - 1.0
        shown.keyframe_insert("location", frame=frame)


def test_hair_moves_with_its_object(scene_with_camera: Any) -> None:
    move(add_curves(scene_with_camera))
    extraction = extract_motion(scene_with_camera)
    (moving,) = extraction.scene.motion.curves
    assert moving.group == 0
    assert_allclose(moving.world_from_object[:, 0, 3], [-1, 0, 1], atol=1e-6)
    assert_allclose(moving.points[0], extraction.scene.curves[0].points, atol=1e-6)
    assert not extraction.warnings


@pytest.mark.parametrize("is_shown", [True, False])
def test_fur_moves_with_what_it_grows_on(scene_with_camera: Any, is_shown: bool) -> None:
    shown = add_furry_square(scene_with_camera)
    shown.show_instancer_for_render = is_shown
    move(shown)
    extraction = extract_motion(scene_with_camera)
    motion = extraction.scene.motion
    assert_allclose(motion.curves[0].world_from_object[:, 0, 3], [-1, 0, 1], atol=1e-6)
    assert not extraction.warnings


def test_hair_that_stands_still_has_no_motion(scene_with_camera: Any) -> None:
    add_curves(scene_with_camera)
    extraction = extract_motion(scene_with_camera)
    assert extraction.scene.motion is None
    assert not extraction.warnings


def lift(shown: Any) -> None:
    """Give a mesh a shape key that lifts one side, more each frame."""
    shown.shape_key_add(name="Basis")
    key = shown.shape_key_add(name="Up")
    for point in key.data[:2]:
        point.co.z += 1.0
    for frame in FRAMES:
        key.value = frame / 2.0
        key.keyframe_insert("value", frame=frame)


def drive(shown: Any, kind: str, socket: str, add: float = 0.0) -> tuple[Any, Any]:
    """Let a node change a Curves object, by the frame plus a number; return it, and the node that adds."""
    (node,) = add_nodes_modifier(shown, kind)
    tree = shown.modifiers[-1].node_group
    time, total = (tree.nodes.new(kind) for kind in ("GeometryNodeInputSceneTime", "ShaderNodeMath"))
    total.inputs[1].default_value = add
    tree.links.new(time.outputs["Frame"], total.inputs[0])
    tree.links.new(total.outputs[0], node.inputs[socket])
    return node, total


def stretch(shown: Any, add: float = 0.0) -> None:
    """Each point goes by (1, 1, 1) for a frame, times its height."""
    node, total = drive(shown, "GeometryNodeSetPosition", "Offset", add)
    tree = shown.modifiers[-1].node_group
    kinds = "ShaderNodeMath", "GeometryNodeInputPosition", "ShaderNodeSeparateXYZ"
    scale, place, parts = (tree.nodes.new(kind) for kind in kinds)
    scale.operation = "MULTIPLY"
    tree.links.new(place.outputs[0], parts.inputs[0])
    tree.links.new(parts.outputs["Z"], scale.inputs[0])
    tree.links.new(total.outputs[0], scale.inputs[1])
    tree.links.new(scale.outputs[0], node.inputs["Offset"])


def assert_as_stills(scene: Any, extraction: Any) -> None:
    """At each step, hair is what a still shows at its frame."""
    for frame, time in FRAMES.items():
        scene.frame_set(frame)
        (expected,), (found,) = extract().scene.curves, find_moment(extraction.scene, time).curves
        assert_allclose(found.points, expected.points, atol=SAME_PLACE)
        assert_allclose(found.radii, expected.radii, atol=SAME_PLACE)


@pytest.mark.parametrize("children", [False, True])
def test_fur_on_a_mesh_that_deforms_is_at_each_step_what_a_still_shows(scene_with_camera: Any, children: bool) -> None:
    settings = {"child_type": "SIMPLE", "rendered_child_count": 2, "child_percent": 2} if children else {}
    shown = add_furry_square(scene_with_camera, **settings)
    lift(shown)
    move(shown)
    extraction = extract_motion(scene_with_camera)
    (moving,) = extraction.scene.motion.curves
    assert moving.points.shape == (3, len(extraction.scene.curves[0].points), 3)
    assert not extraction.warnings
    assert_as_stills(scene_with_camera, extraction)


def test_two_systems_of_fur_move_each_on_its_own(scene_with_camera: Any) -> None:
    shown = add_furry_square(scene_with_camera, count=3)
    shown.modifiers.new("More", "PARTICLE_SYSTEM").particle_system.settings.type = "HAIR"
    lift(shown)
    extraction = extract_motion(scene_with_camera)
    groups = extraction.scene.motion.curves
    assert [group.group for group in groups] == [0, 1]
    for group in groups:
        assert_allclose(group.points[1], extraction.scene.curves[group.group].points, atol=SAME_PLACE)
        assert not np.allclose(group.points[0], group.points[2], atol=0.1)


def test_curves_that_nodes_change_are_at_each_step_what_a_still_shows(scene_with_camera: Any) -> None:
    shown = add_curves(scene_with_camera)
    stretch(shown)
    move(shown)
    extraction = extract_motion(scene_with_camera)
    (moving,) = extraction.scene.motion.curves
    assert_allclose(moving.points[2] - moving.points[0], 2.0 * np.repeat(POINTS[:, 2:], 3, axis=1), atol=SAME_PLACE)
    assert_as_stills(scene_with_camera, extraction)


def test_a_width_that_changes_is_read_at_each_step(scene_with_camera: Any) -> None:
    drive(add_curves(scene_with_camera), "GeometryNodeSetCurveRadius", "Radius")
    extraction = extract_motion(scene_with_camera)
    assert_array_equal(extraction.scene.motion.curves[0].radii, np.repeat([[0.0], [1.0], [2.0]], 5, axis=1))
    assert_array_equal(find_moment(extraction.scene, 0.25).curves[0].radii, [0.5] * 5)


def test_strands_with_other_points_at_a_step_have_theirs_evenly_along_them(scene_with_camera: Any) -> None:
    """A straight one with 1, 2 and 3 of them, which are 2."""
    shown = add_curves(scene_with_camera, (2,), POINTS[3:])
    drive(shown, "GeometryNodeResampleCurve", "Count", add=1.0)
    (moving,) = extract_motion(scene_with_camera).scene.motion.curves
    assert_allclose(moving.points[:, :, 2], [[0.0, 0.0], [0.0, 2.0], [0.0, 2.0]], atol=SAME_PLACE)


@pytest.mark.parametrize("passes", [(), ("Vector",)])
def test_strands_that_come_or_go_are_named_and_keep_their_shape(
    scene_with_camera: Any, passes: tuple[str, ...]
) -> None:
    """The second at the frame 2: there the number of a strand, plus the frame, is above 2."""
    shown = add_curves(scene_with_camera)
    node, total = drive(shown, "GeometryNodeDeleteGeometry", "Selection")
    tree, node.domain = shown.modifiers[-1].node_group, "CURVE"
    above = tree.nodes.new("ShaderNodeMath")
    above.operation, above.inputs[1].default_value = "GREATER_THAN", 2.0
    tree.links.new(tree.nodes.new("GeometryNodeInputIndex").outputs[0], total.inputs[1])
    tree.links.new(total.outputs[0], above.inputs[0])
    tree.links.new(above.outputs[0], node.inputs["Selection"])
    move(shown)
    extraction = extract_motion(scene_with_camera, *passes)
    found = extraction.scene.neighbors if passes else extraction.scene.motion
    assert [len(group.points) for group in found.curves] == [1]
    (warning,) = extraction.warnings
    assert str(warning) == "object 'Curves': strands that come, go or are not finite: they keep their shape in motion"


def test_curves_with_velocities_go_straight_on(scene_with_camera: Any) -> None:
    """By metres in a second: 2 frames of 1/10 s, half before and half behind; shapes at other frames do not count."""
    scene_with_camera.render.fps, scene_with_camera.render.fps_base = 20, 2.0
    shown = add_curves(scene_with_camera)
    velocity = np.arange(15, dtype=np.float32).reshape(5, 3)
    shown.data.attributes.new("velocity", "FLOAT_VECTOR", "POINT").data.foreach_set("vector", velocity.ravel())
    stretch(shown)
    shown.cycles.motion_steps = 3
    (moving,) = extract_motion(scene_with_camera).scene.motion.curves
    middle = POINTS + POINTS[:, 2:]
    assert_allclose(moving.points, [middle - 0.1 * velocity, middle, middle + 0.1 * velocity], atol=SAME_PLACE)
    (neighbors,) = extract_motion(scene_with_camera, "Vector").scene.neighbors.curves
    assert_allclose(neighbors.points, moving.points)


@pytest.mark.parametrize(("kind", "domain"), [("FLOAT", "POINT"), ("FLOAT_VECTOR", "CURVE")])
def test_what_is_no_velocity_of_points_moves_nothing(scene_with_camera: Any, kind: str, domain: str) -> None:
    add_curves(scene_with_camera).data.attributes.new("velocity", kind, domain)
    assert extract_motion(scene_with_camera).scene.motion is None


@pytest.mark.parametrize("setting", ["use_deform_motion", "use_motion_blur"])
def test_deformation_of_hair_can_be_left_out(scene_with_camera: Any, monkeypatch: Any, setting: str) -> None:
    shown = add_furry_square(scene_with_camera)
    lift(shown)
    setattr(shown.cycles, setting, False)
    monkeypatch.setattr(motion, "read_shapes", None)
    assert extract_motion(scene_with_camera).scene.motion is None


def test_shapes_are_read_only_of_what_may_change_and_once_for_all_instances(
    scene_with_camera: Any, monkeypatch: Any
) -> None:
    still, shown = add_curves(scene_with_camera), add_curves(scene_with_camera)
    move(still)
    stretch(shown)
    collection = bpy.data.collections.new("Collection")
    scene_with_camera.collection.objects.unlink(shown)
    collection.objects.link(shown)
    for x in (10, 20):
        add_instancer(scene_with_camera, collection, Matrix.Translation((x, 0, 0)))
    read, sources = motion.read_shapes, []

    def count(shown: Any, source: Any, is_render: bool) -> Any:
        sources.append(source.name)
        return read(shown, source, is_render)

    monkeypatch.setattr(motion, "read_shapes", count)
    found = extract_motion(scene_with_camera).scene.motion.curves
    assert sources == [shown.name] * 2  # at two further times
    assert sorted(len(group.points) for group in found) == [1, 3, 3]
    places = sorted(tuple(group.world_from_object[:, 0, 3].tolist()) for group in found)
    assert places == [(-1.0, 0.0, 1.0), (10.0, 10.0), (20.0, 20.0)]


def test_the_vector_pass_reads_hair_at_the_frames_around(scene_with_camera: Any) -> None:
    shown = add_curves(scene_with_camera)
    stretch(shown)
    move(shown)
    extraction = extract_motion(scene_with_camera, "Vector")
    assert extraction.scene.motion is None
    (moving,) = extraction.scene.neighbors.curves
    assert_allclose(moving.world_from_object[:, 0, 3], [-1, 0, 1], atol=1e-6)
    assert_allclose(moving.points[2] - moving.points[0], 2.0 * np.repeat(POINTS[:, 2:], 3, axis=1), atol=SAME_PLACE)


def make_strands(*counts: int, seed: int = 0) -> Strands:
    rng, first = np.random.default_rng(seed), np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    return Strands(rng.normal(size=(first[-1], 3)), rng.random(first[-1]), first)


def test_other_numbers_of_points_are_interpolated_along_each_strand() -> None:
    strands, wanted = make_strands(5, 1, 2, 4), make_strands(3, 2, 5, 1)
    found = resample(strands, wanted.first)
    for number in range(4):
        old, new = (slice(*each.first[number : number + 2]) for each in (strands, wanted))
        place = np.linspace(0.0, 1.0, new.stop - new.start) * (old.stop - old.start - 1)
        for values, expected in (
            (found.points.T, strands.points.T),
            (found.radii[np.newaxis], strands.radii[np.newaxis]),
        ):
            for one, other in zip(values, expected, strict=True):
                assert_allclose(one[new], np.interp(place, np.arange(old.stop - old.start), other[old]), rtol=1e-14)


def test_strands_that_are_not_finite_or_not_as_many_do_not_fit() -> None:
    strands = make_strands(3, 4)
    assert fit(strands, strands) is strands
    assert fit(make_strands(3, 4, 2), strands) is None
    broken = make_strands(3, 4)
    broken.points[5, 1] = np.nan
    assert fit(broken, strands) is None


def test_points_go_straight_on_with_velocities_that_are_theirs_and_finite() -> None:
    points, velocity = np.arange(21.0).reshape(7, 3), np.ones((7, 3))
    steps = move_points(points, velocity, 3.0)
    assert steps is not None
    assert_array_equal(steps, [points - 1.5, points, points + 1.5])
    assert move_points(points, 0.0 * velocity, 3.0) == []
    assert move_points(points, velocity[1:], 3.0) is None
    assert move_points(points, np.inf * velocity, 3.0) is None
