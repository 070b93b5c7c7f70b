"""Shadow linking: three plain shapes whose shadows on the floor are those of other things.

One lamp shines on the floor alone, and is blocked by a monkey, a ring and a star alone, which the camera does not see;
its twin in the same place shines on the shapes. A cyan and a red lamp reach one of the shapes each, and no floor.
"""

from __future__ import annotations

import math

import bmesh
import bpy

from blend_scenes import building

# Where the three stand, along x; where the key lights are, and look.
PLACES = (-2.0, 0.0, 2.0)
KEY, AIM = (-5.2, -4.2, 6.2), (0.6, 0.6, 0.0)


def build() -> None:
    """Fill the scene: a floor, three shapes, three unseen things in their places, and linked lamps."""
    building.start_scene()
    building.set_world((0.5, 0.6, 0.8), 0.12)
    paper = building.make_shader("Paper", "Diffuse", (0.7, 0.68, 0.64))
    floor = building.link_object("Floor", building.make_backdrop("Floor", 30, 6, 8, 2.0), materials=[paper])
    shapes = [add_shape(*shape) for shape in list_shapes()]
    add_key("Floor's key", [floor], add_shadows())
    add_key("Shapes' key", shapes, shapes)
    add_rim("Cyan", (-3.8, 0.9, 1.0), shapes[0], (0.1, 0.8, 1.0))
    add_rim("Red", (3.8, 0.9, 1.0), shapes[2], (1.0, 0.15, 0.08))
    building.add_camera((0, -7.4, 4.0), (0.3, 0.35, 0.25), 44)


def list_shapes() -> list[tuple[str, bpy.types.Mesh, float]]:
    """Return names, meshes and heights of what is seen."""
    return [
        ("Ball", building.make_sphere("Ball", 0.42, 64), 0.42),
        ("Cube", building.make_box("Cube", 0.74, 0.74, 0.74), 0.0),
        ("Cone", building.make_cone("Cone", 0.45, 0.0, 0.95), 0.0),
    ]


def add_shape(name: str, mesh: bpy.types.Mesh, height: float) -> bpy.types.Object:
    """Add one of the shapes, of white plaster."""
    plaster = building.make_principled(name, (0.8, 0.8, 0.78), roughness=0.6)
    place = (PLACES[("Ball", "Cube", "Cone").index(name)], 0.0, height)
    return building.link_object(name, mesh, place, rotation=(0, 0, 25), materials=[plaster])


def add_shadows() -> list[bpy.types.Object]:
    """Add what blocks the key light: a monkey, a ring and a star, which no other ray sees."""
    monkey = building.make_mesh("Monkey's shadow", bmesh.ops.create_monkey)
    ring = building.make_lathe(
        "Ring's shadow", [(0.38, -0.06), (0.55, -0.06), (0.55, 0.06), (0.38, 0.06), (0.38, -0.06)], 48
    )
    turned = {"Monkey's shadow": (-43, 0, -37), "Ring's shadow": (35, 20, 0), "Star's shadow": (0, 0, 14)}
    things = []
    for mesh, x, scale in zip((monkey, ring, make_star()), PLACES, (0.62, 1.15, 1.25), strict=True):
        thing = building.link_object(mesh.name, mesh, (x + 0.42, 0.36, 0.66), rotation=turned[mesh.name], scale=scale)
        for rays in ("camera", "diffuse", "glossy", "transmission", "volume_scatter"):
            setattr(thing, f"visible_{rays}", False)
        things.append(thing)
    return things


def make_star(points: int = 5, outer: float = 0.62, inner: float = 0.25) -> bpy.types.Mesh:
    """Return a flat star in the xy plane."""
    corners = [
        (radius * math.sin(math.pi * number / points), radius * math.cos(math.pi * number / points), 0.0)
        for number, radius in enumerate((outer, inner) * points)
    ]
    return building.new_mesh("Star's shadow", corners, [tuple(reversed(range(2 * points)))])


def add_key(name: str, receivers: list[bpy.types.Object], blockers: list[bpy.types.Object]) -> None:
    """Add a key light that shines on `receivers` alone, and that `blockers` alone throw shadows of."""
    key = building.add_light(
        name, "SPOT", 4200, KEY, AIM, (1.0, 0.94, 0.85), spot_size=1.3, spot_blend=0.6, shadow_soft_size=0.08
    )
    key.light_linking.receiver_collection = collect(f"{name}: receivers", receivers)
    key.light_linking.blocker_collection = collect(f"{name}: blockers", blockers)


def collect(name: str, things: list[bpy.types.Object]) -> bpy.types.Collection:
    """Return a collection of things that is not part of the scene."""
    collection = bpy.data.collections.new(name)
    for thing in things:
        collection.objects.link(thing)
    return collection


def add_rim(name: str, place: building.Point, thing: bpy.types.Object, color: building.Color) -> None:
    """Add a lamp that shines on one thing alone."""
    lamp = building.add_light(name, "AREA", 260, place, tuple(thing.location), color, shape="DISK", size=0.8)
    lamp.light_linking.receiver_collection = collect(name, [thing])


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "shadow_linking.blend")
