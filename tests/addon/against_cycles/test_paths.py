"""Interreflection against Cycles of the same Blender: every limit of bounces, ray visibility, what Light Path tells.

A small room with colored walls, of diffuse, glossy, and clear surfaces, under an area lamp, seen from its open side.
Both engines have the same limits. Pictures have to pass the statistical test of `addon.compare.cycles.metrics`, pixel
by pixel by Mitsuba 3's bar, and all whole tiles. One case of each kind is quick; all others are marked slow.
"""

import bpy
import pytest

from addon.compare.cycles import metrics
from addon.compare.cycles.rendering import Request, render_both
from blend_scenes import building
from tests.addon.against_cycles.tiles import assert_tiles_agree

pytestmark = pytest.mark.usefixtures("registered_addon")

SIZE = (32, 24)
# Mitsuba 3's render tests let so many pixels fail.
MITSUBA_BAR = 0.0025
SAMPLES, BATCHES = 16, 12
# Cycles' mean over any number of seeds is a little off with few samples (see test_against_cycles).
CYCLES_FACTOR = 4


def make_room():
    """Five walls of two metres, open towards the camera, a ball and a box in it."""
    scene = building.start_scene(*SIZE)
    for name, color, location, rotation in (
        ("Floor", (0.8, 0.8, 0.8), (0, 0, 0), (0, 0, 0)),
        ("Ceiling", (0.8, 0.8, 0.8), (0, 0, 2), (180, 0, 0)),
        ("Back", (0.7, 0.7, 0.7), (0, 1, 1), (90, 0, 0)),
        ("Left", (0.8, 0.2, 0.1), (-1, 0, 1), (0, 90, 0)),
        ("Right", (0.1, 0.7, 0.2), (1, 0, 1), (0, -90, 0)),
    ):
        wall = building.make_shader(name, "Diffuse", color)
        building.link_object(name, building.make_plane(name, 2, 2), location, rotation=rotation, materials=[wall])
    building.add_camera((0, -4.2, 1), (0, 0, 1), 35)
    lamp = building.add_light("Lamp", "AREA", 20.0, (0, 0, 1.9), (0, 0, 0))
    lamp.data.shape, lamp.data.size = "SQUARE", 0.6
    return scene


def add_ball(material, location=(-0.35, 0.2, 0.5), radius=0.45):
    return building.link_object("Ball", building.make_sphere("Ball", radius, 32), location, materials=[material])


def assert_agree(scene, max_bounces=8, taming=None, integrator="PATH", **limits):
    request = Request(
        *(*SIZE, SAMPLES, max_bounces, BATCHES),
        cycles_factor=CYCLES_FACTOR,
        integrator=integrator,
        limits=limits,
        taming=taming or {},
    )
    ours, cycles = render_pair(scene, request)
    assert ours[..., :3].max() > 0
    summed = SAMPLES * CYCLES_FACTOR
    assert metrics.share_failing_pixels(ours, cycles, summed) <= MITSUBA_BAR
    assert_tiles_agree(scene, request, ours, cycles)
    return ours.mean(axis=(0, 1, 2))


def render_pair(scene, request):
    return tuple(side.passes["Combined"] for side in render_both(scene, bpy.context.view_layer, request))


def list_cases(names, quick):
    """Return parameters of which all but some are slow."""
    return [name if name in quick else pytest.param(name, marks=pytest.mark.slow) for name in names]


MATERIALS = {
    "diffuse": lambda: building.make_shader("M", "Diffuse", (0.9, 0.6, 0.3)),
    "glossy": lambda: building.make_shader("M", "Glossy", (0.9, 0.6, 0.3), roughness=0.4),
    "mirror": lambda: building.make_shader("M", "Glossy", (0.9, 0.6, 0.3), roughness=0.0),
    "glass": lambda: building.make_shader("M", "Glass", (0.9, 0.9, 0.9), roughness=0.0, ior=1.45),
    "rough glass": lambda: building.make_shader("M", "Glass", (0.9, 0.9, 0.9), roughness=0.4, ior=1.45),
    "principled": lambda: building.make_principled("M", (0.9, 0.6, 0.3), roughness=0.3),
    "alpha": lambda: building.make_principled("M", (0.9, 0.6, 0.3), alpha=0.5),
}


@pytest.mark.parametrize("name", list_cases(MATERIALS, ["principled"]))
def test_a_ball_in_a_room_agrees(name):
    scene = make_room()
    add_ball(MATERIALS[name]())
    assert_agree(scene)


LIMITS = {
    "nothing": ({"max_bounces": 0}, "principled"),
    "one bounce": ({"max_bounces": 1}, "principled"),
    "no diffuse bounce": ({"diffuse_bounces": 0}, "principled"),
    "one diffuse bounce": ({"diffuse_bounces": 1}, "principled"),
    "no glossy bounce": ({"glossy_bounces": 0}, "principled"),
    "one glossy bounce": ({"glossy_bounces": 1}, "mirror"),
    "no transmission": ({"transmission_bounces": 0}, "glass"),
    "one transmission": ({"transmission_bounces": 1}, "glass"),
    "two transmissions": ({"transmission_bounces": 2}, "rough glass"),
    "no passage": ({"transparent_bounces": 0}, "alpha"),
    "one passage": ({"transparent_bounces": 1}, "alpha"),
    "two passages": ({"transparent_bounces": 2}, "alpha"),
    "three passages": ({"transparent_bounces": 3}, "alpha"),
}


@pytest.mark.parametrize("name", list_cases(LIMITS, ["one glossy bounce", "two passages"]))
def test_a_limit_of_bounces_agrees(name):
    limits, material = LIMITS[name]
    scene = make_room()
    if "transparent_bounces" in limits:
        # Where a path meets a lamp, Cycles counts one passage more, and ends the path at its limit (shade_light.h).
        lamp = bpy.data.objects["Lamp"]
        lamp.data.type = "POINT"
        lamp.data.shadow_soft_size = 0.0
    add_ball(MATERIALS[material]())
    assert_agree(scene, **limits)


KINDS = ["camera", "diffuse", "glossy", "transmission"]


@pytest.mark.parametrize("kind", list_cases([*KINDS, "shadow"], ["diffuse"]))
@pytest.mark.parametrize("material", list_cases(["principled", "rough glass"], ["principled"]))
def test_a_ball_hidden_from_some_rays_agrees(kind, material):
    scene = make_room()
    add_ball(MATERIALS[material]())
    mirror = add_ball(MATERIALS["mirror"](), (0.5, 0.1, 0.35), 0.3)
    setattr(scene.objects[mirror.name], f"visible_{kind}", False)
    setattr(bpy.data.objects["Ball"], f"visible_{kind}", False)
    assert_agree(scene)


@pytest.mark.parametrize("kind", list_cases(KINDS, ["transmission"]))
@pytest.mark.parametrize("material", list_cases(["principled", "rough glass"], ["rough glass"]))
def test_a_lamp_hidden_from_some_rays_agrees(kind, material):
    """It shows in the picture, and its light is missing where it is hidden."""
    scene = make_room()
    add_ball(MATERIALS[material]())
    lamp = bpy.data.objects["Lamp"]
    lamp.location, lamp.data.energy = (0.4, 0.5, 1.2), 5.0
    lamp.visible_camera = True
    setattr(lamp, f"visible_{kind}", False)
    building.aim(lamp, (-0.35, -0.6, 0.5))
    assert_agree(scene)


OUTPUTS = (
    *("Is Camera Ray", "Is Diffuse Ray", "Is Glossy Ray", "Is Singular Ray", "Is Reflection Ray"),
    *("Is Transmission Ray", "Ray Depth", "Diffuse Depth", "Glossy Depth", "Transmission Depth", "Transparent Depth"),
)


@pytest.mark.parametrize("output", list_cases(OUTPUTS, ["Is Glossy Ray"]))
def test_what_light_path_tells_agrees(output):
    """The walls' color is a fraction that grows with what the node says."""
    scene = make_room()
    add_ball(MATERIALS["rough glass"]())
    add_ball(MATERIALS["principled"](), (0.5, 0.1, 0.35), 0.3)
    for name in ("Floor", "Back"):
        tree = bpy.data.materials[name].node_tree
        path = tree.nodes.new("ShaderNodeLightPath")
        share = tree.nodes.new("ShaderNodeMath")
        share.operation = "MULTIPLY_ADD"
        share.inputs[1].default_value, share.inputs[2].default_value = 0.15, 0.2
        diffuse = next(node for node in tree.nodes if node.type == "BSDF_DIFFUSE")
        tree.links.new(path.outputs[output], share.inputs[0])
        tree.links.new(share.outputs[0], diffuse.inputs["Color"])
    assert_agree(scene, max_bounces=4)


@pytest.mark.parametrize("name", list_cases(MATERIALS, ["mirror"]))
def test_filter_glossy_agrees(name):
    scene = make_room()
    add_ball(MATERIALS[name]())
    assert_agree(scene, taming={"filter_glossy": 1.0})


@pytest.mark.parametrize("name", list_cases(["clamp_direct", "clamp_indirect"], ["clamp_indirect"]))
def test_clamped_light_agrees(name):
    """With one lamp without size both engines clamp the same numbers."""
    scene = make_room()
    lamp = bpy.data.objects["Lamp"]
    lamp.data.type, lamp.location.z = "POINT", 1.5
    lamp.data.shadow_soft_size = 0.0
    add_ball(MATERIALS["diffuse"]())
    assert_agree(scene, taming={name: 0.05})


def test_clamped_light_of_several_lamps_agrees():
    """Cycles chooses one of them, evenly without its light tree, and clamps it for all."""
    scene = make_room()
    bpy.data.objects.remove(bpy.data.objects["Lamp"])
    for number, place in enumerate([(0.5, 0, 1.5), (-0.5, 0.3, 1.2), (0.6, -0.4, 0.8)]):
        lamp = building.add_light(f"Lamp {number}", "POINT", 6.0, place, (0, 0, 0))
        lamp.data.shadow_soft_size = 0.0
    add_ball(MATERIALS["diffuse"]())
    scene.cycles.use_light_tree = False
    assert_agree(scene, max_bounces=1, taming={"clamp_direct": 0.25})
