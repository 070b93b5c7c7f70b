"""Jobs for render farms: what they ask for is understood, and run here they make the picture that one render makes.

`make test-clusters` brings `openjd`; the job type for Flamenco is run by Node.js, against a stub of Flamenco's side.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path, PureWindowsPath
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from addon.commands.command_line import build_parser as build_addon_parser
from addon.commands.render import number_path
from raytracer.commands.command_line import build_parser as build_raytracer_parser
from tests.addon.commands.test_command_line import run_command
from tests.addon.engine.engine_fixtures import read_image
from tests.folders import ROOT

pytestmark = pytest.mark.blender

FARM = ROOT / "addon" / "farm"
BLEND = ROOT / "blend_scenes" / "cornell_box.blend"
OPENJD = shutil.which("openjd", path=str(Path(sys.executable).parent)) or shutil.which("openjd")
needs_openjd = pytest.mark.skipif(OPENJD is None, reason="openjd-cli is not installed: the extra [farm] brings it")
needs_node = pytest.mark.skipif(shutil.which("node") is None, reason="Node.js, which runs JavaScript, is not installed")
needs_shell = pytest.mark.skipif(sys.platform == "win32", reason="the Python that fails is a shell's script")

# A Python that fails the first time that it is to render the second tile.
FLAKY = """#!/bin/sh
case "$*" in *2/2*) if mkdir "{folder}/failed" 2>/dev/null; then echo "no licence" >&2; exit 3; fi ;; esac
exec "{python}" "$@"
"""


def run_openjd(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run `openjd` as the README does."""
    command, environment = [str(OPENJD), *map(str, arguments)], {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False, timeout=600
    )  # fmt: skip


def run_job(template: str, **parameters: object) -> subprocess.CompletedProcess[str]:
    named = [text for name, value in parameters.items() for text in ("-p", f"{name}={value}")]
    return run_openjd("run", FARM / template, *named)


@needs_openjd
@pytest.mark.parametrize("template", ["still.yaml", "frames.yaml"])
def test_templates_are_open_job_descriptions(template: str) -> None:
    done = run_openjd("check", FARM / template)
    assert done.returncode == 0, done.stdout + done.stderr


@needs_openjd
@needs_shell
def test_a_still_of_which_a_task_fails_once_is_run_again_and_is_the_picture(tmp_path: Path) -> None:
    parts, python = tmp_path / "parts", tmp_path / "python"
    parts.mkdir()
    python.write_text(FLAKY.format(folder=tmp_path, python=sys.executable), encoding="utf-8")
    python.chmod(0o755)
    job = {"Scene": BLEND, "Picture": tmp_path / "farm.png", "Parts": parts, "Tiles": 2, "Python": python}
    settings = {"Size": "24x20", "Samples": 3}
    assert run_job("still.yaml", **job, **settings).returncode != 0
    assert (parts / "tile_1.npz").exists()
    assert not (tmp_path / "farm.png").exists()
    again = run_job("still.yaml", **job, **settings)
    assert again.returncode == 0, again.stdout
    whole = tmp_path / "whole.png"
    done = run_command("render", BLEND, "-o", whole, "--size", "24x20", "--samples", 3, "--workers", 1)
    assert done.returncode == 0, done.stderr
    np.testing.assert_array_equal(read_image(tmp_path / "farm.png"), read_image(whole))


@needs_openjd
@needs_shell
def test_frames_are_a_task_each(tmp_path: Path) -> None:
    python = tmp_path / "python"
    python.write_text(FLAKY.format(folder=tmp_path, python=sys.executable), encoding="utf-8")
    python.chmod(0o755)
    pictures = tmp_path / "frame_####.png"
    done = run_job(
        "frames.yaml", Scene=BLEND, Pictures=pictures, Frames="1-2", Size="8x8", Samples=1, Python=python
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    assert sorted(path.name for path in tmp_path.glob("*.png")) == ["frame_0001.png", "frame_0002.png"]


def compile_job(**settings: object) -> Any:
    command = ["node", str(Path(__file__).with_name("stub.js")), str(FARM / "reference_raytracer.js")]
    done = subprocess.run([*command, json.dumps(settings)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def check_commands(tasks: list[Any]) -> None:
    """Let the parsers of our own commands read what each task runs."""
    parsers = {"addon": build_addon_parser(), "raytracer": build_raytracer_parser()}
    for task in tasks:
        (command,) = task["commands"]
        assert command["name"] == "exec"
        assert command["parameters"]["exe"] == "python"
        flag, module, *arguments = command["parameters"]["args"]
        assert flag == "-m"
        parsers[module].parse_args(arguments)


@needs_node
def test_flamenco_renders_frames() -> None:
    compiled = compile_job(frames="3-5", size="64x36", output="/out/####.png", blendfile="/in/a.blend")
    tasks = compiled["tasks"]
    check_commands(tasks)
    assert [task["name"] for task in tasks] == ["frame-3", "frame-4", "frame-5"]
    assert not any(task["dependencies"] for task in tasks)


@needs_node
def test_flamenco_renders_tiles_after_the_scene_is_written_and_merges_them_in_the_end() -> None:
    compiled = compile_job(frames="7", tiles=3, size="64x36", output="/out/####.png", blendfile="/in/a.blend")
    tasks = compiled["tasks"]
    check_commands(tasks)
    assert [(task["name"], task["dependencies"]) for task in tasks] == [
        ("export", []),
        *((f"tile-{number}", ["export"]) for number in (1, 2, 3)),
        ("merge", ["tile-1", "tile-2", "tile-3"]),
    ]
    merge = tasks[-1]["commands"][0]["parameters"]["args"]
    assert merge[-4:] == ["-o", "/out/0007.png", "--frame", "7"]


@needs_node
@pytest.mark.parametrize("output", ["/shot #2/a_##.png", "C:\\shot #2\\#a_##.png", "##_a_##_b.png"])
def test_flamenco_numbers_the_picture_as_the_command_does(output: str) -> None:
    compiled = compile_job(frames="7", tiles=1, size="64x36", output=output, blendfile="/in/a.blend")
    folder, name = output[: len(output) - len(PureWindowsPath(output).name)], PureWindowsPath(output).name
    merge = compiled["tasks"][-1]["commands"][0]["parameters"]["args"]
    picture = merge[merge.index("-o") + 1]
    assert picture == folder + number_path(Path(name), 7).name


@needs_node
@pytest.mark.parametrize("tiles", [0, 2])
@pytest.mark.parametrize("samples", [0, 7])
def test_flamenco_takes_the_samples_of_the_file_unless_it_is_told_others(tiles: int, samples: int) -> None:
    """It always had 64."""
    job = {"frames": "7", "size": "64x36", "output": "/out/####.png", "blendfile": "/in/a.blend"}
    tasks = compile_job(**job, tiles=tiles, **({"samples": samples} if samples else {}))["tasks"]
    check_commands(tasks)
    arguments = tasks[0]["commands"][0]["parameters"]["args"]
    assert ("--samples" in arguments) == (samples > 0)
    assert not samples or arguments[arguments.index("--samples") + 1] == str(samples)


@needs_node
def test_flamenco_is_offered_the_size_that_blender_renders() -> None:
    """The percentage of the resolution was left out."""
    job = compile_job(frames="7", size="64x36", output="/out/####.png", blendfile="/in/a.blend")
    (size,) = [setting for setting in job["settings"] if setting["key"] == "size"]
    render = SimpleNamespace(resolution_x=1920, resolution_y=1081, resolution_percentage=50)
    context = SimpleNamespace(scene=SimpleNamespace(render=render))
    assert eval(size["eval"], {}, {"C": context}) == "960x540"


@needs_node
def test_flamencos_settings_are_of_its_types() -> None:
    compiled = compile_job(frames="1", size="8x8", output="a.png", blendfile="a.blend")
    for setting in compiled["settings"]:
        assert setting["type"] in ("string", "int32", "float", "bool")
        assert setting["required"] if "default" not in setting else True
