"""The scanner's operator and panel: what a user touches, with Blender's undo."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest

from addon.scanning import panels
from tests.addon.panels.panel_fixtures import RecordingLayout

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]


@pytest.fixture
def room(scene_with_camera: Any) -> Any:
    """A cube of 4 metres around the camera, and quick settings."""
    bpy.ops.mesh.primitive_cube_add(size=4)
    settings = scene_with_camera.reference_raytracer_scan
    settings.columns, settings.rows = 16, 4
    return scene_with_camera


def list_scans() -> list[Any]:
    return [thing for thing in bpy.data.objects if "distance" in getattr(thing.data, "attributes", ())]


def test_the_operator_scans_from_the_camera(room: Any) -> None:
    assert bpy.ops.raytracer.scan() == {"FINISHED"}
    (points,) = list_scans()
    assert len(points.data.vertices) == 64
    assert bpy.context.view_layer.objects.active == points
    assert bpy.context.selected_objects == [points]
    assert points.modifiers  # renders show them


def test_undo_takes_the_points_back(room: Any) -> None:
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.raytracer.scan()
    bpy.ops.ed.undo_push(message="Scan")
    assert list_scans()
    bpy.ops.ed.undo()
    assert not list_scans()
    bpy.ops.ed.redo()
    assert len(list_scans()) == 1


def test_settings_are_the_arguments(room: Any) -> None:
    settings = room.reference_raytracer_scan
    cube = bpy.data.objects["Cube"]
    bpy.ops.object.empty_add(location=(0.5, 0, 0))
    settings.scanner, settings.field, settings.lowest, settings.highest = "ACTIVE", 0.5, 0.0, 0.0
    settings.echoes, settings.rows, settings.columns, settings.radius = 2, 1, 3, 0.0
    bpy.ops.mesh.primitive_uv_sphere_add(radius=1, location=(0.5, 5, 0))
    bpy.context.view_layer.objects.active = bpy.data.objects["Empty"]
    bpy.ops.raytracer.scan()
    (points,) = list_scans()
    values = [(item.value, echo.value) for item, echo in zip(
        points.data.attributes["distance"].data, points.data.attributes["echo"].data, strict=True)]  # fmt: skip
    assert [echo for _, echo in values] == [1, 1, 2, 1]  # to the left and right of the sphere the wall alone
    np.testing.assert_allclose([values[1][0], values[2][0]], [2, 4], atol=0.05)
    assert not points.modifiers
    bpy.data.objects.remove(points)
    only = bpy.data.collections.new("Only")
    only.objects.link(bpy.data.objects["Sphere"])
    settings.collection = only
    bpy.context.view_layer.objects.active = bpy.data.objects["Empty"]
    bpy.ops.raytracer.scan()
    assert {*list_scans()[0].data["objects"].values()} == {"Sphere"}
    assert cube.name == "Cube"


def test_an_animation_has_points_for_each_frame_shown_then_only(room: Any) -> None:
    room.frame_start, room.frame_end, room.frame_step = 2, 6, 2
    room.reference_raytracer_scan.animation = True
    room.frame_set(4)
    assert bpy.ops.raytracer.scan() == {"FINISHED"}
    assert room.frame_current == 4
    assert [points.name for points in list_scans()] == ["Scan.0002", "Scan.0004", "Scan.0006"]
    for frame, shown in ((1, []), (2, [0]), (3, [0]), (4, [1]), (6, [2]), (8, [])):
        room.frame_set(frame)
        bpy.context.view_layer.update()
        assert [not points.hide_render for points in list_scans()] == [row in shown for row in range(3)]


def test_scans_are_not_scanned(room: Any) -> None:
    bpy.ops.raytracer.scan()
    first = list_scans()[0].data
    bpy.ops.raytracer.scan()
    second = list_scans()[1].data
    for one, other in zip(first.vertices, second.vertices, strict=True):
        assert one.co == other.co


def test_without_a_scanner_the_button_says_so(empty_scene: Any) -> None:
    assert not bpy.ops.raytracer.scan.poll()
    with pytest.raises(RuntimeError, match="The scene has no camera to scan from"):
        bpy.ops.raytracer.scan()


def test_a_range_without_extent_is_refused(room: Any) -> None:
    room.reference_raytracer_scan.near, room.reference_raytracer_scan.distance = 5, 5
    with pytest.raises(RuntimeError, match="Farthest has to be larger than Nearest"):
        bpy.ops.raytracer.scan()
    assert not list_scans()


class Layout(RecordingLayout):
    """With what these panels need besides."""

    active = True

    def separator(self) -> None:
        """Nothing is drawn."""


def test_panels_draw_every_setting_once(room: Any) -> None:
    names: list[str] = []
    for panel in panels.CLASSES:
        layout = Layout()
        panel.draw(SimpleNamespace(layout=layout, make_column=lambda context, layout=layout: (
            layout, context.scene.reference_raytracer_scan)), bpy.context)  # fmt: skip
        names += layout.names
    settings = room.reference_raytracer_scan.bl_rna.properties
    assert sorted(names) == sorted({item.identifier for item in settings} - {"rna_type", "name"})
    assert all(item.description and not item.description.endswith(".") for item in settings if item.identifier in names)
