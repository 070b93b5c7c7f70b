"""Adds comparisons to Blender's window, and takes them out."""

from __future__ import annotations

from . import color_bar, job, operators, panels, properties, session


def register() -> None:
    """Add operators, their results' properties and panels; remove what a killed Blender left of its comparison."""
    job.remove_abandoned()
    properties.register()
    operators.register()
    panels.register()
    session.register()
    color_bar.register()


def unregister() -> None:
    """End a comparison that runs, and take everything out."""
    operators.stop()
    color_bar.unregister()
    session.unregister()
    panels.unregister()
    operators.unregister()
    properties.unregister()
