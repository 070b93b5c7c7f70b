"""Noise taken out of pictures by a process of its own: less of it, nothing left behind, never unasked.

A flat field under noise of a known size is the oracle: its mean has to stay, its spread has to go.
"""

from __future__ import annotations

import errno
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from addon.denoising import process
from addon.engine import finishing
from addon.engine.statistics import last_render
from addon.extract.warnings import Warning
from addon.passes import enable_passes
from addon.versions import has_denoiser, set_image_format
from addon.viewport import finishing as in_viewport
from addon.viewport.finishing import Finishing
from raytracer.rendering.progressive import Picture
from tests.addon.engine.engine_fixtures import make_stage
from tests.folders import ROOT

pytestmark = pytest.mark.usefixtures("registered_addon")
with_denoiser = pytest.mark.skipif(not has_denoiser(), reason=process.NO_DENOISER)

WIDTH, HEIGHT, SPREAD = 64, 48, 0.25
LEFT, RIGHT = 0.5, 2.0


def make_noisy() -> np.ndarray:
    """Return a field of LEFT and RIGHT, (h, w, 4), under noise of a standard deviation of half of each."""
    random = np.random.default_rng(7)
    pixels = np.full((HEIGHT, WIDTH, 4), LEFT, np.float32)
    pixels[:, WIDTH // 2 :] = RIGHT
    pixels[..., :3] *= random.gamma(4.0, SPREAD, size=(HEIGHT, WIDTH, 3)).astype(np.float32)
    pixels[..., 3] = random.random((HEIGHT, WIDTH), np.float32)
    return pixels


def never() -> bool:
    """Return False: nobody cancels."""
    return False


@with_denoiser
def test_noise_goes_and_level_place_and_alpha_stay() -> None:
    noisy = make_noisy()
    quiet = process.denoise(noisy, {}, never)
    np.testing.assert_array_equal(quiet[..., 3], noisy[..., 3])
    inner = slice(4, WIDTH // 2 - 4)
    assert noisy[:, inner, :3].std() > 0.4 * LEFT
    assert quiet[:, inner, :3].std() < 0.1 * LEFT
    # Sixty standard errors of the mean would be 0.1: a picture upside down, mirrored or in another color space is off.
    assert abs(quiet[:, inner, :3].mean() / LEFT - 1) < 0.05
    assert abs(quiet[:, WIDTH // 2 + 4 :, :3].mean() / RIGHT - 1) < 0.05


@with_denoiser
def test_rows_stay_in_order() -> None:
    noisy = make_noisy()
    noisy[: HEIGHT // 2, :, :3] *= 4.0
    quiet = process.denoise(noisy, {}, never)
    assert quiet[: HEIGHT // 2 - 4, :, :3].mean() > 3.0 * quiet[HEIGHT // 2 + 4 :, :, :3].mean()


@with_denoiser
def test_the_process_is_kept_and_leaves_nothing() -> None:
    process.denoise(make_noisy(), {}, never)
    kept = process._Session.process
    assert kept is not None
    process.denoise(make_noisy(), {}, never)
    assert process._Session.process is kept
    folder = kept._files.path
    assert [path.name for path in folder.iterdir() if not path.name.startswith("blender_")] == ["owner"]
    process.close()
    assert not folder.exists()
    assert not kept.is_running


@with_denoiser
def test_a_process_that_died_is_said_and_the_next_picture_gets_another() -> None:
    process.denoise(make_noisy(), {}, never)
    kept = process._Session.process
    assert kept is not None

    def kill() -> bool:
        kept._process.kill()
        return False

    with pytest.raises(process.DenoiseError, match="ended unexpectedly"):
        process.denoise(np.tile(make_noisy(), (24, 24, 1)), {}, kill)
    assert process.denoise(make_noisy(), {}, never).shape == (HEIGHT, WIDTH, 4)


@with_denoiser
def test_esc_ends_it_at_once() -> None:
    process.close()
    with pytest.raises(process.DenoiseCancelledError):
        process.denoise(make_noisy(), {}, lambda: True)
    assert process._Session.process is None


def test_a_build_without_denoiser_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process, "has_denoiser", lambda: False)
    with pytest.raises(process.DenoiseError, match="without OpenImageDenoise"):
        process.denoise(make_noisy(), {}, never)


def render_noise(scene: Any, path: Path) -> np.ndarray:
    """Render two samples of a ground under a sky, into an EXR; return its pixels."""
    set_image_format(scene.render.image_settings, "OPEN_EXR")
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = str(path)
    scene.render.use_file_extension = False
    scene.reference_raytracer.samples = 2
    bpy.ops.render.render(write_still=True, scene=scene.name)
    image = bpy.data.images.load(str(path))
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return pixels


@pytest.fixture
def noisy_scene(empty_scene: Any) -> Any:
    """Return a scene lit by a small lamp and by what bounces off a wall: noise everywhere."""
    make_stage(empty_scene)
    bpy.ops.mesh.primitive_plane_add(size=100)
    bpy.ops.mesh.primitive_uv_sphere_add(radius=2, location=(1, 1, 2))
    bpy.ops.object.light_add(type="AREA", location=(3, 0, 5))
    bpy.context.object.data.energy, bpy.context.object.data.size = 500.0, 3.0
    return empty_scene


@with_denoiser
def test_render_denoises_says_so_and_leaves_nothing_behind(noisy_scene: Any, tmp_path: Path) -> None:
    kinds = (bpy.data.scenes, bpy.data.images, bpy.data.node_groups)
    noisy = render_noise(noisy_scene, tmp_path / "noisy.exr")
    before = [len(kind) for kind in kinds]
    noisy_scene.reference_raytracer.use_denoising = True
    quiet = render_noise(noisy_scene, tmp_path / "quiet.exr")
    assert [len(kind) for kind in kinds] == before
    assert not np.array_equal(noisy, quiet)
    taken = last_render(noisy_scene)
    assert taken is not None
    assert (taken.denoised, taken.warnings) == (True, ())
    assert b"Denoised" in (tmp_path / "quiet.exr").read_bytes()
    assert b"Denoised" not in (tmp_path / "noisy.exr").read_bytes()


@with_denoiser
def test_denoising_passes_guide_where_they_are_asked_for(
    noisy_scene: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: list[set[str]] = []

    def note(pixels: np.ndarray, guides: dict[str, np.ndarray], is_cancelled: Any) -> np.ndarray:
        given.append(set(guides))
        return process.denoise(pixels, guides, is_cancelled)

    monkeypatch.setattr(finishing, "denoise", note)
    noisy_scene.reference_raytracer.use_denoising = True
    plain = render_noise(noisy_scene, tmp_path / "plain.exr")
    enable_passes(noisy_scene.view_layers[0], ("Denoising Albedo", "Denoising Normal", "Denoising Depth"))
    guided = render_noise(noisy_scene, tmp_path / "guided.exr")
    assert given == [set(), {"Albedo", "Normal"}]
    assert not np.array_equal(plain, guided)


def test_render_warns_where_it_cannot_denoise(
    noisy_scene: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    traced = render_noise(noisy_scene, tmp_path / "traced.exr")
    monkeypatch.setattr(process, "has_denoiser", lambda: False)
    noisy_scene.reference_raytracer.use_denoising = True
    np.testing.assert_array_equal(render_noise(noisy_scene, tmp_path / "other.exr"), traced)
    taken = last_render(noisy_scene)
    assert taken is not None
    reason = f"Denoise: {process.NO_DENOISER}; the picture is as it was traced"
    assert (taken.denoised, taken.warnings) == (False, (Warning(reason),))


def test_a_render_stays_as_it_was_traced_where_temporary_files_have_no_room(
    noisy_scene: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(prefix: str) -> Any:
        raise OSError(errno.ENOSPC, "No space left on device", "/tmp/x")

    noisy_scene.reference_raytracer.use_denoising = True
    monkeypatch.setattr(process, "has_denoiser", lambda: True)
    monkeypatch.setattr(process, "OwnedFolder", fail)
    process.close()
    render_noise(noisy_scene, tmp_path / "a.exr")
    taken = last_render(noisy_scene)
    assert taken is not None
    reason = "Denoise: /tmp/x: No space left on device; the picture is as it was traced"
    assert (taken.denoised, taken.warnings) == (False, (Warning(reason),))


def test_a_render_stays_as_it_was_traced_where_denoising_lacks_memory(
    noisy_scene: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any) -> None:
        raise MemoryError

    traced = render_noise(noisy_scene, tmp_path / "traced.exr")
    noisy_scene.reference_raytracer.use_denoising = True
    monkeypatch.setattr(finishing, "denoise", fail)
    np.testing.assert_array_equal(render_noise(noisy_scene, tmp_path / "again.exr"), traced)
    taken = last_render(noisy_scene)
    assert taken is not None
    reason = "Denoise: not enough memory; the picture is as it was traced"
    assert (taken.denoised, taken.warnings) == (False, (Warning(reason),))


def test_a_process_that_cannot_be_started_leaves_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise OSError(errno.EAGAIN, "Resource temporarily unavailable")

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(process, "start_blender", fail)
    with pytest.raises(OSError, match="Resource temporarily unavailable"):
        process.Process()
    assert list(tmp_path.iterdir()) == []


def test_denoising_is_off_and_starts_nothing_unasked(noisy_scene: Any, tmp_path: Path) -> None:
    settings = noisy_scene.reference_raytracer
    assert not settings.use_denoising
    assert not settings.use_viewport_denoising
    process.close()
    render_noise(noisy_scene, tmp_path / "noisy.exr")
    assert process._Session.process is None


def make_picture(samples: int) -> Picture:
    """Return a viewport's picture with so many of 4 samples, lowest row first."""
    return Picture(make_noisy()[::-1], 0, 0, WIDTH, HEIGHT, samples, 4)


def await_news(finishing: Finishing) -> None:
    """Wait for a denoised picture."""
    ends = time.monotonic() + 60
    while not finishing.has_news:
        assert time.monotonic() < ends, finishing.status
        time.sleep(0.02)


@with_denoiser
def test_viewport_denoises_its_last_picture_only() -> None:
    finishing = Finishing()
    first, last = make_picture(1), make_picture(4)
    assert finishing.choose(first, True) is first
    assert "raytracer-denoise" not in [thread.name for thread in threading.enumerate()]
    assert finishing.choose(last, True) is last
    await_news(finishing)
    shown = finishing.choose(None, True)
    assert shown is not None
    assert finishing.status == " | denoised"
    upright = process.denoise(np.ascontiguousarray(last.pixels[::-1]), {}, never)
    np.testing.assert_array_equal(shown.pixels, upright[::-1])
    assert finishing.choose(None, False) is last  # switched off: as it was traced
    assert finishing.status == ""


@with_denoiser
def test_viewport_drops_a_denoised_picture_of_another_view() -> None:
    finishing = Finishing()
    finishing.choose(make_picture(4), True)
    await_news(finishing)
    moved = make_picture(1)
    assert finishing.choose(moved, True) is moved
    assert not finishing.has_news


def test_viewport_says_why_it_is_not_denoised_and_asks_to_be_drawn_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    is_drawn = threading.Event()

    def fail(*_: Any) -> None:
        is_drawn.wait()
        raise process.DenoiseError("no room")

    monkeypatch.setattr(in_viewport, "denoise", fail)
    finishing, last = Finishing(), make_picture(4)
    assert finishing.choose(last, True) is last
    is_drawn.set()
    for thread in threading.enumerate():
        if thread.name == "raytracer-denoise":
            thread.join(60.0)
    assert finishing.has_news
    assert finishing.choose(None, True) is None
    assert finishing.status == " | not denoised: no room"
    assert not finishing.has_news
    assert finishing.choose(make_picture(1), True) is not None
    assert finishing.status == ""


def run_render(output: Path, *more: str) -> subprocess.CompletedProcess[str]:
    """Render a small picture by the command line, with --denoise."""
    scene = ("blend_scenes/cornell_box.blend", "-o", str(output), "--size", "32x24", "--samples", "1")
    command = [sys.executable, "-m", "addon", "render", *scene, "--denoise", *more]
    return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)


@with_denoiser
def test_command_line_denoises(tmp_path: Path) -> None:
    done = run_render(tmp_path / "picture.png", "--json")
    assert done.returncode == 0, done.stderr
    assert '"denoised": true' in done.stdout
    assert b"Denoised" in (tmp_path / "picture.png").read_bytes()


def test_command_line_refuses_a_denoised_film(tmp_path: Path) -> None:
    done = run_render(tmp_path / "film.npz")
    assert done.returncode != 0
    assert "--denoise: expected a picture" in done.stderr
