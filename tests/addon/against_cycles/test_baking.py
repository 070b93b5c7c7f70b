"""Baked textures in our engine and in Cycles of the same Blender: a cube and a smooth ball over a floor."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest

from tests.addon.against_cycles.node_fixtures import add_node

pytestmark = pytest.mark.usefixtures("registered_addon")

SIZE = 24
OURS, CYCLES = "REFERENCE_RAYTRACER", "CYCLES"
OUR_SAMPLES, CYCLES_SAMPLES = 128, 512
# What noise leaves at these samples: of means over a texture, and of pixels, most of it at the checker's edges.
MEAN_BAR, PIXEL_BAR = 0.02, 0.02

CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "combined": ("COMBINED", {}),
    "without indirect light": ("COMBINED", {"pass_filter": {"EMIT", "DIFFUSE", "DIRECT"}}),
    "diffuse": ("DIFFUSE", {}),
    "diffuse color": ("DIFFUSE", {"pass_filter": {"COLOR"}}),
    "direct light": ("DIFFUSE", {"pass_filter": {"DIRECT"}}),
    "indirect light": ("DIFFUSE", {"pass_filter": {"INDIRECT", "COLOR"}}),
    "glossy": ("GLOSSY", {}),
    "occlusion": ("AO", {}),
    "tangent normals": ("NORMAL", {}),
    "object normals": ("NORMAL", {"normal_space": "OBJECT"}),
    "uv": ("UV", {}),
    "emission": ("EMIT", {}),
}


def make_checked(name: str, color: tuple[float, float, float]) -> Any:
    """Return a Principled material of two colors in squares that also shines."""
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    tree = material.node_tree
    principled = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeBsdfPrincipled")
    colors = {"Color1": (*color, 1.0), "Color2": (0.2, 0.8, 0.3, 1.0)}
    checker = add_node(tree, "ShaderNodeTexChecker", {"Scale": 4.0, **colors})
    place = add_node(tree, "ShaderNodeTexCoord", {})
    tree.links.new(place.outputs["UV"], checker.inputs["Vector"])
    tree.links.new(checker.outputs["Color"], principled.inputs["Base Color"])
    principled.inputs["Emission Color"].default_value = (0.1, 0.2, 0.4, 1.0)
    principled.inputs["Emission Strength"].default_value = 0.3
    return material


@pytest.fixture(params=["Cube", "Ball"])
def thing(request: pytest.FixtureRequest) -> Any:
    """Return one of two things on the stage."""
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_plane_add(size=12, location=(0, 0, -1.2))
    bpy.ops.mesh.primitive_uv_sphere_add(radius=1, location=(2.2, 0, 0))
    bpy.context.object.name = "Ball"
    bpy.ops.object.shade_smooth()
    for name, color in (("Cube", (0.8, 0.3, 0.1)), ("Ball", (0.1, 0.3, 0.9))):
        bpy.data.objects[name].data.materials.clear()
        bpy.data.objects[name].data.materials.append(make_checked(name, color))
    scene.reference_raytracer.samples, scene.reference_raytracer.workers = OUR_SAMPLES, 1
    scene.cycles.samples, scene.cycles.use_adaptive_sampling, scene.cycles.use_denoising = CYCLES_SAMPLES, False, False
    return bpy.data.objects[request.param]


def bake(engine: str, thing: Any, kind: str, options: dict[str, Any]) -> np.ndarray:
    """Bake with one of the engines into a new image; return it (pixels, 4)."""
    bpy.context.scene.render.engine = engine
    image = bpy.data.images.new(engine, SIZE, SIZE, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    nodes = thing.data.materials[0].node_tree.nodes
    node = nodes.new("ShaderNodeTexImage")
    node.image, nodes.active = image, node
    for other in bpy.context.view_layer.objects:
        other.select_set(other == thing)
    bpy.context.view_layer.objects.active = thing
    assert bpy.ops.object.bake(type=kind, margin=0, **options) == {"FINISHED"}
    pixels = np.empty(SIZE * SIZE * 4, np.float32)
    image.pixels.foreach_get(pixels)
    nodes.remove(node)
    return pixels.reshape(-1, 4)


@pytest.mark.parametrize("name", CASES)
def test_baked_textures_agree(thing: Any, name: str) -> None:
    kind, options = CASES[name]
    ours = bake(OURS, thing, kind, options)
    theirs = bake(CYCLES, thing, kind, options)
    baked = bake(OURS, thing, "POSITION", {})[:, 3] > 0  # Cycles leaves other pixels as they come
    ours, theirs = ours[baked, :3], theirs[baked, :3]
    assert baked.sum() > 200
    assert np.abs(ours.mean(axis=0) / theirs.mean(axis=0) - 1).max() < MEAN_BAR
    assert np.sqrt(((ours - theirs) ** 2).mean()) < PIXEL_BAR


def test_positions_agree(thing: Any) -> None:
    """With one sample: Cycles adds positions up, and does not divide them by the number of samples."""
    bpy.context.scene.cycles.samples = 1
    ours, theirs = (bake(engine, thing, "POSITION", {}) for engine in (OURS, CYCLES))
    baked = ours[:, 3] > 0
    np.testing.assert_allclose(ours[baked, :3], theirs[baked, :3], atol=1e-5)
