"""Shadow caustics against Cycles of the same Blender: lamps through a ball of clear glass, on the floor below.

What Cycles finds, and what it leaves out, is found and left out here too: pictures have to pass the statistical test of
`addon.compare.cycles.metrics`, pixel by pixel by Mitsuba 3's bar, and all whole tiles. Light is limited as in Cycles,
where the test is not about that. One case is quick; all others are marked slow.
"""

from dataclasses import replace

import bpy
import pytest

from addon.compare.cycles import metrics
from addon.compare.cycles.rendering import Request, render_both
from blend_scenes import building
from raytracer.caustics import chains

pytestmark = pytest.mark.usefixtures("registered_addon")

SIZE = (32, 24)
# Mitsuba 3's render tests let so many pixels fail.
MITSUBA_BAR = 0.0025
SAMPLES, BATCHES, CYCLES_FACTOR = 16, 6, 4
# Where no light is focused on one point, the pictures' means are that close.
CLOSE = 0.02
OTHER_SEED = 100


def make_scene(kind="POINT", **settings):
    """A ball of glass over a floor, and a lamp that is bent by it; the camera sees both."""
    scene = building.start_scene(*SIZE)
    paper = building.make_shader("Paper", "Diffuse", (0.8, 0.8, 0.8))
    floor = building.link_object("Floor", building.make_plane("Floor", 8, 8), materials=[paper])
    floor.cycles.is_caustics_receiver = True
    add_ball(
        "Ball", 0.5, (0, 0, 0.8), building.make_shader("Glass", "Glass", (1.0, 0.95, 0.9), roughness=0.0, ior=1.45)
    )
    target = (0.0, 0.0, 0.8) if kind in ("SUN", "SPOT") else (0.8, 0.6, 0.0)
    lamp = building.add_light("Lamp", kind, 3.0 if kind == "SUN" else 200.0, (0.8, 0.6, 3.5), target, **settings)
    lamp.data.cycles.is_caustics_light = True
    building.add_camera((0, -4.0, 2.5), (0, 0, 0.3), 35)
    return scene


def add_ball(name, radius, place, material):
    ball = building.link_object(name, building.make_sphere(name, radius, 32), place, materials=[material])
    ball.cycles.is_caustics_caster = True
    return ball


def assert_agree(scene, max_bounces=8, **limits):
    request = Request(
        *(*SIZE, SAMPLES, max_bounces, BATCHES), cycles_factor=CYCLES_FACTOR, integrator="PATH", limits=limits
    )
    ours, cycles = render_pair(scene, request)
    summed = SAMPLES * CYCLES_FACTOR
    assert metrics.share_failing_pixels(ours, cycles, summed) <= MITSUBA_BAR
    if metrics.share_failing_tiles(ours, cycles, summed, size=8) > 0.0:
        # One of hundreds of tiles fails by chance now and then; a difference fails with other numbers, too.
        others = render_pair(scene, replace(request, seed=OTHER_SEED))
        assert metrics.share_failing_tiles(*others, summed, size=8) == 0.0
    assert abs(ours[..., :3].mean() / cycles[..., :3].mean() - 1.0) < CLOSE
    return ours[..., :3].mean()


def render_pair(scene, request):
    return tuple(side.passes["Combined"] for side in render_both(scene, bpy.context.view_layer, request))


@pytest.fixture(autouse=True)
def _limit_as_cycles(monkeypatch):
    monkeypatch.setattr(chains, "MOST_FOCUS", 0.0)


LAMPS = {
    "point": ("POINT", {"shadow_soft_size": 0.0}),
    "disk": ("POINT", {"shadow_soft_size": 0.2}),
    "ball": ("POINT", {"shadow_soft_size": 0.2, "use_soft_falloff": False}),
    "spot": ("SPOT", {"shadow_soft_size": 0.0, "spot_size": 1.2}),
    "area": ("AREA", {"size": 0.6}),
    "sun": ("SUN", {"angle": 0.0}),
    "wide sun": ("SUN", {"angle": 0.1}),
}


def list_cases(names, quick):
    """Return parameters of which all but some are slow."""
    return [name if name in quick else pytest.param(name, marks=pytest.mark.slow) for name in names]


@pytest.mark.parametrize("name", list_cases(LAMPS, ["sun"]))
def test_a_lamp_through_a_ball_agrees(name):
    kind, settings = LAMPS[name]
    scene = make_scene(kind, **settings)
    with_caustics = assert_agree(scene)
    bpy.data.objects["Lamp"].data.cycles.is_caustics_light = False
    if name == "sun":
        assert assert_agree(scene) < with_caustics


@pytest.mark.slow
def test_principled_glass_agrees():
    scene = make_scene(shadow_soft_size=0.0)
    glass = building.make_principled("P", (0.9, 0.6, 0.3), roughness=0.0, ior=1.3, transmission_weight=1.0)
    bpy.data.objects["Ball"].data.materials[0] = glass
    assert_agree(scene)


@pytest.mark.slow
def test_two_balls_in_a_row_agree():
    scene = make_scene(shadow_soft_size=0.0)
    add_ball("Other", 0.3, (0.2, 0.15, 1.7), bpy.data.materials["Glass"])
    assert_agree(scene)


@pytest.mark.slow
def test_a_ball_that_is_turned_and_squeezed_agrees():
    """Cycles loses the light through mirrored objects; ours is that of those that are not."""
    scene = make_scene(shadow_soft_size=0.0)
    ball = bpy.data.objects["Ball"]
    ball.scale, ball.rotation_euler = (1.2, 0.8, 0.6), (0.3, 0.2, 0.5)
    assert_agree(scene)


LIMITS = {
    "no diffuse bounce": {"diffuse_bounces": 0},
    "no transmission": {"transmission_bounces": 0},
    "one transmission": {"transmission_bounces": 1},
    "one bounce": {"max_bounces": 1},
    "two bounces": {"max_bounces": 2},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", LIMITS)
def test_a_limit_of_bounces_agrees(name):
    assert_agree(make_scene("SUN", angle=0.0), **LIMITS[name])


@pytest.mark.slow
def test_a_glossy_receiver_agrees():
    scene = make_scene("AREA", size=0.6)
    shiny = building.make_principled("Shiny", (0.6, 0.6, 0.6), roughness=0.4)
    bpy.data.objects["Floor"].data.materials[0] = shiny
    assert_agree(scene)


@pytest.mark.slow
def test_walls_that_receive_nothing_agree():
    """Light that paths bring to the ball by a wall of no concern is not left out."""
    scene = make_scene(shadow_soft_size=0.3)
    wall = building.make_shader("Wall", "Diffuse", (0.9, 0.9, 0.9))
    place = {"location": (0, 1.2, 1), "rotation": (90, 0, 0)}
    building.link_object("Wall", building.make_plane("Wall", 4, 2), materials=[wall], **place)
    assert_agree(scene)
