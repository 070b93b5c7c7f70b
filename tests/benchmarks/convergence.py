"""How the error falls with the samples: points of lamps shared by pixels, a Sobol sequence for each pixel, plain random
numbers, and Cycles; direct light on two scenes with wide lamps."""

from __future__ import annotations

import numpy as np

import raytracer
from tests.benchmarks.noise import measure_noise
from tests.benchmarks.pictures import CYCLES, fit_power, open_scene, render_repeatedly

SCENES = ("penumbra", "cornell_box")
SAMPLES = (1, 4, 16, 64)
SIZE = 120, 80
# The slopes belong to the samples from here on; the first ones show where they start from.
FIRST_FITTED = 4
REPEATS = 2
SHARED, OWN, RANDOM = "shared points (2x2)", "own points", "random"


def measure_convergence(progress):
    """Return a row for every scene, way of sampling and number of samples; `slope` is that of the whole curve."""
    rows = []
    for name in progress(SCENES, "convergence"):
        with open_scene(name, size=SIZE) as (scene, view_layer):
            extracted = extract(view_layer)
            curves = {
                SHARED: [render_ours(extracted, samples, 2) for samples in SAMPLES],
                OWN: [render_ours(extracted, samples, 0) for samples in SAMPLES],
                RANDOM: render_random(extracted),
                CYCLES: [render_repeatedly(scene, view_layer, CYCLES, samples).error for samples in SAMPLES],
            }
        for sampling, errors in curves.items():
            fitted = [k for k, samples in enumerate(SAMPLES) if samples >= FIRST_FITTED]
            slope = -fit_power([SAMPLES[k] for k in fitted], [errors[k] for k in fitted])[1]
            rows += [
                {"scene": name, "sampling": sampling, "samples": samples, "error": error, "slope": slope}
                for samples, error in zip(SAMPLES, errors, strict=True)
            ]
    return rows


def extract(view_layer):
    """Return (raytracer.Scene, Caster) of an open Blender scene."""
    from addon.extract.scene import extract_scene

    view_layer.update()
    extracted = extract_scene(view_layer.depsgraph).scene
    return extracted, raytracer.build(extracted)


def render_ours(extracted, samples, interleaving, seed=0):
    """Return the error of renders whose pixels share points of lamps in squares of a side `interleaving`; 0: none."""
    pictures = [
        render_picture(extracted, samples, interleaving, seed=seed + repeat)[..., :3] for repeat in range(REPEATS)
    ]
    return measure_noise(pictures)


def render_picture(extracted, samples, interleaving, seed):
    """Return Combined (h, w, 4), sampled through a box filter."""
    scene, caster = extracted
    settings = {"pixel_filter": "box", "seed": seed, "max_bounces": 0, "interleaving": interleaving}
    return raytracer.render(scene, *SIZE, samples, caster=caster, **settings)["Combined"]


def render_random(extracted):
    """Return the errors of plain random sampling: means of independent pictures of one sample each."""
    count = SAMPLES[-1]
    pictures = [render_picture(extracted, 1, 0, seed=1000 + seed)[..., :3] for seed in range(2 * count)]
    halves = np.stack([pictures[:count], pictures[count:]])
    return [measure_noise(halves[:, :samples].mean(axis=1, dtype=np.float64)) for samples in SAMPLES]
