"""An animation keeps what did not change between frames, renders the same pictures, and lets go at its end."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest

from addon.compare.cycles.exr import read_exr
from addon.engine import animation, engine, tracing
from addon.engine.statistics import last_render
from addon.extract import mesh_table
from addon.versions import set_image_format
from tests.addon.engine.engine_fixtures import add_plane, make_stage, render_pass

pytestmark = pytest.mark.usefixtures("registered_addon")

LAST = 3


@pytest.fixture
def stage(empty_scene: Any, tmp_path: Path) -> Any:
    """Return a scene of LAST frames: one plane stands, one moves, one is reshaped by a moving hook of keys."""
    make_stage(empty_scene)
    empty_scene.frame_start, empty_scene.frame_end = 1, LAST
    for index, name in enumerate(("Standing", "Moving", "Reshaped")):
        plane = add_plane(empty_scene.collection, name, (0.5, 0.25 * index, 0.125), (-2.0, 2.0), (-1.0, 1.0))
        plane.location = (0.0, 4.0 * index - 4.0, 0.0)
    moving, reshaped = bpy.data.objects["Moving"], bpy.data.objects["Reshaped"]
    reshaped.shape_key_add(name="Basis")
    key = reshaped.shape_key_add(name="Wide")
    key.data[1].co.x = 6.0
    for frame in (1, LAST):
        moving.location.x = 2.0 * frame
        moving.keyframe_insert("location", frame=frame)
        key.value = (frame - 1) / (LAST - 1)
        key.keyframe_insert("value", frame=frame)
    set_image_format(empty_scene.render.image_settings, "OPEN_EXR_MULTILAYER")
    empty_scene.render.image_settings.color_depth = "32"
    empty_scene.render.image_settings.exr_codec = "NONE"
    return empty_scene


def render_frames(stage: Any, folder: Path) -> list[dict[str, np.ndarray]]:
    stage.render.filepath = str(folder / "frame_")
    bpy.ops.render.render(animation=True, scene=stage.name)
    return [read_exr(folder / f"frame_{frame:04}.exr") for frame in range(1, LAST + 1)]


def test_frames_are_those_that_are_rendered_without_keeping(
    stage: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = render_frames(stage, tmp_path / "kept")
    monkeypatch.setattr(animation, "find_frames", lambda *_: None)
    alone = render_frames(stage, tmp_path / "alone")
    for one, other in zip(kept, alone, strict=True):
        assert one.keys() == other.keys()
        for name in one:
            np.testing.assert_array_equal(one[name], other[name])
    combined = [np.stack([frame[name] for name in sorted(frame)]) for frame in kept]
    assert (combined[0] != combined[1]).any()


def test_only_what_changed_is_made_anew(stage: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    same: list[tuple[str, bool]] = []
    extract = mesh_table.extract_geometry

    def extract_and_note(mesh: Any, name: str, with_uvs: bool, warnings: Any, last: Any) -> Any:
        found = extract(mesh, name, with_uvs, warnings, last)
        same.append((name, found is last))
        return found

    monkeypatch.setattr(mesh_table, "extract_geometry", extract_and_note)
    render_frames(stage, tmp_path)
    assert [name for name, is_same in same if is_same] == ["Standing", "Moving"] * (LAST - 1)


def test_casters_are_built_from_those_of_the_frame_before(
    stage: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    known: list[Any] = []
    build = animation.raytracer.build

    def build_and_note(scene: Any, precision: str, last: Any = None) -> Any:
        known.append(last)
        return build(scene, precision, last=last)

    monkeypatch.setattr(animation.raytracer, "build", build_and_note)
    render_frames(stage, tmp_path)
    assert known[0] is None
    assert len(known) == LAST
    assert all(last is not None for last in known[1:])


def test_all_is_let_go_at_the_end(stage: Any, tmp_path: Path) -> None:
    render_frames(stage, tmp_path)
    assert not animation._frames
    stage.camera = None
    with pytest.raises(RuntimeError, match="no camera"):
        render_frames(stage, tmp_path)
    assert not animation._frames


def test_a_single_picture_keeps_nothing() -> None:
    depsgraph = bpy.context.evaluated_depsgraph_get()
    assert animation.find_frames(SimpleNamespace(is_animation=False), depsgraph) is None


def test_a_preview_is_quick_and_leaves_no_trace(stage: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[str, Any] = {}

    class Output:
        def __init__(self, *_: Any) -> None:
            pass

        def __enter__(self) -> Output:
            return self

        def __exit__(self, *_: Any) -> None:
            pass

        def write_film(self, film: Any, uses_up: bool) -> None:
            asked["uses_up"] = uses_up

        def note(self, fields: Any) -> None:
            assert not list(fields)

    def render(scene: Any, width: int, height: int, **settings: Any) -> Any:
        asked.update(settings)
        return SimpleNamespace(passes={}, statistics=SimpleNamespace(), width=32, height=32, ended_by="samples")

    reports: list[Any] = []
    preview = SimpleNamespace(
        is_preview=True,
        camera_override=None,
        is_animation=False,
        resolution_x=32,
        resolution_y=32,
        layers_done=0,
        update_stats=lambda *_: None,
        update_progress=lambda _: None,
        test_break=lambda: False,
        report=lambda *arguments: reports.append(arguments),
    )
    monkeypatch.setattr(engine, "RenderOutput", Output)
    monkeypatch.setattr(engine.raytracer, "render", render)
    smoke = bpy.data.objects.new("Smoke", bpy.data.volumes.new("Smoke"))
    smoke.data.filepath = "//missing.vdb"  # a render would warn
    stage.collection.objects.link(smoke)
    engine.statistics.forget_all()
    engine.render_view_layer(preview, bpy.context.evaluated_depsgraph_get())
    assert (asked["samples"], asked["workers"]) == (tracing.PREVIEW_SAMPLES, 1)
    assert reports == []
    assert last_render(stage) is None
    assert engine.ReferenceRaytracerEngine.bl_use_preview
    assert engine.ReferenceRaytracerEngine.bl_use_eevee_viewport


def test_with_persistent_data_each_frame_is_counted_for_itself(stage: Any, tmp_path: Path) -> None:
    """Blender keeps the engine's object then: a failed render made all later ones empty, and numbers added up."""
    stage.view_layers.new("Second")
    stage.render.use_persistent_data = True
    render_pass(stage, tmp_path / "a.exr")
    once = last_render(stage)
    stage.camera.scale = (0, 0, 0)
    with pytest.raises(RuntimeError, match="has a scale of"):
        render_pass(stage, tmp_path / "b.exr")
    stage.camera.scale = (1, 1, 1)
    for _ in range(2):
        picture = render_pass(stage, tmp_path / "c.exr")
        assert picture[..., :3].any()
        again = last_render(stage)
        assert once is not None
        assert again is not None
        assert (again.rays, again.cancelled) == (once.rays, once.cancelled)
