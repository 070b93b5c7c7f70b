"""The settings of the render engine, kept in the .blend as `Scene.reference_raytracer`."""

from __future__ import annotations

import os
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from .versions import count_passages, relative_path_options

# The engine's identifier, as Blender and its files know it.
ENGINE = "REFERENCE_RAYTRACER"

PRECISIONS = (
    ("CERTIFIED", "Certified", "Every hit is decided exactly (hair: in 64 bits) and has a proven bound on its error"),
    ("FLOAT64", "Double", "64-bit floating point: watertight, without the proof"),
    ("FLOAT32", "Single", "32-bit floating point: the error other renderers have, for comparison"),
)
# The limits of the settings, and what Cycles calls them.
BOUNCE_LIMITS = {
    "max_bounces": "max_bounces",
    "diffuse_bounces": "diffuse_bounces",
    "glossy_bounces": "glossy_bounces",
    "transmission_bounces": "transmission_bounces",
    "volume_bounces": "volume_bounces",
    "transparent_bounces": "transparent_max_bounces",
}
# What trades light for less noise, and what Cycles calls it.
TAMING = {
    "clamp_direct": "sample_clamp_direct",
    "clamp_indirect": "sample_clamp_indirect",
    "filter_glossy": "blur_glossy",
}
PIXEL_FILTERS = (
    ("BLACKMAN_HARRIS", "Blackman-Harris", "Smooth, Cycles' default"),
    ("BOX", "Box", "Sharp: plain average over a square; a narrow box gives values at pixel centers"),
)

WORKERS_MODES = (
    ("AUTO", "Auto-Detect", "One render process per CPU core"),
    ("FIXED", "Fixed", "Choose the number of render processes"),
)

INTEGRATORS = (
    ("PATH", "Path", "Full global illumination, as in Cycles"),
    (
        "DIRECT",
        "Direct",
        "Direct light, reflections and refractions; no light bounced between diffuse surfaces",
    ),
)


# What can be baked; the rest of what Blender's operator knows, this engine does not make.
BAKE_TYPES = (
    ("COMBINED", "Combined", "All light that leaves the surface"),
    ("AO", "Ambient Occlusion", "How open the surroundings are, up to the distance set in the World tab"),
    ("NORMAL", "Normal", "The shading normal, with bump"),
    ("POSITION", "Position", "Where the surface is, in meters"),
    ("UV", "UV", "Texture coordinates"),
    ("EMIT", "Emit", "Light emitted by the surface itself"),
    ("DIFFUSE", "Diffuse", "Diffusely reflected light, or its color"),
    ("GLOSSY", "Glossy", "Light reflected by mirrors and glossy surfaces, or its color"),
    ("TRANSMISSION", "Transmission", "Transmitted light, or its color"),
)


def _bounce_limit(name: str, counted: str, default: int) -> Any:
    """A limit of a path; the defaults are Cycles'."""
    return IntProperty(
        name=name, description=f"Maximum number of {counted}", default=default, min=0, soft_max=64, max=1024
    )


def _light_limit(name: str, which: str, default: float) -> Any:
    """A limit of one sample's light; the defaults are Cycles'."""
    return FloatProperty(
        name=name,
        description=f"Most {which} light that a single sample may contribute, to reduce noise; "
        "0 disables clamping and keeps the image exact",
        default=default,
        min=0.0,
        soft_max=100.0,
    )


def _get_workers_mode(settings: Any) -> int:
    return int(settings.workers > 0)


def _set_workers_mode(settings: Any, mode: int) -> None:
    """Let the number of workers follow the CPU cores, or fix it at what it is now."""
    settings.workers = (settings.workers or count_processors()) if mode else 0


class ReferenceRaytracerSettings(bpy.types.PropertyGroup):
    """Settings of one scene; most are the keyword of the same name of `raytracer.render` (`settings_keywords`)."""

    use_noise_threshold: BoolProperty(  # type: ignore[valid-type]
        name="Noise Threshold",
        description="Stop rendering as soon as the error of the image is below this threshold",
        default=False,
    )
    noise_threshold: FloatProperty(  # type: ignore[valid-type]
        name="Noise Threshold",
        description="Root mean square error at which the image is finished, as a share of its mean brightness. "
        "The error is estimated from the samples themselves",
        subtype="PERCENTAGE",
        default=1.0,
        min=0.001,
        max=100.0,
        soft_min=0.1,
        soft_max=10.0,
        precision=2,
    )
    use_adaptive_sampling: BoolProperty(  # type: ignore[valid-type]
        name="Adaptive Sampling",
        description="Spend more samples on noisy pixels and fewer on the others, at the same total cost; the image "
        "stays unbiased. Below 32 samples per pixel, or 260,000 in total, all pixels get the same number",
        default=False,
    )
    samples: IntProperty(  # type: ignore[valid-type]
        name="Samples",
        description="Number of light paths per pixel, or their maximum with a noise threshold or a time limit; "
        "noise falls at least with the square root of it",
        default=64,
        min=1,
        soft_max=4096,
    )
    min_samples: IntProperty(  # type: ignore[valid-type]
        name="Min Samples",
        description="Minimum number of light paths per pixel before the noise threshold may stop the render; "
        "0 chooses automatically",
        default=0,
        min=0,
        soft_max=4096,
    )
    time_limit: FloatProperty(  # type: ignore[valid-type]
        name="Time Limit",
        description="Most time that a view layer may take, not counting the time to read the scene; rendering stops "
        "after the last sample that fits in. 0 sets no limit",
        unit="TIME_ABSOLUTE",
        default=0.0,
        min=0.0,
        soft_max=3600.0,
        step=100,
    )
    viewport_samples: IntProperty(  # type: ignore[valid-type]
        name="Viewport Samples",
        description="Number of light paths per pixel in the viewport; refinement stops there",
        default=32,
        min=1,
        soft_max=1024,
    )
    use_denoising: BoolProperty(  # type: ignore[valid-type]
        name="Denoise",
        description="Remove noise from the finished render with OpenImageDenoise. The result is good to look at but "
        "no reference: noisy detail is guessed. Error and all other passes stay as rendered",
        default=False,
    )
    use_viewport_denoising: BoolProperty(  # type: ignore[valid-type]
        name="Viewport Denoise",
        description="Remove noise from the viewport with OpenImageDenoise, once it has all its samples",
        default=False,
    )
    integrator: EnumProperty(  # type: ignore[valid-type]
        name="Integrator",
        description="How light is transported through the scene",
        items=INTEGRATORS,
        default="PATH",
    )
    max_bounces: _bounce_limit("Total", "bounces of any kind; 0 shows direct light only", 12)  # type: ignore[valid-type]
    diffuse_bounces: _bounce_limit("Diffuse", "diffuse reflections", 4)  # type: ignore[valid-type]
    glossy_bounces: _bounce_limit("Glossy", "reflections by mirrors and glossy surfaces", 4)  # type: ignore[valid-type]
    transmission_bounces: _bounce_limit(  # type: ignore[valid-type]
        "Transmission", "passages through glass and translucent surfaces", 12
    )
    volume_bounces: _bounce_limit(  # type: ignore[valid-type]
        "Volume", "scattering inside of volumes; 0 shows the light that is scattered once", 0
    )
    transparent_bounces: _bounce_limit(  # type: ignore[valid-type]
        "Transparent", "straight passages through transparent surfaces, which do not count as bounces", 8
    )
    clamp_direct: _light_limit("Direct Light", "direct", 0.0)  # type: ignore[valid-type]
    clamp_indirect: _light_limit("Indirect Light", "indirect", 10.0)  # type: ignore[valid-type]
    filter_glossy: FloatProperty(  # type: ignore[valid-type]
        name="Filter Glossy",
        description="Blurs glossy reflections seen after a diffuse or rough bounce, to reduce noise; "
        "0 keeps the image exact",
        default=1.0,
        min=0.0,
        max=10.0,
    )
    workers_mode: EnumProperty(  # type: ignore[valid-type]
        name="Workers Mode",
        description="How many processes render; the image does not depend on it",
        items=WORKERS_MODES,
        get=_get_workers_mode,
        set=_set_workers_mode,
    )
    workers: IntProperty(  # type: ignore[valid-type]
        name="Workers",
        description="Number of render processes; 0 uses one per CPU core. The image does not depend on it",
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
    exposure: FloatProperty(  # type: ignore[valid-type]
        name="Exposure",
        description="Brightness of the image: a number that all light is multiplied by",
        default=1.0,
        min=0.0,
        max=10.0,
    )
    pixel_filter: EnumProperty(  # type: ignore[valid-type]
        name="Filter",
        description="How samples are weighted within a pixel",
        items=PIXEL_FILTERS,
        default="BLACKMAN_HARRIS",
    )
    filter_width: FloatProperty(  # type: ignore[valid-type]
        name="Width",
        description="Size of the filter in pixels: the radius of Blackman-Harris, or the side of the box "
        "(1 averages over exactly one pixel)",
        subtype="PIXEL",
        default=1.5,
        min=0.01,
        max=10.0,
        soft_max=4.0,
        precision=2,
    )
    bake_type: EnumProperty(  # type: ignore[valid-type]
        name="Bake Type",
        description="What to bake",
        items=BAKE_TYPES,
        default="COMBINED",
    )
    use_checkpoints: BoolProperty(  # type: ignore[valid-type]
        name="Checkpoints",
        description="Save the unfinished render of a still image, so that Render > Resume Render continues it after "
        "Esc or a crash. The file is removed when the image is complete",
        default=False,
    )
    checkpoint_folder: StringProperty(  # type: ignore[valid-type]
        name="Folder",
        description="Where unfinished renders are saved; // is the folder of the .blend file, or a temporary one "
        "while that has not been saved",
        default="//",
        subtype="DIR_PATH",
        options=relative_path_options(),
    )
    checkpoint_interval: IntProperty(  # type: ignore[valid-type]
        name="Interval",
        description="Seconds between two saves, which take at most a twentieth of the render time",
        default=60,
        min=1,
        soft_max=3600,
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
        "error": settings.noise_threshold / 100.0 if settings.use_noise_threshold else None,
        "min_samples": settings.min_samples,
        "seconds": settings.time_limit or None,
        "adaptive": settings.use_adaptive_sampling,
        "integrator": settings.integrator.lower(),
        **{name: getattr(settings, name) for name in (*BOUNCE_LIMITS, *TAMING)},
        "transparent_bounces": count_passages(settings.transparent_bounces),
        "shadow_passages": settings.transparent_bounces,
        "workers": settings.workers or count_processors(),
        "precision": settings.precision.lower(),
        "seed": settings.seed,
        "pixel_filter": settings.pixel_filter.lower(),
        "filter_width": settings.filter_width,
        "exposure": settings.exposure,
        "transparent": scene.render.film_transparent,
        **(read_world_settings(scene.world) if scene.world else {}),
    }


# The power of the distance by which mist thickens.
MIST_POWERS = {"QUADRATIC": 2.0, "LINEAR": 1.0, "INVERSE_QUADRATIC": 0.5}


def read_world_settings(world: Any) -> dict[str, Any]:
    """Return what a world says of passes, as keywords of `raytracer.render`."""
    return {"mist": read_mist(world.mist_settings), "occlusion_distance": world.light_settings.distance}


def read_mist(settings: Any) -> tuple[float, float, float]:
    """Return start, depth and power of a world's mist."""
    return settings.start, settings.depth, MIST_POWERS[settings.falloff]


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
