"""Render processes of a session: started once, for pictures that are worth it, and never left behind."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

import addon
from addon.engine import engine, worker_pool
from addon.engine.statistics import last_render
from raytracer.processes.workers import WorkerError, Workers
from tests.addon.engine.engine_fixtures import HEIGHT, WIDTH, add_plane, make_stage, read_image, render_pass
from tests.folders import ROOT
from tests.portable import is_running, kill

pytestmark = pytest.mark.usefixtures("registered_addon")


@pytest.fixture
def stage(empty_scene: Any) -> Iterator[Any]:
    """Return a scene of one plane, of few samples more than what is worth processes, with two of them."""
    make_stage(empty_scene)
    add_plane(empty_scene.collection, "Plane", (0.5, 0.25, 0.125), (-8.0, 3.0), (-4.0, 5.0))
    empty_scene.reference_raytracer.samples = -(-worker_pool.SMALLEST_PICTURE // (WIDTH * HEIGHT))
    empty_scene.reference_raytracer.workers = 2
    yield empty_scene
    worker_pool.close()


def find_processes() -> list[int]:
    """Return the ids of the session's processes."""
    return worker_pool._Session.workers.process_ids if worker_pool._Session.workers else []


def wait_until(happens: Any) -> None:
    end = time.monotonic() + 30.0
    while not happens():
        assert time.monotonic() < end
        time.sleep(0.02)


def test_renders_and_frames_share_the_processes(stage: Any, tmp_path: Path) -> None:
    picture = render_pass(stage, tmp_path / "first.exr")
    processes = find_processes()
    assert len(processes) == 2
    np.testing.assert_array_equal(render_pass(stage, tmp_path / "second.exr"), picture)
    stage.frame_end = 3
    stage.render.filepath = str(tmp_path / "frame_")
    bpy.ops.render.render(animation=True, scene=stage.name)
    assert find_processes() == processes
    assert list(worker_pool._Session.workers.run([0])) == [None]  # no scene is left in them
    stage.reference_raytracer.workers = 1
    np.testing.assert_array_equal(render_pass(stage, tmp_path / "alone.exr"), picture)


def test_a_small_picture_starts_none(stage: Any, tmp_path: Path) -> None:
    stage.reference_raytracer.samples -= 1
    render_pass(stage, tmp_path / "picture.exr")
    assert not find_processes()


def test_another_number_of_workers_takes_new_processes(stage: Any, tmp_path: Path) -> None:
    render_pass(stage, tmp_path / "picture.exr")
    before = find_processes()
    stage.reference_raytracer.workers = 3
    render_pass(stage, tmp_path / "picture.exr")
    assert len(find_processes()) == 3
    assert not any(map(is_running, before))


def test_processes_end_after_a_while_without_renders(
    stage: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(worker_pool, "IDLE_SECONDS", 0.2)
    render_pass(stage, tmp_path / "picture.exr")
    processes = find_processes()
    wait_until(lambda: not any(map(is_running, processes)))
    wait_until(lambda: not find_processes())
    render_pass(stage, tmp_path / "picture.exr")


def test_processes_that_are_lent_do_not_end_as_their_time_is_over() -> None:
    with worker_pool.lend(2, worker_pool.SMALLEST_PICTURE, print) as workers:
        worker_pool._end_idle()
        assert all(map(is_running, workers.process_ids))
    worker_pool.close()


def test_processes_end_with_the_add_on(stage: Any, tmp_path: Path) -> None:
    render_pass(stage, tmp_path / "picture.exr")
    processes = find_processes()
    addon.unregister()
    try:
        assert processes
        assert not any(map(is_running, processes))
    finally:
        addon.register()


def test_killed_processes_are_replaced(stage: Any, tmp_path: Path) -> None:
    picture = render_pass(stage, tmp_path / "picture.exr")
    for process in find_processes():
        kill(process)
    np.testing.assert_array_equal(render_pass(stage, tmp_path / "again.exr"), picture)


def test_after_an_error_the_next_render_has_new_processes(
    stage: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    render_pass(stage, tmp_path / "picture.exr")
    before = find_processes()

    def fail(*_: Any) -> None:
        raise RuntimeError("broken")

    with monkeypatch.context() as patch:
        patch.setattr(engine.Progress, "show_share", fail)
        with pytest.raises(RuntimeError, match="broken"):
            render_pass(stage, tmp_path / "picture.exr")
    assert not any(map(is_running, before))
    render_pass(stage, tmp_path / "picture.exr")
    assert len(find_processes()) == 2


def test_processes_lost_after_the_last_sample_cost_no_picture(
    stage: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    picture = render_pass(stage, tmp_path / "picture.exr")
    load = Workers.load

    def lose(workers: Workers, factory: Any, *arguments: Any) -> None:
        if factory is worker_pool._hold_nothing:
            raise WorkerError("a worker process ended unexpectedly")
        load(workers, factory, *arguments)

    with monkeypatch.context() as patch:
        patch.setattr(Workers, "load", lose)
        np.testing.assert_array_equal(render_pass(stage, tmp_path / "again.exr"), picture)
    assert not find_processes()
    np.testing.assert_array_equal(render_pass(stage, tmp_path / "anew.exr"), picture)


def test_processes_that_are_lost_for_good_leave_what_is_traced(
    stage: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They took the picture with them, and all of its samples."""
    run = Workers.run

    def lose(workers: Workers, jobs: Any, *arguments: Any) -> Iterator[Any]:
        for number, result in enumerate(run(workers, jobs, *arguments)):
            if number == 1:
                raise WorkerError("a worker process ended unexpectedly (exit code -9)")
            yield result

    monkeypatch.setattr(Workers, "run", lose)
    stage.render.filepath = str(tmp_path / "lost.png")
    with pytest.raises(RuntimeError, match="a worker process ended unexpectedly"):
        bpy.ops.render.render(write_still=True)
    assert not find_processes()
    taken = last_render(stage)
    assert taken is not None
    assert taken.cancelled
    assert 0 < taken.samples < stage.reference_raytracer.samples
    bpy.data.images["Render Result"].save_render(str(tmp_path / "seen.png"))
    assert read_image(tmp_path / "seen.png")[HEIGHT // 2, WIDTH // 2, 0] > 0.1


def test_a_render_beside_another_one_has_processes_of_its_own() -> None:
    stages: list[str] = []
    with worker_pool.lend(2, worker_pool.SMALLEST_PICTURE, stages.append) as workers:
        assert len(workers) == 2
        with worker_pool.lend(2, worker_pool.SMALLEST_PICTURE, stages.append) as count:
            assert count == 2
    assert stages == ["Starting 2 workers"]
    worker_pool.close()


RENDER = """
import sys, bpy, addon
addon.register()
bpy.ops.wm.open_mainfile(filepath=sys.argv[1], load_ui=False)
bpy.ops.render.render()
from addon.engine import worker_pool
print("processes", *worker_pool._Session.workers.process_ids, flush=True)
if len(sys.argv) > 2:
    sys.stdin.read()
"""


@pytest.mark.parametrize("is_killed", [False, True])
def test_no_process_outlives_blender(stage: Any, tmp_path: Path, is_killed: bool) -> None:
    blend = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), check_existing=False)
    command = [sys.executable, "-c", RENDER, str(blend), *(["wait"] if is_killed else [])]
    with subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as blender:
        assert blender.stdout is not None
        line = next(line for line in blender.stdout if line.startswith("processes"))
        processes = [int(number) for number in line.split()[1:]]
        if is_killed:
            kill(blender.pid)
        assert blender.wait(60) == 0 or is_killed
    assert len(processes) == 2
    wait_until(lambda: not any(map(is_running, processes)))
