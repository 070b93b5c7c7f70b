"""Displacement: shader nodes move geometry: cracked ground, a spiky ball, a ball with craters, a dented shield."""

from __future__ import annotations

from typing import Any

import bpy

from blend_scenes import building
from blend_scenes.shader_nodes import add_node


def build() -> None:
    """Fill the scene: four materials whose textures move what they cover, in low light."""
    building.start_scene()
    building.set_world((0.5, 0.6, 0.8), 0.35)
    add_ground()
    add_ball("Moon", (-1.15, 0.1, 0.95), (0.36, 0.35, 0.33), 0.2, make_craters)
    add_ball("Burr", (1.15, 0.3, 0.95), (0.75, 0.3, 0.08), 0.5, make_spikes)
    add_shield()
    building.add_light("Sun", "SUN", 4.0, (-6.0, -3.0, 3.2), (0, 0, 0), (1.0, 0.92, 0.8), angle=0.02)
    building.add_camera((0.0, -7.6, 3.1), (0.0, 0.2, 0.8), 50)


def displace(material: bpy.types.Material, height: bpy.types.NodeSocket, scale: float) -> None:
    """Let a height move the surface of a material."""
    tree = material.node_tree
    moved = add_node(tree, "ShaderNodeDisplacement", {"Height": height, "Midlevel": 0.0, "Scale": scale})
    output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    tree.links.new(moved.outputs[0], output.inputs["Displacement"])
    material.displacement_method = "DISPLACEMENT"


def add_ground() -> None:
    """A plane of dried mud, which cracks along the edges of cells."""
    mud = building.make_principled("Mud", (0.36, 0.25, 0.16), roughness=0.85)
    tree = mud.node_tree
    place = tree.nodes.new("ShaderNodeTexCoord").outputs["Object"]
    cells = {"Vector": place, "Scale": 1.6}
    edge = add_node(tree, "ShaderNodeTexVoronoi", cells, feature="DISTANCE_TO_EDGE").outputs["Distance"]
    ramp = add_node(tree, "ShaderNodeMapRange", {"Value": edge, "From Min": 0.01, "From Max": 0.09})
    noise = add_node(tree, "ShaderNodeTexNoise", {"Vector": place, "Scale": 9.0, "Detail": 4.0})
    height = add_node(
        tree, "ShaderNodeMath", {0: noise.outputs[0], 1: 0.25, 2: ramp.outputs[0]}, operation="MULTIPLY_ADD"
    )
    displace(mud, height.outputs[0], 0.12)
    ground = building.link_object("Ground", building.make_plane("Ground", 14, 14), (0, 1.5, 0), materials=[mud])
    building.subdivide(ground, 9, "SIMPLE")


def add_ball(name: str, place: tuple[float, float, float], color: Any, scale: float, make_height: Any) -> None:
    """Add a ball whose geometry alone a texture moves."""
    material = building.make_principled(name, color, roughness=0.6)
    displace(material, make_height(material.node_tree), scale)
    mesh = building.make_sphere(name, 0.75, 48)
    building.subdivide(building.link_object(name, mesh, place, materials=[material]), 2)


def make_craters(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
    """Round craters of all sizes: a smooth minimum of distances, over three octaves."""
    place = tree.nodes.new("ShaderNodeTexCoord").outputs["Object"]
    inputs = {"Vector": place, "Scale": 2.6, "Detail": 2.0, "Roughness": 0.45, "Smoothness": 0.35}
    return add_node(tree, "ShaderNodeTexVoronoi", inputs, feature="SMOOTH_F1").outputs["Distance"]


def make_spikes(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
    """Spikes where scattered points are near."""
    place = tree.nodes.new("ShaderNodeTexCoord").outputs["Object"]
    near = add_node(tree, "ShaderNodeTexVoronoi", {"Vector": place, "Scale": 3.4}).outputs["Distance"]
    steep = add_node(
        tree, "ShaderNodeMapRange", {"Value": near, "From Min": 0.0, "From Max": 0.55, "To Min": 1.0, "To Max": 0.0}
    )
    return add_node(tree, "ShaderNodeMath", {0: steep.outputs[0], 1: 3.0}, operation="POWER").outputs[0]


def add_shield() -> None:
    """A gilded disc leaning at the back, into which rings and dents are beaten."""
    gold = building.make_principled("Gold", (0.95, 0.7, 0.3), roughness=0.22, metallic=1.0)
    tree = gold.node_tree
    place = tree.nodes.new("ShaderNodeTexCoord").outputs["Object"]
    wave = {"Vector": place, "Scale": 1.4, "Distortion": 0.0}
    rings = add_node(tree, "ShaderNodeTexWave", wave, wave_type="RINGS", rings_direction="Z").outputs["Fac"]
    dents = add_node(tree, "ShaderNodeTexVoronoi", {"Vector": place, "Scale": 7.0}, feature="SMOOTH_F1")
    height = add_node(
        tree, "ShaderNodeMath", {0: dents.outputs["Distance"], 1: 0.35, 2: rings}, operation="MULTIPLY_ADD"
    )
    displace(gold, height.outputs[0], 0.09)
    profile = tuple((radius / 60, 0.12 - 0.12 * (radius / 60) ** 2) for radius in range(61))
    disc = building.make_lathe("Shield", profile, 128)
    shield = building.link_object("Shield", disc, (0.0, 1.6, 1.1), rotation=(72, 0, 0), materials=[gold])
    building.subdivide(shield, 1)


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "displacement.blend")
