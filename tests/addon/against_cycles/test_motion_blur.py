"""Motion blur against Cycles of the same Blender: a shining plane over a lit floor, in motion of every kind.

Both have the same shutter. Cycles' table of its curve ends at 255/256 of the time, which is less than can be seen here.
"""

import math

import bpy
import numpy as np
import pytest

from addon.compare.cycles import metrics
from addon.compare.cycles.rendering import Request, matched_settings, render_batches, render_both
from addon.properties import ENGINE
from blend_scenes import building

pytestmark = pytest.mark.usefixtures("registered_addon")

# As in `test_pictures`.
MITSUBA_BAR = 0.0025
SIZE = (32, 24)
SAMPLES, BATCHES = 16, 8
CYCLES_FACTOR = 4
FRAME = 2


def make_stage():
    """The plane stands still; the shutter is open for a frame around FRAME."""
    scene = building.start_scene(*SIZE)
    shining = building.make_shader("Shining", "Emission", (0.9, 0.6, 0.3))
    plane = building.make_plane("Plane", 1.2, 0.8)
    thing = building.link_object("Plane", plane, (0, 0, 0.5), rotation=(90, 0, 0), materials=[shining])
    grey = building.make_shader("Grey", "Diffuse", (0.6, 0.6, 0.7))
    building.link_object("Floor", building.make_plane("Floor", 6, 6), materials=[grey])
    building.add_camera((0, -5, 1.2), (0, 0, 0.5), 35)
    lamp = building.add_light("Lamp", "POINT", 200.0, (1, -2, 3), (0, 0, 0))
    lamp.data.shadow_soft_size = 0.0
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, 1.0
    return scene, thing


def key(thing, path, *values):
    """Give a property values at the frames around FRAME."""
    for frame, value in zip(range(FRAME - 1, FRAME + 2), values, strict=True):
        setattr(thing, path, value)
        thing.keyframe_insert(path, frame=frame)


def move(scene, thing):
    key(thing, "location", (-1, 0, 0.5), (0, 0, 0.8), (1, 0, 0.5))


def turn(scene, thing):
    key(thing, "rotation_euler", (math.pi / 2, 0, 0), (math.pi / 2, 1.2, 0), (math.pi / 2, 2.9, 0.3))


def turn_in_steps(scene, thing):
    turn(scene, thing)
    thing.cycles.motion_steps = 3


def stretch(scene, thing):
    key(thing, "scale", (0.3, 0.3, 0.3), (1, 1, 1), (2, 0.5, 1))


def move_camera(scene, thing):
    key(scene.camera, "location", (-0.7, -5, 1.2), (0, -5, 1.2), (0.5, -4, 1.5))


def zoom(scene, thing):
    key(scene.camera.data, "lens", 20, 35, 60)


def bend(scene, thing):
    """A shape key."""
    thing.shape_key_add(name="Basis")
    bent = thing.shape_key_add(name="Bent")
    for point in bent.data[:2]:
        point.co.x += 1.5
    key(bent, "value", 0.0, 0.3, 1.0)


def pose(scene, thing):
    """A bone of an armature that moves one side."""
    armature = bpy.data.objects.new("Armature", bpy.data.armatures.new("Armature"))
    scene.collection.objects.link(armature)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    armature.data.edit_bones.new("Bone").tail = (0, 0, 1)
    bpy.ops.object.mode_set(mode="OBJECT")
    thing.vertex_groups.new(name="Bone").add([0, 1], 1.0, "REPLACE")
    building.add_modifier(thing, "ARMATURE", "Armature", object=armature)
    key(armature.pose.bones["Bone"], "location", (-0.8, 0, 0), (0, 0, 0), (0.8, 0.3, 0))


def fly(scene, thing):
    """Velocities of corners, in metres per second: two go to the right, two up."""
    velocity = np.array([(1, 0, 0), (1, 0, 0), (0, 0.5, 0), (0, 0.5, 0)], np.float32) * scene.render.fps
    thing.data.attributes.new("velocity", "FLOAT_VECTOR", "POINT").data.foreach_set("vector", velocity.ravel())


def carry(scene, thing):
    """A parent."""
    thing.parent = add_empty(scene)


def scatter(scene, thing):
    """An instanced collection."""
    collection = bpy.data.collections.new("Collection")
    scene.collection.objects.unlink(thing)
    collection.objects.link(thing)
    empty = add_empty(scene)
    empty.instance_type, empty.instance_collection = "COLLECTION", collection


def add_empty(scene):
    empty = bpy.data.objects.new("Empty", None)
    scene.collection.objects.link(empty)
    key(empty, "location", (-1, 0, 0), (0, 0, 0.3), (1, 0, 0))
    return empty


def leave_out(scene, thing):
    move(scene, thing)
    thing.cycles.use_motion_blur = False


def cloud(scene, thing):
    """A point cloud that turns about a point beside it, and grows."""
    bpy.ops.object.pointcloud_random_add()
    points = bpy.context.object
    points.data.materials.append(thing.data.materials[0])
    scene.objects["Plane"].hide_render = True
    key(points, "location", (-1, 0, 0.5), (0, 0, 0.8), (1, 0, 0.5))
    key(points, "rotation_euler", (0, -1, 0), (0, 0, 0), (0, 1, 0))
    key(points, "scale", (0.3,) * 3, (0.4,) * 3, (0.5,) * 3)


def curve(scene, thing):
    move(scene, thing)
    shutter = scene.render.motion_blur_shutter_curve
    for point, height in zip(shutter.curves[0].points, (0, 1, 0), strict=True):
        point.location.y = height
    shutter.update()


def place(position, change):
    def prepare(scene, thing):
        change(scene, thing)
        scene.render.motion_blur_position = position

    return prepare


def roll(duration, change):
    def prepare(scene, thing):
        change(scene, thing)
        scene.cycles.rolling_shutter_type, scene.cycles.rolling_shutter_duration = "TOP", duration

    return prepare


QUICK = {"a turn": turn, "a camera, rolling": roll(0.4, move_camera)}
SLOW = {
    "a move": move,
    "a turn in nine steps": turn_in_steps,
    "a stretch": stretch,
    "a camera": move_camera,
    "a zoom": zoom,
    "a shape key": bend,
    "an armature": pose,
    "velocities": fly,
    "a parent": carry,
    "a collection": scatter,
    "an object that is left out": leave_out,
    "a point cloud": cloud,
    "a curve": curve,
    "the start": place("START", move),
    "the end": place("END", move),
    "a shape key to the end": place("END", bend),
    "a move, rolling": roll(0.1, move),
    "a move, all rolling": roll(0.0, move),
}
CASES = QUICK | SLOW


REQUEST = Request(*(*SIZE, SAMPLES, 4, BATCHES), cycles_factor=CYCLES_FACTOR, integrator="PATH")


@pytest.mark.parametrize("name", [*QUICK, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)])
def test_motion_agrees(name):
    scene, thing = make_stage()
    CASES[name](scene, thing)
    scene.frame_set(FRAME)
    ours, cycles = (side.passes["Combined"] for side in render_both(scene, bpy.context.view_layer, REQUEST))
    summed = SAMPLES * CYCLES_FACTOR
    assert metrics.share_failing_pixels(ours, cycles, summed) <= MITSUBA_BAR
    assert metrics.share_failing_tiles(ours, cycles, summed, size=8) == 0.0


def test_the_test_would_see_a_picture_without_the_blur():
    scene, thing = make_stage()
    move(scene, thing)
    scene.frame_set(FRAME)
    pictures = []
    for thing.cycles.use_motion_blur in (True, False):
        with matched_settings(scene, bpy.context.view_layer, REQUEST):
            pictures.append(render_batches(scene, bpy.context.view_layer, ENGINE, REQUEST).passes["Combined"])
    blurred, still = pictures
    assert metrics.share_failing_pixels(blurred, still, SAMPLES) > 10 * MITSUBA_BAR


# Pixels, and the share of a vector: what changes within a pixel, of which Cycles has the mean.
VECTOR_TOLERANCE, VECTOR_SHARE = 0.05, 0.02


SLOW_VECTORS = "a turn", "a zoom", "a shape key", "velocities"


@pytest.mark.parametrize("name", ["a camera", *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW_VECTORS)])
def test_vectors_agree_but_at_edges(name):
    """There Cycles has the mean of two surfaces."""
    scene, thing = make_stage()
    CASES[name](scene, thing)
    scene.frame_set(FRAME)
    scene.render.use_motion_blur = False
    for number, name in enumerate(("Plane", "Floor")):
        bpy.data.objects[name].pass_index = number + 1
    request = Request(*(*SIZE, 4, 0), cycles_factor=8, passes=("Combined", "Vector", "Object Index"))
    ours, cycles = (side.passes for side in render_both(scene, bpy.context.view_layer, request))
    index, found, expected = ours["Object Index"][0, ..., 0], ours["Vector"][0], cycles["Vector"][0]
    near = np.lib.stride_tricks.sliding_window_view(index, (3, 3))
    inside = (near == near[..., :1, :1]).all(axis=(2, 3))
    off, size = (np.abs(part).max(axis=-1)[1:-1, 1:-1][inside] for part in (found - expected, expected))
    assert inside.mean() > 0.6
    assert size.max() > 2.0
    assert (off <= VECTOR_TOLERANCE + VECTOR_SHARE * size).all()
