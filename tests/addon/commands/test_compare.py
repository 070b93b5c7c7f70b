"""`python -m addon compare` as a user runs it: its JSON, its picture, its errors."""

import json
import re
import subprocess
import sys

import pytest

from addon.commands.compare import list_finite
from tests.folders import ROOT

SCENE = ROOT / "blend_scenes" / "hard_shadows.blend"
PASSES = (
    *("Depth", "Position", "Normal", "UV", "Diffuse Color", "Emission"),
    *("Object Index", "Material Index", "Alpha"),
)
CYCLES_KEYS = [
    *("rmse", "rel_mse", "flip", "z_fail_share", "tile_error", "tile_noise", "tile_bias"),
    *("passes", "ours_seconds", "cycles_seconds", "samples", "picture_error", "picture_noise", "picture_bias"),
    *("pixel_detectable", "tile_detectable", "picture_detectable", "to", "verdict", "reason"),
]
RAY_CAST_KEYS = [
    *("rays", "wrong_hit", "wrong_object", "wrong_polygon", "max_position_error", "max_normal_error"),
    *("judged", "ours_wrong", "blender_wrong", "ours_seconds", "blender_seconds", "verdict", "reason"),
]
# Saves a scene with a movie for its output: a lit plane, or beside it what this engine lacks: fog for camera rays only.
SAVE_PLANE = """
import sys, bpy
bpy.ops.wm.read_homefile(use_empty=True)
scene = bpy.context.scene
bpy.ops.mesh.primitive_plane_add(size=2)
if sys.argv[2] == "fog":
    bpy.ops.mesh.primitive_cube_add(size=1)
    material = bpy.data.materials.new("Fog")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.remove(tree.nodes["Principled BSDF"])
    fog, kind = tree.nodes.new("ShaderNodeVolumeAbsorption"), tree.nodes.new("ShaderNodeLightPath")
    tree.links.new(kind.outputs["Is Camera Ray"], fog.inputs["Density"])
    tree.links.new(fog.outputs[0], tree.nodes["Material Output"].inputs["Volume"])
    bpy.context.object.data.materials.append(material)
bpy.ops.object.light_add(type="SUN", location=(0, 0, 5))
bpy.ops.object.camera_add(location=(0, -5, 1.5), rotation=(1.35, 0, 0))
scene.camera = bpy.context.object
if hasattr(scene.render.image_settings, "media_type"):
    scene.render.image_settings.media_type = "VIDEO"
scene.render.image_settings.file_format = "FFMPEG"
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
"""


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


def save_plane(path, shader="default"):
    subprocess.run([sys.executable, "-c", SAVE_PLANE, str(path), shader], check=True, capture_output=True)
    return path


def test_too_few_samples_decide_nothing_and_more_of_them_are_taken_until_they_do(tmp_path):
    file = save_plane(tmp_path / "plane.blend")
    few = run_compare(file, "--with", "cycles", "--size", "32x18", "--samples", 8, "--json", "--require")
    numbers = json.loads(few.stdout)
    assert (few.returncode, numbers["verdict"], numbers["z_fail_share"]) == (4, "undecided", 0.0)
    assert max(numbers["tile_detectable"], numbers["picture_detectable"]) > numbers["to"] == 0.01
    assert few.stderr == f"error: undecided: {numbers['reason']}\n"
    more = run_compare(file, "--with", "cycles", "--size", "32x18", "--to", "0.5%", "--json", "--require")
    numbers = json.loads(more.stdout)
    assert (more.returncode, more.stderr, numbers["verdict"]) == (0, "", "agrees")
    assert max(numbers["tile_detectable"], numbers["picture_detectable"]) <= numbers["to"] == 0.005
    assert numbers["samples"] > 8


def test_people_are_told_why_samples_are_added(tmp_path):
    file = save_plane(tmp_path / "plane.blend")
    done = run_compare(file, "--with", "cycles", "--size", "32x18", "--to", "0.5%")
    looks = done.stderr.splitlines()
    assert done.returncode == 0
    assert looks
    assert all(re.fullmatch(r"\d+ samples: noise would hide .* more are taken to find 0.5%", look) for look in looks)
    assert looks[0].startswith("64 samples")
    assert "verdict                  agrees" in done.stdout


def test_what_is_missing_differs_at_any_number_of_samples(tmp_path):
    file = save_plane(tmp_path / "fog.blend", "fog")
    done = run_compare(file, "--with", "cycles", "--size", "32x18", "--to", "1%", "--json", "--require")
    numbers = json.loads(done.stdout)
    assert (done.returncode, numbers["verdict"]) == (3, "differs")
    assert done.stderr == f"error: differs: {numbers['reason']}\n"
    assert numbers["samples"] == 64, "no more samples are needed to say so"


def test_comparison_with_ray_cast_prints_json():
    done = run_compare(SCENE, "--with", "ray_cast", "--size", "24x16", "--samples", 50, "--json")
    assert (done.returncode, done.stderr) == (0, "")
    numbers = json.loads(done.stdout)
    assert list(numbers) == RAY_CAST_KEYS
    assert numbers["rays"] == 24 * 16 + 3 * 50
    assert (numbers["ours_wrong"], numbers["verdict"]) == (0, "agrees")


def test_what_is_infinite_or_no_number_is_null_in_json():
    numbers = {"tile_bias": float("inf"), "rmse": float("nan"), "flip": 0.25, "passes": {"Depth": 0.0}, "to": 1}
    assert list_finite(numbers) == {**numbers, "tile_bias": None, "rmse": None}


def test_comparison_prints_one_number_a_line():
    done = run_compare(SCENE, "--with", "ray_cast", "--size", "8x6", "--samples", 5)
    assert [line.split()[0] for line in done.stdout.splitlines()] == RAY_CAST_KEYS


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["missing.blend", "--with", "cycles"], "missing.blend: no such file"),
        ([SCENE, "--with", "ray_cast", "-o", "x.png"], "only a comparison with cycles"),
        ([SCENE, "--with", "ray_cast", "--to", "1%"], "only a comparison with cycles"),
        ([SCENE, "--with", "cycles", "--to", "0%"], "a share between 0% and 100%"),
        ([SCENE], "--with"),
        ([SCENE, "--with", "cycles", "-o", "no/such/folder/x.png"], "no such folder"),
    ],
)
def test_errors_are_one_line(arguments, message):
    done = run_compare(*arguments)
    assert done.returncode != 0
    assert message in done.stderr
    assert (done.stdout, done.stderr.count("\n")) == ("", 1)
