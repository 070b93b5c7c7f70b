"""Adds the scanner to Blender, and takes it out."""

from __future__ import annotations

from ..together import register_all, unregister_all
from . import operators, panels, properties

PARTS = (properties, operators, panels)


def register() -> None:
    """Add settings, operator and panels."""
    register_all(PARTS)


def unregister() -> None:
    """Take them out."""
    unregister_all(PARTS)
