"""Image sequences and movies: the frame that Cycles shows, whatever start, offset, length and cycle; read once each."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from numpy.testing import assert_allclose

from addon.extract.shaders import images
from addon.extract.shaders.image_frames import find_frame
from addon.versions import VERSION, find_node_tree, set_image_format
from tests.addon.against_cycles.node_fixtures import CELL, add_node, make_sheet, render_centres, render_cycles

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]

COUNT = 5  # frames, of which number k is green by k / COUNT


def write_sequence(folder: Path) -> Any:
    for number in range(1, COUNT + 1):
        image = bpy.data.images.new("Frame", 4, 4)
        image.pixels.foreach_set(np.tile((0.0, number / COUNT, 0.0, 1.0), 16).astype(np.float32))
        image.filepath_raw, image.file_format = str(folder / f"frame_{number:04d}.png"), "PNG"
        image.save()
        bpy.data.images.remove(image)
    found = bpy.data.images.load(str(folder / "frame_0001.png"))
    found.colorspace_settings.name, found.source = "Non-Color", "SEQUENCE"
    return found


def write_movie(path: Path) -> Any:
    """Return a movie whose frame k is green by k / COUNT, which Blender has rendered; the scene is empty afterwards."""
    scene, world = bpy.context.scene, bpy.data.worlds.new("World")
    if VERSION < (5, 0):
        world.use_nodes = True
    scene.world = world
    color = find_node_tree(world).nodes["Background"].inputs["Color"]
    for number in range(1, COUNT + 1):
        color.default_value = (0.0, number / COUNT, 0.0, 1.0)
        color.keyframe_insert("default_value", frame=number)
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(scene.camera)
    scene.render.engine, scene.cycles.samples, scene.frame_end = "CYCLES", 1, COUNT
    scene.render.resolution_x = scene.render.resolution_y = 32
    set_image_format(scene.render.image_settings, "FFMPEG")
    scene.render.ffmpeg.format, scene.render.ffmpeg.constant_rate_factor = "MPEG4", "LOSSLESS"
    scene.render.filepath, scene.render.use_file_extension = str(path), False
    bpy.ops.render.render(animation=True)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    found = bpy.data.images.load(str(path))
    found.colorspace_settings.name = "Non-Color"
    return found


USERS: dict[str, dict[str, Any]] = {
    "plain": {},
    "late": {"frame_start": 3},
    "offset": {"frame_offset": 2, "frame_duration": 3},
    "short": {"frame_duration": 2},
    "cyclic": {"frame_duration": 3, "use_cyclic": True},
    "cyclic, late and offset": {"frame_duration": 3, "use_cyclic": True, "frame_start": 4, "frame_offset": 1},
    "without refresh": {"use_auto_refresh": False},
}


def show(image: Any, user: dict[str, Any]) -> Any:
    def make(tree: Any) -> Any:
        node = add_node(tree, "ShaderNodeTexImage", image=image)
        for name, value in {"frame_duration": COUNT, "frame_start": 1, "use_auto_refresh": True, **user}.items():
            setattr(node.image_user, name, value)
        return node.outputs["Color"]

    return make


@pytest.mark.parametrize("frame", [1, 3, 5, 9])
def test_sequences_show_the_frame_that_cycles_shows(empty_scene: Any, tmp_path: Path, frame: int) -> None:
    image = write_sequence(tmp_path)
    columns, rows = make_sheet(empty_scene, {name: show(image, user) for name, user in USERS.items()})
    empty_scene.frame_set(frame)
    count = len(bpy.data.images)
    ours, _ = render_centres(columns * CELL, rows * CELL)
    assert len(bpy.data.images) == count
    assert_allclose(ours, render_cycles(columns * CELL, rows * CELL), atol=1e-5)


def test_movies_show_the_frame_that_cycles_shows(empty_scene: Any, tmp_path: Path) -> None:
    movie = write_movie(tmp_path / "movie.mp4")
    scene = bpy.context.scene
    columns, rows = make_sheet(scene, {name: show(movie, user) for name, user in USERS.items()})
    seen = []
    for frame in (1, 3, 5, 9, 2):
        scene.frame_set(frame)
        count = len(bpy.data.images), len(bpy.data.textures)
        ours, warnings = render_centres(columns * CELL, rows * CELL)
        assert (len(bpy.data.images), len(bpy.data.textures)) == count
        assert not warnings
        assert_allclose(ours, render_cycles(columns * CELL, rows * CELL), atol=1e-5)
        seen.append(float(ours.max()))
    assert len(set(seen)) > 2, "the frames differ"


def test_a_movie_that_is_missing_is_magenta(empty_scene: Any, tmp_path: Path) -> None:
    movie = write_movie(tmp_path / "movie.mp4")
    movie.filepath = str(tmp_path / "gone.mp4")
    columns, rows = make_sheet(bpy.context.scene, {"plain": show(movie, {})})
    ours, warnings = render_centres(columns * CELL, rows * CELL)
    assert any("is missing" in str(warning) for warning in warnings)
    assert_allclose(ours, render_cycles(columns * CELL, rows * CELL), atol=1e-5)


@pytest.mark.parametrize(
    ("settings", "shown"),
    [
        ({}, [0, 0, 1, 2, 3, 4, 4]),
        ({"frame_start": 2}, [0, 0, 0, 1, 2, 3, 4]),
        ({"frame_offset": 10}, [10, 10, 11, 12, 13, 14, 14]),
        ({"use_cyclic": True}, [3, 4, 1, 2, 3, 4, 1]),
        ({"frame_duration": 0}, [0] * 7),
    ],
)
def test_frames_are_counted_as_blender_counts_them(settings: dict[str, Any], shown: list[int]) -> None:
    plain = {"frame_duration": 4, "frame_start": 1, "frame_offset": 0, "use_cyclic": False}
    assert [find_frame(SimpleNamespace(**plain | settings), frame) for frame in range(-1, 6)] == shown


def test_an_animation_reads_each_frame_once_and_other_images_once(
    empty_scene: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    moving = write_sequence(tmp_path)
    still = bpy.data.images.load(str(tmp_path / "frame_0002.png"), check_existing=False)
    make_sheet(empty_scene, {"moving": show(moving, {"frame_duration": 2}), "still": show(still, {})})
    read: list[str] = []
    original = images.extract_image

    def extract(image: Any, place: Any) -> Any:
        read.append(Path(image.filepath).name)
        return original(image, place)

    monkeypatch.setattr(images, "extract_image", extract)
    empty_scene.render.engine = "REFERENCE_RAYTRACER"
    empty_scene.render.resolution_x = empty_scene.render.resolution_y = 8
    empty_scene.reference_raytracer.samples = empty_scene.reference_raytracer.workers = 1
    empty_scene.frame_start, empty_scene.frame_end = 1, 4
    empty_scene.render.filepath = str(tmp_path / "out_")
    bpy.ops.render.render(animation=True)
    assert sorted(read) == ["frame_0001.png", "frame_0002.png", "frame_0002.png"]
