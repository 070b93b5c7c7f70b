"""Render processes that wait for a region: one is started before it is needed, and used again by the next.

To start takes a second; the first picture should take a tenth of it. So a process waits as long as a scene of the file
renders with this engine.
"""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.handlers import persistent

from raytracer.rendering.live import Live

from ..handlers import HANDLERS, join, leave
from ..properties import ENGINE

_waiting: list[Live] = []
_subscriber = object()


def take() -> Live:
    """Return a process that nobody uses."""
    while _waiting:
        live = _waiting.pop()
        if live.is_running:
            return live
        live.close()
    return Live()


def give_back(live: Live) -> None:
    """Have a process wait for the next region, or end it where one waits already."""
    if _waiting or not live.is_running or not is_wanted():
        live.close()
        return
    live.forget()
    _waiting.append(live)


def is_wanted() -> bool:
    """True where a scene of the file may soon be shown by this engine."""
    return not bpy.app.background and any(scene.render.engine == ENGINE for scene in bpy.data.scenes)


@persistent
def prepare(*_: Any) -> None:
    """Have a process wait, or none; called when a file is loaded or a scene gets another engine."""
    listen()
    if not is_wanted():
        close_all()
    elif not _waiting:
        _waiting.append(Live())


def listen() -> None:
    """Ask to be called when an engine is chosen; Blender forgets that with every file."""
    bpy.msgbus.clear_by_owner(_subscriber)
    key = (bpy.types.RenderSettings, "engine")
    bpy.msgbus.subscribe_rna(key=key, owner=_subscriber, args=(), notify=prepare)


def close_all() -> None:
    """End the processes that wait."""
    while _waiting:
        _waiting.pop().close()


def register() -> None:
    """Watch for scenes that use the engine."""
    join(prepare, HANDLERS.load_post)
    listen()


def unregister() -> None:
    """End the processes that wait, and watch no more."""
    bpy.msgbus.clear_by_owner(_subscriber)
    leave(prepare, HANDLERS.load_post)
    close_all()
