"""Panels: comparisons in the render tab, and the verdict on a ray in the sidebar tab "Ray"."""

# ruff: noqa: N801  (Blender prescribes the form of class names)

from __future__ import annotations

from typing import Any

import bpy

from ...editors import count_letters, wrap_text
from ...inspector.panels import CATEGORY, draw_lines, find_chosen
from ...properties import ENGINE
from ...together import make_registrars
from . import session
from .describe import describe_exact, describe_map, describe_numbers, describe_outcome, describe_verdict
from .heat_map import IMAGE_NAME


class RAYTRACER_UL_worst(bpy.types.UIList):
    """The worst pixels or rays of a comparison."""

    def draw_item(
        self, context: Any, layout: Any, data: Any, item: Any, icon: int, active_data: Any, active: str, index: int = 0
    ) -> None:
        """Draw a row."""
        draw_columns(layout, (item.apart, item.place, item.object, item.ours, item.theirs))


# Shares of a row that its columns take, in the order of `results.Worst.columns`.
WIDTHS = (0.17, 0.15, 0.22, 0.23, 0.23)
# What the columns hold.
HEADERS = {
    "cycles": ("FLIP", "Pixel", "Object", "Ours", "Cycles"),
    "ray_cast": ("Apart", "Ray", "Object", "Ours", "ray_cast"),
}


def draw_columns(layout: Any, texts: tuple[str, ...]) -> None:
    """Draw texts side by side, in columns of WIDTHS."""
    row, left = layout, 1.0
    for width, text in zip(WIDTHS, texts, strict=True):
        part = row.split(factor=min(width / left, 1.0)) if width < left else row
        part.label(text=text)
        row, left = part, left - width


class RAYTRACER_RENDER_PT_compare(bpy.types.Panel):
    """Compare with Cycles and with Scene.ray_cast."""

    bl_label = "Compare"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012
    COMPAT_ENGINES = {ENGINE}  # noqa: RUF012

    @classmethod
    def poll(cls, context: Any) -> bool:
        return context.engine in cls.COMPAT_ENGINES

    def draw(self, context: Any) -> None:
        state = context.window_manager.reference_raytracer_comparison
        column = self.layout.column()
        column.use_property_split = True
        column.use_property_decorate = False
        for name in ("width", "samples", "rays"):
            column.prop(state, name)
        if state.is_running:
            row = self.layout.row(align=True)
            row.progress(text=f"Comparing {state.progress:.0%}", factor=state.progress)
            row.operator("raytracer.cancel_compare", text="", icon="X")
        else:
            buttons = self.layout.column(align=True)
            cycles = buttons.operator("raytracer.compare_cycles")
            cycles.width, cycles.samples = state.width, state.samples
            rays = buttons.operator("raytracer.compare_ray_cast")
            rays.width, rays.rays = state.width, state.rays
        self._draw_outcome(context, state)

    def _draw_outcome(self, context: Any, state: Any) -> None:
        outcome = session.find_outcome(context.scene)
        if outcome is None:
            return
        layout = self.layout
        headline, icon, reason = describe_outcome(outcome.kind, outcome.numbers, count_letters(context))
        layout.label(text=headline, icon=icon)
        lines = layout.column(align=True)
        for line in reason:
            lines.label(text=line)
        draw_lines(layout, describe_numbers(outcome.kind, outcome.numbers), factor=0.5)
        if IMAGE_NAME in bpy.data.images:
            layout.operator("raytracer.show_difference", icon="IMAGE_DATA")
            layout.label(text=describe_map(outcome))
        if outcome.worst:
            layout.label(text="Worst Pixels" if outcome.kind == "cycles" else "Rays Farthest Apart")
            draw_columns(layout, HEADERS[outcome.kind])
            layout.template_list("RAYTRACER_UL_worst", "", state, "worst", state, "worst_index", rows=5)
        if session.find_trouble():
            for line in wrap_text(session.find_trouble(), count_letters(context)):
                layout.label(text=line, icon="ERROR")


class _VerdictPanel:
    """The chosen ray in exact arithmetic, and what Scene.ray_cast says."""

    bl_label = "Exact"
    bl_region_type = "UI"
    bl_category = CATEGORY

    @classmethod
    def poll(cls, context: Any) -> bool:
        return context.engine == ENGINE and find_chosen(context) is not None

    def draw(self, context: Any) -> None:
        layout, ray = self.layout, find_chosen(context)  # type: ignore[attr-defined]
        verdicts = session.find_verdicts_on(ray) if ray else None
        if verdicts is None:
            layout.operator("raytracer.judge_ray")
            return
        draw_lines(layout, describe_exact(verdicts[0]))
        for title, verdict in zip(("This ray tracer", "Scene.ray_cast"), verdicts, strict=True):
            text, icon = ("right", "CHECKMARK") if verdict.is_right else ("wrong", "ERROR")
            layout.label(text=f"{title}: {text}", icon=icon)
            draw_lines(layout, describe_verdict(verdict))


class VIEW3D_PT_raytracer_verdict(_VerdictPanel, bpy.types.Panel):
    """In the 3D view."""

    bl_space_type = "VIEW_3D"
    bl_parent_id = "VIEW3D_PT_raytracer_rays"


class IMAGE_PT_raytracer_verdict(_VerdictPanel, bpy.types.Panel):
    """In the image editor."""

    bl_space_type = "IMAGE_EDITOR"
    bl_parent_id = "IMAGE_PT_raytracer_rays"


CLASSES = (
    RAYTRACER_UL_worst,
    RAYTRACER_RENDER_PT_compare,
    VIEW3D_PT_raytracer_verdict,
    IMAGE_PT_raytracer_verdict,
)

register, unregister = make_registrars(CLASSES)
