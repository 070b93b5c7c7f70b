"""Ambient Occlusion in our engine and in Cycles of the same Blender: floor, wall, ball and pane that shine with it."""

import bpy
import numpy as np
import pytest

from addon.compare.cycles import metrics
from addon.compare.cycles.rendering import Request, render_both
from blend_scenes import building
from tests.addon.against_cycles.node_fixtures import add_node

pytestmark = pytest.mark.usefixtures("registered_addon")

SIZE = (32, 24)
MITSUBA_BAR = 0.0025
SAMPLES, BATCHES, CYCLES_FACTOR = 16, 8, 4


def make_glow(closure="ShaderNodeEmission", sockets=None, **properties):
    """A material whose color is an Ambient Occlusion node's."""
    material = building.make_shader("Glow", "Emission", (1, 1, 1))
    tree = material.node_tree
    node = add_node(
        tree, "ShaderNodeAmbientOcclusion", {"Color": (0.3, 0.6, 1.0, 1.0), **(sockets or {})}, **properties
    )
    shader = tree.nodes.new(closure)
    tree.links.new(node.outputs["Color"], shader.inputs["Color"])
    tree.links.new(shader.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    return material


def make_stage(make):
    """A floor beside a wall, a ball on it and a clear pane before it, seen from above."""
    scene = building.start_scene(*SIZE)
    glow = make()
    building.link_object("Floor", building.make_plane("Floor", 8, 8), materials=[glow])
    building.link_object("Wall", building.make_plane("Wall", 8, 2), (0, 1, 1), rotation=(90, 0, 0), materials=[glow])
    building.link_object("Ball", building.make_sphere("Ball", 0.5, 32), (0.7, 0, 0.5), materials=[glow])
    clear = building.make_shader("Clear", "Transparent", (1, 1, 1))
    building.link_object("Pane", building.make_plane("Pane", 1, 1), (-0.8, 0, 0.3), materials=[clear])
    building.add_camera((0, -5, 3), (0, 0, 0.4), 40)
    return scene


CASES = {
    "near": make_glow,
    "far": lambda: make_glow(sockets={"Distance": 100.0}, samples=1),
    "inside": lambda: make_glow(inside=True, sockets={"Distance": 0.8}),
    "only local": lambda: make_glow(only_local=True),
    "normal": lambda: make_glow(sockets={"Normal": (0.0, 0.8, 0.6)}),
    "no distance": lambda: make_glow(sockets={"Distance": -1.0}),
    "diffuse": lambda: make_glow("ShaderNodeBsdfDiffuse"),
}


@pytest.mark.parametrize("name", CASES)
def test_what_is_open_agrees(name):
    scene = make_stage(CASES[name])
    building.add_light("Lamp", "POINT", 300.0, (-1, -2, 4), (0, 0, 0))
    request = Request(*SIZE, SAMPLES, 0, BATCHES, cycles_factor=CYCLES_FACTOR)
    ours, cycles = (side.passes["Combined"] for side in render_both(scene, bpy.context.view_layer, request))
    assert np.isfinite(ours).all()
    assert ours[..., :3].std() > 0
    summed = SAMPLES * CYCLES_FACTOR
    assert metrics.share_failing_pixels(ours, cycles, summed) <= MITSUBA_BAR
    assert metrics.share_failing_tiles(ours, cycles, summed, size=8) == 0.0
