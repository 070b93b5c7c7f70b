"""Hair in motion against Cycles of the same Blender: shining strands over a lit floor, that move or change their shape.

All keep their width: of one that changes Cycles shows that of the middle of the time (`extract.strand_motion`).
"""

import bpy
import numpy as np
import pytest

from addon.compare.cycles import metrics
from addon.compare.cycles.rendering import Request, render_both
from blend_scenes import building
from tests.addon.against_cycles.test_hair import BIAS_BAR, ROUND_BAR, add_strands
from tests.addon.against_cycles.test_motion_blur import (
    BATCHES,
    CYCLES_FACTOR,
    FRAME,
    SAMPLES,
    SIZE,
    VECTOR_SHARE,
    VECTOR_TOLERANCE,
    key,
    make_stage,
)
from tests.addon.extract.test_strand_motion import drive, stretch

pytestmark = pytest.mark.usefixtures("registered_addon")

# Points of each of `add_strands`.
KEYS = 6


def move(strands):
    key(strands, "location", (-0.8, 0, 0), (-0.3, 0, 0.2), (0.6, 0, 0))
    key(strands, "rotation_euler", (0, 0, 0), (0, 0.2, 0), (0, 0.9, 0))


def bend(strands):
    """Nodes that lean strands over, and let them grow, by their height in a frame."""
    stretch(strands, -FRAME)
    strands.scale, strands.rotation_euler = (0.6, 0.6, 0.6), (0, 0.3, 0)


def trim(strands):
    """Nodes that let strands grow, in a frame by a third of their length: points come and go on each."""
    _, total = drive(strands, "GeometryNodeTrimCurve", "End", 1 / 3)
    total.operation = "MULTIPLY"


def fly(strands):
    """Velocities that get faster to the tips."""
    second = bpy.context.scene.render.fps
    velocity = np.zeros((len(strands.data.points) // KEYS, KEYS, 3), dtype=np.float32)
    velocity[..., 0], velocity[..., 2] = np.linspace(0, 0.8, KEYS) * second, 0.1 * second
    strands.data.attributes.new("velocity", "FLOAT_VECTOR", "POINT").data.foreach_set("vector", velocity.ravel())


STRANDS = {"a move": move, "nodes": bend, "growth": trim, "velocities": fly}


def add_fur(shining, **settings):
    """Fur of a ball that moves, and bulges to one side."""
    ball = building.link_object("Ball", building.make_sphere("Ball", 0.3, 8), (0, 0, 0.6), materials=[shining])
    hair = ball.modifiers.new("Hair", "PARTICLE_SYSTEM").particle_system.settings
    hair.type, hair.count, hair.hair_length, hair.radius_scale = "HAIR", 20, 0.5, 0.3
    for name, value in settings.items():
        setattr(hair, name, value)
    ball.shape_key_add(name="Basis")
    bulge = ball.shape_key_add(name="Bulge")
    for point in bulge.data:
        point.co.x = 1.5 * point.co.x + 0.6 * point.co.z + 0.5
    key(bulge, "value", 0.0, 0.3, 1.0)
    key(ball, "location", (-0.2, 0, 0.6), (0, 0, 0.6), (0.2, 0, 0.7))
    return ball


CHILDREN = {"child_type": "INTERPOLATED", "count": 8, "child_percent": 3, "rendered_child_count": 3}
FUR = {"fur": {}, "children": CHILDREN}
CASES = (*STRANDS, *FUR)


def make_scene(shape, name, **strands):
    scene, thing = make_stage()
    bpy.data.objects.remove(thing)
    scene.cycles_curves.shape, scene.cycles_curves.subdivisions = shape, 4
    shining = building.make_shader("Shining", "Emission", (0.9, 0.6, 0.3))
    if name in STRANDS:
        STRANDS[name](add_strands(shining, **strands))
    else:
        add_fur(shining, **FUR[name])
    scene.frame_set(FRAME)
    return scene


def choose_cases(*quick):
    """Return all cases with both shapes, of which only ribbons of the named ones are quick.

    Of round strands that are cut off even stills differ, by 1% of a tile: Cycles shows more where they end.
    """
    cases = [(name, shape) for name in CASES for shape in ("RIBBONS", "THICK") if (name, shape) != ("growth", "THICK")]
    return [
        pytest.param(name, shape, marks=() if name in quick and shape == "RIBBONS" else pytest.mark.slow)
        for name, shape in cases
    ]


@pytest.mark.parametrize(("name", "shape"), choose_cases("nodes", "fur"))
def test_hair_in_motion_agrees(name, shape):
    scene = make_scene(shape, name, count=10, width=0.15)
    request = Request(*(*SIZE, SAMPLES, 4, BATCHES), cycles_factor=CYCLES_FACTOR, integrator="PATH")
    ours, cycles = (side.passes["Combined"] for side in render_both(scene, bpy.context.view_layer, request))
    assert ours[..., :3].max() > 0
    assert metrics.share_failing_pixels(ours, cycles, SAMPLES * CYCLES_FACTOR) <= ROUND_BAR
    assert metrics.measure_tiles(ours, cycles, size=8).bias <= BIAS_BAR


@pytest.mark.parametrize(
    "name", ["a move", *(pytest.param(name, marks=pytest.mark.slow) for name in ("nodes", "velocities"))]
)
@pytest.mark.parametrize("shape", ["RIBBONS", pytest.param("THICK", marks=pytest.mark.slow)])
def test_vectors_of_hair_agree_but_at_edges(name, shape):
    """There Cycles has the mean of two surfaces. It takes the center line's distance, ours is the surface's; and it has
    points go as they would on straight lines from key to key, which splines are not at the ends of a strand."""
    width, distance = 0.25, 5.0
    scene = make_scene(shape, name, count=3, width=width)
    strands = next(thing for thing in scene.objects if thing.type == "CURVES")
    points = np.zeros((3, KEYS, 3), dtype=np.float32)
    points[..., 0], points[..., 2] = [[-1.2], [0.0], [1.2]], np.linspace(0, 1.5, KEYS)
    strands.data.attributes["position"].data.foreach_set("vector", points.ravel())
    strands.pass_index, scene.render.use_motion_blur = 1, False
    scene.frame_set(FRAME)
    request = Request(96, 72, 4, 0, cycles_factor=64, passes=("Combined", "Vector", "Object Index", "Position"))
    ours, cycles = (side.passes for side in render_both(scene, bpy.context.view_layer, request))
    index, found, expected = ours["Object Index"][0, ..., 0], ours["Vector"][0], cycles["Vector"][0]
    inside = (np.lib.stride_tricks.sliding_window_view(index, (3, 3)) == 1).all(axis=(2, 3))
    inside &= lies_between(strands, ours["Position"][0])[1:-1, 1:-1]
    off, size = (np.abs(part).max(axis=-1)[1:-1, 1:-1][inside] for part in (found - expected, expected))
    assert inside.sum() > 10
    assert size.max() > 2.0
    share = VECTOR_SHARE + (width / distance if shape == "THICK" else 0.0)
    assert (off <= VECTOR_TOLERANCE + share * size).all()


def lies_between(strands, position):
    """Return where places (h, w, 3) in the world are not along the first or last piece of upright strands."""
    shown = strands.evaluated_get(bpy.context.evaluated_depsgraph_get())
    heights = sorted(round(point.position.z, 5) for point in shown.data.points)
    to_object = np.array(shown.matrix_world.inverted())
    height = position @ to_object[2, :3] + to_object[2, 3]
    count = len(heights) // KEYS
    return (height > heights[count]) & (height < heights[-1 - count])
