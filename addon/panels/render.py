"""The render tab: settings."""

# ruff: noqa: N801, RUF012  (Blender prescribes the form of class names and attributes)

from __future__ import annotations

from typing import Any

import bpy

from ..denoising.process import NO_DENOISER
from ..editors import count_letters, wrap_text
from ..properties import BOUNCE_LIMITS, count_processors
from ..versions import has_denoiser
from .presets import RAYTRACER_PT_sampling_presets
from .shared import RenderPanel, split


class RAYTRACER_RENDER_PT_sampling(RenderPanel, bpy.types.Panel):
    """How many samples each pixel gets."""

    bl_label = "Sampling"

    def draw_header_preset(self, context: Any) -> None:
        RAYTRACER_PT_sampling_presets.draw_panel_header(self.layout)

    def draw(self, context: Any) -> None:
        column, settings = split(self), context.scene.reference_raytracer
        column.prop(settings, "viewport_samples", text="Viewport")
        row = column.row(heading="Noise Threshold")
        row.prop(settings, "use_noise_threshold", text="")
        threshold = row.row()
        threshold.active = settings.use_noise_threshold
        threshold.prop(settings, "noise_threshold", text="")
        samples = column.column(align=True)
        samples.prop(settings, "samples", text="Max Samples" if settings.use_noise_threshold else "Render")
        least = samples.column(align=True)
        least.active = settings.use_noise_threshold
        least.prop(settings, "min_samples")
        column.prop(settings, "time_limit")
        column.prop(settings, "use_adaptive_sampling")
        column.prop(settings, "seed")


class RAYTRACER_RENDER_PT_denoise(RenderPanel, bpy.types.Panel):
    """Whether noise is taken out of finished pictures."""

    bl_label = "Denoise"
    bl_parent_id = "RAYTRACER_RENDER_PT_sampling"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        column, settings = split(self), context.scene.reference_raytracer
        choices = column.column(heading="Denoise")
        choices.enabled = has_denoiser()
        choices.prop(settings, "use_viewport_denoising", text="Viewport")
        choices.prop(settings, "use_denoising", text="Render")
        if not choices.enabled:
            for index, line in enumerate(wrap_text(f"Not available: {NO_DENOISER}", count_letters(context))):
                column.label(text=line, icon="BLANK1" if index else "INFO")


class RAYTRACER_RENDER_PT_light_paths(RenderPanel, bpy.types.Panel):
    """Which light is followed."""

    bl_label = "Light Paths"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        split(self).prop(context.scene.reference_raytracer, "integrator")


class RAYTRACER_RENDER_PT_max_bounces(RenderPanel, bpy.types.Panel):
    """How far paths are followed."""

    bl_label = "Max Bounces"
    bl_parent_id = "RAYTRACER_RENDER_PT_light_paths"

    def draw(self, context: Any) -> None:
        column, settings = split(self), context.scene.reference_raytracer
        column.prop(settings, "max_bounces")
        kinds = column.column(align=True)
        for name in BOUNCE_LIMITS:
            if name != "max_bounces":
                kinds.prop(settings, name)


class RAYTRACER_RENDER_PT_clamping(RenderPanel, bpy.types.Panel):
    """What trades correctness for less noise."""

    bl_label = "Clamping"
    bl_parent_id = "RAYTRACER_RENDER_PT_light_paths"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        column, settings = split(self), context.scene.reference_raytracer
        limits = column.column(align=True)
        limits.prop(settings, "clamp_direct")
        limits.prop(settings, "clamp_indirect")
        column.prop(settings, "filter_glossy")


class RAYTRACER_RENDER_PT_precision(RenderPanel, bpy.types.Panel):
    """How intersections are computed."""

    bl_label = "Precision"

    def draw(self, context: Any) -> None:
        split(self).prop(context.scene.reference_raytracer, "precision", text="Hits")


class RAYTRACER_RENDER_PT_film(RenderPanel, bpy.types.Panel):
    """How samples become pixels."""

    bl_label = "Film"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        column, settings = split(self), context.scene.reference_raytracer
        column.prop(settings, "exposure")
        column.prop(settings, "pixel_filter")
        column.prop(settings, "filter_width")
        column.prop(context.scene.render, "film_transparent", text="Transparent")


class RAYTRACER_RENDER_PT_performance(RenderPanel, bpy.types.Panel):
    """On how many processors."""

    bl_label = "Performance"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        column, settings = split(self), context.scene.reference_raytracer
        column.prop(settings, "workers_mode")
        column = column.column()
        column.enabled = settings.workers_mode == "FIXED"
        if column.enabled:
            column.prop(settings, "workers")
        else:
            column.label(text=f"Workers: {count_processors()}")


class RAYTRACER_RENDER_PT_checkpoints(RenderPanel, bpy.types.Panel):
    """Where unfinished renders are kept, and how often."""

    bl_label = "Checkpoints"
    bl_parent_id = "RAYTRACER_RENDER_PT_performance"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header(self, context: Any) -> None:
        self.layout.prop(context.scene.reference_raytracer, "use_checkpoints", text="")

    def draw(self, context: Any) -> None:
        column, settings = split(self), context.scene.reference_raytracer
        column.active = settings.use_checkpoints
        column.prop(settings, "checkpoint_folder")
        column.prop(settings, "checkpoint_interval")


class RAYTRACER_RENDER_PT_simplify(RenderPanel, bpy.types.Panel):
    """What Blender's own panel offers for meshes and hair; that one would stand above all others."""

    bl_label = "Simplify"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header(self, context: Any) -> None:
        self.layout.prop(context.scene.render, "use_simplify", text="")

    def draw(self, context: Any) -> None:
        column, render = split(self), context.scene.render
        column.active = render.use_simplify
        for name, label in (
            ("simplify_subdivision", "Max Subdivision"),
            ("simplify_child_particles", "Child Particles"),
        ):
            limits = column.column(align=True)
            limits.prop(render, name, text=f"{label} Viewport")
            limits.prop(render, f"{name}_render", text="Render")


CLASSES = (
    RAYTRACER_RENDER_PT_sampling,
    RAYTRACER_RENDER_PT_denoise,
    RAYTRACER_RENDER_PT_light_paths,
    RAYTRACER_RENDER_PT_max_bounces,
    RAYTRACER_RENDER_PT_clamping,
    RAYTRACER_RENDER_PT_precision,
    RAYTRACER_RENDER_PT_film,
    RAYTRACER_RENDER_PT_performance,
    RAYTRACER_RENDER_PT_checkpoints,
    RAYTRACER_RENDER_PT_simplify,
)
