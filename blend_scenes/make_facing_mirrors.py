"""Facing mirrors: two mirrors look at each other, and a corridor of reflections grows with the number of bounces."""

from __future__ import annotations

import math

from blend_scenes import building


def build() -> None:
    """Fill the scene: two tall mirrors, almost parallel, and between them a bust on a chequered floor."""
    building.start_scene()
    building.allow_bounces("glossy", 12)
    building.set_world((0.75, 0.82, 1.0), 0.25)
    tiles = [
        building.make_shader("Cream tile", "Diffuse", (0.7, 0.62, 0.5)),
        building.make_shader("Green tile", "Diffuse", (0.05, 0.16, 0.12)),
    ]
    building.link_object("Floor", building.make_chequers("Floor", 8, 16), materials=tiles)
    add_mirror("Far mirror", (0, 1.5, 0.02), 0)
    add_mirror("Near mirror", (0, -1.5, 0.02), 178)
    add_ring_and_ball()
    building.add_light("Lamp", "POINT", 130, (0.5, -0.2, 2.7), (0, 0, 0), (1.0, 0.87, 0.7), shadow_soft_size=0.25)
    building.add_camera((1.36, -1.3, 1.62), (-0.32, 1.5, 0.95), 21)


def add_mirror(name: str, place: building.Point, turn: float) -> None:
    """A mirror that faces -y before it is turned about the vertical, in a wooden frame."""
    silver = building.make_shader(f"{name} silver", "Glossy", (0.9, 0.94, 0.91), roughness=0.0)
    wood = building.make_shader(f"{name} wood", "Diffuse", (0.3, 0.13, 0.05))
    width, height, bar = 2.4, 2.0, 0.1
    stand = building.link_object(name, None, place, rotation=(0, 0, turn))
    pane = building.make_plane(f"{name} pane", width, height)
    parts = [building.link_object(pane.name, pane, (0, 0, height / 2), rotation=(90, 0, 0), materials=[silver])]
    for side, x, z, size in (
        ("left", -(width + bar) / 2, 0, (bar, height)),
        ("right", (width + bar) / 2, 0, (bar, height)),
        ("top", 0, height, (width + 2 * bar, bar)),
    ):
        mesh = building.make_box(f"{name} frame {side}", size[0], 0.08, size[1])
        parts.append(building.link_object(mesh.name, mesh, (x, 0, z), materials=[wood]))
    for part in parts:
        part.parent = stand


def add_ring_and_ball() -> None:
    """The thing that repeats: a red ball that hovers in a slotted ring on a plinth."""
    red = building.make_principled("Red lacquer", (0.7, 0.03, 0.02), roughness=0.15)
    stone = building.make_shader("Plinth stone", "Diffuse", (0.65, 0.65, 0.68))
    bronze = building.make_principled("Bronze", (0.75, 0.5, 0.25), metallic=1.0, roughness=0.3)
    building.link_object("Plinth", building.make_box("Plinth", 0.46, 0.46, 0.55), (-0.1, 0.1, 0), materials=[stone])
    building.link_object("Ball", building.make_sphere("Ball", 0.17), (-0.1, 0.1, 0.9), materials=[red])
    block = building.make_box("Ring block", 0.09, 0.12, 0.05)
    block.materials.append(bronze)
    for number in range(16):
        angle = math.tau * number / 16
        place = (-0.1 + 0.32 * math.sin(angle), 0.1, 0.9 + 0.32 * math.cos(angle))
        building.link_object(f"Ring block {number + 1}", block, place, rotation=(0, math.degrees(angle), 0))


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "facing_mirrors.blend")
