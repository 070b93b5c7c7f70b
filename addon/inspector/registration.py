"""Adds the ray inspector to Blender, and takes it out."""

from __future__ import annotations

from . import operators, panels, properties, session


def register() -> None:
    """Add operators, their results' properties and panels."""
    properties.register()
    operators.register()
    panels.register()
    session.register()


def unregister() -> None:
    """Take out everything, lines in the 3D view included."""
    session.unregister()
    panels.unregister()
    operators.unregister()
    properties.unregister()
