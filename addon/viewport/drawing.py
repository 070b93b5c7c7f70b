"""A picture on the screen: one texture, drawn where its pixels belong.

Viewports are drawn in linear light; Blender transforms what all have drawn to the display. `gpu` is imported where it is used: at module
level it would keep Blender from running in the background. Imports raytracer.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from raytracer.progressive import Picture


class Canvas:
    """The newest picture of a region, on the graphics card."""

    def __init__(self) -> None:
        self._texture: Any = None
        self._place = (0, 0, 0, 0)

    def take(self, picture: Picture) -> None:
        """Keep a picture instead of the last."""
        import gpu

        height, width, _ = picture.pixels.shape
        buffer = gpu.types.Buffer("FLOAT", picture.pixels.size, np.ascontiguousarray(picture.pixels).reshape(-1))
        self._texture = gpu.types.GPUTexture((width, height), format="RGBA32F", data=buffer)
        self._place = (picture.left, picture.bottom, picture.right - picture.left, picture.top - picture.bottom)

    def draw(self, engine: Any, scene: Any) -> None:
        """Draw the picture, if there is one, into the region that is being drawn."""
        if self._texture is None:
            return
        import gpu
        from gpu_extras.presets import draw_texture_2d

        left, bottom, width, height = self._place
        gpu.state.blend_set("ALPHA_PREMULT")
        engine.bind_display_space_shader(scene)
        draw_texture_2d(self._texture, (left, bottom), width, height)
        engine.unbind_display_space_shader()
        gpu.state.blend_set("NONE")
