"""Blender's editors: asking them to draw themselves anew, and fitting text into them."""

from __future__ import annotations

import textwrap
from typing import Any

import bpy

EDITORS = ("VIEW_3D", "IMAGE_EDITOR", "PROPERTIES")


def redraw(*kinds: str) -> None:
    """Ask all areas of some kinds, such as VIEW_3D, to draw themselves anew; of EDITORS where none is named."""
    for manager in bpy.data.window_managers:
        for window in manager.windows:
            for area in window.screen.areas:
                if area.type in (kinds or EDITORS):
                    area.tag_redraw()


def count_letters(context: Any) -> int:
    """Return about how many letters fit beside an icon in the panel's width."""
    letter_width = 7 * context.preferences.system.ui_scale
    return max(20, int(context.region.width / letter_width) - 8)


def wrap_text(text: str, width: int) -> list[str]:
    """Return `text` in lines of at most `width` letters, broken at spaces; Blender's labels do not wrap."""
    return textwrap.wrap(text, width) or [""]
