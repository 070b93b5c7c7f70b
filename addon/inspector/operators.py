"""Operators of the ray inspector."""

# ruff: noqa: N801  (Blender prescribes the form of class names)

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import IntProperty

from ..together import make_registrars
from . import session
from .picking import find_pixel, find_place, find_view_ray

NAVIGATION = {"MIDDLEMOUSE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "TRACKPADPAN", "TRACKPADZOOM"}
HELP = "Click a pixel of the render or a point of the 3D view to see its rays   |   Esc or right click: cancel"


_places: tuple[Any, Any] | None = None  # the window and the workspace in which a click is waited for


def wait_no_more() -> None:
    """Take back what shows that a click is waited for: Blender forgets operators of an add-on that goes, without
    telling them."""
    global _places
    places, _places = _places, None
    if places is not None:
        window, workspace = places
        window.cursor_modal_restore()
        workspace.status_text_set(None)


class RAYTRACER_OT_inspect_pixel(bpy.types.Operator):
    """Trace the rays of one pixel and show them: the camera's, those that it leads to, and their shadow rays"""

    bl_idname = "raytracer.inspect_pixel"
    bl_label = "Inspect Pixel"
    bl_options = {"REGISTER"}  # noqa: RUF012

    x: IntProperty(  # type: ignore[valid-type]
        name="X", description="Column of the pixel in the full image, counted from the left", default=0, min=0
    )
    y: IntProperty(  # type: ignore[valid-type]
        name="Y", description="Row of the pixel in the full image, counted from the bottom", default=0, min=0
    )

    def execute(self, context: Any) -> set[str]:
        """Inspect the pixel x, y of the scene's camera."""
        return self._inspect(lambda: session.inspect_pixel(context.evaluated_depsgraph_get(), self.x, self.y))

    def invoke(self, context: Any, event: Any) -> set[str]:
        """Let the user pick with the mouse, unless the pixel is given."""
        if self.properties.is_property_set("x") and self.properties.is_property_set("y"):
            return self.execute(context)
        global _places
        _places = context.window, context.workspace
        context.window.cursor_modal_set("EYEDROPPER")
        context.workspace.status_text_set(HELP)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: Any, event: Any) -> set[str]:
        """Wait for a click; looking around stays possible."""
        if event.type in NAVIGATION or event.type == "MOUSEMOVE":
            return {"PASS_THROUGH"}
        if event.type in ("ESC", "RIGHTMOUSE"):
            return self._end(context, {"CANCELLED"})
        if event.type == "LEFTMOUSE" and event.value == "PRESS":
            try:
                return self._pick(context, event)
            finally:  # after an error, too: Blender would leave the cursor as it is
                self._end(context, {"FINISHED"})
        return {"RUNNING_MODAL"}

    def cancel(self, context: Any) -> None:
        """Blender ends the operator by itself, for instance before another file is loaded."""
        self._end(context, {"CANCELLED"})

    def _end(self, context: Any, result: set[str]) -> set[str]:
        global _places
        _places = context.window, context.workspace
        wait_no_more()
        return result

    def _pick(self, context: Any, event: Any) -> set[str]:
        place = find_place(context.window, event.mouse_x, event.mouse_y)
        if place is None:
            self.report({"WARNING"}, "Click in an image editor or a 3D view")
            return {"CANCELLED"}
        depsgraph = context.evaluated_depsgraph_get()
        if place.area.type == "VIEW_3D":
            ray, space = find_view_ray(place), place.area.spaces.active
            return self._inspect(lambda: session.inspect_ray(depsgraph, *ray, "Ray of the 3D view", "View", space))
        pixel = None
        if place.area.spaces.active.image is not None:
            pixel = find_pixel(place, session.find_resolution(context.scene), context.scene.render)
        if pixel is None:
            self.report({"WARNING"}, "There is no pixel of the render under the mouse")
            return {"CANCELLED"}
        self.x, self.y = pixel
        return self.execute(context)

    def _inspect(self, inspect: Any) -> set[str]:
        try:
            inspect()
        except ValueError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class RAYTRACER_OT_clear_rays(bpy.types.Operator):
    """Forget the inspected rays and draw them no more"""

    bl_idname = "raytracer.clear_rays"
    bl_label = "Clear Rays"
    bl_options = {"REGISTER"}  # noqa: RUF012

    @classmethod
    def poll(cls, context: Any) -> bool:
        """There is something to clear."""
        return session.find_inspected() is not None

    def execute(self, context: Any) -> set[str]:
        """Clear."""
        session.clear()
        return {"FINISHED"}


CLASSES = (RAYTRACER_OT_inspect_pixel, RAYTRACER_OT_clear_rays)

register, unregister = make_registrars(CLASSES)
