"""A renderer in a process of its own: the pictures are `render`'s, errors are sentences, and nothing stays behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from raytracer import render
from raytracer.bsdfs import microfacet_albedo
from raytracer.processes import child
from raytracer.processes.child import describe_error
from raytracer.rendering.live import Live, warm_up
from raytracer.rendering.progressive import Picture, Target
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


def test_the_process_ends_with_its_parent() -> None:
    code = (
        "import os, numpy as np; from raytracer.rendering.live import Live;"
        "from tests.raytracer.rendering.test_live import *;"
        "live = Live(); live.set_scene(make_scene()); live.draw(ENDLESS, 'certified');"
        "wait_for(lambda: live.report is not None); print(live.process_id, flush=True); os._exit(1)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE)
    process = int(done.stdout)
    wait_for(lambda: not is_running(process))
