"""`python -m raytracer`: renders that are stopped and killed go on, tiles are merged, errors are one line."""

from __future__ import annotations

import argparse
import errno
import itertools
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import raytracer
from raytracer.commands import info
from raytracer.commands import render as render_command
from raytracer.commands.command_line import main
from raytracer.files.unfinished import PREFIX
from raytracer.film import film_file
from raytracer.film.error import format_error, format_interval
from raytracer.scene import scene_file as scene_file_module
from tests.folders import ROOT
from tests.raytracer.rendering.rendering_fixtures import make_lit_scene, same

SIZE = ("--size", "24x18")
SAMPLES = 40


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    path = tmp_path / "scene.npz"
    raytracer.save(make_lit_scene(), path)
    return path


def start(*arguments: object) -> subprocess.Popen[str]:
    """Start a command in a process of its own."""
    command = [sys.executable, "-m", "raytracer", *map(str, arguments)]
    return subprocess.Popen(command, cwd=ROOT, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def expect(samples: int = SAMPLES, **keywords: object) -> raytracer.Film:
    return raytracer.render(make_lit_scene(), 24, 18, samples, **keywords)


def test_a_render_stops_goes_on_and_is_the_whole(tmp_path: Path, scene_file: Path, capsys) -> None:
    output = tmp_path / "film.npz"
    options = ("render", str(scene_file), "-o", str(output), *SIZE, "--samples", "6")
    assert main([*options, "--until", "2"]) == 0
    assert raytracer.load_film(output).samples == 2
    assert main(["info", str(output)]) == 0
    assert "2 of 6 samples" in capsys.readouterr().out
    assert main(options) == 0
    assert same(raytracer.load_film(output), expect(6))
    assert main([*options[:-1], "9"]) == 0
    assert same(raytracer.load_film(output), expect(9))


def test_a_write_that_fails_meanwhile_is_told_and_the_render_goes_on(tmp_path, scene_file, capsys, monkeypatch) -> None:
    """It ended the render."""
    output, writes, write_archive = tmp_path / "film.npz", itertools.count(), film_file.write_archive

    def write(path: Path, *arguments: object) -> None:
        if next(writes) == 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        write_archive(path, *arguments)

    monkeypatch.setattr(film_file, "write_archive", write)
    assert main(["render", str(scene_file), "-o", str(output), *SIZE, "--samples", "3", "--every", "0"]) == 0
    reason = os.strerror(errno.ENOSPC)
    assert capsys.readouterr().err == f"warning: {output}: not written, which is tried again: {reason}\n"
    assert same(raytracer.load_film(output), expect(3))


def test_a_picture_of_some_of_its_samples_keeps_its_film(tmp_path: Path, scene_file: Path) -> None:
    output = tmp_path / "picture.exr"
    options = ("render", str(scene_file), "-o", str(output), *SIZE, "--samples", "3")
    assert main([*options, "--until", "2"]) == 0
    assert raytracer.load_film(f"{output}.npz").samples == 2
    assert main(options) == 0
    assert not Path(f"{output}.npz").exists()


def test_tiles_are_merged_into_a_picture_of_all_passes(tmp_path: Path, scene_file: Path, capsys) -> None:
    tiles = [tmp_path / f"tile_{number}.npz" for number in (1, 2, 3)]
    options = (*SIZE, "--samples", "2", "--passes", "Combined,Normal,Depth")
    for number, tile in enumerate(tiles, 1):
        assert main(["render", str(scene_file), "-o", str(tile), *options, "--tile", f"{number}/3"]) == 0
    whole = tmp_path / "whole.npz"
    assert main(["merge", *map(str, reversed(tiles)), "-o", str(whole)]) == 0
    assert same(raytracer.load_film(whole), expect(2, passes=("Combined", "Normal", "Depth")))
    merged, picture = tmp_path / "merged.exr", tmp_path / "picture.exr"
    assert main(["merge", *map(str, tiles), "-o", str(merged)]) == 0
    assert main(["render", str(scene_file), "-o", str(picture), *options]) == 0
    assert merged.read_bytes() == picture.read_bytes()
    assert sorted(path.suffix for path in tmp_path.iterdir()).count(".exr") == 2
    assert not list(tmp_path.glob("*.exr.npz"))
    capsys.readouterr()
    assert main(["merge", *map(str, tiles[1:]), "-o", str(whole)]) == 1
    assert "a part is missing" in capsys.readouterr().err


def test_a_folder_of_tiles_is_merged_whatever_else_lies_there(tmp_path: Path, scene_file: Path, capsys) -> None:
    """The scene does, and a tile that was killed while it was written, where the file system has no locks."""
    for number in ("1", "2"):
        tile = tmp_path / f"tile_{number}.npz"
        assert main(["render", str(scene_file), "-o", str(tile), *SIZE, "--samples", "1", "--tile", f"{number}/2"]) == 0
    (tmp_path / f"{PREFIX}0123456789ab.npz").write_bytes(b"PK")
    picture = tmp_path / "picture.exr"
    assert main(["merge", str(tmp_path), "-o", str(picture)]) == 0
    empty = tmp_path / "empty"
    empty.mkdir()
    capsys.readouterr()
    assert main(["merge", str(empty), "-o", str(picture)]) == 1
    assert capsys.readouterr().err == f"error: {empty}: expected one or more films, found none\n"


def test_a_scene_file_says_how_it_is_rendered(tmp_path: Path, capsys) -> None:
    scene, output = tmp_path / "scene.npz", tmp_path / "film.npz"
    settings = {"width": 20, "height": 10, "samples": 3, "seed": 5, "border": (2, 1, 9, 8), "passes": ("Combined",)}
    raytracer.save(make_lit_scene(), scene, settings)
    assert main(["render", str(scene), "-o", str(output)]) == 0
    assert same(raytracer.load_film(output), raytracer.render(make_lit_scene(), **settings))
    # All of it is inside of the border, and no part is missing.
    assert main(["merge", str(output), "-o", str(tmp_path / "picture.exr")]) == 0
    raytracer.save(make_lit_scene(), scene, {**settings, "bouces": 3})
    assert main(["render", str(scene), "-o", str(output)]) == 1
    assert "'bouces', which this version does not know" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("render", "S", "-o", "P.png", *SIZE), "ends in .npz or .exr"),
        (("render", "S", "-o", "P.npz"), "--size WxH does"),
        (("render", "no.npz", "-o", "P.npz", *SIZE), "no.npz: No such file"),
        (("render", "S", "-o", "S", *SIZE), "expected a film"),
        (("render", "S", "-o", "no/P.npz", *SIZE), "P.npz: No such file or directory"),
        (("render", "S", "-o", "P.npz", *SIZE, "--tile", "1/99"), "from 1 to 18 tiles"),
        (("render", "S", "-o", "P.npz", *SIZE, "--samples", "4", "--until", "5"), "until: expected"),
        (("render", "S", "-o", "P.npz", *SIZE, "--passes", "Beauty"), "passes"),
        (("merge", "S", "-o", "P.exr"), "expected a film"),
        (("info", "S"), "expected a film"),
    ],
)
def test_errors_are_one_line_and_leave_files_alone(tmp_path, scene_file, capsys, monkeypatch, arguments, reason):
    monkeypatch.chdir(tmp_path)
    before = scene_file.read_bytes()
    assert main([scene_file.name if text == "S" else text for text in arguments]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert reason in lines[0]
    assert [path.name for path in tmp_path.iterdir()] == [scene_file.name]
    assert scene_file.read_bytes() == before


def test_a_scene_and_its_settings_are_of_one_file(tmp_path: Path, scene_file: Path, monkeypatch) -> None:
    """An export in between gave the old scene with the new settings."""
    opened = []
    open_archive = scene_file_module.open_archive
    monkeypatch.setattr(scene_file_module, "open_archive", lambda *names: opened.append(names) or open_archive(*names))
    assert main(["render", str(scene_file), "-o", str(tmp_path / "film.npz"), *SIZE, "--samples", "1"]) == 0
    assert len(opened) == 1


def test_a_name_beyond_the_encoding_of_the_console_is_printed_with_escapes(tmp_path: Path, scene_file: Path) -> None:
    output = tmp_path / "\u7d75.npz"
    command = [sys.executable, "-m", "raytracer", "render", scene_file, "-o", output, *SIZE, "--samples", "1"]
    environment = os.environ | {"PYTHONIOENCODING": "cp1252", "PYTHONUTF8": "0"}
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, env=environment)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.endswith("\\u7d75.npz\n")
    assert raytracer.load_film(output).samples == 1


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="needs a device that is always full")
def test_what_finds_no_room_on_standard_output_says_where(tmp_path: Path, scene_file: Path) -> None:
    output = tmp_path / "film.npz"
    command = [sys.executable, "-m", "raytracer", "render", scene_file, "-o", output, *SIZE, "--samples", "1"]
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    with open("/dev/full", "wb") as full:
        done = subprocess.run(
            command, cwd=ROOT, env=buffered, stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )  # fmt: skip
    assert raytracer.load_film(output).samples == 1
    assert (done.returncode, done.stderr) == (1, "error: standard output: No space left on device\n")


@pytest.mark.parametrize("closed", ["stdout", "stderr"])
def test_an_error_needs_neither_of_the_standard_outputs(monkeypatch, capsys, closed: str) -> None:
    """Without one it was an error of Python's, without the other it came out among the results."""

    def fail(arguments: argparse.Namespace) -> None:
        raise OSError("the disk is gone")

    monkeypatch.setattr(info, "run", fail)
    monkeypatch.setattr(sys, closed, None)
    assert main(["info", "film.npz"]) == 1
    assert capsys.readouterr() == ("", "" if closed == "stderr" else "error: the disk is gone\n")


def test_a_picture_whose_film_another_process_has_removed_is_there(tmp_path, scene_file, capsys, monkeypatch) -> None:
    """It was an error, No such file, after all was done."""
    output = tmp_path / "picture.exr"

    save = render_command.save_picture

    def save_picture(film: raytracer.Film, path: Path) -> None:
        save(film, path)
        render_command.name_film(path).unlink()

    monkeypatch.setattr(render_command, "save_picture", save_picture)
    assert main(["render", str(scene_file), "-o", str(output), *SIZE, "--samples", "1"]) == 0
    assert capsys.readouterr().out == f"{output}\n"


def test_a_film_of_other_settings_is_refused_by_name(tmp_path: Path, scene_file: Path, capsys) -> None:
    output = tmp_path / "film.npz"
    options = ("render", str(scene_file), "-o", str(output), *SIZE)
    assert main([*options, "--samples", "1"]) == 0
    raytracer.save(make_lit_scene(), scene_file, {"max_bounces": 3})
    assert main([*options, "--samples", "2"]) == 1
    assert f"{output} is of another picture: max_bounces is 8, not 3" in capsys.readouterr().err


def read_time(path: Path) -> int:
    """Return when a file was last written, 0 where there is none."""
    return path.stat().st_mtime_ns if path.exists() else 0


def wait_for(path: Path, process: subprocess.Popen[str]) -> None:
    while not path.exists() and process.poll() is None:
        time.sleep(0.02)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows ends processes without telling them")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_render_that_is_told_to_end_keeps_what_it_has(tmp_path: Path, scene_file: Path, number: int) -> None:
    output = tmp_path / "film.npz"
    arguments = ("render", scene_file, "-o", output, *SIZE, "--every", "0")
    process = start(*arguments, "--samples", "1000000")
    wait_for(output, process)
    process.send_signal(number)
    out, error = process.communicate(timeout=60)
    film = raytracer.load_film(output)
    assert (process.returncode, out) == (1, "")
    assert error == (
        f"error: interrupted: {output} has {film.samples} of 1000000 samples; the same command goes on from there\n"
    )
    assert 0 < film.samples < 1000000
    rays = film.statistics.rays
    assert main([*map(str, arguments), "--samples", str(film.samples + 1)]) == 0
    again = raytracer.load_film(output)
    assert same(again, expect(film.samples + 1))
    assert again.statistics.rays > rays


@pytest.fixture
def notice(monkeypatch: pytest.MonkeyPatch) -> int:
    """Return the number of Ctrl-Break, or of a signal in its place."""
    number = getattr(signal, "SIGBREAK", None) or signal.SIGUSR1
    monkeypatch.setattr(signal, "SIGBREAK", number, raising=False)
    return int(number)


def test_the_notice_of_farms_on_windows_is_heard(notice: int) -> None:
    """Ctrl-Break ended the process at once."""
    with render_command.listen() as is_stopped:
        assert not is_stopped()
        signal.raise_signal(notice)
        assert is_stopped()


@pytest.mark.slow
def test_killed_twenty_times_and_resumed_it_is_the_whole(tmp_path: Path, scene_file: Path) -> None:
    output, samples, rng = tmp_path / "film.npz", 20000, np.random.default_rng(2)
    arguments = ("render", scene_file, "-o", output, *SIZE, "--every", "0", "--samples", samples, "--workers", 1)
    before = 0
    for _ in range(20):
        written = read_time(output)
        process = start(*arguments)
        while read_time(output) == written and process.poll() is None:
            time.sleep(0.01)
        time.sleep(rng.uniform(0.0, 0.5))
        process.kill()
        process.communicate()
        done = raytracer.load_film(output).samples if output.exists() else 0
        assert done >= before
        before = done
    assert 0 < before < samples
    last = before + 2
    assert main([*map(str, arguments[:8]), "--samples", str(last)]) == 0
    assert same(raytracer.load_film(output), expect(last))


def test_a_render_ends_at_an_error_wherever_it_was_stopped_before(tmp_path: Path, scene_file: Path, capsys) -> None:
    """The largest error that a film of 16 samples has: it looks there first."""
    output = tmp_path / "film.npz"
    bound = expect(16).error * 1.01
    assert 0.0 < bound < 1.0
    options = ("render", str(scene_file), "-o", str(output), *SIZE, "--samples", "64", "--error", f"{bound}")
    assert main([*options, "--until", "5"]) == 0
    assert main(options) == 0
    film = raytracer.load_film(output)
    assert (film.samples, film.ended_by) == (16, "error")
    assert same(film, expect(64, error=bound))
    capsys.readouterr()
    assert main(["info", str(output)]) == 0
    assert "16 of 64 samples, ended by error, " in capsys.readouterr().out
    assert main(["info", str(output)]) == 0
    told = f"error: {format_error(film.error)} ({format_interval(film.error_interval)})"
    assert told in capsys.readouterr().out
    assert main([*options[:-1], "0.0001%"]) == 0
    assert raytracer.load_film(output).samples == 64


def test_info_tells_the_error_where_it_is_the_only_pass(tmp_path: Path, scene_file: Path, capsys) -> None:
    output = tmp_path / "film.npz"
    options = ("render", str(scene_file), "-o", str(output), *SIZE, "--samples", "4")
    assert main([*options, "--passes", "Error"]) == 0
    assert main(["info", str(output)]) == 0
    assert f"error: {format_error(expect(4).error)}" in capsys.readouterr().out


def test_adaptive_samples_and_time_limits_reach_the_render(tmp_path: Path, scene_file: Path) -> None:
    output = tmp_path / "film.npz"
    options = ("render", str(scene_file), "-o", str(output), *SIZE, "--samples", "16")
    assert main([*options, "--adaptive"]) == 0
    assert same(raytracer.load_film(output), expect(16, adaptive=True))
    output.unlink()
    assert main([*options, "--samples", "4000", "--seconds", "0.2"]) == 0
    assert raytracer.load_film(output).ended_by == "time"


@pytest.mark.parametrize(("options", "samples"), [((), 8), (("--error", "1%"), 4096), (("--samples", "3"), 3)])
def test_an_error_without_a_number_of_samples_may_take_many(options: tuple[str, ...], samples: int) -> None:
    parser = argparse.ArgumentParser()
    render_command.add_arguments(parser)
    arguments = parser.parse_args(["scene.npz", "-o", "film.npz", *options])
    found = {"width": 4, "height": 3, "samples": 8}
    assert render_command.choose_keywords(found, arguments)["samples"] == samples


@pytest.mark.parametrize("text", ["0", "100%", "-1%", "1 %", "a", "1e-3"])
def test_an_error_that_is_no_share_is_refused(text: str, capsys) -> None:
    with pytest.raises(SystemExit):
        main(["render", "scene.npz", "-o", "film.npz", f"--error={text}"])
    assert "expected a share between 0% and 100%" in capsys.readouterr().err
