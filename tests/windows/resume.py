"""Esc in the middle of a render with checkpoints, then Render > Resume Render; and a viewport by all workers."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import stage

SIZE = (160, 100)
SAMPLES, VIEWPORT_SAMPLES = 120, 1
WORKERS = 2

stage.register_addon()


def prepare() -> float:
    """The render tab, small pictures, checkpoints beside the pictures."""
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = *SIZE, 100
    settings = scene.reference_raytracer
    settings.samples, settings.viewport_samples, settings.workers = SAMPLES, VIEWPORT_SAMPLES, WORKERS
    settings.use_checkpoints, settings.checkpoint_interval = True, 1
    settings.checkpoint_folder = str(stage.folder)
    bpy.context.preferences.view.render_display_type = "NONE"
    stage.find_area("PROPERTIES").spaces.active.context = "RENDER"
    return 1.0


def can_resume() -> bool:
    """Return whether the menu's item can be clicked."""
    with stage.within(stage.find_area("VIEW_3D")):
        return bool(bpy.ops.raytracer.resume_render.poll())


def start() -> None:
    """Render as a user does."""
    stage.record["could_resume_before"] = can_resume()
    stage.press_f12()


def wait_for_checkpoint() -> Iterator[stage.Step]:
    """Yield steps until there is a checkpoint, and not yet the picture."""
    ends = time.monotonic() + stage.WAIT_SECONDS
    while not list(stage.folder.glob("*.checkpoint.npz")):
        if time.monotonic() > ends or not bpy.app.is_job_running("RENDER"):
            raise TimeoutError("no checkpoint came")
        yield lambda: None


def press_escape() -> float:
    """Press Esc as a keyboard does, in a Blender without --enable-event-simulate: a script's own does not end renders,
    and with that option Blender is deaf to others."""
    subprocess.run(["xdotool", "mousemove", "400", "400", "key", "Escape"], check=True)
    return 1.0


def record_render(name: str) -> stage.Step:
    """Return a step that writes down how far the last render came."""

    def step() -> None:
        from addon.engine.statistics import last_render

        taken = last_render(bpy.context.scene)
        stage.record[name] = [taken.samples, taken.cancelled, can_resume()]

    return step


def open_menu() -> float:
    """Open Blender's Render menu."""
    with stage.within(stage.find_area("VIEW_3D")):
        bpy.ops.wm.call_menu(name="TOPBAR_MT_render")
    return 1.0


def resume() -> float:
    """Choose the menu's item."""
    with stage.within(stage.find_area("VIEW_3D")):
        bpy.ops.raytracer.resume_render("INVOKE_DEFAULT")
    return 1.0


def show_rendered() -> float:
    """Rendered shading, at its full size."""
    stage.find_area("VIEW_3D").spaces.active.shading.type = "RENDERED"
    return 2.0


def find_session() -> Any:
    """Return the session of the region that is drawn."""
    from addon.viewport import viewport

    (shown,) = viewport._viewports
    return shown.session


def wait_for_viewport() -> Iterator[stage.Step]:
    """Yield steps until the viewport has all its samples; note the most processes there are below this one."""
    ends, most = time.monotonic() + stage.WAIT_SECONDS, 0
    while not find_session().status.startswith(f"Sample {VIEWPORT_SAMPLES}/"):
        if time.monotonic() > ends:
            raise TimeoutError(f"the viewport did not finish: {find_session().status}")
        most = max(most, count_processes())
        yield lambda: None
    stage.record["viewport_processes"] = most
    stage.record["viewport_status"] = find_session().status


def count_processes() -> int:
    """Return how many render processes hang below the viewport's own, as the system tells."""
    parents = {}
    for entry in Path("/proc").glob("[0-9]*/stat"):
        try:
            number, rest = entry.read_text(encoding="utf-8", errors="replace").split(" ", 1)
            parents[int(number)] = int(rest.rsplit(")", 1)[1].split()[1])
        except OSError:  # it has ended
            continue
    children = {number for number, parent in parents.items() if parent == os.getpid()}
    return sum(parent in children for parent in parents.values())


def steps() -> Iterator[stage.Step]:
    """Yield all steps."""
    yield from (prepare, start)
    yield from wait_for_checkpoint()
    yield press_escape
    yield from stage.wait_for()
    yield from (record_render("stopped"), open_menu, stage.take_picture("menu"), press_escape, resume)
    yield stage.take_picture("resumed")
    yield from stage.wait_for()
    yield from (record_render("finished"), stage.take_picture("finished"), show_rendered)
    yield from wait_for_viewport()
    yield stage.take_picture("viewport")


stage.play(steps())
