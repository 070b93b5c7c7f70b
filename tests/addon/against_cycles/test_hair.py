"""Hair against Cycles: shaders, what Curves Info tells, particles.

On surfaces Cycles 5.0 lets Principled Hair scatter to half of all directions only, by a test of bumps that takes the
closure's axis for its normal; the Hair BSDF it shows whole. Where Cycles' hair is not exact the settings are such that
its error is below the bars: its Bessel function misses 3% of the first reflection at roughness 0.3, and nothing at 0.4
(`bsdfs.hair_chiang`); the Hair BSDF is compared under lamps without size (`bsdfs.hair_cauchy`).
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest

from addon.compare.cycles import metrics
from addon.compare.cycles.rendering import Request, render_both
from blend_scenes import building
from tests.addon.against_cycles import furnace
from tests.addon.against_cycles.furnace import node
from tests.addon.against_cycles.node_fixtures import add_node
from tests.addon.against_cycles.test_pictures import (
    CYCLES_FACTOR,
    MITSUBA_BAR,
    SMALL_SIZE,
    add_lamp,
    make_stage,
)
from tests.addon.extract.shaders.shader_trees import clear_nodes

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]

# Pixels of the small picture that may differ with round strands; all tiles' light may by this share, beyond noise.
ROUND_BAR, BIAS_BAR = 2 / (SMALL_SIZE[0] * SMALL_SIZE[1]), 0.005
BROWN = (0.5, 0.25, 0.12, 1.0)
# Of the node's own: what is reflected more than twice inside, which Cycles finds too much of, hardly counts.
DARK = (0.0175, 0.0058, 0.0021, 1.0)


def principled(**settings: Any) -> furnace.Make:
    smooth = {"Roughness": 0.4, "Radial_Roughness": 0.4}
    return node("HairPrincipled", "Roughness", "Color", **{**smooth, **settings})


def huang(**settings: Any) -> furnace.Make:
    return node("HairPrincipled", "Roughness", "Color", **{"model": "HUANG", "Color": DARK, **settings})


SHADERS = {
    "color": principled(Color=BROWN),
    "absorption": principled(parametrization="ABSORPTION", Absorption_Coefficient=(0.2, 0.6, 1.5)),
    "melanin": principled(parametrization="MELANIN", Melanin=0.4, Melanin_Redness=0.3, Tint=BROWN),
    "random": principled(parametrization="MELANIN", Melanin=0.6, Random_Color=0.7, Random_Roughness=0.4),
    "coat": principled(Coat=0.1, Roughness=0.5, Radial_Roughness=0.6, IOR=1.4, Offset=0.2),
    "reflection": node("Hair", "RoughnessU", RoughnessU=0.3, RoughnessV=0.4, Offset=0.2),
    "transmission": node("Hair", "RoughnessU", RoughnessU=0.3, RoughnessV=0.5, component="Transmission"),
    "diffuse": node("Diffuse"),
    "huang": huang(),
    "huang round": huang(Aspect_Ratio=1.0),
    "huang rough": huang(Aspect_Ratio=1.0, Roughness=0.6, IOR=1.4, Offset=0.0),
    "huang lobes": huang(Aspect_Ratio=1.0, Offset=0.0, R_lobe=0.3, TT_lobe=0.7, TRT_lobe=2.0),
}
QUICK = ("melanin", "reflection", "transmission", "huang")


def assert_within_bars(scene: Any, samples: int, max_bounces: int = 0, pixels: float = MITSUBA_BAR) -> None:
    """Pixels by Mitsuba 3's test; tiles, where noise averages out, by half a percent of their light."""
    request = Request(*SMALL_SIZE, samples, max_bounces, 12, cycles_factor=CYCLES_FACTOR)
    ours, cycles = (side.passes["Combined"] for side in render_both(scene, bpy.context.view_layer, request))
    assert ours[..., :3].max() > 0
    assert metrics.share_failing_pixels(ours, cycles, samples * CYCLES_FACTOR) <= pixels
    assert metrics.measure_tiles(ours, cycles, size=8).bias <= BIAS_BAR


def add_lamps() -> None:
    """Lamps without size, before and behind."""
    for side in (-1, 1):
        lamp = add_lamp("POINT", {"shadow_soft_size": 0.0}, (0.8, 2.5 * side, 2.0), power=150.0)
        lamp.data.color = (1.0, 0.7, 0.4) if side < 0 else (0.3, 0.6, 1.0)


def add_strands(material: Any, count: int = 40, width: float = 0.06) -> Any:
    """Bent strands that stand on the stage."""
    rng, up = np.random.default_rng(1), np.linspace(0.0, 1.0, 6)
    root, bend = rng.uniform(-1.5, 1.5, (count, 1, 2)), rng.uniform(-0.6, 0.6, (count, 1, 2))
    points = np.zeros((count, 6, 3), dtype=np.float32)
    points[..., :2] = root + bend * up[:, np.newaxis] ** 2
    points[..., 2] = 0.05 + 1.8 * up
    data = bpy.data.hair_curves.new("Strands")
    data.add_curves([6] * count)
    data.attributes["position"].data.foreach_set("vector", points.ravel())
    radii = np.tile(np.linspace(width, 0.3 * width, 6, dtype=np.float32), count)
    data.attributes.new("radius", "FLOAT", "POINT").data.foreach_set("value", radii)
    return building.link_object("Strands", data, materials=[material])


def choose_shape(scene: Any, shape: str) -> None:
    """Ribbons as smooth as Cycles makes them, or round strands."""
    scene.cycles_curves.shape, scene.cycles_curves.subdivisions = shape, 4


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in SHADERS]
)
def test_hair_shaders_on_ribbons_agree(name: str) -> None:
    scene = make_stage()
    choose_shape(scene, "RIBBONS")
    add_lamps()
    add_strands(furnace.make_material(SHADERS[name]))
    assert_within_bars(scene, samples=16)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name == "melanin" else pytest.mark.slow) for name in SHADERS]
)
def test_hair_shaders_on_round_strands_agree(name: str) -> None:
    """But for two pixels of the floor, at roots that stand in the air, and thousandths of light in shadows: whatever
    the shader, the floor is darker in Cycles where light comes by an open end."""
    scene = make_stage()
    choose_shape(scene, "THICK")
    add_lamps()
    add_strands(furnace.make_material(SHADERS[name]))
    assert_within_bars(scene, 16, pixels=ROUND_BAR)


def test_hair_that_hair_shines_on_agrees() -> None:
    """A world, and light that several strands have scattered."""
    scene = make_stage()
    choose_shape(scene, "RIBBONS")
    building.set_world((0.5, 0.6, 0.8), 1.0)
    add_strands(furnace.make_material(principled(Color=(0.8, 0.7, 0.6, 1.0), Roughness=0.5, Radial_Roughness=0.5)))
    assert_within_bars(scene, samples=32, max_bounces=3)


@pytest.mark.parametrize("width", [0.06, 0.4])
def test_huangs_hair_under_a_world_agrees(width: float) -> None:
    """Bright round strands, whose light rays find: thinner than a pixel, and so wide that each pixel sees a part."""
    scene = make_stage()
    choose_shape(scene, "RIBBONS")
    building.set_world((0.5, 0.6, 0.8), 1.0)
    add_strands(furnace.make_material(huang(Color=BROWN, Aspect_Ratio=1.0)), 40 if width < 0.1 else 6, width)
    assert_within_bars(scene, samples=16, max_bounces=2)


@pytest.mark.parametrize("output", ["Is Strand", "Intercept", "Length", "Thickness", "Tangent Normal", "Random"])
def test_what_curves_info_tells_agrees(output: str) -> None:
    """As light of strands, and of a ball, which is none."""
    scene = make_stage()
    bpy.data.objects.remove(bpy.data.objects["Plane"])
    choose_shape(scene, "RIBBONS")
    material = bpy.data.materials.new(output)
    tree = clear_nodes(material)
    emission = add_node(tree, "ShaderNodeEmission", {"Strength": 10.0 if output == "Thickness" else 1.0})
    tree.links.new(add_node(tree, "ShaderNodeHairInfo", {}).outputs[output], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], tree.nodes[0].inputs["Surface"])
    add_strands(material)
    ball = building.make_sphere("Ball", 0.5, 16)
    building.link_object("Ball", ball, (0, 0, 0.5), materials=[material])
    assert_within_bars(scene, samples=16)


@pytest.mark.parametrize("child_type", ["NONE", "INTERPOLATED"])
def test_particle_hair_agrees(child_type: str) -> None:
    """On a ball that hides behind it, or not; coordinates of the roots color it."""
    scene = make_stage()
    choose_shape(scene, "RIBBONS")
    add_lamps()
    fur = furnace.make_material(principled())
    tree = fur.node_tree
    shader = next(each for each in tree.nodes if each.type == "BSDF_HAIR_PRINCIPLED")
    tree.links.new(add_node(tree, "ShaderNodeTexCoord", {}).outputs["UV"], shader.inputs["Color"])
    skin = building.make_shader("Skin", "Diffuse", (0.5, 0.4, 0.3))
    ball = building.link_object("Ball", building.make_sphere("Ball", 0.8, 16), (0, 0, 1), materials=[skin, fur])
    ball.show_instancer_for_render = child_type == "NONE"
    hair = ball.modifiers.new("Hair", "PARTICLE_SYSTEM").particle_system.settings
    hair.type, hair.count, hair.hair_length, hair.child_type = "HAIR", 60, 0.8, child_type
    hair.rendered_child_count, hair.radius_scale, hair.root_radius, hair.tip_radius = 3, 0.1, 1.0, 0.4
    hair.material, hair.kink, hair.kink_amplitude = 2, "WAVE", 0.1
    assert_within_bars(scene, samples=16)


def test_instances_of_hair_agree() -> None:
    """The same strands, turned and scaled, twice."""
    scene = make_stage()
    choose_shape(scene, "RIBBONS")
    add_lamps()
    strands = add_strands(furnace.make_material(principled(Color=BROWN)), count=12)
    strands.location = (-1, 0, 0)
    twin = bpy.data.objects.new("Twin", strands.data)
    twin.location, twin.rotation_euler, twin.scale = (1, 0.5, 0), (0, 0.4, 1.0), (0.7, 0.7, 0.7)
    bpy.context.scene.collection.objects.link(twin)
    assert_within_bars(scene, samples=16)


@pytest.mark.parametrize("name", ["reflection", "transmission"])
def test_hair_bsdfs_on_surfaces_agree(name: str) -> None:
    scene = make_stage()
    add_lamps()
    made = furnace.make_material(SHADERS[name])
    sheet = building.make_plane("Sheet", 2.0, 1.6)
    building.link_object("Sheet", sheet, (-1.1, 0, 1.0), rotation=(75, 0, 15), materials=[made])
    building.link_object("Ball", building.make_sphere("Ball", 0.9, 24), (1.2, 0, 1.0), materials=[made])
    assert_within_bars(scene, samples=16)
