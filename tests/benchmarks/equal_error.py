"""The time that each engine takes to the same error: ours against Cycles on the CPU, one thread each, the same light.

Every scene is rendered with direct light and with paths, by ours and by Cycles, both also with their adaptive sampling,
with more and more samples, several times each; the engines take turns. Times are compared at the smallest error that
both have reached: nothing is extrapolated. The error is noise; what Cycles' adaptive sampling leaves out by stopping
early is a bias, which it does not show. Run it pinned to one core (`taskset -c 0`): else a thread of Cycles' waits by
spinning, and counts.

References
----------
Blender, intern/cycles/scene/integrator.cpp, Integrator::get_adaptive_sampling: the automatic threshold, 1 / samples,
and the fewest samples, 16 / threshold^0.3: 56 of 64, 85 of 256, so that below some 64 samples nothing is adaptive.
"""

from __future__ import annotations

import resource
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.benchmarks.kept_rows import keep_row, read_rows
from tests.benchmarks.noise import FEWEST_RENDERS, SHARES, compare_seconds, jackknife, leave_one_out, measure_errors
from tests.benchmarks.pictures import CYCLES, HEIGHT, OURS, SCENES, WIDTH, fit_line, fit_power, open_scene, set_samples
from tests.benchmarks.timing import read_processor

# A choice of scenes for a quicker report.
SMALL = ("cornell_box", "hard_shadows", "penumbra", "plane_and_spheres", "glass", "still_life", "terrain", "hdri")
OURS_ADAPTIVE = "raytracer adaptive"
CYCLES_ADAPTIVE = "Cycles adaptive"
CONTENDERS = (OURS, OURS_ADAPTIVE, CYCLES, CYCLES_ADAPTIVE)
# What the table compares: the time of the first over that of the second.
COMPARED = {
    CYCLES: (CYCLES, OURS),
    CYCLES_ADAPTIVE: (CYCLES_ADAPTIVE, OURS),
    "both adaptive": (CYCLES_ADAPTIVE, OURS_ADAPTIVE),
    "ours uniform over adaptive": (OURS, OURS_ADAPTIVE),
}
LIGHTS = {"direct": "DIRECT", "path": "PATH"}
# Samples grow from here, by so many times.
FEWEST, STEP = 4, 4
# The share of the pixels whose part of the noise is told.
FIREFLIES = "without 1%"

CYCLES_SCRIPT = """
import sys, bpy
bpy.ops.wm.open_mainfile(filepath=sys.argv[1], load_ui=False)
scene = bpy.context.scene
scene.render.engine = "CYCLES"
scene.render.threads_mode, scene.render.threads = "FIXED", 1
scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = {width}, {height}, 100
scene.cycles.samples = 1
scene.cycles.use_denoising = False
scene.render.filepath = sys.argv[2]
bpy.ops.render.render(write_still=True)
"""


@dataclass(frozen=True)
class Effort:
    """How much is rendered: pixels, most samples, renders of each number of samples, scenes (none: a choice); and
    `keep`, the file that rows are kept in as they come, and taken from if they are there.

    Raises
    ------
    ValueError
        If that is too little to compare.
    """

    size: tuple[int, int] = (WIDTH, HEIGHT)
    most: int = 256
    renders: int = 8
    scenes: tuple[str, ...] = ()
    keep: Path | None = None

    def __post_init__(self):
        if self.most < FEWEST * STEP:
            raise ValueError(f"samples: expected {FEWEST * STEP} or more, got {self.most}")
        if self.renders < FEWEST_RENDERS:
            raise ValueError(f"renders: expected {FEWEST_RENDERS} or more, got {self.renders}")
        missing = sorted(set(self.scenes) - {path.stem for path in SCENES.glob("*.blend")})
        if missing:
            raise ValueError(f"scenes: no such file in blend_scenes: {', '.join(missing)}")


@dataclass(frozen=True)
class Renders:
    """Renders (k, h, w, 3) of one number of samples, and the median of their seconds."""

    samples: int
    seconds: float
    pictures: np.ndarray


def list_scenes(effort, large):
    """Return the scenes that were asked for; else a choice, and all files of blend_scenes where `large`."""
    others = sorted({path.stem for path in SCENES.glob("*.blend")} - set(SMALL)) if large else []
    return list(effort.scenes) or [*SMALL, *others]


def list_samples(most):
    """Return the numbers of samples that are rendered: 4, 16, 64, 256, ... up to `most`."""
    return [FEWEST * STEP**k for k in range(32) if FEWEST * STEP**k <= most]


def measure_equal_error(effort, large, progress):
    """Return a row for every scene and light: each engine's curve, and Cycles' times over ours."""
    settings = [read_processor(), effort.size, effort.most, effort.renders]
    kept = {(row["scene"], row["light"]): row for row in read_rows(effort.keep, settings)}
    rows = []
    for name in progress(list_scenes(effort, large), "equal error"):
        for light in LIGHTS:
            row = kept.get((name, light))
            if row is None:
                row = measure_row(name, light, effort)
                keep_row(effort.keep, settings, row)
            rows.append(row)
    return rows


def measure_row(name, light, effort):
    """Return the row of one scene and light: seconds of a whole process, the curves, and the ratios."""
    process = {engine: measure_process(name, engine, effort.size) for engine in (OURS, CYCLES)}
    renders = render_scene(name, LIGHTS[light], effort)
    return {"scene": name, "light": light, "process": process, **describe_renders(renders)}


def render_scene(name, integrator, effort):
    """Return contender -> Renders for every number of samples; the contenders take turns."""
    renders = {contender: [] for contender in CONTENDERS}
    with open_scene(name, size=effort.size, integrator=integrator) as (scene, view_layer):
        for contender in CONTENDERS:
            render_once(scene, view_layer, contender, 1, seed=1)  # loads what is loaded once
        for samples in list_samples(effort.most):
            made = {contender: [] for contender in CONTENDERS}
            for seed in range(1, 1 + effort.renders):
                for contender in CONTENDERS:
                    made[contender].append(render_once(scene, view_layer, contender, samples, seed))
            for contender, own in made.items():
                seconds = statistics.median(taken for taken, _ in own)
                renders[contender].append(Renders(samples, seconds, np.stack([picture for _, picture in own])))
    return renders


def render_once(scene, view_layer, contender, samples, seed):
    """Return (seconds of the processor, picture (h, w, 3)) of one render."""
    from addon.compare.cycles import rendering

    set_samples(scene, samples)
    width, height = scene.render.resolution_x, scene.render.resolution_y
    request = rendering.Request(width, height, samples, max_bounces=0, seed=seed)
    engine = rendering.ENGINE if contender in (OURS, OURS_ADAPTIVE) else rendering.CYCLES
    with sample_adaptively(scene, contender, samples):
        started = time.process_time()
        rendered = rendering.render_batches(scene, view_layer, engine, request)
        seconds = time.process_time() - started
    return seconds, rendered.passes["Combined"][0, ..., :3]


def sample_adaptively(scene, contender, samples):
    """Return a context in which adaptive contenders sample as they do by default: Cycles the first ones of `samples`,
    up to all of them."""
    from addon.compare.cycles.rendering import changed

    if contender == OURS_ADAPTIVE:
        return changed(scene.reference_raytracer, use_adaptive_sampling=True)
    if contender != CYCLES_ADAPTIVE:
        return nullcontext()
    whole = {"use_sample_subset": False} if hasattr(scene.cycles, "use_sample_subset") else {}
    return changed(
        scene.cycles, samples=samples, use_adaptive_sampling=True, adaptive_threshold=0.0, adaptive_min_samples=0,
        sample_offset=0, **whole,
    )  # fmt: skip


def describe_renders(renders):
    """Return the curves of all contenders, and the ratios of times in COMPARED, of the renders of one scene."""
    curves = {contender: describe_curve(own) for contender, own in renders.items()}
    lefts = {contender: [leave_one_out(each.pictures) for each in own] for contender, own in renders.items()}
    ratios = {
        title: {name: compare_contenders(curves, lefts, pair, name) for name in SHARES}
        for title, pair in COMPARED.items()
    }
    return {"curves": curves, "ratios": ratios}


def describe_curve(renders):
    """Return errors and seconds of a contender by numbers of samples, their slopes, and what a sample costs.

    slopes : p of error c N^-p over the numbers of samples that were rendered; noise_in_1% : the share of the squared
    error of the last renders that sits in the noisiest hundredth of the pixels
    """
    samples = [each.samples for each in renders]
    seconds = [each.seconds for each in renders]
    measured = [measure_errors(each.pictures) for each in renders]
    errors = {name: [each[name] for each in measured] for name in SHARES}
    start, per_sample = fit_line(samples, seconds)
    last = {name: errors[name][-1] for name in SHARES}
    kept = (1 - SHARES[FIREFLIES]) * last[FIREFLIES] ** 2 / last["all"] ** 2 if last["all"] else 1.0
    pixels = renders[0].pictures[0, ..., 0].size
    return {
        "samples": samples,
        "seconds": seconds,
        "errors": errors,
        "slopes": {name: fit_power(samples, values)[1] if all(values) else None for name, values in errors.items()},
        "start": start,
        "microseconds": 1e6 * per_sample / pixels,
        "noise_in_1%": max(1.0 - kept, 0.0),
    }


def compare_contenders(curves, lefts, pair, name):
    """Return error, ratio of seconds and its standard error (of the logarithm), or None: the first of a pair over the
    second.

    lefts : contender -> for each number of samples the errors without one of the renders
    """
    first, second = ((curves[one]["errors"][name], curves[one]["seconds"]) for one in pair)
    compared = compare_seconds(second, first)
    if compared is None:
        return None
    count = len(lefts[OURS][0][name])
    without = [
        compare_seconds(*(([left[name][k] for left in lefts[one]], curves[one]["seconds"]) for one in pair[::-1]))
        for k in range(count)
    ]
    logarithms = [np.log(each[1]) for each in without if each is not None]
    spread = jackknife(logarithms) if len(logarithms) == count else None
    return {"error": compared[0], "ratio": compared[1], "spread": spread}


def measure_process(name, engine, size):
    """Return the seconds of the processor of a whole process that renders one sample."""
    blend = SCENES / f"{name}.blend"
    width, height = size
    with tempfile.TemporaryDirectory() as folder:
        picture = str(Path(folder) / "picture.png")
        if engine == OURS:
            options = ["--size", f"{width}x{height}", "--samples", "1"]
            command = ["-m", "addon", "render", str(blend), "-o", picture, *options]
        else:
            command = ["-c", CYCLES_SCRIPT.format(width=width, height=height), str(blend), picture]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, *command], cwd=SCENES.parent, check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
