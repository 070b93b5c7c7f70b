"""Adds comparisons to Blender's window, and takes them out."""

from __future__ import annotations

from . import operators, panels, properties, session


def register() -> None:
    """Add operators, their results' properties and panels."""
    properties.register()
    operators.register()
    panels.register()
    session.register()


def unregister() -> None:
    """End a comparison that runs, and take everything out."""
    operators.stop()
    session.unregister()
    panels.unregister()
    operators.unregister()
    properties.unregister()
