"""Materials: two rows of balls on a table, each of another surface, and Suzanne in a textured one."""

from __future__ import annotations

from typing import Any

import bmesh

from blend_scenes import building

RADIUS = 0.42
# What each ball is made of: Principled inputs, or a shader node of its own.
PRINCIPLED: dict[str, tuple[building.Color, dict[str, float]]] = {
    "Car paint": ((0.45, 0.02, 0.03), {"metallic": 0.6, "roughness": 0.45, "coat_weight": 1.0}),
    "Velvet": ((0.05, 0.07, 0.3), {"roughness": 0.8, "sheen_weight": 1.0, "sheen_roughness": 0.4}),
    "Brushed steel": ((0.6, 0.6, 0.62), {"metallic": 1.0, "roughness": 0.4, "anisotropic": 0.9}),
    "Gold": ((1.0, 0.72, 0.3), {"metallic": 1.0, "roughness": 0.2}),
    "Plastic": ((0.1, 0.5, 0.2), {"roughness": 0.25, "specular_ior_level": 0.8}),
    "Tinted glass": ((0.8, 0.95, 0.9), {"transmission_weight": 1.0, "roughness": 0.0, "ior": 1.45}),
    "Wax": ((0.85, 0.65, 0.4), {"roughness": 0.5, "transmission_weight": 0.4, "coat_weight": 0.3}),
}


def build() -> None:
    """Fill the scene."""
    building.start_scene(640, 360)
    building.set_world((0.75, 0.85, 1.0), 0.5)
    table = building.make_shader("Slate", "Diffuse", (0.3, 0.3, 0.32), roughness=0.8)
    building.link_object("Table", building.make_plane("Table", 24, 24), materials=[table])
    materials = [make_principled(name, *said) for name, said in PRINCIPLED.items()]
    materials += [make_clay(), make_frosted(), make_felt()]
    for number, material in enumerate(materials):
        row, column = divmod(number, 5)
        ball = building.make_sphere(material.name, RADIUS, 64)
        place = (1.05 * column - 2.9 + 0.25 * row, 1.1 - 1.15 * row, RADIUS + 0.001)
        building.link_object(material.name, ball, place, materials=[material])
    add_suzanne()
    building.add_light(
        "Window", "AREA", 260, (-3.0, -2.5, 4.5), (0, 0.4, 0.3), (1, 0.95, 0.9), shape="SQUARE", size=1.5
    )
    building.add_light("Lamp", "POINT", 60, (3.5, -2.0, 2.5), (0, 0, 0), (1, 0.8, 0.6), shadow_soft_size=0.1)
    building.add_camera((0.2, -6.4, 2.6), (0.12, 0.3, 0.42), 36)


def make_principled(name: str, color: building.Color, inputs: dict[str, float]) -> Any:
    known = {key: value for key, value in inputs.items() if key != "specular_ior_level"}
    material = building.make_principled(name, color, **known)
    if "specular_ior_level" in inputs:
        node = material.node_tree.nodes["Principled BSDF"]
        building.set_inputs(node, {"Specular IOR Level": inputs["specular_ior_level"]})
    return material


def make_clay() -> Any:
    return building.make_shader("Clay", "Diffuse", (0.6, 0.3, 0.18), roughness=1.0)


def make_frosted() -> Any:
    """Glass with Beckmann's facets."""
    material = building.make_shader("Frosted glass", "Glass", (1.0, 1.0, 1.0), roughness=0.3, ior=1.5)
    material.node_tree.nodes["Glass BSDF"].distribution = "BECKMANN"
    return material


def make_felt() -> Any:
    """A mix of a matte base and sheen."""
    material = building.make_shader("Felt", "Diffuse", (0.25, 0.08, 0.3))
    tree = material.node_tree
    base, output = tree.nodes["Diffuse BSDF"], tree.nodes["Material Output"]
    sheen, total = tree.nodes.new("ShaderNodeBsdfSheen"), tree.nodes.new("ShaderNodeMixShader")
    building.set_inputs(sheen, {"Color": (0.9, 0.7, 0.9), "Roughness": 0.4})
    building.set_inputs(total, {"Fac": 0.4})
    tree.links.new(base.outputs[0], total.inputs[1])
    tree.links.new(sheen.outputs[0], total.inputs[2])
    tree.links.new(total.outputs[0], output.inputs["Surface"])
    return material


def add_suzanne() -> None:
    """A monkey's head of glazed porcelain: noise drives its base color and how rough it is."""
    mesh = building.make_mesh("Suzanne", bmesh.ops.create_monkey, smooth=True)
    material = building.make_principled("Porcelain", (0.8, 0.8, 0.8), coat_weight=0.5)
    tree = material.node_tree
    noise, ramp = tree.nodes.new("ShaderNodeTexNoise"), tree.nodes.new("ShaderNodeValToRGB")
    building.set_inputs(noise, {"Scale": 4.0, "Detail": 3.0})
    ramp.color_ramp.elements[0].color = (0.05, 0.12, 0.4, 1.0)
    ramp.color_ramp.elements[0].position = 0.42
    ramp.color_ramp.elements[1].color = (0.85, 0.82, 0.75, 1.0)
    ramp.color_ramp.elements[1].position = 0.55
    principled = tree.nodes["Principled BSDF"]
    tree.links.new(noise.outputs["Fac"], ramp.inputs["Fac"])
    tree.links.new(ramp.outputs["Color"], principled.inputs["Base Color"])
    tree.links.new(noise.outputs["Fac"], principled.inputs["Roughness"])
    thing = building.link_object(
        "Suzanne", mesh, (2.55, 0.35, 0.76), rotation=(-10, 0, -28), scale=0.78, materials=[material]
    )
    building.subdivide(thing, 2)


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "materials.blend")
