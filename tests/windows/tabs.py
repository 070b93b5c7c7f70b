"""Every tab of the properties editor with all panels open, after a render with warnings; then disable and enable."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import stage

TIMES = 10
# Built-in panels that are closed at first.
CLOSED = ("DATA_PT_camera_dof", "DATA_PT_camera_dof_aperture", "OBJECT_PT_visibility")


def open_panels() -> None:
    """Let panels start open: the panels' state of a new area comes from there."""
    stage.import_addon()
    from addon import panels
    from addon.compare import window

    for panel in (*panels.CLASSES, *window.panels.CLASSES):
        if hasattr(panel, "bl_options") and issubclass(panel, bpy.types.Panel):
            panel.bl_options = set(panel.bl_options) - {"DEFAULT_CLOSED"}
    for name in CLOSED:
        panel = getattr(bpy.types, name)
        bpy.utils.unregister_class(panel)
        panel.bl_options = set()
        bpy.utils.register_class(panel)


open_panels()
stage.register_addon()


def prepare() -> float:
    """Render something that the engine warns of; columns of properties editors."""
    scene = bpy.context.scene
    scene.render.engine = "REFERENCE_RAYTRACER"
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 48, 32, 100
    scene.reference_raytracer.samples = 1
    scene.render.use_motion_blur = True
    bpy.ops.mesh.primitive_plane_add()
    plane, material = bpy.context.object, bpy.data.materials.new("Nothing")
    plane.name = "Plane"
    plane.data.materials.append(material)
    material.node_tree.nodes.clear()
    bpy.ops.render.render()
    return 1.0


def split_widest() -> None:
    """Split the widest 3D view in two."""
    area = max((one for one in stage.find_window().screen.areas if one.type == "VIEW_3D"), key=lambda one: one.width)
    with stage.within(area):
        bpy.ops.screen.area_split(direction="VERTICAL", factor=0.5)


def make_columns() -> float:
    """Turn the 3D views to properties editors."""
    for area in [one for one in stage.find_window().screen.areas if one.type == "VIEW_3D"]:
        area.type = "PROPERTIES"
    return 1.0


def show(name: str, *tabs: str) -> tuple[stage.Step, stage.Step]:
    """Return two steps: make an object active, and, once that is drawn, show tabs, one a column."""

    def activate() -> None:
        bpy.context.view_layer.objects.active = bpy.data.objects[name]

    def choose_tabs() -> float:
        areas = [area for area in stage.find_window().screen.areas if area.type == "PROPERTIES" and area.height > 500]
        for area, tab in zip(sorted(areas, key=lambda one: one.x), tabs, strict=False):
            area.spaces.active.context = tab
            area.tag_redraw()
        return 1.5

    return activate, choose_tabs


def click_warning() -> None:
    """Select what the first warning that names an object names."""
    from addon.panels.last_render import list_warnings

    warnings = list_warnings(bpy.context.scene)
    stage.record["warnings"] = [[warning.object, warning.material, warning.text] for warning in warnings]
    with stage.within(stage.find_area("PROPERTIES")):
        bpy.ops.raytracer.select_warned(object=next(warning.object for warning in warnings if warning.object))
    stage.record["selected"] = [thing.name for thing in bpy.context.selected_objects]


def disable() -> None:
    """Take the add-on out; the scene's engine is another one then."""
    import addon

    addon.unregister()
    stage.record.setdefault("engines", []).append(bpy.context.scene.render.engine)


def fold_settings() -> None:
    """Let the panels of settings start closed, so that results are seen without scrolling."""
    from addon.panels import render

    for panel in render.CLASSES:
        panel.bl_options = {"DEFAULT_CLOSED"}


def enable() -> None:
    """Bring it back."""
    import addon

    addon.register()
    bpy.context.scene.render.engine = "REFERENCE_RAYTRACER"


def record_types() -> None:
    """What is registered; the same after ten times."""
    kinds = sorted(name for name in dir(bpy.types) if "RAYTRACER" in name.upper())
    joined = sum(
        "REFERENCE_RAYTRACER" in getattr(panel, "COMPAT_ENGINES", ()) for panel in list_panels(bpy.types.Panel)
    )
    stage.record.setdefault("types", []).append([kinds, joined, len(bpy.app.handlers.load_post)])


def list_panels(kind: type) -> list[type]:
    """Return all panels."""
    return [one for child in kind.__subclasses__() for one in (child, *list_panels(child))]


stage.play(
    [
        *(prepare, split_widest, split_widest, split_widest, make_columns),
        *(*show("Camera", "RENDER", "OUTPUT", "VIEW_LAYER", "WORLD"), stage.take_picture("scene")),
        *(*show("Camera", "OBJECT", "DATA"), stage.take_picture("camera"), click_warning),
        *(*show("Window", "OBJECT", "DATA", "SCENE"), stage.take_picture("light")),
        *(*show("Glass ball", "OBJECT", "DATA", "MATERIAL"), stage.take_picture("mesh")),
        record_types,
        *(disable, fold_settings, enable) * TIMES,
        *(
            record_types,
            lambda: bpy.ops.render.render() and 1.0,
            *show("Glass ball", "MATERIAL", "DATA", "RENDER"),
            stage.take_picture("again"),
        ),
    ]
)
