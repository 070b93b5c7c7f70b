"""The render tab's Denoise and Bake, a bake by its button, Freestyle and stereo renders, World > Settings."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import stage

TEXTURE = 64
SIZE = (240, 150)


def open_panels() -> None:
    """Let panels start open: the panels' state of a new area comes from there."""
    stage.import_addon()
    from addon import panels

    shown = (panels.render.RAYTRACER_RENDER_PT_denoise, *panels.bake.CLASSES, *panels.scene_data.CLASSES)
    for panel in panels.CLASSES:
        if issubclass(panel, bpy.types.Panel) and not hasattr(panel, "bl_parent_id"):
            panel.bl_options = {"DEFAULT_CLOSED"}
    for panel in (panels.render.RAYTRACER_RENDER_PT_sampling, *shown):
        panel.bl_options = set()


open_panels()
stage.register_addon()


def prepare() -> float:
    """The render tab beside an image editor; a small picture."""
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = *SIZE, 100
    scene.reference_raytracer.samples = 2
    bpy.context.preferences.view.render_display_type = "AREA"
    view = stage.find_area("VIEW_3D")
    with stage.within(view):
        bpy.ops.screen.area_split(direction="VERTICAL", factor=0.5)
    right = max((area for area in stage.find_window().screen.areas if area.type == "VIEW_3D"), key=lambda area: area.x)
    right.type = "PROPERTIES"
    right.spaces.active.context = "RENDER"
    from addon.versions import has_denoiser

    stage.record["has_denoiser"] = has_denoiser()
    return 1.0


def make_target() -> None:
    """Give the ball a texture to bake into."""
    thing = bpy.data.objects["Glass ball"]
    material = bpy.data.materials.new("Baked")
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    thing.data.materials.clear()
    thing.data.materials.append(material)
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = bpy.data.images.new("Bake", TEXTURE, TEXTURE)
    material.node_tree.nodes.active = node
    for other in bpy.context.view_layer.objects:
        other.select_set(other == thing)
    bpy.context.view_layer.objects.active = thing
    with stage.within(stage.find_area("VIEW_3D")):
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.uv.smart_project(island_margin=0.02)
        bpy.ops.object.mode_set(mode="OBJECT")


def start_bake() -> float:
    """Bake while the window stays alive, as the button does."""
    bpy.context.scene.reference_raytracer.bake_type = "COMBINED"
    with stage.within(stage.find_area("VIEW_3D")):
        stage.record["bake"] = list(bpy.ops.object.bake("INVOKE_DEFAULT", type="COMBINED", margin=2))
    return 1.0


def show_image(name: str) -> stage.Step:
    """Return a step that shows an image in place of the 3D view, and writes down how bright it is."""

    def step() -> float:
        areas = [area for area in stage.find_window().screen.areas if area.type in ("VIEW_3D", "IMAGE_EDITOR")]
        area = max(areas, key=lambda area: area.height)
        area.type = "IMAGE_EDITOR"
        area.spaces.active.image = image = bpy.data.images[name]
        if image.has_data and len(image.pixels):
            pixels = np.empty(len(image.pixels), np.float32)
            image.pixels.foreach_get(pixels)
            stage.record[f"mean_{name}"] = float(pixels.reshape(-1, 4)[:, :3].mean())
        return 1.0

    return step


def find_picture() -> Any:
    """Return the largest image editor."""
    areas = [area for area in stage.find_window().screen.areas if area.type == "IMAGE_EDITOR"]
    return max(areas, key=lambda area: area.height)


def fit() -> float:
    """Fit the image in its editor."""
    with stage.within(find_picture()):
        bpy.ops.image.view_all(fit_view=True)
    return 1.0


def draw_lines() -> None:
    """Switch Freestyle on, and render."""
    scene = bpy.context.scene
    scene.render.use_freestyle = True
    for layer in scene.view_layers:
        layer.use_freestyle = True
        settings = layer.freestyle_settings
        lines = settings.linesets[0] if settings.linesets else settings.linesets.new("Lines")
        lines.linestyle = lines.linestyle or bpy.data.linestyles.new("Lines")
        stage.record["linestyles"] = len(bpy.data.linestyles)
    stage.press_f12()


def use_two_eyes() -> None:
    """Switch Freestyle off and stereo on, and render."""
    scene = bpy.context.scene
    scene.render.use_freestyle = False
    scene.render.use_multiview = True
    scene.camera.data.stereo.convergence_distance = 2.0
    stage.press_f12()


def show_stereo() -> float:
    """Show both eyes side by side: anaglyph."""
    space = find_picture().spaces.active
    space.show_stereo_3d = True
    stage.find_window().stereo_3d_display.display_mode = "ANAGLYPH"
    from addon.engine.statistics import last_render

    taken = last_render(bpy.context.scene)
    stage.record["warnings"] = [str(warning) for warning in taken.warnings]
    return 1.0


def show_world() -> float:
    """The world's tab."""
    for area in stage.find_window().screen.areas:
        if area.type == "PROPERTIES" and area.height > 500:
            area.spaces.active.context = "WORLD"
    return 1.0


def steps() -> Iterator[stage.Step]:
    """Yield all steps."""
    yield from (prepare, stage.take_picture("denoise"))
    yield from (make_target, start_bake)
    yield from stage.wait_for("OBJECT_BAKE")
    yield from (show_image("Bake"), fit, stage.take_picture("bake"))
    yield draw_lines
    yield from stage.wait_for()
    yield from (show_image("Render Result"), fit, stage.take_picture("freestyle"))
    yield use_two_eyes
    yield from stage.wait_for()
    yield from (show_image("Render Result"), show_stereo, fit, stage.take_picture("stereo"))
    yield from (show_world, stage.take_picture("world"))


stage.play(steps())
