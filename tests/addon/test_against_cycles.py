"""Pictures and passes against Cycles of the same Blender, with matched settings.

Passes at pixel centres: Depth, Position and the indices have to agree in every pixel of every scene, Normal wherever
Cycles shows the interpolated normal (it bends those at which a specular closure would reflect into the surface).
Pictures: every scene, and one small scene for each kind of lamp and of closure, have to pass the statistical test of
`addon.compare.metrics` with Mitsuba 3's bar.
"""

import math
from pathlib import Path

import bpy
import numpy as np
import pytest

import addon
import raytracer
from addon.compare import metrics
from addon.compare.rendering import Request, render_both
from addon.compare.with_cycles import compare_passes, compare_with_cycles
from addon.extract import extract_scene
from blend_scenes import building
from raytracer.accelerate.geometry import world_corners
from raytracer.camera import primary_rays

SCENES = sorted((Path(__file__).parents[2] / "blend_scenes").glob("*.blend"))
# The largest scenes: their pictures, and more bounces, are compared in the slow tier.
LARGE = ("forest", "still_life", "terrain")
# Mitsuba 3's render tests let so many pixels fail.
MITSUBA_BAR = 0.0025
PASS_SIZE = (64, 36)
PICTURE_SIZE = (48, 27)
SMALL_SIZE = (32, 24)
# With 16 samples the mean of Cycles over any number of seeds is off by some 0.03% (a disk-shaped lamp over a plane,
# against quadrature), with 64 by less than 0.005%; tiles show the former.
CYCLES_FACTOR = 8


@pytest.fixture(autouse=True, scope="module")
def _registered():
    addon.register()
    yield
    addon.unregister()


def mark_large(paths):
    return [pytest.param(path, id=path.stem, marks=pytest.mark.slow if path.stem in LARGE else ()) for path in paths]


def open_scene(path):
    bpy.ops.wm.open_mainfile(filepath=str(path), load_ui=False)
    return bpy.context.scene, bpy.context.view_layer


def cast_through_centre(width, height, row, column):
    """Return the view direction (from the surface) and the flat normal, towards the viewer, at pixels' centres."""
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = width, height
    extracted = extract_scene(bpy.context.evaluated_depsgraph_get()).scene
    caster = raytracer.build(extracted)
    rays = primary_rays(extracted.camera, width, height, column + 0.5, height - row - 0.5)
    hits = caster.closest_hit(rays.origins, rays.directions, rays.t_min, rays.t_max)
    a, b, c = world_corners(caster.geometry, hits.instance, hits.primitive)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    view = -rays.directions / np.linalg.norm(rays.directions, axis=1, keepdims=True)
    return view, normal * np.sign((normal * view).sum(axis=1, keepdims=True))


def find_unexplained_normals(differing, ours, cycles):
    """Return the pixels where Cycles' Normal is not ours for another reason than the two that are known.

    Cycles bends the normal N of specular closures so that the view I, reflected, stays above the flat surface Ng by
    min(0.9 Ng.I, 0.01) (Cycles, `maybe_ensure_valid_specular_reflection`); and a triangle of less than a hundredth of
    a pixel at the very centre can be flat and missed by all samples of ours.
    """
    row, column = np.nonzero(differing)
    view, flat = cast_through_centre(*differing.shape[::-1], row, column)
    normal, shown = ours[row, column].astype(np.float64), cycles[row, column].astype(np.float64)
    reflected = 2 * (normal * view).sum(axis=1, keepdims=True) * normal - view
    lowest = np.minimum(0.9 * (flat * view).sum(axis=1), 0.01)
    bent = (flat * reflected).sum(axis=1) < lowest
    tiny = np.abs(np.abs((flat * shown).sum(axis=1)) - 1) <= metrics.float32_slack(metrics.FLOAT32_OPERATIONS)
    return [(int(y), int(x)) for y, x, known in zip(row, column, bent | tiny, strict=True) if not known]


def test_there_are_scenes_to_compare():
    assert SCENES, "no .blend in blend_scenes/: make them with python -m blend_scenes.make_all"


@pytest.mark.parametrize("path", mark_large(SCENES))
def test_passes_at_pixel_centres_agree(path, record_property):
    passes = compare_passes(*open_scene(path), *PASS_SIZE)
    record_property("largest_elsewhere", {name: item.largest_elsewhere for name, item in passes.items()})
    record_property("share", {name: item.share for name, item in passes.items()})
    for name in ("Depth", "Position", "Object Index", "Material Index"):
        assert passes[name].share == 0.0, name
    normal = passes["Normal"]
    assert find_unexplained_normals(normal.differing, normal.ours, normal.cycles) == []


# Pixels that differ for a known reason, by scene: Cycles shadows a surface with another one that lies exactly in it.
COPLANAR = {
    "lights": "the partitions' tops lie in the top board's: half of Cycles' shadow rays hit the other of the two"
}


@pytest.mark.parametrize("path", mark_large(SCENES))
def test_pictures_of_the_scenes_agree(path, record_property):
    comparison = compare_with_cycles(*open_scene(path), *PICTURE_SIZE, samples=64)
    numbers = comparison.summarise()
    record_property("numbers", numbers)
    assert numbers["z_fail_share"] <= MITSUBA_BAR


def make_stage():
    """A grey diffuse plane, seen by a camera from above at an angle; everything else is dark."""
    scene = building.start_scene(*SMALL_SIZE)
    building.link_object("Plane", building.make_plane("Plane", 8, 8), materials=[make_grey()])
    building.add_camera((0, -6, 4), (0, 0, 0.4), 40)
    return scene


def make_grey():
    return building.make_shader("Grey", "Diffuse", (0.8, 0.6, 0.4))


def assert_pictures_agree(scene, samples, max_bounces=0, batches=12, cycles_factor=CYCLES_FACTOR):
    """Colour and alpha: pixels by Mitsuba 3's bar; whole tiles, where noise averages out, all of them."""
    request = Request(*SMALL_SIZE, samples, max_bounces, batches, cycles_factor=cycles_factor)
    ours, cycles = (side.passes["Combined"] for side in render_both(scene, bpy.context.view_layer, request))
    assert ours[..., :3].max() > 0
    summed = samples * cycles_factor
    assert metrics.share_failing_pixels(ours, cycles, summed) <= MITSUBA_BAR
    assert metrics.share_failing_tiles(ours, cycles, summed, size=8) == 0.0


LAMPS = {
    "point": ("POINT", {"shadow_soft_size": 0.0}),
    "point with size": ("POINT", {"shadow_soft_size": 0.6}),
    "ball": ("POINT", {"shadow_soft_size": 0.6, "use_soft_falloff": False}),
    "spot": ("SPOT", {"shadow_soft_size": 0.0, "spot_size": 0.7, "spot_blend": 0.4}),
    "spot with size": ("SPOT", {"shadow_soft_size": 0.4, "spot_size": 0.9, "spot_blend": 0.2}),
    "sharp spot": ("SPOT", {"shadow_soft_size": 0.3, "spot_size": 0.8, "spot_blend": 0.0, "use_soft_falloff": False}),
    "sun": ("SUN", {"angle": 0.0}),
    "wide sun": ("SUN", {"angle": 0.5}),
    "square": ("AREA", {"shape": "SQUARE", "size": 1.5}),
    "rectangle": ("AREA", {"shape": "RECTANGLE", "size": 2.0, "size_y": 0.5}),
    "disk": ("AREA", {"shape": "DISK", "size": 1.5}),
    "ellipse": ("AREA", {"shape": "ELLIPSE", "size": 2.0, "size_y": 0.7}),
    "spread": ("AREA", {"shape": "SQUARE", "size": 1.0, "spread": 1.2}),
    "disk with spread": ("AREA", {"shape": "DISK", "size": 1.0, "spread": 1.2}),
}


def add_lamp(kind, settings, location=(0.6, -0.8, 2.5), target=(-0.2, 0.5, 0), power=None):
    lamp = building.add_light("Lamp", kind, power or (3.0 if kind == "SUN" else 200.0), location, target)
    for name, value in settings.items():
        setattr(lamp.data, name, value)
    lamp.data.color = (1.0, 0.7, 0.4)
    return lamp


@pytest.mark.parametrize("name", LAMPS)
def test_one_lamp_over_a_plane_agrees(name):
    scene = make_stage()
    add_lamp(*LAMPS[name])
    assert_pictures_agree(scene, samples=16)


@pytest.mark.parametrize("name", ["point with size", "ball", "spot with size", "wide sun", "rectangle", "spread"])
def test_the_soft_shadow_of_one_lamp_agrees(name):
    scene = make_stage()
    add_lamp(*LAMPS[name])
    box = building.make_box("Box", 0.8, 0.8, 0.9)
    building.link_object("Box", box, (0.2, 0.4, 0), rotation=(0, 0, 30), materials=[make_grey()])
    assert_pictures_agree(scene, samples=16)


@pytest.mark.parametrize("name", ["spot", "square", "ellipse", "point with size"])
def test_a_scaled_and_mirrored_lamp_agrees(name):
    scene = make_stage()
    add_lamp(*LAMPS[name]).scale = (1.6, -0.7, 1.2)
    assert_pictures_agree(scene, samples=16)


def test_a_shining_mesh_agrees():
    scene = make_stage()
    lamp = building.make_shader("Lamp", "Emission", (1.0, 0.7, 0.4), strength=8.0)
    building.link_object("Ball", building.make_sphere("Ball", 0.5, 16), (0, 0.5, 1.2), materials=[lamp])
    assert_pictures_agree(scene, samples=16)


def test_the_world_agrees():
    scene = make_stage()
    building.set_world((0.4, 0.5, 0.7), 1.5)
    building.link_object("Ball", building.make_sphere("Ball", 0.8, 32), (0, 0.5, 0.7), materials=[make_grey()])
    assert_pictures_agree(scene, samples=16)


def test_transparent_film_agrees():
    """The horizon runs close to pixels' centres: Cycles' first sample, if not left out, would show."""
    scene = make_stage()
    scene.render.film_transparent = True
    building.set_world((0.4, 0.5, 0.7), 1.5)
    bpy.context.scene.camera.location.z = 1.0
    building.aim(bpy.context.scene.camera, (0, 0, 1.0))
    assert_pictures_agree(scene, samples=16, cycles_factor=1)


WARM = (0.9, 0.6, 0.3)
CLOSURES = {
    "diffuse": lambda: building.make_shader("M", "Diffuse", WARM),
    "mirror": lambda: building.make_shader("M", "Glossy", WARM, roughness=0.0),
    "glossy": lambda: building.make_shader("M", "Glossy", WARM, roughness=0.4),
    "rough glossy": lambda: building.make_shader("M", "Glossy", WARM, roughness=0.9),
    "glass": lambda: building.make_shader("M", "Glass", WARM, roughness=0.0, ior=1.45),
    "rough glass": lambda: building.make_shader("M", "Glass", WARM, roughness=0.4, ior=1.45),
    "refraction": lambda: building.make_shader("M", "Refraction", WARM, roughness=0.0, ior=1.3),
    "rough refraction": lambda: building.make_shader("M", "Refraction", WARM, roughness=0.4, ior=1.3),
    "transparent": lambda: building.make_shader("M", "Transparent", WARM),
    "emission": lambda: building.make_shader("M", "Emission", WARM, strength=0.7),
    "principled": lambda: building.make_principled("M", WARM),
    "principled smooth": lambda: building.make_principled("M", WARM, roughness=0.0),
    "principled without specular": lambda: make_dull(),
    "principled dielectric": lambda: building.make_principled("M", WARM, roughness=0.3, ior=2.0),
    "metal": lambda: building.make_principled("M", WARM, metallic=1.0, roughness=0.0),
    "rough metal": lambda: building.make_principled("M", WARM, metallic=1.0, roughness=0.5),
    "half metal": lambda: building.make_principled("M", WARM, metallic=0.5, roughness=0.4),
    "transmission": lambda: building.make_principled("M", WARM, transmission_weight=1.0, roughness=0.0, ior=1.4),
    "rough transmission": lambda: building.make_principled("M", WARM, transmission_weight=1.0, roughness=0.3),
    "half transmission": lambda: building.make_principled("M", WARM, transmission_weight=0.5, roughness=0.3),
    "alpha": lambda: building.make_principled("M", WARM, alpha=0.4),
    "principled emission": lambda: building.make_principled("M", WARM, emission_strength=0.5),
}


def make_dull():
    material = building.make_principled("M", WARM)
    building.set_inputs(material.node_tree.nodes["Principled BSDF"], {"Specular IOR Level": 0.0})
    return material


def make_showcase(name):
    """A smooth ball of the material over the plane, lit by an area lamp, a lamp without extent, and a dim world."""
    scene = make_stage()
    add_lamp("AREA", {"shape": "SQUARE", "size": 1.5}, location=(-1.5, -2.5, 3.0))
    add_lamp("POINT", {"shadow_soft_size": 0.0}, location=(2.5, -1.5, 2.0), power=80.0)
    building.set_world((0.2, 0.25, 0.3), 1.0)
    ball = building.make_sphere("Ball", 1.2, 64)
    building.link_object("Ball", ball, (0, 0.2, 1.2), materials=[CLOSURES[name]()])
    return scene


@pytest.mark.parametrize("name", CLOSURES)
def test_a_ball_of_one_closure_without_bounces_agrees(name):
    assert_pictures_agree(make_showcase(name), samples=16)


# Not those that are diffuse as well: where Cycles has sampled a direction for the specular part, it carries the diffuse
# part's share of that direction on, whatever its limit of diffuse bounces says.
SPECULAR = (
    "mirror",
    "glossy",
    "glass",
    "rough glass",
    "refraction",
    "metal",
    "rough metal",
    "transmission",
    "transparent",
)


@pytest.mark.parametrize("name", SPECULAR)
@pytest.mark.parametrize("bounces", [1, pytest.param(4, marks=pytest.mark.slow)])
def test_a_ball_of_one_closure_with_bounces_agrees(name, bounces):
    assert_pictures_agree(make_showcase(name), samples=16, max_bounces=bounces)


def test_a_wrong_lamp_is_found():
    """The test has teeth: a lamp of one percent more power fails it."""
    scene = make_stage()
    lamp = add_lamp(*LAMPS["square"])
    request = Request(*SMALL_SIZE, 16, 0, 12, cycles_factor=CYCLES_FACTOR)
    ours, cycles = render_both(scene, bpy.context.view_layer, request)
    lamp.data.energy *= 1.01
    brighter, _ = render_both(scene, bpy.context.view_layer, request)
    failing = [
        metrics.share_failing_tiles(side.passes["Combined"], cycles.passes["Combined"], 16 * CYCLES_FACTOR, size=8)
        for side in (ours, brighter)
    ]
    assert failing[0] == 0.0
    assert failing[1] > 0.5


def test_settings_are_put_back():
    scene = make_stage()
    add_lamp(*LAMPS["sun"])
    view_layer = bpy.context.view_layer
    scene.render.resolution_percentage, scene.cycles.seed, scene.reference_raytracer.samples = 37, 5, 3
    scene.render.image_settings.file_format = "PNG"
    view_layer.use_pass_z = True

    def read():
        cycles = {name: getattr(scene.cycles, name) for name in ("samples", "seed", "max_bounces", "use_denoising")}
        render = {name: getattr(scene.render, name) for name in ("engine", "filepath", "resolution_x", "threads_mode")}
        image = (scene.render.image_settings.file_format, scene.render.resolution_percentage)
        ours = (scene.reference_raytracer.samples, scene.reference_raytracer.pixel_filter)
        return cycles, render, image, ours, view_layer.use_pass_z, view_layer.use_pass_normal

    before = read()
    render_both(scene, view_layer, Request(8, 6, 1, 0, passes=("Combined", "Normal")))
    assert read() == before
    assert math.isclose(scene.render.dither_intensity, 1.0)
