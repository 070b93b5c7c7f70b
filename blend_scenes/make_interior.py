"""Interior: a room lit through its window alone; most of what is seen has been reflected by walls."""

from __future__ import annotations

import math

import bpy

from blend_scenes import building

WIDTH, DEPTH, HEIGHT = 4.2, 5.0, 2.6
WINDOW = (-0.4, 1.6, 0.75, 2.25)  # from and to along the left wall, from and to in height
THICKNESS = 0.25


def make_left_wall() -> bpy.types.Mesh:
    """A wall in the plane x = 0 with a hole and the hole's reveal; it faces +x."""
    low, high, sill, top = WINDOW
    ends, rows = (-DEPTH / 2, low, high, DEPTH / 2), (0.0, sill, top, HEIGHT)
    corners = [(0.0, y, z) for z in rows for y in ends]
    outside = [(-THICKNESS, y, z) for z, y in ((sill, low), (sill, high), (top, high), (top, low))]
    faces = [
        (4 * row + column, 4 * row + column + 1, 4 * row + column + 5, 4 * row + column + 4)
        for row in range(3)
        for column in range(3)
        if (row, column) != (1, 1)
    ]
    inner = (5, 6, 10, 9)
    faces += [(inner[k], inner[(k + 1) % 4], 16 + (k + 1) % 4, 16 + k) for k in range(4)]
    return building.new_mesh("Left wall", corners + outside, faces)


def add_room() -> None:
    """Floor, ceiling and walls."""
    plaster = building.make_shader("Plaster", "Diffuse", (0.82, 0.79, 0.73))
    accent = building.make_shader("Terracotta", "Diffuse", (0.62, 0.25, 0.14))
    tiles = [
        building.make_principled("Dark boards", (0.22, 0.12, 0.06), roughness=0.4),
        building.make_principled("Light boards", (0.38, 0.22, 0.11), roughness=0.4),
    ]
    building.link_object("Floor", building.make_chequers("Floor", 6.0, 12), materials=tiles)
    for name, size, place, turn, material in (
        ("Ceiling", (WIDTH, DEPTH), (0, 0, HEIGHT), (180, 0, 0), plaster),
        ("Back wall", (WIDTH, HEIGHT), (0, DEPTH / 2, HEIGHT / 2), (90, 0, 0), accent),
        ("Front wall", (WIDTH, HEIGHT), (0, -DEPTH / 2, HEIGHT / 2), (-90, 0, 0), plaster),
        ("Right wall", (HEIGHT, DEPTH), (WIDTH / 2, 0, HEIGHT / 2), (0, -90, 0), plaster),
    ):
        building.link_object(name, building.make_plane(name, *size), place, rotation=turn, materials=[material])
    building.link_object("Left wall", make_left_wall(), (-WIDTH / 2, 0, 0), materials=[plaster])
    frame = building.make_shader("White paint", "Diffuse", (0.85, 0.85, 0.85))
    low, high, sill, top = WINDOW
    for name, box, place in (
        ("Mullion", (0.05, 0.05, top - sill), (0, (low + high) / 2, sill)),
        ("Transom", (0.05, high - low, 0.05), (0, (low + high) / 2, (sill + top) / 2)),
    ):
        place = (-WIDTH / 2 - THICKNESS / 2, *place[1:])
        building.link_object(name, building.make_box(name, *box), place, materials=[frame])


def add_furniture() -> None:
    """A table with a vase and a ball, a picture on the wall."""
    wood = building.make_principled("Oak", (0.45, 0.27, 0.13), roughness=0.35)
    building.link_object("Table top", building.make_box("Table top", 1.5, 0.8, 0.05), (0.3, 0.9, 0.7), materials=[wood])
    leg = building.make_box("Leg", 0.06, 0.06, 0.7)
    leg.materials.append(wood)
    for number in range(4):
        place = (0.3 + 0.68 * (-1) ** number, 0.9 + 0.33 * (-1) ** (number // 2), 0)
        building.link_object(f"Leg {number + 1}", leg, place)
    glaze = building.make_principled("Blue glaze", (0.05, 0.16, 0.4), roughness=0.12)
    profile = [
        (0.0, 0.0),
        (0.09, 0.0),
        (0.15, 0.12),
        (0.13, 0.24),
        (0.06, 0.32),
        (0.09, 0.38),
        (0.08, 0.38),
        (0.0, 0.1),
    ]
    building.link_object("Vase", building.make_lathe("Vase", profile, 48), (0.05, 0.95, 0.75), materials=[glaze])
    brass = building.make_principled("Brass", (0.9, 0.64, 0.3), metallic=1.0, roughness=0.25)
    building.link_object("Ball", building.make_sphere("Ball", 0.11, 48), (0.62, 0.8, 0.86), materials=[brass])
    mirror = building.make_shader("Mirror", "Glossy", (0.92, 0.92, 0.92), roughness=0.0)
    oval = building.make_cone("Mirror", 0.42, 0.42, 0.02, 64)
    building.link_object("Mirror", oval, (0.5, DEPTH / 2 - 0.01, 1.6), rotation=(90, 0, 0), materials=[mirror])


def add_skylight() -> None:
    """A lamp in the window's outer plane stands for the sky: aimed at, it gives less noise than a sky that is not."""
    low, high, sill, top = WINDOW
    place = (-WIDTH / 2 - THICKNESS, (low + high) / 2, (sill + top) / 2)
    settings = {"shape": "RECTANGLE", "size": high - low, "size_y": top - sill}
    building.add_light("Skylight", "AREA", 55.0, place, (0.0, *place[1:]), (0.68, 0.82, 1.0), **settings)


def build() -> None:
    """Fill the scene: the sun throws the window on the floor, the sky does the rest."""
    building.start_scene()
    building.set_world((0.62, 0.78, 1.0), 0.6)
    add_room()
    add_furniture()
    add_skylight()
    building.add_light("Sun", "SUN", 9.0, (-6, -1.2, 6), (0.0, 0.9, 0.0), (1.0, 0.9, 0.74), angle=math.radians(1.0))
    building.add_camera((1.45, -2.25, 1.45), (-0.25, 1.6, 0.98), 21)


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "interior.blend")
