"""A leaf before lamps, the world and what shines, in our engine and in Cycles of the same Blender; light that comes
through is a bounce of transmission, which the direct integrator follows."""

import bpy
import numpy as np
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


COLOR, STRENGTH = 0.8, 5.0
# Standard errors by which a mean of batches may be off.
MOST_ERRORS = 5.0


def sum_square(places=400):
    """Return the light that a leaf sends up from under its middle, a metre above a square of 1 m x 1 m that shines, and
    the part of it that is left to reflected rays if light sampling chooses points by area (power heuristic)."""
    middle = (np.arange(places) + 0.5) / places - 0.5
    squared = middle[:, np.newaxis] ** 2 + middle**2 + 1.0
    cosine = squared**-0.5
    light = COLOR / np.pi * STRENGTH * cosine**2 / squared / places**2
    reflected, sampled = cosine / np.pi, squared / cosine
    return light.sum(), (light * reflected**2 / (reflected**2 + sampled**2)).sum()


@pytest.mark.parametrize("sampling", ["NONE", "AUTO"])
def test_what_diffuse_rays_do_not_see_shines_through_a_leaf_by_what_light_sampling_leaves(sampling):
    """A leaf is diffuse to light sampling, which then leaves out what diffuse rays do not see (surface_shader.h,
    _surface_shader_exclude), and its rays are transmitted ones, which see it (path_state_ray_visibility) and count it
    with the weight that is left to them. So what is seen depends on how lights are sampled: Cycles chooses points by
    area or by solid angle and by its tree; without light sampling it shows all."""
    scene = building.start_scene(8, 8)
    leaf = building.make_shader("Leaf", "Translucent", (COLOR,) * 3)
    building.link_object("Leaf", building.make_plane("Leaf", 4, 4), materials=[leaf])
    shining = building.make_shader("Shining", "Emission", (1, 1, 1), strength=STRENGTH)
    shining.cycles.emission_sampling = sampling
    square = building.link_object("Square", building.make_plane("Square", 1, 1), (0, 0, -1), materials=[shining])
    square.visible_diffuse = False
    building.add_camera((0, 0, 2), (0, 0, 0), 5000)
    request = Request(8, 8, 64, 0, 8, cycles_factor=4)
    sides = [side.passes["Combined"][..., 0] for side in render_both(scene, bpy.context.view_layer, request)]
    ours, cycles = (side.mean() for side in sides)
    error_of_ours, error_of_cycles = (side.std(ddof=1) / side.size**0.5 for side in sides)
    full, left = sum_square()
    assert abs(ours - left) < MOST_ERRORS * error_of_ours
    if sampling == "NONE":
        assert abs(cycles - full) < MOST_ERRORS * error_of_cycles
    else:
        assert 0.0 < cycles < full / 2
