"""Bevel in our engine and in Cycles of the same Blender: blocks, a ball and a smooth block on a floor, as the normal of
shaders and as their color."""

import bpy
import numpy as np
import pytest

from addon.compare.cycles import metrics
from addon.compare.cycles.rendering import Request, render_both
from addon.versions import VERSION
from blend_scenes import building
from tests.addon.against_cycles.node_fixtures import add_node

pytestmark = pytest.mark.usefixtures("registered_addon")

SIZE = (32, 24)
MITSUBA_BAR = 0.0025
SAMPLES, BATCHES, CYCLES_FACTOR = 32, 8, 4
RADIUS = 0.3


def make_shown(closure="ShaderNodeBsdfDiffuse", samples=4, bump=False, radius=RADIUS, **sockets):
    """A material whose shader has a Bevel node's normal."""
    material = building.make_shader("Beveled", "Emission", (1, 1, 1))
    tree = material.node_tree
    shader = tree.nodes.new(closure)
    normal = add_node(tree, "ShaderNodeBevel", {"Radius": radius}, samples=samples)
    if bump:
        waves = add_node(tree, "ShaderNodeTexChecker", {"Scale": 4.0})
        height = add_node(tree, "ShaderNodeBump", {"Height": waves.outputs["Fac"], "Distance": 0.05})
        tree.links.new(height.outputs["Normal"], normal.inputs["Normal"])
    for name, value in sockets.items():
        shader.inputs[name].default_value = value
    tree.links.new(normal.outputs["Normal"], shader.inputs["Normal"])
    tree.links.new(shader.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    return material


def make_uncorrected():
    """A material whose bent normals do not fade the light that grazes them."""
    material = make_shown(bump=True, radius=0.6)
    material.cycles.use_bump_map_correction = False
    return material


def make_colored(samples=4, radius=RADIUS):
    """A material that shines with half a Bevel node's normal, and a half."""
    material = building.make_shader("Normal", "Emission", (1, 1, 1))
    tree = material.node_tree
    normal = add_node(tree, "ShaderNodeBevel", {"Radius": radius}, samples=samples)
    shown = add_node(tree, "ShaderNodeVectorMath", {"Vector": normal.outputs["Normal"]}, operation="MULTIPLY_ADD")
    shown.inputs[1].default_value = shown.inputs[2].default_value = [0.5] * 3
    tree.links.new(shown.outputs[0], tree.nodes["Emission"].inputs["Color"])
    return material


def make_stage(make):
    """Blocks that are turned, scaled and mirrored, a smooth one and one open below, which the camera sees inside of."""
    scene = building.start_scene(*SIZE)
    material = make()
    building.link_object("Floor", building.make_plane("Floor", 8, 8), (0, 0, -0.5), materials=[material])
    cube = building.make_box("Cube", 1, 1, 1)
    building.link_object("Block", cube, (-1.2, 0, 0), rotation=(0, 0, 30), materials=[material])
    building.link_object("Tall", cube.copy(), (0, 0.3, 0.1), rotation=(20, 0, 50), materials=[material])
    bpy.data.objects["Tall"].scale = (0.7, -0.8, 1.2)
    smooth = building.make_box("Smooth", 1, 1, 1)
    for face in smooth.polygons:
        face.use_smooth = True
    building.link_object("Smooth", smooth, (1.2, 0, 0), rotation=(0, 0, 10), materials=[material])
    building.add_camera((0, -4, 2.5), (0, 0, 0), 45)
    return scene


CASES = {
    "diffuse": make_shown,
    "two samples": lambda: make_colored(samples=2),
    "wide": lambda: make_shown(samples=16, radius=0.8),
    "bump": lambda: make_shown(bump=True),
    "uncorrected": make_uncorrected,
    "glossy": lambda: make_shown("ShaderNodeBsdfAnisotropic", Roughness=0.6),
    "principled": lambda: make_shown("ShaderNodeBsdfPrincipled", Roughness=0.4, Metallic=0.5),
    "color": make_colored,
}


# Before Blender 5.0 light that grazes bent normals fades in another way.
FADING = ("diffuse", "wide", "bump", "uncorrected")


@pytest.mark.parametrize("name", CASES)
def test_rounded_normals_agree(name):
    if name in FADING and VERSION < (5, 0):
        pytest.skip("bent normals of diffuse closures are compared from Blender 5.0 on")
    scene = make_stage(CASES[name])
    building.add_light("Lamp", "POINT", 300.0, (-1, -2, 4), (0, 0, 0))
    request = Request(*SIZE, SAMPLES, 2, BATCHES, cycles_factor=CYCLES_FACTOR)
    ours, cycles = (side.passes["Combined"] for side in render_both(scene, bpy.context.view_layer, request))
    assert np.isfinite(ours).all()
    assert ours[..., :3].std() > 0
    summed = SAMPLES * CYCLES_FACTOR
    assert metrics.share_failing_pixels(ours, cycles, summed) <= MITSUBA_BAR
    assert metrics.share_failing_tiles(ours, cycles, summed, size=8) == 0.0
