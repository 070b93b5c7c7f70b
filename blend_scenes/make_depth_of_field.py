"""Depth of field: a row of marbles that runs through the plane of focus, and lamps far off as five-sided discs."""

from __future__ import annotations

import bpy

from blend_scenes import building


def build() -> None:
    """Fill the scene: marbles in focus at the fourth, small lamps behind, and a wide lens of five blades."""
    building.start_scene()
    building.set_world((0.5, 0.6, 0.8), 0.25)
    board = [
        building.make_shader(name, "Diffuse", color)
        for name, color in (("Walnut", (0.16, 0.08, 0.04)), ("Maple", (0.62, 0.47, 0.3)))
    ]
    building.link_object("Board", building.make_chequers("Board", 16, 32), (0, 5, 0), materials=board)
    mesh = building.make_sphere("Marble", 0.3, 32)
    for number in range(8):
        hue = number / 7
        paint = building.make_principled(
            f"Paint {number + 1}", (0.7 - 0.55 * hue, 0.12 + 0.35 * hue, 0.1 + 0.5 * hue), roughness=0.3
        )
        place = (-1.15 + 0.42 * number, -1.2 + 0.9 * number, 0.3)
        building.link_object(f"Marble {number + 1}", mesh.copy(), place, materials=[paint])
    for number in range(9):
        shade = (1.0, 0.45 + 0.06 * number, 0.9 - 0.09 * number)
        lamp = building.make_shader(f"Lamp {number + 1}", "Emission", shade, strength=8.0)
        place = (-4.4 + 1.1 * number, 11.0, 1.5 + 0.7 * ((number * 5) % 3))
        building.link_object(f"Lamp {number + 1}", building.make_sphere("Bulb", 0.06, 16), place, materials=[lamp])
    building.add_light("Key", "AREA", 220, (-3.5, -2.5, 4.5), (0, 0.8, 0), (1.0, 0.94, 0.86), size=1.6)
    focus = bpy.data.objects["Marble 4"]
    camera = building.add_camera((0.2, -5.2, 1.5), (0.15, 2.0, 0.75), 50).data
    camera.dof.use_dof = True
    camera.dof.focus_object = focus
    camera.dof.aperture_fstop = 0.16
    camera.dof.aperture_blades = 5
    camera.dof.aperture_rotation = 0.3
    camera.dof.aperture_ratio = 1.0


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "depth_of_field.blend")
