"""Press F12: the first look in large pixels, the stages, and what Last Render says without a click."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import stage

# A picture of which one sweep takes a few seconds.
SIZE = (480, 300)

stage.register_addon()


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


def steps() -> Iterator[stage.Step]:
    """Yield all steps."""
    yield stage.take_picture("opened")
    yield from (prepare, stage.press_f12, lambda: 3.0, stage.take_picture("first_look"))
    yield stage.take_picture("later")
    yield from stage.wait_for()
    yield lambda: 2.0
    yield stage.take_picture("done")


stage.play(steps())
