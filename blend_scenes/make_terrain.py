"""Terrain: 262,144 triangles from a mesh of two faces, subdivided and displaced by modifiers."""

from __future__ import annotations

import math

import bpy

from blend_scenes import building

SNOW_LINE, GRASS_LINE = 2.3, 1.1  # metres above the lake


def build() -> None:
    """Fill the scene: mountains, a lake that mirrors them, and a low sun with its long shadows."""
    building.start_scene()
    building.set_world((0.42, 0.6, 0.95), 0.55)
    add_mountains()
    water = building.make_principled("Lake", (0.01, 0.03, 0.05), roughness=0.0, ior=1.33)
    building.link_object("Lake", building.make_plane("Lake", 60, 30), (0, 0, 0), materials=[water])
    building.add_light("Sun", "SUN", 5.5, (-7, -2.5, 4.0), (0, 0, 0), (1.0, 0.86, 0.7), angle=math.radians(0.53))
    building.add_camera((0.0, -14.5, 4.2), (0.0, 4.0, 1.05), 50)


def add_mountains() -> None:
    """Two square faces that rise to the back, eight subdivisions, ridges upon hills, and materials by height."""
    faces = building.new_mesh(
        "Mountains", [(x, y, 0.14 * y) for y in (-12, 12) for x in (-24, 0, 24)], [(0, 1, 4, 3), (1, 2, 5, 4)]
    )
    slots = [
        building.make_shader(name, "Diffuse", color)
        for name, color in (("Meadow", (0.13, 0.17, 0.05)), ("Rock", (0.25, 0.2, 0.17)), ("Snow", (0.85, 0.87, 0.9)))
    ]
    land = building.link_object("Mountains", faces, (0, 4, -0.9), materials=slots)
    building.subdivide(land, 8, "SIMPLE")
    ridges = {"musgrave_type": "RIDGED_MULTIFRACTAL", "noise_scale": 5.0, "octaves": 8, "gain": 2.0, "offset": 0.9}
    building.displace(land, 2.2, "MUSGRAVE", direction="Z", **ridges)
    building.displace(land, 3.0, "CLOUDS", direction="Z", noise_scale=8.0, noise_depth=1)
    paint_by_height(land, slots)


def paint_by_height(land: bpy.types.Object, slots: list[bpy.types.Material]) -> None:
    """Give the faces above two heights another material, by geometry nodes."""
    nodes = building.GeometryNodes(land, "Paint by height")
    height = nodes.add("ShaderNodeSeparateXYZ", {"Vector": nodes.add("GeometryNodeInputPosition").outputs[0]})
    geometry = nodes.source
    for limit, material in zip((-math.inf, GRASS_LINE, SNOW_LINE), slots, strict=True):
        above = nodes.add(
            "FunctionNodeCompare",
            {"A": height.outputs["Z"], "B": limit - land.location.z},
            data_type="FLOAT",
            operation="GREATER_THAN",
        )
        painted = nodes.add(
            "GeometryNodeSetMaterial", {"Geometry": geometry, "Selection": above.outputs[0], "Material": material}
        )
        geometry = painted.outputs[0]
    nodes.finish(geometry)


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "terrain.blend")
