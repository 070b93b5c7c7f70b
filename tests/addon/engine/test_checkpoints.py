"""Checkpoints of stills: a render that was stopped goes on from its file, one that does not fit is refused by name."""

from __future__ import annotations

import errno
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest

from addon.engine import checkpoints, engine, orders
from addon.engine.output import RenderOutput
from addon.engine.statistics import last_render
from addon.panels.resume import RAYTRACER_OT_resume_render
from raytracer.film.film_file import load_film
from raytracer.rendering import checkpoints as writing
from tests.addon.engine.engine_fixtures import HEIGHT, WIDTH, add_plane, make_stage, render_pass
from tests.folders import ROOT
from tests.portable import kill

SAMPLES = 6

pytestmark = pytest.mark.usefixtures("registered_addon")


@pytest.fixture
def stage(empty_scene: Any, tmp_path: Path) -> Any:
    """Return a scene of one plane that keeps checkpoints in the test's folder, and traces a sample at a time."""
    make_stage(empty_scene)
    add_plane(empty_scene.collection, "Plane", (0.5, 0.25, 0.125), (-8.0, 3.0), (-4.0, 5.0))
    settings = empty_scene.reference_raytracer
    settings.samples, settings.pixel_filter, settings.filter_width = SAMPLES, "BLACKMAN_HARRIS", 1.5
    settings.use_checkpoints, settings.checkpoint_folder = True, str(tmp_path / "kept")
    return empty_scene


@pytest.fixture
def stop(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return a function that presses Esc as a render has some of its samples, or never; it returns the list of the
    sweeps that are done from then on."""
    trace = engine.trace

    def stop_at(samples: int = SAMPLES) -> list[int]:
        done: list[int] = []

        def trace_some(*arguments: Any) -> Any:
            *others, render = arguments

            def render_some(*positional: Any, **keywords: Any) -> Any:
                asked = {
                    "on_sweep": lambda film, count, total: done.append(count),
                    "is_cancelled": lambda: samples in done and samples < SAMPLES,
                }
                return render(*positional, **{**keywords, **asked}, block_size=WIDTH * HEIGHT)

            return trace(*others, render_some)

        monkeypatch.setattr(engine, "trace", trace_some)
        return done

    return stop_at


def list_names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def resume(scene: Any, path: Path, layer: str = "") -> Any:
    """Return the picture of a render that goes on from the files, as the menu's item begins it."""
    checkpoints.resume()
    return render_pass(scene, path, layer=layer)


def render_without_memory(monkeypatch: pytest.MonkeyPatch, owner: Any, name: str) -> None:
    """Render the scene, which fails as a function of a module or class is called."""

    def fail(*arguments: object, **keywords: object) -> None:
        raise MemoryError

    with monkeypatch.context() as patch:
        patch.setattr(owner, name, fail)
        with pytest.raises(RuntimeError, match="not enough memory"):
            bpy.ops.render.render()


def test_a_stopped_render_goes_on_from_its_file(stage: Any, stop: Any, tmp_path: Path) -> None:
    stop()
    whole = render_pass(stage, tmp_path / "whole.exr")
    assert list_names(tmp_path / "kept") == []  # a complete one leaves no file
    stop(2)
    some = render_pass(stage, tmp_path / "some.exr")
    assert (some != whole).any()
    assert bpy.ops.raytracer.resume_render.poll()
    (path,) = checkpoints.list_files(stage)
    assert load_film(path).samples == 2
    stop()
    np.testing.assert_array_equal(resume(stage, tmp_path / "resumed.exr"), whole)
    assert list_names(tmp_path / "kept") == []
    assert not bpy.ops.raytracer.resume_render.poll()


def test_resume_traces_only_what_is_missing(stage: Any, stop: Any, tmp_path: Path) -> None:
    stop()
    render_pass(stage, tmp_path / "whole.exr")
    rays = last_render(stage).rays
    stop(4)
    render_pass(stage, tmp_path / "some.exr")
    done = stop()
    assert bpy.ops.raytracer.resume_render() == {"FINISHED"}
    assert done == [5, 6]
    assert last_render(stage).rays == rays  # those of both


def test_a_render_begins_anew_without_being_asked_to_resume(stage: Any, stop: Any, tmp_path: Path) -> None:
    stop(4)
    render_pass(stage, tmp_path / "some.exr")
    (path,) = checkpoints.list_files(stage)
    stage.reference_raytracer.seed = 1  # another picture, which is no error
    stop(2)
    render_pass(stage, tmp_path / "other.exr")
    assert load_film(path).samples == 2


def test_a_render_in_place_of_resume_costs_nothing_where_it_is_stopped(stage: Any, stop: Any, tmp_path: Path) -> None:
    """It removed the hours of the one before as it began."""
    stop(4)
    render_pass(stage, tmp_path / "some.exr")
    (path,) = checkpoints.list_files(stage)
    stop(2)
    render_pass(stage, tmp_path / "mistaken.exr")
    assert load_film(path).samples == 4
    stop(5)
    render_pass(stage, tmp_path / "more.exr")
    assert load_film(path).samples == 5
    assert list_names(tmp_path / "kept") == [path.name]


def test_a_render_that_breaks_before_its_first_write_leaves_the_file_of_the_one_before(
    stage: Any, stop: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """There was none any more to go on from."""
    stop()
    whole = render_pass(stage, tmp_path / "whole.exr")
    stop(4)
    render_pass(stage, tmp_path / "some.exr")
    render_without_memory(monkeypatch, orders, "render_into")
    assert bpy.ops.raytracer.resume_render.poll()
    done = stop()
    np.testing.assert_array_equal(resume(stage, tmp_path / "resumed.exr"), whole)
    assert done == [5, 6]
    assert list_names(tmp_path / "kept") == []


def test_a_changed_setting_or_scene_is_refused_by_name(stage: Any, stop: Any, tmp_path: Path) -> None:
    stop(2)
    render_pass(stage, tmp_path / "some.exr")
    (path,) = checkpoints.list_files(stage)
    stop()
    stage.reference_raytracer.seed = 7
    with pytest.raises(RuntimeError, match=r"checkpoint\.npz is of another picture: seed is 0, not 7$"):
        bpy.ops.raytracer.resume_render()
    stage.reference_raytracer.seed = 0
    bpy.data.objects["Plane"].location.x = 1.0
    with pytest.raises(RuntimeError, match="is of another picture: the scene differs in its"):
        bpy.ops.raytracer.resume_render()
    assert path.is_file()  # what was rendered is not lost by asking


def test_nothing_is_kept_unless_the_scene_asks_for_it(stage: Any, stop: Any, tmp_path: Path) -> None:
    stage.reference_raytracer.use_checkpoints = False
    stop(2)
    render_pass(stage, tmp_path / "some.exr")
    assert not (tmp_path / "kept").exists()
    assert not bpy.ops.raytracer.resume_render.poll()


def test_a_folder_that_takes_no_file_is_told_before_the_render(stage: Any, tmp_path: Path) -> None:
    (tmp_path / "kept").write_bytes(b"")
    with pytest.raises(RuntimeError, match="Checkpoints: "):
        render_pass(stage, tmp_path / "whole.exr")


def test_a_disk_that_gets_full_costs_the_checkpoint_and_not_the_picture(
    stage: Any, stop: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stop()
    whole = render_pass(stage, tmp_path / "whole.exr")
    faults: list[object] = []

    def fail(film: object, path: Path) -> None:
        faults.append(path)
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr(writing, "save_film", fail)
    np.testing.assert_array_equal(render_pass(stage, tmp_path / "again.exr"), whole)
    assert faults


def test_a_file_that_cannot_be_removed_costs_no_picture(
    stage: Any, stop: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    stop()
    whole = render_pass(stage, tmp_path / "whole.exr")
    unlink = Path.unlink

    def refuse(path: Path, missing_ok: bool = False) -> None:
        if path.name.endswith(checkpoints.SUFFIX) and path.exists():
            raise PermissionError(errno.EACCES, "Permission denied", str(path))  # a virus scanner reads it, on Windows
        unlink(path, missing_ok)

    monkeypatch.setattr(Path, "unlink", refuse)
    np.testing.assert_array_equal(render_pass(stage, tmp_path / "again.exr"), whole)
    assert "Checkpoint not removed: " in capfd.readouterr().out


def test_a_resumed_render_that_could_not_begin_leaves_the_next_one_alone(stage: Any, stop: Any, tmp_path: Path) -> None:
    stop(2)
    render_pass(stage, tmp_path / "some.exr")
    stage.camera = None
    reports: list[str] = []
    operator = SimpleNamespace(report=lambda kind, text: reports.append(text))
    assert RAYTRACER_OT_resume_render.invoke(operator, bpy.context, None) == {"CANCELLED"}
    assert "camera" in "".join(reports)
    assert not checkpoints._Session.is_resuming


def test_view_layers_each_have_a_file_until_the_last_is_done(stage: Any, stop: Any, tmp_path: Path) -> None:
    stage.view_layers.new("Second")
    stop()
    whole = render_pass(stage, tmp_path / "whole.exr", layer="Second")
    assert list_names(tmp_path / "kept") == []
    stop(2)
    render_pass(stage, tmp_path / "some.exr", layer="Second")
    assert len(checkpoints.list_files(stage)) == 2
    stop()
    np.testing.assert_array_equal(resume(stage, tmp_path / "resumed.exr", "Second"), whole)
    assert list_names(tmp_path / "kept") == []


def test_a_scene_that_was_never_saved_keeps_its_file_in_the_temporary_folder(
    stage: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(checkpoints.tempfile, "gettempdir", lambda: str(tmp_path))
    stage.reference_raytracer.checkpoint_folder = "//"
    path = checkpoints.find_path(stage, "ViewLayer")
    assert path.parent == tmp_path
    assert path.name.startswith("untitled_0001_")
    stage.frame_set(12)
    assert checkpoints.find_path(stage, "ViewLayer").name.startswith("untitled_0012_")


def test_a_traced_picture_that_does_not_reach_blender_can_be_resumed(
    stage: Any, stop: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The file went as the last sample was traced, before the picture was anywhere."""
    stop()
    render_without_memory(monkeypatch, RenderOutput, "write_film")
    (path,) = checkpoints.list_files(stage)
    assert load_film(path).samples == SAMPLES
    seen: list[bool] = []
    post = bpy.app.handlers.render_post
    post.append(lambda *_: seen.append(path.exists()))
    try:
        resume(stage, tmp_path / "resumed.exr")
    finally:
        post.pop()
    assert seen == [True]  # Blender has composited, and is about to write
    assert not path.exists()


@pytest.fixture
def use_name(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return a function that has the open file another name."""

    def set_name(filepath: str) -> None:
        data = SimpleNamespace(filepath=filepath)
        monkeypatch.setattr(checkpoints, "bpy", SimpleNamespace(data=data, path=bpy.path))

    return set_name


def test_files_of_one_name_in_one_folder_have_their_own(
    stage: Any, use_name: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of two shots, or of two users of a temporary folder: the second's render removed the first's hours."""
    paths = []
    for name in ("/shots/010/scene.blend", "/shots/020/scene.blend", ""):
        use_name(name)
        paths += [checkpoints.find_path(stage, "ViewLayer"), checkpoints.find_path(stage, "ViewLayer", "left")]
    stage.reference_raytracer.checkpoint_folder = "//"
    for user in (1, 2):
        monkeypatch.setattr(checkpoints, "find_user", lambda user=user: user)
        paths.append(checkpoints.find_path(stage, "ViewLayer"))
    assert len(set(paths)) == len(paths)
    assert len({path.parent for path in paths[:6]}) == 1


def test_a_long_name_has_room_for_the_rest_and_differs_by_its_end(stage: Any, use_name: Any, tmp_path: Path) -> None:
    """A name of 80 Japanese letters was too long a file name with what tells it apart."""
    stage.frame_set(123456)
    names = ["\u5f71" * 78 + ending for ending in ("a", "b")]
    paths = []
    for folder in ("//", str(tmp_path)):
        stage.reference_raytracer.checkpoint_folder = folder
        for name in names:
            use_name(f"/shots/{name}.blend")
            paths.append(checkpoints.find_path(stage, "ViewLayer").name)
    assert len(set(paths)) == 4
    assert max(len(path.encode()) for path in paths) <= 255


RENDER = """
import sys, bpy, addon
addon.register()
bpy.ops.wm.open_mainfile(filepath=sys.argv[1], load_ui=False)
bpy.ops.render.render()
"""


@pytest.mark.slow
def test_a_render_that_was_killed_is_resumed_from_the_file_beside_its_blend(stage: Any, tmp_path: Path) -> None:
    settings = stage.reference_raytracer
    settings.samples, settings.checkpoint_folder, settings.checkpoint_interval = 30_000, "//", 1
    blend = tmp_path / "long.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), check_existing=False)
    with subprocess.Popen([sys.executable, "-c", RENDER, str(blend)], cwd=ROOT) as process:
        while not list(tmp_path.glob("long_0001_*.checkpoint.npz")):
            assert process.poll() is None
            time.sleep(0.05)
        kill(process.pid)
    bpy.ops.wm.open_mainfile(filepath=str(blend), load_ui=False)
    scene = bpy.context.scene
    (path,) = checkpoints.list_files(scene)
    film = load_film(path)
    assert 0 < film.samples < 30_000
    assert bpy.ops.raytracer.resume_render() == {"FINISHED"}
    assert not path.exists()
    assert last_render(scene).samples == 30_000
    assert last_render(scene).rays > film.statistics.rays
