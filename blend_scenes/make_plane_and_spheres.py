"""Plane and spheres: the picture at the end of the lecture, a chequered plane and spheres that reflect one another.

The spheres are true spheres, given by centre and radius as in the lecture: each is a point cloud of one point.
"""

from __future__ import annotations

import bpy

from blend_scenes import building


def build() -> None:
    """Fill the scene: a plane, four spheres, one point of light and a sky."""
    building.start_scene(view_transform="Standard")
    building.set_world((0.32, 0.5, 0.8), 0.6)
    tiles = [
        building.make_shader("Light tile", "Diffuse", (0.75, 0.72, 0.65)),
        building.make_shader("Dark tile", "Diffuse", (0.09, 0.1, 0.13)),
    ]
    building.link_object("Chequered plane", building.make_chequers("Chequered plane", 30, 30), materials=tiles)
    red = building.make_shader("Matte red", "Diffuse", (0.75, 0.08, 0.05))
    yellow = building.make_principled("Glossy yellow", (0.85, 0.55, 0.04), roughness=0.1)
    mirror = building.make_shader("Mirror", "Glossy", (0.8, 0.8, 0.8), roughness=0.0)
    gold = building.make_principled("Gold mirror", (0.95, 0.62, 0.25), metallic=1.0, roughness=0.0)
    add_sphere("Mirror sphere", (-0.1, 1.2, 1.25), 1.25, mirror)
    add_sphere("Red sphere", (-1.7, -0.4, 0.7), 0.7, red)
    add_sphere("Yellow sphere", (0.65, -1.1, 0.5), 0.5, yellow)
    add_sphere("Gold sphere", (2.0, 0.1, 0.8), 0.8, gold)
    building.add_light("Light", "POINT", 1700, (-3.2, -4.0, 5.5), (0, 0, 0), shadow_soft_size=0.0)
    building.add_camera((0.3, -8.4, 2.7), (0.12, 0, 1.05), 50)


def add_sphere(name: str, centre: building.Point, radius: float, material: bpy.types.Material) -> bpy.types.Object:
    """Add a true sphere: geometry nodes that make a point cloud of one point."""
    thing = building.link_object(name, bpy.data.meshes.new(name), centre)
    nodes = building.GeometryNodes(thing, name)
    point = nodes.add("GeometryNodePoints", {"Count": 1, "Radius": radius})
    painted = nodes.add("GeometryNodeSetMaterial", {"Geometry": point.outputs[0], "Material": material})
    nodes.finish(painted.outputs[0])
    return thing


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "plane_and_spheres.blend")
