"""Light and shadow linking in Blender 4.2, whose panels are Cycles' alone; later ones are for all engines."""

# ruff: noqa: N801  (Blender prescribes the form of class names and attributes)

from __future__ import annotations

from typing import Any

import bpy

from .. import versions
from .shared import EnginePanel, split


class _LinkingPanel(EnginePanel):
    """A panel of an object."""

    bl_parent_id = versions.SHADING_PANEL
    bl_context = "object"
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012


def draw_linking(panel: Any, linking: Any, kind: str) -> None:
    """Draw the collection of an object's links of a kind, "receiver" or "blocker", and what it names."""
    column, name = split(panel), f"{kind}_collection"
    column.template_ID(linking, name, new=f"object.light_linking_{name}_new")
    if getattr(linking, name) is None:
        return
    row = column.row()
    row.column().template_light_linking_collection(row, linking, name)
    buttons = row.column(align=True)
    buttons.operator(f"object.light_linking_{kind}s_link", icon="ADD", text="").link_state = "INCLUDE"
    buttons.operator("object.light_linking_unlink_from_collection", icon="REMOVE", text="")


class RAYTRACER_OBJECT_PT_light_linking(_LinkingPanel, bpy.types.Panel):
    """Which objects a lamp, or what shines, lights."""

    bl_label = "Light Linking"

    def draw(self, context: Any) -> None:
        draw_linking(self, context.object.light_linking, "receiver")


class RAYTRACER_OBJECT_PT_shadow_linking(_LinkingPanel, bpy.types.Panel):
    """Which objects cast shadows in its light."""

    bl_label = "Shadow Linking"

    def draw(self, context: Any) -> None:
        draw_linking(self, context.object.light_linking, "blocker")


CLASSES = (RAYTRACER_OBJECT_PT_light_linking, RAYTRACER_OBJECT_PT_shadow_linking) if versions.VERSION < (4, 3) else ()
