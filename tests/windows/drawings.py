"""Press F12 on a scene with a Grease Pencil stroke in front of it: Blender draws it over the picture itself."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

sys.path.insert(0, str(Path(__file__).parent))
import stage

SIZE = (320, 200)

stage.register_addon()


def add_drawing() -> float:
    """A stroke across the picture, in front of all else."""
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = *SIZE, 100
    scene.reference_raytracer.samples = 4
    with stage.within(stage.find_area("VIEW_3D")):
        bpy.ops.object.grease_pencil_add(type="STROKE")
    drawing = bpy.context.object
    camera = scene.camera
    drawing.matrix_world = camera.matrix_world
    drawing.location = camera.matrix_world.translation + camera.matrix_world.to_quaternion() @ Vector((0, 0, -1.5))
    drawing.scale = (0.4, 0.4, 0.4)
    stage.record["drawing"] = drawing.type
    bpy.context.preferences.view.render_display_type = "AREA"
    return 1.0


def look_at_line() -> None:
    """Note how dark the darkest row of the picture is; the stroke runs across."""
    path = stage.folder / "render.png"
    bpy.data.images["Render Result"].save_render(str(path))
    width, height = SIZE
    pixels = np.array(bpy.data.images.load(str(path)).pixels[:]).reshape(height, width, 4)
    stage.record["darkest_row"] = float(pixels[..., :3].max(axis=2).mean(axis=1).min())


def steps() -> Iterator[stage.Step]:
    """Yield all steps."""
    yield from (add_drawing, stage.press_f12)
    yield from stage.wait_for()
    yield stage.take_picture("done")
    yield look_at_line


stage.play(steps())
