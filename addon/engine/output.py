"""The render result: which pixels of the frame it holds, and how a film gets into it.

Blender stores rows from the bottom up; the ray tracer's arrays have the top row first.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.film.film import Film

from ..versions import blender_pass_name

# Pixels that are handed over at a time: a whole picture beside the film and Blender's own would be one too many.
STRIP = 1 << 17


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
    """Blender's result of one view layer, or of one of its stereo views, which a `with` block always leaves there.

    What is shown meanwhile is one of the whole border, begun when there is something to show; the film comes last, in
    strips. Each is ended without `cancel`, even after an error or Esc: what was written so far stays, and Blender
    crashes when it saves a result that was thrown away.
    """

    def __init__(self, engine: Any, view_layer: str, border: Border, view: str = "") -> None:
        self._engine = engine
        self._view_layer = view_layer
        self._border = border
        self._view = {"view": view} if view else {}
        self._whole: Any = None
        self._is_written = False

    def __enter__(self) -> RenderOutput:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not self._is_written:
            self._whole = self._whole or self._begin(0, self._border.height)
        self._end_whole()

    def write(self, passes: Mapping[str, NDArray[np.float32]]) -> None:
        """Copy passes, (h, w, c) by name, into what is shown."""
        self._whole = self._whole or self._begin(0, self._border.height)
        fill_passes(self._whole, {name: to_blender_pixels(values) for name, values in passes.items()})

    def write_film(self, film: Film, uses_up: bool = False, **replaced: NDArray[np.float32]) -> None:
        """Copy all passes of a film into the result, the highest strip first.

        uses_up : True where nobody needs the film any more: strips that Blender has are cut off it
        replaced : passes (h, w, c) that take the place of the film's own
        """
        self._end_whole()
        readers = {name: film.open_pass(name) for name in film.names if name not in replaced}
        width, height = self._border.width, self._border.height
        rows = max(1, STRIP // width)
        for start in reversed(range(0, height, rows)):
            stop = min(start + rows, height)
            strip = {name: read(slice(start * width, stop * width)).reshape(-1) for name, read in readers.items()}
            strip |= {name: to_blender_pixels(part[height - stop : height - start]) for name, part in replaced.items()}
            result = self._begin(start, stop)
            fill_passes(result, strip)
            self._engine.end_result(result)
            if uses_up:
                film.cut_off(start)
        self._is_written = True

    def _begin(self, start: int, stop: int) -> Any:
        """Return a result of some rows."""
        # Blender counts a result's corner from the border's own.
        size = self._border.width, stop - start
        return self._engine.begin_result(0, start, *size, layer=self._view_layer, **self._view)

    def _end_whole(self) -> None:
        if self._whole is not None:
            self._engine.end_result(self._whole)
            self._whole = None

    def note(self, fields: Iterable[tuple[str, str]]) -> None:
        """Add fields, names and values, to the metadata of the picture."""
        for name, value in fields:  # to the whole result: a part's own are lost
            self._engine.get_result().stamp_data_add_field(name, value)

    def show(self) -> None:
        """Let Blender draw what was written."""
        self._engine.update_result(self._whole)


def fill_passes(result: Any, passes: Mapping[str, NDArray[np.float32]]) -> None:
    """Copy passes by name, each flat as Blender has them, into a result."""
    names = {blender_pass_name(name): name for name in passes}
    for stored in result.layers[0].passes:
        name = names.get(stored.name)
        if name is not None:
            stored.rect.foreach_set(passes[name])


def to_blender_pixels(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return (h, w, c) pixels, top row first, as Blender's flat array, bottom row first."""
    return np.ascontiguousarray(pixels[::-1]).reshape(-1)
