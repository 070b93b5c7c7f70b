"""Tiled images (UDIM) in our engine and in Cycles of the same Blender: files, packed and generated ones."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from addon.extract.kept import Changes, Kept
from addon.extract.shaders import images
from addon.extract.shaders.images import ImageTable
from addon.extract.shaders.nodes import WarningContext
from addon.extract.warnings import WarningList
from raytracer import TiledImage
from tests.addon.against_cycles.node_fixtures import Make, add_node, measure_differences
from tests.addon.against_cycles.node_sources import GENERATED, STEEP, assert_agreement, stretch

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]

SIZES = {1001: (5, 4), 1002: (3, 6), 1011: (2, 2), 1012: (1, 1)}
# Coordinates from -1.53 to 2.47: all tiles, what is cut off towards them, and squares without any.
AROUND = stretch(GENERATED, (4.0, 4.0, 1.0), (-1.53, -1.53, 0.0))


def save_tiles(folder: Path, file_format: str = "PNG", opaque: bool = True) -> str:
    """Write random pixels to a file for each tile; return their path."""
    rng, ending = np.random.default_rng(3), {"PNG": "png", "OPEN_EXR": "exr"}[file_format]
    for number, (width, height) in SIZES.items():
        tile = bpy.data.images.new("Tile", width, height, alpha=True, float_buffer=file_format == "OPEN_EXR")
        pixels = rng.random((height, width, 4)).astype(np.float32)
        pixels[..., 3] = 1.0 if opaque else pixels[..., 3]
        tile.pixels.foreach_set(pixels.ravel())
        tile.filepath_raw, tile.file_format = str(folder / f"tile.{number}.{ending}"), file_format
        tile.save()
        bpy.data.images.remove(tile)
    return str(folder / f"tile.<UDIM>.{ending}")


def load_tiles(path: str, *more: int, space: str = "") -> Any:
    """Return the tiled image of files, with numbers `more` that have no file."""
    image = bpy.data.images.load(path.replace("<UDIM>", "1001"), check_existing=False)
    image.source = "TILED"
    image.filepath = path
    for number in more:
        image.tiles.new(number)
    if space:
        image.colorspace_settings.name = space
    return image


def pack_tiles(path: str) -> Any:
    image = load_tiles(path)
    image.pack()
    return image


def generate_tiles() -> Any:
    """Return an image of two generated tiles, of one color each."""
    image = bpy.data.images.new("Generated", 8, 8, tiled=True, alpha=True)
    image.tiles.new(1012)
    for position, color in enumerate(((0.2, 0.5, 0.9, 1.0), (0.7, 0.1, 0.3, 1.0))):
        image.tiles.active_index = position
        with bpy.context.temp_override(edit_image=image):
            bpy.ops.image.tile_fill(color=color, width=4, height=6)
    return image


def show(image: Any, output: str = "Color", **settings: Any) -> Make:
    def build(tree: Any) -> Any:
        node = add_node(tree, "ShaderNodeTexImage", {"Vector": AROUND(tree)}, image=image, **settings)
        return node.outputs[output]

    return build


def test_tiles_agree(empty_scene: Any, tmp_path: Path, record_property: Any) -> None:
    path = save_tiles(tmp_path)
    files = load_tiles(path)
    configurations = {
        **{
            f"{interpolation} {extension}": show(files, interpolation=interpolation, extension=extension)
            for interpolation in ("Linear", "Closest", "Cubic")
            for extension in ("REPEAT", "EXTEND", "CLIP", "MIRROR")
        },
        "box": show(files, projection="BOX", projection_blend=0.3),
        "data": show(load_tiles(path, space="Non-Color")),
        "another space": show(load_tiles(path, space="Linear Rec.709")),
        "sphere": show(files, projection="SPHERE"),
        "tube": show(files, projection="TUBE"),
        "packed": show(pack_tiles(path)),
        "generated": show(generate_tiles()),
    }
    assert_agreement(configurations, STEEP, record_property)


@pytest.mark.parametrize("file_format", ["PNG", "OPEN_EXR"])
def test_tiles_with_alpha_agree(file_format: str, empty_scene: Any, tmp_path: Path, record_property: Any) -> None:
    path = save_tiles(tmp_path, file_format, opaque=False)
    configurations = {
        f"{output} {name}": show(image, output)
        for name, image in (("file", load_tiles(path)), ("packed", pack_tiles(path)))
        for output in ("Color", "Alpha")
    }
    assert_agreement(configurations, STEEP, record_property)


def test_a_missing_tile_is_one_magenta_pixel_as_in_cycles(empty_scene: Any, tmp_path: Path) -> None:
    """It clips and fades, unlike squares that the image has no tile for."""
    path = save_tiles(tmp_path)
    (tmp_path / "tile.1011.png").unlink()
    images = {space: load_tiles(path, 1011, space=space) for space in ("sRGB", "Non-Color")}
    configurations = {
        f"{space} {interpolation} {extension}": show(image, interpolation=interpolation, extension=extension)
        for space, image in images.items()
        for interpolation, extension in (("Linear", "CLIP"), ("Cubic", "CLIP"), ("Closest", "REPEAT"))
    }
    differences, _, warnings = measure_differences(empty_scene, configurations)
    assert max(differences.values()) < STEEP
    assert {warning.text.split("image ")[-1].split(": ", 1)[1] for warning in warnings} == {
        "tiles without pixels are shown in magenta: 1011"
    }


@pytest.mark.parametrize("make", [load_tiles, pack_tiles], ids=["files", "packed"])
def test_tiles_are_read_whole_and_the_image_stays_as_it_was(
    make: Callable[[str], Any], empty_scene: Any, tmp_path: Path
) -> None:
    image, warnings = make(save_tiles(tmp_path)), WarningList()
    before = [(tile.number, *tile.size) for tile in image.tiles], len(image.packed_files), len(bpy.data.images)
    found = ImageTable().find_image(image, None, "Node", WarningContext(warnings))
    assert isinstance(found, TiledImage)
    assert_array_equal(found.numbers, list(SIZES))
    assert [tile.pixels.shape[1::-1] for tile in found.tiles] == list(SIZES.values())
    after = [(tile.number, *tile.size) for tile in image.tiles], len(image.packed_files), len(bpy.data.images)
    assert after == before
    assert not warnings.records


def test_tiles_that_are_missing_are_read_once_and_named_each_time(empty_scene: Any, tmp_path: Path) -> None:
    """A viewport asks again after each reading, since that makes data-blocks: it must not read again."""
    image = load_tiles(save_tiles(tmp_path))
    for file in tmp_path.iterdir():
        file.unlink()
    image.reload()
    kept, tables = Kept(), []
    for _ in range(2):
        tables.append(ImageTable(kept))
        warnings = WarningList()
        found = tables[-1].find_image(image, None, "Node", WarningContext(warnings))
        (warning,) = warnings.records
        assert "tiles without pixels are shown in magenta: 1001" in warning.text
        kept = Kept(images=tables[-1].readings, changes=Changes(frozenset(), frozenset(), frozenset()))
    (kept_once,), (kept_again,) = (table.readings.values() for table in tables)
    assert kept_once is kept_again
    assert kept_once.image is found


@pytest.mark.parametrize("lost", [True, False], ids=["lost movie", "tiles in an unknown space"])
def test_what_is_warned_of_in_reading_is_read_once_too(
    empty_scene: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lost: bool
) -> None:
    """A viewport that met them never rested."""
    image = load_tiles(save_tiles(tmp_path))
    if lost:
        image = bpy.data.images.new("Movie", 1, 1)
        image.source, image.filepath = "MOVIE", str(tmp_path / "lost.mp4")
    else:
        image.colorspace_settings.name = "AgX Base sRGB"
    user = SimpleNamespace(frame_duration=1, frame_start=1, frame_offset=0, use_cyclic=False)
    opened: list[str] = []
    said: list[Any] = []
    kept = Kept()
    for name in ("open_movie", "open_tiles"):
        monkeypatch.setattr(images, name, note_calls(getattr(images, name), opened))
    for _ in range(2):
        table, warnings = ImageTable(kept), WarningList()
        table.find_image(image, user, "Node", WarningContext(warnings))
        said.append(warnings.records)
        kept = Kept(images=table.readings, changes=Changes(frozenset(), frozenset(), frozenset()))
    assert len(opened) == 1
    assert said[0] == said[1]
    assert len(said[0]) == 1


def note_calls(function: Callable[..., Any], calls: list[str]) -> Callable[..., Any]:
    def call(*arguments: Any) -> Any:
        calls.append(function.__name__)
        return function(*arguments)

    return call


def test_tiles_of_a_library_are_found_beside_it(empty_scene: Any, tmp_path: Path) -> None:
    """Paths in a library start at its own folder."""
    folder = tmp_path / "library"
    folder.mkdir()
    image = load_tiles(save_tiles(folder))
    image.name, image.filepath = "Linked", "//tile.<UDIM>.png"
    bpy.data.libraries.write(str(folder / "library.blend"), {image}, fake_user=True)
    bpy.data.images.remove(image)
    with bpy.data.libraries.load(str(folder / "library.blend"), link=True) as (_, linked):
        linked.images = ["Linked"]
    warnings = WarningList()
    found = ImageTable().find_image(bpy.data.images["Linked"], None, "Node", WarningContext(warnings))
    assert isinstance(found, TiledImage)
    assert [tile.pixels.shape[1::-1] for tile in found.tiles] == list(SIZES.values())
    assert not warnings.records


def test_an_environment_shows_the_first_tile_and_says_so(empty_scene: Any, tmp_path: Path) -> None:
    """Cycles asks for a file with <UDIM> in its name: magenta; of packed tiles it shows the first, too."""
    path = save_tiles(tmp_path)

    def build(image: Any) -> Make:
        return lambda tree: add_node(
            tree, "ShaderNodeTexEnvironment", {"Vector": GENERATED(tree)}, image=image
        ).outputs["Color"]

    configurations = {"files": build(load_tiles(path)), "packed": build(pack_tiles(path))}
    differences, pictures, warnings = measure_differences(empty_scene, configurations)
    assert differences["packed"] < STEEP
    assert_array_equal(pictures["files"][0], pictures["packed"][0])
    np.testing.assert_allclose(pictures["files"][1].reshape(-1, 3), np.tile((1, 0, 1), (64, 1)), atol=STEEP)
    assert all("environments have no tiles, tile 1001 is shown" in warning.text for warning in warnings)
    assert warnings


def test_tiles_with_unsaved_paint_are_named(empty_scene: Any) -> None:
    image, warnings = generate_tiles(), WarningList()
    image.pixels.foreach_set([0.25] * len(image.pixels))
    image.update()
    ImageTable().find_image(image, None, "Node", WarningContext(warnings))
    (warning,) = warnings.records
    assert "paint on its tiles is neither saved nor packed, and not shown" in warning.text
    image.pack()
    warnings = WarningList()
    found = ImageTable().find_image(image, None, "Node", WarningContext(warnings))
    assert isinstance(found, TiledImage)
    assert (found.tiles[0].pixels == (16, 16, 16, 64)).all()  # times alpha, in bytes
    assert not warnings.records
