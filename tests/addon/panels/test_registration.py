"""The add-on's coming and going: panels, presets, properties, handlers."""

from __future__ import annotations

from typing import Any

import bpy
import pytest

import addon
from addon import handlers, inspector, panels, properties, scanning
from addon.compare import window
from addon.compare.window import job
from addon.denoising import process
from addon.panels import built_in, last_render, presets
from addon.properties import ENGINE
from addon.viewport.viewport import Viewport
from tests.addon.panels.panel_fixtures import registered

__all__ = ["registered"]  # a fixture


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


def test_a_panel_that_lists_its_engines_otherwise_is_left_alone(
    empty_scene: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    engines = ("BLENDER_RENDER", "CYCLES")  # as of another add-on; Blender itself only asks what is in it
    monkeypatch.setattr(bpy.types.RENDER_PT_format, "COMPAT_ENGINES", engines)
    addon.register()
    addon.unregister()
    assert engines == bpy.types.RENDER_PT_format.COMPAT_ENGINES


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


def find_presets() -> dict[str, str]:
    from pathlib import Path

    folders = bpy.utils.preset_paths(presets.FOLDER)
    return {path.stem: str(path) for folder in folders for path in Path(folder).glob("*.py")}


@pytest.mark.skipif(not hasattr(bpy.utils, "register_preset_path"), reason="Blender 4.2.0 finds no presets of others")
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


def test_the_addon_registers_where_blender_finds_no_presets_of_others(
    empty_scene: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("register_preset_path", "unregister_preset_path"):
        monkeypatch.delattr(bpy.utils, name, raising=False)  # Blender 4.2.0
    addon.register()
    assert find_presets() == {}
    addon.unregister()
    assert not hasattr(bpy.context.scene, "reference_raytracer")


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


def fail(*_: Any) -> None:
    raise OSError("no usable folder")


def test_what_fails_to_register_leaves_nothing(empty_scene: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The engine stayed without its add-on, which could not be switched on again before Blender was started anew."""
    before = {name for name in dir(bpy.types) if "RAYTRACER" in name.upper()}
    with monkeypatch.context() as broken:
        broken.setattr(scanning.panels, "register", fail)
        for _ in range(2):
            with pytest.raises(OSError, match="no usable folder"):
                addon.register()
            assert {name for name in dir(bpy.types) if "RAYTRACER" in name.upper()} == before
            assert not hasattr(bpy.context.scene, "reference_raytracer")
    addon.register()
    addon.unregister()


def test_a_class_that_fails_to_register_takes_the_others_with_it(
    empty_scene: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where another add-on has taken a panel away that one of ours stands below, say."""
    with monkeypatch.context() as broken:
        broken.setattr(panels.CLASSES[-1], "bl_idname", "no.operator of a valid name")
        with pytest.raises((ValueError, RuntimeError)):
            addon.register()
    addon.register()
    addon.unregister()


def test_a_part_that_fails_to_unregister_keeps_no_other(empty_scene: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    addon.register()
    with monkeypatch.context() as broken:
        broken.setattr(inspector.session, "leave", fail)
        with pytest.raises(OSError, match="no usable folder"):
            addon.unregister()
    assert not hasattr(bpy.context.scene, "reference_raytracer")
    addon.register()
    addon.unregister()


def test_no_folder_for_temporary_files_is_no_reason_not_to_register(
    empty_scene: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is looked into only to tidy up."""
    monkeypatch.setattr(job, "sweep", fail)
    addon.register()
    addon.unregister()


def test_the_denoiser_ends_after_the_viewports_that_ask_it(empty_scene: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else unregistering would wait for a picture, and the next one that waits would start a process anew."""

    class Engine:
        pass

    addon.register()
    engine, closed = Engine(), []
    region = Viewport(engine)
    close = process.close

    def note() -> None:
        closed.append(region.finishing._is_closed)
        close()

    monkeypatch.setattr(process, "close", note)
    addon.unregister()
    assert closed == [True]
