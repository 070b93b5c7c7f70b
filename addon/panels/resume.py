"""*Render > Resume Render*, below Blender's own items for renders, where the scene keeps checkpoints."""

# ruff: noqa: N801  (Blender prescribes the form of class names)

from __future__ import annotations

from typing import Any

import bpy

from ..engine import checkpoints
from ..properties import ENGINE


class RAYTRACER_OT_resume_render(bpy.types.Operator):
    """Go on with the render of this frame that was stopped, or that ended with Blender"""

    bl_idname = "raytracer.resume_render"
    bl_label = "Resume Render"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """A checkpoint is there."""
        if not checkpoints.can_resume(context.scene):
            cls.poll_message_set("This frame has no unfinished render with checkpoints")
            return False
        return True

    def execute(self, context: Any) -> set[str]:
        """Render, and return when it is done."""
        try:
            return resume(self, context.scene, "EXEC_DEFAULT")
        finally:
            checkpoints.forget()

    def invoke(self, context: Any, event: Any) -> set[str]:
        """Render while the user watches, as Render Image does."""
        result = resume(self, context.scene, "INVOKE_DEFAULT")
        if "CANCELLED" in result:  # it has not begun, and no end will be told
            checkpoints.forget()
        return result


def resume(operator: Any, scene: Any, how: str) -> set[str]:
    """Have Blender's operator render from the files that are there, called by `how`; report why it does not."""
    checkpoints.resume()
    try:
        result = bpy.ops.render.render(how, scene=scene.name)
    except RuntimeError as error:
        operator.report({"ERROR"}, str(error).strip().removeprefix("Error: "))
        return {"CANCELLED"}
    return {"CANCELLED"} if "CANCELLED" in result else {"FINISHED"}


def draw_item(menu: Any, context: Any) -> None:
    """Add the item to Blender's Render menu."""
    scene = context.scene
    if scene.render.engine == ENGINE and scene.reference_raytracer.use_checkpoints:
        menu.layout.separator()
        menu.layout.operator("raytracer.resume_render", icon="RENDER_STILL")


def register() -> None:
    """Join the menu."""
    bpy.types.TOPBAR_MT_render.append(draw_item)


def unregister() -> None:
    """Leave the menu."""
    bpy.types.TOPBAR_MT_render.remove(draw_item)


CLASSES = (RAYTRACER_OT_resume_render,)
