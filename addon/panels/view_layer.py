"""The tab of the view layer."""

# ruff: noqa: N801, RUF012  (Blender prescribes the form of class names and attributes)

from __future__ import annotations

from typing import Any

import bpy

from ..passes import DENOISING_DATA, MATTE_OPTIONS, PASSES, find_owner, list_mattes
from .shared import EnginePanel, split


class RAYTRACER_VIEWLAYER_PT_cryptomatte(EnginePanel, bpy.types.Panel):
    """Which mattes a view layer renders."""

    bl_label = "Cryptomatte"
    bl_context = "view_layer"
    bl_parent_id = "RAYTRACER_VIEWLAYER_PT_passes"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        column, layer = split(self), context.view_layer
        kinds = column.column(heading="Include", align=True)
        for kind, option in MATTE_OPTIONS.items():
            kinds.prop(layer, option, text=kind)
        levels = column.column()
        levels.active = bool(list_mattes(layer))
        levels.prop(layer, "pass_cryptomatte_depth", text="Levels")


class RAYTRACER_VIEWLAYER_PT_aov(EnginePanel, bpy.types.Panel):
    """Passes that shaders write by their AOV Output nodes."""

    bl_label = "Shader AOV"
    bl_context = "view_layer"
    bl_parent_id = "RAYTRACER_VIEWLAYER_PT_passes"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        layer, row = context.view_layer, split(self).row()
        row.column().template_list("VIEWLAYER_UL_aov", "aovs", layer, "aovs", layer, "active_aov_index", rows=3)
        buttons = row.column(align=True)
        buttons.operator("scene.view_layer_add_aov", icon="ADD", text="")
        buttons.operator("scene.view_layer_remove_aov", icon="REMOVE", text="")
        if layer.active_aov and not layer.active_aov.is_valid:
            self.layout.label(text="Conflicts with another render pass of the same name", icon="ERROR")


class RAYTRACER_VIEWLAYER_PT_light_groups(EnginePanel, bpy.types.Panel):
    """Groups of lights, each of which has a pass of its own."""

    bl_label = "Light Groups"
    bl_context = "view_layer"
    bl_parent_id = "RAYTRACER_VIEWLAYER_PT_passes"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        layer, row = context.view_layer, split(self).row()
        row.column().template_list(
            "UI_UL_list", "lightgroups", layer, "lightgroups", layer, "active_lightgroup_index", rows=3
        )
        buttons = row.column(align=True)
        buttons.operator("scene.view_layer_add_lightgroup", icon="ADD", text="")
        buttons.operator("scene.view_layer_remove_lightgroup", icon="REMOVE", text="")
        buttons.separator()
        buttons.menu("VIEWLAYER_MT_lightgroup_sync", icon="DOWNARROW_HLT", text="")


class RAYTRACER_VIEWLAYER_PT_filter(EnginePanel, bpy.types.Panel):
    """What a view layer leaves out of its scene."""

    bl_label = "Filter"
    bl_context = "view_layer"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        parts, layer = split(self), context.view_layer
        column = parts.column(heading="Include")
        column.prop(layer, "use_sky", text="Environment")
        column.prop(layer, "use_solid", text="Surfaces")
        column.prop(layer, "use_strand", text="Curves")
        column.prop(layer, "use_volumes", text="Volumes")
        use = parts.column(heading="Use")
        use.active = context.scene.render.use_motion_blur
        use.prop(layer, "use_motion_blur", text="Motion Blur")


class RAYTRACER_VIEWLAYER_PT_override(EnginePanel, bpy.types.Panel):
    """What a view layer shows instead of the materials and the world of its scene."""

    bl_label = "Override"
    bl_context = "view_layer"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        column, layer = split(self), context.view_layer
        column.prop(layer, "material_override", text="Material")
        if "world_override" in layer.bl_rna.properties:
            column.prop(layer, "world_override", text="World")


class RAYTRACER_VIEWLAYER_PT_passes(EnginePanel, bpy.types.Panel):
    """Which passes a view layer renders."""

    bl_label = "Passes"
    bl_context = "view_layer"

    def draw(self, context: Any) -> None:
        column = split(self).column(heading="Include", align=True)
        shown = {stored.option: name for name, stored in PASSES.items()} | {DENOISING_DATA: "Denoising Data"}
        for option, name in shown.items():
            owner, own_name = find_owner(context.view_layer, option)
            if name != "Combined" and owner is not None:
                column.prop(owner, own_name, text=name)


CLASSES = (
    RAYTRACER_VIEWLAYER_PT_filter,
    RAYTRACER_VIEWLAYER_PT_override,
    RAYTRACER_VIEWLAYER_PT_passes,
    RAYTRACER_VIEWLAYER_PT_cryptomatte,
    RAYTRACER_VIEWLAYER_PT_aov,
    RAYTRACER_VIEWLAYER_PT_light_groups,
)
