"""A scene that is nothing but a Denoise node between an image and a file; it runs in a process of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..versions import escape_path, find_compositor_output, make_compositor_tree, set_high_range, set_image_format

Pixels = NDArray[np.float32]
# What the Denoise node takes; the first is what it denoises, the others tell edges of things from noise.
INPUTS = ("Image", "Albedo", "Normal")


def carry_out(folder: Path, number: str) -> None:
    """Denoise the pictures FOLDER/NUMBER_INPUT.npy into FOLDER/NUMBER_Done.npy, for `own_blender.child`."""
    paths = {name: folder / f"{number}_{name}.npy" for name in INPUTS}
    pictures = {name: np.load(path) for name, path in paths.items() if path.exists()}
    np.save(folder / f"{number}_Done.npy", denoise_pictures(pictures, folder / f"{number}.exr"))


def denoise_pictures(pictures: dict[str, Pixels], file: Path) -> Pixels:
    """Return the picture "Image" without its noise.

    Parameters
    ----------
    pictures : arrays (h, w, 3), linear, by the name of the node's input (`INPUTS`)
    file : where the compositor may write
    """
    height, width, _ = pictures["Image"].shape
    scene = bpy.data.scenes.new("Denoise")
    images = {name: make_image(name, pixels) for name, pixels in pictures.items()}
    try:
        link_nodes(make_compositor_tree(scene), images)
        set_output(scene, width, height, file)
        bpy.ops.render.render(write_still=True, scene=scene.name)
        return read_image(file)
    finally:
        for image in images.values():
            bpy.data.images.remove(image)
        bpy.data.scenes.remove(scene)
        file.unlink(missing_ok=True)


def make_image(name: str, pixels: Pixels) -> Any:
    """Return an image whose numbers Blender takes as they are."""
    height, width, _ = pixels.shape
    image = bpy.data.images.new(name, width, height, alpha=True, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    opaque = np.concatenate((pixels, np.ones((height, width, 1), np.float32)), axis=2)
    image.pixels.foreach_set(opaque[::-1].ravel())  # Blender's rows run from the bottom up
    image.update()
    return image


def read_image(file: Path) -> Pixels:
    """Return the color of a picture file as it is stored, (h, w, 3), top row first."""
    image = bpy.data.images.load(str(file), check_existing=False)
    image.colorspace_settings.name = "Non-Color"
    width, height = image.size
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return np.ascontiguousarray(pixels.reshape(height, width, 4)[::-1, :, :3])


def link_nodes(tree: Any, images: dict[str, Any]) -> None:
    """Add the nodes: images, Denoise, and what the scene shows."""
    denoise = tree.nodes.new("CompositorNodeDenoise")
    set_high_range(denoise)
    for name, image in images.items():
        source = tree.nodes.new("CompositorNodeImage")
        source.image = image
        tree.links.new(source.outputs["Image"], denoise.inputs[name])
    tree.links.new(denoise.outputs["Image"], find_compositor_output(tree))


def set_output(scene: Any, width: int, height: int, file: Path) -> None:
    """Let the scene write its pixels to `file`, in full precision."""
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = width, height, 100
    render.use_compositing, render.use_sequencer = True, False
    render.compositor_device = "CPU"  # a process without a window may have no other
    set_image_format(render.image_settings, "OPEN_EXR")
    render.image_settings.color_depth, render.image_settings.exr_codec = "32", "NONE"
    render.filepath, render.use_file_extension = escape_path(str(file)), False
