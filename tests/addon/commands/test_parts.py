"""Renders in parts: films, tiles and scene files of `python -m addon`, which make the picture that one render makes."""

from __future__ import annotations

import argparse
import errno
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import bpy
import numpy as np
import pytest

import raytracer
from addon import interrupts
from addon.commands import merge
from addon.commands.arguments import parse_tile
from addon.commands.command_line import CommandError, hide_python_output
from addon.commands.parts import check_arguments, is_finished, keep_film
from addon.engine.orders import KeepFilm, find_order
from raytracer.film.film import Film
from tests.addon.commands.test_command_line import run_command
from tests.addon.engine.engine_fixtures import read_image, save_plane
from tests.folders import ROOT

pytestmark = pytest.mark.blender

BLEND = ROOT / "blend_scenes" / "cornell_box.blend"
SIZE = ("--size", "24x20", "--workers", "1")
OPTIONS = (*SIZE, "--samples", "4")


def run(*arguments: object) -> str:
    done = run_command(*arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the picture that one render makes, as EXR and PNG, and its film."""
    folder = tmp_path_factory.mktemp("parts")
    run("render", BLEND, "-o", folder / "whole.exr", *OPTIONS)
    run("render", BLEND, "-o", folder / "whole.png", *OPTIONS, "--part", folder / "whole.npz")
    return folder


def test_tiles_that_are_merged_are_the_picture_as_exr_and_png(folder: Path) -> None:
    tiles = [folder / f"tile_{number}.npz" for number in (1, 2)]
    for number, tile in enumerate(tiles, 1):
        assert run("render", BLEND, "-o", tile, *OPTIONS, "--tile", f"{number}/2") == f"{tile}\n"
    for suffix in (".exr", ".png"):
        merged = folder / f"merged{suffix}"
        assert run("merge", BLEND, *reversed(tiles), "-o", merged) == f"{merged}\n"
        np.testing.assert_array_equal(read_image(merged), read_image(folder / f"whole{suffix}"))
    told = json.loads(run("render", BLEND, "-o", tiles[0], *OPTIONS, "--tile", "1/2", "--json"))
    assert (told["width"], told["height"]) == (24, 10)
    done = run_command("merge", BLEND, tiles[1], "-o", folder / "no.png")
    assert (done.returncode, done.stdout) == (1, "")
    assert "a part is missing" in done.stderr
    assert not (folder / "no.png").exists()


def test_films_of_a_frame_are_merged_with_its_view_settings(registered_addon: None, tmp_path: Path) -> None:
    """They were those of the frame that the file was saved at."""
    blend, film = save_plane(tmp_path / "bright.blend"), tmp_path / "film.npz"
    settings = bpy.context.scene.view_settings
    for frame, exposure in ((-4, -3.0), (1, 0.0)):
        settings.exposure = exposure
        settings.keyframe_insert("exposure", frame=frame)
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), check_existing=False)
    options = ("--size", "8x8", "--samples", 1, "--workers", 1, "--frame", "-4")
    run("render", blend, "-o", tmp_path / "whole.png", *options, "--part", film)
    run("merge", blend, film, "-o", tmp_path / "merged.png", "--frame", "-4")
    np.testing.assert_array_equal(read_image(tmp_path / "merged.png"), read_image(tmp_path / "whole.png"))
    run("merge", blend, film, "-o", tmp_path / "other.png")
    assert read_image(tmp_path / "other.png")[4, 4, 0] > read_image(tmp_path / "whole.png")[4, 4, 0] + 0.1


def test_a_film_goes_on_and_the_picture_beside_it_is_the_whole(folder: Path) -> None:
    film, picture = folder / "film.npz", folder / "picture.exr"
    run("render", BLEND, "-o", film, *OPTIONS, "--until", 1)
    assert raytracer.load_film(film).samples == 1
    run("render", BLEND, "-o", picture, *OPTIONS, "--part", film)
    assert raytracer.load_film(film).samples == 4
    np.testing.assert_array_equal(read_image(picture), read_image(folder / "whole.exr"))
    done = run_command("render", BLEND, "-o", picture, *OPTIONS, "--part", film, "--bounces", "3")
    assert done.returncode == 1
    assert "is of another picture: max_bounces is" in done.stderr


def test_an_exported_scene_is_rendered_to_the_same_film_without_blender(folder: Path) -> None:
    scene, film = folder / "scene.npz", folder / "from_scene.npz"
    assert run("export", BLEND, "-o", scene, *OPTIONS[:2], *OPTIONS[4:]) == f"{scene}\n"
    block = (
        f"import sys; sys.modules['bpy'] = None; sys.argv = {['raytracer', 'render', str(scene), '-o', str(film)]!r}"
    )
    command = [sys.executable, "-c", f"{block}; from raytracer.commands.command_line import main; sys.exit(main())"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found, expected = raytracer.load_film(film), raytracer.load_film(folder / "whole.npz")
    assert found.key.digest == expected.key.digest
    for name, array in expected.arrays.items():
        np.testing.assert_array_equal(found.arrays[name], array)


def test_frames_that_are_there_are_left_out(tmp_path: Path) -> None:
    options = ("--frames", "1-2", "--size", "8x8", "--samples", 1, "--workers", 1, "--skip-existing")
    assert len(run("render", BLEND, "-o", tmp_path / "f#.png", *options).splitlines()) == 2
    first, second = tmp_path / "f1.png", tmp_path / "f2.png"
    kept = first.read_bytes()
    second.write_bytes(second.read_bytes()[:-20])
    time_of_first = first.stat().st_mtime_ns
    assert run("render", BLEND, "-o", tmp_path / "f#.png", *options) == f"{second}\n"
    assert (first.read_bytes(), first.stat().st_mtime_ns) == (kept, time_of_first)


def test_a_picture_is_not_done_while_its_film_goes_on(tmp_path: Path) -> None:
    """One of --until counted as done for whoever asked for all samples."""
    picture, film = tmp_path / "f#.png", tmp_path / "p#.npz"
    options = ("-o", picture, "--part", film, "--frames", "1-1", "--size", "8x8", "--samples", 4, "--workers", 1)
    done = f"{tmp_path / 'f1.png'}\n"
    for until, printed in ((("--until", 2), done), (("--until", 2), ""), ((), done), ((), "")):
        assert run("render", BLEND, *options, "--skip-existing", *until) == printed
    assert raytracer.load_film(tmp_path / "p1.npz").samples == 4


@pytest.mark.skipif(sys.platform == "win32", reason="Windows ends processes without telling them")
def test_a_render_that_is_told_to_end_keeps_its_film(tmp_path: Path) -> None:
    film = tmp_path / "film.npz"
    command = [
        sys.executable,
        "-m",
        "addon",
        "render",
        BLEND,
        "-o",
        film,
        *SIZE,
        "--samples",
        "1000000",
        "--every",
        "0",
    ]
    process = subprocess.Popen(
        [*map(str, command), "--samples", "1000000"], cwd=ROOT, text=True, stderr=subprocess.PIPE
    )
    while not film.exists() and process.poll() is None:  # Blender starts, and some samples are traced
        time.sleep(0.05)
    process.send_signal(signal.SIGTERM)
    _, error = process.communicate(timeout=60)
    assert (process.returncode, error.splitlines()[-1]) == (130, "error: interrupted")
    assert raytracer.load_film(film).samples > 0


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ({"output": "a.png", "tile": (1, 2)}, "a tile is no picture"),
        ({"output": "a.npz", "part": "b.npz"}, "expected an .npz beside a picture"),
        ({"output": "a.png", "part": "b.exr"}, "expected an .npz beside a picture"),
        ({"output": "a.png", "part": "no_folder/b.npz"}, "no_folder: no such folder"),
        ({"output": "a.png", "until": 8}, "--until 8: expected a film to go on from"),
    ],
)
def test_arguments_that_do_not_fit_each_other_are_refused(arguments: dict[str, object], reason: str) -> None:
    with pytest.raises(CommandError, match=reason):
        check_arguments(argparse.Namespace(**{"tile": None, "part": None, "until": None, **arguments}))


def test_films_that_an_error_or_the_time_has_ended_are_whole() -> None:
    """As long as no smaller error is asked for, and an error or a time may end them."""
    ended_by_error = make_noisy_film(0.02, "error")
    for film, settings, expected in (
        (ended_by_error, {"use_noise_threshold": True, "noise_threshold": 2.5}, True),
        (ended_by_error, {"use_noise_threshold": True, "noise_threshold": 1.5}, False),
        (ended_by_error, {"use_noise_threshold": False, "noise_threshold": 2.5}, False),
        (ended_by_error, {"use_noise_threshold": False, "samples": 2}, True),
        (make_noisy_film(0.02, "time"), {"time_limit": 9.0}, True),
        (make_noisy_film(0.02, "time"), {}, False),
        (make_noisy_film(0.02, "cancelled"), {"time_limit": 9.0}, False),
    ):
        usual = {"samples": 64, "use_noise_threshold": False, "noise_threshold": 1.0, "time_limit": 0.0}
        assert is_finished(film, argparse.Namespace(**{**usual, **settings})) == expected, settings


def make_noisy_film(error: float, ended_by: str) -> Film:
    """Return a film of two samples of one pixel."""
    film = Film(1, 1, ("Combined",), samples=2, ended_by=ended_by)
    for number, value in enumerate((1.0 - error, 1.0 + error)):
        film.add(slice(0, 1), {"Combined": np.full((1, 4), value)}, number)
    return film


def test_the_film_of_a_border_is_a_whole_picture(tmp_path: Path) -> None:
    scene = raytracer.Scene(camera=raytracer.Camera(np.eye(4)), world=raytracer.World(1.0))
    order = KeepFilm(tmp_path / "film.npz")
    order.render(scene, 20, 10, 1, border=(2, 1, 9, 8), is_cancelled=lambda: False)
    merged = raytracer.merge([raytracer.load_film(tmp_path / "film.npz")])
    assert (merged.left, merged.bottom, merged.width, merged.height) == (2, 1, 7, 7)


def test_a_write_that_fails_meanwhile_is_told_through_what_the_render_hides(tmp_path: Path, capsys) -> None:
    """It ended the render."""
    path = tmp_path / "film.npz"
    with keep_film(path, argparse.Namespace(every=None, tile=None, until=None)), hide_python_output():
        find_order().on_fault(OSError(errno.ENOSPC, "No space left on device", str(path)))
    assert capsys.readouterr().err == f"warning: {path}: not written, which is tried again: No space left on device\n"


def test_the_notice_of_farms_on_windows_is_heard(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-Break ended the process at once."""
    number = getattr(signal, "SIGBREAK", None) or signal.SIGUSR1
    monkeypatch.setattr(signal, "SIGBREAK", number, raising=False)
    monkeypatch.setattr(interrupts._State, "is_noted", False)  # afterwards, too: what it notes would end later tests
    kept = keep_film(tmp_path / "film.npz", argparse.Namespace(every=None, tile=None, until=None))
    with kept, pytest.raises(KeyboardInterrupt):
        signal.raise_signal(number)


def test_films_without_a_picture_make_none(tmp_path: Path) -> None:
    scene = raytracer.Scene(camera=raytracer.Camera(np.eye(4)))
    raytracer.save_film(raytracer.render(scene, 4, 4, 1, passes=("Depth",)), tmp_path / "film.npz")
    arguments = argparse.Namespace(output=str(tmp_path / "a.exr"), films=[str(tmp_path / "film.npz")], file="no.blend")
    with pytest.raises(CommandError, match=r"film.npz: expected Combined, .* got Depth; `python -m raytracer merge`"):
        merge.run(arguments)


@pytest.mark.parametrize("text", ["0/2", "3/2", "1", "a/b", "1/0", "-1/2"])
def test_a_tile_is_one_of_so_many(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="expected I/N"):
        parse_tile(text)
