"""Adaptive subdivision: how finely the scene cuts, and what objects ask for.

The settings of scenes are Cycles' own. Those of modifiers are Blender's, whose panel shows them to Cycles alone; so
they have a panel above the modifiers.
"""

# ruff: noqa: N801, RUF012  (Blender prescribes the form of class names and attributes)

from __future__ import annotations

from typing import Any

import bpy

from .. import versions
from .shared import EnginePanel, RenderPanel, split


class RAYTRACER_RENDER_PT_subdivision(RenderPanel, bpy.types.Panel):
    """How finely meshes are cut that are subdivided adaptively."""

    bl_label = "Subdivision"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        return super().poll(context) and versions.VERSION >= (5, 0) and hasattr(context.scene, "cycles")

    def draw(self, context: Any) -> None:
        column, settings = split(self), context.scene.cycles
        column.prop(settings, "dicing_rate", text="Dicing Rate Render")
        column.prop(settings, "preview_dicing_rate", text="Viewport")
        column.prop(settings, "offscreen_dicing_scale", text="Offscreen Scale")
        column.prop(settings, "max_subdivisions")
        column.prop(settings, "dicing_camera")


class RAYTRACER_OBJECT_PT_subdivision(EnginePanel, bpy.types.Panel):
    """Whether and how finely an object's last modifier subdivides adaptively."""

    bl_label = "Adaptive Subdivision"
    bl_context = "modifier"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        return super().poll(context) and find_modifier(context.object) is not None

    def draw_header(self, context: Any) -> None:
        self.layout.prop(find_modifier(context.object), "use_adaptive_subdivision", text="")

    def draw(self, context: Any) -> None:
        column, modifier = split(self), find_modifier(context.object)
        column.active = modifier.use_adaptive_subdivision
        column.prop(modifier, "adaptive_space")
        in_pixels = modifier.adaptive_space == "PIXEL"
        column.prop(modifier, "adaptive_pixel_size" if in_pixels else "adaptive_object_edge_length")


def find_modifier(thing: Any) -> Any:
    """Return the last modifier of an object if that may subdivide adaptively, or None."""
    last = thing.modifiers[-1] if thing is not None and len(thing.modifiers) else None
    return last if hasattr(last, "use_adaptive_subdivision") else None


CLASSES = (RAYTRACER_RENDER_PT_subdivision, RAYTRACER_OBJECT_PT_subdivision)
