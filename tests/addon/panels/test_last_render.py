"""The panel Last Render: statistics, the error, warnings that can be clicked."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import bpy

import raytracer
from addon.engine import statistics
from addon.extract.warnings import Warning
from addon.panels import last_render
from addon.properties import ENGINE
from tests.addon.panels.panel_fixtures import draw, registered

__all__ = ["registered"]  # a fixture


WARNINGS = (
    Warning("Wave Texture is not supported, its socket's own color is taken", object="Table", material="Wood"),
    Warning("Stereoscopy is not supported"),
)


def record_statistics(scene: Any, **changes: Any) -> statistics.Statistics:
    values = {
        "passes": ("Combined",), "width": 640, "height": 360, "samples": 8, "triangles": 250000, "rays": 3_000_000,
        "build_seconds": 0.25, "trace_seconds": 2.0, "total_seconds": 2.5, "peak_memory_mb": 321.0, "warnings": (),
    }  # fmt: skip
    taken = statistics.Statistics(**{**values, **changes})
    statistics.record_view_layer(scene, taken, first=True)
    return taken


def test_statistics_panel_shows_the_last_render(empty_scene: Any, registered: None) -> None:
    assert draw(last_render.RAYTRACER_RENDER_PT_statistics).texts == ["Nothing rendered yet"]
    record_statistics(empty_scene)
    texts = draw(last_render.RAYTRACER_RENDER_PT_statistics).texts
    assert {"250,000", "3,000,000", "1.50 million rays/s", "0.25 s", "2.00 s", "321 MB", "640 x 360"} <= set(texts)
    record_statistics(empty_scene, peak_memory_mb=None, cancelled=True)
    assert {"unknown", "8 (stopped)"} <= set(draw(last_render.RAYTRACER_RENDER_PT_statistics).texts)


def test_statistics_panel_shows_the_error_and_what_ended_the_render(empty_scene: Any, registered: None) -> None:
    assert dict(last_render.describe_error(record_statistics(empty_scene))) == {"Error": "unknown"}
    known = {"error": 0.0234, "error_interval": (0.0221, 0.025), "error_p99": 0.011, "error_note": "3 pixels hold it"}
    record_statistics(empty_scene, ended_by="error", **known)
    texts = draw(last_render.RAYTRACER_RENDER_PT_statistics).texts
    assert {"8 (noise threshold)", "2.3% (2.2% to 2.5%)", "1.1%", "3 pixels hold it"} <= set(texts)
    record_statistics(empty_scene, **{**known, "error_interval": (0.0, math.inf)})
    assert "2.3% (any)" in draw(last_render.RAYTRACER_RENDER_PT_statistics).texts
    record_statistics(empty_scene, ended_by="time")
    assert "8 (time limit)" in draw(last_render.RAYTRACER_RENDER_PT_statistics).texts


def test_the_worst_view_layer_says_the_error_of_a_frame(empty_scene: Any) -> None:
    one = record_statistics(empty_scene, error=0.01, ended_by="error")
    statistics.record_view_layer(empty_scene, replace(one, error=0.02, error_note="few", ended_by="time"), first=False)
    taken = statistics.last_render(empty_scene)
    assert taken is not None
    assert (taken.error, taken.error_note, taken.ended_by) == (0.02, "few", "time")


def test_a_frame_is_ended_by_its_error_where_all_view_layers_have_it(empty_scene: Any) -> None:
    for endings, expected in (
        (("error", "error"), "error"),
        (("error", "samples"), "samples"),
        (("samples", "error"), "samples"),
        (("samples", "time"), "time"),
        (("error", "cancelled"), "cancelled"),
    ):
        one = record_statistics(empty_scene, ended_by=endings[0])
        statistics.record_view_layer(empty_scene, replace(one, ended_by=endings[1]), first=False)
        taken = statistics.last_render(empty_scene)
        assert taken is not None
        assert taken.ended_by == expected


def test_warnings_panel_shows_only_with_warnings_and_wraps_them(empty_scene: Any, registered: None) -> None:
    surroundings = SimpleNamespace(engine=ENGINE, scene=empty_scene)
    record_statistics(empty_scene)
    assert not last_render.RAYTRACER_RENDER_PT_warnings.poll(surroundings)
    record_statistics(empty_scene, warnings=WARNINGS)
    assert last_render.RAYTRACER_RENDER_PT_warnings.poll(surroundings)
    layout = draw(last_render.RAYTRACER_RENDER_PT_warnings)
    assert len(layout.texts) > 2
    assert " ".join(layout.texts) == " ".join(warning.text for warning in WARNINGS)
    (button,) = layout.buttons
    assert (button.name, button.object, button.material) == ("raytracer.select_warned", "Table", "Wood")


def test_many_warnings_are_cut_and_counted(empty_scene: Any, registered: None) -> None:
    record_statistics(empty_scene, warnings=tuple(Warning(f"number {k}") for k in range(40)))
    texts = draw(last_render.RAYTRACER_RENDER_PT_warnings).texts
    assert (len(texts), texts[-1]) == (31, "and 10 more, on the console")


def test_clicking_a_warning_selects_object_and_material(empty_scene: Any, registered: None) -> None:
    things = []
    for name in ("Chair", "Table", "Shelf"):
        mesh = bpy.data.meshes.new(name)
        for material in ("Metal", "Wood")[: 1 + (name != "Chair")]:
            mesh.materials.append(bpy.data.materials.get(material) or bpy.data.materials.new(material))
        things.append(bpy.data.objects.new(name, mesh))
        empty_scene.collection.objects.link(things[-1])
    things[0].select_set(True)
    assert bpy.ops.raytracer.select_warned(object="Table", material="Wood") == {"FINISHED"}
    assert [thing.select_get() for thing in things] == [False, True, False]
    assert bpy.context.view_layer.objects.active == things[1]
    assert things[1].active_material_index == 1
    assert bpy.ops.raytracer.select_warned(material="Wood") == {"FINISHED"}
    assert [thing.select_get() for thing in things] == [False, True, True]
    assert bpy.ops.raytracer.select_warned(object="Gone") == {"CANCELLED"}
    assert [thing.select_get() for thing in things] == [False, True, True]


def test_statistics_add_up_over_view_layers(empty_scene: Any, registered: None) -> None:
    record_statistics(empty_scene, warnings=(Warning("one"),))
    first = statistics.last_render(empty_scene)
    assert first is not None
    statistics.record_view_layer(empty_scene, first, first=False)
    both = statistics.last_render(empty_scene)
    assert both is not None
    assert (both.rays, both.trace_seconds, both.triangles) == (6_000_000, 4.0, 250000)
    assert both.warnings == (Warning("one"),)


def test_triangles_count_each_instance() -> None:
    import numpy as np

    quad = raytracer.Mesh(np.eye(4, 3), np.array([[0, 1, 2], [1, 2, 3]]))
    single = raytracer.Mesh(np.eye(3), np.array([[0, 1, 2]]))
    assert statistics.count_triangles(raytracer.Scene(meshes=[quad, single])) == 3
    placed = raytracer.Instances(np.array([0, 0, 1]), np.tile(np.eye(4), (3, 1, 1)))
    assert statistics.count_triangles(raytracer.Scene(meshes=[quad, single], instances=placed)) == 5
