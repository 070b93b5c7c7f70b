"""Shadow catchers against Cycles of the same Blender: color and alpha, over a transparent and an opaque film."""

import bpy
import numpy as np
import pytest

from addon.compare.cycles import metrics
from addon.compare.cycles.rendering import Request, render_both
from blend_scenes import building

pytestmark = pytest.mark.usefixtures("registered_addon")

# As in `test_pictures`.
MITSUBA_BAR = 0.0025
SIZE = (32, 24)
SAMPLES = 16
CYCLES_FACTOR = 4
# Where noise is strong the shadow, no more than black and no less than nothing, is off by as much as there is noise:
# both take as many samples, and whole tiles, where nothing else is left, are not compared, but the picture's mean is.
MANY_SAMPLES = 64


def make_stage(ground="Diffuse", **inputs):
    """A ground that catches the shadow of a box and of a ball beside the picture, seen at an angle."""
    scene = building.start_scene(*SIZE)
    material = building.make_shader("Ground", ground, (0.8, 0.6, 0.4), **inputs)
    plane = building.link_object("Ground", building.make_plane("Ground", 4, 5), materials=[material])
    plane.is_shadow_catcher = True
    grey = building.make_shader("Grey", "Diffuse", (0.5, 0.6, 0.7))
    building.link_object(
        "Box", building.make_box("Box", 0.8, 0.8, 0.9), (0.2, 0.4, 0), rotation=(0, 0, 30), materials=[grey]
    )
    building.link_object("Ball", building.make_sphere("Ball", 0.5, 32), (-0.9, -0.4, 0.5), materials=[grey])
    building.add_camera((0, -6, 4), (0, 0, 0.4), 40)
    return scene


def add_lamp(kind="AREA", power=150.0, location=(1.6, -1.2, 2.5)):
    return building.add_light("Lamp", kind, power, location, (-0.2, 0.5, 0))


# Standard errors, known with ten degrees of freedom, that two means may be apart; and the share of a pixel's rim.
APART, LEAST = 4.0, 1e-3


def assert_means_agree(ours, cycles, case):
    """Compare the means over whole pictures, of batches (k, h, w, c) each."""
    means = [side.mean(axis=(1, 2), dtype=np.float64) for side in (ours, cycles)]
    error = np.sqrt(sum(batch.var(axis=0, ddof=1) / len(batch) for batch in means))
    difference = np.abs(means[0].mean(axis=0) - means[1].mean(axis=0))
    assert (difference <= APART * error + LEAST).all(), (case, means[0].mean(axis=0), means[1].mean(axis=0))


# Without a world an opaque film shows nothing of a shadow: over black it is black.
CLEAR = (True,)


def assert_pictures_agree(scene, max_bounces=0, noisy=False, films=(True, False), **options):
    samples, factor = (MANY_SAMPLES, 1) if noisy else (SAMPLES, CYCLES_FACTOR)
    for transparent in films:
        scene.render.film_transparent = transparent
        request = Request(*SIZE, samples, max_bounces, 12, cycles_factor=factor, **options)
        ours, cycles = (side.passes["Combined"] for side in render_both(scene, bpy.context.view_layer, request))
        assert ours.mean(axis=0).std() > 0
        assert metrics.share_failing_pixels(ours, cycles, samples * factor) <= MITSUBA_BAR, transparent
        if noisy:
            assert_means_agree(ours, cycles, transparent)
        else:
            assert metrics.share_failing_tiles(ours, cycles, samples * factor, size=8) == 0.0, transparent


@pytest.mark.parametrize(
    ("kind", "power"), [pytest.param("POINT", 150.0, marks=pytest.mark.slow), ("SUN", 3.0), ("AREA", 150.0)]
)
def test_the_shadow_of_a_lamp_agrees(kind, power):
    scene = make_stage()
    add_lamp(kind, power)
    assert_pictures_agree(scene, films=CLEAR)


def test_shadows_under_a_world_and_a_lamp_agree():
    scene = make_stage()
    building.set_world((0.4, 0.5, 0.7), 0.5)
    add_lamp()
    assert_pictures_agree(scene)


def test_interreflection_agrees():
    scene = make_stage()
    building.set_world((0.4, 0.5, 0.7), 0.5)
    add_lamp()
    assert_pictures_agree(scene, max_bounces=2, noisy=True, integrator="PATH")


@pytest.mark.slow
def test_a_catcher_in_a_mirror_agrees():
    scene = make_stage()
    add_lamp()
    mirror = building.make_shader("Mirror", "Glossy", (0.9, 0.9, 0.9), roughness=0.0)
    bpy.data.objects["Ball"].data.materials[0] = mirror
    assert_pictures_agree(scene, max_bounces=2)


def test_a_lamp_that_is_no_part_of_the_footage_agrees():
    scene = make_stage()
    building.set_world((0.4, 0.5, 0.7), 0.5)
    add_lamp().is_shadow_catcher = False
    assert_pictures_agree(scene)


def test_a_catcher_behind_a_pane_agrees():
    scene = make_stage()
    add_lamp()
    pane = building.make_shader("Pane", "Transparent", (0.7, 0.8, 0.3))
    building.link_object("Pane", building.make_plane("Pane", 1.5, 1.5), (-0.5, -1, 1), materials=[pane])
    assert_pictures_agree(scene, films=CLEAR)


def test_a_catcher_that_is_seen_through_agrees():
    """Cycles counts what passes it twice, in the alpha of its shadow and in the background behind it; so do we."""
    scene = make_stage()
    building.set_world((0.4, 0.5, 0.7), 0.5)
    add_lamp()
    ground = bpy.data.objects["Ground"]
    ground.data.materials[0] = building.make_principled("Thin", (0.8, 0.6, 0.4), alpha=0.8, roughness=1.0)
    below = building.make_shader("Below", "Emission", (0.2, 0.3, 0.8), strength=0.5)
    building.link_object("Below", building.make_plane("Below", 1, 5), (1.2, 0, -0.5), materials=[below])
    assert_pictures_agree(scene)


@pytest.mark.parametrize("catches", [pytest.param(True, marks=pytest.mark.slow), False])
def test_what_shines_as_a_catcher_or_not_agrees(catches):
    scene = make_stage()
    building.set_world((0.4, 0.5, 0.7), 0.5)
    glow = building.make_shader("Glow", "Emission", (1.0, 0.7, 0.4), strength=4.0)
    ball = bpy.data.objects["Ball"]
    ball.data.materials[0] = glow
    ball.is_shadow_catcher = catches
    assert_pictures_agree(scene, noisy=True)


@pytest.mark.slow
def test_one_catcher_over_another_agrees():
    scene = make_stage()
    building.set_world((0.4, 0.5, 0.7), 0.5)
    add_lamp()
    bpy.data.objects["Box"].is_shadow_catcher = True
    assert_pictures_agree(scene)


def test_a_catcher_that_punches_a_hole_agrees():
    scene = make_stage()
    add_lamp()
    bpy.data.objects["Ground"].is_holdout = True
    assert_pictures_agree(scene)


@pytest.mark.slow
def test_interreflection_and_glass_over_a_catcher_agree():
    scene = make_stage()
    building.set_world((0.4, 0.5, 0.7), 0.5)
    add_lamp()
    glass = building.make_shader("Glass", "Glass", (0.9, 0.9, 0.9), roughness=0.2)
    bpy.data.objects["Ball"].data.materials[0] = glass
    assert_pictures_agree(scene, max_bounces=3, noisy=True, integrator="PATH")


def test_the_pass_of_catchers_and_those_beside_it_agree():
    """Where the pass is asked for, Combined leaves the shadows to it; other passes of light leave catchers out, and
    Environment has what is behind them."""
    scene = make_stage()
    building.set_world((0.4, 0.5, 0.7), 0.5)
    add_lamp()
    layer = bpy.context.view_layer
    layer.lightgroups.add(name="lamps")
    for thing in scene.objects:
        thing.lightgroup = "lamps"
    names = ("Combined", "Shadow Catcher", "Diffuse Direct", "Diffuse Indirect", "Diffuse Color", "Combined_lamps")
    names += ("Environment",)
    for transparent in (True, False):
        scene.render.film_transparent = transparent
        request = Request(*SIZE, 32, 2, 6, passes=names, integrator="PATH")
        ours, cycles = (side.passes for side in render_both(scene, layer, request))
        for name in names:
            assert_means_agree(ours[name], cycles[name], name)
