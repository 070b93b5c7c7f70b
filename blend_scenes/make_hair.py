"""Hair: fur of particles, strands of a Curves object, and a brush, all lit from before and from behind.

The ball's fur is colored by melanin, more of it here than there, and varies from strand to strand; the tuft's strands
are of a color of their own, darker at the root (Curves Info); the brush's bristles are straight, and shine by the
simpler Hair BSDF, which reflects light and lets it through.
"""

from __future__ import annotations

import math
import random

import bpy

from blend_scenes import building

STRANDS, POINTS = 700, 6


def build() -> None:
    """Fill the scene: a ball of fur, a tuft, a brush, a lamp behind them and one in front."""
    scene = building.start_scene()
    scene.cycles_curves.subdivisions = 3
    building.set_world((0.5, 0.6, 0.8), 0.35)
    slate = building.make_shader("Slate", "Diffuse", (0.16, 0.17, 0.2))
    building.link_object("Table", building.make_backdrop("Table", 24, 9, 8, 2.0), (0, 2.0, 0), materials=[slate])
    add_ball()
    add_tuft()
    add_brush()
    building.add_light("Behind", "AREA", 420, (0.6, 3.4, 2.8), (0, 0, 0.6), (1.0, 0.9, 0.75), shape="DISK", size=0.8)
    building.add_light("Front", "AREA", 160, (-3.0, -4.0, 3.5), (0, 0, 0.6), (0.8, 0.9, 1.0), shape="DISK", size=1.5)
    building.add_camera((0, -6.2, 2.1), (-0.05, 0, 0.62), 46)


def make_principled_hair(name: str, parametrization: str, **inputs: float) -> bpy.types.Material:
    """Return a material of Principled Hair by Chiang's model."""
    material = building.make_shader(name, "HairPrincipled", (0.8, 0.8, 0.8))
    node = find_shader(material)
    node.model, node.parametrization = "CHIANG", parametrization
    building.set_inputs(node, {key.title().replace("_", " "): value for key, value in inputs.items()})
    return material


def find_shader(material: bpy.types.Material) -> bpy.types.Node:
    """Return the shader of a material that has one."""
    return next(node for node in material.node_tree.nodes if node.type.startswith("BSDF"))


def add_ball() -> None:
    """A ball of fur: guide hairs, and many more between them."""
    skin = building.make_shader("Skin", "Diffuse", (0.25, 0.15, 0.1))
    fur = make_principled_hair(
        "Fur", "MELANIN", melanin=0.45, melanin_redness=0.6, random_color=0.5, roughness=0.35, radial_roughness=0.4
    )
    ball = building.make_sphere("Ball", 0.5, 24)
    shown = building.link_object("Ball", ball, (-1.45, 0.1, 0.78), materials=[skin, fur])
    settings = shown.modifiers.new("Fur", "PARTICLE_SYSTEM").particle_system.settings
    settings.type, settings.count, settings.hair_length, settings.hair_step = "HAIR", 250, 0.26, 4
    settings.emit_from, settings.material = "FACE", 2
    settings.child_type, settings.rendered_child_count, settings.child_percent = "INTERPOLATED", 40, 4
    settings.render_step, settings.display_step = 3, 3
    settings.clump_factor, settings.roughness_2, settings.roughness_2_size = 0.5, 0.03, 0.5
    settings.brownian_factor = 0.02
    settings.radius_scale, settings.root_radius, settings.tip_radius = 0.01, 1.0, 0.2


def add_tuft() -> None:
    """A Curves object: strands that bend over, darker where they begin."""
    silk = make_principled_hair("Silk", "COLOR", roughness=0.25, radial_roughness=0.35, coat=0.3)
    tree, shader = silk.node_tree, find_shader(silk)
    ramp, info = tree.nodes.new("ShaderNodeValToRGB"), tree.nodes.new("ShaderNodeHairInfo")
    ramp.color_ramp.elements[0].color = (0.1, 0.25, 0.5, 1.0)
    ramp.color_ramp.elements[1].color = (0.85, 0.75, 0.95, 1.0)
    tree.links.new(info.outputs["Intercept"], ramp.inputs["Fac"])
    tree.links.new(ramp.outputs["Color"], shader.inputs["Color"])
    chance = random.Random(3)
    data = bpy.data.hair_curves.new("Tuft")
    data.add_curves([POINTS] * STRANDS)
    points, radii = [], []
    for _ in range(STRANDS):
        around, out = chance.uniform(0, 2 * math.pi), math.sqrt(chance.random())
        reach, height = 0.7 * out + chance.uniform(-0.08, 0.08), 1.15 - 0.35 * out + chance.uniform(-0.1, 0.1)
        for step in range(POINTS):
            up = step / (POINTS - 1)
            way = 0.12 * out + reach * up**2
            points += [way * math.cos(around), way * math.sin(around), height * (up + 0.45 * out * (up - up**3))]
            radii.append(0.008 * (1.0 - 0.7 * up))
    data.attributes["position"].data.foreach_set("vector", points)
    data.attributes.new("radius", "FLOAT", "POINT").data.foreach_set("value", radii)
    building.link_object("Tuft", data, (0.1, 0.1, 0), materials=[silk])


def add_brush() -> None:
    """A handle with straight bristles of nylon."""
    wood = building.make_principled("Wood", (0.4, 0.2, 0.09), roughness=0.4)
    handle = building.make_box("Handle", 0.9, 0.36, 0.14)
    shown = building.link_object("Handle", handle, (1.5, -0.1, 0.06), rotation=(0, 0, -20), materials=[wood])
    building.add_modifier(shown, "BEVEL", "Round", width=0.04, segments=3)
    data = bpy.data.hair_curves.new("Bristles")
    rows, columns = 12, 34
    data.add_curves([2] * (rows * columns))
    points = []
    for row in range(rows):
        for column in range(columns):
            x, y = 0.82 * (column / (columns - 1) - 0.5), 0.28 * (row / (rows - 1) - 0.5)
            points += [x, y, 0.1, 1.2 * x, 1.4 * y, 0.75]
    data.attributes["position"].data.foreach_set("vector", points)
    radii = [0.006] * (2 * rows * columns)
    data.attributes.new("radius", "FLOAT", "POINT").data.foreach_set("value", radii)
    building.link_object("Bristles", data, (1.5, -0.1, 0.06), rotation=(0, 0, -20), materials=[make_nylon()])


def make_nylon() -> bpy.types.Material:
    """Return a material that half reflects light, and half lets it through."""
    nylon = building.make_shader("Nylon", "Hair", (0.95, 0.55, 0.15))
    tree, reflection = nylon.node_tree, find_shader(nylon)
    through, mix = tree.nodes.new("ShaderNodeBsdfHair"), tree.nodes.new("ShaderNodeMixShader")
    through.component = "Transmission"
    for node in (reflection, through):
        building.set_inputs(node, {"Color": (0.95, 0.55, 0.15), "RoughnessU": 0.25, "RoughnessV": 0.4})
    output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    tree.links.new(reflection.outputs[0], mix.inputs[1])
    tree.links.new(through.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    return nylon


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "hair.blend")
