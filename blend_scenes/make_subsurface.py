"""Subsurface scattering: light goes into things, through what is thin of them, and comes out elsewhere.

Behind the table stands a lamp: a monkey of jade, lit through its ears, a candle that glows below its flame, bars of
soap that differ in nothing but the radius, and a fan of leaves from a thick one to a thin one.
"""

from __future__ import annotations

import bmesh
import bpy
from mathutils import Matrix

from blend_scenes import building


def build() -> None:
    """Fill the scene: a monkey, a candle, three bars, a fan of plates, a lamp behind them and one in front."""
    building.start_scene()
    building.set_world((0.5, 0.6, 0.8), 0.25)
    slate = building.make_shader("Slate", "Diffuse", (0.16, 0.17, 0.2))
    building.link_object("Table", building.make_backdrop("Table", 24, 9, 8, 2.0), (0, 2.0, 0), materials=[slate])
    add_monkey()
    add_candle()
    add_bars()
    add_fan()
    building.add_light("Behind", "AREA", 420, (0.3, 3.4, 2.6), (0, 0, 0.6), (1.0, 0.9, 0.75), shape="DISK", size=1.0)
    building.add_light("Front", "AREA", 60, (-3.0, -4.0, 3.5), (0, 0, 0.6), (0.75, 0.85, 1.0), shape="DISK", size=2.5)
    building.add_camera((0, -6.2, 2.1), (0.08, 0, 0.52), 50)


def make_buried(name: str, color: building.Color, radius: building.Color, scale: float) -> bpy.types.Material:
    """Return a Principled material all of whose base lies below the surface; radius : of red, green and blue light."""
    inputs = {"subsurface_weight": 1.0, "subsurface_radius": radius, "subsurface_scale": scale}
    return building.make_principled(name, color, roughness=0.35, **inputs)


def add_monkey() -> None:
    """A monkey of jade."""
    jade = make_buried("Jade", (0.25, 0.62, 0.35), (0.4, 1.0, 0.5), 0.8)
    size = Matrix.Scale(0.66, 4)
    mesh = building.make_mesh("Monkey", bmesh.ops.create_monkey, smooth=True, matrix=size)
    monkey = building.link_object("Monkey", mesh, (-1.3, -0.1, 0.62), rotation=(-6, 0, 28), materials=[jade])
    building.subdivide(monkey, 1)


def add_candle() -> None:
    """A candle, its rim higher than its middle, and a flame."""
    wax = make_buried("Wax", (0.9, 0.72, 0.5), (1.0, 0.5, 0.25), 1.2)
    profile = [(0, 0.001), (0.3, 0.001), (0.32, 0.02), (0.32, 1.12), (0.3, 1.16), (0.26, 1.12), (0.2, 1.05), (0, 1.02)]
    building.link_object("Candle", building.make_lathe("Candle", profile, 48), (0.12, 0.3, 0), materials=[wax])
    building.add_light("Flame", "POINT", 12, (0.12, 0.3, 1.24), (0, 0, 0), (1.0, 0.6, 0.25), shadow_soft_size=0.03)


def add_bars() -> None:
    """Three bars of soap of one color: light goes ever further into them."""
    for number, scale in enumerate((0.02, 0.2, 2.0)):
        name = f"Bar {number + 1}"
        soap = make_buried(f"Soap {number + 1}", (0.85, 0.45, 0.4), (1.0, 0.4, 0.25), scale)
        bar = building.link_object(
            name, building.make_box(name, 0.5, 0.26, 0.3), (-0.45 + 0.62 * number, -1.1, 0.001), materials=[soap]
        )
        building.add_modifier(bar, "BEVEL", "Round", width=0.05, segments=3)


def add_fan() -> None:
    """Leaves of a node of its own, skin, from thick to thin."""
    leaf = building.make_shader("Leaf", "Subsurface", (0.45, 0.75, 0.15), scale=0.5, radius=(0.5, 1.0, 0.2))
    for number, depth in enumerate((0.3, 0.12, 0.04, 0.012)):
        name = f"Leaf {number + 1}"
        plate = building.make_box(name, 0.4, depth, 1.0 - 0.12 * number)
        place = (0.92 + 0.36 * number, 0.3 - 0.2 * number, 0.001)
        building.link_object(name, plate, place, rotation=(0, 0, 12), materials=[leaf])


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "subsurface.blend")
