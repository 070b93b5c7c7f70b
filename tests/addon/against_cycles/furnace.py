"""A white furnace: a sheet of small planes, one for each closure and roughness, under an even white world.

All lie in one plane, so that none sees another, and are looked at under one angle by a camera without perspective:
each shows how much light its closure sends on to that direction. Both engines render the same picture.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray

from addon.compare.cycles.rendering import Request, render_both
from addon.versions import VERSION, find_node_tree
from blend_scenes import building
from tests.addon.against_cycles.node_fixtures import add_node

CELL = 8  # pixels of a plane, each side
FAR = 100.0  # metres to the camera
COLOR = (1.0, 0.6, 0.3, 1.0)
ROUGHNESS = (0.0, 0.25, 0.5, 0.75, 1.0)

Make = Callable[[Any, float | None], Any]


def node(kind: str, varied: str = "Roughness", color: str = "Color", /, **settings: Any) -> Make:
    """Return what makes a shader node of a roughness (None: as in `settings`).

    settings : inputs by identifier, with underscores for blanks; properties in lower case
    """
    inputs = {name.replace("_", " "): value for name, value in settings.items() if not name.islower()}
    properties = {name: value for name, value in settings.items() if name.islower()}

    def make(tree: Any, roughness: float | None) -> Any:
        values = {color: COLOR, **inputs} if roughness is None else {color: COLOR, **inputs, varied: roughness}
        return add_node(tree, f"ShaderNodeBsdf{kind}", values, **properties).outputs[0]

    return make


def principled(varied: str = "Roughness", /, **settings: Any) -> Make:
    return node("Principled", varied, "Base Color", **settings)


def metallic(varied: str = "Roughness", /, **settings: Any) -> Make:
    return node("Metallic", varied, "Base Color", **settings)


TINT = (0.9, 0.5, 0.7, 1.0)
FURNACE: dict[str, Make] = {
    "diffuse": node("Diffuse"),
    "glossy": node("Anisotropic"),
    "glossy ggx": node("Anisotropic", distribution="GGX"),
    "glossy beckmann": node("Anisotropic", distribution="BECKMANN"),
    "glossy stretched": node("Anisotropic", Anisotropy=0.6, Rotation=0.15),
    "glossy beckmann stretched": node("Anisotropic", Anisotropy=-0.5, distribution="BECKMANN"),
    "glass": node("Glass", IOR=1.45),
    "glass ggx": node("Glass", IOR=1.45, distribution="GGX"),
    "glass beckmann": node("Glass", IOR=1.45, distribution="BECKMANN"),
    "refraction": node("Refraction", IOR=1.45, distribution="GGX"),
    "refraction beckmann": node("Refraction", IOR=1.45),
    "sheen": node("Sheen"),
    "velvet": node("Sheen", "Roughness", distribution="ASHIKHMIN"),
    "toon": node("Toon", "Size", Smooth=0.2),
    "principled": principled(),
    "principled ggx": principled(distribution="GGX"),
    "principled tinted": principled(Specular_Tint=TINT, Specular_IOR_Level=0.8, IOR=1.7),
    "metal": principled(Metallic=1.0, Specular_Tint=TINT),
    "stretched metal": principled(Metallic=1.0, Anisotropic=0.8, Anisotropic_Rotation=0.1),
    "transmission": principled(Transmission_Weight=1.0, IOR=1.45),
    "coat": principled("Coat Roughness", Coat_Weight=1.0, Coat_Tint=TINT),
    "half coat": principled(Coat_Weight=0.5, Coat_IOR=1.8, Coat_Roughness=0.3, Metallic=0.5),
    "sheen layer": principled("Sheen Roughness", Sheen_Weight=0.8, Sheen_Tint=TINT),
    "all layers": principled(
        Sheen_Weight=0.5, Coat_Weight=0.5, Coat_Roughness=0.3, Coat_Tint=TINT, Metallic=0.3, Transmission_Weight=0.3
    ),
}
if VERSION >= (4, 3):
    FURNACE |= {
        "rough base": principled("Diffuse Roughness"),
        "metallic": metallic(Edge_Tint=TINT),
        "metallic beckmann": metallic(Edge_Tint=TINT, distribution="BECKMANN", Anisotropy=0.5),
        "conductor": node("Metallic", "Roughness", "Edge Tint", fresnel_type="PHYSICAL_CONDUCTOR"),
    }

FILM = {"Thin_Film_Thickness": 420.0, "Thin_Film_IOR": 1.6}
if VERSION >= (5, 0):  # older ones have films on dielectrics alone, and fits of the eye's curves instead of the curves
    FURNACE |= {
        "film": principled(**FILM),
        "film tinted": principled(Specular_Tint=TINT, IOR=1.8, Thin_Film_Thickness=250.0),
        "film on its own": principled(IOR=1.0, **FILM),
        "film on metal": principled(Metallic=1.0, Specular_Tint=TINT, **FILM),
        "film on transmission": principled(Transmission_Weight=1.0, IOR=1.45, **FILM),
        "film on glass": node("Glass", IOR=1.45, Thin_Film_Thickness=900.0),
        "film on metallic": metallic(Edge_Tint=TINT, **FILM),
        "film on conductor": node("Metallic", "Roughness", "Edge Tint", fresnel_type="PHYSICAL_CONDUCTOR", **FILM),
    }


class Furnace(NamedTuple):
    """Mean colors (closures, roughnesses, 3) of both engines, and ours' and Cycles' standard errors."""

    ours: NDArray[np.float64]
    cycles: NDArray[np.float64]
    error: NDArray[np.float64]


def make_furnace(names: Sequence[str], roughness: Sequence[float], cosine: float) -> Any:
    """Build the scene, seen at `cosine` to the planes' normal; return its world."""
    columns, rows = len(roughness), len(names)
    scene = building.start_scene(columns * CELL, rows * CELL)
    building.set_world((1.0, 1.0, 1.0), 1.0)
    depth = 1.0 / cosine
    for row, name in enumerate(names):
        for column, value in enumerate(roughness):
            left, back = column - columns / 2, (rows / 2 - row) * depth
            corners = [(left, back - depth, 0), (left + 1, back - depth, 0), (left + 1, back, 0), (left, back, 0)]
            plane = building.new_mesh(f"{name} {value}", corners, [(0, 1, 2, 3)])
            building.link_object(plane.name, plane, materials=[make_material(FURNACE[name], value)])
    camera = building.add_camera((0, 0, 1), (0, 0, 0))
    camera.data.type, camera.data.ortho_scale, camera.data.clip_end = "ORTHO", max(columns, rows), 10 * FAR
    camera.location = Vector((0, -math.sqrt(1 - cosine**2), cosine)) * FAR
    camera.rotation_euler = (math.acos(cosine), 0, 0)
    return scene


def make_material(make: Make, roughness: float | None = None) -> Any:
    material = bpy.data.materials.new("Furnace")
    if VERSION < (5, 0):
        material.use_nodes = True
    tree = find_node_tree(material)
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(make(tree, roughness), output.inputs["Surface"])
    return material


def measure_furnace(
    names: Sequence[str], roughness: Sequence[float], cosine: float, samples: int, cycles_factor: int
) -> Furnace:
    """Render both engines, without bounces: what goes on sees the world."""
    scene = make_furnace(names, roughness, cosine)
    size = len(roughness) * CELL, len(names) * CELL
    request = Request(*size, samples, max_bounces=0, batches=1, cycles_factor=cycles_factor)
    both = [side.passes["Combined"][0, ..., :3] for side in render_both(scene, bpy.context.view_layer, request)]
    shape = (len(names), CELL, len(roughness), CELL, 3)
    # Pixels at borders hold both neighbours.
    inner = [image.astype(np.float64).reshape(shape)[:, 1:-1, :, 1:-1] for image in both]
    variance = sum(side.var(axis=(1, 3)) for side in inner)
    ours, cycles = (side.mean(axis=(1, 3)) for side in inner)
    return Furnace(ours, cycles, np.sqrt(variance / (CELL - 2) ** 2))
