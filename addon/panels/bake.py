"""The render tab: baking into textures, with the settings that all engines of Blender share."""

# ruff: noqa: N801, RUF012  (Blender prescribes the form of class names and attributes)

from __future__ import annotations

from typing import Any

import bpy

from ..engine.baking import PART_TYPES
from .shared import RenderPanel, split


class RAYTRACER_RENDER_PT_bake(RenderPanel, bpy.types.Panel):
    """What to bake, and from where it is seen."""

    bl_label = "Bake"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        column, settings, bake = split(self), context.scene.reference_raytracer, context.scene.render.bake
        column.operator("object.bake", text="Bake", icon="RENDER_STILL").type = settings.bake_type
        column.prop(settings, "bake_type")
        column.prop(bake, "view_from")
        draw_influence(column, settings.bake_type, bake)


def draw_influence(column: Any, kind: str, bake: Any) -> None:
    """Draw the choices that a type of bake has of its own."""
    if kind == "NORMAL":
        column.prop(bake, "normal_space", text="Space")
        swizzle = column.column(align=True)
        for channel in "rgb":
            swizzle.prop(bake, f"normal_{channel}", text=f"Swizzle {channel.upper()}")
    elif kind == "COMBINED" or kind in PART_TYPES:
        light = column.column(heading="Lighting", align=True)
        names = ["direct", "indirect"] + (["color"] if kind in PART_TYPES else [])
        for name in names:
            light.prop(bake, f"use_pass_{name}")
        if kind == "COMBINED":
            parts = column.column(heading="Contributions", align=True)
            for name in ("diffuse", "glossy", "transmission", "emit"):
                parts.prop(bake, f"use_pass_{name}")


class RAYTRACER_RENDER_PT_bake_selected(RenderPanel, bpy.types.Panel):
    """Baking what selected objects show into the active one."""

    bl_label = "Selected to Active"
    bl_parent_id = "RAYTRACER_RENDER_PT_bake"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header(self, context: Any) -> None:
        self.layout.prop(context.scene.render.bake, "use_selected_to_active", text="")

    def draw(self, context: Any) -> None:
        column, bake = split(self), context.scene.render.bake
        column.active = bake.use_selected_to_active
        column.prop(bake, "use_cage")
        if bake.use_cage:
            column.prop(bake, "cage_object")
        column.prop(bake, "cage_extrusion", text="Extrusion")
        column.prop(bake, "max_ray_distance")


class RAYTRACER_RENDER_PT_bake_output(RenderPanel, bpy.types.Panel):
    """Where the pixels go."""

    bl_label = "Output"
    bl_parent_id = "RAYTRACER_RENDER_PT_bake"

    def draw(self, context: Any) -> None:
        column, bake = split(self), context.scene.render.bake
        column.prop(bake, "target")
        if bake.target == "IMAGE_TEXTURES":
            column.prop(bake, "use_clear", text="Clear Image")
            column.prop(bake, "margin_type", text="Margin")
            column.prop(bake, "margin", text="Size")


CLASSES = (RAYTRACER_RENDER_PT_bake, RAYTRACER_RENDER_PT_bake_selected, RAYTRACER_RENDER_PT_bake_output)
