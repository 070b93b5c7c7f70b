"""The pictures of addon/scripting/README.md: range scans, their echoes, and maps of what a camera sees.

Run from the top folder: `python -m blend_scenes.scan_pictures`. Needs Pillow; the scans are rendered by this engine.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from PIL import Image

import addon
from addon import ray_cast, scan
from blend_scenes import building

GALLERY = building.SCENES / "gallery"
SIZE = (640, 400)
# From near to far, and from thin to thick: dark blue, green, yellow; linear between (the ends and middle of viridis).
COLORS = np.array([(0.27, 0.0, 0.33), (0.13, 0.57, 0.55), (0.99, 0.91, 0.14)])


def make_tiles(points: Any, name: str, low: float, high: float, size: float) -> Any:
    """Return a mesh of a square at each point, across the camera's view, that glows in the colors of an attribute."""
    count = len(points.data.vertices)
    center, values = np.empty(3 * count, dtype=np.float32), np.empty(count, dtype=np.float32)
    points.data.vertices.foreach_get("co", center)
    points.data.attributes[name].data.foreach_get("value", values)
    axes = np.array(bpy.context.scene.camera.matrix_world)[:3, :2].T * size / 2  # right, up
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) @ axes  # (4, 3)
    mesh = bpy.data.meshes.new(name)
    places = (center.reshape(-1, 1, 3) + corners).reshape(-1, 3)
    mesh.from_pydata(places, [], np.arange(4 * count).reshape(-1, 4))
    share = np.clip((values - low) / (high - low), 0, 1)
    stops = np.linspace(0, 1, len(COLORS))
    colors = np.stack([np.interp(share, stops, COLORS[:, channel]) for channel in range(3)], axis=-1)
    linear = np.concatenate([colors**2.2, np.ones((count, 1))], axis=1)  # about what sRGB asks for
    attribute = mesh.attributes.new("Tint", "FLOAT_COLOR", "FACE")
    attribute.data.foreach_set("color", linear.astype(np.float32).ravel())
    mesh.materials.append(make_glow("Tint"))
    tiles = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(tiles)
    return tiles


def make_glow(name: str) -> Any:
    """Return a material that glows in the color of an attribute."""
    material = bpy.data.materials.new(name)
    if material.node_tree is None:  # always there from Blender 5.0 on
        material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    attribute, glow, output = (nodes.new(f"ShaderNode{kind}") for kind in ("Attribute", "Emission", "OutputMaterial"))
    attribute.attribute_name = name
    links.new(attribute.outputs["Color"], glow.inputs["Color"])
    links.new(glow.outputs[0], output.inputs["Surface"])
    return material


def render_only(points: Any, path: Path, samples: int = 16) -> None:
    """Render the points alone, on black, through the scene's camera."""
    scene = bpy.context.scene
    for thing in scene.objects:
        thing.hide_render = thing != points and thing.type != "CAMERA"
    for collection in bpy.data.collections:
        collection.hide_render = True
    scene.world = None
    scene.render.engine = "REFERENCE_RAYTRACER"
    scene.reference_raytracer.samples = samples
    scene.view_settings.view_transform = "Standard"
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    Image.open(path).convert("RGB").quantize(128).save(path, optimize=True)


def open_scene(name: str) -> Any:
    """Open one of the gallery's scenes and return its depsgraph."""
    bpy.ops.wm.open_mainfile(filepath=str(building.SCENES / f"{name}.blend"), load_ui=False)
    return bpy.context.evaluated_depsgraph_get()


def aim_camera(place: tuple[float, float, float], target: tuple[float, float, float]) -> None:
    """Move the scene's camera."""
    camera = bpy.context.scene.camera
    camera.location, camera.data.dof.use_dof = place, False
    building.aim(camera, target)
    bpy.context.view_layer.update()


def scan_forest() -> None:
    """A LiDAR of 64 rings among the trees, seen from above, colored by distance."""
    depsgraph = open_scene("forest")
    points = scan(
        depsgraph,
        (0, 0, 2.0),
        vertical=(math.radians(-25), math.radians(25)),
        columns=1800,
        rows=64,
        distance=60,
    )
    aim_camera((0, -26, 20), (0, -1, 0))
    tiles = make_tiles(points, "distance", 0, 30, size=0.06)
    render_only(tiles, GALLERY / "scan_forest.png")


def map_colors(values: Any, low: float, high: float) -> Any:
    """Return values (h, w) as colors (h, w, 3) uint8; black where they are not finite."""
    share = np.clip((values - low) / (high - low), 0, 1)
    stops = np.linspace(0, 1, len(COLORS))
    rows = np.stack([np.interp(share, stops, COLORS[:, channel]) for channel in range(3)], axis=-1)
    return np.uint8(np.round(255 * np.where(np.isfinite(values)[..., np.newaxis], rows, 0)))


def make_camera_rays(width: int, height: int) -> tuple[Any, Any]:
    """Return the place of the scene's camera and the directions (h w, 3) through the centers of pixels."""
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = width, height
    camera = np.array(scene.camera.matrix_world, dtype=float)
    right_top, _, left, top = (np.array(corner) for corner in scene.camera.data.view_frame(scene=scene))
    u, v = (np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height
    grid = top + u[None, :, None] * (right_top - top) + v[:, None, None] * (left - top)
    return camera[:3, 3], grid.reshape(-1, 3) @ camera[:3, :3].T


def map_still_life() -> None:
    """What a data set needs of a picture: distance, normals, objects, and all that each ray passes through."""
    depsgraph = open_scene("still_life")
    width, height = SIZE[0] // 2, SIZE[1] // 2
    origin, directions = make_camera_rays(width, height)
    cast = ray_cast(depsgraph, origin, directions, hits=math.inf)
    count = cast.result.sum(axis=1).reshape(height, width)
    first = cast.result[:, 0].reshape(height, width)
    distance = np.where(first, cast.distance[:, 0].reshape(height, width), np.nan)
    normal = np.where(first[..., None], cast.normal[:, 0].reshape(height, width, 3) / 2 + 0.5, 0)
    palette = np.random.default_rng(3).uniform(0.2, 1, (len(cast.objects) + 1, 3))
    palette[-1] = 0
    tiles = [
        map_colors(distance, np.nanmin(distance), np.nanpercentile(distance, 95)),
        np.uint8(255 * normal),
        np.uint8(255 * palette[cast.object[:, 0].reshape(height, width)]),
        map_colors(np.where(count > 0, count, np.nan).astype(float), 1, np.percentile(count, 99)),
    ]
    rows = [np.concatenate(tiles[:2], axis=1), np.concatenate(tiles[2:], axis=1)]
    Image.fromarray(np.concatenate(rows)).quantize(256).save(GALLERY / "scan_maps.png", optimize=True)


def main() -> None:
    """Make the pictures."""
    addon.register()
    try:
        scan_forest()
        map_still_life()
    finally:
        addon.unregister()


if __name__ == "__main__":
    main()
