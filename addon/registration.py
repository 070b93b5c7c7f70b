"""Adds all that the add-on brings to Blender, part by part, and takes it out in the reverse order."""

from __future__ import annotations

import atexit
from typing import Any

from . import inspector, panels, passes, properties, scanning
from .compare import window
from .compare.window import operators
from .denoising import process as denoiser
from .engine import engine, worker_pool
from .scripting import held
from .together import register_all, unregister_all

PARTS = (properties, passes, engine, panels, inspector, window, scanning)

_registered: list[Any] = []


def register(*more: Any) -> None:
    """Add the parts, and `more` of them, to Blender; all or none."""
    parts = (*PARTS, *more)
    register_all(parts)
    _registered.extend(parts)
    atexit.register(_leave)


def unregister() -> None:
    """Take out everything that `register` added."""
    atexit.unregister(_leave)
    held.unregister()
    parts = tuple(_registered)
    _registered.clear()
    unregister_all(parts)
    denoiser.close()  # viewports that still wait for it want no more by now


def _leave() -> None:
    """End what runs, at Python's end. Blender 4.2 crashes and 4.5 hangs there while a render engine is registered; the
    Blender application has already let go of all classes."""
    operators.end_process()
    worker_pool.close()
    denoiser.close()
    if engine.ReferenceRaytracerEngine.is_registered:
        unregister()
