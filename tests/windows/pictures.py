"""The README's pictures of the window: ray inspector, error map, panel."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import bpy
from mathutils import Euler

sys.path.insert(0, str(Path(__file__).parent))
import stage

WIDTH, HEIGHT = 288, 192
# A pixel that shows the goblet, and the row of its ray whose lamp is blocked.
PIXEL = (200, 42)
ROW = 1


def open_results() -> None:
    """Let the panels of results start open, and those of settings closed."""
    stage.import_addon()
    from addon import panels
    from addon.compare import window

    for panel in panels.render.CLASSES:
        if panel.__name__ != "RAYTRACER_RENDER_PT_sampling":
            panel.bl_options = {"DEFAULT_CLOSED"}
    window.panels.RAYTRACER_RENDER_PT_compare.bl_options = set()


open_results()
stage.register_addon()


def prepare() -> float:
    """Render; a large 3D view, an image editor, the render tab."""
    scene = bpy.context.scene
    scene.render.engine = "REFERENCE_RAYTRACER"
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = WIDTH, HEIGHT, 100
    scene.reference_raytracer.samples = 2
    smoke = bpy.data.objects.new("Smoke", bpy.data.volumes.new("Smoke"))  # something to warn of
    scene.collection.objects.link(smoke)
    bpy.ops.render.render()
    view = stage.find_area("VIEW_3D").spaces.active
    view.show_gizmo = view.show_region_toolbar = view.overlay.show_floor = view.overlay.show_text = False
    view.overlay.show_extras = view.overlay.show_cursor = False
    view.show_region_header = view.show_region_tool_header = False
    view.overlay.show_axis_x = view.overlay.show_axis_y = view.overlay.show_relationship_lines = False
    view.region_3d.view_rotation = Euler((1.25, 0.0, 0.9)).to_quaternion()
    view.region_3d.view_location, view.region_3d.view_distance = (0.35, -0.3, 0.35), 1.9
    state = bpy.context.window_manager.reference_raytracer_comparison
    state.width, state.samples, state.rays = 144, 32, 4096
    return 1.0


def inspect() -> float:
    """Show the rays of a pixel."""
    with stage.within(stage.find_area("VIEW_3D")):
        bpy.ops.raytracer.inspect_pixel(x=PIXEL[0], y=PIXEL[1])
        bpy.context.window_manager.reference_raytracer.ray_index = ROW
        bpy.ops.raytracer.judge_ray()
    return 1.0


def compare() -> float:
    """Compare with Cycles, and wait."""
    with stage.within(stage.find_area("PROPERTIES")):
        state = bpy.context.window_manager.reference_raytracer_comparison
        bpy.ops.raytracer.compare_cycles("EXEC_DEFAULT", width=state.width, samples=state.samples)
    return 1.0


def split() -> float:
    """Two areas in place of the 3D view."""
    with stage.within(stage.find_area("VIEW_3D")):
        bpy.ops.screen.area_split(direction="VERTICAL", factor=0.7)
    return 1.0


def show_map() -> float:
    """Show the error map, and the render tab beside it."""
    left, right = sorted(
        (area for area in stage.find_window().screen.areas if area.type == "VIEW_3D"), key=lambda a: a.x
    )
    right.type, left.type = "PROPERTIES", "IMAGE_EDITOR"
    left.spaces.active.image = bpy.data.images["Raytracer Difference"]
    return 1.0


def fit_map() -> float:
    """Fit the map, show the tab."""
    image = stage.find_area("IMAGE_EDITOR")
    with stage.within(image):
        bpy.ops.image.view_all(fit_view=True)
    for area in stage.find_window().screen.areas:
        if area.type == "PROPERTIES":
            area.spaces.active.context = "RENDER"
    return 1.0


def steps() -> Iterator[stage.Step]:
    """Yield all steps."""
    yield from (prepare, inspect)
    yield from stage.show_tab("VIEW_3D", "Ray")
    yield stage.take_picture("ray_inspector", "VIEW_3D")
    yield from (compare, split, show_map, fit_map, stage.take_picture("comparison"))


stage.play(steps())
