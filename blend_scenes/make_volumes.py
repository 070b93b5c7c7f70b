"""Volumes: haze in the air that shows the beam of a lamp, a cloud, smoke of voxels, a fire, and glass that is colored
through and through.

The cloud and the fire are noise in boxes, the smoke is a grid that geometry nodes make, and three balls of one glass
are the darker the larger they are.
"""

from __future__ import annotations

from typing import Any

import bmesh
import bpy

from blend_scenes import building
from blend_scenes.shader_nodes import add_node, connect, make_material, open_tree


def build() -> None:
    """Fill the scene: a floor, haze, a spot, and four things that light goes through."""
    building.start_scene()
    building.set_world((0.35, 0.45, 0.7), 0.35)
    add_haze()
    slate = building.make_shader("Slate", "Diffuse", (0.2, 0.2, 0.22))
    building.link_object("Floor", building.make_backdrop("Floor", 24, 9, 8, 2.0), (0, 2.5, 0), materials=[slate])
    add_cloud()
    add_smoke()
    add_fire()
    add_glass()
    building.add_light(
        "Beam", "SPOT", 4000, (-4.2, -0.6, 4.6), (-0.9, 0.3, 0.8), (1.0, 0.85, 0.65),
        spot_size=0.42, spot_blend=0.2, shadow_soft_size=0.05,
    )  # fmt: skip
    building.add_light("Back", "AREA", 300, (3.0, 3.2, 3.4), (0.4, 0, 0.6), (0.6, 0.75, 1.0), shape="DISK", size=1.5)
    building.add_camera((0, -7.0, 2.0), (0.1, 0, 0.85), 50)
    building.allow_bounces("volume", 2)


def add_haze() -> None:
    """Thin air everywhere, which shows where the lamp shines."""
    tree = open_tree(bpy.context.scene.world)
    haze = add_node(tree, "ShaderNodeVolumeScatter", {"Density": 0.025, "Anisotropy": 0.3, "Color": (1, 1, 1, 1)})
    tree.links.new(haze.outputs[0], tree.nodes["World Output"].inputs["Volume"])


def find_billows(tree: Any, scale: float, size: float) -> Any:
    """Return an output of noise, 0 to 1, that fades towards a distance of `size` from the object's origin."""
    place = add_node(tree, "ShaderNodeTexCoord").outputs["Object"]
    noise = add_node(tree, "ShaderNodeTexNoise", {"Vector": place, "Scale": scale, "Detail": 1.0}).outputs[0]
    far = add_node(tree, "ShaderNodeVectorMath", {"Vector": place}, operation="LENGTH").outputs["Value"]
    inside = add_node(tree, "ShaderNodeMapRange", {"Value": far, "From Max": size, "To Min": 0.35, "To Max": -0.25})
    thick = add_node(tree, "ShaderNodeMath", operation="ADD")
    tree.links.new(noise, thick.inputs[0])
    tree.links.new(inside.outputs[0], thick.inputs[1])
    shape = {"Value": thick.outputs[0], "From Min": 0.5, "From Max": 0.75}
    return add_node(tree, "ShaderNodeMapRange", shape).outputs[0]


def add_cloud() -> None:
    """A cloud of noise, white, where the beam ends."""
    material, tree = make_material("Cloud")
    dense = add_node(tree, "ShaderNodeMath", operation="MULTIPLY")
    tree.links.new(find_billows(tree, 2.2, 0.85), dense.inputs[0])
    dense.inputs[1].default_value = 9.0
    inputs = {"Color": (0.97, 0.97, 0.97, 1), "Density": dense.outputs[0], "Anisotropy": 0.2}
    connect(tree, add_node(tree, "ShaderNodeVolumePrincipled", inputs), "Volume")
    cube = building.make_mesh("Cloud", bmesh.ops.create_cube, size=1.7)
    building.link_object("Cloud", cube, (-0.95, 0.3, 0.95), materials=[material])


def add_smoke() -> None:
    """Voxels of geometry nodes: a column that thins out, of smoke that an object's own material colors."""
    material, tree = make_material("Smoke")
    inputs = {"Color": (0.5, 0.28, 0.12, 1), "Density": 5.0}
    connect(tree, add_node(tree, "ShaderNodeVolumePrincipled", inputs), "Volume")
    nodes = bpy.data.node_groups.new("Smoke", "GeometryNodeTree")
    nodes.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    place = add_node(nodes, "GeometryNodeInputPosition").outputs[0]
    noise = add_node(nodes, "ShaderNodeTexNoise", {"Vector": place, "Scale": 3.0}).outputs[0]
    flat = add_node(nodes, "ShaderNodeVectorMath", {"Vector": place}, operation="MULTIPLY")
    flat.inputs[1].default_value = (1.0, 1.0, 0.45)
    far = add_node(nodes, "ShaderNodeVectorMath", {"Vector": flat.outputs[0]}, operation="LENGTH").outputs["Value"]
    difference = add_node(nodes, "ShaderNodeMath", operation="SUBTRACT")
    nodes.links.new(noise, difference.inputs[0])
    nodes.links.new(far, difference.inputs[1])
    shape = add_node(nodes, "ShaderNodeMapRange", {"Value": difference.outputs[0], "From Max": 0.3})
    size = {f"Resolution {axis}": count for axis, count in zip("XYZ", (20, 20, 40), strict=True)}
    cube = add_node(
        nodes, "GeometryNodeVolumeCube",
        {"Density": shape.outputs[0], "Min": (-0.6, -0.6, -1.3), "Max": (0.6, 0.6, 1.3), **size},
    )  # fmt: skip
    painted = add_node(nodes, "GeometryNodeSetMaterial", {"Geometry": cube.outputs[0], "Material": material})
    end = nodes.nodes.new("NodeGroupOutput")
    nodes.links.new(painted.outputs[0], end.inputs[0])
    smoke = building.link_object("Smoke", bpy.data.meshes.new("Smoke"), (0.45, 0.8, 1.25))
    building.add_modifier(smoke, "NODES", "Smoke", node_group=nodes)


def add_fire() -> None:
    """A flame: a black body, hotter where the noise is denser."""
    material, tree = make_material("Fire")
    heat = find_billows(tree, 2.6, 0.9)
    warm = add_node(tree, "ShaderNodeMapRange", {"Value": heat, "To Max": 2800.0})
    inputs = {"Density": 0.0, "Blackbody Intensity": 1.0, "Temperature": warm.outputs[0]}
    connect(tree, add_node(tree, "ShaderNodeVolumePrincipled", inputs), "Volume")
    cube = building.make_mesh("Fire", bmesh.ops.create_cube, size=1.6)
    fire = building.link_object("Fire", cube, (1.75, 0.5, 0.66), materials=[material])
    fire.scale = (0.4, 0.4, 0.8)


def add_glass() -> None:
    """Three balls of clear glass, colored by what is inside: the larger, the darker."""
    for number, radius in enumerate((0.16, 0.24, 0.34)):
        name = f"Ball {number + 1}"
        material, tree = make_material(name)
        connect(tree, add_node(tree, "ShaderNodeBsdfGlass", {"Roughness": 0.0, "IOR": 1.45}))
        inputs = {"Color": (0.25, 0.75, 0.55, 1), "Density": 3.0}
        connect(tree, add_node(tree, "ShaderNodeVolumeAbsorption", inputs), "Volume")
        place = (0.05 + 0.55 * number, -1.2, radius + 0.001)
        building.link_object(name, building.make_sphere(name, radius, 48), place, materials=[material])


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "volumes.blend")
