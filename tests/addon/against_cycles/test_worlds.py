"""Worlds that vary, and cameras with a lens, against Cycles: pixels by Mitsuba 3's bar, and every tile."""

import bpy
import numpy as np
import pytest

from addon.compare.cycles import metrics
from addon.compare.cycles.rendering import Request, render_both
from addon.extract.shaders.skies import SKY_TYPES
from addon.versions import VERSION, find_node_tree
from blend_scenes import building
from tests.addon.against_cycles.tiles import assert_tiles_agree

pytestmark = pytest.mark.usefixtures("registered_addon")

SIZE = (32, 24)
MITSUBA_BAR = 0.0025
# Cycles takes so many times our samples.
CYCLES_FACTOR = 4
SAMPLES, BATCHES = 16, 8
TURN = (0.3, 0.2, 1.0)
WIDTH, HEIGHT = 64, 32


def assert_pictures_agree(scene, max_bounces=1, samples=SAMPLES):
    request = Request(*SIZE, samples, max_bounces, BATCHES, cycles_factor=CYCLES_FACTOR)
    ours, cycles = (side.passes["Combined"] for side in render_both(scene, bpy.context.view_layer, request))
    assert ours[..., :3].std() > 0
    summed = samples * CYCLES_FACTOR
    assert metrics.share_failing_pixels(ours, cycles, summed) <= MITSUBA_BAR
    assert_tiles_agree(scene, request, ours, cycles)


# Worlds


def make_stage():
    """A grey plane with a grey and a glossy ball, and sky behind them."""
    scene = building.start_scene(*SIZE)
    grey = building.make_shader("Grey", "Diffuse", (0.8, 0.6, 0.4))
    building.link_object("Plane", building.make_plane("Plane", 8, 8), materials=[grey])
    building.link_object("Ball", building.make_sphere("Ball", 0.8, 32), (0, 0.5, 0.7), materials=[grey])
    glossy = building.make_shader("Glossy", "Glossy", (0.9, 0.9, 0.9), roughness=0.3)
    building.link_object("Glossy", building.make_sphere("Glossy", 0.5, 32), (1.4, -0.5, 0.5), materials=[glossy])
    building.add_camera((0, -6, 2), (0, 0, 1.2), 40)
    return scene


def make_picture(sun):
    """A smooth picture of all directions, of which one pixel has the radiance `sun`."""
    image = bpy.data.images.new("Sky", WIDTH, HEIGHT, float_buffer=True)
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    pixels = np.ones((HEIGHT, WIDTH, 4), np.float32)
    pixels[..., 0] = 0.3 + 0.3 * np.sin(2 * np.pi * x / WIDTH)
    pixels[..., 1] = 0.2 + 0.5 * y / HEIGHT
    pixels[..., 2] = 0.4
    pixels[24, 20, :3] = sun
    image.pixels.foreach_set(pixels.ravel())
    return image


def add_picture(tree, sun=200.0, **settings):
    node = tree.nodes.new("ShaderNodeTexEnvironment")
    node.image = make_picture(sun)
    for name, value in settings.items():
        setattr(node, name, value)
    return node


def add_background(tree, color):
    background = tree.nodes.new("ShaderNodeBackground")
    tree.links.new(color, background.inputs["Color"])
    return background.outputs[0]


def show_picture(**settings):
    return lambda tree: add_background(tree, add_picture(tree, **settings).outputs[0])


def show_turned(tree):
    picture, coordinates = add_picture(tree), tree.nodes.new("ShaderNodeTexCoord")
    mapping = tree.nodes.new("ShaderNodeMapping")
    mapping.inputs["Rotation"].default_value = TURN
    tree.links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs[0], picture.inputs["Vector"])
    return add_background(tree, picture.outputs[0])


def show_to_camera(tree):
    """The camera sees blue; light comes from the picture."""
    mix, path = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new("ShaderNodeLightPath")
    blue = tree.nodes.new("ShaderNodeBackground")
    blue.inputs["Color"].default_value = (0.1, 0.2, 0.6, 1.0)
    tree.links.new(path.outputs["Is Camera Ray"], mix.inputs[0])
    tree.links.new(show_picture()(tree), mix.inputs[1])
    tree.links.new(blue.outputs[0], mix.inputs[2])
    return mix.outputs[0]


def add_shaders(tree):
    add = tree.nodes.new("ShaderNodeAddShader")
    tree.links.new(show_picture()(tree), add.inputs[0])
    tree.links.new(show_coordinate("Generated")(tree), add.inputs[1])
    return add.outputs[0]


def show_coordinate(name):
    def make(tree):
        coordinates, absolute = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeVectorMath")
        absolute.operation = "ABSOLUTE"
        tree.links.new(coordinates.outputs[name], absolute.inputs[0])
        return add_background(tree, absolute.outputs[0])

    return make


WORLDS = {
    "picture": show_picture(),
    "even picture": show_picture(sun=0.4),
    "closest": show_picture(interpolation="Closest"),
    "mirror ball": show_picture(projection="MIRROR_BALL"),
    "turned": show_turned,
    "other to the camera": show_to_camera,
    "sum": add_shaders,
    **{name: show_coordinate(name) for name in ("Generated", "Normal", "Object", "Camera", "Reflection")},
}


def set_world(make):
    world = bpy.data.worlds.new("World")
    if VERSION < (5, 0):
        world.use_nodes = True
    tree = find_node_tree(world)
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputWorld")
    tree.links.new(make(tree), output.inputs["Surface"])
    bpy.context.scene.world = world
    return world


@pytest.mark.parametrize("name", WORLDS)
def test_a_world_agrees(name):
    scene = make_stage()
    set_world(WORLDS[name])
    assert_pictures_agree(scene)


def test_a_world_hidden_from_the_camera_agrees():
    scene = make_stage()
    set_world(show_picture()).cycles_visibility.camera = False
    assert_pictures_agree(scene)


@pytest.mark.parametrize(("sampling", "lost"), [("AUTOMATIC", 0.015), ("NONE", -0.001)])
def test_a_world_s_limit_of_bounces_agrees(sampling, lost):
    """Without samples of its own Cycles' world has no limit; with them, a quarter of what that takes away is left open,
    for reflected rays still see the world in a share that depends on the map which samples follow."""
    scene = make_stage()
    wall = building.make_plane("Wall", 8, 3)
    building.link_object(
        "Wall",
        wall,
        (0, 1.5, 1.0),
        rotation=(90, 0, 0),
        materials=[building.make_shader("W", "Diffuse", (0.8, 0.8, 0.8))],
    )
    world = set_world(lambda tree: add_background(tree, add_picture(tree, sun=1.0).outputs["Color"]))
    world.cycles.sampling_method = sampling
    request = Request(*SIZE, SAMPLES, 4, 2, cycles_factor=CYCLES_FACTOR, integrator="PATH")
    whole, (ours, cycles) = 0.0, (0.0, 0.0)
    for limit in (1024, 0):
        world.cycles.max_bounces = limit
        sides = render_both(scene, bpy.context.view_layer, request)
        ours, cycles = (side.passes["Combined"][..., :3].mean() for side in sides)
        whole = whole or cycles
    assert cycles < whole * (1 - lost)
    assert abs(ours - cycles) < 0.25 * max(whole - cycles, 0.015 * whole)


def list_sky_types():
    """Skies that are clear, of this Blender."""
    return [kind for kind in SKY_TYPES if kind in bpy.types.ShaderNodeTexSky.bl_rna.properties["sky_type"].enum_items]


def test_a_clear_sky_agrees():
    """The sky of each version's own default, with a sun wide enough for pixels: background, balls and plane."""
    scene = make_stage()

    def show_sky(tree):
        sky = tree.nodes.new("ShaderNodeTexSky")
        sky.sun_size, sky.sun_elevation, sky.sun_rotation = 0.1, 0.6, 2.0
        background = add_background(tree, sky.outputs[0])
        tree.nodes[-1].inputs["Strength"].default_value = 0.1
        return background

    set_world(show_sky)
    assert_pictures_agree(scene)


@pytest.mark.parametrize("kind", list_sky_types())
def test_a_sunset_agrees(kind):
    """The horizon, what lies below it, and a sun that it cuts."""
    scene = building.start_scene(*SIZE)
    building.add_camera((0, 0, 0), (1, 0, 0.01), 20)

    def show_sky(tree):
        sky = tree.nodes.new("ShaderNodeTexSky")
        sky.sky_type, sky.altitude, sky.sun_intensity = kind, 2000.0, 0.01
        sky.sun_size, sky.sun_elevation, sky.sun_rotation = 0.3, 0.04, np.pi / 2
        return add_background(tree, sky.outputs[0])

    set_world(show_sky)
    assert_pictures_agree(scene, max_bounces=0)


# Lenses


def make_row(**settings):
    """Shining balls at several depths over a chequered floor, through a wide lens."""
    scene = building.start_scene(*SIZE)
    for number, (x, y) in enumerate([(-1.2, -2), (0, 0), (1.2, 2), (0.3, -1.2)]):
        color = (1.0, 0.2 + 0.2 * number, 0.3 * number)
        shine = building.make_shader(f"Shine {number}", "Emission", color, strength=1.0 + number)
        ball = building.make_sphere(f"Ball {number}", 0.3, 24)
        building.link_object(f"Ball {number}", ball, (x, y, 0.6), materials=[shine])
    floor = [building.make_shader(name, "Emission", (0.1 + shade,) * 3) for name, shade in (("Dark", 0), ("Pale", 0.4))]
    building.link_object("Floor", building.make_chequers("Floor", 12, 24), materials=floor)
    camera = building.add_camera((0, -6, 2), (0, 0, 0.6), 40).data
    camera.dof.use_dof = True
    for name, value in settings.items():
        setattr(camera if hasattr(camera, name) else camera.dof, name, value)
    return scene


LENSES = {
    "disk": {"aperture_fstop": 0.1, "focus_distance": 6.3},
    "blades": {"aperture_fstop": 0.05, "focus_distance": 6.0, "aperture_blades": 5, "aperture_rotation": 0.4},
    "ratio": {"aperture_fstop": 0.05, "focus_distance": 4.5, "aperture_blades": 3, "aperture_ratio": 2.0},
    "orthographic": {"type": "ORTHO", "ortho_scale": 4.0, "aperture_fstop": 2.0, "focus_distance": 6.0},
}


@pytest.mark.parametrize("name", LENSES)
def test_a_lens_agrees(name):
    assert_pictures_agree(make_row(**LENSES[name]), max_bounces=0)


def test_a_lens_focused_on_an_object_agrees():
    scene = make_row(aperture_fstop=0.1)
    scene.camera.data.dof.focus_object = bpy.data.objects["Ball 0"]
    assert_pictures_agree(scene, max_bounces=0)
