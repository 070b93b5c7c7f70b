"""Press F12: the first look in large pixels, the stages, and what Last Render says without a click."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import stage

WAIT_SECONDS = 240.0
# A picture of which one sweep takes a few seconds.
SIZE = (480, 300)

stage.register_addon()

_begun = 0.0


def prepare() -> float:
    """The render tab beside an image editor, in place of the 3D view."""
    scene = bpy.context.scene
    stage.record["engine"] = scene.render.engine
    view = stage.find_area("VIEW_3D")
    stage.record["view"] = view.spaces.active.region_3d.view_perspective
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = *SIZE, 100
    scene.reference_raytracer.samples = 1
    bpy.context.preferences.view.render_display_type = "AREA"
    stage.find_area("PROPERTIES").spaces.active.context = "RENDER"
    return 1.0


def press_f12() -> float:
    """Render as a user does."""
    global _begun
    with stage.within(stage.find_area("VIEW_3D")):
        bpy.ops.render.render("INVOKE_DEFAULT")
    _begun = time.monotonic()
    return 3.0


def wait() -> Iterator[stage.Step]:
    """Yield steps until the render is done."""
    while bpy.app.is_job_running("RENDER"):
        if time.monotonic() > _begun + WAIT_SECONDS:
            raise TimeoutError("the render did not end")
        yield lambda: None
    stage.record["seconds"] = time.monotonic() - _begun


def steps() -> Iterator[stage.Step]:
    """Yield all steps."""
    yield stage.take_picture("opened")
    yield from (prepare, press_f12, stage.take_picture("first_look"))
    yield stage.take_picture("later")
    yield from wait()
    yield lambda: 2.0
    yield stage.take_picture("done")


stage.play(steps())
