"""The error of every pixel as an image of Blender's."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..picture import show_heat

IMAGE_NAME = "Raytracer Difference"


def show_heat_map(heat: NDArray[np.float32]) -> Any:
    """Put an error map (h, w), 0 to 1, row 0 at the top, into the image of that name; return it."""
    height, width = heat.shape
    image = bpy.data.images.get(IMAGE_NAME)
    if image is None:
        image = bpy.data.images.new(IMAGE_NAME, width, height)
    if tuple(image.size) == (0, 0):  # it was saved as a file that is gone
        image.source = "GENERATED"
    if tuple(image.size) != (width, height):
        image.scale(width, height)
    pixels = np.ones((height, width, 4), dtype=np.float32)
    pixels[..., :3] = show_heat(heat[::-1]) / np.float32(255)
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    return image


def open_image(window: Any, image: Any) -> bool:
    """Show an image, as large as fits, in an image editor of a window; return whether there is one."""
    for area in window.screen.areas if window else ():
        if area.type == "IMAGE_EDITOR":
            area.spaces.active.image = image
            fit_image(window, area)
            return True
    return False


def fit_image(window: Any, area: Any) -> None:
    """Let an image fill its editor."""
    region = next(region for region in area.regions if region.type == "WINDOW")
    with bpy.context.temp_override(window=window, area=area, region=region):
        bpy.ops.image.view_all(fit_view=True)
