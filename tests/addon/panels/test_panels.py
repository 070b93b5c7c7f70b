"""The panels: drawn with a layout that writes down what is asked of it, and their coming and going."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import bpy
import pytest

import addon
import raytracer
from addon import handlers, inspector, panels, properties, versions
from addon.compare import window
from addon.engine import statistics
from addon.extract.warnings import Warning
from addon.panels import bake, built_in, last_render, presets, render, resume, scene_data, view_layer
from addon.passes import MATTE_OPTIONS, PASSES, enable_passes, enabled_passes, find_pass, list_options
from addon.properties import ENGINE
from raytracer.film import passes
from raytracer.integrator import settings


@pytest.fixture
def registered() -> Iterator[None]:
    addon.register()
    yield
    addon.unregister()


def test_simplify_panel_draws_what_blender_follows(empty_scene: Any, registered: None) -> None:
    names = draw(render.RAYTRACER_RENDER_PT_simplify).names
    assert names == ["use_simplify", "simplify_subdivision", "simplify_subdivision_render"]


class RecordingLayout:
    """Stands for a UILayout: checks that every property drawn exists, and keeps names and texts."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.texts: list[str] = []
        self.buttons: list[Any] = []
        self.views: list[Any] = []

    def prop(self, data: Any, name: str, **options: Any) -> None:
        assert name in data.bl_rna.properties, f"{data} has no property {name}"
        self.names.append(name)

    def label(self, text: str = "", **options: Any) -> None:
        self.texts.append(text)

    def operator(self, name: str, **options: Any) -> Any:
        self.buttons.append(SimpleNamespace(name=name))
        return self.buttons[-1]

    def template_node_view(self, tree: Any, node: Any, socket: Any) -> None:
        self.views.append((tree, node, socket))

    def template_curve_mapping(self, data: Any, name: str) -> None:
        self.prop(data, name)

    def template_list(
        self, kind: str, name: str, data: Any, items: str, holder: Any, index: str, **options: Any
    ) -> None:
        assert hasattr(bpy.types, kind)
        self.prop(data, items)
        assert index in holder.bl_rna.properties

    def prop_search(self, data: Any, name: str, found_in: Any, items: str, **options: Any) -> None:
        self.prop(data, name)
        assert items in found_in.bl_rna.properties

    def menu(self, name: str, **options: Any) -> None:
        assert hasattr(bpy.types, name)

    def separator(self) -> None:
        pass

    def column(self, **options: Any) -> RecordingLayout:
        return self

    split = row = column


def draw(panel: Any, **context: Any) -> RecordingLayout:
    """Return what a panel draws in a context."""
    layout = RecordingLayout()
    preferences = SimpleNamespace(system=SimpleNamespace(ui_scale=1.0))
    defaults = {"scene": bpy.context.scene, "view_layer": bpy.context.view_layer, "light": None}
    surroundings = SimpleNamespace(
        engine=ENGINE, preferences=preferences, region=SimpleNamespace(width=300), **{**defaults, **context}
    )
    for function in (getattr(panel, "draw_header", None), panel.draw):
        if function:
            function(SimpleNamespace(layout=layout), surroundings)
    return layout


def find_compatible_engines() -> dict[str, frozenset[str]]:
    """Return the engines of every panel there is."""
    return {
        panel.__name__: frozenset(panel.COMPAT_ENGINES)
        for panel in built_in.all_subclasses(bpy.types.Panel)
        if hasattr(panel, "COMPAT_ENGINES") and panel.__module__.split(".")[0] != "addon"
    }


def test_unregister_leaves_built_in_panels_as_they_were(empty_scene: Any) -> None:
    before = find_compatible_engines()
    addon.register()
    during = find_compatible_engines()
    addon.unregister()
    assert find_compatible_engines() == before
    joined = {name for name in before if during[name] != before[name]}
    assert all(during[name] == before[name] | {ENGINE} for name in joined)
    assert {"RENDER_PT_format", "DATA_PT_lens", "RENDER_PT_color_management", *built_in.BORROWED} <= joined


def test_left_out_panels_are_not_joined(empty_scene: Any, registered: None) -> None:
    joined = {name for name, engines in find_compatible_engines().items() if ENGINE in engines}
    assert joined.isdisjoint(built_in.LEFT_OUT)
    assert not [name for name in joined if name.startswith(built_in.LEFT_OUT_GROUPS)]


def test_left_out_names_are_panels_of_this_blender(empty_scene: Any) -> None:
    marked = {name for name, engines in find_compatible_engines().items() if "BLENDER_RENDER" in engines}
    assert set(built_in.LEFT_OUT) <= marked
    assert all(any(name.startswith(group) for name in marked) for group in built_in.LEFT_OUT_GROUPS)


def test_register_twice_in_a_row_works(empty_scene: Any) -> None:
    for _ in range(2):
        addon.register()
        assert bpy.context.scene.reference_raytracer.samples == 64
        addon.unregister()
    assert not hasattr(bpy.context.scene, "reference_raytracer")


def test_every_setting_is_drawn_once_and_explained(empty_scene: Any, registered: None) -> None:
    chosen = [panel for panel in render.CLASSES if panel is not render.RAYTRACER_RENDER_PT_simplify]
    assert "Workers: " in " ".join(draw(render.RAYTRACER_RENDER_PT_performance).texts)
    empty_scene.reference_raytracer.workers_mode = "FIXED"
    drawn = [name for panel in chosen for name in draw(panel).names] + ["bake_type"]
    assert "bake_type" in draw(bake.RAYTRACER_RENDER_PT_bake).names
    own = [
        item
        for item in empty_scene.reference_raytracer.bl_rna.properties
        if item.identifier not in ("name", "rna_type")
    ]
    assert sorted(drawn) == sorted([item.identifier for item in own] + ["film_transparent"])
    assert all(item.description for item in own)


def test_the_render_menu_offers_to_resume_where_checkpoints_are_kept(empty_scene: Any, registered: None) -> None:
    assert resume.draw_item in bpy.types.TOPBAR_MT_render.draw._draw_funcs
    item = SimpleNamespace(draw=resume.draw_item)
    empty_scene.render.engine = ENGINE
    assert not draw(item).buttons
    empty_scene.reference_raytracer.use_checkpoints = True
    assert [button.name for button in draw(item).buttons] == ["raytracer.resume_render"]
    empty_scene.render.engine = "BLENDER_WORKBENCH"
    assert not draw(item).buttons


def test_settings_reach_the_ray_tracer_by_their_names(empty_scene: Any, registered: None) -> None:
    keywords = properties.settings_keywords(empty_scene)
    assert settings.Settings(**keywords).samples == 64
    assert keywords["workers"] == properties.count_processors() >= 1
    empty_scene.reference_raytracer.workers = 3
    empty_scene.reference_raytracer.pixel_filter = "BOX"
    assert properties.settings_keywords(empty_scene)["workers"] == 3
    assert properties.settings_keywords(empty_scene)["pixel_filter"] == "box"


def test_workers_follow_the_processors_until_they_are_fixed(empty_scene: Any, registered: None) -> None:
    own = empty_scene.reference_raytracer
    assert (own.workers_mode, own.workers) == ("AUTO", 0)
    own.workers_mode = "FIXED"
    assert own.workers == properties.count_processors()
    own.workers = 3
    own.workers_mode = "FIXED"
    assert (own.workers_mode, own.workers) == ("FIXED", 3)
    own.workers_mode = "AUTO"
    assert own.workers == 0


def test_choices_are_those_of_the_ray_tracer() -> None:
    assert tuple(name.lower() for name, *_ in properties.PRECISIONS) == settings.PRECISIONS
    assert tuple(name.lower() for name, *_ in properties.PIXEL_FILTERS) == tuple(settings.FILTER_WIDTHS)


def test_passes_are_those_of_the_film() -> None:
    for name, traced in passes.PASSES.items():
        assert (name in PASSES) == (not traced.matte)
        assert len(find_pass(name).channels) == traced.channels


def test_passes_panel_switches_what_the_engine_reads(empty_scene: Any, registered: None) -> None:
    drawn = draw(view_layer.RAYTRACER_VIEWLAYER_PT_passes).names
    assert drawn == [option.split(".")[-1] for option in list_options() if option != "use_pass_combined"]
    layer = bpy.context.view_layer
    for name, stored in PASSES.items():
        enable_passes(layer, (name,))
        switched = [other for other in PASSES if PASSES[other].option in ("use_pass_combined", stored.option)]
        assert enabled_passes(layer) == tuple(switched)
    layer.use_pass_combined = False  # as a file of another engine may have it; Blender keeps the pass all the same
    assert "Combined" in enabled_passes(layer)


def test_cryptomatte_panel_switches_two_levels_a_pass(empty_scene: Any, registered: None) -> None:
    layer = bpy.context.view_layer
    names = draw(view_layer.RAYTRACER_VIEWLAYER_PT_cryptomatte).names
    assert names == [*MATTE_OPTIONS.values(), "pass_cryptomatte_depth"]
    enable_passes(layer, ("CryptoAsset01",))
    assert enabled_passes(layer) == ("Combined", "CryptoAsset00", "CryptoAsset01")
    layer.pass_cryptomatte_depth, layer.use_pass_cryptomatte_object = 2, True
    assert enabled_passes(layer) == ("Combined", "CryptoObject00", "CryptoAsset00")
    enable_passes(layer, ("Depth",))
    assert enabled_passes(layer) == ("Combined", "Depth")


def test_aov_panel_lists_what_shaders_write(empty_scene: Any, registered: None) -> None:
    layer = bpy.context.view_layer
    shown = draw(view_layer.RAYTRACER_VIEWLAYER_PT_aov)
    assert (shown.names, shown.texts) == (["aovs"], [])
    assert [button.name for button in shown.buttons] == ["scene.view_layer_add_aov", "scene.view_layer_remove_aov"]
    for button in shown.buttons[:1]:
        group, name = button.name.split(".")
        getattr(getattr(bpy.ops, group), name)()
    layer.aovs[0].name, layer.aovs[0].type = "mask", "VALUE"
    assert enabled_passes(layer) == ("Combined", "AOV Value mask")
    stored = find_pass("AOV Value mask")
    assert (stored.channels, stored.kind, versions.blender_pass_name("AOV Value mask")) == ("X", "VALUE", "mask")
    assert len(find_pass("AOV Color mask").channels) == passes.find_pass("AOV Color mask").channels


def test_light_groups_are_listed_and_given_to_objects_and_the_world(empty_scene: Any, registered: None) -> None:
    layer, world = bpy.context.view_layer, bpy.data.worlds.new("World")
    shown = draw(view_layer.RAYTRACER_VIEWLAYER_PT_light_groups)
    assert shown.names == ["lightgroups"]
    assert [button.name.split("_")[-2] for button in shown.buttons] == ["add", "remove"]
    layer.lightgroups.add(name="key")
    assert enabled_passes(layer) == ("Combined", "Combined_key")
    assert (find_pass("Combined_key").channels, versions.blender_pass_name("Combined_key")) == ("RGB", "Combined_key")
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "SUN"))
    for panel, owner in (
        (scene_data.RAYTRACER_OBJECT_PT_light_group, {"object": lamp}),
        (scene_data.RAYTRACER_WORLD_PT_light_group, {"world": world}),
    ):
        (owned,) = owner.values()
        owned.lightgroup = "rim"
        drawn = draw(panel, **owner)
        assert (drawn.names, drawn.buttons[0].name) == (["lightgroup"], "rim")


@pytest.mark.parametrize("kind", ["POINT", "SUN", "SPOT", "AREA"])
def test_light_panel_draws_every_kind_of_light(empty_scene: Any, registered: None, kind: str) -> None:
    light = bpy.data.lights.new("Light", kind)
    names = draw(scene_data.RAYTRACER_LIGHT_PT_tracing, light=light).names
    expected = ["use_shadow", "spread"] if kind == "AREA" else ["use_shadow"]
    assert names == [*expected, *(["max_bounces"] if hasattr(light, "cycles") else [])]


def test_world_and_light_panels_draw_their_nodes(empty_scene: Any, registered: None) -> None:
    world, light = bpy.data.worlds.new("World"), bpy.data.lights.new("Light", "SUN")
    for owner in (world, light):
        if versions.find_node_tree(owner) is None:
            owner.use_nodes = True
    for panel, name, owner in (
        (scene_data.RAYTRACER_WORLD_PT_surface, "world", world),
        (scene_data.RAYTRACER_LIGHT_PT_nodes, "light", light),
    ):
        (tree, output, socket) = draw(panel, **{name: owner}).views[0]
        assert (tree, output.type, socket.name) == (owner.node_tree, f"OUTPUT_{name.upper()}", "Surface")
        owner.node_tree.nodes.clear()
        assert draw(panel, **{name: owner}).texts == ["No output node"]
    names = draw(scene_data.RAYTRACER_WORLD_PT_ray_visibility, world=world).names
    assert names == ["camera", "diffuse", "glossy", "transmission"]
    assert draw(scene_data.RAYTRACER_WORLD_PT_settings, world=world).names == ["max_bounces"]


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
    assert (taken.error, taken.error_note, taken.ended_by) == (0.02, "few", "error")


def test_noise_threshold_and_time_limit_reach_the_ray_tracer(empty_scene: Any, registered: None) -> None:
    keywords = properties.settings_keywords(empty_scene)
    assert (keywords["error"], keywords["seconds"]) == (None, None)
    own = empty_scene.reference_raytracer
    own.use_noise_threshold, own.noise_threshold, own.min_samples, own.time_limit = True, 2.5, 32, 60.0
    chosen = settings.Settings(**properties.settings_keywords(empty_scene))
    assert (round(chosen.error or 0.0, 9), chosen.min_samples, chosen.seconds) == (0.025, 32, 60.0)


WARNINGS = (
    Warning("Wave Texture is not supported, its socket's own color is taken", object="Table", material="Wood"),
    Warning("Stereoscopy is not supported"),
)


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


def test_ray_visibility_and_material_panels_draw_what_is_read(empty_scene: Any, registered: None) -> None:
    thing = bpy.data.objects.new("Thing", bpy.data.meshes.new("Thing"))
    visibility = scene_data.RAYTRACER_OBJECT_PT_ray_visibility
    assert visibility.poll(SimpleNamespace(object=thing, engine=ENGINE))
    assert not visibility.poll(SimpleNamespace(object=None, engine=ENGINE))
    names = draw(visibility, object=thing).names
    assert names == [f"visible_{kind}" for kind in ("camera", "diffuse", "glossy", "transmission", "shadow")]
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    assert draw(visibility, object=lamp).names == names[:-1]
    material = bpy.data.materials.new("Material")
    assert scene_data.RAYTRACER_MATERIAL_PT_settings.poll(SimpleNamespace(material=material, engine=ENGINE))
    names = draw(scene_data.RAYTRACER_MATERIAL_PT_settings, material=material).names
    assert names == ["use_transparent_shadow", "pass_index"]


def test_shadow_catcher_is_shown_for_what_can_be_seen(empty_scene: Any, registered: None) -> None:
    panel = scene_data.RAYTRACER_OBJECT_PT_shadow_catcher
    assert draw(panel, object=bpy.data.objects.new("Thing", bpy.data.meshes.new("Thing"))).names == [
        "is_shadow_catcher"
    ]
    assert not panel.poll(SimpleNamespace(object=bpy.data.objects.new("Empty", None), engine=ENGINE))


def test_override_panel_draws_what_this_blender_has(empty_scene: Any, registered: None) -> None:
    names = draw(view_layer.RAYTRACER_VIEWLAYER_PT_override).names
    has_world = "world_override" in bpy.context.view_layer.bl_rna.properties
    assert names == ["material_override", "world_override"][: 1 + has_world]


def test_filter_panel_draws_what_the_engine_heeds(empty_scene: Any, registered: None) -> None:
    assert draw(view_layer.RAYTRACER_VIEWLAYER_PT_filter).names == ["use_sky", "use_solid"]


def find_presets() -> dict[str, str]:
    from pathlib import Path

    folders = bpy.utils.preset_paths(presets.FOLDER)
    return {path.stem: str(path) for folder in folders for path in Path(folder).glob("*.py")}


def test_presets_set_what_they_hold(empty_scene: Any, registered: None) -> None:
    assert {"Draft", "Final", "Reference"} <= find_presets().keys()
    own = empty_scene.reference_raytracer
    seen = {}
    for name in ("Draft", "Final", "Reference"):
        for setting in presets.SETTINGS:
            own.property_unset(setting)
        menu = "RAYTRACER_PT_sampling_presets"
        assert bpy.ops.script.execute_preset(filepath=find_presets()[name], menu_idname=menu) == {"FINISHED"}
        seen[name] = {setting: getattr(own, setting) for setting in presets.SETTINGS}
    assert seen["Draft"]["samples"] < seen["Final"]["samples"] < seen["Reference"]["samples"]
    assert (seen["Reference"]["clamp_indirect"], seen["Reference"]["filter_glossy"]) == (0.0, 0.0)


def test_presets_are_forgotten_with_the_addon(empty_scene: Any) -> None:
    addon.register()
    addon.unregister()
    assert find_presets() == {}


def list_own_types() -> list[Any]:
    """Return all classes that the add-on registers."""
    own = [*panels.CLASSES, *inspector.panels.CLASSES, *inspector.operators.CLASSES, *inspector.properties.CLASSES]
    own += [*window.panels.CLASSES, *window.operators.CLASSES, *window.properties.CLASSES]
    return [*own, properties.ReferenceRaytracerSettings]


# What a number's description has to say where its subtype does not: the unit, or what is counted.
UNITS = ("pixel", "number", "most ", "share", "place", "per pixel", "row", "processes", "chooses", "blurs", "metres")


def test_every_property_and_operator_is_explained_with_its_unit(empty_scene: Any, registered: None) -> None:
    operators = 0
    for own in list_own_types():
        if issubclass(own, bpy.types.Operator):
            operators += 1
            group, name = own.bl_idname.split(".")
            described = getattr(getattr(bpy.ops, group), name).get_rna_type()
            assert described.description, own
        else:
            described = own.bl_rna
        if not issubclass(own, bpy.types.Operator | bpy.types.PropertyGroup):
            continue
        for name in own.__annotations__:
            item = described.properties[name]
            assert item.name, (own, name)
            assert item.description, (own, name)
            assert not item.description.endswith("."), (own, name)  # Blender adds it
            if item.type in ("INT", "FLOAT") and not name.endswith("_index"):
                assert any(unit in item.description.lower() for unit in UNITS), (own, name, item.description)
    assert operators >= 8


def test_enable_and_disable_ten_times_leaves_nothing(empty_scene: Any) -> None:
    def describe() -> tuple[Any, ...]:
        handlers = {name: len(getattr(bpy.app.handlers, name)) for name in ("load_post", "depsgraph_update_post")}
        own = {name for name in dir(bpy.types) if "RAYTRACER" in name.upper()}
        kinds = [name for name in dir(bpy.ops.raytracer) if not name.startswith("_")]
        return find_compatible_engines(), handlers, own, kinds, list(bpy.utils.preset_paths(presets.FOLDER))

    before = describe()
    for _ in range(10):
        addon.register()
        assert describe()[2] != before[2]
        addon.unregister()
        assert describe() == before


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


def test_leaving_handlers_that_others_have_emptied_is_harmless(empty_scene: Any) -> None:
    addon.register()
    bpy.app.handlers.load_post.clear()
    bpy.app.handlers.render_complete.clear()
    addon.unregister()
    addon.register()
    count = len(bpy.app.handlers.render_complete)
    handlers.join(last_render.show_news, bpy.app.handlers.render_complete)
    assert len(bpy.app.handlers.render_complete) == count
    addon.unregister()
