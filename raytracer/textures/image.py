"""Image textures: pixels at coordinates, between pixels and beyond the border.

The centre of pixel (i, j) of a picture of w x h lies at u = (i + 1/2) / w, v = (j + 1/2) / h, row 0 at the bottom.
Stored numbers are blended first and decoded afterwards, as Cycles does.

References
----------
Blender, intern/cycles/kernel/device/cpu/image.h: borders and the cubic B-spline; kernel/svm/image.h
(svm_node_tex_image), in later versions kernel/image.h (kernel_image_udim_map): tiles.
IEC 61966-2-1: the curve of sRGB.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats
from raytracer.scene.programs import FIRST_TILE, Image, TiledImage

Indices = NDArray[np.int64]


EXTENSIONS = ("REPEAT", "EXTEND", "CLIP", "MIRROR")

# A square of texture space without a tile: magenta, whole, as a missing image.
MISSING = (1.0, 0.0, 1.0, 1.0)
TILES_PER_ROW = 10

# Coordinates further out than this are all the same beyond a border; keeps the numbers of pixels within 64 bits.
FARTHEST = 2.0**40


def decode_srgb(values: Floats) -> Floats:
    """Return linear numbers of sRGB ones; 0 for those below 0."""
    values = np.maximum(values, 0.0)
    return np.where(values < 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def encode_srgb(values: Floats) -> Floats:
    """Return sRGB numbers of linear ones, the inverse of `decode_srgb`."""
    values = np.maximum(values, 0.0)
    return np.where(values < 0.04045 / 12.92, values * 12.92, 1.055 * values ** (1 / 2.4) - 0.055)


def map_sphere(x: Floats, y: Floats, z: Floats) -> tuple[Floats, Floats]:
    """Return longitude and latitude (n,), 0 to 1, of points around the origin; 0 at the origin itself."""
    radius = np.sqrt(x * x + y * y + z * z)
    u = np.where((x == 0) & (y == 0), 0.0, (1.0 - np.arctan2(x, y) / np.pi) / 2.0)
    height = np.divide(z, radius, out=np.zeros_like(radius), where=radius > 0)
    return u, np.where(radius > 0, 1.0 - np.arccos(np.clip(height, -1.0, 1.0)) / np.pi, 0.0)


def _weigh_closest(at: Floats) -> tuple[Indices, list[Floats]]:
    return np.floor(at).astype(np.int64), [np.ones_like(at)]


def _weigh_linear(at: Floats) -> tuple[Indices, list[Floats]]:
    first = np.floor(at - 0.5)
    rest = at - 0.5 - first
    return first.astype(np.int64), [1.0 - rest, rest]


def _weigh_cubic(at: Floats) -> tuple[Indices, list[Floats]]:
    """The uniform cubic B-spline: it smooths, and does not pass through the pixels."""
    first = np.floor(at - 0.5)
    t = at - 0.5 - first
    weights = [
        (1.0 - t) ** 3 / 6.0,
        t * t * (t / 2.0 - 1.0) + 2.0 / 3.0,
        t * (t * (1.0 - t) + 1.0) / 2.0 + 1.0 / 6.0,
        t**3 / 6.0,
    ]
    return first.astype(np.int64) - 1, weights


INTERPOLATIONS: dict[str, Callable[[Floats], tuple[Indices, list[Floats]]]] = {
    "Closest": _weigh_closest,
    "Linear": _weigh_linear,
    "Cubic": _weigh_cubic,
    "Smart": _weigh_cubic,
}


def _wrap(index: Indices, size: int | Indices, extension: str) -> Indices:
    """Return the pixels (n,) that stand for those outside; CLIP's are wrong, and get no weight."""
    if extension == "REPEAT":
        return index % size
    if extension == "MIRROR":
        index = index % (2 * size)
        return np.where(index >= size, 2 * size - 1 - index, index)
    return np.clip(index, 0, size - 1)


def _find_taps(
    coordinate: Floats, size: int | Indices, interpolation: str, extension: str
) -> list[tuple[Indices, Floats]]:
    """Return the pixels along one axis, with their weights (n,)."""
    at = np.clip(np.nan_to_num(coordinate), -FARTHEST, FARTHEST) * size
    first, weights = INTERPOLATIONS[interpolation](at)
    taps = []
    for step, weight in enumerate(weights):
        index = first + step
        if extension == "CLIP":
            weight = np.where((index >= 0) & (index < size), weight, 0.0)
        taps.append((_wrap(index, size, extension), weight))
    return taps


def read_image(image: Image, uv: Floats, interpolation: str = "Linear", extension: str = "REPEAT") -> Floats:
    """Return what an image holds at coordinates, (n, 4) as stored; CLIP gives 0 outside.

    Parameters
    ----------
    uv : (n, 2) float64, (0, 0) the lower left corner and (1, 1) the upper right one
    interpolation : 'Closest', 'Linear', 'Cubic' or 'Smart' (which is cubic)
    extension : one of EXTENSIONS
    """
    height, width = image.pixels.shape[:2]
    total = blend_pixels(partial(image.pixels.reshape(-1, 4).take, axis=0), height, width, uv, interpolation, extension)
    return scale_stored(total, image)


def blend_pixels(
    read: Callable[[Indices], NDArray[Any]],
    height: int | Indices,
    width: int | Indices,
    uv: Floats,
    interpolation: str,
    extension: str,
) -> Floats:
    """Return the weighted sum (n, 4) of the pixels around coordinates (n, 2), in stored numbers.

    read : the pixels (n, 4) with numbers row * width + column (n,)
    height, width : of the image, or (n,) of each point's
    """
    rows = _find_taps(uv[:, 1], height, interpolation, extension)
    columns = _find_taps(uv[:, 0], width, interpolation, extension)
    total = np.zeros((4, len(uv)))
    for row, row_weight in rows:
        for column, column_weight in columns:
            weight = row_weight * column_weight
            for channel, stored in zip(total, read(row * width + column).T, strict=True):
                channel += weight * stored
    return total.T


def scale_stored(values: Floats, image: Image) -> Floats:
    """Return stored numbers as those that they stand for: 255 of a byte is 1."""
    return values / 255.0 if image.pixels.dtype == np.uint8 else values


def sample_image(
    image: Image | TiledImage,
    uv: Floats,
    interpolation: str = "Linear",
    extension: str = "REPEAT",
    unassociate: bool = False,
) -> Floats:
    """Return color and alpha (n, 4) at coordinates (n, 2), scene linear; `unassociate` divides the color by alpha."""
    if isinstance(image, TiledImage):
        return _sample_tiles(image, uv, interpolation, extension, unassociate)
    return finish_colors(read_image(image, uv, interpolation, extension), image.encoding, unassociate)


def finish_colors(values: Floats, encoding: str, unassociate: bool) -> Floats:
    """Return interpolated colors (n, 4) scene linear, in place; `unassociate` divides them by alpha."""
    if unassociate:
        alpha = values[:, 3:]
        values[:, :3] /= np.where((alpha != 0) & (alpha != 1), alpha, 1.0)
    if encoding == "srgb":
        values[:, :3] = decode_srgb(values[:, :3])
    return values


def find_tiles(uv: Floats) -> tuple[Indices, Floats]:
    """Return the numbers (n,) of the tiles that coordinates (n, 2) lie in, 0 for none, and the tiles' corners (n, 2).

    Cycles cuts coordinates off towards 0: what is less than 1 below an axis belongs to the tiles on that axis, beyond
    their border.
    """
    corners = np.trunc(np.clip(np.nan_to_num(uv), -FARTHEST, FARTHEST))
    column, row = corners.astype(np.int64).T
    is_within = (column >= 0) & (column < TILES_PER_ROW) & (row >= 0)
    return np.where(is_within, FIRST_TILE + column + TILES_PER_ROW * row, 0), corners


def _sample_tiles(image: TiledImage, uv: Floats, interpolation: str, extension: str, unassociate: bool) -> Floats:
    """Each tile is read alone, by the rest of the coordinates: none blends with its neighbors."""
    numbers, corners = find_tiles(uv)
    values = np.tile(MISSING, (len(uv), 1))
    for number, tile in zip(image.numbers, image.tiles, strict=True):
        rows = np.flatnonzero(numbers == number)
        if len(rows):
            values[rows] = sample_image(tile, uv[rows] - corners[rows], interpolation, extension, unassociate)
    return values
