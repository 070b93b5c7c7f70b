"""The render engine through Blender's own render operator: what arrives in the file, pixel by pixel.

The scenes emit light and receive none, so that every pixel is known exactly.
"""

from __future__ import annotations

import gc
import itertools
import tracemalloc
import weakref
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest

import raytracer
from addon.engine import progress
from addon.engine.statistics import last_render
from addon.extract.shaders.images import ImageTable
from addon.extract.shaders.nodes import WarningContext
from addon.extract.warnings import WarningList
from addon.versions import set_image_format
from raytracer.processes.workers import WorkerError
from tests.addon.engine.engine_fixtures import (
    HEIGHT,
    WIDTH,
    add_plane,
    make_stage,
    render_channels,
    render_pass,
    select_pass,
)

pytestmark = pytest.mark.usefixtures("registered_addon")

RED, GREEN = (0.75, 0.125, 0.0), (0.0, 0.5, 0.25)  # exact in binary
LEFT, RIGHT = (-WIDTH / 2, 0.0), (0.0, WIDTH / 2)
LOWER, UPPER = (-HEIGHT / 2, 0.0), (0.0, HEIGHT / 2)


@pytest.fixture
def stage(empty_scene: Any) -> Any:
    """Return a scene with a red plane in the lower left quarter of the picture and a green one in the upper right."""
    make_stage(empty_scene)
    add_plane(empty_scene.collection, "Red", RED, LEFT, LOWER)
    add_plane(empty_scene.collection, "Green", GREEN, RIGHT, UPPER)
    return empty_scene


def paint_expected(transparent: bool = False) -> np.ndarray:
    """Return the picture of the stage, (h, w, 4), row 0 at the top."""
    picture = np.zeros((HEIGHT, WIDTH, 4), np.float32)
    picture[..., 3] = 0.0 if transparent else 1.0
    picture[HEIGHT // 2 :, : WIDTH // 2] = (*RED, 1.0)
    picture[: HEIGHT // 2, WIDTH // 2 :] = (*GREEN, 1.0)
    return picture


def test_render_puts_every_pixel_in_its_place(stage: Any, tmp_path: Path) -> None:
    np.testing.assert_array_equal(render_pass(stage, tmp_path / "a.exr"), paint_expected())


def test_a_file_of_passes_as_texture_is_named(stage: Any, tmp_path: Path) -> None:
    """Blender's Python sees no pixels of it, but it is not missing."""
    path, warnings = tmp_path / "passes.exr", WarningList()
    render_pass(stage, path)
    ImageTable().find_image(bpy.data.images.load(str(path)), None, "Image Texture", WarningContext(warnings))
    (warning,) = warnings.records
    assert "'passes.exr' has layers of passes, which are not supported, magenta is shown" in warning.text


def test_transparent_film_has_no_alpha_where_nothing_is(stage: Any, tmp_path: Path) -> None:
    stage.render.film_transparent = True
    np.testing.assert_array_equal(render_pass(stage, tmp_path / "a.exr"), paint_expected(transparent=True))


def test_resolution_percentage_scales_the_picture(stage: Any, tmp_path: Path) -> None:
    stage.render.resolution_percentage = 50
    np.testing.assert_array_equal(render_pass(stage, tmp_path / "a.exr"), paint_expected()[::2, ::2])


# Borders as fractions (x from, x to, y from, y to): within, touching the frame, and where float32 rounds.
@pytest.mark.parametrize("border", [(0.3, 0.7, 0.2, 0.9), (0.0, 0.5, 0.5, 1.0), (0.7, 0.95, 0.1, 0.35)])
def test_border_shows_the_same_pixels_as_the_whole_picture(stage: Any, tmp_path: Path, border: Any) -> None:
    add_noise_source(stage)
    whole = render_pass(stage, tmp_path / "whole.exr")
    render = stage.render
    render.use_border = True
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = border
    inside = render_pass(stage, tmp_path / "border.exr")
    assert inside.shape == whole.shape
    rows, columns = np.nonzero(inside[..., 3])
    top, bottom, left, right = rows.min(), rows.max() + 1, columns.min(), columns.max() + 1
    np.testing.assert_array_equal(inside[top:bottom, left:right], whole[top:bottom, left:right])
    assert not inside[: top + 0].any()
    assert not inside[:, right:].any()
    render.use_crop_to_border = True
    cropped = render_pass(stage, tmp_path / "crop.exr")
    np.testing.assert_array_equal(cropped, whole[top:bottom, left:right])


@pytest.mark.parametrize("tenths", [(1, 7), (3, 6), (2, 9)])
def test_border_at_a_pixel_edge_is_cut_off_as_blender_does(stage: Any, tmp_path: Path, tenths: Any) -> None:
    add_noise_source(stage)
    render = stage.render
    render.resolution_x, render.resolution_y = 20, 10
    whole = render_pass(stage, tmp_path / "whole.exr")
    render.use_border = render.use_crop_to_border = True
    render.border_min_x, render.border_max_x = render.border_min_y, render.border_max_y = np.array(tenths) / 10
    cropped = render_pass(stage, tmp_path / "crop.exr")
    low, high = tenths
    np.testing.assert_array_equal(cropped, whole[10 - high : 10 - low, 2 * low : 2 * high])


def add_noise_source(stage: Any) -> None:
    """Make neighbouring pixels differ: a striped plane finer than a pixel behind the others."""
    for index in range(60):
        left = -WIDTH / 2 + index * WIDTH / 60
        stripe = add_plane(stage.collection, f"Stripe {index}", (index / 64, 0.5, 0.0), (left, left + 0.21), (-9, 9))
        stripe.rotation_euler = (0.0, 0.0, 0.1)
        stripe.location.z = -1.0


def test_view_layers_show_their_own_collections(stage: Any, tmp_path: Path) -> None:
    other = bpy.data.collections.new("Other")
    stage.collection.children.link(other)
    green = bpy.data.objects["Green"]
    stage.collection.objects.unlink(green)
    other.objects.link(green)
    stage.view_layers[0].name = "Red only"
    stage.view_layers[0].layer_collection.children["Other"].exclude = True
    stage.view_layers.new("Both")
    channels = render_channels(stage, tmp_path / "a.exr")
    both, red = paint_expected(), paint_expected()
    red[: HEIGHT // 2, WIDTH // 2 :] = (0.0, 0.0, 0.0, 1.0)
    np.testing.assert_array_equal(select_pass(channels, "Combined", "Red only"), red)
    np.testing.assert_array_equal(select_pass(channels, "Combined", "Both"), both)
    statistics = last_render(stage)
    assert statistics.triangles == 4  # of the larger layer, not the sum
    assert statistics.rays >= 2 * WIDTH * HEIGHT * stage.reference_raytracer.samples  # of both layers


def test_passes_reach_the_layers_that_ask_for_them(stage: Any, tmp_path: Path) -> None:
    layer, plain = stage.view_layers[0], stage.view_layers.new("Plain")
    layer.use_pass_z = layer.use_pass_object_index = layer.use_pass_position = True
    plain.use_pass_z = False
    bpy.data.objects["Red"].pass_index = 7
    channels = render_channels(stage, tmp_path / "a.exr")
    assert not any(name.startswith("Plain.Depth") for name in channels)
    red = paint_expected()[..., 0] > 0
    np.testing.assert_array_equal(select_pass(channels, "Object Index", layer.name)[..., 0], np.where(red, 7.0, 0.0))
    depth = select_pass(channels, "Depth", layer.name)[..., 0]
    np.testing.assert_array_equal(depth[red], 10.0)
    position = select_pass(channels, "Position", layer.name)
    np.testing.assert_allclose(position[HEIGHT - 1, 0], (-WIDTH / 2 + 0.5, -HEIGHT / 2 + 0.5, 0.0), atol=1e-5)


def test_animation_renders_each_frame_anew(stage: Any, tmp_path: Path) -> None:
    green = bpy.data.objects["Green"]
    for frame, hidden in ((1, False), (2, True)):
        green.hide_render = hidden
        green.keyframe_insert("hide_render", frame=frame)
    pictures = []
    for frame in (1, 2):
        stage.frame_set(frame)
        pictures.append(render_pass(stage, tmp_path / "a.exr"))
    np.testing.assert_array_equal(pictures[0], paint_expected())
    assert not pictures[1][: HEIGHT // 2, :, :3].any()


def test_two_scenes_of_one_session_stay_apart(stage: Any, tmp_path: Path) -> None:
    other = bpy.data.scenes.new("Other")
    make_stage(other)
    add_plane(other.collection, "Blue", (0.0, 0.0, 1.0), (-99.0, 99.0), (-99.0, 99.0))
    first = render_pass(stage, tmp_path / "a.exr")
    np.testing.assert_array_equal(
        render_pass(other, tmp_path / "b.exr")[..., :3], np.full((HEIGHT, WIDTH, 3), (0, 0, 1))
    )
    np.testing.assert_array_equal(render_pass(stage, tmp_path / "a.exr"), first)
    assert last_render(stage).triangles == 4
    assert last_render(other).triangles == 2


def test_statistics_tell_what_the_render_took(stage: Any, tmp_path: Path) -> None:
    render_pass(stage, tmp_path / "a.exr")
    statistics = last_render(stage)
    assert (statistics.width, statistics.height, statistics.samples) == (WIDTH, HEIGHT, 2)
    assert statistics.passes == ("Combined",)
    assert statistics.triangles == 4
    assert statistics.rays >= WIDTH * HEIGHT * 2
    assert not statistics.cancelled


@pytest.mark.parametrize(
    ("setting", "value", "text"),
    [
        ("samples", 3, "Samples of a view layer's own are not supported: 'ViewLayer' has those of the scene"),
        (
            "pass_alpha_threshold",
            0.25,
            "Alpha thresholds of passes are not supported: they tell of the first surface that is half opaque",
        ),
    ],
)
def test_what_a_view_layer_alone_would_have_is_named(
    stage: Any, tmp_path: Path, setting: str, value: float, text: str
) -> None:
    bpy.context.view_layer.use_pass_z = True
    setattr(bpy.context.view_layer, setting, value)
    render_pass(stage, tmp_path / "a.exr")
    assert [str(warning) for warning in last_render(stage).warnings] == [text]


def test_error_and_sample_count_reach_the_file(stage: Any, tmp_path: Path) -> None:
    layer = stage.view_layers[0]
    layer.raytracer_use_pass_error = layer.raytracer_use_pass_sample_count = True
    stage.reference_raytracer.filter_width = 4.0  # so that there is noise at the edges
    channels = render_channels(stage, tmp_path / "a.exr")
    error = select_pass(channels, "Error", layer.name)[..., 0]
    assert (error > 0).any()
    assert (error == 0).any()
    np.testing.assert_array_equal(select_pass(channels, "Sample Count", layer.name), 2.0)
    statistics = last_render(stage)
    assert 0 < statistics.error_interval[0] < statistics.error < statistics.error_interval[1]
    assert statistics.ended_by == "samples"


def test_status_tells_samples_error_and_time_left(monkeypatch: pytest.MonkeyPatch) -> None:
    texts: list[str] = []
    seen = SimpleNamespace(
        layers_done=0, update_stats=lambda _, text: texts.append(text), update_progress=lambda share: None
    )
    monkeypatch.setattr(progress, "TEXT_INTERVAL", 0.0)
    monkeypatch.setattr(progress, "ERROR_SHARE", 1e-9)
    shown = progress.Progress(seen, SimpleNamespace(), 1)
    shown.show_share(0.25)
    shown.show_pass(SimpleNamespace(samples=12, error=0.0234), 12, 64)
    shown.show_share(0.5)
    assert texts[0] == "Tracing"
    assert texts[1].startswith("Sample 12/64 | error 2.3% | remaining 00:0")
    shown.show_pass(SimpleNamespace(samples=13, error=0.5), 13, 64)
    assert shown._error == "error 2.3% | "  # to tell it anew at once would take more than its share of the time


def test_progress_rises_to_one_over_all_view_layers(stage: Any, tmp_path: Path) -> None:
    stage.view_layers.new("Second")
    shares: list[float] = []
    progress.progress_listeners.append(shares.append)
    try:
        render_pass(stage, tmp_path / "a.exr")
    finally:
        progress.progress_listeners.remove(shares.append)
    assert shares == sorted(shares)
    assert {0.5, 1.0} <= set(shares)


def test_the_shader_editor_is_there_and_so_are_settings_of_spherical_stereo(stage: Any) -> None:
    area = next(area for screen in bpy.data.screens for area in screen.areas if area.type == "VIEW_3D")
    try:
        area.ui_type = "ShaderNodeTree"  # TypeError where the list of editors has none
        assert area.type == "NODE_EDITOR"
    finally:
        area.type = "VIEW_3D"
    assert stage.render.use_spherical_stereo


# What goes wrong, and what the user reads. (Classes, not exceptions: one that was raised holds on to the engine through
# its traceback, and Blender 4.2 crashes if that outlives the render.)
FAILURES = (
    (WorkerError, "a worker\nended", "Reference Ray Tracer: a worker ended"),
    (ValueError, "bug", "Reference Ray Tracer: internal error, ValueError: bug"),
    (MemoryError, "", "Reference Ray Tracer: not enough memory"),
    (KeyboardInterrupt, "", "Reference Ray Tracer: interrupted"),
    (KeyError, "bug", "Reference Ray Tracer: internal error, KeyError: 'bug'"),
)


@pytest.mark.parametrize(("kind", "text", "message"), FAILURES)
def test_error_while_rendering_is_one_sentence_and_no_file(
    stage: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: type, text: str, message: str
) -> None:
    stage.view_layers.new("Second")
    calls = []

    def fail(*arguments: Any, **keywords: Any) -> Any:
        calls.append(arguments)
        raise kind(text)

    with monkeypatch.context() as patch:
        patch.setattr(raytracer, "render", fail)
        with pytest.raises(RuntimeError) as caught:
            render_pass(stage, tmp_path / "a.exr")
    assert str(caught.value).strip().removeprefix("Error: ") == message
    assert len(calls) == 1  # the second view layer is not tried
    assert not (tmp_path / "a.exr").exists()
    np.testing.assert_array_equal(render_pass(stage, tmp_path / "a.exr"), paint_expected())


def test_scene_that_cannot_be_read_is_one_sentence(stage: Any, tmp_path: Path) -> None:
    stage.camera.scale = (0.0, 1.0, 1.0)
    with pytest.raises(RuntimeError, match=r"^Error: Reference Ray Tracer: Camera 'Camera'[^\n]*\n?$"):
        render_pass(stage, tmp_path / "a.exr")


@pytest.mark.parametrize("file_format", ["OPEN_EXR", "OPEN_EXR_MULTILAYER", "PNG"])
def test_cancel_keeps_what_was_finished(
    stage: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, file_format: str
) -> None:
    stage.reference_raytracer.samples = asked = 1_000_000
    polls = itertools.count()
    real_render = raytracer.render

    def press_escape(*arguments: Any, is_cancelled: Any, **keywords: Any) -> Any:
        assert is_cancelled() is False  # Blender's own answer, as long as nobody presses it
        return real_render(*arguments, is_cancelled=lambda: is_cancelled() or next(polls) > 5, **keywords)

    monkeypatch.setattr(raytracer, "render", press_escape)
    set_image_format(stage.render.image_settings, file_format)
    stage.render.filepath = str(tmp_path / "a")
    bpy.ops.render.render(write_still=True)
    statistics = last_render(stage)
    assert statistics.cancelled
    assert 1 <= statistics.samples < asked
    suffix = "png" if file_format == "PNG" else "exr"
    assert (tmp_path / f"a.{suffix}").stat().st_size


def test_render_twenty_times_keeps_nothing(stage: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    films: list[weakref.ref[Any]] = []
    real_render = raytracer.render

    def watch(*arguments: Any, **keywords: Any) -> Any:
        film = real_render(*arguments, **keywords)
        films.append(weakref.ref(film))
        return film

    monkeypatch.setattr(raytracer, "render", watch)
    gc.freeze()  # what is there before is not looked through twenty times
    tracemalloc.start()
    try:
        sizes = []
        for _ in range(20):
            render_pass(stage, tmp_path / "a.exr")
            gc.collect()
            sizes.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
        gc.unfreeze()
    assert len(films) == 20
    assert not any(film() for film in films)
    # The first renders fill caches; had the later ones kept a film each, that alone would show.
    film_bytes = WIDTH * HEIGHT * 4 * np.dtype(np.float64).itemsize
    assert sizes[-1] - sizes[4] < 15 * film_bytes
