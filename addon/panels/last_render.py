"""The render tab: what the last render took, and what it did not show as the scene says."""

# ruff: noqa: N801  (Blender prescribes the form of class names)

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import bpy
from bpy.app.handlers import persistent
from bpy.props import StringProperty

from raytracer.film.error import format_error, format_interval

from ..editors import count_letters, redraw, wrap_text
from ..engine.statistics import Statistics, last_render
from ..extract.warnings import Warning
from ..handlers import HANDLERS, join, leave
from .shared import RenderPanel

# What is said of a render that did not take all samples.
ENDINGS = {"samples": "", "error": " (noise threshold)", "time": " (time limit)"}
# More would fill the tab; the console has all.
MOST_WARNINGS = 30


class RAYTRACER_RENDER_PT_statistics(RenderPanel, bpy.types.Panel):
    """What the last render of the scene took."""

    bl_label = "Last Render"

    def draw(self, context: Any) -> None:
        statistics = last_render(context.scene)
        if statistics is None:
            self.layout.label(text="Nothing rendered yet")
            return
        table = self.layout.split(factor=0.4)
        names, values = table.column(align=True), table.column(align=True)
        names.alignment = "RIGHT"
        for name, value in describe_statistics(statistics):
            names.label(text=name)
            values.label(text=value)
        note = wrap_text(statistics.error_note, count_letters(context)) if statistics.error_note else []
        for index, line in enumerate(note):
            self.layout.label(text=line, icon="BLANK1" if index else "INFO")


def describe_statistics(statistics: Statistics) -> Iterator[tuple[str, str]]:
    """Yield the lines of the statistics panel as names and values with units."""
    memory = statistics.peak_memory_mb
    yield "Resolution", f"{statistics.width} x {statistics.height}"
    yield "Samples", f"{statistics.samples}{' (stopped)' if statistics.cancelled else ENDINGS[statistics.ended_by]}"
    yield from describe_error(statistics)
    if statistics.denoised:
        yield "Denoised", "by OpenImageDenoise, after the error was measured"
    yield "Triangles", f"{statistics.triangles:,}"
    yield "Rays", f"{statistics.rays:,}"
    yield "Speed", f"{statistics.rays_per_second / 1e6:.2f} million rays/s"
    yield "Build", f"{statistics.build_seconds:.2f} s"
    yield "Trace", f"{statistics.trace_seconds:.2f} s"
    yield "Total", f"{statistics.total_seconds:.2f} s"
    yield "Peak memory", "unknown" if memory is None else f"{memory:,.0f} MB"


def describe_error(statistics: Statistics) -> Iterator[tuple[str, str]]:
    """Yield the lines about the error; one sample tells nothing."""
    if not math.isfinite(statistics.error):
        yield "Error", "unknown"
        return
    yield "Error", f"{format_error(statistics.error)} ({format_interval(statistics.error_interval)})"
    yield "Without noisiest 1%", format_error(statistics.error_p99)


class RAYTRACER_RENDER_PT_warnings(RenderPanel, bpy.types.Panel):
    """What the last render did not show as the scene says; click a name to select it."""

    bl_label = "Warnings"
    bl_parent_id = "RAYTRACER_RENDER_PT_statistics"

    @classmethod
    def poll(cls, context: Any) -> bool:
        return context.engine in cls.COMPAT_ENGINES and bool(list_warnings(context.scene))

    def draw(self, context: Any) -> None:
        warnings, width = list_warnings(context.scene), count_letters(context)
        for warning in warnings[:MOST_WARNINGS]:
            draw_warning(self.layout.column(align=True), warning, width)
        if len(warnings) > MOST_WARNINGS:
            self.layout.label(text=f"and {len(warnings) - MOST_WARNINGS} more, on the console")


def list_warnings(scene: Any) -> tuple[Warning, ...]:
    """Return the warnings of a scene's last render."""
    statistics = last_render(scene)
    return statistics.warnings if statistics else ()


def draw_warning(column: Any, warning: Warning, width: int) -> None:
    """Draw a button with the names of what a warning is about, and its text in lines of `width` letters below."""
    name = ", ".join(filter(None, (warning.object, warning.material)))
    if name:
        row = column.row()
        row.alignment = "LEFT"
        icon = "OBJECT_DATA" if warning.object else "MATERIAL"
        button = row.operator("raytracer.select_warned", text=name, icon=icon, emboss=False)
        button.object, button.material = warning.object, warning.material
    for index, line in enumerate(wrap_text(warning.text, width)):
        column.label(text=line, icon="BLANK1" if index else "ERROR")


class RAYTRACER_OT_select_warned(bpy.types.Operator):
    """Select the object of a warning, or the objects that have its material, and show the material"""

    bl_idname = "raytracer.select_warned"
    bl_label = "Select"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    object: StringProperty(name="Object", description="Name of the object to select")  # type: ignore[valid-type]
    material: StringProperty(  # type: ignore[valid-type]
        name="Material", description="Name of the material whose slot becomes active"
    )

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Objects can be selected."""
        return context.mode == "OBJECT"

    def execute(self, context: Any) -> set[str]:
        """Select them in place of what is selected."""
        found = [thing for thing in context.view_layer.objects if self._is_meant(thing)]
        if not found:
            self.report({"WARNING"}, f"{self.object or self.material} is not in this view layer")
            return {"CANCELLED"}
        for thing in context.view_layer.objects:
            thing.select_set(thing in found)
        context.view_layer.objects.active = found[0]
        names = [slot.name for slot in found[0].material_slots]
        if self.material in names:
            found[0].active_material_index = names.index(self.material)
        return {"FINISHED"}

    def _is_meant(self, thing: Any) -> bool:
        if self.object:
            return self.object in (thing.name, thing.name_full)
        return any(slot.material and slot.material.name == self.material for slot in thing.material_slots)


@persistent
def show_news(*_: Any) -> None:
    """Draw the render tab anew: Blender itself does so only when something in it was changed."""
    redraw("PROPERTIES")


# An animation's frame is told by the second.
NEWS = (HANDLERS.render_complete, HANDLERS.render_post, HANDLERS.render_cancel)


def register() -> None:
    """Watch for the ends of renders."""
    join(show_news, *NEWS)


def unregister() -> None:
    """Watch no more."""
    leave(show_news, *NEWS)


CLASSES = (RAYTRACER_RENDER_PT_statistics, RAYTRACER_RENDER_PT_warnings, RAYTRACER_OT_select_warned)
