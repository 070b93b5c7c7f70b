"""OpenEXR pictures of the ray tracer's own, as Blender reads them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

import raytracer
from raytracer.film.film_picture import save_picture
from tests.raytracer.rendering.rendering_fixtures import make_lit_scene

pytestmark = pytest.mark.blender


@pytest.mark.parametrize(("width", "height"), [(16, 16), (37, 41)])
def test_blender_reads_the_numbers_that_were_written(empty_scene: Any, tmp_path: Path, width: int, height: int) -> None:
    film = raytracer.render(make_lit_scene(), width, height, 2)
    save_picture(film, tmp_path / "picture.exr")
    image = bpy.data.images.load(str(tmp_path / "picture.exr"))
    assert (*image.size, image.channels, image.is_float) == (width, height, 4, True)
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    np.testing.assert_array_equal(pixels.reshape(height, width, 4)[::-1], film["Combined"])


def test_blender_finds_every_pass_as_a_layer(empty_scene: Any, tmp_path: Path) -> None:
    passes = ("Combined", "Depth", "Normal", "UV", "Object Index")
    film = raytracer.render(make_lit_scene(), 16, 8, 1, passes=passes)
    save_picture(film, tmp_path / "picture.exr")
    image = bpy.data.images.load(str(tmp_path / "picture.exr"))
    assert not image.size[0]  # asked for its size Blender reads a file; of one with layers it tells none to Python
    assert image.type == "MULTILAYER"
