"""Adds the ray inspector to Blender, and takes it out."""

from __future__ import annotations

from ..together import register_all, unregister_all
from . import operators, panels, properties, session

PARTS = (properties, operators, panels, session)


def register() -> None:
    """Add operators, their results' properties and panels."""
    register_all(PARTS)


def unregister() -> None:
    """Take out everything, lines in the 3D view included."""
    operators.wait_no_more()
    unregister_all(PARTS)
