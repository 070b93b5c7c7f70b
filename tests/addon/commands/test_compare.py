"""`python -m addon compare` as a user runs it: its JSON, its picture, its errors."""

import json
import subprocess
import sys

import pytest

from tests.folders import ROOT

SCENE = ROOT / "blend_scenes" / "hard_shadows.blend"
PASSES = (
    *("Depth", "Position", "Normal", "UV", "Diffuse Color", "Emission"),
    *("Object Index", "Material Index", "Alpha"),
)
CYCLES_KEYS = [
    *("rmse", "rel_mse", "flip", "z_fail_share", "tile_error", "tile_noise", "tile_bias"),
    *("passes", "ours_seconds", "cycles_seconds"),
]
RAY_CAST_KEYS = [
    *("rays", "wrong_hit", "wrong_object", "wrong_polygon", "max_position_error", "max_normal_error"),
    *("judged", "ours_wrong", "blender_wrong", "ours_seconds", "blender_seconds"),
]


def run_compare(*arguments):
    command = [sys.executable, "-m", "addon", "compare", *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=300)


def test_comparison_with_cycles_prints_json_and_writes_three_panels(tmp_path):
    out = tmp_path / "panels.png"
    done = run_compare(SCENE, "--with", "cycles", "--size", "24x16", "--samples", 16, "-o", out, "--json")
    assert (done.returncode, done.stderr) == (0, "")
    numbers = json.loads(done.stdout)
    assert list(numbers) == CYCLES_KEYS
    assert numbers["passes"] == dict.fromkeys(PASSES, 0.0)
    assert 0 < numbers["flip"] < 1
    # The size of a PNG stands big-endian after the signature and the first chunk's head.
    assert int.from_bytes(out.read_bytes()[16:20], "big") == 3 * 24


def test_comparison_with_ray_cast_prints_json():
    done = run_compare(SCENE, "--with", "ray_cast", "--size", "24x16", "--samples", 50, "--json")
    assert (done.returncode, done.stderr) == (0, "")
    numbers = json.loads(done.stdout)
    assert list(numbers) == RAY_CAST_KEYS
    assert numbers["rays"] == 24 * 16 + 3 * 50
    assert numbers["ours_wrong"] == 0


def test_comparison_prints_one_number_a_line():
    done = run_compare(SCENE, "--with", "ray_cast", "--size", "8x6", "--samples", 5)
    assert [line.split()[0] for line in done.stdout.splitlines()] == RAY_CAST_KEYS


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["missing.blend", "--with", "cycles"], "missing.blend: no such file"),
        ([SCENE, "--with", "ray_cast", "-o", "x.png"], "only a comparison with cycles"),
        ([SCENE], "--with"),
        ([SCENE, "--with", "cycles", "-o", "no/such/folder/x.png"], "no such folder"),
    ],
)
def test_errors_are_one_line(arguments, message):
    done = run_compare(*arguments)
    assert done.returncode != 0
    assert message in done.stderr
    assert (done.stdout, done.stderr.count("\n")) == ("", 1)
