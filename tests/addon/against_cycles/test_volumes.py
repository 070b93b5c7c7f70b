"""Participating media against Cycles: fog, smoke, fire and colored glass, in every kind of light and of place.

Cycles up to 4.5 marches through volumes that vary, in steps; `addon.compare` makes them fine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import bmesh
import bpy
import numpy as np
import pytest

from addon.compare.cycles import comparison, metrics
from addon.compare.cycles.chance import BACKGROUND_DEPTH, find_seen
from addon.compare.cycles.comparison import CENTRE_WIDTH
from addon.compare.cycles.rendering import CYCLES, Request, matched_settings, render_batches, render_both
from addon.compare.cycles.verdict import PASSES_BAR
from addon.versions import VERSION, find_node_tree
from blend_scenes import building
from tests.addon.against_cycles.node_fixtures import add_node
from tests.addon.against_cycles.test_pictures import CYCLES_FACTOR, MITSUBA_BAR, SMALL_SIZE, add_lamp, make_stage
from tests.addon.extract.shaders.shader_trees import clear_nodes
from tests.addon.extract.test_volume_objects import make_cloud

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]

WARM = (0.9, 0.6, 0.3, 1.0)
# What makes the shader of a volume in a tree, and returns its output.
Fill = Callable[[Any], Any]


def make_volume(fill: Fill, surface: str = "") -> Any:
    """Return a material that is filled, within a surface or none."""
    material = bpy.data.materials.new("Volume")
    tree = clear_nodes(material)
    tree.links.new(fill(tree), tree.nodes[0].inputs["Volume"])
    if surface:
        tree.links.new(add_node(tree, surface).outputs[0], tree.nodes[0].inputs["Surface"])
    return material


def fill_world(fill: Fill) -> None:
    tree = find_node_tree(bpy.context.scene.world)
    output = next(node for node in tree.nodes if node.type == "OUTPUT_WORLD")
    tree.links.new(fill(tree), output.inputs["Volume"])


def node(kind: str, inputs: dict[str, Any] | None = None, **properties: Any) -> Fill:
    """Return what adds one node."""
    return lambda tree: add_node(tree, f"ShaderNode{kind}", inputs, **properties).outputs[0]


def scatter(density: float = 0.8, **properties: Any) -> Fill:
    inputs = {name: properties.pop(name) for name in tuple(properties) if name[0].isupper()}
    return node("VolumeScatter", {"Color": WARM, "Density": density, **inputs}, **properties)


def vary(kind: str, inputs: dict[str, Any], socket: str, coordinates: str, scale: float = 3.0) -> Fill:
    """Return what adds one node, an input of which is noise."""

    def fill(tree: Any) -> Any:
        place = add_node(tree, "ShaderNodeTexCoord")
        vector = next(output for output in place.outputs if output.name == coordinates)
        noise = add_node(tree, "ShaderNodeTexNoise", {"Vector": vector, "Scale": scale})
        sharp = add_node(
            tree,
            "ShaderNodeMapRange",
            {"Value": noise.outputs[0], "From Min": 0.4, "From Max": 0.65, "To Max": 3.0},
            clamp=True,
        )
        made = add_node(tree, f"ShaderNode{kind}", inputs)
        found = next(item for item in made.inputs if item.name == socket)
        tree.links.new(noise.outputs["Color"] if "Color" in socket else sharp.outputs[0], found)
        return made.outputs[0]

    return fill


def both(first: Fill, second: Fill, share: float | None = None) -> Fill:
    """Return what adds two shaders up, or mixes them."""

    def fill(tree: Any) -> Any:
        mix = add_node(tree, "ShaderNodeAddShader" if share is None else "ShaderNodeMixShader")
        if share is not None:
            mix.inputs[0].default_value = share
        for socket, made in zip(mix.inputs[-2:], (first, second), strict=True):
            tree.links.new(made(tree), socket)
        return mix.outputs[0]

    return fill


def put(fill: Fill, body: str = "box", place: tuple[float, float, float] = (0, 0.2, 0.05), surface: str = "") -> Any:
    """Put a body of a volume on the stage."""
    meshes = {
        "box": lambda: building.make_box("Body", 1.8, 1.6, 1.6),
        "ball": lambda: building.make_sphere("Body", 0.9, 24),
        "small box": lambda: building.make_box("Body", 0.8, 0.8, 0.8),
        "hall": lambda: building.make_box("Body", 30, 30, 12),
    }
    return building.link_object("Body", meshes[body](), place, materials=[make_volume(fill, surface)])


def nest() -> None:
    put(scatter(0.4))
    put(scatter(2.0, Color=(0.2, 0.5, 0.9, 1.0)), "small box", (0, 0.2, 0.4))


def overlap() -> None:
    put(scatter(0.6), "ball", (-0.4, 0.2, 0.95))
    put(node("VolumeAbsorption", {"Color": (0.2, 0.5, 0.9, 1.0), "Density": 1.5}), "ball", (0.4, 0.2, 0.95))


def stand_inside() -> None:
    put(scatter(0.12), "hall", (0, 0, -0.5))


def fog(density: float = 0.08, **properties: Any) -> Callable[[], None]:
    def build() -> None:
        building.set_world((0.0, 0.0, 0.0), 1.0)
        fill_world(scatter(density, **properties))

    return build


def look_through_film() -> None:
    bpy.context.scene.render.film_transparent = True
    bpy.context.scene.collection.objects.unlink(bpy.data.objects["Plane"])
    put(both(scatter(0.8), node("VolumeAbsorption", {"Density": 0.5})), "ball", (0, 0.2, 0.4))


def show_voxels() -> None:
    shown = make_cloud(bpy.context.scene)
    shown.location, shown.scale = (-1.2, 0.2, 1.0), (1.5, 0.6, 0.4)


class Case(NamedTuple):
    """What stands on the stage, in which light, how often light is scattered, and renders."""

    build: Callable[[], Any]
    lamp: str = "point"
    bounces: int = 0
    batches: int = 12


# Before each render Cycles 5 looks for the bounds of what varies, which takes seconds: fewer renders tell enough.
FEW = 4


LAMPS = {
    "point": ("POINT", {"shadow_soft_size": 0.0}),
    "ball": ("POINT", {"shadow_soft_size": 0.4}),
    "sun": ("SUN", {"angle": 0.2}),
    "spot": ("SPOT", {"shadow_soft_size": 0.1, "spot_size": 0.9, "spot_blend": 0.3}),
    "area": ("AREA", {"shape": "SQUARE", "size": 1.0}),
}
GREY_LIGHT = "world"

CASES = {
    "box": Case(lambda: put(scatter())),
    "ball in the sun": Case(lambda: put(scatter(), "ball", (0, 0.2, 0.95)), "sun"),
    "inside": Case(stand_inside, "ball"),
    "nested": Case(nest),
    "overlapping": Case(overlap, "area"),
    "fog and a point": Case(fog(), "point"),
    "fog and a ball": Case(fog(), "ball"),
    "fog and a spot": Case(fog(), "spot"),
    "fog and an area": Case(fog(), "area"),
    "absorption": Case(lambda: put(node("VolumeAbsorption", {"Color": WARM, "Density": 1.0})), "sun"),
    "absorbing glass": Case(
        lambda: put(node("VolumeAbsorption", {"Color": WARM, "Density": 1.5}), surface="ShaderNodeBsdfGlass"),
        GREY_LIGHT,
        6,
    ),
    "forward": Case(lambda: put(scatter(Anisotropy=0.7)), "area"),
    "backward": Case(lambda: put(scatter(Anisotropy=-0.5)), "sun"),
    "noise": Case(lambda: put(vary("VolumeScatter", {"Color": WARM}, "Density", "Object")), batches=FEW),
    "colors by place": Case(
        lambda: put(vary("VolumeScatter", {"Density": 1.0}, "Color", "Generated", 4.0)), "sun", batches=FEW
    ),
    "fire": Case(
        lambda: put(both(scatter(0.3), vary("Emission", {"Color": WARM}, "Strength", "Object"))), bounces=4, batches=FEW
    ),
    "mixed": Case(lambda: put(both(scatter(2.0), node("VolumeAbsorption", {"Density": 2.0}), 0.3)), "sun"),
    "principled": Case(
        lambda: put(node("VolumePrincipled", {"Color": WARM, "Absorption Color": (0.1, 0.4, 0.8, 1), "Density": 1.5}))
    ),
    # What is redder than Rec. 709 can show, below 1900 K, takes blue light away.
    "red heat": Case(
        lambda: put(node("VolumePrincipled", {"Density": 0.5, "Blackbody Intensity": 0.6, "Temperature": 1100.0})),
        bounces=4,
    ),
    "glow on the floor": Case(lambda: put(node("Emission", {"Color": WARM, "Strength": 3.0}))),
    "glow that is scattered": Case(lambda: put(both(scatter(1.0), node("Emission", {"Color": WARM, "Strength": 3.0})))),
    "black body": Case(
        lambda: put(node("VolumePrincipled", {"Density": 0.5, "Blackbody Intensity": 0.1, "Temperature": 2500.0})),
        bounces=4,
    ),
    "glowing": Case(
        lambda: put(
            vary(
                "VolumePrincipled",
                {"Emission Strength": 0.5, "Emission Color": WARM, "Density": 0.5},
                "Density",
                "Object",
            )
        ),
        "sun",
        4,
        FEW,
    ),
    "scattered often": Case(lambda: put(scatter(2.0)), GREY_LIGHT, 12),
    "fog scattered often": Case(lambda: (stand_inside(), put(scatter(1.0), "ball", (0, 0.2, 0.95))), "area", 4),
    "film": Case(look_through_film, "sun"),
    "voxels": Case(show_voxels, "sun", batches=FEW),
}
if VERSION >= (4, 3):
    CASES |= {
        "Fournier and Forand": Case(lambda: put(scatter(phase="FOURNIER_FORAND", IOR=1.4, Backscatter=0.2)), "area"),
        "Draine": Case(lambda: put(scatter(phase="DRAINE", Anisotropy=0.5, Alpha=20.0)), "area"),
        "Rayleigh": Case(lambda: put(scatter(phase="RAYLEIGH")), "sun"),
        "Mie": Case(lambda: put(scatter(phase="MIE", Diameter=3.0)), "area"),
    }
if VERSION >= (5, 0):
    coefficients = {
        "Absorption Coefficients": (0.1, 0.3, 0.8),
        "Scatter Coefficients": (1.0, 0.5, 0.2),
        "Emission Coefficients": (0.0, 0.05, 0.2),
    }
    CASES["coefficients"] = Case(lambda: put(node("VolumeCoefficients", coefficients)), bounces=4)
SAMPLES = 32
QUICK = ("box", "fog and a spot", "noise", "absorbing glass")


def make_scene(case: Case) -> Any:
    scene = make_stage()
    building.set_world((0.4, 0.5, 0.7) if case.lamp == GREY_LIGHT else (0.0, 0.0, 0.0), 1.0)
    if case.lamp != GREY_LIGHT:
        add_lamp(*LAMPS[case.lamp], location=(1.8, -1.2, 2.6), target=(0, 0.2, 0.5))
    case.build()
    return scene


def mark(names: tuple[str, ...] | dict[str, Case]) -> list[Any]:
    return [pytest.param(name, marks=[] if name in QUICK else [pytest.mark.slow]) for name in names]


def render(name: str, passes: tuple[str, ...] = ("Combined",)) -> tuple[Any, Any]:
    """Return what both engines make of a case: batches of each pass."""
    case = CASES[name]
    scene = make_scene(case)
    request = Request(
        *(*SMALL_SIZE, SAMPLES, case.bounces, case.batches),
        cycles_factor=CYCLES_FACTOR,
        integrator="PATH",
        passes=passes,
    )
    ours, cycles = render_both(scene, bpy.context.view_layer, request)
    return ours.passes, cycles.passes


@pytest.mark.parametrize("name", mark(CASES))
def test_a_volume_agrees(name: str) -> None:
    """Color and alpha of pixels by Mitsuba 3's bar; of tiles, where noise averages out, all."""
    ours, cycles = (passes["Combined"] for passes in render(name))
    assert ours[..., :3].max() > 0
    assert metrics.share_failing_pixels(ours, cycles, SAMPLES * CYCLES_FACTOR) <= MITSUBA_BAR
    assert metrics.share_failing_tiles(ours, cycles, SAMPLES * CYCLES_FACTOR, size=8) == 0.0


LIGHT_PASSES = ("Volume Direct", "Volume Indirect", "Diffuse Direct", "Diffuse Indirect", "Environment")
# Standard errors by which the means of a pass may lie apart: one in 10,000 of 30 comparisons of 22 degrees of freedom.
MOST_ERRORS = 6.0


@pytest.mark.parametrize("name", mark(("box", "scattered often", "absorbing glass")))
def test_the_means_of_passes_agree(name: str) -> None:
    """What media scatter is a part of its own, by how often it was scattered; what they let through counts as ever."""
    ours, cycles = render(name, ("Combined", *LIGHT_PASSES))
    for found in LIGHT_PASSES:
        means = [side[found][..., :3].mean(axis=(1, 2)) for side in (ours, cycles)]  # (batches, 3) each
        error = np.sqrt(sum(mean.var(axis=0, ddof=1) / len(mean) for mean in means))
        difference = means[0].mean(axis=0) - means[1].mean(axis=0)
        assert (np.abs(difference) <= MOST_ERRORS * error).all(), found
    assert ours["Volume Direct"].max() > 0 or name == "absorbing glass"


def make_slab(depth: float) -> Any:
    """Return a scene of a wall behind a metre of fog of an optical depth."""
    scene = building.start_scene(*SMALL_SIZE)
    grey = building.make_shader("Wall", "Diffuse", (0.8, 0.8, 0.8))
    building.link_object("Wall", building.make_plane("Wall", 40, 40), (0, 5, 0), rotation=(80, 0, 0), materials=[grey])
    fog = make_volume(node("VolumeScatter", {"Color": (1.0, 1.0, 1.0, 1.0), "Density": depth}))
    cube = building.make_mesh("Fog", bmesh.ops.create_cube, size=1.0)
    building.link_object("Fog", cube, materials=[fog]).scale = (40, 1, 40)
    building.add_camera((0, -6, 0), (0, 0, 0), 300)
    return scene


# Standard errors of a share of pixels, if those were independent: batches of Cycles are more even than that.
MOST_SHARE_ERRORS = 5.0


@pytest.mark.parametrize("marches", [True, False])
def test_cycles_depth_behind_fog_is_that_of_a_path_that_was_not_scattered(marches: bool) -> None:
    """Of the probability T = exp(-depth) where Cycles marches; from 5.0 on else of 1/4 T + 3/4 1/2: a path's chance to
    be scattered is led, by three quarters, to what paths before it found, and to one half as none was before."""
    depth, batches = 1.2, 8
    scene = make_slab(depth)
    request = Request(
        *(*SMALL_SIZE, 1, 0, batches),
        pixel_filter="BLACKMAN_HARRIS",
        filter_width=CENTRE_WIDTH,
        through_centre=True,
        passes=("Combined", "Depth"),
        marches=marches,
    )
    with matched_settings(scene, bpy.context.view_layer, request):
        seen = find_seen(render_batches(scene, bpy.context.view_layer, CYCLES, request).passes["Depth"])
    led = not marches and VERSION >= (5, 0)
    expected = np.exp(-depth) / 4 + 3 / 8 if led else np.exp(-depth)
    error = np.sqrt(expected * (1 - expected) / seen.size)
    assert abs(seen.mean() - expected) < MOST_SHARE_ERRORS * error


def test_what_lies_behind_fog_agrees_however_seldom_cycles_shows_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """And a depth that is wrong by 1% differs."""
    scene, kept = make_slab(4.0), []

    def keep(*arguments: Any) -> Any:
        kept.append(render_both(*arguments))
        return kept[0]

    monkeypatch.setattr(comparison, "render_both", keep)
    passes = comparison.compare_passes(scene, bpy.context.view_layer, *SMALL_SIZE)
    for name in ("Depth", "Position", "Object Index", "Material Index"):
        assert passes[name].share <= PASSES_BAR, name
    assert (passes["Depth"].ours < BACKGROUND_DEPTH).all()

    ours, cycles = kept[0]
    spoiled = replace(ours, passes=ours.passes | {"Depth": ours.passes["Depth"] * np.float32(1.01)})
    monkeypatch.setattr(comparison, "render_both", lambda *_: (spoiled, cycles))
    assert comparison.compare_passes(scene, bpy.context.view_layer, *SMALL_SIZE)["Depth"].share > 0.9
