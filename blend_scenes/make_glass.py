"""Glass: a solid ball, a hollow one, a frosted one and a prism before stripes, each of which bends them differently."""

from __future__ import annotations

import bpy

from blend_scenes import building


def build() -> None:
    """Fill the scene: four glass things, a striped wall behind them, light from above."""
    building.start_scene()
    building.set_world((0.8, 0.88, 1.0), 0.45)
    paper = building.make_shader("Paper", "Diffuse", (0.75, 0.73, 0.7))
    building.link_object("Table", building.make_plane("Table", 24, 24), materials=[paper])
    add_stripes()
    clear = building.make_shader("Clear glass", "Glass", (1.0, 1.0, 1.0), roughness=0.0, ior=1.5)
    green = building.make_principled(
        "Bottle glass", (0.75, 0.95, 0.82), roughness=0.0, ior=1.5, transmission_weight=1.0
    )
    frosted = building.make_shader("Frosted glass", "Glass", (0.97, 0.98, 1.0), roughness=0.25, ior=1.45)
    diamond = building.make_shader("Diamond", "Glass", (1.0, 0.97, 0.93), roughness=0.0, ior=2.42)
    add_hollow_ball((-0.75, 0, 0.601), clear)
    for name, place, radius, material in (
        ("Solid ball", (-2.05, -0.2, 0.601), 0.6, green),
        ("Frosted ball", (0.55, -0.2, 0.601), 0.6, frosted),
    ):
        building.link_object(name, building.make_sphere(name, radius, 96), place, materials=[material])
    gem = building.make_lathe("Gem", [(0, 0), (0.62, 0.68), (0.62, 0.74), (0.38, 0.95), (0, 0.95)], segments=9)
    for polygon in gem.polygons:
        polygon.use_smooth = False
    building.link_object("Gem", gem, (1.9, 0, 0.3), rotation=(0, 0, 12), materials=[diamond])
    collar = building.make_lathe("Gem stand", [(0.3, 0.001), (0.3, 0.5), (0.26, 0.5), (0.26, 0.001)], segments=64)
    steel = building.make_principled("Steel", (0.7, 0.7, 0.72), metallic=1.0, roughness=0.2)
    building.link_object("Gem stand", collar, (1.9, 0, 0), materials=[steel])
    building.add_light(
        "Softbox", "AREA", 300, (-1.0, -2.5, 5.0), (0, 0.4, 0.4), (1.0, 0.95, 0.88), shape="DISK", size=1.6
    )
    building.add_camera((0, -7.4, 1.75), (-0.08, 0, 0.74), 47)


def add_hollow_ball(centre: building.Point, glass: bpy.types.Material) -> None:
    """Two surfaces: the inner sphere's normals point inwards, out of the glass."""
    inner = building.make_sphere("Inner surface", 0.54, 96)
    inner.flip_normals()
    for name, mesh in (("Hollow ball", building.make_sphere("Outer surface", 0.6, 96)), ("Hollow ball inside", inner)):
        building.link_object(name, mesh, centre, materials=[glass])


def add_stripes() -> None:
    """A wall of colored stripes: what the glass bends."""
    for number, color in enumerate([(0.72, 0.1, 0.07), (0.82, 0.74, 0.58), (0.07, 0.24, 0.4), (0.82, 0.74, 0.58)] * 7):
        name = f"Stripe {number + 1}"
        paint = building.make_shader(name, "Diffuse", color)
        place = (-4.05 + 0.3 * number, 2.2, 1.35)
        building.link_object(name, building.make_plane(name, 0.3, 2.7), place, rotation=(90, 0, 0), materials=[paint])


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "glass.blend")
