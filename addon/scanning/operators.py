"""The operator that scans the scene."""

# ruff: noqa: N801  (Blender prescribes the form of class names)

from __future__ import annotations

from typing import Any

import bpy

from ..scripting.scan import scan, scan_frames
from ..together import make_registrars


class RAYTRACER_OT_scan(bpy.types.Operator):
    """Measure the distance to the surfaces around the scanner, as a LiDAR does, and add the points as a mesh"""

    bl_idname = "raytracer.scan"
    bl_label = "Scan"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    @classmethod
    def poll(cls, context: Any) -> bool:
        """There is a scanner."""
        if find_scanner(context) is not None:
            return True
        wanted = "camera" if context.scene.reference_raytracer_scan.scanner == "CAMERA" else "active object"
        cls.poll_message_set(f"The scene has no {wanted} to scan from")
        return False

    def execute(self, context: Any) -> set[str]:
        """Scan with the scene's settings, and make the points the active object."""
        settings = context.scene.reference_raytracer_scan
        if settings.distance <= settings.near:
            self.report({"ERROR"}, "Farthest has to be larger than Nearest")
            return {"CANCELLED"}
        options, scanner = read_options(settings), find_scanner(context)
        if settings.animation:
            found = scan_animation(context, scanner, options)
        else:
            found = [scan(context.evaluated_depsgraph_get(), scanner, **options)]
        count = sum(len(points.data.vertices) for points in found)
        choose(context, found)
        frames = f" in {len(found)} frames" if settings.animation else ""
        self.report({"INFO"} if count else {"WARNING"}, f"{count:,} points{frames}" if count else "Nothing in range")
        return {"FINISHED"}


def find_scanner(context: Any) -> Any:
    """Return the object to scan from, or None."""
    if context.scene.reference_raytracer_scan.scanner == "CAMERA":
        return context.scene.camera
    return context.view_layer.objects.active


def read_options(settings: Any) -> dict[str, Any]:
    """Return the settings as arguments of `scan`."""
    names = ("columns", "rows", "near", "distance", "echoes", "noise", "seed", "radius", "collection")
    return {
        **{name: getattr(settings, name) for name in names},
        "horizontal": (-settings.field / 2, settings.field / 2),
        "vertical": (settings.lowest, settings.highest),
        "visibility": settings.visibility.lower(),
    }


def scan_animation(context: Any, scanner: Any, options: dict[str, Any]) -> list[Any]:
    """Return the points of each frame, each shown in its frame only; Blender's cursor counts the frames."""
    scene, manager, found = context.scene, context.window_manager, []
    manager.progress_begin(scene.frame_start, scene.frame_end)
    try:
        for frame, points in scan_frames(scene, scanner, **options):
            show_at(points, frame, scene.frame_step)
            manager.progress_update(frame)
            found.append(points)
    finally:
        manager.progress_end()
    return found


def show_at(points: Any, frame: int, step: int) -> None:
    """Show an object from a frame on, for `step` frames, in viewports and renders."""
    for when, hidden in ((frame - 1, True), (frame, False), (frame + step, True)):
        points.hide_viewport = points.hide_render = hidden
        for path in ("hide_viewport", "hide_render"):
            points.keyframe_insert(path, frame=when)


def choose(context: Any, found: list[Any]) -> None:
    """Select the points alone, and make the last the active object where it can be."""
    for thing in context.selected_objects:
        thing.select_set(False)
    for points in found:
        if points.visible_get():
            points.select_set(True)
    if found and context.mode == "OBJECT":
        context.view_layer.objects.active = found[-1]


register, unregister = make_registrars((RAYTRACER_OT_scan,))
