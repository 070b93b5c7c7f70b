"""Shadow caustics: what clear glass makes of a small lamp's light, found by looking for it and not by chance.

A ball gathers it to a point, a lens of two bulges to a spot, a leaning ring to bright arcs within its shadow. The lamp
makes shadow caustics, the glass casts them, the table receives them.
"""

from __future__ import annotations

import math

import bpy

from blend_scenes import building


def build() -> None:
    """Fill the scene: three things of glass over a table, a small lamp, a faint sky."""
    building.start_scene()
    building.set_world((0.6, 0.75, 1.0), 0.06)
    paper = building.make_shader("Paper", "Diffuse", (0.72, 0.68, 0.62))
    table = building.link_object("Table", building.make_plane("Table", 24, 24), materials=[paper])
    table.cycles.is_caustics_receiver = True
    clear = building.make_shader("Clear glass", "Glass", (1.0, 1.0, 1.0), roughness=0.0, ior=1.5)
    amber = building.make_shader("Amber glass", "Glass", (1.0, 0.72, 0.35), roughness=0.0, ior=1.5)
    blue = building.make_principled("Blue glass", (0.45, 0.75, 1.0), roughness=0.0, ior=1.45, transmission_weight=1.0)
    place_glass("Ball", building.make_sphere("Ball", 0.42, 64), (-1.35, 0.1, 0.62), amber)
    place_glass("Lens", make_lens(0.45, 0.15), (0.05, -0.3, 0.75), clear, (-34, 0, 0))
    place_glass("Ring", make_ring(0.46, 0.13), (1.4, -0.1, 0.42), blue, (14, -8, 0))
    lamp = building.add_light(
        "Lamp", "POINT", 260, (-0.6, 1.9, 4.6), (0, 0, 0), (1.0, 0.93, 0.82), shadow_soft_size=0.02
    )
    lamp.data.cycles.is_caustics_light = True
    building.add_camera((0, -4.7, 3.3), (0.02, -0.2, 0.33), 45)


def place_glass(
    name: str,
    mesh: bpy.types.Mesh,
    place: building.Point,
    material: bpy.types.Material,
    rotation: building.Point = (0, 0, 0),
) -> None:
    """Put something of glass there that casts caustics."""
    thing = building.link_object(name, mesh, place, rotation=rotation, materials=[material])
    thing.cycles.is_caustics_caster = True


def make_lens(radius: float, bulge: float, steps: int = 32) -> bpy.types.Mesh:
    """Return a body of two bulges, an ellipsoid, around the z axis."""
    angles = [math.pi * (step / steps - 0.5) for step in range(steps + 1)]
    profile = [(radius * math.cos(angle), bulge * math.sin(angle)) for angle in angles]
    profile[0], profile[-1] = (0.0, -bulge), (0.0, bulge)
    return building.make_lathe("Lens", profile, 64)


def make_ring(radius: float, thickness: float, steps: int = 32) -> bpy.types.Mesh:
    """Return a torus around the z axis."""
    angles = [2.0 * math.pi * step / steps for step in range(steps + 1)]
    return building.make_lathe(
        "Ring", [(radius + thickness * math.cos(angle), thickness * math.sin(angle)) for angle in angles], 96
    )


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "caustics.blend")
