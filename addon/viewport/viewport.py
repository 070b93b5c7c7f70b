"""Rendered shading: what Blender calls for each region that shows it, and the watch that asks for redraws.

`session` talks to the renderer, `views` reads where a region looks, `drawing` puts pictures on the screen. An engine
object of Blender's holds the session of its region.
"""

from __future__ import annotations

import weakref
from typing import Any

import bpy
from bpy.app.handlers import persistent

from ..handlers import HANDLERS, join, leave
from . import pool
from .drawing import Canvas
from .finishing import Finishing
from .session import Session

UNANNOUNCED = (HANDLERS.undo_pre, HANDLERS.undo_post, HANDLERS.redo_pre, HANDLERS.redo_post)
# Seconds between two looks for news of the renderers.
WATCH_INTERVAL = 1 / 60


class Viewport:
    """A region in Rendered shading; Blender's engine object holds it, and ends it."""

    def __init__(self, engine: Any) -> None:
        self.engine = weakref.ref(engine)
        self.session = Session()
        self.canvas = Canvas()
        self.finishing = Finishing()
        _viewports.add(self)
        if not bpy.app.timers.is_registered(watch):
            bpy.app.timers.register(watch, persistent=True)

    def update(self, context: Any, depsgraph: Any) -> None:
        """Take a change of the scene."""
        self.session.update(depsgraph, context.space_data)

    def draw(self, engine: Any, context: Any, depsgraph: Any) -> None:
        """Draw the region as far as it is, and let the renderer know where it looks."""
        pixel_size = int(engine.get_preview_pixel_size(depsgraph.scene))
        region, data, space = context.region, context.region_data, context.space_data
        self.session.look(region, data, space, depsgraph, pixel_size)
        is_denoised = depsgraph.scene.reference_raytracer.use_viewport_denoising
        picture = self.finishing.choose(self.session.read_picture(), is_denoised)
        if picture is not None:
            self.canvas.take(picture)
        self.canvas.upload()
        self.canvas.draw(engine, depsgraph.scene)
        engine.update_stats("", self.session.status + self.finishing.status)

    def has_news(self) -> bool:
        """True where the region should be drawn again."""
        return self.session.has_news or self.finishing.has_news or self.canvas.is_busy

    def close(self) -> None:
        """End it; may be called again."""
        _viewports.discard(self)
        self.session.close()
        self.finishing.close()


_viewports: set[Viewport] = set()


def watch() -> float | None:
    """Let regions with news be drawn; called by Blender's timer while there are viewports."""
    for viewport in list(_viewports):
        engine = viewport.engine()
        if engine is None or is_freed(engine):
            viewport.close()
        elif viewport.has_news():
            engine.tag_redraw()
    return WATCH_INTERVAL if _viewports else None


def is_freed(engine: Any) -> bool:
    """Return whether Blender has let go of its engine: the frames of an error may hold the object still."""
    try:
        engine.as_pointer()
    except ReferenceError:
        return True
    return False


@persistent
def distrust_all(*_: Any) -> None:
    """Let all scenes be read and compared anew; called around undo and redo, which may change anything."""
    for viewport in list(_viewports):
        viewport.session.distrust()


def register() -> None:
    """Listen to undo and redo, and have a process wait where one will be needed."""
    pool.register()
    join(distrust_all, *UNANNOUNCED)


def unregister() -> None:
    """End all renderers, and listen no more."""
    close_all()
    pool.unregister()
    leave(distrust_all, *UNANNOUNCED)


def close_all() -> None:
    """End all renderers."""
    for viewport in list(_viewports):
        viewport.close()
    if bpy.app.timers.is_registered(watch):
        bpy.app.timers.unregister(watch)
