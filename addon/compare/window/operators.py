"""Operators that compare: at once from Python, in the background from the panel."""

# ruff: noqa: N801  (Blender prescribes the form of class names)

from __future__ import annotations

from typing import Any

import bpy

from ...editors import redraw
from ...inspector import session as inspector
from ...inspector.panels import find_chosen
from ...together import make_registrars
from . import session
from .heat_map import IMAGE_NAME, open_image
from .job import ComparisonError, Running
from .properties import rays_property, samples_property, width_property

POLL_SECONDS = 0.25

_running: Running | None = None
_timer: Any = None  # of the operator that looks after it


def end_process() -> None:
    """End the process that compares, if any."""
    global _running
    if _running is not None:
        _running.close()
        _running = None


def stop() -> None:
    """End the comparison that runs, if any, and show so."""
    end_process()
    for manager in bpy.data.window_managers:
        manager.reference_raytracer_comparison.is_running = False
    redraw()


def end_timer(manager: Any, timer: Any) -> None:
    """Look after a comparison no more."""
    global _timer
    _timer = None
    manager.event_timer_remove(timer)


def leave() -> None:
    """End what runs, as the add-on goes: Blender then forgets operators that wait without telling them."""
    if _timer is not None:
        end_timer(bpy.context.window_manager, _timer)
    stop()


class _Compare:
    """What both comparisons share."""

    kind = ""

    width: width_property()  # type: ignore[valid-type]
    scene = 0  # the `session_uid` of what is compared

    @classmethod
    def poll(cls, context: Any) -> bool:
        """One at a time, and there has to be a camera."""
        if context.scene is None or context.scene.camera is None:
            cls.poll_message_set("The scene has no camera")  # type: ignore[attr-defined]
            return False
        return _running is None

    def execute(self, context: Any) -> set[str]:
        """Compare, and return when it is done."""
        if not self._start(context):
            return {"CANCELLED"}
        assert _running is not None
        _running.wait()
        return self._finish(context)

    def invoke(self, context: Any, event: Any) -> set[str]:
        """Compare while the user goes on working."""
        if not self._start(context):
            return {"CANCELLED"}
        global _timer
        self._timer = _timer = context.window_manager.event_timer_add(POLL_SECONDS, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: Any, event: Any) -> set[str]:
        """Look after the process; Esc ends it."""
        if event.type == "ESC" and _running is not None:
            stop()
        if _running is None:  # stopped here, by the button, or because the add-on goes
            end_timer(context.window_manager, self._timer)
            self.report({"INFO"}, "Comparison cancelled")  # type: ignore[attr-defined]
            return {"CANCELLED"}
        if event.type == "TIMER":
            self._show_progress(context)
            if _running.is_done():
                end_timer(context.window_manager, self._timer)
                return self._finish(context)
        return {"PASS_THROUGH"}

    def _show_progress(self, context: Any) -> None:
        """Draw the panel anew where the progress has moved: a few times a second at most, and no picture with it."""
        assert _running is not None
        state, progress = context.window_manager.reference_raytracer_comparison, _running.read_progress()
        if state.progress != progress:
            state.progress = progress
            redraw("PROPERTIES")

    def cancel(self, context: Any) -> None:
        """Blender ends the operator by itself, for instance before another file is loaded."""
        end_timer(context.window_manager, self._timer)
        stop()

    def _start(self, context: Any) -> bool:
        """Begin, or report why that cannot be; return whether it runs."""
        global _running
        width, height = inspector.find_resolution(context.scene)
        size = self.width, max(4, round(self.width * height / width))
        try:
            _running = Running(context.scene, context.view_layer, self.kind, size, self._count_samples())
        except ComparisonError as error:
            self.report({"ERROR"}, str(error))  # type: ignore[attr-defined]
            return False
        self.scene = context.scene.session_uid
        state = context.window_manager.reference_raytracer_comparison
        state.is_running, state.progress = True, 0.0
        return True

    def _count_samples(self) -> int:
        raise NotImplementedError

    def _finish(self, context: Any) -> set[str]:
        running = _running
        assert running is not None
        try:
            outcome = running.read_outcome()
        except ComparisonError as error:
            self.report({"ERROR"}, str(error))  # type: ignore[attr-defined]
            return {"CANCELLED"}
        else:
            if running.blocked:
                reason = f"Compared without scripts of the file, which the preferences do not allow: {running.blocked}"
                self.report({"WARNING"}, reason)  # type: ignore[attr-defined]
        finally:
            stop()
        open_image(context.window, session.keep(outcome, self.scene))
        return {"FINISHED"}


class RAYTRACER_OT_compare_cycles(_Compare, bpy.types.Operator):
    """Render the scene with this engine and with Cycles, in a process of its own, and show how far they are apart"""

    bl_idname = "raytracer.compare_cycles"
    bl_label = "Compare with Cycles"
    bl_options = {"REGISTER"}  # noqa: RUF012
    kind = "cycles"

    samples: samples_property()  # type: ignore[valid-type]

    def _count_samples(self) -> int:
        return int(self.samples)


class RAYTRACER_OT_compare_ray_cast(_Compare, bpy.types.Operator):
    """Cast the same rays with this ray tracer and with Scene.ray_cast, and let exact arithmetic judge"""

    bl_idname = "raytracer.compare_ray_cast"
    bl_label = "Compare with ray_cast"
    bl_options = {"REGISTER"}  # noqa: RUF012
    kind = "ray_cast"

    rays: rays_property()  # type: ignore[valid-type]

    def _count_samples(self) -> int:
        return int(self.rays)


class RAYTRACER_OT_cancel_compare(bpy.types.Operator):
    """End the comparison that runs"""

    bl_idname = "raytracer.cancel_compare"
    bl_label = "Cancel Comparison"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Something runs."""
        return _running is not None

    def execute(self, context: Any) -> set[str]:
        """End the process of the comparison."""
        stop()
        return {"FINISHED"}


class RAYTRACER_OT_show_difference(bpy.types.Operator):
    """Show the map of the errors in an image editor, in a new window if there is none"""

    bl_idname = "raytracer.show_difference"
    bl_label = "Show Error Map"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """There is a map."""
        return IMAGE_NAME in bpy.data.images

    def execute(self, context: Any) -> set[str]:
        """Open the image of differences in an editor."""
        image = bpy.data.images[IMAGE_NAME]
        if not open_image(context.window, image):
            bpy.ops.wm.window_new()
            window = context.window_manager.windows[-1]
            window.screen.areas[0].type = "IMAGE_EDITOR"
            open_image(window, image)
        return {"FINISHED"}


class RAYTRACER_OT_judge_ray(bpy.types.Operator):
    """Cast the chosen ray once more among meshes, as Scene.ray_cast sees them (without hair, point clouds and
    displacement by materials), and compute the exact distance in integers"""

    bl_idname = "raytracer.judge_ray"
    bl_label = "Judge Ray"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """A ray is chosen."""
        return find_chosen(context) is not None

    def execute(self, context: Any) -> set[str]:
        """Let exact arithmetic judge the chosen ray."""
        ray = find_chosen(context)
        assert ray is not None
        session.judge(context, ray.origin, ray.direction)
        redraw()
        return {"FINISHED"}


CLASSES = (
    RAYTRACER_OT_compare_cycles,
    RAYTRACER_OT_compare_ray_cast,
    RAYTRACER_OT_cancel_compare,
    RAYTRACER_OT_show_difference,
    RAYTRACER_OT_judge_ray,
)

register, unregister = make_registrars(CLASSES)
