"""Textured Suzanne: pictures painted by this script, wrapped by UV maps: color, roughness and a normal map."""

from __future__ import annotations

from typing import Any

import bmesh
import bpy
import numpy as np

from blend_scenes import building

SIZE = 192  # pixels a side
ROWS = 26  # of scales


def paint(name: str, colors: Any, is_color: bool = True) -> bpy.types.Image:
    """Return an image of 8 bits a channel, packed into the file, of (SIZE, SIZE, 3) values; row 0 is the lowest."""
    image = bpy.data.images.new(name, SIZE, SIZE)
    image.colorspace_settings.name = "sRGB" if is_color else "Non-Color"
    pixels = np.concatenate([np.clip(colors, 0, 1), np.ones((SIZE, SIZE, 1))], axis=2)
    image.pixels.foreach_set(pixels.astype(np.float32).ravel())
    image.pack()
    return image


def paint_scales() -> tuple[Any, Any, Any]:
    """Return color, roughness and normals of rows of round scales, each (SIZE, SIZE, 3)."""
    row, column = np.mgrid[0:SIZE, 0:SIZE] / SIZE
    line = np.floor(row * ROWS)
    across = (column * ROWS + 0.5 * (line % 2)) % 1.0 - 0.5
    along = (row * ROWS) % 1.0 - 0.5
    away = np.minimum(2.0 * np.hypot(across, along), 1.0)[..., np.newaxis]
    hue = (np.sin(6.0 * np.pi * column) * np.sin(4.0 * np.pi * row))[..., np.newaxis]
    color = np.array([0.30, 0.55, 0.32]) + hue * np.array([0.30, 0.05, -0.25])
    color = color * (1.3 - 1.1 * away**2)
    roughness = np.repeat(0.25 + 0.45 * away, 3, axis=2)
    slope = np.where(away < 1.0, away**2, 0.0)
    normal = np.concatenate(
        [slope * across[..., np.newaxis], slope * along[..., np.newaxis], np.ones_like(away)], axis=2
    )
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    return color, roughness, 0.5 + 0.5 * normal


def paint_boards() -> Any:
    """Return the color of wooden boards, (SIZE, SIZE, 3)."""
    row, column = np.mgrid[0:SIZE, 0:SIZE] / SIZE
    board = np.floor(column * 4)
    grain = 0.5 + 0.5 * np.sin(2 * np.pi * (20.0 * column + 0.7 * np.sin(2 * np.pi * (row + 0.37 * board))))
    seam = ((column * 4) % 1.0 > 0.04)[..., np.newaxis]
    color = np.array([0.62, 0.42, 0.26]) * (0.75 + 0.25 * grain[..., np.newaxis] + 0.06 * (board % 2)[..., np.newaxis])
    return np.where(seam, color, 0.12)


def make_monkey() -> bpy.types.Mesh:
    """Return Suzanne with her own UV map."""
    edited = bmesh.new()
    edited.loops.layers.uv.new("UVMap")
    bmesh.ops.create_monkey(edited, calc_uvs=True)
    mesh = bpy.data.meshes.new("Suzanne")
    edited.to_mesh(mesh)
    edited.free()
    mesh.shade_smooth()
    return mesh


def add_picture(tree: bpy.types.NodeTree, image: bpy.types.Image, **settings: Any) -> bpy.types.NodeSocket:
    """Add an Image Texture and return its color."""
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    for name, value in settings.items():
        setattr(node, name, value)
    return node.outputs["Color"]


def make_scales() -> bpy.types.Material:
    """A Principled material that three pictures drive."""
    color, roughness, normal = paint_scales()
    material = building.make_principled("Scales", (0.8, 0.8, 0.8), coat_weight=0.3)
    tree = material.node_tree
    principled = tree.nodes["Principled BSDF"]
    links = tree.links
    links.new(add_picture(tree, paint("Scale color", color)), principled.inputs["Base Color"])
    links.new(add_picture(tree, paint("Scale roughness", roughness, False)), principled.inputs["Roughness"])
    bend = tree.nodes.new("ShaderNodeNormalMap")
    bend.inputs["Strength"].default_value = 0.8
    links.new(add_picture(tree, paint("Scale normals", normal, False)), bend.inputs["Color"])
    links.new(bend.outputs["Normal"], principled.inputs["Normal"])
    return material


def make_boards() -> bpy.types.Material:
    """Boards, repeated over the table by a Mapping node, read with cubic interpolation."""
    material = building.make_principled("Boards", (0.8, 0.8, 0.8), roughness=0.45)
    tree = material.node_tree
    coordinates, mapping = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeMapping")
    mapping.inputs["Scale"].default_value = (5.0, 5.0, 1.0)
    picture = add_picture(tree, paint("Boards", paint_boards()), interpolation="Cubic")
    tree.links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], picture.node.inputs["Vector"])
    tree.links.new(picture, tree.nodes["Principled BSDF"].inputs["Base Color"])
    return material


def build() -> None:
    """Fill the scene: Suzanne on a table under a soft lamp."""
    building.start_scene()
    building.set_world((0.55, 0.68, 1.0), 0.35)
    building.link_object("Table", building.make_plane("Table", 12, 12), materials=[make_boards()])
    monkey = building.link_object(
        "Suzanne", make_monkey(), (0, 0, 0.98), rotation=(-18, 0, 24), materials=[make_scales()]
    )
    building.subdivide(monkey, 2)
    building.add_light(
        "Softbox", "AREA", 520, (-2.6, -2.4, 3.8), (0, 0, 0.9), (1.0, 0.93, 0.84), shape="SQUARE", size=1.6
    )
    building.add_camera((0.2, -5.4, 2.4), (0.05, 0, 0.86), 52)


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "textured_suzanne.blend")
