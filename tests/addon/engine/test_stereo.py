"""Stereoscopy: each view is the picture that a camera at its place takes, in every mode."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from addon.compare.cycles.exr import read_exr
from addon.engine.checkpoints import find_path, list_files
from addon.engine.engine import count_pictures
from addon.engine.statistics import last_render
from addon.engine.stereo import find_camera, list_views
from tests.addon.engine.engine_fixtures import add_plane, make_stage

pytestmark = pytest.mark.usefixtures("registered_addon")

DISTANCE, CONVERGENCE = 0.5, 4.0


@pytest.fixture
def stage(empty_scene: Any) -> Any:
    """Return a scene with planes near and far before a perspective camera, in stereo."""
    make_stage(empty_scene)
    for number, color in enumerate([(1.0, 0.5, 0.25), (0.25, 1.0, 0.5), (0.5, 0.25, 1.0)]):
        x = (-1.3 + number, -0.4 + number)
        plane = add_plane(empty_scene.collection, f"Plane {number}", color, x, (-1.0, 1.0))
        plane.location.z = -2.0 * number
    empty_scene.camera.location = (0.0, 0.0, 6.0)
    empty_scene.camera.data.type = "PERSP"
    render = empty_scene.render
    render.use_multiview = True
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_depth = "32"
    render.image_settings.exr_codec = "NONE"
    render.image_settings.views_format = "INDIVIDUAL"
    render.use_file_extension = True
    stereo = empty_scene.camera.data.stereo
    stereo.interocular_distance, stereo.convergence_distance = DISTANCE, CONVERGENCE
    stereo.convergence_mode = "OFFAXIS"
    return empty_scene


def render_views(scene: Any, folder: Path) -> dict[str, np.ndarray]:
    """Render; return the pictures by the suffix of their files."""
    scene.render.filepath = str(folder / "picture")
    bpy.ops.render.render(write_still=True, scene=scene.name)
    return {path.stem.removeprefix("picture"): read_pixels(path) for path in sorted(folder.glob("picture*.exr"))}


def read_pixels(path: Path) -> np.ndarray:
    """Return the pixels (h, w, 4) of a view's file, in which Blender 4.2 sees layers and no picture."""
    channels = read_exr(path)
    return np.stack([channels[name] for name in "RGBA"], axis=-1)


def render_from(scene: Any, folder: Path, x: float, shift: float) -> np.ndarray:
    """Render one picture from a place beside the camera's, with a shift of the lens."""
    scene.render.use_multiview = False
    scene.camera.location.x, scene.camera.data.shift_x = x, shift
    folder.mkdir()
    return render_views(scene, folder)[""]


@pytest.mark.parametrize("mode", ["OFFAXIS", "PARALLEL"])
@pytest.mark.parametrize(("view", "side"), [("_L", -1), ("_R", 1)])
def test_each_eye_sees_what_a_camera_at_its_place_does(
    stage: Any, tmp_path: Path, mode: str, view: str, side: int
) -> None:
    """Off axis, what is at the distance c of convergence stays in place: a shift of d / 2 f / c, over the sensor."""
    lens = stage.camera.data
    lens.stereo.convergence_mode, lens.stereo.pivot = mode, "CENTER"
    seen = render_views(stage, tmp_path)
    assert set(seen) == {"_L", "_R"}
    shift = -side * DISTANCE / 2 * lens.lens / lens.sensor_width / CONVERGENCE if mode == "OFFAXIS" else 0.0
    alone = render_from(stage, tmp_path / "alone", side * DISTANCE / 2, shift)
    assert len(np.unique(alone.reshape(-1, 4), axis=0)) > 4
    np.testing.assert_allclose(seen[view], alone, atol=1e-4)
    assert not np.array_equal(seen["_L"], seen["_R"])


def test_a_frame_has_a_picture_for_each_view(stage: Any, tmp_path: Path) -> None:
    assert list_views(stage) == ("left", "right")
    assert count_pictures(stage) == 2
    stage.render.views["right"].use = False
    assert list_views(stage) == ("left",)
    stage.render.use_multiview = False
    assert list_views(stage) == ("",)


def test_statistics_count_both_eyes(stage: Any, tmp_path: Path) -> None:
    render_views(stage, tmp_path)
    both = last_render(stage)
    stage.render.use_multiview = False
    render_from(stage, tmp_path / "alone", 0.0, 0.0)
    one = last_render(stage)
    assert both is not None
    assert one is not None
    assert both.rays == 2 * one.rays
    assert both.warnings == ()


def test_each_of_several_cameras_is_its_views(stage: Any, tmp_path: Path) -> None:
    stage.render.views_format = "MULTIVIEW"
    stage.camera.name = "Camera_L"
    other = bpy.data.objects.new("Camera_R", stage.camera.data)
    other.location = (0.0, 0.0, 12.0)
    stage.collection.objects.link(other)
    assert find_camera(stage, "right") == other
    seen = render_views(stage, tmp_path)
    stage.camera = other
    np.testing.assert_allclose(seen["_R"], render_from(stage, tmp_path / "alone", 0.0, 0.0), atol=1e-4)
    assert not np.array_equal(seen["_L"], seen["_R"])


def test_each_view_has_its_own_checkpoint(stage: Any) -> None:
    paths = [find_path(stage, "ViewLayer", view) for view in ("", "left", "right")]
    assert len(set(paths)) == 3
    assert list_files(stage) == []


def test_motion_that_stereoscopy_does_not_show_is_warned_of(stage: Any, tmp_path: Path) -> None:
    """The Vector pass was 0 without a word."""
    bpy.context.view_layer.use_pass_vector = True
    render_views(stage, tmp_path)
    taken = last_render(stage)
    assert taken is not None
    assert [warning.text[:15] for warning in taken.warnings] == ["The Vector pass"]


def test_spherical_stereo_without_a_panorama_is_warned_of(stage: Any, tmp_path: Path) -> None:
    stage.camera.data.stereo.use_spherical_stereo = True
    render_views(stage, tmp_path)
    taken = last_render(stage)
    assert taken is not None
    assert [warning.text[:16] for warning in taken.warnings] == ["Spherical Stereo"]
