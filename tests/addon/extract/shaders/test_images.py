"""Images: pixels, alpha, color spaces, and files of the formats that Blender loads."""

from __future__ import annotations

import tracemalloc
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from addon.extract.kept import Kept
from addon.extract.shaders.color_spaces import LINEAR_SPACES, REC709, find_decoder, xyz_from_linear
from addon.extract.shaders.images import ImageTable, associate, drop_infinities, extract_image, read_floats
from addon.extract.shaders.nodes import WarningContext
from addon.extract.warnings import WarningList
from addon.versions import set_image_format
from raytracer.textures.image import decode_srgb
from tests.addon.against_cycles.node_fixtures import add_node, measure_differences

pytestmark = pytest.mark.blender

SIZE = (6, 4)


@pytest.fixture
def warnings(empty_scene: Any) -> WarningList:
    return WarningList()


def place(warnings: WarningList) -> WarningContext:
    return WarningContext(warnings, "Object", "Material")


def make_pixels(opaque: bool = True) -> np.ndarray:
    pixels = np.random.default_rng(5).integers(0, 256, (SIZE[1], SIZE[0], 4)) / np.float32(255)
    if opaque:
        pixels[..., 3] = 1.0
    return pixels.astype(np.float32)


def make_image(is_float: bool = False, opaque: bool = True, space: str = "") -> Any:
    image = bpy.data.images.new("Image", *SIZE, alpha=True, float_buffer=is_float)
    if space:  # a change of space loads the image anew
        image.colorspace_settings.name = space
    image.pixels.foreach_set(make_pixels(opaque).ravel())
    image.update()
    return image


def test_bytes_stay_bytes_and_floats_floats(warnings: WarningList) -> None:
    found = extract_image(make_image(), place(warnings))
    assert (found.pixels.dtype, found.encoding) == (np.uint8, "srgb")
    assert_array_equal(found.pixels, np.rint(make_pixels() * 255))
    found = extract_image(make_image(is_float=True), place(warnings))
    assert (found.pixels.dtype, found.encoding) == (np.float32, "linear")
    assert_array_equal(found.pixels, make_pixels())


def test_row_0_is_the_lowest(warnings: WarningList) -> None:
    image = bpy.data.images.new("Image", 1, 2)
    image.pixels.foreach_set([1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0])  # Blender's rows run upwards
    assert_array_equal(extract_image(image, place(warnings)).pixels[:, 0, 0], (255, 0))


def test_data_is_not_decoded(warnings: WarningList) -> None:
    image = make_image(opaque=False, space="Non-Color")
    found = extract_image(image, place(warnings))
    assert found.encoding == "linear"
    assert_array_equal(found.pixels, np.rint(make_pixels(opaque=False) * 255))


def test_an_image_is_read_once(warnings: WarningList) -> None:
    images, image = ImageTable(), make_image()
    assert images.find_image(image, None, "Node", place(warnings)) is images.find_image(
        image, None, "Other", place(warnings)
    )


def test_a_missing_file_is_named(warnings: WarningList) -> None:
    found = ImageTable().find_image(make_lost(), None, "Node", place(warnings))
    assert found is not None
    assert_array_equal(found.pixels, [[(1.0, 0.0, 1.0, 1.0)]])
    (warning,) = warnings.records
    assert "node 'Node': image 'Lost' is missing, magenta is shown" in warning.text
    assert (warning.object, warning.material) == ("Object", "Material")


def test_an_unknown_space_is_named_and_read_as_srgb(warnings: WarningList) -> None:
    image = make_image(space="Filmic Log")
    assert extract_image(image, place(warnings)).encoding == "srgb"
    assert "color space 'Filmic Log' is not supported, read as sRGB" in warnings.records[0].text


def test_bytes_times_alpha_round_down() -> None:
    pixels = np.array([[[255, 100, 1, 128], [7, 8, 9, 255]]], np.uint8)
    assert_array_equal(associate(pixels), [[[128, 50, 0, 128], [7, 8, 9, 255]]])


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_missing_channels_are_filled(channels: int) -> None:
    found = read_floats(np.full((1, 1, channels), 0.5, np.float32))
    assert_array_equal(found, [[[0.5, 0.5, 0.5, 0.5 if channels == 4 else 1.0]]])


# Color spaces --------------------------------------------------------------------------------------------------------


def test_the_working_space_is_itself() -> None:
    color = np.array([[0.1, 0.5, 0.9]], np.float32)
    assert_allclose(find_decoder("Linear Rec.709")(color), color, rtol=1e-12)


@pytest.mark.parametrize("name", [name for name, (primaries, _) in LINEAR_SPACES.items() if primaries])
def test_white_stays_white(name: str) -> None:
    assert_allclose(find_decoder(name)(np.ones((1, 3), np.float32)), 1.0, atol=1e-9)


def test_the_matrix_of_rec_709_is_the_published_one() -> None:
    """IEC 61966-2-1, to the four digits that it gives."""
    published = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    assert_allclose(xyz_from_linear(REC709, (0.3127, 0.3290)), published, atol=1e-4)


def test_display_p3_has_the_curve_of_srgb() -> None:
    grey = np.full((1, 3), 0.5, np.float32)
    assert_allclose(find_decoder("Display P3")(grey), decode_srgb(np.array(0.5)), rtol=1e-6)


# Files, against Cycles -----------------------------------------------------------------------------------------------

# Format, settings, and how far Cycles' own reader may be off Blender's: lossy formats decode alike but for rounding.
FORMATS = {
    "PNG": ({"color_mode": "RGB", "color_depth": "8"}, 1e-4),
    "PNG with alpha": ({"color_mode": "RGBA", "color_depth": "8"}, 1e-4),
    "PNG grey": ({"color_mode": "BW", "color_depth": "8"}, 1e-4),
    "TIFF": ({"color_mode": "RGB", "color_depth": "8"}, 1e-4),
    "BMP": ({"color_mode": "RGB"}, 1e-4),
    "TARGA": ({"color_mode": "RGB"}, 1e-4),
    "JPEG": ({"color_mode": "RGB", "quality": 100}, 1e-4),
    "WEBP": ({"color_mode": "RGB", "quality": 100}, 1e-4),
    "OPEN_EXR": ({"color_mode": "RGB", "color_depth": "32"}, 1e-4),
    "OPEN_EXR half": ({"color_mode": "RGB", "color_depth": "16"}, 1e-4),
    "HDR": ({"color_mode": "RGB"}, 1e-4),
}


def save_file(folder: Path, name: str) -> Any:
    """Write the pixels to a file of a format, and return an image that reads it."""
    settings = bpy.context.scene.render.image_settings
    set_image_format(settings, name.split(" ")[0])
    for key, value in FORMATS[name][0].items():
        setattr(settings, key, value)
    path = folder / f"{name}.image"
    image = make_image(is_float=name.startswith(("OPEN_EXR", "HDR")), opaque="alpha" not in name)
    image.save_render(str(path), scene=bpy.context.scene)
    return bpy.data.images.load(str(path))


@pytest.mark.usefixtures("registered_addon")
def test_files_look_as_in_cycles(empty_scene: Any, tmp_path: Path, record_property: Any) -> None:
    empty_scene.view_settings.view_transform = "Standard"
    images = {name: save_file(tmp_path, name) for name in FORMATS}

    def show(image: Any) -> Any:
        return lambda tree: add_node(tree, "ShaderNodeTexImage", image=image, interpolation="Closest").outputs["Color"]

    differences, _, warnings = measure_differences(empty_scene, {name: show(image) for name, image in images.items()})
    record_property("largest_difference", differences)
    assert not warnings
    assert {name: value for name, value in differences.items() if value > FORMATS[name][1]} == {}


# Missing images ------------------------------------------------------------------------------------------------------


def make_lost(space: str = "sRGB") -> Any:
    image = bpy.data.images.new("Lost", 1, 1)
    image.source, image.filepath = "FILE", "//nowhere.png"
    image.colorspace_settings.name = space
    image.reload()
    return image


@pytest.mark.usefixtures("registered_addon")
def test_a_missing_image_is_magenta_as_in_cycles(empty_scene: Any) -> None:
    image = make_lost()

    def show(tree: Any) -> Any:
        return add_node(tree, "ShaderNodeTexImage", image=image).outputs["Color"]

    differences, pictures, warnings = measure_differences(empty_scene, {"lost": show})
    assert differences["lost"] < 1e-6
    assert_allclose(pictures["lost"][0][0, 0], (1.0, 0.0, 1.0), atol=1e-6)
    assert ["missing" in str(warning) for warning in warnings] == [True]


def test_a_large_image_takes_little_more_memory_than_itself(empty_scene: Any) -> None:
    """What Blender hands out is 16 bytes a pixel, what is kept 4; whole arrays between them would be 16 each."""
    side = 1024
    image = bpy.data.images.new("Large", side, side, alpha=True)
    tracemalloc.start()
    extract_image(image, WarningContext(WarningList()))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1.25 * side * side * (16 + 4)


def test_what_is_not_finite_in_a_float_image_is_black(empty_scene: Any) -> None:
    image = bpy.data.images.new("Float", 2, 1, alpha=True, float_buffer=True)
    image.pixels = [np.nan, 0.5, 2.0, 1.0, 0.25, 0.0, 0.0, 1.0]
    found = extract_image(image, WarningContext(WarningList()))
    assert found is not None
    assert_array_equal(found.pixels[0], [(0.0, 0.5, 2.0, 1.0), (0.25, 0.0, 0.0, 1.0)])
    assert_array_equal(drop_infinities(np.array([np.inf, -np.inf, np.nan, -1.0, 1e38])), [0.0, 0.0, 0.0, -1.0, 1e38])


@pytest.mark.usefixtures("registered_addon")
def test_a_missing_image_is_one_pixel_that_clips_and_fades_as_in_cycles(empty_scene: Any) -> None:
    """Images as Planes clip: a missing one fades to nothing at the border of its plane."""
    images = {space: make_lost(space) for space in ("sRGB", "Non-Color")} | {"none": None}

    def show(output: str, image: Any, **settings: Any) -> Any:
        return lambda tree: add_node(tree, "ShaderNodeTexImage", image=image, **settings).outputs[output]

    ways: dict[str, dict[str, str]] = {
        f"{extension} {interpolation}": {"extension": extension, "interpolation": interpolation}
        for extension in ("REPEAT", "EXTEND", "CLIP", "MIRROR")
        for interpolation in ("Closest", "Linear", "Cubic", "Smart")
    }
    ways |= {projection: {"extension": "CLIP", "projection": projection} for projection in ("BOX", "SPHERE", "TUBE")}
    configurations = {
        f"{name} {output} {way}": show(output, image, **settings)
        for way, settings in ways.items()
        for output in ("Color", "Alpha")
        for name, image in images.items()
    }
    differences, pictures, _ = measure_differences(empty_scene, configurations)
    assert {name: value for name, value in differences.items() if value > 1e-6} == {}
    assert pictures["sRGB Alpha CLIP Linear"][0].min() < 0.6


# Alpha ---------------------------------------------------------------------------------------------------------------

COLOR, ALPHA = np.array((0.3, 0.5, 0.1)), 0.4
ALPHA_MODES = ("STRAIGHT", "PREMUL", "CHANNEL_PACKED", "NONE")
# Half floats keep 11 bits, and PNG files of 16 bits were written from bytes.
STORED_TOLERANCE = 2.0**-10


def save_alpha(folder: Path, file_format: str, depth: str) -> Path:
    """Write a picture of one color and alpha, each channel as it is given."""
    settings = bpy.context.scene.render.image_settings
    set_image_format(settings, file_format)
    settings.color_mode, settings.color_depth = "RGBA", depth
    image = bpy.data.images.new("Written", 2, 2, alpha=True, float_buffer=file_format == "OPEN_EXR")
    image.pixels.foreach_set(np.tile(np.append(COLOR, ALPHA), 4).astype(np.float32))
    path = folder / f"{file_format}{depth}.image"
    image.save_render(str(path), scene=bpy.context.scene)
    return path


def show_alpha(image: Any, reads_alpha: bool) -> Any:
    """Return what makes the image's color; with `reads_alpha` alpha is read too, and adds next to nothing."""

    def make(tree: Any) -> Any:
        node = add_node(tree, "ShaderNodeTexImage", image=image, interpolation="Closest")
        if not reads_alpha:
            return node.outputs["Color"]
        inputs = {"Value": node.outputs["Alpha"], "Value_001": 1e-9}
        little = add_node(tree, "ShaderNodeMath", inputs, operation="MULTIPLY").outputs[0]
        inputs = {"Vector": node.outputs["Color"], "Vector_001": little}
        return add_node(tree, "ShaderNodeVectorMath", inputs, operation="ADD").outputs[0]

    return make


@pytest.mark.usefixtures("registered_addon")
@pytest.mark.parametrize("is_packed", [False, True])
@pytest.mark.parametrize(
    ("file_format", "depth"), [("OPEN_EXR", "32"), ("OPEN_EXR", "16"), ("PNG", "8"), ("PNG", "16")]
)
def test_alpha_modes_mean_what_the_manual_says(
    empty_scene: Any, tmp_path: Path, file_format: str, depth: str, is_packed: bool
) -> None:
    """A file holds color c and alpha a. Straight: the color is c, and c a where alpha is not read, for it masks.
    Premultiplied: c / a, and c. Otherwise: c. Cycles agrees on packed files, and on others where the mode is that of
    their format: by itself it takes OpenEXR for premultiplied and PNG for straight, whatever is set."""
    empty_scene.view_settings.view_transform = "Standard"
    path, configurations = save_alpha(tmp_path, file_format, depth), {}
    for mode in ALPHA_MODES:
        image = bpy.data.images.load(str(path), check_existing=False)
        image.alpha_mode = mode
        if is_packed:
            image.pack()
        configurations |= {f"{mode} {reads}": show_alpha(image, reads) for reads in (False, True)}
    differences, pictures, warnings = measure_differences(empty_scene, configurations)
    assert not warnings
    overruled = "STRAIGHT" if file_format == "OPEN_EXR" else "PREMUL"
    agreeing = [name for name in differences if is_packed or not name.startswith(overruled)]
    assert max(differences[name] for name in agreeing) < 1e-4
    if not is_packed:
        assert min(differences[name] for name in set(differences) - set(agreeing)) > 0.01
    if file_format == "OPEN_EXR":
        right = {"STRAIGHT": (COLOR * ALPHA, COLOR), "PREMUL": (COLOR, COLOR / ALPHA)}
        found = {mode: [pictures[f"{mode} {reads}"][0][1, 1] for reads in (False, True)] for mode in right}
        for mode, colors in right.items():
            assert_allclose(found[mode], colors, rtol=STORED_TOLERANCE)


@pytest.mark.usefixtures("registered_addon")
@pytest.mark.parametrize("is_packed", [False, True])
def test_files_of_16_bits_are_blended_between_pixels_as_in_cycles(
    empty_scene: Any, tmp_path: Path, is_packed: bool
) -> None:
    """Cycles blends the encoded numbers of those that it reads by itself, and linear ones of packed files."""
    settings = empty_scene.render.image_settings
    set_image_format(settings, "PNG")
    settings.color_mode, settings.color_depth = "RGBA", "16"
    empty_scene.view_settings.view_transform = "Standard"
    make_image(is_float=True, opaque=False).save_render(str(tmp_path / "image.png"), scene=empty_scene)
    configurations = {}
    for mode in ("STRAIGHT", "CHANNEL_PACKED", "NONE"):
        image = bpy.data.images.load(str(tmp_path / "image.png"), check_existing=False)
        image.alpha_mode = mode
        if is_packed:
            image.pack()
        configurations[mode] = lambda tree, image=image: add_node(
            tree, "ShaderNodeTexImage", image=image, interpolation="Linear"
        ).outputs["Color"]
    differences, _, _ = measure_differences(empty_scene, configurations)
    assert max(differences.values()) < 1e-4


def test_an_image_that_is_given_another_file_is_read_again(warnings: WarningList, tmp_path: Path) -> None:
    """Animations keep images, and a script may swap the file from frame to frame."""
    for name, value in (("one", 0.25), ("two", 0.75)):
        image = bpy.data.images.new(name, 1, 1)
        image.pixels.foreach_set([value, value, value, 1.0])
        image.file_format, image.filepath_raw = "PNG", str(tmp_path / f"{name}.png")
        image.save()
    shown, kept, found = bpy.data.images.load(str(tmp_path / "one.png")), Kept(trusts_files=True), []
    for name in ("one", "one", "two"):
        shown.filepath = str(tmp_path / f"{name}.png")
        table = ImageTable(kept)
        found.append(table.find_image(shown, None, "Image Texture", place(warnings)))
        kept.images = table.readings
    assert found[1] is found[0]
    assert [int(image.pixels[0, 0, 0]) for image in found] == [64, 64, 191]
