"""Motion blur: the scene's shutter, in the render tab, and how an object is blurred, in its own.

Rolling shutter and the settings of objects are Cycles' own, for files to look alike in both; they are there as long as
its add-on is on.
"""

# ruff: noqa: N801, RUF012  (Blender prescribes the form of class names and attributes)

from __future__ import annotations

from typing import Any

import bpy

from .scene_data import VISIBLE_TYPES
from .shared import EnginePanel, RenderPanel, split

BLURRED_TYPES = (VISIBLE_TYPES | {"CAMERA"}) - {"LIGHT"}


class RAYTRACER_RENDER_PT_motion_blur(RenderPanel, bpy.types.Panel):
    """How long the shutter is open, and when."""

    bl_label = "Motion Blur"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header(self, context: Any) -> None:
        self.layout.prop(context.scene.render, "use_motion_blur", text="")

    def draw(self, context: Any) -> None:
        column, render = split(self), context.scene.render
        column.active = render.use_motion_blur
        column.prop(render, "motion_blur_position", text="Position")
        column.prop(render, "motion_blur_shutter")
        settings = getattr(context.scene, "cycles", None)
        if settings is not None:
            column.prop(settings, "rolling_shutter_type", text="Rolling Shutter")
            duration = column.column()
            duration.active = render.use_motion_blur and settings.rolling_shutter_type != "NONE"
            duration.prop(settings, "rolling_shutter_duration", text="Duration")


class RAYTRACER_RENDER_PT_motion_blur_curve(RenderPanel, bpy.types.Panel):
    """How the shutter opens and closes."""

    bl_label = "Shutter Curve"
    bl_parent_id = "RAYTRACER_RENDER_PT_motion_blur"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        render = context.scene.render
        self.layout.active = render.use_motion_blur
        self.layout.template_curve_mapping(render, "motion_blur_shutter_curve")


class RAYTRACER_OBJECT_PT_motion_blur(EnginePanel, bpy.types.Panel):
    """Whether an object is blurred, and how finely its path is followed."""

    bl_label = "Motion Blur"
    bl_context = "object"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        thing = context.object
        is_blurred = thing is not None and (thing.type in BLURRED_TYPES or thing.instance_type == "COLLECTION")
        return is_blurred and hasattr(thing, "cycles") and context.engine in cls.COMPAT_ENGINES

    def draw_header(self, context: Any) -> None:
        self.layout.prop(context.object.cycles, "use_motion_blur", text="")

    def draw(self, context: Any) -> None:
        column, settings = split(self), context.object.cycles
        column.active = context.scene.render.use_motion_blur and settings.use_motion_blur
        column.prop(settings, "motion_steps", text="Steps")
        if context.object.type != "CAMERA":
            column.prop(settings, "use_deform_motion", text="Deformation")


CLASSES = (
    RAYTRACER_RENDER_PT_motion_blur,
    RAYTRACER_RENDER_PT_motion_blur_curve,
    RAYTRACER_OBJECT_PT_motion_blur,
)
