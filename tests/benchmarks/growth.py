"""What grows with a scene, a picture or the number of workers: `python -m tests.benchmarks.growth FOLDER`.

Writes FOLDER/growth.md: what each took before films were parts, and takes now. The numbers of then stay here; they
are of a quiet machine, and times are the processor's.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

import raytracer
from raytracer.film.film import Film
from raytracer.film.film_picture import save_picture
from raytracer.film.sums import DEVIATIONS, DIFFERENCE
from raytracer.integrator.settings import Settings
from raytracer.processes.python import ONE_THREAD
from raytracer.processes.workers import Workers
from raytracer.rendering.block_plan import BlockPlan
from raytracer.rendering.blocks import FrameWindow, hand_out
from raytracer.rendering.ending import Ending
from raytracer.rendering.render import accumulate, plan_blocks
from tests.benchmarks.sender import Sender
from tests.benchmarks.timing import describe_machine
from tests.large_scenes import make_crowd, make_terrain

COUNT = 1_000_000
RAY = ((0.1, 0.2, 900.0), (0.0, 0.0, -1.0))
TEN_PASSES = (
    *("Combined", "Depth", "Normal", "Position", "UV", "Diffuse Direct", "Diffuse Indirect"),
    *("Glossy Direct", "Glossy Indirect", "Emission"),
)
GREY = raytracer.Material((raytracer.Closure("diffuse"),))
READ_MESHES = """
import time, bpy, addon
from addon.extract.scene import extract_scene
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
for number in range(10000):
    mesh = bpy.data.meshes.new(str(number))
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1)], [], [(0, 1, 2, 3), (0, 1, 4), (1, 2, 4)])
    scene.collection.objects.link(bpy.data.objects.new(str(number), mesh))
scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
scene.collection.objects.link(scene.camera)
depsgraph = bpy.context.evaluated_depsgraph_get()
started = time.process_time()
extract_scene(depsgraph)
print("seconds", time.process_time() - started)
"""
RENDER_FRAMES = """
import statistics, time, bpy, addon
bpy.ops.wm.open_mainfile(filepath="blend_scenes/cornell_box.blend")
addon.register()
scene = bpy.context.scene
scene.render.engine = "REFERENCE_RAYTRACER"
scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 64, 36, 100
scene.reference_raytracer.samples = 1
scene.frame_start, scene.frame_end, scene.render.filepath = 1, 12, {path!r}
times = []
bpy.app.handlers.render_write.append(lambda *_: times.append(time.process_time()))
bpy.ops.render.render(animation=True)
print("seconds", statistics.median(after - before for before, after in zip(times[2:], times[3:])))
"""


def show_build(scene: raytracer.Scene) -> str:
    """Return what the tree for a single ray takes: seconds, and bytes for each of COUNT with the scene's own."""
    started = time.process_time()
    raytracer.build(scene).closest_hit(*RAY)
    seconds = time.process_time() - started
    tracemalloc.start()
    caster = raytracer.build(scene)
    caster.closest_hit(*RAY)
    kept, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    arrays = [scene.meshes[0].positions, scene.meshes[0].triangles]
    own = sum(array.nbytes for array in arrays) + (scene.instances.world_from_object.nbytes if scene.instances else 0)
    return f"{seconds:.1f} s; {(kept + own) / COUNT:.0f} bytes each, {(peak + own) / COUNT:.0f} at most"


def show_start() -> str:
    """Return what two workers take to get a caster that their parent has built: seconds, and memory of one's own."""
    caster = raytracer.build(make_terrain(COUNT))
    caster.closest_hit(*RAY)
    with Workers(2) as workers:
        workers.load(partial, int)  # once this is there, Python and NumPy are
        started = time.perf_counter()
        workers.load(partial, raytracer.Caster.closest_hit, caster, *RAY)
        list(workers.run([0.0, 0.0]))
        seconds = time.perf_counter() - started
        rollup = Path(f"/proc/{workers.process_ids[0]}/smaps_rollup")
        own = ""
        if rollup.exists():
            lines = rollup.read_text(encoding="utf-8").splitlines()
            own = f", {sum(int(line.split()[1]) for line in lines if line.startswith('Private_')) / 1024:.0f} MB"
    return f"{seconds:.1f} s{own}"


def show_shares() -> str:
    """Return how many of 40 workers have something to do in a picture of 512 x 512 pixels and 4 samples."""
    plan = BlockPlan(512 * 512, 4, 1 << 18, workers=40)
    return f"{min(40, sum(1 for _ in plan))} of 40"


def show_adding() -> str:
    """Return what the parent of forty workers takes for a sample, of Combined and with four passes more, from where on
    they add up what they trace; and how many could be kept busy whose samples take a microsecond."""
    window = FrameWindow(raytracer.Camera(np.eye(4)), 4096, 2048, 0, 0, 4096, 2048)
    shown = []
    with Workers(1) as workers:
        for passes in (("Combined",), ("Combined", "Normal", "Diffuse Color", "Diffuse Direct", "Diffuse Indirect")):
            settings = Settings(samples=48, passes=passes, workers=40)
            film = Film(window.width, window.height, passes, samples=16)
            film.sums.hold((DIFFERENCE, DEVIATIONS))
            for array in film.arrays.values():
                array[...] = 8  # memory that earlier samples have been written to
            film.sums.counts.put(slice(None), np.full((window.width * window.height, 2), 8, dtype=np.int32))
            workers.load(Sender, passes)
            plan = plan_blocks(raytracer.Scene(), film, window, settings, None)
            started, first = time.process_time(), film.samples
            results = workers.run(hand_out(film, plan))
            accumulate(film, plan, results, Ending(settings, plan.sweeps, started, first), None, None)
            share = (time.process_time() - started) / (window.width * window.height * (film.samples - first)) * 1e9
            shown.append(f"{share:.0f} ns: {1000 / share:.0f} workers")
    return "; ".join(shown)


def show_passes() -> str:
    """Return what writing ten passes takes at most, over their sums."""
    film = Film(1024, 512, TEN_PASSES, samples=4)
    film.sums.hold((DIFFERENCE, DEVIATIONS))
    sums = sum(array.nbytes for array in film.arrays.values())
    with tempfile.TemporaryDirectory() as folder:
        tracemalloc.start()
        save_picture(film, Path(folder) / "ten.exr")
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    return f"{(sums + peak) / sums:.2f} times the sums, {(sums + peak) / (1024 * 512) * 7680 * 4320 / 1e9:.1f} GB at 8k"


def run_blender(script: str) -> float:
    """Return the seconds that a script of Blender's Python says: in one thread, for idle threads of the linear algebra
    spin, and would count as processor time."""
    command, environment = [sys.executable, "-W", "ignore", "-c", script], os.environ | ONE_THREAD
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    return float(next(line.split()[1] for line in done.stdout.splitlines() if line.startswith("seconds")))


def show_meshes() -> str:
    return f"{run_blender(READ_MESHES):.1f} s"


def show_frames() -> str:
    with tempfile.TemporaryDirectory() as folder:
        return f"{1000 * run_blender(RENDER_FRAMES.format(path=f'{folder}/')):.0f} ms"


# What grows, what it took, what it should, and how it is measured.
ROWS: tuple[tuple[str, str, str, Callable[[], str]], ...] = (
    ("two workers get a scene of 1M triangles (by the clock)", "1.9 s, 190 MB", "0.4 s, 32 MB", show_start),
    ("workers that a small picture uses", "8 of 40", "all", show_shares),
    (
        "what the parent of 40 workers does for a sample (1 and 5 passes)",
        "some 40 workers",
        "more",
        show_adding,
    ),
    ("ten passes, written", "21 to 23 GB at 8k", "2.2 times the sums", show_passes),
    ("10,000 own meshes, read", "8.2 s", "1.5 s", show_meshes),
    ("a frame of 64 x 36 pixels, Cornell box, 1 sample", "147 ms", "40 ms", show_frames),
    ("1M triangles, first ray", "230 bytes each", "160 bytes each", lambda: show_build(make_terrain(COUNT))),
    (
        "1M instances, first ray",
        "4.8 s; 980 bytes each",
        "2 s; 400 bytes each",
        lambda: show_build(make_crowd(COUNT, 200.0)),
    ),
)


def main(folder: Path) -> None:
    """Measure, and write the table."""
    machine = describe_machine()
    lines = [
        "# What grows",
        "",
        "Generated by `python -m tests.benchmarks.growth tests/report`.",
        "",
        f"- {machine['date']}, {machine['processor']}, {machine['cores']} cores, load {machine['load']:.1f}",
        "- bytes are those of arrays, the scene's own with them",
        "",
        "| what | before | asked | now |",
        "| --- | --- | --- | --- |",
    ]
    for what, before, asked, show in ROWS:
        lines.append(f"| {what} | {before} | {asked} | {show()} |")
        print(lines[-1])
    (folder / "growth.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
