"""The viewport without a window: what is seen, what a session asks for and says."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest

import raytracer
from addon.extract.camera import extract_camera
from addon.extract.kept import Changes, Kept
from addon.extract.scene import extract_scene
from addon.extract.warnings import WarningList
from addon.viewport import session as session_module
from addon.viewport import viewport as viewport_module
from addon.viewport.drawing import BAND_PIXELS, Canvas
from addon.viewport.session import Session, make_target
from addon.viewport.views import EmptyBorderError, read_view, read_window
from raytracer.film.camera import locate_on_film
from raytracer.rendering.live import Live
from raytracer.rendering.progressive import Picture, Target
from tests.addon.viewport.viewport_fixtures import (
    HEIGHT,
    WIDTH,
    look_through,
    make_region,
    make_space,
    make_two_planes,
    project,
    update,
)
from tests.portable import kill

pytestmark = pytest.mark.usefixtures("registered_addon")

# A window matrix comes from a float32 chain of about 8 operations.
FLOAT32_CHAIN = 8 * np.finfo(np.float32).eps
# Seconds; a test that waits longer has failed.
PATIENCE = 120.0


@pytest.fixture
def stage(empty_scene: Any) -> Any:
    return make_two_planes(empty_scene)


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
@pytest.mark.parametrize("fit", ["AUTO", "HORIZONTAL", "VERTICAL"])
def test_camera_view_shows_what_blenders_matrix_shows(stage: Any, kind: str, fit: str) -> None:
    camera = stage.camera
    camera.data.type, camera.data.sensor_fit = kind, fit
    camera.rotation_euler = (0.5, 0.25, 1.0)
    for (width, height), shift, zoom in itertools.product([(300, 200), (150, 400)], [(0, 0), (0.3, -0.7)], [1.0, 0.6]):
        camera.data.shift_x, camera.data.shift_y = shift
        data = look_through(camera, width, height, zoom, (0.2, -0.1))
        view = read_view(make_region(width, height), data, make_space(), stage)
        assert (view.width, view.height, view.border) == (width, height, None)
        assert view.camera.projection == {"PERSP": "perspective", "ORTHO": "orthographic"}[kind]
        x, y = np.array([0.0, width, width / 3]), np.array([0.0, height, height / 5])
        found = project(data.window_matrix, locate_on_film(view.camera, width, height, x, y))
        expected = np.stack([2 * x / width - 1, 2 * y / height - 1], axis=1)
        scale = 1 + np.abs(data.window_matrix[:2]).max()
        np.testing.assert_allclose(found, expected, rtol=0, atol=FLOAT32_CHAIN * scale)


def test_camera_view_stands_where_the_camera_stands(stage: Any) -> None:
    camera = stage.camera
    camera.location, camera.rotation_euler, camera.scale = (1e6, 2.0, 3.0), (0.5, 0.25, 1.0), (2.0, 3.0, 1.0)
    camera.data.dof.use_dof = True
    data = look_through(camera, WIDTH, HEIGHT)
    view = read_view(make_region(), data, make_space(), stage).camera
    render = extract_camera(update().scene_eval, WarningList())
    np.testing.assert_array_equal(view.world_from_camera, render.world_from_camera)
    assert (view.clip_start, view.clip_end) == (render.clip_start, render.clip_end)
    assert (view.aperture_radius, view.focus_distance) == (render.aperture_radius, render.focus_distance)


def test_picture_through_the_whole_window_is_that_of_a_render(stage: Any) -> None:
    data = look_through(stage.camera, 24, 16)
    view = read_view(make_region(24, 16), data, make_space(), stage)
    scene = extract_scene(update()).scene
    settings = {"pixel_filter": "box", "filter_width": 0.0}
    expected = raytracer.render(scene, 24, 16, 1, **settings)["Combined"]
    seen = raytracer.render(raytracer.Scene(**{**vars(scene), "camera": view.camera}), 24, 16, 1, **settings)[
        "Combined"
    ]
    np.testing.assert_array_equal(seen, expected)


@pytest.mark.parametrize("view_perspective", ["PERSP", "ORTHO"])
def test_free_view_sees_points_where_blender_puts_them(stage: Any, view_perspective: str) -> None:
    view_matrix = np.array([[0.0, 1.0, 0.0, -2.0], [0.0, 0.0, 1.0, 1.0], [1.0, 0.0, 0.0, -9.0], [0.0, 0.0, 0.0, 1.0]])
    if view_perspective == "PERSP":
        window = np.array([[1.4, 0, 0.1, 0], [0, 2.1, -0.2, 0], [0, 0, -1.01, -0.2], [0, 0, -1, 0]])
    else:
        window = np.array([[0.1, 0, 0, 0.3], [0, 0.15, 0, -0.2], [0, 0, -0.002, 0], [0, 0, 0, 1.0]])
    data = SimpleNamespace(window_matrix=window, view_matrix=view_matrix, view_perspective=view_perspective)
    space = make_space()
    camera = read_view(make_region(), data, space, stage).camera
    x, y = np.array([10.0, 250.0]), np.array([20.0, 130.0])
    points = locate_on_film(camera, WIDTH, HEIGHT, x, y)
    world = points @ camera.world_from_camera[:3, :3].T + camera.world_from_camera[:3, 3]
    seen = project(window, np.concatenate([world, np.ones((2, 1))], axis=1) @ view_matrix[:3].T)
    np.testing.assert_allclose(
        seen, np.stack([2 * x / WIDTH - 1, 2 * y / HEIGHT - 1], axis=1), atol=1e3 * FLOAT32_CHAIN
    )
    start = np.array([0.0, 0.0, -camera.clip_start, 1.0]) @ camera.world_from_camera.T @ view_matrix.T
    expected = -space.clip_start if view_perspective == "PERSP" else space.clip_end / 2
    assert start[2] == pytest.approx(expected)
    assert camera.clip_end - camera.clip_start == pytest.approx(49.9 if view_perspective == "PERSP" else 50.0)


def test_window_of_an_asymmetric_frustum() -> None:
    matrix = np.array([[2.0, 0, 0.5, 0], [0, 4.0, -0.25, 0], [0, 0, -1, -0.2], [0, 0, -1, 0]])
    window = read_window(matrix)
    assert (window.left, window.right, window.bottom, window.top) == (-0.25, 0.75, -0.3125, 0.1875)
    assert window.is_perspective


def test_border_of_a_camera_lies_in_its_frame(stage: Any) -> None:
    stage.render.use_border = True
    render = stage.render
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.75, 0.5, 1.0
    # The frame of 24 x 16 stands in the middle half of a region of twice its size.
    view = read_view(make_region(48, 32), look_through(stage.camera, 24, 16, zoom=0.5), make_space(), stage)
    assert view.border == (12 + 6, 8 + 8, 12 + 18, 8 + 16)


def test_border_of_a_free_view_is_the_regions(stage: Any) -> None:
    data = look_through(stage.camera, WIDTH, HEIGHT)
    data.view_perspective = "ORTHO"
    space = make_space(use_render_border=True, render_border_min_x=0.1, render_border_max_y=0.5)
    stage.render.use_border = True  # another view's
    assert read_view(make_region(), data, space, stage).border == (30, 0, 300, 100)
    space.render_border_min_x = 1.0
    with pytest.raises(EmptyBorderError):
        read_view(make_region(), data, space, stage)


class Watch:
    """Looks at a session as a region would."""

    def __init__(self, stage: Any, monkeypatch: pytest.MonkeyPatch) -> None:
        self.session = Session()
        self.stage = stage
        self.space = make_space()
        self.extractions = 0
        monkeypatch.setattr(session_module, "extract_scene", self._extract)

    def _extract(self, depsgraph: Any, space: Any, kept: Kept) -> Any:
        self.extractions += 1
        return extract_scene(depsgraph, kept=kept)  # without a window there is no space to ask

    def update(self) -> None:
        self.session.update(update(), self.space)

    def look(self) -> None:
        data = look_through(self.stage.camera, 24, 16)
        self.session.look(make_region(24, 16), data, self.space, update(), 1)

    def wait(self) -> np.ndarray:
        """Return the last picture of what was asked, row 0 at the top."""
        live, end = self.session._live, time.perf_counter() + PATIENCE
        while live.report is None or live.report.job != live._job or not live.report.is_finished:
            assert time.perf_counter() < end
            time.sleep(0.002)
        picture = self.session.read_picture()
        assert picture is not None
        return picture.pixels[::-1].copy()


@pytest.fixture
def watch(stage: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[Watch]:
    stage.reference_raytracer.viewport_samples = 2
    one = Watch(stage, monkeypatch)
    yield one
    one.session.close()


def render_stage() -> np.ndarray:
    from addon.properties import settings_keywords

    scene = bpy.context.scene
    settings = settings_keywords(scene) | {"samples": 2, "workers": 1}
    return raytracer.render(extract_scene(update()).scene, 24, 16, **settings)["Combined"]


def test_session_shows_the_picture_of_a_render(watch: Watch) -> None:
    watch.update()
    watch.look()
    np.testing.assert_array_equal(watch.wait(), render_stage())
    assert watch.session.status.startswith("Sample 2/2 | error ")


def test_session_follows_changes(watch: Watch, stage: Any) -> None:
    watch.update()
    watch.look()
    before = watch.wait()
    bpy.data.objects["Red"].location.y = 4.0
    watch.update()
    watch.look()
    after = watch.wait()
    np.testing.assert_array_equal(after, render_stage())
    assert (after != before).any()
    stage.render.film_transparent = True
    watch.look()
    np.testing.assert_array_equal(watch.wait(), render_stage())


def test_session_follows_settings_that_a_script_changes(watch: Watch, stage: Any) -> None:
    watch.update()
    depsgraph = update()
    data = look_through(stage.camera, 24, 16)
    watch.session.look(make_region(24, 16), data, watch.space, depsgraph, 1)
    job = watch.session._live._job
    stage.reference_raytracer.seed = 5
    watch.session.look(make_region(24, 16), data, watch.space, depsgraph, 1)
    assert watch.session._live._job == job + 1
    np.testing.assert_array_equal(watch.wait(), render_stage())


def test_session_draws_on_where_nothing_changed(watch: Watch) -> None:
    watch.update()
    watch.look()
    job = watch.session._live._job
    watch.look()
    watch.update()
    watch.look()
    assert watch.session._live._job == job


def test_session_extracts_nothing_for_a_camera(watch: Watch, stage: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    watch.update()
    watch.look()
    job = watch.session._live._job
    monkeypatch.setattr(session_module, "read_changes", lambda depsgraph: Changes(kinds=frozenset({"CAMERA"})))
    stage.camera.location.x = 3.0
    watch.update()
    watch.look()
    assert watch.extractions == 1
    assert watch.session._live._job == job + 1
    np.testing.assert_array_equal(watch.wait(), render_stage())


def test_session_reads_all_again_when_it_cannot_trust(watch: Watch, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session_module, "read_changes", lambda depsgraph: Changes())
    watch.update()
    bpy.data.meshes["Red"].vertices[0].co.z = 1.0  # unannounced, as after undo
    bpy.data.meshes["Red"].update()
    watch.session.distrust()
    watch.update()
    watch.look()
    np.testing.assert_array_equal(watch.wait(), render_stage())


def test_session_says_what_is_wrong_and_goes_on_afterwards(watch: Watch, stage: Any) -> None:
    watch.update()
    stage.camera.scale = (0.0, 1.0, 1.0)
    update()
    data = SimpleNamespace(
        window_matrix=np.diag([1.0, 1.0, -1.0, 1.0]), view_matrix=np.eye(4), view_perspective="CAMERA"
    )
    watch.session.look(make_region(24, 16), data, watch.space, update(), 1)
    assert watch.session.status.startswith("Error: Camera 'Camera' has a scale of (0, 1, 1)")
    stage.camera.scale = (1.0, 1.0, 1.0)
    watch.look()
    np.testing.assert_array_equal(watch.wait(), render_stage())


def test_session_explains_what_should_not_happen(
    watch: Watch, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise KeyError("gone")

    with monkeypatch.context() as broken:
        broken.setattr(session_module, "extract_scene", fail)
        watch.update()
    assert watch.session.status == "Error: internal error, KeyError: 'gone'"
    assert "Traceback" in capsys.readouterr().err
    watch.update()
    watch.look()
    np.testing.assert_array_equal(watch.wait(), render_stage())


def test_session_takes_another_process_for_one_that_ended(watch: Watch) -> None:
    watch.update()
    watch.look()
    watch.wait()
    kill(watch.session._live.process_id)
    end = time.perf_counter() + PATIENCE
    while watch.session.status.startswith("Sample"):
        assert time.perf_counter() < end
    assert watch.session.status.startswith("Error: the render process ended unexpectedly")
    watch.update()
    watch.look()
    np.testing.assert_array_equal(watch.wait(), render_stage())


def test_regions_that_draw_share_the_workers(watch: Watch, stage: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    draw = Live.draw

    def note(live: Live, target: Target, precision: str) -> None:
        asked.append(target.workers)
        draw(live, target, precision)

    monkeypatch.setattr(Live, "draw", note)
    stage.reference_raytracer.workers = 5
    watch.update()
    watch.look()
    watch.wait()
    other = Watch(stage, monkeypatch)  # the first has finished when the second begins
    other.update()
    other.look()
    other.wait()
    stage.reference_raytracer.seed = 3
    bpy.data.objects["Red"].location.y = 4.0
    for one in (watch, other):
        one.update()
    for one in (watch, other):
        one.look()
    for one in (watch, other):
        np.testing.assert_array_equal(one.wait(), render_stage())
    other.session.close()
    stage.reference_raytracer.seed = 4
    watch.look()
    stage.reference_raytracer.workers = 2  # nothing is drawn anew for that
    watch.look()
    assert asked == [5, 5, 2, 2, 5]


def test_target_has_the_viewports_samples_and_the_renders_settings(stage: Any) -> None:
    settings = stage.reference_raytracer
    settings.samples, settings.viewport_samples, settings.seed, settings.max_bounces = 7, 5, 3, 2
    view = read_view(make_region(), look_through(stage.camera, WIDTH, HEIGHT), make_space(), stage)
    target = make_target(view, stage, 2)
    assert (target.samples, target.pixel_size, target.width, target.height) == (5, 2, WIDTH, HEIGHT)
    assert (target.settings["seed"], target.settings["max_bounces"]) == (3, 2)


def make_picture(width: int, height: int, value: float, samples: int = 1) -> Picture:
    return Picture(np.full((height, width, 4), value, np.float32), 0, 0, width, height, samples, 8)


def test_large_pictures_reach_the_screen_in_bands(monkeypatch: pytest.MonkeyPatch) -> None:
    from addon.viewport import drawing

    monkeypatch.setattr(drawing, "make_texture", lambda pixels: pixels.copy())
    monkeypatch.setattr(drawing, "UPLOAD_SECONDS", 0.0)
    canvas, height = Canvas(), 3 * BAND_PIXELS // 1024 + 5
    canvas.take(make_picture(1024, height, 1.0))
    steps = 0
    while canvas.is_busy:
        assert canvas._shown is None
        canvas.upload()
        steps += 1
        if steps == 2:
            canvas.take(make_picture(1024, height, 2.0, samples=2))  # more samples of the same: go on with those
    assert steps == 4
    assert [band[0, 0, 0] for band in canvas._shown.bands] == [1.0, 1.0, 2.0, 2.0]
    assert sum(len(band) for band in canvas._shown.bands) == height
    canvas.take(make_picture(1024, height, 3.0))
    canvas.upload()
    canvas.take(make_picture(64, 8, 4.0))  # other pixels: begin anew
    canvas.upload()
    assert not canvas.is_busy
    assert canvas._shown.picture.pixels.shape == (8, 64, 4)


def test_a_denoised_picture_is_not_mixed_with_the_one_it_was_made_of(monkeypatch: pytest.MonkeyPatch) -> None:
    from addon.viewport import drawing

    monkeypatch.setattr(drawing, "make_texture", lambda pixels: pixels.copy())
    monkeypatch.setattr(drawing, "UPLOAD_SECONDS", 0.0)
    canvas = Canvas()
    canvas.take(make_picture(1024, 2 * BAND_PIXELS // 1024, 1.0, samples=8))
    canvas.upload()
    canvas.take(make_picture(1024, 2 * BAND_PIXELS // 1024, 2.0, samples=8))
    while canvas.is_busy:
        canvas.upload()
    assert canvas._shown is not None
    assert [band[0, 0, 0] for band in canvas._shown.bands] == [2.0, 2.0]


def test_a_region_whose_engine_blender_freed_is_ended_and_the_others_are_drawn_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Engine:
        redraws = 0

        def as_pointer(self) -> int:
            return id(self)

        def tag_redraw(self) -> None:
            self.redraws += 1

    class FreedEngine:  # an error's traceback still holds it
        def __getattr__(self, name: str) -> Any:
            raise ReferenceError("StructRNA of type ReferenceRaytracerEngine has been removed")

    engines = FreedEngine(), Engine()
    monkeypatch.setattr(viewport_module.Viewport, "has_news", lambda self: True)
    freed, living = viewports = [viewport_module.Viewport(engine) for engine in engines]
    try:
        assert viewport_module.watch() is not None
        assert (freed.session.is_closed, living.session.is_closed) == (True, False)
        assert engines[1].redraws == 1
    finally:
        for one in viewports:
            one.close()
