"""Blender's three ray casters as peers, each in its fastest form: a Python loop with prebuilt Vectors.

All three are float32 inside and take one ray a call; `BVHTree` is Blender's library for scripts, `Object.ray_cast`
and `Scene.ray_cast` go through the evaluated scene.
"""

from __future__ import annotations

import numpy as np

from tests.benchmarks.peers import Answer, Built, Peer, miss_all, project_location

BVH_TREE, OBJECT, SCENE = "Blender BVHTree", "Blender Object.ray_cast", "Blender Scene.ray_cast"
# What Blender's functions take for "any distance".
ANYWHERE = 1.70141e38
RAY_LIMIT = 1 << 20


def load(name):
    """Return one of Blender's casters as a Peer."""
    import bpy

    build = {BVH_TREE: build_bvh_tree, OBJECT: build_object, SCENE: build_scene}[name]
    return Peer(name, f"Blender {bpy.app.version_string}", build, RAY_LIMIT)


def prepare(origins, directions, reach):
    """Return the arrays, and one tuple (origin, direction, distance) of Blender's types per ray.

    Blender measures distances in metres along the normalised direction: t times the direction's length.
    """
    from mathutils import Vector

    lengths = np.linalg.norm(directions, axis=1)
    distances = np.minimum(reach * lengths, ANYWHERE).tolist()
    calls = [
        (Vector(origin), Vector(direction), distance)
        for origin, direction, distance in zip(origins.tolist(), directions.tolist(), distances, strict=True)
    ]
    return origins, directions, calls


def build_bvh_tree(positions, triangles):
    """`mathutils.bvhtree.BVHTree` over the mesh."""
    from mathutils.bvhtree import BVHTree

    tree = BVHTree.FromPolygons(positions.tolist(), triangles.tolist(), all_triangles=True)

    def cast(rays):
        ray_cast = tree.ray_cast
        return rays[1], [ray_cast(*call) for call in rays[2]]

    return Built(prepare, cast, read_distances, occlude=cast)


def read_distances(found):
    """Translate (location, normal, index, distance) per ray."""
    directions, results = found
    t, primitive = miss_all(len(results))
    for row, (_, _, index, distance) in enumerate(results):
        if index is not None:
            t[row], primitive[row] = distance, index
    return Answer(t / np.linalg.norm(directions, axis=1), primitive)


def show_mesh(positions, triangles, title):
    """Put the mesh, alone, into a Blender scene of this title; return (scene, depsgraph, evaluated object)."""
    import bpy

    for collection in (bpy.data.scenes, bpy.data.objects, bpy.data.meshes):
        if title in collection:
            collection.remove(collection[title])
    mesh = bpy.data.meshes.new(title)
    mesh.from_pydata(positions, [], triangles)
    shown = bpy.data.objects.new(title, mesh)
    scene = bpy.data.scenes.new(title)
    scene.collection.objects.link(shown)
    layer = scene.view_layers[0]
    layer.update()
    return scene, layer.depsgraph, shown.evaluated_get(layer.depsgraph)


def build_object(positions, triangles):
    """`Object.ray_cast` on an object with the mesh; the first cast builds its tree, so one is made here."""
    shown = show_mesh(positions, triangles, OBJECT)[2]
    ray_cast = shown.ray_cast
    ray_cast((0, 0, 0), (0, 0, 1))

    def cast(rays):
        found = [ray_cast(origin, direction, distance=reach) for origin, direction, reach in rays[2]]
        return rays, found

    return Built(prepare, cast, read_locations, occlude=cast)


def build_scene(positions, triangles):
    """`Scene.ray_cast` in a scene with the mesh; the first cast builds its tree, so one is made here."""
    scene, depsgraph, _ = show_mesh(positions, triangles, SCENE)
    ray_cast = scene.ray_cast
    ray_cast(depsgraph, (0, 0, 0), (0, 0, 1))

    def cast(rays):
        found = [ray_cast(depsgraph, origin, direction, distance=reach) for origin, direction, reach in rays[2]]
        return rays, found

    return Built(prepare, cast, read_locations, occlude=cast)


def read_locations(found):
    """Translate (result, location, normal, index, ...) per ray; these casters tell no distance."""
    (origins, directions, _), results = found
    t, primitive = miss_all(len(results))
    hit = np.array([result[0] for result in results], dtype=bool)
    locations = np.array([result[1][:] for result in results if result[0]], dtype=np.float64).reshape(-1, 3)
    t[hit] = project_location(origins[hit], directions[hit], locations)
    primitive[hit] = [result[3] for result in results if result[0]]
    return Answer(t, primitive)


PEERS = dict.fromkeys((BVH_TREE, OBJECT, SCENE), load)
