"""The settings of the render engine, kept in the .blend as `Scene.reference_raytracer`. Imports bpy."""

from __future__ import annotations

import os
from typing import Any

import bpy
from bpy.props import EnumProperty, FloatProperty, IntProperty, PointerProperty

PRECISIONS = (
    ("CERTIFIED", "Certified", "Every hit is decided exactly and comes with a proven bound on its error"),
    ("FLOAT64", "Double", "64-bit floating point: watertight, without the proof"),
    ("FLOAT32", "Single", "32-bit floating point: the error other renderers have, for comparison"),
)
PIXEL_FILTERS = (
    ("BLACKMAN_HARRIS", "Blackman-Harris", "Smooth: each sample counts into the pixel it falls near to"),
    ("BOX", "Box", "Sharp: the plain mean over a square; a narrow one gives values at pixel centres"),
)


class ReferenceRaytracerSettings(bpy.types.PropertyGroup):
    """Settings of one scene; each is the keyword of the same name of `raytracer.render`."""

    samples: IntProperty(  # type: ignore[valid-type]
        name="Samples",
        description="Light paths per pixel; noise falls with its square root or faster",
        default=64,
        min=1,
        soft_max=4096,
    )
    max_bounces: IntProperty(  # type: ignore[valid-type]
        name="Max Bounces",
        description="How often a path is reflected or refracted; 0 shows direct light only",
        default=8,
        min=0,
        soft_max=64,
        max=1024,
    )
    workers: IntProperty(  # type: ignore[valid-type]
        name="Workers",
        description="Processes that trace at the same time; 0 takes one for each processor. "
        "The image is the same for any number",
        default=0,
        min=0,
        soft_max=64,
        max=1024,
    )
    precision: EnumProperty(  # type: ignore[valid-type]
        name="Precision",
        description="How intersections are computed",
        items=PRECISIONS,
        default="CERTIFIED",
    )
    seed: IntProperty(  # type: ignore[valid-type]
        name="Seed",
        description="Chooses the noise pattern; the same seed gives the same image",
        default=0,
        min=0,
    )
    pixel_filter: EnumProperty(  # type: ignore[valid-type]
        name="Filter",
        description="How samples weigh in their pixel",
        items=PIXEL_FILTERS,
        default="BLACKMAN_HARRIS",
    )
    filter_width: FloatProperty(  # type: ignore[valid-type]
        name="Width",
        description="Pixels that a sample reaches: radius of Blackman-Harris, side of the box (1 is the plain mean)",
        subtype="PIXEL",
        default=1.5,
        min=0.01,
        max=10.0,
        soft_max=4.0,
        precision=2,
    )


def count_processors() -> int:
    """Return how many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def settings_keywords(scene: Any) -> dict[str, Any]:
    """Return a scene's settings as keywords of `raytracer.render`."""
    settings = scene.reference_raytracer
    return {
        "samples": settings.samples,
        "max_bounces": settings.max_bounces,
        "workers": settings.workers or count_processors(),
        "precision": settings.precision.lower(),
        "seed": settings.seed,
        "pixel_filter": settings.pixel_filter.lower(),
        "filter_width": settings.filter_width,
        "transparent": scene.render.film_transparent,
    }


def register() -> None:
    """Add the settings to every scene."""
    bpy.utils.register_class(ReferenceRaytracerSettings)
    bpy.types.Scene.reference_raytracer = PointerProperty(
        type=ReferenceRaytracerSettings, name="Reference Ray Tracer", description="Settings of the render engine"
    )


def unregister() -> None:
    """Take the settings out of every scene."""
    del bpy.types.Scene.reference_raytracer
    bpy.utils.unregister_class(ReferenceRaytracerSettings)
