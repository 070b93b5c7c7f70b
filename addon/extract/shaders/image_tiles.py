"""Tiled images (UDIM): each of their tiles as an image of its own, for as long as it is read.

Python gets at the pixels of the first tile only. Of a copy, tiles are taken away from the front, so that each of them
comes first once: files and generated tiles are read so. What is packed would be lost with the first tile; each of its
files is packed into an image of its own instead. Paint that is neither saved nor packed is out of reach.

References
----------
Blender, source/blender/blenkernel/intern/image.cc (BKE_image_remove_tile); makesrna/intern/rna_image.cc
(rna_Image_pixels_get).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy


def open_tiles(image: Any) -> Iterator[tuple[int, Any]]:
    """Yield the number of each tile, and an image whose pixels are the tile's: none where it is missing.

    An image is gone as soon as the next is asked for.
    """
    return _open_packed(image) if image.packed_files else _open_copies(image)


def _open_copies(image: Any) -> Iterator[tuple[int, Any]]:
    copy = image.original.copy()
    try:
        for number in [tile.number for tile in copy.tiles]:
            if number != copy.tiles[0].number:
                copy.tiles.remove(copy.tiles[0])
            yield number, copy
    finally:
        bpy.data.images.remove(copy)


def _open_packed(image: Any) -> Iterator[tuple[int, Any]]:
    files = {file.tile_number: file.packed_file for file in image.packed_files}
    for number in [tile.number for tile in image.tiles]:
        tile = bpy.data.images.new(image.name, 1, 1)
        try:
            tile.source = "FILE"
            if number in files:
                tile.pack(data=bytes(files[number].data), data_len=files[number].size)
            tile.colorspace_settings.name = image.colorspace_settings.name
            tile.alpha_mode = image.alpha_mode
            yield number, tile
        finally:
            bpy.data.images.remove(tile)
