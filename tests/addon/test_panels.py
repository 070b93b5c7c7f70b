"""The panels: drawn with a layout that writes down what is asked of it, and their coming and going."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import bpy
import pytest

import addon
import raytracer
from addon import panels, properties, statistics
from addon.engine import ENGINE
from addon.passes import PASSES, enable_passes, enabled_passes
from raytracer import film, settings


@pytest.fixture
def registered() -> Iterator[None]:
    addon.register()
    yield
    addon.unregister()


def test_simplify_panel_draws_what_blender_follows(empty_scene: Any, registered: None) -> None:
    names = draw(panels.RAYTRACER_RENDER_PT_simplify).names
    assert names == ["simplify_subdivision", "simplify_subdivision_render"]


class RecordingLayout:
    """Stands for a UILayout: checks that every property drawn exists, and keeps names and texts."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.texts: list[str] = []

    def prop(self, data: Any, name: str, **options: Any) -> None:
        assert name in data.bl_rna.properties, f"{data} has no property {name}"
        self.names.append(name)

    def label(self, text: str = "", **options: Any) -> None:
        self.texts.append(text)

    def column(self, **options: Any) -> RecordingLayout:
        return self

    split = column


def draw(panel: Any, **context: Any) -> RecordingLayout:
    """Return what a panel draws in a context."""
    layout = RecordingLayout()
    preferences = SimpleNamespace(system=SimpleNamespace(ui_scale=1.0))
    defaults = {"scene": bpy.context.scene, "view_layer": bpy.context.view_layer, "light": None}
    surroundings = SimpleNamespace(
        engine=ENGINE, preferences=preferences, region=SimpleNamespace(width=300), **{**defaults, **context}
    )
    panel.draw(SimpleNamespace(layout=layout), surroundings)
    return layout


def find_compatible_engines() -> dict[str, frozenset[str]]:
    """Return the engines of every panel there is."""
    return {
        panel.__name__: frozenset(panel.COMPAT_ENGINES)
        for panel in panels.all_subclasses(bpy.types.Panel)
        if hasattr(panel, "COMPAT_ENGINES") and panel not in panels.CLASSES
    }


def test_unregister_leaves_built_in_panels_as_they_were(empty_scene: Any) -> None:
    before = find_compatible_engines()
    addon.register()
    during = find_compatible_engines()
    addon.unregister()
    assert find_compatible_engines() == before
    joined = {name for name in before if during[name] != before[name]}
    assert all(during[name] == before[name] | {ENGINE} for name in joined)
    assert {"RENDER_PT_format", "DATA_PT_lens", "RENDER_PT_color_management", *panels.BORROWED} <= joined


def test_left_out_panels_are_not_joined(empty_scene: Any, registered: None) -> None:
    joined = {name for name, engines in find_compatible_engines().items() if ENGINE in engines}
    assert joined.isdisjoint(panels.LEFT_OUT)
    assert not [name for name in joined if name.startswith(panels.LEFT_OUT_GROUPS)]


def test_left_out_names_are_panels_of_this_blender(empty_scene: Any) -> None:
    marked = {name for name, engines in find_compatible_engines().items() if "BLENDER_RENDER" in engines}
    assert set(panels.LEFT_OUT) <= marked
    assert all(any(name.startswith(group) for name in marked) for group in panels.LEFT_OUT_GROUPS)


def test_register_twice_in_a_row_works(empty_scene: Any) -> None:
    for _ in range(2):
        addon.register()
        assert bpy.context.scene.reference_raytracer.samples == 64
        addon.unregister()
    assert not hasattr(bpy.context.scene, "reference_raytracer")


def test_every_setting_is_drawn_once_and_explained(empty_scene: Any, registered: None) -> None:
    drawn = [name for panel in panels.CLASSES[:4] for name in draw(panel).names]
    own = [
        item
        for item in empty_scene.reference_raytracer.bl_rna.properties
        if item.identifier not in ("name", "rna_type")
    ]
    assert sorted(drawn) == sorted([item.identifier for item in own] + ["film_transparent"])
    assert all(item.description for item in own)


def test_settings_reach_the_ray_tracer_by_their_names(empty_scene: Any, registered: None) -> None:
    keywords = properties.settings_keywords(empty_scene)
    assert settings.Settings(**keywords).samples == 64
    assert keywords["workers"] == properties.count_processors() >= 1
    empty_scene.reference_raytracer.workers = 3
    empty_scene.reference_raytracer.pixel_filter = "BOX"
    assert properties.settings_keywords(empty_scene)["workers"] == 3
    assert properties.settings_keywords(empty_scene)["pixel_filter"] == "box"


def test_choices_are_those_of_the_ray_tracer() -> None:
    assert tuple(name.lower() for name, *_ in properties.PRECISIONS) == settings.PRECISIONS
    assert tuple(name.lower() for name, *_ in properties.PIXEL_FILTERS) == tuple(settings.FILTER_WIDTHS)


def test_passes_are_those_of_the_film() -> None:
    assert {name: len(stored.channels) for name, stored in PASSES.items()} == {
        name: stored.channels for name, stored in film.PASSES.items()
    }


def test_passes_panel_switches_what_the_engine_reads(empty_scene: Any, registered: None) -> None:
    assert draw(panels.RAYTRACER_VIEWLAYER_PT_passes).names == [
        stored.option for name, stored in PASSES.items() if name != "Combined"
    ]
    layer = bpy.context.view_layer
    for name in PASSES:
        enable_passes(layer, (name,))
        assert enabled_passes(layer) == tuple(dict.fromkeys(("Combined", name)))
    layer.use_pass_combined = False  # as a file of another engine may have it; Blender keeps the pass all the same
    assert "Combined" in enabled_passes(layer)


@pytest.mark.parametrize("kind", ["POINT", "SUN", "SPOT", "AREA"])
def test_light_panel_draws_every_kind_of_light(empty_scene: Any, registered: None, kind: str) -> None:
    light = bpy.data.lights.new("Light", kind)
    names = draw(panels.RAYTRACER_LIGHT_PT_tracing, light=light).names
    assert names == ["use_shadow", "spread"] if kind == "AREA" else ["use_shadow"]


def record_statistics(scene: Any, **changes: Any) -> None:
    values = {
        "passes": ("Combined",), "width": 640, "height": 360, "samples": 8, "triangles": 250000, "rays": 3_000_000,
        "build_seconds": 0.25, "trace_seconds": 2.0, "total_seconds": 2.5, "peak_memory_mb": 321.0, "warnings": (),
    }  # fmt: skip
    statistics.record_view_layer(scene, statistics.Statistics(**{**values, **changes}), first=True)


def test_statistics_panel_shows_the_last_render(empty_scene: Any, registered: None) -> None:
    assert draw(panels.RAYTRACER_RENDER_PT_statistics).texts == ["Nothing rendered yet"]
    record_statistics(empty_scene)
    texts = draw(panels.RAYTRACER_RENDER_PT_statistics).texts
    assert {"250,000", "3,000,000", "1.50 million rays/s", "0.25 s", "2.00 s", "321 MB", "640 x 360"} <= set(texts)
    record_statistics(empty_scene, peak_memory_mb=None, cancelled=True)
    assert {"unknown", "8 (stopped)"} <= set(draw(panels.RAYTRACER_RENDER_PT_statistics).texts)


def test_warnings_panel_shows_only_with_warnings_and_wraps_them(empty_scene: Any, registered: None) -> None:
    surroundings = SimpleNamespace(engine=ENGINE, scene=empty_scene)
    record_statistics(empty_scene)
    assert not panels.RAYTRACER_RENDER_PT_warnings.poll(surroundings)
    warning = "material 'Wood': Wave Texture is not supported, its socket's own color is taken"
    record_statistics(empty_scene, warnings=(warning,))
    assert panels.RAYTRACER_RENDER_PT_warnings.poll(surroundings)
    lines = draw(panels.RAYTRACER_RENDER_PT_warnings).texts
    assert len(lines) > 1
    assert " ".join(lines) == warning


def test_statistics_add_up_over_view_layers(empty_scene: Any, registered: None) -> None:
    record_statistics(empty_scene, warnings=("one",))
    first = statistics.last_render(empty_scene)
    assert first is not None
    statistics.record_view_layer(empty_scene, first, first=False)
    both = statistics.last_render(empty_scene)
    assert both is not None
    assert (both.rays, both.trace_seconds, both.triangles) == (6_000_000, 4.0, 250000)
    assert both.warnings == ("one",)


def test_triangles_count_each_instance() -> None:
    import numpy as np

    quad = raytracer.Mesh(np.eye(4, 3), np.array([[0, 1, 2], [1, 2, 3]]))
    single = raytracer.Mesh(np.eye(3), np.array([[0, 1, 2]]))
    assert statistics.count_triangles(raytracer.Scene(meshes=[quad, single])) == 3
    placed = raytracer.Instances(np.array([0, 0, 1]), np.tile(np.eye(4), (3, 1, 1)))
    assert statistics.count_triangles(raytracer.Scene(meshes=[quad, single], instances=placed)) == 5
