"""Comparisons in Blender's window: with Cycles and with Scene.ray_cast, as operators and panels.

job : a process of its own that computes (`compare.child`), so that nothing of the user's changes and Esc ends it;
session : the outcome; heat_map : its picture; operators, properties, panels : what the user touches.
"""

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
