"""Forest: 1,722 trees from three, as instances that geometry nodes scatter over a hill; nothing is copied."""

from __future__ import annotations

import math
import random

import bpy

from blend_scenes import building


def build() -> None:
    """Fill the scene: a rolling ground, a collection of three trees, the nodes that plant it, a low sun."""
    building.start_scene()
    building.set_world((0.5, 0.68, 1.0), 0.5)
    trees = add_tree_collection()
    grass = building.make_shader("Grass", "Diffuse", (0.16, 0.22, 0.05))
    ground = building.link_object("Ground", building.make_plane("Ground", 120, 120), (0, 40, 0), materials=[grass])
    building.subdivide(ground, 7, "SIMPLE")
    building.displace(ground, 9.0, "CLOUDS", noise_scale=24.0, noise_depth=2)
    plant_trees(ground, trees)
    building.add_light("Low sun", "SUN", 4.0, (-6, -1, 4), (0, 0, 0), (1.0, 0.85, 0.65), angle=math.radians(1.0))
    building.add_camera((0, -24, 11), (0, 16, 1.0), 40)


def add_tree_collection() -> bpy.types.Collection:
    """A collection of two conifers and a broadleaf tree; it is left out of the view layer, only its instances show."""
    collection = bpy.data.collections.new("Trees")
    bpy.context.scene.collection.children.link(collection)
    bark = building.make_shader("Bark", "Diffuse", (0.16, 0.09, 0.05))
    for name, leaves, tiers in (("Fir", (0.03, 0.1, 0.04), 5), ("Spruce", (0.05, 0.14, 0.1), 7)):
        needles = building.make_shader(f"{name} needles", "Diffuse", leaves)
        building.link_object(name, make_conifer(name, tiers), materials=[bark, needles], collection=collection)
    leaves = building.make_shader("Birch leaves", "Diffuse", (0.42, 0.3, 0.03))
    building.link_object("Birch", make_broadleaf("Birch"), materials=[bark, leaves], collection=collection)
    bpy.context.view_layer.layer_collection.children["Trees"].exclude = True
    return collection


def make_conifer(name: str, tiers: int, sides: int = 9) -> bpy.types.Mesh:
    """Return a trunk and a stack of open cones with drooping, jagged rims; slot 0 is bark, slot 1 needles."""
    vertices, faces = make_trunk(0.12, 1.0)
    trunk_faces = len(faces)
    for tier in range(tiers):
        share = tier / tiers
        base, reach = 0.5 + 3.4 * share, 1.15 * (1 - share) + 0.2
        apex = len(vertices)
        vertices.append((0.0, 0.0, base + 1.25))
        for side in range(2 * sides):
            angle = math.tau * (side + tier) / (2 * sides)
            jagged = reach * (1.0 if side % 2 else 0.7)
            vertices.append((jagged * math.cos(angle), jagged * math.sin(angle), base + (0.0 if side % 2 else 0.18)))
            faces.append((apex, apex + 1 + side, apex + 1 + (side + 1) % (2 * sides)))
    mesh = building.new_mesh(name, vertices, faces)
    assign_crown(mesh, trunk_faces)
    return mesh


def make_broadleaf(name: str) -> bpy.types.Mesh:
    """Return a trunk and a crown of small leaves, each a triangle, that lie around a ball; slot 1 is leaves."""
    draw = random.Random(7)
    vertices, faces = make_trunk(0.09, 1.9)
    trunk_faces = len(faces)
    for _ in range(420):
        angle, z = draw.uniform(0, math.tau), draw.uniform(-1, 1)
        reach, radius = math.sqrt(1 - z * z), draw.uniform(0.75, 1.1)
        centre = (radius * reach * math.cos(angle), radius * reach * math.sin(angle), 2.6 + 1.35 * radius * z)
        faces.append(tuple(range(len(vertices), len(vertices) + 3)))
        vertices += [tuple(value + draw.uniform(-0.17, 0.17) for value in centre) for _ in range(3)]
    mesh = building.new_mesh(name, vertices, faces)
    assign_crown(mesh, trunk_faces)
    return mesh


def make_trunk(radius: float, height: float) -> tuple[list[tuple[float, ...]], list[tuple[int, ...]]]:
    """Return the corners and faces of a hexagonal trunk whose foot reaches below the ground."""
    ring = [(radius * math.cos(math.tau * i / 6), radius * math.sin(math.tau * i / 6)) for i in range(6)]
    vertices: list[tuple[float, ...]] = [(x, y, z) for z in (-0.5, height) for x, y in ring]
    return vertices, [(i, (i + 1) % 6, 6 + (i + 1) % 6, 6 + i) for i in range(6)]


def assign_crown(mesh: bpy.types.Mesh, trunk_faces: int) -> None:
    """Give all faces after the trunk's the second material slot."""
    for polygon in mesh.polygons[trunk_faces:]:
        polygon.material_index = 1


def plant_trees(ground: bpy.types.Object, trees: bpy.types.Collection) -> None:
    """Scatter instances of the collection's trees over `ground`, each turned and scaled at random."""
    nodes = building.GeometryNodes(ground, "Plant trees")
    points = nodes.add(
        "GeometryNodeDistributePointsOnFaces",
        {"Mesh": nodes.source, "Distance Min": 1.3, "Density Max": 0.16, "Seed": 3},
        distribute_method="POISSON",
    )
    chosen = nodes.add("GeometryNodeCollectionInfo", {"Collection": trees, "Separate Children": True})
    turn = nodes.add_random((0, 0, 0), (0, 0, math.tau), "FLOAT_VECTOR")
    size = nodes.add_random(0.55, 1.25)
    planted = nodes.add(
        "GeometryNodeInstanceOnPoints",
        {
            "Points": points.outputs["Points"],
            "Instance": chosen.outputs[0],
            "Pick Instance": True,
            "Rotation": turn,
            "Scale": size,
        },
    )
    both = nodes.add("GeometryNodeJoinGeometry")
    for geometry in (planted.outputs[0], nodes.source):
        nodes.tree.links.new(geometry, both.inputs[0])
    nodes.finish(both.outputs[0])


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "forest.blend")
