"""Panorama: a ring of columns seen all around from its middle, by an equirectangular camera."""

from __future__ import annotations

import colorsys
import math

import bpy

from blend_scenes import building

COLUMNS = 12
RADIUS = 3.2
COLUMN = (
    (0.0, 0.0),
    (0.5, 0.0),
    (0.5, 0.15),
    (0.34, 0.3),
    (0.28, 2.6),
    (0.34, 2.75),
    (0.5, 2.9),
    (0.5, 3.05),
    (0, 3.05),
)


def build() -> None:
    """Fill the scene: a floor, columns under a ring, a ball between any two of them, sun and sky."""
    building.start_scene(width=640, height=320)
    building.set_world((0.35, 0.55, 0.9), 0.7)
    tiles = [
        building.make_shader("Light tile", "Diffuse", (0.7, 0.66, 0.58)),
        building.make_shader("Dark tile", "Diffuse", (0.2, 0.16, 0.13)),
    ]
    building.link_object("Floor", building.make_chequers("Floor", 24, 48), materials=tiles)
    marble = building.make_principled("Marble", (0.85, 0.8, 0.72), roughness=0.35)
    column = building.make_lathe("Column", COLUMN)
    for number in range(COLUMNS):
        angle = 2.0 * math.pi * number / COLUMNS
        place = RADIUS * math.cos(angle), RADIUS * math.sin(angle)
        building.link_object(f"Column {number}", column, (*place, 0.0), materials=[marble])
        add_ball(number, angle + math.pi / COLUMNS)
    add_ring(marble)
    sun = building.add_light("Sun", "SUN", 4.0, (-3.0, -2.0, 8.0), (0.0, 0.0, 0.0))
    sun.data.angle = math.radians(1.0)
    camera = building.add_camera((0.0, 0.0, 1.5), (0.0, 10.0, 1.5))
    camera.data.type, camera.data.panorama_type = "PANO", "EQUIRECTANGULAR"


def add_ball(number: int, angle: float) -> None:
    """Add a ball of a color of its own, every third a mirror."""
    color = colorsys.hsv_to_rgb(number / COLUMNS, 0.75, 0.8)
    if number % 3 == 0:
        material = building.make_shader(f"Mirror {number}", "Glossy", (0.9, 0.9, 0.9), roughness=0.0)
    else:
        material = building.make_principled(f"Paint {number}", color, roughness=0.3)
    place = 0.75 * RADIUS * math.cos(angle), 0.75 * RADIUS * math.sin(angle), 0.45
    building.link_object(
        f"Ball {number}", building.make_sphere(f"Ball {number}", 0.45, 48), place, materials=[material]
    )


def add_ring(material: bpy.types.Material) -> None:
    """Add the ring of stone that the columns carry."""
    profile = ((RADIUS - 0.5, 0.0), (RADIUS + 0.5, 0.0), (RADIUS + 0.6, 0.5), (RADIUS - 0.5, 0.5), (RADIUS - 0.5, 0.0))
    building.link_object("Ring", building.make_lathe("Ring", profile, 96), (0.0, 0.0, 3.05), materials=[material])


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "panorama.blend")
