"""Light below surfaces against Cycles: balls, thin bodies and a monkey, of several radii, colors and methods."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import pytest

from addon.versions import VERSION
from blend_scenes import building
from tests.addon.against_cycles.furnace import Make, make_material, principled
from tests.addon.against_cycles.node_fixtures import add_node
from tests.addon.against_cycles.test_pictures import add_lamp, assert_pictures_agree, make_stage

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]

SKIN_COLOR = (0.8, 0.5, 0.3, 1.0)


def below(falloff: str = "RANDOM_WALK", /, **settings: Any) -> Make:
    """Return what makes a Subsurface Scattering node."""

    def make(tree: Any, roughness: float | None) -> Any:
        values = {"Color": SKIN_COLOR, "Radius": (1.0, 0.5, 0.2), **settings}
        return add_node(tree, "ShaderNodeSubsurfaceScattering", values, falloff=falloff).outputs[0]

    return make


def bumped(tree: Any, roughness: float | None) -> Any:
    """Noise in the color, and as bumps, which bend the normal where light leaves."""
    shader = below(Scale=0.1)(tree, roughness)
    noise = add_node(tree, "ShaderNodeTexNoise", {"Scale": 4.0})
    bump = add_node(tree, "ShaderNodeBump", {"Strength": 0.8, "Distance": 0.3})
    tree.links.new(noise.outputs[0], bump.inputs["Height"])
    tree.links.new(bump.outputs[0], shader.node.inputs["Normal"])
    tree.links.new(noise.outputs["Color"], shader.node.inputs["Color"])
    return shader


MATERIALS = {
    "bumped": bumped,
    "walk": below(Scale=0.5),
    "far": below(Scale=10.0, Color=(0.95, 0.6, 0.1, 1.0)),
    "near": below(Scale=0.02, IOR=1.8, Roughness=0.2),
    "dark": below(Scale=1.0, Color=(0.02, 0.1, 0.3, 1.0)),
    "skin": below("RANDOM_WALK_SKIN", Scale=0.2),
    "sharp": below(Scale=1.0, Anisotropy=0.7),
    "sharp skin": below("RANDOM_WALK_SKIN", Scale=0.2, Anisotropy=0.8),
    "red only": below(Scale=1.0, Radius=(1.0, 0.0, 0.0)),
    "principled": principled(Subsurface_Weight=0.7, Subsurface_Scale=0.5, Roughness=0.4),
    "principled skin": principled(
        Subsurface_Weight=1.0, Subsurface_Scale=0.2, Subsurface_IOR=1.6, subsurface_method="RANDOM_WALK_SKIN"
    ),
}
QUICK = ("walk", "sharp skin", "principled")


def make_ball() -> Any:
    return building.make_sphere("Ball", 1.2, 32)


def make_comb() -> Any:
    """A plate with thin teeth: light comes through from behind."""
    corners, faces = [], []
    for low, high in (
        ((-1.2, -0.1, -1.0), (1.2, 0.1, -0.4)),
        *(((x, -0.05, -0.4), (x + 0.2, 0.05, 1.0)) for x in (-1.0, -0.2, 0.6)),
    ):
        first = len(corners)
        corners += [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
        sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
        faces += [tuple(first + corner for corner in side) for side in sides]
    return building.new_mesh("Comb", corners, faces)


def make_monkey() -> Any:
    bpy.ops.mesh.primitive_monkey_add(size=2.4)
    monkey = bpy.context.object
    mesh = monkey.data.copy()
    bpy.data.objects.remove(monkey)
    return mesh


BODIES: dict[str, Callable[[], Any]] = {"ball": make_ball, "comb": make_comb, "monkey": make_monkey}


def make_scene(body: str, material: str) -> Any:
    scene = make_stage()
    add_lamp("AREA", {"shape": "SQUARE", "size": 1.5}, location=(-1.5, -2.5, 3.0))
    add_lamp("POINT", {"shadow_soft_size": 0.1}, location=(1.5, 2.5, 2.0), power=150.0)
    building.set_world((0.2, 0.25, 0.3), 1.0)
    made = make_material(MATERIALS[material])
    building.link_object("Body", BODIES[body](), (0, 0.2, 1.2), materials=[made])
    return scene


# Light that goes on nearly straight, g = 0.8: .7756 +- .0007 in Cycles 5.2.3, .7670 +- .0008 here and in 5.0; a
# difference of 1.1% whose cause is not found.
BRIGHTER_IN_5_2 = pytest.mark.xfail(VERSION >= (5, 2), reason="Cycles 5.2 is 1.1% brighter, it is not known why")


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(
            name,
            marks=[
                *([] if name in QUICK else [pytest.mark.slow]),
                *([BRIGHTER_IN_5_2] if name == "sharp" else []),
            ],
        )
        for name in MATERIALS
    ],
)
def test_a_ball_agrees(name: str) -> None:
    assert_pictures_agree(make_scene("ball", name), samples=16)


@pytest.mark.parametrize("body", ["comb", pytest.param("monkey", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", ["walk", pytest.param("principled skin", marks=pytest.mark.slow)])
def test_thin_and_bent_bodies_agree(body: str, name: str) -> None:
    assert_pictures_agree(make_scene(body, name), samples=16)


@pytest.mark.slow
def test_a_ball_agrees_with_bounces() -> None:
    assert_pictures_agree(make_scene("ball", "principled"), samples=16, max_bounces=4)
