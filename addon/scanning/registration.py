"""Adds the scanner to Blender, and takes it out."""

from __future__ import annotations

from . import operators, panels, properties


def register() -> None:
    """Add settings, operator and panels."""
    properties.register()
    operators.register()
    panels.register()


def unregister() -> None:
    """Take them out."""
    panels.unregister()
    operators.unregister()
    properties.unregister()
