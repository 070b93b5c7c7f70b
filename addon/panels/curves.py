"""Curves: whether hair is shown as ribbons or as round strands.

The setting is Cycles' own, for files to look alike in both; without its add-on it is the one that Blender has for other
engines.
"""

# ruff: noqa: N801  (Blender prescribes the form of class names)

from __future__ import annotations

from typing import Any

import bpy

from .shared import RenderPanel, split


class RAYTRACER_RENDER_PT_curves(RenderPanel, bpy.types.Panel):
    """What strands of hair look like."""

    bl_label = "Curves"
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012

    def draw(self, context: Any) -> None:
        column, settings = split(self), getattr(context.scene, "cycles_curves", None)
        if settings is not None:
            column.prop(settings, "shape", text="Shape")
        else:
            column.prop(context.scene.render, "hair_type", text="Shape")


CLASSES = (RAYTRACER_RENDER_PT_curves,)
