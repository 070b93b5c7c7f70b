"""`python -m addon render` as a user runs it: a process of its own, its files, streams and exit code."""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from addon.commands import render
from addon.commands.arguments import parse_frames, parse_size
from addon.commands.command_line import build_parser, join_frames, open_blend
from addon.commands.render import JSON_KEYS, number_path
from addon.versions import blender_pass_name
from tests.addon.engine.engine_fixtures import HEIGHT, WIDTH, read_image, save_plane
from tests.folders import ROOT


def run_command(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run `python -m addon` with the streams captured."""
    command = [sys.executable, "-m", "addon", *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=300)


@pytest.fixture(scope="module")
def blend(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a .blend: a plane of radiance (0.75, 0.125, 0) fills the camera, at frame 2 it is hidden."""
    return save_plane(tmp_path_factory.mktemp("blend") / "plane.blend")


def test_render_writes_linear_exr_and_prints_json_alone(blend: Path, tmp_path: Path) -> None:
    out = tmp_path / "a {b} #.exr"
    size = f"{WIDTH}x{HEIGHT}"
    done = run_command("render", blend, "-o", out, "--size", size, "--samples", 2, "--workers", 1, "--json")
    assert (done.returncode, done.stderr) == (0, "")
    values = json.loads(done.stdout)
    assert tuple(values) == JSON_KEYS
    assert (values["passes"], values["width"], values["height"], values["samples"]) == (["Combined"], WIDTH, HEIGHT, 2)
    assert (values["triangles"], values["warnings"]) == (2, [])
    assert values["rays"] >= 2 * WIDTH * HEIGHT
    assert values["peak_memory_mb"] > 1
    np.testing.assert_array_equal(read_image(out)[..., :3], np.full((HEIGHT, WIDTH, 3), (0.75, 0.125, 0.0), np.float32))


def test_render_ends_at_an_error_and_says_how_wrong_the_picture_is(blend: Path, tmp_path: Path) -> None:
    done = run_command(
        "render", blend, "-o", tmp_path / "a.exr", "--size", "8x8", "--adaptive", "--error", "1%", "--min-samples", 6,
        "--seconds", 600, "--workers", 1, "--passes", "Error,Sample Count", "--json",
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    values = json.loads(done.stdout)
    assert (values["samples"], values["ended_by"]) == (6, "error")
    assert values["passes"] == ["Combined", "Error", "Sample Count"]
    assert (values["error"], values["error_interval"], values["error_p99"]) == (0.0, [0.0, 0.0], 0.0)


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--error", "0", "expected a share between 0% and 100%, such as 1%, got '0'"),
        ("--seconds", "0", "expected a number of seconds above 0, got '0'"),
    ],
)
def test_limits_that_make_no_sense_are_refused(
    capsys: pytest.CaptureFixture[str], option: str, value: str, message: str
) -> None:
    parser = argparse.ArgumentParser()
    render.add_arguments(parser)
    with pytest.raises(SystemExit):
        parser.parse_args(["a.blend", "-o", "a.png", option, value])
    assert message in capsys.readouterr().err


def test_an_unknown_error_is_null_in_json() -> None:
    assert (render.finite(math.inf), render.finite(0.25)) == (None, 0.25)


def test_render_writes_png_with_view_transform_and_prints_its_path(blend: Path, tmp_path: Path) -> None:
    out = tmp_path / "a.png"
    done = run_command(
        "render", blend, "-o", out, "--size", "8x8", "--samples", 1, "--workers", 1, "--precision", "float64"
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, f"{out}\n", "")
    pixel = read_image(out)[4, 4]
    assert 0.0 < pixel[1] < pixel[0] < 1.0
    assert abs(pixel[0] - 0.75) > 1 / 255  # the file's transform is not linear
    assert pixel[3] == 1.0


def test_frames_write_a_file_each_with_the_passes_asked_for(blend: Path, tmp_path: Path) -> None:
    done = run_command(
        "render", blend, "-o", tmp_path / "f##.exr", "--frames", "1-2", "--size", "8x8", "--samples", "1",
        "--workers", 1, "--passes", "Depth,Object Index", "--json",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert [line["triangles"] for line in lines] == [2, 0]
    assert lines[0]["passes"] == ["Combined", "Depth", "Object Index"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["f01.exr", "f02.exr"]
    header = (tmp_path / "f01.exr").read_bytes()[:4096]
    assert b"ViewLayer.Depth" in header
    assert blender_pass_name("Object Index").encode() in header


def test_a_name_beyond_the_encoding_of_the_console_is_printed_with_escapes(blend: Path, tmp_path: Path) -> None:
    out = tmp_path / "\u7d75\u753b.png"
    command = [sys.executable, "-m", "addon", "render", blend, "-o", out, "--size", "8x8", "--samples", "1"]
    environment = os.environ | {"PYTHONIOENCODING": "cp1252", "PYTHONUTF8": "0"}
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=300, env=environment)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.endswith("\\u7d75\\u753b.png\n")
    assert out.is_file()


USER_ERRORS: tuple[tuple[Any, str], ...] = (
    (("nofile.blend", "-o", "{out}.png"), "nofile.blend: no such file"),
    (("Makefile", "-o", "{out}.png"), "Makefile: not a .blend file"),
    (("{broken}", "-o", "{out}.png"), "broken.blend: "),
    (("{blend}", "-o", "{out}.jpg"), ".jpg: expected a name that ends in .png, .exr or .npz"),
    (("{blend}", "-o", "{out}/no/a.png"), "no such folder"),
    (("{blend}", "-o", "/proc/a.png"), "/proc/a.png: "),
    (("{blend}", "-o", "{out}.png", "--part", "{out}/no/a.npz", "--size", "8x8", "--samples", "1"), "no such folder"),
    (("{blend}", "-o", "{out}.png", "--passes", "Depth"), "passes need an .exr file"),
    (("{blend}", "-o", "{out}.exr", "--passes", "Depht"), "unknown pass 'Depht': expected some of Combined, Depth,"),
)


@pytest.mark.parametrize(("arguments", "message"), USER_ERRORS)
def test_errors_are_one_line_and_exit_code_one(blend: Path, tmp_path: Path, arguments: Any, message: str) -> None:
    broken = tmp_path / "broken.blend"
    broken.write_bytes(b"BLENDER-v402 and nothing more")
    places = {"blend": blend, "broken": broken, "out": tmp_path / "a"}
    done = run_command("render", *(argument.format(**places) for argument in arguments))
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("error: ")
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["broken.blend"]


@pytest.mark.skipif(os.name == "nt", reason="Windows lets few make links")
def test_a_link_to_a_file_stands_where_it_is_as_for_blender(
    blend: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, registered_addon: None
) -> None:
    (tmp_path / "link.blend").symlink_to(blend)
    monkeypatch.chdir(tmp_path)
    open_blend("link.blend")
    assert bpy.path.abspath("//texture.png") == str(tmp_path / "texture.png")


def test_scene_without_camera_fails_and_keeps_the_old_picture(tmp_path: Path) -> None:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    path, out = tmp_path / "empty.blend", tmp_path / "a.png"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), check_existing=False)
    out.write_text("old", encoding="utf-8")
    done = run_command("render", path, "-o", out)
    assert (done.returncode, done.stdout) == (1, "")
    assert "camera" in done.stderr
    assert done.stderr.count("\n") == 1
    assert out.read_text(encoding="utf-8") == "old"


@pytest.mark.parametrize(
    "arguments", [(), ("render",), ("dance",), ("render", "a.blend", "-o", "a.png", "--size", "9")]
)
def test_wrong_usage_is_one_line(capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...]) -> None:
    with pytest.raises(SystemExit) as caught:
        build_parser().parse_args(arguments)
    assert caught.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_help_needs_no_blender() -> None:
    script = "import sys; sys.modules['bpy'] = None; from addon.commands.command_line import main; main(sys.argv[1:])"
    for arguments in (["--help"], ["render", "--help"], ["compare", "--help"]):
        done = subprocess.run(
            [sys.executable, "-c", script, *arguments], cwd=ROOT, capture_output=True, text=True, check=False
        )
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout.startswith("usage: python -m addon")


def test_frames_and_sizes_are_parsed() -> None:
    assert parse_frames("3-5") == range(3, 6)
    assert parse_frames("-2--1") == range(-2, 0)
    assert parse_size("640x360") == (640, 360)
    for parse, text in ((parse_frames, "5-3"), (parse_frames, "5"), (parse_size, "3x8"), (parse_size, "640*360")):
        with pytest.raises(argparse.ArgumentTypeError):
            parse(text)


def test_frames_below_zero_are_no_option() -> None:
    arguments = ["render", "a.blend", "--frames", "-5--3", "-o", "a.png"]
    assert build_parser().parse_args(join_frames(arguments)).frames == range(-5, -2)


@pytest.mark.parametrize(
    ("name", "frame", "expected"),
    [
        ("a.png", 7, "a0007.png"),
        ("a_##.exr", 7, "a_07.exr"),
        ("##a###b.png", 12, "##a012b.png"),
        ("#.png", -1, "-1.png"),
    ],
)
def test_frame_number_takes_the_place_of_the_last_hashes(name: str, frame: int, expected: str) -> None:
    assert number_path(Path(name), frame).name == expected


def test_checkpoints_of_the_window_are_left_alone(registered_addon: None, tmp_path: Path) -> None:
    """A file that asks for them, in a folder that takes none, could not be rendered."""
    path = save_plane(tmp_path / "kept.blend")
    settings = bpy.context.scene.reference_raytracer
    settings.use_checkpoints, settings.checkpoint_folder = True, "//kept.blend/"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), check_existing=False)
    done = run_command("render", path, "-o", tmp_path / "a.png", "--size", "8x8", "--samples", 1)
    assert (done.returncode, done.stderr) == (0, "")


def test_scripts_of_a_file_run_where_they_are_allowed_and_are_named_where_not(tmp_path: Path) -> None:
    """Drivers that Blender does not run count as 0: the plane stood elsewhere, without a word."""
    path, out = save_plane(tmp_path / "driven.blend"), tmp_path / "a.exr"
    driver = bpy.data.objects["Plane"].driver_add("location", 0).driver
    driver.type, driver.expression = "SCRIPTED", "float(str(1000))"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), check_existing=False)
    options = ("-o", out, "--size", "8x8", "--samples", 1, "--workers", 1)
    done = run_command("render", path, *options, "--json")
    (warning,) = json.loads(done.stdout)["warnings"]
    assert "scripts of the file are not run" in warning
    assert "float(str(1000))" in warning
    assert read_image(out)[4, 4, 0] > 0.0
    done = run_command("render", path, *options, "--scripts")
    assert (done.returncode, done.stderr) == (0, "")
    assert read_image(out)[4, 4, 0] == 0.0
    done = run_command("compare", path, "--with", "ray_cast", "--size", "4x4", "--samples", 1)
    assert done.stderr == f"warning: {warning}\n"
