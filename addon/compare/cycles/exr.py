"""Read back what Blender's render operator wrote: uncompressed, scanline OpenEXR files with any number of passes.

Blender's Python cannot read the passes of a multilayer file (`Image.pixels` holds one at most) and brings no OpenEXR
module in its bpy wheels. Written without compression, such a file is a header and rows of numbers. Blender 4.2 writes
all passes into one part, 5.0 one part per pass.

References
----------
"OpenEXR File Layout", openexr.com: magic number, version and flags, headers, offset tables, chunks.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from raytracer.files.pictures import measure_picture

MAGIC = 20000630
TILED, DEEP, MULTIPART = 0x200, 0x800, 0x1000
PIXEL_TYPES = (np.dtype("<u4"), np.dtype("<f2"), np.dtype("<f4"))


@dataclass
class Part:
    """The header of one part: channel names with their types in file order, and the window in pixels."""

    channels: list[tuple[str, np.dtype]]
    left: int
    top: int
    width: int
    height: int


class Cursor:
    """A position in the bytes of a file."""

    def __init__(self, data: bytes) -> None:
        self.data, self.place = data, 0

    def take(self, count: int) -> bytes:
        self.place += count
        return self.data[self.place - count : self.place]

    def take_numbers(self, layout: str) -> tuple[int, ...]:
        return struct.unpack("<" + layout, self.take(struct.calcsize("<" + layout)))

    def take_name(self) -> str:
        name = self.take(self.data.index(0, self.place) - self.place).decode()
        self.place += 1
        return name


def read_exr(path: str | Path) -> dict[str, NDArray[np.float32]]:
    """Return the channels of an uncompressed OpenEXR file by name, (h, w) each, row 0 at the top.

    Raises
    ------
    ValueError
        If the file is not OpenEXR, is tiled, deep or compressed, or is not whole.
    """
    try:
        measure_picture(Path(path))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    cursor = Cursor(Path(path).read_bytes())
    magic, version = cursor.take_numbers("ii") if len(cursor.data) > 8 else (0, 0)
    if magic != MAGIC or version & (TILED | DEEP):
        raise ValueError(f"{path}: expected an OpenEXR file with scanlines")
    multipart = bool(version & MULTIPART)
    parts = []
    while part := _read_header(cursor, path):
        parts.append(part)
        if not multipart:
            break
    rows = sum(part.height for part in parts)
    cursor.take(8 * rows)
    channels = {name: np.zeros((part.height, part.width), np.float32) for part in parts for name, _ in part.channels}
    for _ in range(rows):
        part = parts[cursor.take_numbers("i")[0] if multipart else 0]
        row, _ = cursor.take_numbers("ii")
        for name, dtype in part.channels:
            channels[name][row - part.top] = np.frombuffer(cursor.take(dtype.itemsize * part.width), dtype)
    return channels


def _read_header(cursor: Cursor, path: str | Path) -> Part | None:
    """Read the attributes of one part; None at the empty header that ends the list."""
    attributes: dict[str, Cursor] = {}
    while name := cursor.take_name():
        cursor.take_name()  # the attribute's type
        attributes[name] = Cursor(cursor.take(cursor.take_numbers("i")[0]))
    if not attributes:
        return None
    if attributes["compression"].take(1) != b"\0":
        raise ValueError(f"{path}: expected an OpenEXR file without compression")
    left, top, right, bottom = attributes["dataWindow"].take_numbers("iiii")
    return Part(_read_channels(attributes["channels"]), left, top, right - left + 1, bottom - top + 1)


def _read_channels(cursor: Cursor) -> list[tuple[str, np.dtype]]:
    channels = []
    while name := cursor.take_name():
        pixel_type, *_ = cursor.take_numbers("iiii")  # then: perceptually linear, x and y sampling
        channels.append((name, PIXEL_TYPES[pixel_type]))
    return channels
