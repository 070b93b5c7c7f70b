"""Ray portals: two rings that lead into each other, and a door to another place.

A ray that enters one ring leaves the other: turned about the vertical by what lies between the two, and moved by what
lies between their centres. So each ring shows the monkey from the other's side. Behind the door is what stands
FAR_AWAY from it.
"""

from __future__ import annotations

import math
from typing import Any

import bmesh
import bpy
from mathutils import Matrix, Vector

from blend_scenes import building
from blend_scenes.shader_nodes import add_node, connect, make_material

RADIUS = 0.82
# A ring's centre, and the angle about the vertical, in degrees, in which its front looks.
LEFT, RIGHT = (Vector((-1.62, 0.3, 1.0)), -45.0), (Vector((1.62, 0.3, 1.0)), -135.0)
# Rays leave a portal so far before it that they do not meet it again.
STEP = 0.01
FAR_AWAY = Vector((0.0, 200.0, 0.0))


def build() -> None:
    """Fill the scene: a studio with rings, door and monkey, and the place that the door leads to."""
    building.start_scene()
    building.set_world((0.62, 0.72, 0.9), 0.55)
    plaster = building.make_shader("Plaster", "Diffuse", (0.55, 0.54, 0.52))
    building.link_object("Studio", building.make_backdrop("Studio", 30, 5, 9, 2.5), (0, 0, 0), materials=[plaster])
    add_ring("Left ring", LEFT, RIGHT, (0.1, 0.45, 1.0))
    add_ring("Right ring", RIGHT, LEFT, (1.0, 0.35, 0.05))
    add_monkey()
    add_door()
    add_far_place()
    building.add_light(
        "Key", "AREA", 420, (-2.5, -5.0, 6.5), (0, 0, 0.8), (1.0, 0.95, 0.88), shape="DISK", size=8.0
    )  # fmt: skip
    building.add_light("Top", "AREA", 120, (2.0, 1.0, 6.0), (0, 0.5, 0), (0.8, 0.88, 1.0), shape="DISK", size=8.0)
    building.add_camera((0, -6.6, 1.7), (0, 0, 1.0), 46)


def make_portal(name: str, position: Any, direction: Any = None) -> Any:
    """Return a material of a portal; position, direction : functions that add nodes and return where rays go on and
    in which direction, that of before without."""
    material, tree = make_material(name)
    geometry = add_node(tree, "ShaderNodeNewGeometry")
    inputs = {"Color": (1, 1, 1, 1), "Position": position(tree, geometry.outputs["Position"])}
    if direction is not None:
        inputs["Direction"] = direction(tree, geometry.outputs["Incoming"])
    connect(tree, add_node(tree, "ShaderNodeBsdfRayPortal", inputs))
    return material


def add_ring(name: str, here: tuple[Vector, float], there: tuple[Vector, float], color: building.Color) -> None:
    """Add a glowing ring around a disc through which rays go on from another ring."""
    turn = math.radians(there[1] - here[1] - 180.0)
    front = Vector((math.cos(math.radians(there[1])), math.sin(math.radians(there[1])), 0.0))

    def leave(tree: Any, place: Any) -> Any:
        """R (P - c) + c': about this ring's centre, then as far as to the other's."""
        turned = add_node(
            tree, "ShaderNodeVectorRotate", {"Vector": place, "Center": here[0], "Angle": turn}, rotation_type="Z_AXIS"
        )
        return move(tree, turned.outputs[0], there[0] - here[0] + STEP * front)

    def look(tree: Any, incoming: Any) -> Any:
        """R (-I), for Incoming looks to where the ray comes from."""
        onwards = add_node(tree, "ShaderNodeVectorMath", {0: incoming, "Scale": -1.0}, operation="SCALE")
        turned = add_node(
            tree, "ShaderNodeVectorRotate", {"Vector": onwards.outputs[0], "Angle": turn}, rotation_type="Z_AXIS"
        )
        return turned.outputs[0]

    upright = Matrix.Rotation(math.radians(here[1]), 4, "Z") @ Matrix.Rotation(math.radians(90.0), 4, "Y")
    disc = building.make_mesh(
        f"{name}'s portal", bmesh.ops.create_circle, cap_ends=True, segments=64, radius=RADIUS, matrix=upright
    )
    building.link_object(disc.name, disc, here[0], materials=[make_portal(disc.name, leave, look)])
    glow = building.make_shader(name, "Emission", color, strength=2.5)
    ring = building.link_object(name, make_ring(name), here[0], materials=[glow])
    ring.matrix_world = Matrix.Translation(here[0]) @ upright


def move(tree: Any, place: Any, offset: Vector) -> Any:
    return add_node(tree, "ShaderNodeVectorMath", {0: place, 1: offset}, operation="ADD").outputs[0]


def make_ring(name: str, thickness: float = 0.045, segments: int = 64, sides: int = 12) -> bpy.types.Mesh:
    """Return a torus in the xy plane that lies around a portal."""
    corners = [
        (
            (RADIUS + thickness * math.cos(math.tau * side / sides)) * math.cos(math.tau * step / segments),
            (RADIUS + thickness * math.cos(math.tau * side / sides)) * math.sin(math.tau * step / segments),
            thickness * math.sin(math.tau * side / sides),
        )
        for step in range(segments)
        for side in range(sides)
    ]
    faces = [
        (
            step * sides + side,
            (step + 1) % segments * sides + side,
            (step + 1) % segments * sides + (side + 1) % sides,
            step * sides + (side + 1) % sides,
        )
        for step in range(segments)
        for side in range(sides)
    ]
    return building.new_mesh(name, corners, faces, smooth=True)


def add_monkey() -> None:
    """A monkey on a pedestal, which looks at the camera; the rings see it from both sides."""
    gold = building.make_principled("Gold", (0.62, 0.42, 0.08), metallic=1.0, roughness=0.22)
    marble = building.make_principled("Marble", (0.75, 0.73, 0.7), roughness=0.35)
    building.link_object("Pedestal", building.make_cone("Pedestal", 0.4, 0.36, 0.12), (0, -0.1, 0), materials=[marble])
    monkey = building.make_mesh("Monkey", bmesh.ops.create_monkey, smooth=True)
    thing = building.link_object("Monkey", monkey, (0, -0.1, 0.5), scale=0.42, rotation=(0, 0, 8), materials=[gold])
    building.subdivide(thing, 2)


def add_door() -> None:
    """A frame of wood at the back of the studio, through which one looks far away."""
    wood = building.make_principled("Wood", (0.22, 0.1, 0.045), roughness=0.5)
    for name, width, place in (
        ("Left post", 0.12, (-0.62, 2.0, 0)),
        ("Right post", 0.12, (0.62, 2.0, 0)),
        ("Lintel", 1.5, (0, 2.0, 2.2)),
    ):
        height = 0.14 if name == "Lintel" else 2.2
        building.link_object(name, building.make_box(name, width, 0.16, height), place, materials=[wood])
    portal = make_portal("Door", lambda tree, place: move(tree, place, FAR_AWAY))
    door = building.new_mesh(
        "Door", [(-0.56, 2.0, 0.0), (0.56, 2.0, 0.0), (0.56, 2.0, 2.2), (-0.56, 2.0, 2.2)], [(0, 1, 2, 3)]
    )
    building.link_object("Door", door, materials=[portal])


def add_far_place() -> None:
    """Firs on red sand before a low sun of their own."""
    sand = building.make_shader("Sand", "Diffuse", (0.5, 0.16, 0.06))
    green = building.make_shader("Fir", "Diffuse", (0.05, 0.2, 0.09))
    glow = building.make_shader("Far sun", "Emission", (1.0, 0.45, 0.12), strength=3.0)
    dusk = building.make_shader("Dusk", "Emission", (0.9, 0.32, 0.3), strength=0.35)
    building.link_object("Sand", building.make_plane("Sand", 60, 40), FAR_AWAY + Vector((0, 21.5, 0)), materials=[sand])
    sun = building.make_sphere("Far sun", 2.2, 48)
    building.link_object("Far sun", sun, FAR_AWAY + Vector((-1.2, 34, 3.4)), materials=[glow])
    wall = building.new_mesh("Dusk", [(-60, 45, -2), (60, 45, -2), (60, 45, 50), (-60, 45, 50)], [(3, 2, 1, 0)])
    building.link_object("Dusk", wall, FAR_AWAY, materials=[dusk])
    tree = building.make_cone("Fir", 0.55, 0.0, 2.1, 24)
    tree.materials.append(green)
    for number, (x, y, size) in enumerate(
        ((-1.0, 5.6, 0.9), (0.85, 4.9, 1.05), (0.2, 8.0, 1.0), (-2.4, 9.5, 1.2), (2.3, 10.0, 1.3), (1.1, 14.0, 1.1))
    ):
        building.link_object(f"Fir {number + 1}", tree, FAR_AWAY + Vector((x, y, 0)), scale=size)
    building.add_light(
        "Far lamp", "AREA", 900, FAR_AWAY + Vector((-3, 2, 6)), FAR_AWAY + Vector((0, 7, 0.5)), (1.0, 0.75, 0.6),
        shape="DISK", size=2.0,
    )  # fmt: skip


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "portals.blend")
