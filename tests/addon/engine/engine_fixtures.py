"""What the tests of the engine share: a registered add-on, a scene of emitting planes, and rendering into arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from addon.compare.cycles.exr import read_exr
from addon.properties import ENGINE
from addon.versions import blender_pass_name, find_node_tree, set_image_format

WIDTH, HEIGHT = 24, 16


def make_stage(scene: Any) -> None:
    """Set up a scene of WIDTH x HEIGHT pixels that an orthographic camera shows at 1 pixel per unit length.

    The camera stands at z = 10 and looks down; the picture's centre is the origin.
    """
    render = scene.render
    render.engine = ENGINE
    render.resolution_x, render.resolution_y, render.resolution_percentage = WIDTH, HEIGHT, 100
    scene.reference_raytracer.samples = 2
    scene.reference_raytracer.workers = 1
    scene.reference_raytracer.pixel_filter = "BOX"
    scene.reference_raytracer.filter_width = 1.0
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.ortho_scale, camera.clip_end = "ORTHO", max(WIDTH, HEIGHT), 100.0
    holder = bpy.data.objects.new("Camera", camera)
    holder.location = (0.0, 0.0, 10.0)
    scene.collection.objects.link(holder)
    scene.camera = holder


def add_plane(
    collection: Any, name: str, color: tuple[float, float, float], x: tuple[float, float], y: tuple[float, float]
) -> Any:
    """Add a plane at z = 0 that emits `color` and covers the ranges x and y."""
    mesh = bpy.data.meshes.new(name)
    corners = [(x[0], y[0], 0.0), (x[1], y[0], 0.0), (x[1], y[1], 0.0), (x[0], y[1], 0.0)]
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    mesh.materials.append(make_emission(name, color))
    plane = bpy.data.objects.new(name, mesh)
    collection.objects.link(plane)
    return plane


def save_plane(path: Path) -> Path:
    """Save a file in which a plane of radiance (0.75, 0.125, 0) fills the camera; at frame 2 it is hidden."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location = (0.0, 0.0, 10.0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    plane = add_plane(scene.collection, "Plane", (0.75, 0.125, 0.0), (-99.0, 99.0), (-99.0, 99.0))
    for frame, hidden in ((1, False), (2, True)):
        plane.hide_render = hidden
        plane.keyframe_insert("hide_render", frame=frame)
    scene.frame_set(1)
    bpy.ops.wm.save_as_mainfile(filepath=str(path), check_existing=False)
    return path


def read_image(path: Path) -> np.ndarray:
    """Return an image's pixels as stored, (h, w, 4)."""
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name = "Non-Color"
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    width, height = image.size
    bpy.data.images.remove(image)
    return pixels.reshape(height, width, 4)


def make_emission(name: str, color: tuple[float, float, float]) -> Any:
    """Return a material that only emits."""
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    nodes = find_node_tree(material).nodes
    nodes.clear()
    emission, output = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeOutputMaterial")
    emission.inputs["Color"].default_value = (*color, 1.0)
    find_node_tree(material).links.new(emission.outputs[0], output.inputs["Surface"])
    return material


def render_channels(scene: Any, path: Path) -> dict[str, NDArray[np.float32]]:
    """Render into a multilayer EXR; return its channels, (h, w) each, row 0 at the top."""
    set_image_format(scene.render.image_settings, "OPEN_EXR_MULTILAYER")
    scene.render.image_settings.color_depth = "32"
    scene.render.image_settings.exr_codec = "NONE"
    scene.render.filepath = str(path)
    scene.render.use_file_extension = False
    path.unlink(missing_ok=True)  # Blender's FINISHED proves nothing, a new file does
    bpy.ops.render.render(write_still=True, scene=scene.name)
    return read_exr(path)


def render_pass(scene: Any, path: Path, name: str = "Combined", layer: str = "") -> NDArray[np.float32]:
    """Render; return a pass of a view layer (the first one by default), (h, w, channels)."""
    return select_pass(render_channels(scene, path), name, layer or scene.view_layers[0].name)


def select_pass(channels: dict[str, NDArray[np.float32]], name: str, layer: str) -> NDArray[np.float32]:
    """Return the channels of one pass as (h, w, channels), in the order of Blender's letters."""
    from addon.passes import PASSES

    prefix = f"{layer}.{blender_pass_name(name)}."
    return np.stack([channels[prefix + letter] for letter in PASSES[name].channels], axis=-1)
