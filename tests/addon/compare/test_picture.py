"""Files of a comparison: the EXR that Blender wrote is read as it is, the PNG holds what was put in."""

import struct
import zlib

import bpy
import numpy as np
import pytest

from addon.compare import picture
from addon.compare.cycles.exr import read_exr


def read_png(path):
    """Decode the one kind of PNG that `save_png` writes."""
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    place, chunks = 8, {}
    while place < len(data):
        (size,), kind = struct.unpack(">I", data[place : place + 4]), data[place + 4 : place + 8]
        chunks[kind] = data[place + 8 : place + 8 + size]
        checksum = struct.unpack(">I", data[place + 8 + size : place + 12 + size])[0]
        assert checksum == zlib.crc32(kind + chunks[kind])
        place += 12 + size
    width, height = struct.unpack(">II", chunks[b"IHDR"][:8])
    rows = np.frombuffer(zlib.decompress(chunks[b"IDAT"]), np.uint8).reshape(height, 1 + 3 * width)
    assert not rows[:, 0].any()
    return rows[:, 1:].reshape(height, width, 3)


def save_blender_image(path, codec="NONE", depth="32"):
    """Let Blender write an EXR of 5 x 3 pixels whose values name their place; return them, row 0 at the top."""
    values = np.arange(5 * 3 * 4, dtype=np.float32).reshape(3, 5, 4) / 8
    image = bpy.data.images.new("values", 5, 3, alpha=True, float_buffer=True)
    image.pixels.foreach_set(values[::-1].ravel())
    scene = bpy.context.scene
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode = "OPEN_EXR", "RGBA"
    settings.exr_codec, settings.color_depth = codec, depth
    image.save_render(str(path), scene=scene)
    return values


def test_png_holds_the_pixels(tmp_path):
    pixels = np.random.default_rng(1).integers(256, size=(7, 5, 3), dtype=np.uint8)
    picture.save_png(tmp_path / "out.png", pixels)
    np.testing.assert_array_equal(read_png(tmp_path / "out.png"), pixels)


def test_blender_reads_the_png(tmp_path):
    pixels = np.random.default_rng(2).integers(256, size=(4, 6, 3), dtype=np.uint8)
    picture.save_png(tmp_path / "out.png", pixels)
    image = bpy.data.images.load(str(tmp_path / "out.png"))
    read = np.array(image.pixels[:]).reshape(4, 6, 4)[::-1, :, :3]
    np.testing.assert_array_equal(np.rint(read * 255), pixels)


def test_linear_values_are_shown_as_srgb():
    # IEC 61966-2-1: 0.5 linear is code value 188 of 255; 0.002 lies on the straight part, 12.92 * 0.002 * 255 = 6.6.
    np.testing.assert_array_equal(picture.show_linear([0.0, 0.002, 0.5, 1.0, 7.0, -1.0]), [0, 7, 188, 255, 255, 0])


def test_heat_runs_from_black_to_white():
    heat = picture.show_heat(np.array([[0.0, 0.5, 1.0]]))
    assert heat[0, 0].tolist() == [0, 0, 0]
    assert heat[0, 2].tolist() == [255, 255, 255]
    assert heat[0, 1].sum() < heat[0, 2].sum()


@pytest.mark.parametrize("depth", ["16", "32"])
def test_exr_channels_are_what_blender_wrote(empty_scene, tmp_path, depth):
    values = save_blender_image(tmp_path / "out.exr", depth=depth)  # eighths below 8: exact in half precision too
    channels = read_exr(tmp_path / "out.exr")
    for index, name in enumerate("RGBA"):
        np.testing.assert_array_equal(channels[name], values[..., index])


def test_compressed_exr_is_refused(empty_scene, tmp_path):
    save_blender_image(tmp_path / "out.exr", codec="ZIP")
    with pytest.raises(ValueError, match="without compression"):
        read_exr(tmp_path / "out.exr")


@pytest.mark.parametrize("content", [b"", b"BLENDER-v500 and more"])
def test_other_files_are_refused(tmp_path, content):
    (tmp_path / "out.exr").write_bytes(content)
    with pytest.raises(ValueError, match="OpenEXR"):
        read_exr(tmp_path / "out.exr")
