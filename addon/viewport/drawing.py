"""A picture on the screen: textures, drawn where its pixels belong.

To bring a large picture to the graphics card takes longer than Blender should wait. So it goes there in bands of rows,
a few at a time, and takes the place of the last one when all are there. Viewports are drawn in linear light, which
Blender transforms to the display's colors. `gpu` is imported where it is used: at module level it would keep Blender
from running in the background.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from raytracer.rendering.progressive import Picture

# Seconds of a redraw that pictures may take on their way to the graphics card, and the pixels that go at a time.
UPLOAD_SECONDS = 0.01
BAND_PIXELS = 1 << 17


@dataclass
class Upload:
    """A picture and the textures of its rows so far: bands of `rows` rows, from below."""

    picture: Picture
    rows: int
    bands: list[Any] = field(default_factory=list)

    @property
    def is_complete(self) -> bool:
        return len(self.bands) * self.rows >= len(self.picture.pixels)

    def can_go_on_with(self, picture: Picture) -> bool:
        """True where the rest may come from another picture: one of the same pixels, with more samples.

        One with as many is the same without its noise, and one with fewer may show something else.
        """
        is_further = picture.samples > self.picture.samples
        same_place = place_of(picture) == place_of(self.picture)
        return is_further and same_place and picture.pixels.shape == self.picture.pixels.shape


def place_of(picture: Picture) -> tuple[int, int, int, int]:
    """Return left, bottom, right and top of a picture, pixels of the region."""
    return picture.left, picture.bottom, picture.right, picture.top


class Canvas:
    """The pictures of a region on the graphics card: the one that is shown, and the next one on its way."""

    def __init__(self) -> None:
        self._shown: Upload | None = None
        self._coming: Upload | None = None

    @property
    def is_busy(self) -> bool:
        """True while a picture is on its way."""
        return self._coming is not None

    def take(self, picture: Picture) -> None:
        """Have a picture shown next."""
        if self._coming is not None and self._coming.can_go_on_with(picture):
            self._coming.picture = picture
            return
        self._coming = Upload(picture, max(1, BAND_PIXELS // picture.pixels.shape[1]))

    def upload(self) -> None:
        """Bring some of the picture that is on its way to the graphics card."""
        started = time.perf_counter()
        coming = self._coming
        while coming is not None and not coming.is_complete:
            first = len(coming.bands) * coming.rows
            coming.bands.append(make_texture(coming.picture.pixels[first : first + coming.rows]))
            if time.perf_counter() - started > UPLOAD_SECONDS:
                break
        if coming is not None and coming.is_complete:
            self._shown, self._coming = coming, None

    def draw(self, engine: Any, scene: Any) -> None:
        """Draw what is shown, if there is anything, into the region that is being drawn."""
        if self._shown is None:
            return
        import gpu
        from gpu_extras.presets import draw_texture_2d

        gpu.state.blend_set("ALPHA_PREMULT")
        engine.bind_display_space_shader(scene)
        left, bottom, right, top = place_of(self._shown.picture)
        pixel = (top - bottom) / len(self._shown.picture.pixels)
        for number, texture in enumerate(self._shown.bands):
            low = bottom + number * self._shown.rows * pixel
            draw_texture_2d(texture, (left, low), right - left, texture.height * pixel)
        engine.unbind_display_space_shader()
        gpu.state.blend_set("NONE")


def make_texture(pixels: Any) -> Any:
    """Return pixels (h, w, 4), lowest row first, as a texture."""
    import gpu

    height, width, _ = pixels.shape
    buffer = gpu.types.Buffer("FLOAT", pixels.size, np.ascontiguousarray(pixels).reshape(-1))
    return gpu.types.GPUTexture((width, height), format="RGBA32F", data=buffer)
