"""The engine's panels, and the built-in ones that it joins while it is registered. Imports bpy.

A panel is shown for the engines in its `COMPAT_ENGINES`. Most of Blender's carry BLENDER_RENDER, the mark of settings
that any engine may follow; those for things this engine does not follow are left out. The few of EEVEE's that edit
what every engine shares (shader nodes, light) are joined too, so that they look as in the Blender at hand.
"""

# ruff: noqa: N801, RUF012  (Blender prescribes the form of class names and attributes)

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from typing import Any

import bpy

from .engine import ENGINE
from .passes import PASSES
from .properties import BOUNCE_LIMITS
from .statistics import Statistics, last_render

# Built-in panels marked BLENDER_RENDER for what the engine does not follow, or replaced by a better one below.
LEFT_OUT = (
    "DATA_PT_camera_stereoscopy",
    "DATA_PT_light",
    "DATA_PT_volume_render",
    "EEVEE_MATERIAL_PT_viewport_settings",
    "NODE_DATA_PT_light",
    "RENDER_PT_freestyle",
    "RENDER_PT_stereoscopy",
)
LEFT_OUT_GROUPS = ("DATA_PT_lightprobe", "MATERIAL_PT_freestyle", "RENDER_PT_simplify", "VIEWLAYER_PT_freestyle")

# EEVEE's panels for what all engines share.
BORROWED = (
    "DATA_PT_EEVEE_light",
    "EEVEE_MATERIAL_PT_context_material",
    "EEVEE_MATERIAL_PT_surface",
    "EEVEE_WORLD_PT_surface",
    "MATERIAL_PT_preview",
)


class _RenderPanel:
    """A panel of the render tab."""

    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    COMPAT_ENGINES = {ENGINE}

    @classmethod
    def poll(cls, context: Any) -> bool:
        return context.engine in cls.COMPAT_ENGINES


def _split(panel: Any) -> Any:
    """Return a column with Blender's usual split of name and value."""
    panel.layout.use_property_split = True
    panel.layout.use_property_decorate = False
    return panel.layout.column()


class RAYTRACER_RENDER_PT_sampling(_RenderPanel, bpy.types.Panel):
    """How many samples each pixel gets."""

    bl_label = "Sampling"

    def draw(self, context: Any) -> None:
        column, settings = _split(self), context.scene.reference_raytracer
        samples = column.column(align=True)
        samples.prop(settings, "viewport_samples", text="Samples Viewport")
        samples.prop(settings, "samples", text="Render")
        column.prop(settings, "seed")


class RAYTRACER_RENDER_PT_light_paths(_RenderPanel, bpy.types.Panel):
    """How far paths are followed."""

    bl_label = "Light Paths"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        column, settings = _split(self), context.scene.reference_raytracer
        column.prop(settings, "integrator")
        limits = column.column(heading="Max Bounces", align=True)
        for name in BOUNCE_LIMITS:
            limits.prop(settings, name)
        clamping = column.column(heading="Clamping", align=True)
        clamping.prop(settings, "clamp_direct")
        clamping.prop(settings, "clamp_indirect")
        column.prop(settings, "filter_glossy")


class RAYTRACER_RENDER_PT_film(_RenderPanel, bpy.types.Panel):
    """How samples become pixels."""

    bl_label = "Film"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        column, settings = _split(self), context.scene.reference_raytracer
        column.prop(context.scene.render, "film_transparent", text="Transparent")
        column.prop(settings, "pixel_filter")
        column.prop(settings, "filter_width")


class RAYTRACER_RENDER_PT_performance(_RenderPanel, bpy.types.Panel):
    """How precisely and on how many processors."""

    bl_label = "Performance"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        column, settings = _split(self), context.scene.reference_raytracer
        column.prop(settings, "precision")
        column.prop(settings, "workers")


class RAYTRACER_RENDER_PT_simplify(_RenderPanel, bpy.types.Panel):
    """What Blender's own panel offers for meshes; that one would stand above all others."""

    bl_label = "Simplify"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header(self, context: Any) -> None:
        self.layout.prop(context.scene.render, "use_simplify", text="")

    def draw(self, context: Any) -> None:
        column, render = _split(self), context.scene.render
        column.active = render.use_simplify
        column.prop(render, "simplify_subdivision", text="Max Subdivision Viewport")
        column.prop(render, "simplify_subdivision_render", text="Render")


class RAYTRACER_RENDER_PT_statistics(_RenderPanel, bpy.types.Panel):
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


class RAYTRACER_RENDER_PT_warnings(_RenderPanel, bpy.types.Panel):
    """What the last render did not show as the scene says."""

    bl_label = "Warnings"
    bl_parent_id = "RAYTRACER_RENDER_PT_statistics"

    @classmethod
    def poll(cls, context: Any) -> bool:
        statistics = last_render(context.scene)
        return context.engine in cls.COMPAT_ENGINES and statistics is not None and bool(statistics.warnings)

    def draw(self, context: Any) -> None:
        statistics = last_render(context.scene)
        column = self.layout.column(align=True)
        for warning in statistics.warnings if statistics else ():
            for index, line in enumerate(wrap_text(warning, count_letters(context))):
                column.label(text=line, icon="BLANK1" if index else "ERROR")


class RAYTRACER_VIEWLAYER_PT_passes(bpy.types.Panel):
    """Which passes a view layer renders."""

    bl_label = "Passes"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "view_layer"
    COMPAT_ENGINES = {ENGINE}

    @classmethod
    def poll(cls, context: Any) -> bool:
        return context.engine in cls.COMPAT_ENGINES

    def draw(self, context: Any) -> None:
        column = _split(self).column(heading="Include", align=True)
        for name, stored in PASSES.items():
            if name != "Combined":
                column.prop(context.view_layer, stored.option, text=name)


class RAYTRACER_WORLD_PT_preview(bpy.types.Panel):
    """A small picture of the world; Blender's own panel is Cycles'."""

    bl_label = "Preview"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "world"
    bl_options = {"DEFAULT_CLOSED"}
    COMPAT_ENGINES = {ENGINE}

    @classmethod
    def poll(cls, context: Any) -> bool:
        return context.world is not None and context.engine in cls.COMPAT_ENGINES

    def draw(self, context: Any) -> None:
        self.layout.template_preview(context.world)


class RAYTRACER_LIGHT_PT_tracing(bpy.types.Panel):
    """What EEVEE's panel of a light does not show."""

    bl_label = "Ray Tracing"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "data"
    bl_parent_id = "DATA_PT_EEVEE_light"
    COMPAT_ENGINES = {ENGINE}

    @classmethod
    def poll(cls, context: Any) -> bool:
        return context.light is not None and context.engine in cls.COMPAT_ENGINES

    def draw(self, context: Any) -> None:
        column = _split(self)
        column.prop(context.light, "use_shadow", text="Cast Shadow")
        if context.light.type == "AREA":
            column.prop(context.light, "spread")


CLASSES = (
    RAYTRACER_RENDER_PT_sampling,
    RAYTRACER_RENDER_PT_light_paths,
    RAYTRACER_RENDER_PT_film,
    RAYTRACER_RENDER_PT_performance,
    RAYTRACER_RENDER_PT_simplify,
    RAYTRACER_RENDER_PT_statistics,
    RAYTRACER_RENDER_PT_warnings,
    RAYTRACER_VIEWLAYER_PT_passes,
    RAYTRACER_LIGHT_PT_tracing,
    RAYTRACER_WORLD_PT_preview,
)


def describe_statistics(statistics: Statistics) -> Iterator[tuple[str, str]]:
    """Yield the lines of the statistics panel as names and values with units."""
    memory = statistics.peak_memory_mb
    yield "Resolution", f"{statistics.width} x {statistics.height}"
    yield "Samples", f"{statistics.samples}{' (stopped)' if statistics.cancelled else ''}"
    yield "Triangles", f"{statistics.triangles:,}"
    yield "Rays", f"{statistics.rays:,}"
    yield "Speed", f"{statistics.rays_per_second / 1e6:.2f} million rays/s"
    yield "Build", f"{statistics.build_seconds:.2f} s"
    yield "Trace", f"{statistics.trace_seconds:.2f} s"
    yield "Total", f"{statistics.total_seconds:.2f} s"
    yield "Peak memory", "unknown" if memory is None else f"{memory:,.0f} MB"


def count_letters(context: Any) -> int:
    """Return about how many letters fit beside an icon in the panel's width."""
    letter_width = 7 * context.preferences.system.ui_scale
    return max(20, int(context.region.width / letter_width) - 8)


def wrap_text(text: str, width: int) -> list[str]:
    """Return `text` in lines of at most `width` letters, broken at spaces; Blender's labels do not wrap."""
    return textwrap.wrap(text, width) or [""]


def find_built_in_panels() -> list[Any]:
    """Return the built-in panels that this engine joins."""
    return [panel for panel in all_subclasses(bpy.types.Panel) if is_joined(panel)]


def is_joined(panel: Any) -> bool:
    """Return whether the engine shows a built-in panel."""
    name = panel.__name__
    if name in BORROWED:
        return True
    left_out = name in LEFT_OUT or name.startswith(LEFT_OUT_GROUPS)
    return "BLENDER_RENDER" in getattr(panel, "COMPAT_ENGINES", ()) and not left_out


def all_subclasses(kind: Any) -> Iterator[Any]:
    """Yield the classes that derive from `kind`, directly or not."""
    for subclass in kind.__subclasses__():
        yield subclass
        yield from all_subclasses(subclass)


_joined: list[Any] = []


def register() -> None:
    """Add the panels and join the built-in ones."""
    for panel in CLASSES:
        bpy.utils.register_class(panel)
    _joined[:] = find_built_in_panels()
    for panel in _joined:
        panel.COMPAT_ENGINES.add(ENGINE)


def unregister() -> None:
    """Leave the built-in panels and take the own ones out."""
    for panel in _joined:
        panel.COMPAT_ENGINES.discard(ENGINE)
    _joined.clear()
    for panel in reversed(CLASSES):
        bpy.utils.unregister_class(panel)
