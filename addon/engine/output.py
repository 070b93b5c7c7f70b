"""The render result: which pixels of the frame it holds, and how a film gets into it.

Blender stores rows from the bottom up; the ray tracer's arrays have the top row first.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..versions import blender_pass_name


class Border(NamedTuple):
    """Pixels to render: columns x_min <= x < x_max and rows y_min <= y < y_max, row 0 at the bottom of the frame."""

    x_min: int
    y_min: int
    x_max: int
    y_max: int

    @property
    def width(self) -> int:
        return self.x_max - self.x_min

    @property
    def height(self) -> int:
        return self.y_max - self.y_min


def read_border(settings: Any, width: int, height: int) -> Border:
    """Return the render border of `Scene.render` in pixels of a frame of width x height, or the whole frame.

    Blender stores a border as fractions of the frame and cuts the products off to whole pixels, in 32-bit floating
    point; so does this, or a border could be a pixel off.
    """
    if not settings.use_border:
        return Border(0, 0, width, height)

    def cut_off(fraction: float, size: int) -> int:
        return int(np.float32(fraction) * np.float32(size))

    return Border(
        cut_off(settings.border_min_x, width),
        cut_off(settings.border_min_y, height),
        cut_off(settings.border_max_x, width),
        cut_off(settings.border_max_y, height),
    )


def measure_picture(settings: Any) -> tuple[int, int]:
    """Return the width and height, in pixels, of the picture that Blender writes with `Scene.render`."""
    sides = (settings.resolution_x, settings.resolution_y)
    width, height = (side * settings.resolution_percentage // 100 for side in sides)
    if not settings.use_crop_to_border:
        return width, height
    border = read_border(settings, width, height)
    return border.width, border.height


class RenderOutput:
    """Blender's result of one view layer, or of one of its stereo views, open inside a `with` block and always ended.

    It is ended without `cancel`, even after an error or Esc: what was written so far stays, and Blender crashes when
    it saves a result that was thrown away.
    """

    def __init__(self, engine: Any, view_layer: str, border: Border, view: str = "") -> None:
        self._engine = engine
        self._view_layer = view_layer
        self._border = border
        self._view = {"view": view} if view else {}

    def __enter__(self) -> RenderOutput:
        # Blender counts a result's corner from the border's own.
        size = self._border.width, self._border.height
        self._result = self._engine.begin_result(0, 0, *size, layer=self._view_layer, **self._view)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._engine.end_result(self._result)

    def write(self, passes: Mapping[str, NDArray[np.float32]]) -> None:
        """Copy a film's passes, (h, w, c) by name, into the result."""
        names = {blender_pass_name(name): name for name in passes}
        for stored in self._result.layers[0].passes:
            name = names.get(stored.name)
            if name is not None:
                stored.rect.foreach_set(to_blender_pixels(passes[name]))

    def note(self, fields: Iterable[tuple[str, str]]) -> None:
        """Add fields, names and values, to the metadata of the picture."""
        for name, value in fields:  # to the whole result: a part's own are lost
            self._engine.get_result().stamp_data_add_field(name, value)

    def show(self) -> None:
        """Let Blender draw what was written."""
        self._engine.update_result(self._result)


def to_blender_pixels(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return (h, w, c) pixels, top row first, as Blender's flat array, bottom row first."""
    return np.ascontiguousarray(pixels[::-1]).reshape(-1)
