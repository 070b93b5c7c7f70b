"""Rendering without a window, in the Blender application that the environment variable BLENDER names: files, formats,
what comes after the engine, `blender --command`, messages and exit codes."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from addon.compare.cycles.exr import read_exr
from addon.passes import PASSES
from tests.addon.engine.engine_fixtures import read_image, save_plane
from tests.folders import ROOT

BLENDER = os.environ.get("BLENDER", "")
# Of the plane of `save_plane`, which fills the picture at frame 1 and is hidden at frame 2.
COLOR = (0.75, 0.125, 0.0)
SETTINGS = """
import sys, bpy
sys.path.insert(0, {root!r})
import addon
addon.register()
scene = bpy.context.scene
scene.render.engine = "REFERENCE_RAYTRACER"
scene.render.resolution_x, scene.render.resolution_y = 12, 8
scene.reference_raytracer.samples = 1
from addon.versions import set_image_format
set_image_format(scene.render.image_settings, "OPEN_EXR")
scene.render.image_settings.color_depth = "32"
{more}
"""

pytestmark = pytest.mark.skipif(not BLENDER, reason="set BLENDER to a Blender application to render in it")


@pytest.fixture(scope="module")
def blend(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_plane(tmp_path_factory.mktemp("blend") / "plane.blend")


def run_blender(blend: Path | None, folder: Path, more: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run Blender on a file with the add-on and settings of this test, then `arguments`."""
    script = folder / "settings.py"
    script.write_text(SETTINGS.format(root=str(ROOT), more=more), encoding="utf-8")
    command = [BLENDER, "-b", *([blend] if blend else []), "--factory-startup", "--python-exit-code", "3", "-P", script]
    environment = {**os.environ, "BLENDER_USER_RESOURCES": str(folder)}
    return subprocess.run(
        [str(part) for part in (*command, *arguments)], env=environment, capture_output=True, text=True, check=False,
        timeout=300,
    )  # fmt: skip


def succeed(done: subprocess.CompletedProcess[str]) -> str:
    output = done.stdout + done.stderr
    assert done.returncode == 0, output
    assert "Traceback" not in output, output
    return output


def assert_filled(picture: Path, color: Any = COLOR, tolerance: float = 2**-20) -> None:
    pixels = read_image(picture)[..., :3]
    assert pixels.shape == (8, 12, 3)
    np.testing.assert_allclose(pixels, np.broadcast_to(color, pixels.shape), rtol=tolerance, atol=tolerance)


def test_animation_writes_a_file_for_each_frame(blend: Path, tmp_path: Path) -> None:
    succeed(run_blender(blend, tmp_path, "", "-o", tmp_path / "out_", "-s", 1, "-e", 2, "-a"))
    assert sorted(path.name for path in tmp_path.glob("*.exr")) == ["out_0001.exr", "out_0002.exr"]
    assert_filled(tmp_path / "out_0001.exr")
    assert_filled(tmp_path / "out_0002.exr", (0.0, 0.0, 0.0))


def test_frames_are_rendered_by_number_and_range(blend: Path, tmp_path: Path) -> None:
    succeed(run_blender(blend, tmp_path, "", "-o", tmp_path / "out_", "-f", "1,3..4"))
    assert sorted(path.name for path in tmp_path.glob("*.exr")) == [f"out_000{frame}.exr" for frame in (1, 3, 4)]


def test_png_has_the_view_transform(blend: Path, tmp_path: Path) -> None:
    more = 'set_image_format(scene.render.image_settings, "PNG"); scene.view_settings.view_transform = "Standard"'
    succeed(run_blender(blend, tmp_path, more, "-o", tmp_path / "out_", "-f", 1))
    encoded = np.where(np.array(COLOR) <= 0.0031308, 12.92 * np.array(COLOR), 1.055 * np.power(COLOR, 1 / 2.4) - 0.055)
    assert_filled(tmp_path / "out_0001.png", encoded, tolerance=1 / 255)  # 8 bits, dithered by up to one step


def test_multilayer_exr_holds_every_pass(blend: Path, tmp_path: Path) -> None:
    more = """
from addon.passes import PASSES, enable_passes
enable_passes(bpy.context.view_layer, tuple(PASSES))
set_image_format(scene.render.image_settings, "OPEN_EXR_MULTILAYER")
scene.render.image_settings.color_depth, scene.render.image_settings.exr_codec = "32", "NONE"
"""
    succeed(run_blender(blend, tmp_path, more, "-o", tmp_path / "out_", "-f", 1))
    channels = read_exr(tmp_path / "out_0001.exr")
    passes = {name.split(".")[-2] for name in channels}
    assert len(passes) == len(PASSES)
    assert sum(len(stored.channels) for stored in PASSES.values()) == len(channels)
    depth = next(values for name, values in channels.items() if name.endswith("Depth.Z"))
    np.testing.assert_allclose(depth, 10.0, rtol=2**-20)


def test_existing_files_stay_without_overwrite(blend: Path, tmp_path: Path) -> None:
    for frame in (1, 2):
        (tmp_path / f"out_000{frame}.exr").write_bytes(b"mine")
    more = "scene.render.use_overwrite, scene.render.use_placeholder = False, True"
    succeed(run_blender(blend, tmp_path, more, "-o", tmp_path / "out_", "-s", 1, "-e", 3, "-a"))
    assert (tmp_path / "out_0001.exr").read_bytes() == (tmp_path / "out_0002.exr").read_bytes() == b"mine"
    assert_filled(tmp_path / "out_0003.exr", (0.0, 0.0, 0.0))


COMPOSITE = """
if hasattr(scene, "compositing_node_group"):
    tree = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    scene.compositing_node_group, output = tree, tree.nodes.new("NodeGroupOutput")
else:
    scene.use_nodes = True
    tree = scene.node_tree
    tree.nodes.clear()
    output = tree.nodes.new("CompositorNodeComposite")
layers, exposure = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("CompositorNodeExposure")
exposure.inputs["Exposure"].default_value = 1.0
tree.links.new(layers.outputs["Image"], exposure.inputs["Image"])
tree.links.new(exposure.outputs[0], output.inputs[0])
"""


def test_compositor_comes_after_the_engine(blend: Path, tmp_path: Path) -> None:
    succeed(run_blender(blend, tmp_path, COMPOSITE, "-o", tmp_path / "out_", "-f", 1))
    assert_filled(tmp_path / "out_0001.exr", 2 * np.array(COLOR), tolerance=2**-10)  # half floats within


SEQUENCE = """
editing = scene.sequence_editor_create()
cut = bpy.data.scenes.new("Cut")
cut.render.resolution_x, cut.render.resolution_y = 12, 8
strips = cut.sequence_editor_create()
strips = strips.strips if hasattr(strips, "strips") else strips.sequences
strip = strips.new_scene("Shot", scene, 1, 1)
strip.color_multiply = 0.5
set_image_format(cut.render.image_settings, "OPEN_EXR")
cut.render.image_settings.color_depth = "32"
cut.sequencer_colorspace_settings.name = scene.sequencer_colorspace_settings.name = "Linear Rec.709"
cut.view_settings.view_transform = "Standard"
"""


def test_sequencer_comes_after_the_engine(blend: Path, tmp_path: Path) -> None:
    succeed(run_blender(blend, tmp_path, SEQUENCE, "-S", "Cut", "-o", tmp_path / "out_", "-f", 1))
    assert_filled(tmp_path / "out_0001.exr", 0.5 * np.array(COLOR), tolerance=2**-7)  # the strip has 8 bits


def test_a_strip_has_its_own_camera(blend: Path, tmp_path: Path) -> None:
    """It was seen from the scene's."""
    away = """
away = bpy.data.objects.new("Away", bpy.data.cameras.new("Away"))
away.location, away.rotation_euler = (0.0, 0.0, 10.0), (3.14159, 0.0, 0.0)
scene.collection.objects.link(away)
strip.scene_camera = away
"""
    succeed(run_blender(blend, tmp_path, SEQUENCE + away, "-S", "Cut", "-o", tmp_path / "out_", "-f", 1))
    assert_filled(tmp_path / "out_0001.exr", np.zeros(3))


def test_failure_is_told_and_leaves_no_file(blend: Path, tmp_path: Path) -> None:
    more = "bpy.data.objects['Camera'].scale = (0, 0, 0)"
    done = run_blender(blend, tmp_path, more, "-o", tmp_path / "out_", "-f", 1)
    output = done.stdout + done.stderr
    assert "Reference Ray Tracer: Camera 'Camera' has a scale of" in output
    assert "Traceback" not in output
    assert not list(tmp_path.glob("out_*"))


def test_render_operator_raises_what_the_engine_reports(blend: Path, tmp_path: Path) -> None:
    more = "bpy.data.objects['Camera'].scale = (0, 0, 0)\nbpy.ops.render.render(write_still=True)"
    done = run_blender(blend, tmp_path, more)
    assert done.returncode == 3
    assert "RuntimeError: Error: Reference Ray Tracer: Camera 'Camera' has a scale of" in done.stdout + done.stderr


def run_command(folder: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run `blender --command raytracer`."""
    return run_blender(None, folder, "", "--command", "raytracer", *arguments)


def test_command_renders_and_compares(blend: Path, tmp_path: Path) -> None:
    picture = tmp_path / "picture.exr"
    done = run_command(tmp_path, "render", blend, "-o", picture, "--size", "12x8", "--samples", 1, "--json")
    assert done.returncode == 0, done.stderr
    values = json.loads(done.stdout.strip().splitlines()[-1])
    assert (values["width"], values["height"], values["triangles"], values["warnings"]) == (12, 8, 2, [])
    assert_filled(picture)
    done = run_command(tmp_path, "compare", blend, "--with", "ray_cast", "--size", "12x8", "--samples", 9, "--json")
    assert done.returncode == 0, done.stderr
    numbers = json.loads(done.stdout.strip().splitlines()[-1])
    assert (numbers["rays"], numbers["ours_wrong"]) == (12 * 8 + 27, 0)


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (("render", "nothing.blend", "-o", "out.png"), 1, "error: nothing.blend: no such file"),
        (("render", "nothing.blend"), 2, "blender --command raytracer render: error: the following arguments"),
        (("bench",), 2, "invalid choice: 'bench'"),
    ],
)
def test_command_fails_in_one_line(tmp_path: Path, arguments: tuple[str, ...], code: int, message: str) -> None:
    done = run_command(tmp_path, *arguments)
    assert done.returncode == code, done.stdout + done.stderr
    assert message in done.stderr
    assert "Traceback" not in done.stdout + done.stderr
