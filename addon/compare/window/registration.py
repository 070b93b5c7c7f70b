"""Adds comparisons to Blender's window, and takes them out."""

from __future__ import annotations

from contextlib import suppress

from ...together import register_all, unregister_all
from . import color_bar, job, operators, panels, properties, session

PARTS = (properties, operators, panels, session, color_bar)


def register() -> None:
    """Add operators, their results' properties and panels; remove what a killed Blender left of its comparison."""
    with suppress(OSError):  # a full disk has no folder for temporary files
        job.remove_abandoned()
    register_all(PARTS)


def unregister() -> None:
    """End a comparison that runs, and take everything out."""
    operators.leave()
    unregister_all(PARTS)
