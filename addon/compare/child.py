"""Run a comparison in a Blender process of its own: the user's scene, engine and result stay as they are.

    blender -b -P child.py -- JOB.json        or        python child.py JOB.json

JOB.json holds a Job (see `compare.window.job`). The outcome comes back as files in its folder: progress.txt while it
runs, outcome.json and heat.npy at the end, error.txt where it fails. This file runs as a script, outside of its
package.
"""

from __future__ import annotations

import json
import os
import sys
import traceback
from importlib import import_module
from pathlib import Path
from typing import Any


def main(path: str) -> int:
    """Run the job in a file; return the exit code."""
    job = json.loads(Path(path).read_text(encoding="utf-8"))
    folder = Path(job["folder"])
    # Python looks for modules beside a script first, where `cycles` would stand before the package of Blender's engine.
    sys.path[:] = [entry for entry in sys.path if Path(entry).resolve() != Path(__file__).resolve().parent]
    try:
        import bpy  # (before the paths: those of the bpy module hold a package of that name for itself)

        sys.path.insert(0, job["root"])
        sys.path += [entry for entry in job["paths"] if entry not in sys.path]
        import_module("raytracer.processes.child").end_with_parent()
        outcome = run(job, folder)
        import numpy as np

        blocked = bpy.app.autoexec_fail_message if bpy.app.autoexec_fail else ""
        np.save(folder / "heat.npy", outcome.heat)
        (folder / "outcome.json").write_text(json.dumps({**outcome.as_plain(), "blocked": blocked}), encoding="utf-8")
    except Exception as error:
        traceback.print_exc()
        (folder / "error.txt").write_text(str(error) or type(error).__name__, encoding="utf-8")
        return 1
    return 0


def run(job: dict[str, Any], folder: Path) -> Any:
    """Open the file and compare; return the Outcome."""
    import bpy

    package = import_module(job["package"])
    package.register()
    bpy.ops.wm.open_mainfile(filepath=job["blend"], load_ui=False, use_scripts=job["scripts"])
    scene = bpy.data.scenes[job["scene"]]
    view_layer = scene.view_layers[job["view_layer"]]
    frame, subframe = job["frame"]
    scene.frame_set(frame, subframe=subframe)
    results = import_module(f"{job['package']}.compare.results")
    size = job["width"], job["height"]
    if job["kind"] == "cycles":
        return compare_pictures(job, scene, view_layer, size, results, folder)
    module = import_module(f"{job['package']}.compare.ray_cast.comparison")
    with bpy.context.temp_override(scene=scene, view_layer=view_layer):
        depsgraph = bpy.context.evaluated_depsgraph_get()
        comparison, sides = module.compare_with_ray_cast(scene, depsgraph, *size, job["samples"])
    return results.make_ray_cast_outcome(comparison, *size, sides.list_names())


def compare_pictures(
    job: dict[str, Any], scene: Any, view_layer: Any, size: tuple[int, int], results: Any, folder: Path
) -> Any:
    """Compare with Cycles; tell the progress by the renders that are done."""
    import bpy

    module = import_module(f"{job['package']}.compare.cycles.comparison")
    total = module.FIRST_RENDERS
    done = 0

    def count(*_: Any) -> None:
        nonlocal done
        done += 1
        (folder / "progress.new").write_text(str(min(done / total, 1.0)), encoding="utf-8")
        os.replace(folder / "progress.new", folder / "progress.txt")

    def name(pixels: list[tuple[int, int]]) -> Any:
        with bpy.context.temp_override(scene=scene, view_layer=view_layer):
            return results.name_objects(bpy.context.evaluated_depsgraph_get(), pixels, *size)

    bpy.app.handlers.render_complete.append(count)
    return results.make_cycles_outcome(module.compare_with_cycles(scene, view_layer, *size, job["samples"]), name)


if __name__ == "__main__":
    code = main(sys.argv[-1])
    sys.stdout.flush()
    os._exit(code)  # Blender would end with 0, and some versions crash while a render engine is registered
