"""A leaf before lamps, the world and what shines, in our engine and in Cycles of the same Blender; light that comes
through is a bounce of transmission, which the direct integrator follows."""

import bpy
import pytest

from addon.compare.cycles import metrics
from addon.compare.cycles.rendering import Request, render_both
from blend_scenes import building

pytestmark = pytest.mark.usefixtures("registered_addon")

SIZE = (24, 16)
MITSUBA_BAR = 0.0025
SAMPLES, BATCHES, CYCLES_FACTOR = 32, 4, 4


def make_stage(light):
    scene = building.start_scene(*SIZE)
    building.set_world((0.5, 0.6, 0.7) if light == "world" else (0.0, 0.0, 0.0), 1.0)
    leaf, paint = (
        building.make_shader("Leaf", "Translucent", (0.8, 0.7, 0.5)),
        building.make_shader("Paint", "Diffuse", (0.8, 0.8, 0.8)),
    )
    building.link_object("Leaf", building.make_plane("Leaf", 2, 2), (0, 0, 1), rotation=(60, 0, 0), materials=[leaf])
    building.link_object("Floor", building.make_plane("Floor", 6, 6), (0, 0, -0.3), materials=[paint])
    if light == "lamp":
        building.add_light("Lamp", "AREA", 200.0, (0, 3, 2.5), (0, 0, 1))
    if light == "square":
        shining = building.make_shader("Shining", "Emission", (5, 5, 5))
        square = building.make_plane("Square", 1, 1)
        building.link_object("Square", square, (0, 1.5, 2), rotation=(120, 0, 0), materials=[shining])
    building.add_camera((0, -6, 2), (0, 0, 0.7), 40)
    return scene


@pytest.mark.parametrize("bounces", [0, 2])
@pytest.mark.parametrize("light", ["lamp", "world", "square"])
def test_a_leaf_agrees(light, bounces):
    scene = make_stage(light)
    request = Request(*SIZE, SAMPLES, bounces, BATCHES, cycles_factor=CYCLES_FACTOR)
    ours, cycles = (side.passes["Combined"] for side in render_both(scene, bpy.context.view_layer, request))
    assert ours[..., :3].max() > 0
    assert metrics.share_failing_pixels(ours, cycles, SAMPLES * CYCLES_FACTOR) <= MITSUBA_BAR
    assert metrics.share_failing_tiles(ours, cycles, SAMPLES * CYCLES_FACTOR, size=8) == 0.0
