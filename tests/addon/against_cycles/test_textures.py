"""Pictures of textured materials against Cycles: parameters of closures that nodes compute, under lamps.

Under a lamp without extent nothing is left to chance: both engines are compared point by point. In the slow tier,
larger lamps: the statistical test of `tests.addon.test_pictures`, pixels by Mitsuba 3's bar, tiles all.
"""

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
import pytest

from addon.versions import VERSION, find_node_tree
from blend_scenes import building
from tests.addon.against_cycles.node_fixtures import add_node, render_centres, render_cycles
from tests.addon.against_cycles.test_pictures import add_lamp, assert_pictures_agree, make_stage

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]


def make_material(make: Callable[[Any], Any]) -> Any:
    """Return a material whose surface is the shader socket that `make` returns."""
    material = bpy.data.materials.new("Textured")
    if VERSION < (5, 0):
        material.use_nodes = True
    tree = find_node_tree(material)
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(make(tree), output.inputs["Surface"])
    return material


def noise(tree: Any, scale: float = 3.0, output: str = "Fac") -> Any:
    return add_node(tree, "ShaderNodeTexNoise", {"Scale": scale, "Detail": 1.0}).outputs[output]


def checker(tree: Any, scale: float = 4.0) -> Any:
    return add_node(tree, "ShaderNodeTexChecker", {"Scale": scale}).outputs["Fac"]


def shader(tree: Any, kind: str, **inputs: Any) -> Any:
    values = {name.replace("_", " "): value for name, value in inputs.items()}
    return add_node(tree, f"ShaderNodeBsdf{kind}", values).outputs[0]


def bump(tree: Any, distance: float = 0.2) -> Any:
    return add_node(tree, "ShaderNodeBump", {"Height": noise(tree, 2.0), "Distance": distance}).outputs[0]


def mix(tree: Any, factor: Any, first: Any, second: Any) -> Any:
    node = tree.nodes.new("ShaderNodeMixShader")
    for socket, source in zip(node.inputs, (factor, first, second), strict=True):
        tree.links.new(source, socket)
    return node.outputs[0]


def emission(tree: Any, color: Any, strength: Any = 1.0) -> Any:
    return add_node(tree, "ShaderNodeEmission", {"Color": color, "Strength": strength}).outputs[0]


MATERIALS: dict[str, Callable[[Any], Any]] = {
    "diffuse": lambda tree: shader(tree, "Diffuse", Color=noise(tree, output="Color")),
    "diffuse with bump": lambda tree: shader(tree, "Diffuse", Normal=bump(tree)),
    "glossy with bump": lambda tree: shader(tree, "Anisotropic", Roughness=0.4, Normal=bump(tree, 0.05)),
    "principled": lambda tree: shader(
        tree, "Principled", Base_Color=noise(tree, output="Color"), Roughness=noise(tree, 5.0), Metallic=checker(tree)
    ),
    "principled with bump": lambda tree: shader(tree, "Principled", Roughness=0.6, Normal=bump(tree)),
    "alpha": lambda tree: shader(tree, "Principled", Alpha=checker(tree)),
    "mixed": lambda tree: mix(
        tree, noise(tree), shader(tree, "Diffuse"), shader(tree, "Anisotropic", Roughness=0.5, Normal=bump(tree, 0.05))
    ),
    "mixed with transparent": lambda tree: mix(
        tree, checker(tree), shader(tree, "Diffuse"), shader(tree, "Transparent", Color=noise(tree, output="Color"))
    ),
    "diffuse and bent diffuse": lambda tree: mix(
        tree, noise(tree), shader(tree, "Diffuse"), shader(tree, "Diffuse", Normal=bump(tree))
    ),
    "shining": lambda tree: emission(tree, noise(tree, output="Color"), checker(tree)),
}


# Blender 4.2's Cycles lets light on bent diffuse normals fade out by another formula than later ones.
FADING = ("diffuse with bump", "principled with bump", "diffuse and bent diffuse")
SAME_FADING = pytest.mark.skipif(VERSION < (5, 0), reason="Cycles fades light on bumps otherwise before Blender 5.0")


# Where a path goes at random straight on.
TRANSPARENT = ("alpha", "mixed with transparent")
EXACT = tuple(name for name in MATERIALS if name not in (*TRANSPARENT, "shining"))
# Cycles starts shadow rays elsewhere where a mesh stands for a round thing: some points at the shadow's border differ.
BORDER_SHARE = 0.002


@pytest.mark.parametrize("name", [pytest.param(name, marks=SAME_FADING if name in FADING else ()) for name in EXACT])
def test_a_ball_of_a_textured_material_agrees_point_by_point(name: str) -> None:
    make_stage()
    add_lamp("POINT", {"shadow_soft_size": 0.0}, location=(2.5, -2.5, 3.0), power=300.0)
    ball = building.make_sphere("Ball", 1.2, 64)
    building.link_object("Ball", ball, (0, 0.2, 1.2), materials=[make_material(MATERIALS[name])])
    (ours, warnings), cycles = render_centres(96, 72), render_cycles(96, 72)
    assert not warnings
    difference = np.abs(ours - cycles).max(axis=2)
    assert np.quantile(difference, 1.0 - BORDER_SHARE) < 2e-3
    assert abs(ours.mean() - cycles.mean()) < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=SAME_FADING if name in FADING else ()) for name in MATERIALS]
)
def test_a_ball_of_a_textured_material_agrees(name: str) -> None:
    scene = make_stage()
    add_lamp("AREA", {"shape": "SQUARE", "size": 1.5}, location=(-1.5, -2.5, 3.0))
    add_lamp("POINT", {"shadow_soft_size": 0.0}, location=(2.5, -1.5, 2.0), power=80.0)
    ball = building.make_sphere("Ball", 1.2, 64)
    building.link_object("Ball", ball, (0, 0.2, 1.2), materials=[make_material(MATERIALS[name])])
    assert_pictures_agree(scene, samples=16)


@pytest.mark.slow
def test_a_textured_plane_lights_the_scene_as_in_cycles() -> None:
    """One side of the plane is much brighter than the other; nothing else shines."""
    scene = make_stage()

    def make(tree: Any) -> Any:
        ramp = add_node(tree, "ShaderNodeTexGradient", gradient_type="QUADRATIC").outputs["Fac"]
        strength = add_node(tree, "ShaderNodeMath", {"Value": ramp, "Value_001": 20.0}, operation="MULTIPLY").outputs[0]
        return emission(tree, noise(tree, output="Color"), strength)

    plane = building.make_plane("Lamp", 3, 2)
    building.link_object("Lamp", plane, (0, 1.0, 2.0), rotation=(70, 0, 0), materials=[make_material(make)])
    assert_pictures_agree(scene, samples=16)


def test_a_pane_without_transparent_shadow_stops_the_light_as_in_cycles() -> None:
    make_stage()
    add_lamp("POINT", {"shadow_soft_size": 0.0}, location=(0.2, 0.3, 3.0), power=300.0)
    material = make_material(lambda tree: shader(tree, "Transparent", Color=noise(tree, output="Color")))
    building.link_object("Pane", building.make_plane("Pane", 2, 2), (0, 0, 1.5), materials=[material])
    seen = {}
    for choice in (False, True):
        material.use_transparent_shadow = choice
        ours, cycles = render_centres(96, 72)[0], render_cycles(96, 72)
        assert np.quantile(np.abs(ours - cycles).max(axis=2), 1.0 - BORDER_SHARE) < 2e-3
        seen[choice] = ours
    assert np.abs(seen[True] - seen[False]).max() > 0.1


def test_a_pane_without_transparent_shadow_lets_the_light_of_an_even_world_pass_as_in_cycles() -> None:
    """Cycles takes an even world's light from paths alone, and those go on behind what stops shadow rays."""
    scene = make_stage()
    building.set_world((1.0, 0.9, 0.8), 1.0)
    material = make_material(lambda tree: shader(tree, "Transparent", Color=noise(tree, output="Color")))
    material.use_transparent_shadow = False
    building.link_object("Pane", building.make_plane("Pane", 4, 4), (0, 0, 1.5), materials=[material])
    assert_pictures_agree(scene, samples=16)


def test_a_coat_on_a_bent_base_is_flat_as_in_cycles() -> None:
    """Black under its coat, so that the coat's reflection of a lamp is all that is seen."""
    scene = make_stage()
    add_lamp("AREA", {"size": 1.0}, location=(2.0, 0.0, 3.0), power=200.0)
    material = building.make_principled("Coated", (0, 0, 0), coat_weight=1.0, coat_roughness=0.3)
    tree = material.node_tree
    principled, bend = tree.nodes["Principled BSDF"], tree.nodes.new("ShaderNodeNormalMap")
    principled.inputs["Specular IOR Level"].default_value = 0.0
    bend.space, bend.inputs["Color"].default_value = "WORLD", (0.75, 0.5, 0.9, 1.0)
    tree.links.new(bend.outputs["Normal"], principled.inputs["Normal"])
    bpy.data.objects["Plane"].data.materials[0] = material
    assert_pictures_agree(scene, samples=16)


def test_a_surface_that_only_shadow_rays_pass_agrees() -> None:
    """The usual trick with Light Path: seen as diffuse, and without a shadow."""
    make_stage()
    add_lamp("POINT", {"shadow_soft_size": 0.0}, location=(0.2, 0.3, 3.0), power=300.0)

    def make_pane(tree: Any) -> Any:
        is_shadow = tree.nodes.new("ShaderNodeLightPath").outputs["Is Shadow Ray"]
        return mix(tree, is_shadow, shader(tree, "Diffuse"), shader(tree, "Transparent"))

    pane = building.link_object(
        "Pane", building.make_plane("Pane", 1, 1), (0, 0, 1.0), materials=[make_material(make_pane)]
    )
    (ours, warnings), cycles = render_centres(96, 72), render_cycles(96, 72)
    assert not warnings
    assert np.quantile(np.abs(ours - cycles).max(axis=2), 1.0 - BORDER_SHARE) < 2e-3
    bpy.data.objects.remove(pane)
    open_ = render_centres(96, 72)[0]
    assert np.isclose(ours, open_, atol=1e-12).all(axis=2).mean() > 0.7  # all but the pane itself


@pytest.mark.slow
@SAME_FADING
def test_normal_maps_agree_under_a_lamp() -> None:
    """A tangent-space map on a curved mesh with a seam."""
    scene = make_stage()
    add_lamp("POINT", {"shadow_soft_size": 0.0}, location=(2.5, -2.5, 3.0), power=300.0)

    def make(tree: Any) -> Any:
        color = noise(tree, 4.0, "Color")
        normal = add_node(tree, "ShaderNodeNormalMap", {"Color": color, "Strength": 0.7}).outputs[0]
        return shader(tree, "Diffuse", Normal=normal)

    bpy.ops.mesh.primitive_uv_sphere_add(segments=24, ring_count=12, radius=1.2, location=(0, 0.2, 1.2))
    ball = bpy.context.object.data
    ball.polygons.foreach_set("use_smooth", np.ones(len(ball.polygons), bool))
    ball.materials.append(make_material(make))
    assert_pictures_agree(scene, samples=16)
