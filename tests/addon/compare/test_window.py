"""Comparisons as operators: outcome, map and list; nothing of the user's changes; verdicts in exact arithmetic."""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest

import addon
from addon.compare import results
from addon.compare.ray_cast.rays import Aimed
from addon.compare.window import color_bar, describe, heat_map, job, operators, session
from addon.inspector import operators as picking
from addon.inspector import session as inspector
from raytracer.processes.folders import OwnedFolder
from tests.addon.compare.comparison_fixtures import stage
from tests.addon.engine.engine_fixtures import HEIGHT, WIDTH
from tests.addon.inspector.test_inspector import describe_scene

__all__ = ["stage"]  # a fixture

LETTERS = 40  # in a line of a panel


def test_comparing_with_cycles_finds_agreement_and_changes_nothing(stage: Any) -> None:
    stage.render.engine = "BLENDER_WORKBENCH"
    before, images = describe_scene(stage), set(bpy.data.images.keys())
    objects = {thing.name: list(thing.matrix_world) for thing in stage.objects}
    assert bpy.ops.raytracer.compare_cycles(width=WIDTH, samples=8) == {"FINISHED"}
    outcome = session.find_outcome()
    assert outcome is not None
    assert (outcome.kind, outcome.heat.shape) == ("cycles", (HEIGHT, WIDTH))
    assert outcome.numbers["z_fail_share"] == 0.0
    headline, icon, lines = describe.describe_outcome(outcome.kind, outcome.numbers, LETTERS)
    assert (headline, icon) in (("Agrees with Cycles", "CHECKMARK"), ("Too few samples to tell", "QUESTION"))
    assert " ".join(lines).lower() == outcome.numbers["reason"].lower()
    assert max(map(len, lines)) <= LETTERS
    assert all(share == 0.0 for share in outcome.numbers["passes"].values())
    assert describe_scene(stage) == before
    assert {thing.name: list(thing.matrix_world) for thing in stage.objects} == objects
    assert set(bpy.data.images.keys()) - images == {heat_map.IMAGE_NAME}
    assert tuple(bpy.data.images[heat_map.IMAGE_NAME].size) == (WIDTH, HEIGHT)
    assert bpy.data.filepath == ""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    assert outcome.worst
    for entry in outcome.worst:  # the camera looks straight down, a pixel per unit length
        above = (entry.x + 0.5 - WIDTH / 2, entry.y + 0.5 - HEIGHT / 2, 10.0)
        seen = stage.ray_cast(depsgraph, above, (0, 0, -1))[4]
        assert (entry.place, entry.object) == (f"{entry.x}, {entry.y}", seen.name if seen else "nothing")


def test_comparing_with_ray_cast_lists_rays_that_can_be_inspected(stage: Any) -> None:
    assert bpy.ops.raytracer.compare_ray_cast(width=WIDTH, rays=100) == {"FINISHED"}
    outcome, state = session.find_outcome(), bpy.context.window_manager.reference_raytracer_comparison
    assert outcome is not None
    numbers = outcome.numbers
    assert numbers["rays"] == WIDTH * HEIGHT + 300
    assert numbers["ours_wrong"] == 0
    assert describe.describe_outcome(outcome.kind, numbers, LETTERS)[:2] == ("Right by exact arithmetic", "CHECKMARK")
    assert [(row.apart, row.place, row.object, row.ours, row.theirs) for row in state.worst] == [
        entry.columns for entry in outcome.worst
    ]
    assert {entry.object for entry in outcome.worst} <= {"Plane", "nothing"}
    assert not state.is_running
    assert outcome.worst
    for index, entry in enumerate(outcome.worst[:3]):
        state.worst_index = index
        verdicts = session.find_verdicts()
        assert verdicts is not None
        assert verdicts[0].is_right
        np.testing.assert_array_equal(verdicts[0].origin, entry.origin)
        lines = [*describe.describe_exact(verdicts[0]), *describe.describe_verdict(verdicts[1])]
        assert all(name and all(values) for name, values in lines)
        assert len(bpy.context.window_manager.reference_raytracer.rays) >= 1
        inspected = inspector.find_inspected()
        assert inspected is not None
        assert session.find_verdicts_on(inspected.tree[0]) == verdicts
        assert all(session.find_verdicts_on(ray) is None for ray in inspected.tree[1:])


def test_a_list_is_of_the_scene_that_was_compared_and_says_what_goes_wrong(stage: Any) -> None:
    """Every scene showed it, and a click inspected the pixel of any; errors of clicks reached the console alone."""
    assert bpy.ops.raytracer.compare_ray_cast(width=WIDTH, rays=1) == {"FINISHED"}
    other, state = bpy.data.scenes.new("Other"), bpy.context.window_manager.reference_raytracer_comparison
    assert session.find_outcome(stage) is session.find_outcome() is not None
    assert session.find_outcome(other) is None
    before = inspector.find_inspected()
    session.inspect_worst(SimpleNamespace(scene=other), 0)
    assert inspector.find_inspected() is before
    stage.camera.scale = (0.0, 0.0, 0.0)
    bpy.context.view_layer.update()
    state.worst_index = 1
    assert session.find_trouble().startswith("Camera 'Camera' has a scale of")
    stage.camera.scale = (1.0, 1.0, 1.0)
    bpy.context.view_layer.update()
    state.worst_index = 0
    assert session.find_trouble() == ""


@pytest.mark.parametrize("kind", ["cycles", "ray_cast"])
def test_a_difference_is_said_in_words(kind: str) -> None:
    headline, icon, lines = describe.describe_outcome(kind, {"verdict": "differs", "reason": "depth is off"}, LETTERS)
    assert headline.split()[0] == ("Differs" if kind == "cycles" else "Wrong")
    assert (icon, lines) == ("ERROR", ["Depth is off"])


def test_between_two_frames_what_is_there_is_compared(stage: Any) -> None:
    for frame, place in ((1, 0.0), (2, 2.0)):
        stage.camera.location.x = place
        stage.camera.keyframe_insert("location", frame=frame)
    stage.frame_set(1, subframe=0.5)
    middle = stage.camera.location.x
    assert 0.0 < middle < 2.0
    assert bpy.ops.raytracer.compare_ray_cast(width=WIDTH, rays=1) == {"FINISHED"}
    outcome = session.find_outcome()
    assert outcome is not None
    places = [(entry.origin[0], entry.x) for entry in outcome.worst if entry.x >= 0]
    assert places
    for origin, column in places:
        assert origin == pytest.approx(middle + column + 0.5 - WIDTH / 2)


def test_failure_is_one_sentence(stage: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(job, "CHILD", job.CHILD.with_name("nothing.py"))
    with pytest.raises(RuntimeError, match=r"^Error: Blender ended with code 2: .*nothing\.py.*\n?$"):
        bpy.ops.raytracer.compare_ray_cast(width=16, rays=1)
    assert operators._running is None
    assert not bpy.context.window_manager.reference_raytracer_comparison.is_running
    assert bpy.ops.raytracer.compare_ray_cast.poll()


def test_stopping_ends_the_process_and_removes_its_files(stage: Any) -> None:
    running = job.Running(stage, bpy.context.view_layer, "cycles", (WIDTH, HEIGHT), 4096)
    operators._running = running
    assert not bpy.ops.raytracer.compare_cycles.poll()
    assert running.folder.is_dir()
    assert not running.is_done()
    assert bpy.ops.raytracer.cancel_compare() == {"FINISHED"}
    assert running.is_done()
    assert not running.folder.exists()


def test_progress_that_is_being_written_is_that_of_before(
    stage: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On Windows a file that is put in another's place cannot be read at that moment."""
    running = object.__new__(job.Running)
    running.folder = tmp_path
    assert running.read_progress() == 0.0
    (tmp_path / "progress.txt").write_text("0.5", encoding="utf-8")
    assert running.read_progress() == 0.5

    def refuse(path: Path, encoding: str) -> str:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "read_text", refuse)
    assert running.read_progress() == 0.5


def test_a_comparison_that_blender_ends_leaves_no_timer(stage: Any) -> None:
    """As before another file is loaded into the same windows, whose timers go on."""
    removed: list[object] = []
    context = SimpleNamespace(window_manager=SimpleNamespace(event_timer_remove=removed.append))
    operator = SimpleNamespace(_timer="timer")
    operators.RAYTRACER_OT_compare_cycles.cancel(operator, context)
    assert removed == ["timer"]


def test_operators_that_wait_leave_nothing_when_the_addon_goes(stage: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Blender does not cancel them: a timer, a cursor and a text in the status bar stayed."""
    told: list[object] = []
    monkeypatch.setattr(operators, "end_timer", lambda manager, timer: told.append(timer))
    monkeypatch.setattr(operators, "_timer", "timer")
    window = SimpleNamespace(cursor_modal_restore=lambda: told.append("cursor"))
    monkeypatch.setattr(picking, "_places", (window, SimpleNamespace(status_text_set=told.append)))
    addon.unregister()
    assert sorted(map(str, told)) == ["None", "cursor", "timer"]
    assert picking._places is None
    addon.register()


def test_the_process_of_a_comparison_ends_with_its_parent(stage: Any) -> None:
    running = job.Running(stage, bpy.context.view_layer, "cycles", (WIDTH, HEIGHT), 4096)
    try:
        progress = running.folder / "progress.txt"
        end = time.perf_counter() + 120.0
        while not progress.exists():
            assert time.perf_counter() < end
            assert not running.is_done()
            time.sleep(0.05)
        assert running._process.stdin is not None
        running._process.stdin.close()  # as the system does for a parent that was killed
        assert running._process.wait(timeout=10.0) == 1
    finally:
        running.close()


def test_scene_without_camera_cannot_be_compared(stage: Any) -> None:
    stage.camera = None
    assert not bpy.ops.raytracer.compare_cycles.poll()


def test_worst_pixels_are_sorted_and_apart() -> None:
    heat = np.zeros((20, 30))
    heat[4, 5], heat[5, 6], heat[19, 29], heat[0, 0] = 0.9, 0.8, 0.7, 0.1
    assert results.find_worst(heat) == [(4, 5, 0.9), (19, 29, 0.7), (0, 0, 0.1)]
    assert results.find_worst(np.zeros((3, 3))) == []


def test_ray_that_hits_different_surfaces_is_brightest_where_its_pixel_is() -> None:
    width, height, odd, far = 4, 3, 2, 9  # camera rays are numbered from the lower left corner; one other ray follows
    count = width * height + 1
    target, other, error = np.zeros(count, dtype=int), np.zeros(count, dtype=int), np.zeros(count)
    other[odd], error[far] = 1, 0.25
    comparison = SimpleNamespace(
        rays=Aimed(np.zeros((count, 3)), np.ones((count, 3)), np.array(["camera"] * (count - 1) + ["edge"])),
        ours=SimpleNamespace(target=target, polygon=np.full(count, 3)),
        blender=SimpleNamespace(target=other, polygon=np.full(count, 5)),
        agreeing=target == other,
        position_error=error,
        summarise=dict,
    )
    outcome = results.make_ray_cast_outcome(comparison, width, height, {0: "Wall", 1: "Post"})
    assert outcome.heat[2, 2] == 1.0  # the lowest row is the last
    assert outcome.heat[0, 1] == results.LARGEST_HEAT
    assert np.count_nonzero(outcome.heat) == 2
    assert [(entry.x, entry.y) for entry in outcome.worst] == [(2, 0), (1, 2)]
    assert [entry.columns for entry in outcome.worst] == [
        ("surfaces", "2, 0", "Wall", "polygon 3", "Post, polygon 5"),
        ("2.50e-01 m", "1, 2", "Wall", "polygon 3", "polygon 5"),
    ]
    assert outcome.gain == 1.0


@pytest.mark.parametrize(("largest", "gain"), [(1.0, 1.0), (0.5, 2.0), (0.06, 10.0), (0.0011, 500.0), (0.0, 5000.0)])
def test_map_is_brightened_until_its_brightest_is_white(largest: float, gain: float) -> None:
    heat = np.full((4, 5), largest, dtype=np.float32)
    outcome = results.Outcome("cycles", {}, heat, [])
    assert outcome.gain == gain
    assert describe.describe_map(outcome).endswith(f"white is {1 / gain:g} or more")
    assert color_bar.list_marks(gain)[::4] == ["0", f"{1 / gain:g}"]


def test_heat_map_has_the_top_row_on_top(stage: Any) -> None:
    heat = np.zeros((3, 5), dtype=np.float32)
    heat[0] = 1.0  # the top row
    image = heat_map.show_heat_map(heat)
    pixels = np.array(image.pixels[:]).reshape(3, 5, 4)
    np.testing.assert_array_equal(pixels[2], np.ones((5, 4)))  # Blender's last row is the top one
    np.testing.assert_array_equal(pixels[:2, :, :3], np.zeros((2, 5, 3)))
    assert heat_map.show_heat_map(np.ones((4, 4), dtype=np.float32)) == image
    assert tuple(image.size) == (4, 4)


def test_heat_map_takes_the_place_of_one_whose_file_is_gone(stage: Any, tmp_path: Path) -> None:
    image = heat_map.show_heat_map(np.zeros((3, 5), dtype=np.float32))
    image.filepath_raw, image.file_format = str(tmp_path / "map.png"), "PNG"
    image.save()
    (tmp_path / "map.png").unlink()
    image.reload()
    shown = heat_map.show_heat_map(np.ones((4, 6), dtype=np.float32))
    assert (shown.name, tuple(shown.size)) == (heat_map.IMAGE_NAME, (6, 4))
    np.testing.assert_array_equal(shown.pixels[:], np.ones(4 * 4 * 6))


def test_a_comparison_that_cannot_begin_says_why_and_leaves_no_files(
    stage: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class FullFolder(OwnedFolder):
        def __init__(self, prefix: str) -> None:
            super().__init__(prefix)
            (self.path / "scene.blend").mkdir()  # in whose place no file can be written

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(job, "OwnedFolder", FullFolder)
    with pytest.raises(RuntimeError, match=r"^Error: (?!Python).*scene\.blend.*\n?$"):
        bpy.ops.raytracer.compare_cycles(width=16, samples=1)
    assert list(tmp_path.iterdir()) == []
    assert operators._running is None
    assert not bpy.context.window_manager.reference_raytracer_comparison.is_running


def test_a_comparison_begins_whatever_a_script_put_among_the_import_paths(
    stage: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "path", [*sys.path, tmp_path])  # Python passes over what is no text
    running = job.Running(stage, bpy.context.view_layer, "ray_cast", (WIDTH, HEIGHT), 16)
    running.close()
    assert str(tmp_path) not in map(str, running.job.paths)
