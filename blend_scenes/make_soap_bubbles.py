"""Thin films: soap bubbles, whose walls are thinner towards the top; a puddle of oil; a beetle's wing case.

A bubble is one surface: a film with air on both sides, so that light goes straight through it and its
reflection is all interference. Oil lies on wet asphalt, and lacquer on the dark case of a ball.
"""

from __future__ import annotations

from typing import Any

import bpy

from blend_scenes import building
from blend_scenes.shader_nodes import add_node, open_tree

# Of real soap 1.33: this wall mirrors three times as much, which shows more.
SOAP, WATER, OIL = 1.6, 1.33, 1.5
# Centres and radii.
BUBBLES = (
    ((-1.05, 0.1, 1.25), 0.78),
    ((0.55, 0.5, 1.75), 0.5),
    ((1.35, -0.2, 1.05), 0.6),
    ((0.25, -0.6, 0.75), 0.34),
    ((-0.05, -0.2, 1.95), 0.2),
    ((-1.9, -0.5, 0.45), 0.22),
    ((2.05, -0.6, 1.85), 0.26),
)


def build() -> None:
    """Fill the scene: bubbles before a dark wall, over a wet floor, and windows of light that they mirror."""
    building.start_scene()
    building.set_world((0.55, 0.68, 0.9), 1.0)
    add_floor()
    for number, (place, radius) in enumerate(BUBBLES):
        name = f"Bubble {number + 1}"
        sphere = building.make_sphere(name, radius, 64)
        building.link_object(name, sphere, place, materials=[make_soap(name, 260.0 + 35.0 * number)])
    for name, place, energy, width, height in (
        ("Left window", (-5.0, -3.5, 3.2), 240, 3.0, 4.0),
        ("Right window", (5.0, -2.5, 3.2), 200, 2.5, 4.0),
        ("Top window", (0.0, -0.5, 6.5), 160, 5.0, 3.5),
    ):
        building.add_light(name, "AREA", energy, place, (0, 0, 1.1), shape="RECTANGLE", size=width, size_y=height)
    building.add_camera((0, -6.4, 1.75), (0.05, 0, 1.1), 45)


def make_film(name: str, color: building.Color, film: float, thickness: Any, **inputs: float) -> bpy.types.Material:
    """Return a material under a film of the index `film`; thickness : a function that adds nodes and returns the
    film's, in nanometres."""
    material = building.make_principled(name, color, **inputs)
    tree = open_tree(material)
    shader = tree.nodes["Principled BSDF"]
    shader.inputs["Thin Film IOR"].default_value = film
    tree.links.new(thickness(tree), shader.inputs["Thin Film Thickness"])
    return material


def make_soap(name: str, thinnest: float) -> bpy.types.Material:
    """Return a wall of water that gravity has drawn down: `thinnest` at the top, with swirls."""

    def drain(tree: Any) -> Any:
        place = add_node(tree, "ShaderNodeTexCoord").outputs["Generated"]
        swirl = add_node(
            tree, "ShaderNodeTexNoise", {"Vector": place, "Scale": 2.2, "Detail": 2.0, "Distortion": 1.6}
        ).outputs[0]
        height = add_node(tree, "ShaderNodeSeparateXYZ", {"Vector": place}).outputs["Z"]
        low = add_node(tree, "ShaderNodeMath", {0: swirl, 1: 0.7, 2: height}, operation="MULTIPLY_ADD").outputs[0]
        inputs = {"Value": low, "From Min": 0.1, "From Max": 1.5, "To Min": thinnest + 420.0, "To Max": thinnest}
        return add_node(tree, "ShaderNodeMapRange", inputs).outputs[0]

    return make_film(name, (1, 1, 1), SOAP, drain, transmission_weight=1.0, ior=1.0, roughness=0.0)


def add_floor() -> None:
    """Asphalt, black and wet, on which oil has spread in rings."""

    def spread(tree: Any) -> Any:
        place = add_node(tree, "ShaderNodeTexCoord").outputs["Object"]
        waves = add_node(
            tree, "ShaderNodeTexNoise", {"Vector": place, "Scale": 0.9, "Detail": 3.0, "Distortion": 0.8}
        ).outputs[0]
        away = add_node(tree, "ShaderNodeVectorMath", {0: place, 1: (-0.2, -1.2, 0.0)}, operation="DISTANCE")
        inputs = {"Value": away.outputs["Value"], "From Max": 2.3, "To Min": 520.0, "To Max": 0.0}
        thick = add_node(tree, "ShaderNodeMapRange", inputs).outputs[0]
        scale = {"Value": waves, "From Min": 0.3, "From Max": 0.7, "To Min": 0.55, "To Max": 1.35}
        rough = add_node(tree, "ShaderNodeMapRange", scale).outputs[0]
        return add_node(tree, "ShaderNodeMath", {0: thick, 1: rough}, operation="MULTIPLY").outputs[0]

    asphalt = make_film("Oil on asphalt", (0.02, 0.02, 0.022), OIL, spread, roughness=0.25, ior=WATER)
    backdrop = building.make_backdrop("Floor", 30, 6, 8, 2.5)
    building.link_object("Floor", backdrop, materials=[asphalt])


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "soap_bubbles.blend")
