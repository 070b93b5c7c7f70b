"""A renderer in a process of its own: the pictures are `render`'s, errors are sentences, and nothing stays behind."""

from __future__ import annotations

import os
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
from raytracer.rendering.live import Live, describe_error, warm_up
from raytracer.rendering.progressive import Picture, Target
from raytracer.scene.camera import Camera
from raytracer.scene.lights import PointLight
from raytracer.scene.materials import Closure, Material
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Mesh
from tests.folders import ROOT

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


def wait_for_last(live: Live) -> Picture:
    wait_for(lambda: live.report is not None and live.report.job == live._job and live.report.is_finished)
    picture = live.read_picture()
    assert picture is not None
    return picture


def expect(scene: Scene, target: Target) -> np.ndarray:
    film = render(replace(scene, camera=target.camera), target.width, target.height, target.samples, **target.settings)
    return film["Combined"][::-1]


def is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


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
    live._process.kill()
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


def test_close_leaves_nothing_behind() -> None:
    threads = threading.active_count()
    live = Live()
    live.set_scene(make_scene())
    live.draw(ENDLESS, "certified")
    wait_for(lambda: live.report is not None)
    folder = Path(live._directory.name)
    live.close()
    live.close()
    live.set_scene(make_scene(-4.0))
    live.draw(TARGET, "certified")
    assert not is_alive(live.process_id)
    assert not folder.exists()
    assert threading.active_count() == threads


def test_the_process_ends_with_its_parent() -> None:
    code = (
        "import os, numpy as np; from raytracer.rendering.live import Live;"
        "from tests.raytracer.rendering.test_live import *;"
        "live = Live(); live.set_scene(make_scene()); live.draw(ENDLESS, 'certified');"
        "wait_for(lambda: live.report is not None); print(live.process_id, flush=True); os._exit(1)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE)
    process = int(done.stdout)
    wait_for(lambda: not is_alive(process) or is_zombie(process))


def is_zombie(process: int) -> bool:
    """True for a process that has ended and that nobody has asked about."""
    stat = Path(f"/proc/{process}/stat")
    return stat.exists() and stat.read_text().rsplit(")", 1)[1].split()[0] == "Z"
