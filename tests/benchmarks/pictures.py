"""Renders of .blend files by both engines, for the benchmarks of pictures: what the error is, and what it took.

The error is told from independent renders of the same picture, which differ by their noise alone: no reference has to
converge, and what the engines' pictures have in common (both are exact in the limit) does not matter. Times are the
processor's, of this process, all threads together; Cycles is given one thread.
"""

from __future__ import annotations

import time
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tests.benchmarks.noise import measure_noise

SCENES = Path(__file__).resolve().parents[2] / "blend_scenes"
OURS, CYCLES = "raytracer", "Cycles"
WIDTH, HEIGHT = 240, 160


@dataclass(frozen=True)
class Renders:
    """Independent renders of one picture.

    seconds : of one, the fastest; error : root mean square of their noise, over the mean level of the picture
    """

    samples: int
    seconds: float
    error: float


@contextmanager
def open_scene(name, persistent=True, size=(WIDTH, HEIGHT), integrator="DIRECT"):
    """Open one of `blend_scenes`, set up so that both engines compute the same light; yield (scene, view layer)."""
    import bpy

    import addon
    from addon.compare.cycles.rendering import changed, matched_settings

    was_registered = hasattr(bpy.types.Scene, "reference_raytracer")
    if not was_registered:
        addon.register()
    try:
        bpy.ops.wm.open_mainfile(filepath=str(SCENES / f"{name}.blend"), load_ui=False)
        scene, view_layer = bpy.context.scene, bpy.context.view_layer
        request = replace(make_request(scene, 1), width=size[0], height=size[1], integrator=integrator)
        with (
            matched_settings(scene, view_layer, request),
            changed(scene.render, use_persistent_data=persistent),
        ):
            yield scene, view_layer
    finally:
        if not was_registered:  # tests that come after register it themselves
            addon.unregister()


def make_request(scene, samples, seed=0):
    """Return the Request of a render through a box filter of one pixel."""
    from addon.compare.cycles.rendering import Request

    return Request(WIDTH, HEIGHT, samples, scene.reference_raytracer.max_bounces, seed=seed)


def render_repeatedly(scene, view_layer, engine, samples, repeats=2):
    """Render one picture with several seeds; return Renders."""
    from addon.compare.cycles import rendering

    names = {OURS: rendering.ENGINE, CYCLES: rendering.CYCLES}
    set_samples(scene, samples)
    pictures, seconds = [], []
    for seed in range(repeats):
        request = make_request(scene, samples, seed=1 + seed)
        started = time.process_time()
        rendered = rendering.render_batches(scene, view_layer, names[engine], request)
        seconds.append(time.process_time() - started)
        pictures.append(rendered.passes["Combined"][0, ..., :3])
    return Renders(samples, min(seconds), measure_noise(np.stack(pictures)))


def set_samples(scene, samples):
    """Set the number of samples of both engines; Cycles takes those after the first `samples` of its sequence, for its
    very first sample goes through the pixel's centre."""
    from addon.compare.cycles.rendering import skip_samples

    scene.reference_raytracer.samples = samples
    scene.cycles.samples = samples
    for name, value in skip_samples(scene.cycles, samples).items():
        setattr(scene.cycles, name, value)


def fit_power(samples, errors):
    """Return (c, p) of error = c N^-p, by least squares of the logarithms."""
    slope, offset = np.polyfit(np.log(samples), np.log(errors), 1)
    return float(np.exp(offset)), float(-slope)


def fit_line(samples, seconds):
    """Return (a, b) of seconds = a + b N, weighed by 1 / seconds; neither is negative."""
    slope, offset = np.polyfit(samples, seconds, 1, w=1.0 / np.asarray(seconds))
    return max(float(offset), 0.0), max(float(slope), 0.0)
