"""The lines in every 3D view: in front of objects full, behind them faint. `gpu` is imported where it draws: at the
head of a module it breaks `blender -b`.
"""

from __future__ import annotations

from typing import Any

import bpy

from ..editors import redraw
from .segments import Segments

LINE_WIDTH, CHOSEN_WIDTH = 1.5, 4.0  # pixels at a resolution scale of 1
HIDDEN_SHARE = 0.25  # opacity of what objects hide

_handler: Any = None
_segments: Segments | None = None
_chosen = 0


def show_segments(segments: Segments) -> None:
    """Draw lines in all 3D views from now on, in place of those before."""
    global _handler, _segments
    _segments = segments
    if _handler is None:
        _handler = bpy.types.SpaceView3D.draw_handler_add(draw, (), "WINDOW", "POST_VIEW")
    choose_ray(0)


def choose_ray(number: int) -> None:
    """Draw the lines of one ray thicker."""
    global _chosen
    _chosen = number
    redraw()


def clear_segments() -> None:
    """Draw nothing any more."""
    global _handler, _segments
    _segments = None
    if _handler is not None:
        bpy.types.SpaceView3D.draw_handler_remove(_handler, "WINDOW")
        _handler = None
        redraw()


def is_drawing() -> bool:
    """Return whether lines are shown."""
    return _handler is not None


def draw() -> None:
    """Draw the lines into the 3D view of the moment (Blender's callback)."""
    context = bpy.context
    if _segments is None or not len(_segments.ends) or not context.space_data.overlay.show_overlays:
        return
    import gpu

    scale = context.preferences.system.ui_scale
    is_chosen = _segments.ray == _chosen
    parts = ((_segments.select(~is_chosen), LINE_WIDTH * scale), (_segments.select(is_chosen), CHOSEN_WIDTH * scale))
    gpu.state.blend_set("ALPHA")
    gpu.state.depth_mask_set(False)
    for test, share in (("LESS_EQUAL", 1.0), ("GREATER", HIDDEN_SHARE)):
        gpu.state.depth_test_set(test)
        for segments, width in parts:
            if len(segments.ends):
                draw_lines(gpu, segments, share, width)
    gpu.state.depth_mask_set(True)
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("NONE")


def draw_lines(gpu: Any, segments: Segments, share: float, width: float) -> None:
    """Draw lines of a width in pixels with their opacity times `share`."""
    from gpu_extras.batch import batch_for_shader

    colors = segments.colors.copy()
    colors[..., 3] *= share
    shader = gpu.shader.from_builtin("POLYLINE_SMOOTH_COLOR")
    batch = batch_for_shader(shader, "LINES", {"pos": segments.ends.reshape(-1, 3), "color": colors.reshape(-1, 4)})
    shader.bind()
    shader.uniform_float("lineWidth", width)
    shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
    batch.draw(shader)
