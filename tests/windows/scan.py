"""The scanner's tab in the 3D view: settings, the button, the points, undo."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import stage

stage.register_addon()


def prepare() -> None:
    """Look through no camera, at everything; a quick scan around the camera's place."""
    area = stage.find_area("VIEW_3D")
    area.spaces.active.region_3d.view_perspective = "PERSP"
    with stage.within(area):
        bpy.ops.view3d.view_all()
    settings = bpy.context.scene.reference_raytracer_scan
    settings.columns, settings.rows, settings.radius = 400, 48, 0.004
    settings.field, settings.lowest, settings.highest = math.radians(60), math.radians(-25), math.radians(15)


def scan() -> float:
    """Press the button."""
    with stage.within(stage.find_area("VIEW_3D")):
        bpy.ops.ed.undo_push(message="before")  # a timer's operators push none themselves
        stage.record["result"] = sorted(bpy.ops.raytracer.scan("INVOKE_DEFAULT"))
        bpy.ops.ed.undo_push(message="Scan")
        bpy.ops.view3d.view_selected()
    points = bpy.context.view_layer.objects.active
    stage.record["points"] = [points.name, len(points.data.vertices)]
    return 2.0


def undo() -> None:
    """Take it back."""
    with stage.within(stage.find_area("VIEW_3D")):
        bpy.ops.ed.undo()
    stage.record["after_undo"] = "Scan" in bpy.data.objects


stage.play(
    [
        prepare,
        *stage.show_tab("VIEW_3D", "Scan"),
        stage.take_picture("scan_before"),
        scan,
        stage.take_picture("scan_after"),
        undo,
    ]
)
