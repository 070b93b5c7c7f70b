"""Render, inspect a pixel that shows glass, look at its rays and at the tab "Ray"; pick by mouse; undo; load a file."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import stage

stage.register_addon()
WIDTH, HEIGHT = 300, 200


def prepare() -> float:
    """Render; an image editor with the result beside a 3D view."""
    scene = bpy.context.scene
    scene.render.engine = "REFERENCE_RAYTRACER"
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = WIDTH, HEIGHT, 100
    scene.reference_raytracer.samples = 4
    bpy.ops.render.render()
    with stage.within(stage.find_area("VIEW_3D")):
        bpy.ops.screen.area_split(direction="VERTICAL", factor=0.4)
    image = stage.find_area("VIEW_3D", 1)
    image.type = "IMAGE_EDITOR"
    image.spaces.active.image = bpy.data.images["Render Result"]
    return 1.0


def look_closer() -> float:
    """Fit the picture, and turn the 3D view to the middle of the scene."""
    with stage.within(stage.find_area("IMAGE_EDITOR")):
        bpy.ops.image.view_all(fit_view=True)
    view = stage.find_area("VIEW_3D").spaces.active
    view.region_3d.view_location = (0.1, -0.8, 0.3)
    view.region_3d.view_distance = 3.5
    return 1.0


def inspect() -> None:
    """Inspect the pixel in which the middle of the glass ball lies."""
    with stage.within(stage.find_area("IMAGE_EDITOR")):
        stage.record["result"] = list(bpy.ops.raytracer.inspect_pixel(x=116, y=42))
    rows = bpy.context.window_manager.reference_raytracer.rays
    stage.record["rays"] = [f"{row.depth} {row.name}" for row in rows]
    bpy.context.window_manager.reference_raytracer.ray_index = 4


def start_picking() -> None:
    """Start the operator as the button does."""
    area = stage.find_area("VIEW_3D")
    with stage.within(area):
        stage.record["picking"] = list(bpy.ops.raytracer.inspect_pixel("INVOKE_DEFAULT"))


def press_escape() -> None:
    """Esc ends picking and changes nothing."""
    stage.press("ESC", 800, 500)


def check_escape() -> None:
    """What was inspected is still there."""
    stage.record["after_escape"] = len(bpy.context.window_manager.reference_raytracer.rays)
    stage.record["modal_after_escape"] = [operator.bl_idname for operator in stage.find_window().modal_operators]


def click_picture() -> None:
    """Click the middle of the mirror in the picture."""
    area = stage.find_area("IMAGE_EDITOR")
    region = stage.find_region(area)
    x, y = region.view2d.view_to_region(0.735, 0.62, clip=False)
    stage.press("LEFTMOUSE", region.x + x, region.y + y)


def record_rays(name: str) -> stage.Step:
    """Return a step that writes down the list of rays."""

    def step() -> None:
        rows = bpy.context.window_manager.reference_raytracer.rays
        stage.record[name] = [f"{row.depth} {row.name}" for row in rows]

    return step


def click_view() -> None:
    """Click the middle of the 3D view's free part."""
    region = stage.find_region(stage.find_area("VIEW_3D"))
    stage.press("LEFTMOUSE", region.x + region.width // 3, region.y + region.height // 3)


def undo() -> None:
    """Move an object, and undo."""
    with stage.within(stage.find_area("VIEW_3D")):
        bpy.ops.ed.undo_push(message="before")
        bpy.data.objects["Glass ball"].location.x += 1
        bpy.ops.ed.undo_push(message="moved")
        bpy.ops.ed.undo()


def load_file() -> None:
    """A new file clears rays and lines."""
    from addon.inspector import drawing, session

    bpy.ops.wm.read_homefile(use_factory_startup=True)
    stage.record["after_load"] = [session.find_inspected() is None, not drawing.is_drawing()]


stage.play(
    [
        *(prepare, look_closer, inspect, *stage.show_tab("VIEW_3D", "Ray"), stage.take_picture("rays")),
        *(start_picking, press_escape, check_escape),
        *(start_picking, click_picture, record_rays("picked_in_picture"), stage.take_picture("mirror")),
        *(start_picking, click_view, record_rays("picked_in_view"), stage.take_picture("view")),
        *(undo, stage.take_picture("undone"), record_rays("after_undo"), load_file),
    ]
)
