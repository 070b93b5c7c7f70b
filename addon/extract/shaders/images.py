"""Images of image textures: pixels as Cycles interpolates them, read once for each image.

Byte images stay bytes, straight from Blender and still encoded; float images are scene linear already. Alpha is
multiplied in where Cycles does so: never for data, channel-packed images, or where alpha is switched off.

Whether a file's colors are multiplied by alpha is for its Alpha mode to say, as in Blender's manual and in all that
reads images through Blender: EEVEE, the viewport, and Cycles for packed and generated ones. Cycles reads other files by
itself, and there goes by their format alone: colors of an OpenEXR file set to Straight, or of a PNG set to
Premultiplied, are then wrong by the factor alpha.

References
----------
Blender, intern/cycles/scene/image_oiio.cpp (image_associate_alpha), blender/image.cpp; source/blender/imbuf/intern/
readimage.cc (imb_handle_alpha); manual, Editors > Image Editor > Image Settings > Alpha.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.scene.programs import FIRST_TILE, Image, TiledImage
from raytracer.textures.image import encode_srgb

from ... import versions
from ..kept import Kept
from ..warnings import WarningList
from .color_spaces import find_decoder
from .image_frames import find_frame, find_path, open_frame, open_movie
from .image_tiles import open_tiles
from .nodes import WarningContext

Pixels = NDArray[Any]
# An image's `session_uid`, its frame (of sequences the path, of movies the number, else empty), and what scripts may
# change from frame to frame: its file, color space and alpha mode.
ImageKey = tuple[int, str | int, str, str, str]

LARGEST_BYTE = 255
# Numbers that are converted at a time: a large image as a whole would need several times its own memory for what
# stands between, and to get so much from the system takes longer than to compute it.
BLOCK = 1 << 18
UNASSOCIATED_MODES = ("CHANNEL_PACKED", "NONE")
# A missing image in sRGB, which is decoded after interpolation as any other.
MAGENTA = Image(np.array([[(1.0, 0.0, 1.0, 1.0)]], dtype=np.float32), "srgb", "missing")
LINEAR_MAGENTA = Image(MAGENTA.pixels, "linear", "missing")


class Reading(NamedTuple):
    """What an image's pixels were read as, which may be kept: None for none, and what had to be said of it."""

    image: Image | TiledImage | None
    texts: tuple[str, ...] = ()


class ImageTable:
    """The scene's images, each read once, and again only if it may have changed since the last extraction.

    frame : of the scene, for sequences and movies; each frame of one is an image of its own
    """

    def __init__(self, kept: Kept | None = None, frame: int = 1) -> None:
        self.readings: dict[ImageKey, Reading] = {}
        self._kept, self._frame = kept or Kept(), frame
        self.sequences = 0  # how often one was asked for

    def find_image(self, image: Any, user: Any, node: str, place: WarningContext) -> Image | TiledImage | None:
        """Return an image as the tracer's, or None, which shows magenta, for none; magenta in its own color space for
        one whose file is missing.

        user : the ImageUser of the evaluated node that shows it
        """
        if image is None:
            return None
        frame: str | int = ""
        if image.source == "SEQUENCE":
            frame, self.sequences = find_path(image, user, self._frame), self.sequences + 1
        if image.source == "MOVIE":
            frame, self.sequences = find_frame(user, self._frame), self.sequences + 1
        settings = image.filepath, image.colorspace_settings.name, image.alpha_mode
        key = image.original.session_uid, frame, *settings
        if key not in self.readings:
            stays = self._kept.trusts(key[0]) or (self._kept.trusts_files and is_read_from_file(image))
            last = self._kept.images.get(key) if stays else None
            self.readings[key] = last or self._read(image, frame)
        found, texts = self.readings[key]
        for text in texts:
            place.warn(text)
        if found is None:
            is_layered = image.type == "MULTILAYER"  # known only now that its pixels were asked for
            reason = "has layers of passes, which are not supported" if is_layered else "is missing"
            place.warn(f"node '{node}': image '{image.name}' {reason}, magenta is shown")
            return MAGENTA if image.colorspace_settings.name == "sRGB" else None
        if isinstance(found, TiledImage):
            warn_of_tiles(image, found, place)
        return found

    def _read(self, image: Any, frame: str | int) -> Reading:
        """Read an image. What is to be said of it is kept with it: reading makes data-blocks, upon which a viewport
        asks for the scene anew, and would read for ever."""
        place = WarningContext(WarningList())
        found: Image | TiledImage | None = None
        if image.source == "TILED":
            found = extract_tiles(image, place)
        elif frame == "":
            found = extract_image(image, place)
        else:
            with open_movie(image, frame) if isinstance(frame, int) else open_frame(image, frame) as shown:
                found = None if shown is None else extract_image(shown, place)
        return Reading(found, tuple(warning.text for warning in place.warnings.records))


def is_associated(image: Any) -> bool:
    """True where an image's colors come multiplied by its alpha, and are divided by it where alpha is read as well."""
    return image is not None and not image.colorspace_settings.is_data and image.alpha_mode not in UNASSOCIATED_MODES


def extract_image(image: Any, place: WarningContext) -> Image | None:
    """Return an image's pixels, or None where they cannot be read."""
    width, height = image.size
    count = len(image.pixels)
    if not width or not height or not count:
        return None
    flat = np.empty(count, dtype=np.float32)
    image.pixels.foreach_get(flat)
    pixels = flat.reshape(height, width, -1)
    found = read_floats(drop_infinities(pixels)) if image.is_float else read_bytes(pixels)
    if image.alpha_mode == "NONE":
        found[..., 3] = LARGEST_BYTE if found.dtype == np.uint8 else 1.0
    if is_associated(image) and versions.multiplies_alpha(image):
        found = associate(found)
    if not image.is_float:
        return decode(found, image, place)
    if image.colorspace_settings.name == "sRGB" and is_read_from_file(image):
        return Image(encode(found, is_associated(image)), "srgb", image.name)
    return Image(found, "linear", image.name)


def extract_tiles(image: Any, place: WarningContext) -> TiledImage:
    """Return a tiled image; a tile that is missing is one magenta pixel, which clips and fades."""
    magenta = MAGENTA if image.colorspace_settings.name == "sRGB" else LINEAR_MAGENTA
    found = {number: extract_image(tile, place) or magenta for number, tile in open_tiles(image)}
    return TiledImage(list(found), list(found.values()), image.name)


def warn_of_tiles(image: Any, found: TiledImage, place: WarningContext) -> None:
    """Name what a tiled image does not show."""
    if image.is_dirty:
        place.warn(f"image '{image.name}': paint on its tiles is neither saved nor packed, and not shown")
    pairs = zip(found.numbers, found.tiles, strict=True)
    missing = [str(number) for number, tile in pairs if tile is MAGENTA or tile is LINEAR_MAGENTA]
    if missing:
        place.warn(f"image '{image.name}': tiles without pixels are shown in magenta: {', '.join(missing)}")


def find_first_tile(image: Image | TiledImage | None) -> Image | None:
    """Return the tile 1001 of a tiled image, or None where it has none; other images as they are.

    Cycles reads only that one through boxes, wherever their coordinates lead (scene/shader_nodes.cpp,
    ImageTextureNode::cull_tiles).
    """
    if not isinstance(image, TiledImage):
        return image
    return dict(zip(image.numbers.tolist(), image.tiles, strict=True)).get(FIRST_TILE)


def is_read_from_file(image: Any) -> bool:
    """True for an image that Cycles reads from its file by itself: neither packed nor generated nor painted on."""
    return image.source != "GENERATED" and not image.packed_file and not image.is_dirty


def encode(pixels: Pixels, associated: bool) -> Pixels:
    """Turn linear float pixels, in place, into what their sRGB file holds, which Cycles interpolates (16 bits each).

    associated : True where colors are multiplied by alpha, which then the encoded ones are
    """
    for rows in list_row_blocks(pixels):
        block = pixels[rows]
        alpha = np.where((block[..., 3:] > 0) & associated, block[..., 3:], 1.0).astype(np.float64)
        block[..., :3] = encode_srgb(block[..., :3] / alpha) * alpha
    return pixels


def drop_infinities(pixels: Pixels) -> Pixels:
    """Return float pixels with 0 for what is not finite, as Cycles has it (scene/image.cpp)."""
    return np.nan_to_num(pixels, copy=False, nan=0.0, posinf=0.0, neginf=0.0)


def read_floats(pixels: Pixels) -> Pixels:
    """Return float pixels (h, w, k) as color and alpha; one number is grey."""
    if pixels.shape[2] == 4:
        return pixels
    color = np.repeat(pixels, 3, axis=2) if pixels.shape[2] == 1 else pixels
    missing = 4 - color.shape[2]
    return np.concatenate([color, np.ones((*color.shape[:2], missing), np.float32)], axis=2)


def list_row_blocks(pixels: Pixels) -> Iterator[slice]:
    """Yield runs of rows of (h, w, k) pixels, of about BLOCK numbers each."""
    height, step = len(pixels), max(BLOCK // max(pixels[0].size, 1), 1)
    yield from (slice(start, start + step) for start in range(0, height, step))


def read_bytes(pixels: Pixels) -> Pixels:
    """Return pixels (h, w, k) of a byte image, which Blender hands out as k / 255, as bytes of color and alpha."""
    found = np.empty((*pixels.shape[:2], 4), dtype=np.uint8)
    for rows in list_row_blocks(pixels):
        found[rows] = np.rint(read_floats(pixels[rows]) * LARGEST_BYTE)
    return found


def associate(pixels: Pixels) -> Pixels:
    """Multiply colors by their alpha, in place; bytes are rounded down as in Cycles (blender/image.cpp)."""
    for rows in list_row_blocks(pixels):
        block = pixels[rows]
        if pixels.dtype != np.uint8:
            block[..., :3] *= block[..., 3:]
        elif (block[..., 3] != LARGEST_BYTE).any():
            block[..., :3] = block[..., :3].astype(np.uint16) * block[..., 3:] // LARGEST_BYTE
    return pixels


def decode(pixels: Pixels, image: Any, place: WarningContext) -> Image:
    """Return bytes in an image's color space; all but sRGB and data become scene linear floats before interpolation."""
    name = image.colorspace_settings.name
    if image.colorspace_settings.is_data:
        return Image(pixels, "linear", image.name)
    decoder = None if name == "sRGB" else find_decoder(name)
    if decoder is None:
        if name != "sRGB":
            place.warn(f"image '{image.name}': color space '{name}' is not supported, read as sRGB")
        return Image(pixels, "srgb", image.name)
    values = pixels.astype(np.float32) / np.float32(LARGEST_BYTE)
    values[..., :3] = decoder(values[..., :3])
    return Image(values, "linear", image.name)
