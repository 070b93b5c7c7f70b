"""Blender's handlers: functions that it calls when something happens, joined and left.

A list may have been emptied by others meanwhile, so leaving it takes what is there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy

HANDLERS = bpy.app.handlers
# A render that is complete or was stopped, or another file: what is kept for a render ends with these.
RENDER_STOPS = (HANDLERS.render_cancel, HANDLERS.load_pre)
RENDER_ENDS = (HANDLERS.render_complete, *RENDER_STOPS)


def join(function: Callable[..., Any], *lists: Any) -> None:
    """Have Blender call a function, once, for each of some lists of `bpy.app.handlers`."""
    for called in lists:
        if function not in called:
            called.append(function)


def leave(function: Callable[..., Any], *lists: Any) -> None:
    """Have Blender not call it any more."""
    for called in lists:
        if function in called:
            called.remove(function)
