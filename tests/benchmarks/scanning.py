"""A range scan three ways: a loop over Scene.ray_cast, a loop over a BVHTree of all meshes, and addon.ray_cast.

    python -m tests.benchmarks.scanning [--rays N]

The loops are those that range-scan add-ons and data set makers write today; prints a table in Markdown.
Source: BlenderProc, blenderproc/python/camera/CameraProjection.py, `depth_via_raytracing`.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
from mathutils import Vector
from mathutils.bvhtree import BVHTree

from addon import closest_point, ray_cast
from addon.scripting.scan import ScanPattern
from tests.folders import ROOT

PLACES = {"still_life": (0.0, -0.6, 0.3), "forest": (0.0, 0.0, 2.0)}
# A loop over more rays tells nothing new: time per ray is what is compared.
LOOPED_RAYS = 20_000


def open_scene(name: str) -> Any:
    """Return the depsgraph of one of the gallery's scenes."""
    bpy.ops.wm.open_mainfile(filepath=str(ROOT / "blend_scenes" / f"{name}.blend"), load_ui=False)
    return bpy.context.evaluated_depsgraph_get()


def make_tree(depsgraph: Any) -> BVHTree:
    """Return one tree over all meshes, instances copied, in the world."""
    corners: list[Any] = []
    triangles: list[Any] = []
    count = 0
    for instance in depsgraph.object_instances:
        if instance.object.type != "MESH":
            continue
        mesh, matrix = instance.object.data, np.array(instance.matrix_world)
        mesh.calc_loop_triangles()
        local = np.empty((len(mesh.vertices), 3), np.float32)
        mesh.vertices.foreach_get("co", local.ravel())
        faces = np.empty((len(mesh.loop_triangles), 3), np.int32)
        mesh.loop_triangles.foreach_get("vertices", faces.ravel())
        corners.append(local @ matrix[:3, :3].T + matrix[:3, 3])
        triangles.append(faces + count)
        count += len(local)
    return BVHTree.FromPolygons(np.concatenate(corners).tolist(), np.concatenate(triangles).tolist())


def measure(work: Callable[[], Any]) -> tuple[float, Any]:
    """Return the processor's seconds that some work takes, and its result."""
    start = time.process_time()
    result = work()
    return time.process_time() - start, result


def scan_scene(name: str, rays: int, with_tree: bool) -> list[str]:
    """Return the rows of the table for one scene."""
    depsgraph, origin = open_scene(name), PLACES[name]
    directions = ScanPattern(columns=max(rays // 64, 1), rows=64).make_directions()
    few = directions[:: max(1, len(directions) // LOOPED_RAYS)]
    scene, start, rows = bpy.context.scene, Vector(origin), []
    spent, hit = measure(lambda: [scene.ray_cast(depsgraph, start, Vector(row))[0] for row in few])
    rows.append(
        f"| {name} | loop over `Scene.ray_cast` | - | {1e6 * spent / len(few):.2f} | {sum(hit) / len(few):.4f} |"
    )
    if with_tree:
        built, tree = measure(lambda: make_tree(depsgraph))
        spent, hit = measure(lambda: [tree.ray_cast(start, Vector(row))[3] is not None for row in few])
        each = 1e6 * spent / len(few)
        rows.append(f"| {name} | loop over a `BVHTree` | {built:.2f} | {each:.2f} | {sum(hit) / len(few):.4f} |")
    built, _ = measure(lambda: ray_cast(depsgraph, origin, directions))
    spent, cast = measure(lambda: ray_cast(depsgraph, origin, directions))
    each, first = 1e6 * spent / len(directions), max(built - spent, 0.0)
    rows.append(f"| {name} | `ray_cast`, as arrays | {first:.2f} | {each:.2f} | {cast.result.mean():.4f} |")
    spent, cast = measure(lambda: ray_cast(depsgraph, origin, directions, hits=4))
    each = 1e6 * spent / len(directions)
    rows.append(f"| {name} | `ray_cast`, four hits each | - | {each:.2f} | {cast.result[:, 0].mean():.4f} |")
    return rows


def find_closest() -> list[str]:
    """Return the rows for closest points, near the surface of the still life."""
    depsgraph = open_scene("still_life")
    directions = ScanPattern(columns=300, rows=64).make_directions()
    cast = ray_cast(depsgraph, PLACES["still_life"], directions)
    points = cast.location[cast.result] + np.random.default_rng(1).normal(scale=0.01, size=(cast.result.sum(), 3))
    built, tree = measure(lambda: make_tree(depsgraph))
    spent, _ = measure(lambda: [tree.find_nearest(Vector(point)) for point in points])
    rows = [f"| still_life | loop over `BVHTree.find_nearest` | {built:.2f} | {1e6 * spent / len(points):.2f} | |"]
    first, _ = measure(lambda: closest_point(depsgraph, points))
    spent, _ = measure(lambda: closest_point(depsgraph, points))
    each = 1e6 * spent / len(points)
    return [*rows, f"| still_life | `closest_point`, as arrays | {max(first - spent, 0.0):.2f} | {each:.2f} | |"]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.scanning", description=__doc__.splitlines()[0])
    parser.add_argument("--rays", type=int, default=115_200, help="rays of a scan")
    rays = parser.parse_args().rays
    print("| scene | way | first, s | each ray, microseconds | share that hits |\n|---|---|---|---|---|")
    print("\n".join([*scan_scene("still_life", rays, True), *scan_scene("forest", rays, False), *find_closest()]))


if __name__ == "__main__":
    main()
