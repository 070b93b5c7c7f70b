"""Hard shadows: lights without size. A cool sun casts parallel shadows, a warm point casts ones that fan out."""

from __future__ import annotations

import math

from blend_scenes import building


def build() -> None:
    """Fill the scene: a ring of columns around a point light, and the sun across them."""
    building.start_scene()
    building.set_world((0.5, 0.6, 0.8), 0.12)
    sand = building.make_shader("Sand", "Diffuse", (0.62, 0.55, 0.45))
    stone = building.make_shader("Stone", "Diffuse", (0.72, 0.7, 0.66))
    building.link_object("Ground", building.make_plane("Ground", 60, 60), materials=[sand])
    column, slab = building.make_cone("Column", 0.16, 0.13, 1.7, 32), building.make_box("Slab", 0.46, 0.46, 0.1)
    for mesh in (column, slab):
        mesh.materials.append(stone)
    for number in range(9):
        angle = math.tau * (number + 0.5) / 9
        place = (1.9 * math.cos(angle), 1.9 * math.sin(angle))
        building.link_object(f"Column {number + 1}", column, (*place, 0), rotation=(0, 0, math.degrees(angle)))
        building.link_object(f"Slab {number + 1}", slab, (*place, 1.7), rotation=(0, 0, math.degrees(angle)))
    bowl = building.make_shader("Bronze", "Diffuse", (0.2, 0.12, 0.07))
    building.link_object("Fire bowl", building.make_cone("Fire bowl", 0.14, 0.36, 0.4, 32), materials=[bowl])
    building.add_light("Fire", "POINT", 700, (0, 0, 0.75), (0, 0, 0), (1.0, 0.42, 0.12), shadow_soft_size=0.0)
    building.add_light("Sun", "SUN", 1.3, (-5, 3, 6), (0, 1.0, 0), (0.7, 0.82, 1.0), angle=0.0)
    building.add_camera((0.8, -8.2, 4.9), (0.1, 0.1, 0.45), 44)


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "hard_shadows.blend")
