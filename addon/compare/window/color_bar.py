"""The scale of the error map: a bar of its colors, with the errors that they stand for, at the foot of its editor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy

from ..picture import HEAT
from . import session
from .heat_map import IMAGE_NAME

# Sizes in points of Blender's interface: of the bar, of its margin and of the letters.
WIDTH, HEIGHT, MARGIN, LETTERS = 200, 12, 16, 11
STEPS = 4

_handler: Any = None


def list_marks(gain: float) -> list[str]:
    """Return the errors at the ends of the bar's steps, in words; white is 1 / gain or more."""
    return [f"{step / STEPS / gain:g}" for step in range(STEPS + 1)]


def draw() -> None:
    """Draw the bar over the map, where an image editor shows it (Blender's callback)."""
    context, outcome = bpy.context, session.find_outcome()
    image = context.space_data.image
    if outcome is None or outcome.kind != "cycles" or image is None or image.name != IMAGE_NAME:
        return
    scale = context.preferences.system.ui_scale
    left = bottom = MARGIN * scale
    draw_bar(left, bottom, WIDTH * scale, HEIGHT * scale)
    draw_marks(list_marks(outcome.gain), left, bottom + (HEIGHT + 4) * scale, WIDTH * scale, LETTERS * scale)


def draw_bar(left: float, bottom: float, width: float, height: float) -> None:
    """Draw the colors of the map from left to right; pixels of the region."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    corners, colors = [], []
    for stop, color in enumerate(HEAT / 255.0):
        x = left + width * stop / (len(HEAT) - 1)
        corners += [(x, bottom), (x, bottom + height)]
        colors += [(*color, 1.0)] * 2
    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    batch_for_shader(shader, "TRI_STRIP", {"pos": corners, "color": colors}).draw(shader)


def draw_marks(marks: Sequence[str], left: float, bottom: float, width: float, size: float) -> None:
    """Draw texts above the bar, evenly spread from end to end."""
    import blf

    font = 0
    blf.size(font, size)
    blf.color(font, 1.0, 1.0, 1.0, 1.0)
    for number, mark in enumerate(marks):
        middle = left + width * number / (len(marks) - 1)
        blf.position(font, middle - blf.dimensions(font, mark)[0] / 2, bottom, 0)
        blf.draw(font, mark)


def register() -> None:
    """Draw from now on."""
    global _handler
    _handler = bpy.types.SpaceImageEditor.draw_handler_add(draw, (), "WINDOW", "POST_PIXEL")


def unregister() -> None:
    """Draw no more."""
    global _handler
    bpy.types.SpaceImageEditor.draw_handler_remove(_handler, "WINDOW")
    _handler = None
