"""HDRI: light from a picture of all directions, painted by this script: a sun in the haze, blue sky, warm ground."""

from __future__ import annotations

import bpy
import numpy as np

from blend_scenes import building

WIDTH, HEIGHT = 256, 128
SUN = (75, 86)  # column and row of its centre
SUN_RADIUS = 1.0  # pixels


def paint_sky() -> bpy.types.Image:
    """Return an equirectangular float image, packed into the file; row 0 is straight down."""
    row, column = np.mgrid[0:HEIGHT, 0:WIDTH]
    height = np.sin(((row + 0.5) / HEIGHT - 0.5) * np.pi)[..., np.newaxis]
    zenith, horizon, earth = (np.array(color) for color in ((0.10, 0.22, 0.55), (0.85, 0.80, 0.75), (0.20, 0.14, 0.09)))
    haze = np.exp(-6.0 * np.abs(height))
    color = np.where(height > 0, zenith + (horizon - zenith) * haze, earth + (horizon - earth) * haze**4)
    away = np.hypot(column - SUN[0], row - SUN[1])[..., np.newaxis]
    color = color + np.array([6.0, 4.2, 2.4]) * np.exp(-away / 6.0)
    color = np.where(away <= SUN_RADIUS, np.array([1500.0, 1200.0, 900.0]), color)
    clouds = np.sin(column * 8 * np.pi / WIDTH) * np.sin(row * 18 * np.pi / HEIGHT)
    color = color * (1.0 + 0.25 * np.clip(clouds, 0, 1)[..., np.newaxis])
    image = bpy.data.images.new("Painted sky", WIDTH, HEIGHT, float_buffer=True)
    pixels = np.concatenate([color, np.ones((HEIGHT, WIDTH, 1))], axis=2)
    image.pixels.foreach_set(pixels.astype(np.float32).ravel())
    image.pack()
    return image


def set_picture(image: bpy.types.Image, turn: float) -> None:
    """Wrap an image round the world, turned about the vertical, radians."""
    world = bpy.data.worlds.new("Picture of the sky")
    if world.node_tree is None:  # always there from Blender 5.0 on
        world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    texture, mapping = nodes.new("ShaderNodeTexEnvironment"), nodes.new("ShaderNodeMapping")
    coordinates = nodes.new("ShaderNodeTexCoord")
    texture.image = image
    mapping.inputs["Rotation"].default_value = (0.0, 0.0, turn)
    links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    links.new(mapping.outputs["Vector"], texture.inputs["Vector"])
    links.new(texture.outputs["Color"], nodes["Background"].inputs["Color"])
    bpy.context.scene.world = world


def build() -> None:
    """Fill the scene: balls from matt to mirror, and one of glass, under the painted sky alone."""
    building.start_scene()
    set_picture(paint_sky(), 0.6)
    ground = building.make_shader("Ground", "Diffuse", (0.55, 0.5, 0.44))
    building.link_object("Ground", building.make_plane("Ground", 30, 30), materials=[ground])
    balls = {
        "Plaster": building.make_shader("Plaster", "Diffuse", (0.8, 0.78, 0.74)),
        "Lacquer": building.make_principled("Lacquer", (0.55, 0.06, 0.04), roughness=0.25),
        "Brass": building.make_principled("Brass", (0.9, 0.62, 0.26), metallic=1.0, roughness=0.3),
        "Chrome": building.make_shader("Chrome", "Glossy", (0.95, 0.95, 0.95), roughness=0.0),
        "Glass": building.make_shader("Glass", "Glass", (1.0, 1.0, 1.0), roughness=0.0, ior=1.45),
    }
    mesh = building.make_sphere("Ball", 0.62, 48)
    for number, (name, material) in enumerate(balls.items()):
        place = (-2.9 + 1.45 * number, 0.35 * (number % 2), 0.62)
        ball = building.link_object(name, mesh.copy(), place, materials=[material])
        ball.name = name
    building.add_camera((0.2, -7.6, 2.1), (0.0, 0.3, 0.75), 38)


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "hdri.blend")
