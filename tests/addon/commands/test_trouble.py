"""The command line in trouble: full disks, pictures that cannot be written, layers that are off."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import bpy
import pytest

from addon.commands.arguments import parse_names
from addon.engine.output import measure_picture
from raytracer.files.pictures import check_picture
from tests.addon.engine.engine_fixtures import read_image, save_plane
from tests.folders import ROOT

pytestmark = pytest.mark.blender

# The command line in a process that may not write more than so many bytes to one file.
ON_A_SMALL_DISK = """
import resource, sys
from addon.commands.command_line import main
limit = int(sys.argv.pop(1))
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
sys.exit(main(sys.argv[1:]))
"""


@pytest.fixture(scope="module")
def blend(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_plane(tmp_path_factory.mktemp("blend") / "plane.blend")


def run_python(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=300)


def render(blend: Path, out: Path, *more: object) -> subprocess.CompletedProcess[str]:
    options = ("--size", "16x16", "--samples", 1, "--workers", 1)
    return run_python("-m", "addon", "render", blend, "-o", out, *options, *more)


def assert_refused(done: subprocess.CompletedProcess[str], words: str) -> None:
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (1, "", 1), done.stderr
    assert done.stderr.startswith("error: ")
    assert words in done.stderr


@pytest.mark.skipif(os.name == "nt", reason="needs limits of resources, which Windows lacks")
@pytest.mark.parametrize("name", ["a.png", "a.exr"])
def test_a_full_disk_keeps_the_old_picture_and_names_it(blend: Path, tmp_path: Path, name: str) -> None:
    out = tmp_path / name
    assert render(blend, out).returncode == 0
    whole = out.read_bytes()
    for limit in (1, len(whole) // 2, len(whole) - 1):
        out.write_bytes(b"old")
        options = ("-o", out, "--size", "16x16", "--samples", 1, "--workers", 1)
        assert_refused(run_python("-c", ON_A_SMALL_DISK, limit, "render", blend, *options), str(out))
        assert out.read_bytes() == b"old"
        assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.skipif(os.name == "nt", reason="needs limits of resources, which Windows lacks")
@pytest.mark.parametrize("command", ["render", "export"])
def test_a_full_disk_is_said_of_films_and_scenes_too(blend: Path, tmp_path: Path, command: str) -> None:
    out = tmp_path / "a.npz"
    options = (command, blend, "-o", out, "--size", "16x16", "--samples", 1)
    assert_refused(run_python("-c", ON_A_SMALL_DISK, 1000, *options), f"Reference Ray Tracer: {out}: File too large")
    assert not list(tmp_path.iterdir())


SAVE_MAP = """
import resource, sys
import numpy as np
from addon.compare.picture import save_png
resource.setrlimit(resource.RLIMIT_FSIZE, (5000, 5000))
save_png(sys.argv[1], np.random.default_rng(1).integers(0, 256, (50, 40, 3), dtype=np.uint8))
"""


@pytest.mark.skipif(os.name == "nt", reason="needs limits of resources, which Windows lacks")
def test_a_full_disk_keeps_the_old_map_of_a_comparison(tmp_path: Path) -> None:
    out = tmp_path / "map.png"
    out.write_bytes(b"old")
    done = run_python("-c", SAVE_MAP, out)
    assert done.returncode == 1
    assert f"File too large: '{out}'" in done.stderr.splitlines()[-1]
    assert out.read_bytes() == b"old"
    assert [path.name for path in tmp_path.iterdir()] == ["map.png"]


@pytest.mark.skipif(os.name == "nt", reason="needs limits of resources, which Windows lacks")
def test_a_comparison_without_room_for_its_own_files_says_so(blend: Path, tmp_path: Path) -> None:
    options = ("--with", "cycles", "--size", "64x64", "--samples", 1)
    assert_refused(run_python("-c", ON_A_SMALL_DISK, 100_000, "compare", blend, *options), "the picture ends too early")


def run_into(output: Any, *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "addon", *map(str, arguments)]
    return subprocess.run(
        command, cwd=ROOT, stdout=output, stderr=subprocess.PIPE, text=True, check=False, timeout=300
    )  # fmt: skip


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="needs a device that is always full")
def test_numbers_that_find_no_room_or_no_reader_are_an_error_in_one_line(blend: Path, tmp_path: Path) -> None:
    size = ("--size", "8x8", "--samples", 8)
    with open("/dev/full", "wb") as full:
        for rest in (("render", blend, "-o", tmp_path / "a.png", "--json"), ("compare", blend, "--with", "cycles")):
            done = run_into(full, *rest, *size)
            assert (done.returncode, done.stderr) == (1, "error: standard output: No space left on device\n")
    reader, writer = os.pipe()
    os.close(reader)
    done = run_into(writer, "render", blend, "-o", tmp_path / "a.png", *size)
    os.close(writer)
    assert (done.returncode, done.stderr) == (1, "error: standard output: Broken pipe\n")
    check_picture(tmp_path / "a.png", 8, 8)


@pytest.mark.parametrize(("suffix", "passes"), [(".png", ()), (".exr", ()), (".exr", ("--passes", "Depth,Normal"))])
def test_pictures_cut_short_anywhere_are_refused(blend: Path, tmp_path: Path, suffix: str, passes: Any) -> None:
    out = tmp_path / "a {b} #" / f"a{suffix}"
    out.parent.mkdir()
    assert render(blend, out, *passes).returncode == 0
    check_picture(out, 16, 16)
    whole = out.read_bytes()
    for length in range(len(whole) - 1, 0, -max(len(whole) // 100, 1)):
        out.write_bytes(whole[:length])
        with pytest.raises(ValueError, match="picture"):
            check_picture(out, 16, 16)


def test_the_size_of_the_picture_is_blenders(tmp_path: Path) -> None:
    save_plane(tmp_path / "plane.blend")
    settings, out = bpy.context.scene.render, tmp_path / "a.png"
    settings.resolution_x, settings.resolution_y, settings.resolution_percentage = 37, 53, 71
    settings.border_min_x, settings.border_max_x, settings.border_min_y, settings.border_max_y = 0.1, 0.77, 0.3, 0.9
    settings.engine, bpy.context.scene.cycles.samples = "CYCLES", 1
    settings.filepath, settings.image_settings.file_format = str(out), "PNG"
    for settings.use_border, settings.use_crop_to_border in (
        (False, False),
        (True, False),
        (True, True),
        (False, True),
    ):
        bpy.ops.render.render(write_still=True)
        height, width = read_image(out).shape[:2]
        assert measure_picture(settings) == (width, height)


# What is refused before anything is rendered -------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["a.png", "a.exr"])
def test_view_layers_that_are_all_off_are_named_and_the_old_picture_stays(tmp_path: Path, name: str) -> None:
    path, out = save_plane(tmp_path / "plane.blend"), tmp_path / name
    out.write_bytes(b"old")
    for layer in bpy.context.scene.view_layers:
        layer.use = False
    bpy.ops.wm.save_as_mainfile(filepath=str(path), check_existing=False)
    assert_refused(render(path, out), "no view layer is used for rendering")
    assert out.read_bytes() == b"old"


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [
        ("--samples", "2147483648", "--samples: expected a number from 1 to 2147483647, got 2147483648"),
        ("--samples", "9" * 30, "--samples: expected a number from 1 to 2147483647"),
        ("--bounces", "1025", "--bounces: expected a number from 0 to 1024, got 1025"),
        ("--workers", "1025", "--workers: expected a number from 0 to 1024, got 1025"),
        ("--error", "0.0009%", "--error: expected 0.001% or more, got 0.0009%"),
        ("--frame", "1048575", "--frame: expected a number from -1048574 to 1048574, got 1048575"),
        ("--frames", "5-9999999999", "--frames: expected a number from -1048574 to 1048574, got 9999999999"),
    ],
)
def test_numbers_out_of_range_are_named_by_their_option(
    blend: Path, tmp_path: Path, option: str, value: str, words: str
) -> None:
    assert_refused(run_python("-m", "addon", "render", blend, "-o", tmp_path / "a.png", option, value), words)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("names", [",", "", "Depth,", ",,Depth"])
def test_lists_of_passes_without_names_are_refused(names: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="expected names with commas between them"):
        parse_names(names)
    assert parse_names("Depth, Normal") == ("Depth", "Normal")


def test_a_folder_as_the_map_of_a_comparison_is_refused_before_rendering(tmp_path: Path) -> None:
    """The file of the scene is none, which would be named if it had been opened before."""
    folder = tmp_path / "folder.png"
    folder.mkdir()
    done = run_python("-m", "addon", "compare", "Makefile", "--with", "cycles", "-o", folder)
    assert_refused(done, "folder.png: is a folder")
