"""A renderer in a process of its own: the pictures are `render`'s, errors are sentences, and nothing stays behind."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from raytracer import render
from raytracer.bsdfs import microfacet_albedo
from raytracer.casting.caster import build
from raytracer.processes import child
from raytracer.processes.channel import Channel, ChannelClosedError
from raytracer.processes.child import describe_error
from raytracer.processes.late_pool import LatePool
from raytracer.processes.transfer import Sender
from raytracer.processes.workers import WorkerError
from raytracer.rendering import progressive
from raytracer.rendering.live import Job, Live, Painter, Report, warm_up
from raytracer.rendering.progressive import Picture, Target, refine
from raytracer.scene.camera import Camera
from raytracer.scene.lights import PointLight
from raytracer.scene.materials import Closure, Material
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Mesh
from tests.folders import ROOT
from tests.portable import is_running, kill

CAMERA = Camera(np.eye(4))
SETTINGS = {"integrator": "path", "pixel_filter": "box", "filter_width": 1.0}
TARGET = Target(CAMERA, 48, 32, samples=2, settings=SETTINGS)
ENDLESS = replace(TARGET, width=200, height=150, samples=2**20)
# Seconds; a test that waits longer has failed.
PATIENCE = 120.0


# Long enough for others to help, by any pace, and never finished.
SHARED = replace(ENDLESS, workers=2)


def make_scene(z: float = -3.0) -> Scene:
    return Scene(
        meshes=[Mesh([(-2.0, -2.0, z), (2.0, -2.0, z), (0.0, 2.0, z)], [(0, 1, 2)])],
        lights=[PointLight((1.0, 1.0, 0.0), (50.0, 50.0, 50.0), radius=0.3)],
    )


@pytest.fixture
def live() -> Iterator[Live]:
    one = Live()
    yield one
    one.close()


def wait_for(condition: Callable[[], bool]) -> None:
    end = time.perf_counter() + PATIENCE
    while not condition():
        assert time.perf_counter() < end, "waited in vain"
        time.sleep(0.002)


def wait_for_news(live: Live) -> None:
    wait_for(lambda: live.has_news)


def wait_for_last(live: Live) -> Picture:
    wait_for(lambda: live.report is not None and live.report.job == live._job and live.report.is_finished)
    picture = live.read_picture()
    assert picture is not None
    return picture


def expect(scene: Scene, target: Target) -> np.ndarray:
    film = render(replace(scene, camera=target.camera), target.width, target.height, target.samples, **target.settings)
    return film["Combined"][::-1]


def test_the_last_picture_is_that_of_render(live: Live) -> None:
    live.set_scene(make_scene())
    live.draw(TARGET, "certified")
    np.testing.assert_array_equal(wait_for_last(live).pixels, expect(make_scene(), TARGET))


def test_changes_of_scene_view_and_size_are_followed(live: Live) -> None:
    live.set_scene(make_scene())
    live.draw(ENDLESS, "certified")
    wait_for(lambda: live.report is not None)
    live.set_scene(make_scene(-5.0))
    other = replace(TARGET, width=150, height=90, camera=Camera(np.eye(4), focal_length=30.0))
    live.draw(other, "float64")
    expected = render(replace(make_scene(-5.0), camera=other.camera), 150, 90, 2, precision="float64", **SETTINGS)[
        "Combined"
    ]
    np.testing.assert_array_equal(wait_for_last(live).pixels[::-1], expected)


def test_the_same_scene_is_no_change(live: Live) -> None:
    assert live.set_scene(make_scene())
    scene = make_scene(-4.0)
    assert live.set_scene(scene)
    assert not live.set_scene(scene)


def test_many_changes_end_with_the_last(live: Live) -> None:
    for step in range(30):
        live.set_scene(make_scene(-3.0 - step / 10))
        live.draw(TARGET, "certified")
    np.testing.assert_array_equal(wait_for_last(live).pixels, expect(make_scene(-5.9), TARGET))


def test_what_cannot_be_drawn_is_said_and_does_not_last(live: Live) -> None:
    live.set_scene(make_scene())
    live.draw(replace(TARGET, settings={**SETTINGS, "max_bounces": -1}), "certified")
    wait_for(lambda: live.report is not None and live.report.is_finished)
    assert live.report is not None
    assert live.report.error == "Settings: max_bounces: expected a whole number of 0 or more, got -1"
    live.draw(TARGET, "certified")
    np.testing.assert_array_equal(wait_for_last(live).pixels, expect(make_scene(), TARGET))


def test_after_warming_up_a_principled_surface_waits_for_no_table() -> None:
    warm_up()
    made = microfacet_albedo.reflection_tables.cache_info().misses, microfacet_albedo.schlick_table.cache_info().misses
    assert min(made) > 0
    surface = replace(make_scene(), materials=[Material([Closure("principled", roughness=0.3)])], camera=CAMERA)
    render(surface, 16, 16, 1, **SETTINGS)
    found = microfacet_albedo.reflection_tables.cache_info().misses, microfacet_albedo.schlick_table.cache_info().misses
    assert found == made


def test_errors_are_sentences() -> None:
    assert describe_error(ValueError("Scene:\n no  camera")) == "Scene: no camera"
    assert describe_error(WorkerError("a worker process ended")) == "a worker process ended"
    assert describe_error(MemoryError()) == "not enough memory"
    assert describe_error(KeyError("x")) == "internal error, KeyError: 'x'"


def test_the_end_of_the_process_is_noticed(live: Live) -> None:
    live.set_scene(make_scene())
    live.draw(ENDLESS, "certified")
    kill(live.process_id)
    wait_for(lambda: not live.is_running and live.report is not None and bool(live.report.error))
    assert live.report is not None
    assert "ended unexpectedly" in live.report.error
    live.set_scene(make_scene(-4.0))  # harmless
    live.draw(TARGET, "certified")


def test_the_end_of_a_process_that_did_not_start_is_said_of_all_that_is_asked_for_later(live: Live) -> None:
    kill(live.process_id)
    wait_for(lambda: not live._threads[1].is_alive())  # it is known
    live.set_scene(make_scene())
    for _ in range(2):
        live.draw(TARGET, "certified")
        assert live.report is not None
        assert "ended unexpectedly" in live.report.error
        assert not live.is_drawing  # others need not share the workers with it


def test_a_process_that_cannot_be_started_is_said_like_one_that_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    """It was an error at each redraw of a viewport, and nothing on the screen."""

    def refuse(*_: Any, **__: Any) -> None:
        raise OSError(errno.EAGAIN, "Resource temporarily unavailable")

    monkeypatch.setattr(child, "start_process", refuse)
    live = Live()
    assert not live.is_running
    assert live.has_news
    live.set_scene(make_scene())
    live.draw(TARGET, "certified")
    assert live.read_picture() is None
    assert not live.is_drawing
    assert live.report is not None
    assert live.report.error == "the render process cannot be started: Resource temporarily unavailable"
    live.close()


def test_the_end_of_the_process_is_noticed_though_its_pipe_stays_open(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where another process was started at the same moment and got hold of it."""
    closed = threading.Event()

    def receive(_: Channel) -> Any:
        closed.wait()
        raise ChannelClosedError

    monkeypatch.setattr(Channel, "receive", receive)
    live = Live()
    try:
        live.draw(TARGET, "certified")
        kill(live.process_id)
        wait_for(lambda: live.report is not None and bool(live.report.error))
    finally:
        closed.set()
        live.close()


def test_forget_drops_pictures_and_reports(live: Live) -> None:
    live.set_scene(make_scene())
    live.draw(TARGET, "certified")
    wait_for_last(live)
    live.forget()
    assert live.report is None
    assert live.read_picture() is None
    live.set_scene(make_scene(-4.0))
    live.draw(TARGET, "certified")
    np.testing.assert_array_equal(wait_for_last(live).pixels, expect(make_scene(-4.0), TARGET))


@pytest.fixture
def painter(monkeypatch: pytest.MonkeyPatch) -> Iterator[Painter]:
    """Return a process' painter in this one, to whom every picture is long and helpers come at once."""
    load = LatePool.load

    def load_and_wait(pool: LatePool, *what: Any) -> None:
        load(pool, *what)
        wait_for(lambda: pool._loading is not None and pool._loading.done())

    monkeypatch.setattr(LatePool, "load", load_and_wait)
    monkeypatch.setattr(progressive, "LONG_SECONDS", 0.0)
    reports: list[Report] = []
    one = Painter(reports.append)
    one.reports = reports  # type: ignore[attr-defined]
    yield one
    helpers = one._helpers
    one.rest()
    wait_for(lambda: helpers is None or not helpers.process_ids)


def paint(painter: Painter, scene: Scene, target: Target) -> Report:
    painter.take(Sender().pack(scene))
    painter.paint(Job(1, target, "certified"), lambda: False)
    last: Report = painter.reports[-1]  # type: ignore[attr-defined]
    return last


def test_the_picture_is_the_same_for_any_number_of_workers(painter: Painter) -> None:
    target = replace(TARGET, width=90, height=70, samples=4)
    expected = expect(make_scene(), target)
    for workers in (1, 2, 3, 2):
        last = paint(painter, make_scene(), replace(target, workers=workers))
        assert last.is_finished
        assert last.picture is not None
        np.testing.assert_array_equal(last.picture.pixels, expected)
        if workers > 1:
            assert len(last.workers) == workers


def test_helpers_are_asked_only_where_the_finest_picture_takes_long() -> None:
    pools: list[LatePool] = []

    def find_helpers(count: int) -> LatePool:
        pools.append(LatePool(count))
        return pools[-1]

    rays = TARGET.width * TARGET.height * TARGET.samples
    scene = make_scene()
    caster = build(scene)
    for workers, pace in ((1, 1e-3), (2, 0.0), (2, 1.01 * rays / progressive.LONG_SECONDS)):
        small = replace(TARGET, workers=workers)  # too few pixels for coarse pictures, which would tell another pace
        refine(scene, caster, small, lambda picture: None, lambda: False, pace, find_helpers)
    assert not pools
    refine(scene, caster, replace(TARGET, workers=2), lambda picture: None, lambda: False, 1.0, find_helpers)
    assert [len(pool) for pool in pools] == [2]
    pools[0].close()
    wait_for(lambda: not pools[0].process_ids)


def test_helpers_of_other_processes_are_dropped_with_their_job(live: Live) -> None:
    live.set_scene(make_scene())
    live.draw(SHARED, "certified")
    wait_for(lambda: live.report is not None and len(live.report.workers) == 2)
    live.set_scene(make_scene(-5.0))
    live.draw(TARGET, "certified")
    np.testing.assert_array_equal(wait_for_last(live).pixels, expect(make_scene(-5.0), TARGET))
    assert not live.is_drawing


@pytest.mark.parametrize("end", ["close", "kill", "forget"])
def test_helpers_end_with_the_process_or_its_work(live: Live, end: str) -> None:
    live.set_scene(make_scene())
    live.draw(SHARED, "certified")
    wait_for(lambda: live.report is not None and len(live.report.workers) == 2)
    assert live.is_drawing
    assert live.report is not None
    helpers = live.report.workers
    if end == "kill":
        kill(live.process_id)
    else:
        getattr(live, end)()
    wait_for(lambda: not any(is_running(process) for process in helpers))
    assert is_running(live.process_id) == (end == "forget")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the temporary folder of this process and its children, empty."""
    found = tmp_path / "temporary"
    found.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(found))
    for name in ("TMPDIR", "TEMP", "TMP"):
        monkeypatch.setenv(name, str(found))
    return found


def test_close_leaves_nothing_behind(folder: Path) -> None:
    threads = threading.active_count()
    live = Live()
    live.set_scene(make_scene())
    live.draw(ENDLESS, "certified")
    wait_for(lambda: live.report is not None)
    held = live.read_picture()
    live.close()
    live.close()
    live.set_scene(make_scene(-4.0))
    live.draw(TARGET, "certified")
    assert not is_running(live.process_id)
    assert held is not None
    assert np.isfinite(held.pixels).all()
    assert list(folder.iterdir()) == []
    assert threading.active_count() == threads


@pytest.mark.parametrize("edits", [20, pytest.param(100, marks=pytest.mark.slow)])
def test_edits_kills_and_closes_leave_nothing_in_the_temporary_folder(folder: Path, edits: int) -> None:
    positions = np.random.default_rng(5).normal(size=(5000, 3))
    triangles = np.arange(4998).reshape(-1, 3)
    live = Live()
    for step in range(edits):
        if step % 20 == 13:
            kill(live.process_id)
        if step % 20 in (7, 13):
            live.close()
            live = Live()
        live.set_scene(replace(make_scene(), meshes=[Mesh(positions + step / 100, triangles)]))
        live.draw(replace(TARGET, width=48 + step, samples=1), "float64")
        if step % 20 == 19:
            wait_for_news(live)
            assert live.read_picture() is not None
        assert list(folder.iterdir()) == []
    live.close()
    assert list(folder.iterdir()) == []


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="processes cannot be stopped here")
def test_a_stopped_process_is_noticed_and_nothing_waits_for_it(live: Live, monkeypatch: pytest.MonkeyPatch) -> None:
    live.set_scene(make_scene())
    live.draw(TARGET, "certified")
    wait_for_last(live)
    os.kill(live.process_id, signal.SIGSTOP)
    large = np.random.default_rng(5).normal(size=(100_000, 3))
    begun = time.perf_counter()
    for step in range(200):  # more than any pipe holds
        live.set_scene(replace(make_scene(), meshes=[Mesh(large + step, [(0, 1, 2)])] if step < 5 else []))
        live.draw(replace(TARGET, settings=SETTINGS | {"seed": step}), "certified")
    assert time.perf_counter() - begun < PATIENCE / 10
    monkeypatch.setattr(child, "SILENCE_SECONDS", 1.0)
    wait_for(lambda: not live.is_running and live.report is not None and bool(live.report.error))
    assert live.report is not None
    assert live.report.error.startswith("the render process gave no sign of life for ")


def test_the_process_and_its_helpers_end_with_its_parent() -> None:
    code = (
        "import os, numpy as np; from raytracer.rendering.live import Live;"
        "from tests.raytracer.rendering.test_live import *;"
        "live = Live(); live.set_scene(make_scene()); live.draw(SHARED, 'certified');"
        "wait_for(lambda: live.report is not None and live.report.workers);"
        "print(live.process_id, *live.report.workers, flush=True); os._exit(1)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE)
    processes = [int(word) for word in done.stdout.split()]
    assert len(processes) == 3
    wait_for(lambda: not any(is_running(process) for process in processes))
