"""Point clouds: 3,728 true spheres of many sizes, each a centre and a radius; only the ground is a mesh."""

from __future__ import annotations

import math

import bpy

from blend_scenes import building

COUNT = 3000
GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))


def build() -> None:
    """Fill the scene: a ball of beads on a spiral, two point clouds around it, a dark ground."""
    building.start_scene(view_transform="Standard")
    building.set_world((0.6, 0.72, 1.0), 0.35)
    slate = building.make_shader("Slate", "Diffuse", (0.2, 0.21, 0.24))
    building.link_object("Ground", building.make_plane("Ground", 60, 60), materials=[slate])
    coral = building.make_principled("Coral beads", (0.82, 0.22, 0.12), roughness=0.3)
    pearl = building.make_principled("Pearls", (0.8, 0.76, 0.7), roughness=0.15)
    steel = building.make_principled("Steel balls", (0.8, 0.82, 0.85), metallic=1.0, roughness=0.0)
    add_cloud("Bead ball", make_spiral_ball(), coral, smallest=0.015, largest=0.06, place=(0, 0, 1.15))
    add_cloud("Steel ring", make_ring("Steel ring", 28, 1.75), steel, smallest=0.12, largest=0.12, place=(0, 0, 0.12))
    add_cloud("Scattered pearls", make_sunflower(700), pearl, smallest=0.02, largest=0.1, place=(0, 0, 0))
    building.add_light(
        "Softbox", "AREA", 700, (-3.5, -3.5, 5.5), (0, 0, 0.8), (1.0, 0.93, 0.84), shape="DISK", size=1.6
    )
    building.add_camera((0, -7.8, 4.6), (0, 0, 0.85), 50)


def make_spiral_ball() -> bpy.types.Mesh:
    """Return vertices on the spherical Fibonacci spiral, pushed in and out by waves."""
    vertices = []
    for number in range(COUNT):
        z = 1 - (2 * number + 1) / COUNT
        angle, reach = GOLDEN_ANGLE * number, math.sqrt(1 - z * z)
        radius = 0.95 + 0.08 * math.sin(5 * angle) + 0.08 * math.sin(9 * z)
        vertices.append((radius * reach * math.cos(angle), radius * reach * math.sin(angle), radius * z))
    return building.new_mesh("Bead ball", vertices, [])


def make_ring(name: str, count: int, radius: float) -> bpy.types.Mesh:
    """Return vertices on a circle."""
    angles = [math.tau * number / count for number in range(count)]
    return building.new_mesh(name, [(radius * math.cos(angle), radius * math.sin(angle), 0) for angle in angles], [])


def make_sunflower(count: int) -> bpy.types.Mesh:
    """Return vertices in the order of a sunflower's seeds, outside the ring."""
    places = [(0.28 * math.sqrt(number + 60), GOLDEN_ANGLE * number) for number in range(count)]
    return building.new_mesh("Scattered pearls", [(r * math.cos(a), r * math.sin(a), 0.05) for r, a in places], [])


def add_cloud(
    name: str,
    mesh: bpy.types.Mesh,
    material: bpy.types.Material,
    *,
    smallest: float,
    largest: float,
    place: building.Point,
) -> None:
    """Turn a mesh's vertices into spheres with random radii, by geometry nodes."""
    cloud = building.link_object(name, mesh, place)
    nodes = building.GeometryNodes(cloud, f"{name} to spheres")
    radius = nodes.add_random(smallest, largest)
    points = nodes.add("GeometryNodeMeshToPoints", {"Mesh": nodes.source, "Radius": radius})
    painted = nodes.add("GeometryNodeSetMaterial", {"Geometry": points.outputs[0], "Material": material})
    nodes.finish(painted.outputs[0])


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "spheres_point_cloud.blend")
