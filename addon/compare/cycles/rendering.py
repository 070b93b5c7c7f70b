"""Two engines, one scene, matched settings: every pass comes back as scene-linear float32, row 0 at the top.

Both engines render through Blender's own operator into an uncompressed OpenEXR file. Whatever is set on the scene for
that is put back afterwards.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from raytracer.processes.folders import OwnedFolder

from ... import interrupts
from ...passes import MATTE_OPTIONS, enable_passes, find_pass, is_on, list_options, switch
from ...properties import BOUNCE_LIMITS, ENGINE, TAMING
from ...versions import blender_pass_name, escape_path, read_image_format, set_image_format
from .exr import read_exr

CYCLES = "CYCLES"
FOLDER_PREFIX = "raytracer_passes_"
Image = NDArray[np.float32]

# Cycles' largest limit.
MOST_TRANSPARENT = 1024
# What neither engine shall add to the traced picture, and one thread each for times that compare.
PLAIN_RENDER = {
    "resolution_percentage": 100,
    "use_border": False,
    "use_compositing": False,
    "use_sequencer": False,
    # What is kept from one render to the next is not told of another seed, and batches were alike.
    "use_persistent_data": False,
    "use_multiview": False,
    "dither_intensity": 0.0,
    "threads_mode": "FIXED",
    "threads": 1,
}
# Cycles without anything that trades correctness for speed or looks: no clamping, blurring, skipping or denoising, and
# samples that are scrambled afresh for each seed and pixel, not taken from a table.
UNBIASED_CYCLES = {
    "device": "CPU",
    "shading_system": False,
    "use_adaptive_sampling": False,
    "use_denoising": False,
    "use_guiding": False,
    "use_fast_gi": False,
    "use_animated_seed": False,
    "sampling_pattern": "SOBOL_BURLEY",
    "auto_scrambling_distance": False,
    "scrambling_distance": 1.0,
    "light_sampling_threshold": 0.0,
    "caustics_reflective": True,
    "caustics_refractive": True,
    "film_exposure": 1.0,
    "use_layer_samples": "IGNORE",
    "time_limit": 0.0,
    "min_light_bounces": 0,
    "min_transparent_bounces": 0,
}


@dataclass(frozen=True)
class Request:
    """What both engines shall render.

    samples : per pixel and batch; Cycles takes `cycles_factor` times as many
    batches : independent renders; seed : of the first, the next ones count up
    pixel_filter : 'BOX', one pixel wide whatever the width (Cycles' is), or 'BLACKMAN_HARRIS' of `filter_width` pixels
    through_centre : Cycles takes its first sample through the centre, which pulls a picture of few samples towards what
        is seen there, and has no depth of field; False leaves that sample out
    max_bounces : of any kind
    integrator : 'DIRECT' or 'PATH'; Cycles then follows no diffuse bounces, or all
    limits : other limits by their names in `properties.BOUNCE_LIMITS`; what it does not say is `max_bounces`, and as
        many transparent surfaces as no scene has
    taming : clamping and blurring by their names in `properties.TAMING`; none of what it does not say
    marches : Cycles marches through media in steps of its own, which biases how much light gets through
    """

    width: int
    height: int
    samples: int
    max_bounces: int
    batches: int = 1
    seed: int = 0
    pixel_filter: str = "BOX"
    filter_width: float = 1.0
    through_centre: bool = False
    passes: tuple[str, ...] = ("Combined",)
    cycles_factor: int = 1
    integrator: str = "DIRECT"
    limits: Mapping[str, int] = field(default_factory=dict)
    taming: Mapping[str, float] = field(default_factory=dict)
    marches: bool = False

    def list_limits(self) -> dict[str, int]:
        """Return all limits by the names in `properties.BOUNCE_LIMITS`."""
        limits = dict.fromkeys(BOUNCE_LIMITS, self.max_bounces) | {"transparent_bounces": MOST_TRANSPARENT}
        return limits | dict(self.limits)


@dataclass(frozen=True, eq=False)
class Rendering:
    """What one engine made of a Request: per pass the batches (k, h, w, channels) float32, and the seconds it took."""

    passes: dict[str, Image]
    seconds: float


@contextmanager
def changed(target: Any, **values: Any) -> Iterator[None]:
    """Set properties of a Blender object for as long as the context lasts."""
    before = {name: getattr(target, name) for name in values}
    try:
        for name, value in values.items():
            setattr(target, name, value)
        yield
    finally:
        for name, value in before.items():
            setattr(target, name, value)


@contextmanager
def exr_output(scene: Any, path: Path) -> Iterator[None]:
    """Let the render operator write every pass as float32 to an uncompressed OpenEXR file."""
    image = scene.render.image_settings
    before = read_image_format(image)
    try:
        set_image_format(image, "OPEN_EXR_MULTILAYER")
        image.color_mode, image.color_depth, image.exr_codec = "RGBA", "32", "NONE"
        with changed(scene.render, filepath=escape_path(str(path)), use_file_extension=False):
            yield
    finally:
        for name, value in before.items():
            setattr(image, name, value)


@contextmanager
def matched_settings(scene: Any, view_layer: Any, request: Request) -> Iterator[None]:
    """Set a scene up so that both engines compute the same picture."""
    limits = request.list_limits()
    cycles = {
        **UNBIASED_CYCLES,
        **{name: limits[own] for own, name in BOUNCE_LIMITS.items()},
        **{name: request.taming.get(own, 0.0) for own, name in TAMING.items()},
        **list_volume_settings(scene.cycles, request.marches),
        "samples": request.samples * request.cycles_factor,
        "pixel_filter_type": request.pixel_filter,
        "filter_width": request.filter_width,
    }
    if request.integrator == "DIRECT":
        cycles["diffuse_bounces"] = 0
    if not request.through_centre:
        cycles |= skip_samples(scene.cycles, request.samples * request.cycles_factor)
    ours = {
        "samples": request.samples,
        "use_noise_threshold": False,
        "use_adaptive_sampling": False,
        "time_limit": 0.0,
        "integrator": request.integrator,
        **limits,
        **{name: request.taming.get(name, 0.0) for name in TAMING},
        "workers": 1,
        "exposure": 1.0,
        "use_checkpoints": False,
        "use_denoising": False,
        "pixel_filter": request.pixel_filter,
        "filter_width": request.filter_width,
    }
    size = {"resolution_x": request.width, "resolution_y": request.height}
    others = {layer.name: layer.use for layer in scene.view_layers}
    preferences = bpy.context.preferences
    with (
        # Without these two Blender does not offer the sampling pattern.
        changed(preferences.view, show_developer_ui=True),
        changed(preferences.experimental, use_cycles_debug=True),
        changed(scene.render, engine=scene.render.engine, **PLAIN_RENDER, **size),
        changed(scene.cycles, seed=scene.cycles.seed, **cycles),
        changed(scene.reference_raytracer, seed=scene.reference_raytracer.seed, **ours),
        chosen_passes(view_layer, request.passes),
        sharp_camera(scene) if request.through_centre else nullcontext(),
    ):
        try:
            for layer in scene.view_layers:
                layer.use = layer == view_layer
            yield
        finally:
            for name, use in others.items():
                scene.view_layers[name].use = use


@contextmanager
def chosen_passes(view_layer: Any, names: tuple[str, ...]) -> Iterator[None]:
    """Let a view layer have exactly some passes for as long as the context lasts."""
    before = {option: is_on(view_layer, option) for option in (*list_options(), *MATTE_OPTIONS.values())}
    depth = view_layer.pass_cryptomatte_depth
    try:
        enable_passes(view_layer, names)
        yield
    finally:
        for option, on in before.items():
            switch(view_layer, option, on)
        view_layer.pass_cryptomatte_depth = depth


def sharp_camera(scene: Any) -> AbstractContextManager[None]:
    """Switch depth of field off for as long as the context lasts."""
    if scene.camera is None or scene.camera.type != "CAMERA":
        return nullcontext()
    return changed(scene.camera.data.dof, use_dof=False)


def list_volume_settings(settings: Any, marches: bool) -> dict[str, Any]:
    """Return the settings of Cycles that leave volumes unbiased; up to 4.5 it marches through them, here in steps so
    fine that the error of most is small. Or those of marching fast."""
    marching = {"volume_step_rate": 1.0 if marches else 0.1, "volume_max_steps": 1024 if marches else 65536}
    if hasattr(settings, "volume_biased"):  # 5.0
        return {"volume_biased": marches} | (marching if marches else {})
    return marching


def skip_samples(settings: Any, count: int) -> dict[str, Any]:
    """Return the settings of Cycles that take `count` samples of its sequence, after the first `count`."""
    if hasattr(settings, "use_sample_subset"):  # 4.5
        return {"use_sample_subset": True, "sample_offset": count, "sample_subset_length": count, "samples": 2 * count}
    return {"sample_offset": count}


def render_batches(scene: Any, view_layer: Any, engine: str, request: Request) -> Rendering:
    """Render a Request with one engine; call within `matched_settings`.

    Raises
    ------
    RuntimeError
        If the engine reports an error (from Blender's operator).
    """
    scene.render.engine = engine
    seeds = scene.cycles if engine == CYCLES else scene.reference_raytracer
    batches, seconds = [], 0.0
    with closing(OwnedFolder(FOLDER_PREFIX)) as folder, interrupts.tidying(folder.close):
        path = folder.path / "passes.exr"
        with exr_output(scene, path):
            for batch in range(request.batches):
                seeds.seed = request.seed + batch
                started = time.perf_counter()
                with interrupts.hold():
                    bpy.ops.render.render(write_still=True, scene=scene.name)
                seconds += time.perf_counter() - started
                batches.append(collect_passes(read_exr(path), view_layer.name, request.passes))
                path.unlink()  # a render that writes nothing must not pass for the one before
    passes = {name: np.stack([batch[name] for batch in batches]) for name in request.passes}
    return Rendering(passes, seconds)


def collect_passes(channels: dict[str, Image], layer: str, names: Sequence[str]) -> dict[str, Image]:
    """Return the passes (h, w, channels) of a view layer from the channels "layer.pass.letter" of its file."""
    return {
        name: np.stack(
            [channels[f"{layer}.{blender_pass_name(name)}.{letter}"] for letter in find_pass(name).channels], axis=-1
        )
        for name in names
    }


def render_both(scene: Any, view_layer: Any, request: Request) -> tuple[Rendering, Rendering]:
    """Render a Request with this add-on's engine and with Cycles; return (ours, Cycles').

    Raises
    ------
    RuntimeError
        If Cycles is not there, or an engine reports an error.
    """
    if not hasattr(scene, "cycles"):
        raise RuntimeError("Cycles is switched off: enable its add-on in the preferences")
    with matched_settings(scene, view_layer, request):
        ours = render_batches(scene, view_layer, ENGINE, request)
        return ours, render_batches(scene, view_layer, CYCLES, request)
