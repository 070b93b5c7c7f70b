"""The time that each engine takes to the same error: ours against Cycles on the CPU, one thread each, the same light.

Error c N^-p and time a + b N are fitted to renders of a few numbers of samples, and solved for the error wanted. The
render call includes reading the scene, building and writing the picture; "persistent" lets the engines keep what they
can from one render to the next; "process" adds what a fresh process takes to start and to open the file.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.benchmarks.pictures import (
    CYCLES,
    HEIGHT,
    OURS,
    SCENES,
    WIDTH,
    fit_line,
    fit_power,
    open_scene,
    render_repeatedly,
)

# A choice of scenes for a quicker report.
SMALL = ("cornell_box", "hard_shadows", "penumbra", "plane_and_spheres", "glass", "still_life", "terrain")
TARGETS = (0.01, 0.003)
SAMPLES = {OURS: (2, 8, 24), CYCLES: (4, 16, 64)}
# Noise that falls more slowly with the number of samples than N^-p sits in a few bright pixels: too few to tell from
# some renders what many more samples would bring. Independent samples have p = 0.5, well spread ones more.
SMALLEST_POWER = 0.4
# Pictures that noise is measured from: a few bright pixels hold most of it where mirrors meet.
REPEATS = 4

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


def measure_equal_error(large, progress):
    """Return a row for every scene and target, with both engines' fits and the ratios of their times.

    `large` takes all files of blend_scenes, which is a minute or two each.
    """
    others = sorted({path.stem for path in SCENES.glob("*.blend")} - set(SMALL)) if large else []
    rows = []
    for name in progress([*SMALL, *others], "equal error"):
        fits = {engine: measure_engine(name, engine) for engine in (OURS, CYCLES)}
        process = {engine: measure_process(name, engine) for engine in (OURS, CYCLES)}
        for target in TARGETS:
            rows.append({"scene": name, "target": target, **compare_times(fits, process, target)})
    return rows


def measure_engine(name, engine):
    """Return the fits of one engine on one scene: error c N^-p, seconds a + b N, the first also without persistence."""
    with open_scene(name) as (scene, view_layer):
        render_repeatedly(scene, view_layer, engine, 1)  # loads what is loaded once
        renders = [render_repeatedly(scene, view_layer, engine, samples, REPEATS) for samples in SAMPLES[engine]]
    samples = [each.samples for each in renders]
    c, p = fit_power(samples, [each.error for each in renders])
    a, b = fit_line(samples, [each.seconds for each in renders])
    with open_scene(name, persistent=False) as (scene, view_layer):
        fresh = render_repeatedly(scene, view_layer, engine, samples[0])
    return {"c": c, "p": p, "a": a, "b": b, "a_fresh": max(fresh.seconds - b * samples[0], 0.0)}


def measure_process(name, engine):
    """Return the seconds of the processor of a whole process that renders one sample."""
    blend = SCENES / f"{name}.blend"
    with tempfile.TemporaryDirectory() as folder:
        picture = str(Path(folder) / "picture.png")
        if engine == OURS:
            options = ["--size", f"{WIDTH}x{HEIGHT}", "--samples", "1"]
            command = ["-m", "addon", "render", str(blend), "-o", picture, *options]
        else:
            command = ["-c", CYCLES_SCRIPT.format(width=WIDTH, height=HEIGHT), str(blend), picture]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, *command], cwd=SCENES.parent, check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def compare_times(fits, process, target):
    """Return the samples and seconds that each engine needs to `target`, and Cycles' times over ours; None for those
    where an engine's fit says nothing."""
    row = {}
    for engine, fit in fits.items():
        samples = max((fit["c"] / target) ** (1.0 / fit["p"]), 1.0)
        start = max(process[engine] - fit["a_fresh"] - fit["b"], 0.0)
        row[engine] = {
            **fit,
            "samples": samples,
            "persistent": fit["a"] + fit["b"] * samples,
            "render": fit["a_fresh"] + fit["b"] * samples,
            "process": start + fit["a_fresh"] + fit["b"] * samples,
        }
    tells = all(fit["p"] >= SMALLEST_POWER for fit in fits.values())
    kinds = ("persistent", "render", "process")
    row["ratios"] = {kind: row[CYCLES][kind] / row[OURS][kind] if tells else None for kind in kinds}
    return row
