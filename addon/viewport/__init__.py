"""Rendered shading: what Blender calls for each region that shows it, and the watch that asks for redraws.

`session` talks to the renderer, `views` reads where a region looks, `drawing` puts pictures on the screen. An engine
object of Blender's holds the session of its region. Imports bpy and this package.
"""

from __future__ import annotations

import weakref
from typing import Any

import bpy
from bpy.app.handlers import persistent

from .drawing import Canvas
from .session import Session

handlers = bpy.app.handlers
UNANNOUNCED = (handlers.undo_pre, handlers.undo_post, handlers.redo_pre, handlers.redo_post)
# Seconds between two looks for news of the renderers.
WATCH_INTERVAL = 1 / 60


class Viewport:
    """What an engine object keeps for its region."""

    def __init__(self) -> None:
        self.session = Session()
        self.canvas = Canvas()


_viewports: weakref.WeakKeyDictionary[Any, Viewport] = weakref.WeakKeyDictionary()


def update(engine: Any, context: Any, depsgraph: Any) -> None:
    """Take a change of the scene (Blender's callback `view_update`)."""
    find_viewport(engine).session.update(depsgraph, context.space_data)


def draw(engine: Any, context: Any, depsgraph: Any) -> None:
    """Draw a region (Blender's callback `view_draw`)."""
    viewport, scene = find_viewport(engine), depsgraph.scene_eval
    pixel_size = int(engine.get_preview_pixel_size(depsgraph.scene))
    viewport.session.look(context.region, context.region_data, context.space_data, scene, pixel_size)
    picture = viewport.session.read_picture()
    if picture is not None:
        viewport.canvas.take(picture)
    viewport.canvas.upload()
    viewport.canvas.draw(engine, depsgraph.scene)
    engine.update_stats("", viewport.session.status)


def free(engine: Any) -> None:
    """End what an engine object began."""
    viewport = _viewports.pop(engine, None)
    if viewport is not None:
        viewport.session.close()


def find_viewport(engine: Any) -> Viewport:
    """Return what an engine object keeps, begun when it is first asked for."""
    if engine not in _viewports:
        _viewports[engine] = Viewport()
        if not bpy.app.timers.is_registered(watch):
            bpy.app.timers.register(watch, persistent=True)
    return _viewports[engine]


def watch() -> float | None:
    """Let regions with news be drawn; called by Blender's timer while there are viewports."""
    for engine, viewport in list(_viewports.items()):
        if viewport.session.has_news or viewport.canvas.is_busy:
            engine.tag_redraw()
    return WATCH_INTERVAL if _viewports else None


@persistent
def distrust_all(*_: Any) -> None:
    """Let all scenes be read and compared anew; called around undo and redo, which may change anything."""
    for viewport in list(_viewports.values()):
        viewport.session.distrust()


def register() -> None:
    """Listen to undo and redo."""
    for called in UNANNOUNCED:
        called.append(distrust_all)


def unregister() -> None:
    """End all renderers, and listen no more."""
    close_all()
    for called in UNANNOUNCED:
        if distrust_all in called:
            called.remove(distrust_all)


def close_all() -> None:
    """End all renderers."""
    for viewport in list(_viewports.values()):
        viewport.session.close()
    _viewports.clear()
    if bpy.app.timers.is_registered(watch):
        bpy.app.timers.unregister(watch)
