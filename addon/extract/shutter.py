"""When the shutter is open, and how far; the depsgraph shows the middle of its time meanwhile.

References
----------
Blender, intern/cycles/blender/sync.cpp (sync_motion), blender/camera.cpp: position, curve.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import versions

# Cycles evaluates the shutter's curve so often.
CURVE_SIZE = 256
# Called with a frame, a whole number, and what is behind its point, to have the depsgraph show it.
SetFrame = Callable[[int, float], None]


@dataclass(frozen=True)
class Shutter:
    """When the shutter is open.

    frame, subframe : the scene's; offset : frames from there to the middle of the time; length : frames that it takes
    """

    frame: int
    subframe: float
    offset: float
    length: float

    def find_frame(self, time: float) -> tuple[int, float]:
        """Return frame and subframe at a time, -1 where the shutter opens to 1 where it closes."""
        at = self.frame + self.subframe + self.offset + time * self.length / 2.0
        return math.floor(at), at - math.floor(at)


def is_blurred(depsgraph: Any) -> bool:
    """Return whether a view layer shows what moves while the shutter is open; its own filter may leave that out."""
    return bool(depsgraph.scene.render.use_motion_blur and depsgraph.view_layer.use_motion_blur)


def read_shutter(scene: Any) -> Shutter:
    """Return when a scene's shutter is open."""
    length = scene.render.motion_blur_shutter
    offset = {"START": 0.5, "CENTER": 0.0, "END": -0.5}[versions.read_shutter_position(scene)] * length
    return Shutter(scene.frame_current, scene.frame_subframe, offset, length)


def span_neighbors(scene: Any) -> Shutter:
    """Return a shutter that is open from the frame before to the next one, for the Vector pass."""
    return Shutter(scene.frame_current, scene.frame_subframe, 0.0, 2.0)


def read_curve(render: Any) -> NDArray[np.float64] | None:
    """Return how far the shutter is open, (CURVE_SIZE,); None where that never changes, or it never opens."""
    curve = render.motion_blur_shutter_curve
    curve.initialize()
    places = np.linspace(0.0, 1.0, CURVE_SIZE).tolist()
    values = np.abs([curve.evaluate(curve.curves[0], place) for place in places])
    return None if (values == values[0]).all() else values


@contextmanager
def opened_shutter(shutter: Shutter, set_frame: SetFrame) -> Iterator[None]:
    """Set the depsgraph to the middle of the shutter's time, and afterwards to the frame that it showed."""
    try:
        if shutter.offset:
            set_frame(*shutter.find_frame(0.0))
        yield
    finally:
        set_frame(shutter.frame, shutter.subframe)


def list_times(steps: int) -> list[float]:
    """Return the times of steps, -1 to 1."""
    return [2.0 * step / (steps - 1) - 1.0 for step in range(steps)] if steps else []
