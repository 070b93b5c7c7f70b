"""Write OpenEXR pictures: lines of pixels, 32-bit floating point, compressed without loss (ZIP).

Lossless and in the precision of the film, for machines on which nothing else writes the format.

References
----------
"OpenEXR File Layout", openexr.com: header, offset table, chunks of 16 lines.
"Technical Introduction to OpenEXR", openexr.com: names of layers and their channels.
OpenEXR, src/lib/OpenEXRCore/internal_zip.c: bytes are split in halves and stored as differences before deflate.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import BinaryIO, Protocol

import numpy as np
from numpy.typing import NDArray

from raytracer.files.pictures import EXR_MAGIC, LINES_OF_CHUNK, check_picture
from raytracer.files.replacing import replace_file

ZIP = 3  # the number of the compression
FLOAT = 2  # the number of the pixel type
VERSION, LONG_NAMES = 2, 0x400
LONGEST_SHORT_NAME = 31  # bytes


class Plane(Protocol):
    """Numbers (h, w) float32, an array or what makes some of its lines when they are asked for."""

    @property
    def shape(self) -> tuple[int, ...]:
        """(h, w)."""

    def __getitem__(self, lines: slice, /) -> NDArray[np.float32]:
        """Return some lines (k, w)."""


def write_exr(path: str | Path, channels: Mapping[str, Plane]) -> None:
    """Write a picture whole, or not at all.

    Parameters
    ----------
    channels : (h, w) float32 by name, row 0 the top one; a dot parts the name of a layer from that of its channel

    Raises
    ------
    OSError
        If it cannot be written, naming the file.
    """
    names = sorted(channels)
    height, width = channels[names[0]].shape
    with replace_file(path, lambda new: check_picture(new, width, height)) as new, new.open("wb") as file:
        file.write(pack_header(names, width, height))
        write_chunks(file, [channels[name] for name in names], height)


def pack_header(names: list[str], width: int, height: int) -> bytes:
    """Return what a file begins with, up to the table of offsets."""
    flags = LONG_NAMES if max(len(name.encode()) for name in names) > LONGEST_SHORT_NAME else 0
    window = struct.pack("<iiii", 0, 0, width - 1, height - 1)
    listed = b"".join(name.encode() + b"\0" + struct.pack("<iBxxxii", FLOAT, 0, 1, 1) for name in names) + b"\0"
    attributes = (
        ("channels", "chlist", listed),
        ("compression", "compression", bytes([ZIP])),
        ("dataWindow", "box2i", window),
        ("displayWindow", "box2i", window),
        ("lineOrder", "lineOrder", b"\0"),
        ("pixelAspectRatio", "float", struct.pack("<f", 1.0)),
        ("screenWindowCenter", "v2f", struct.pack("<ff", 0.0, 0.0)),
        ("screenWindowWidth", "float", struct.pack("<f", 1.0)),
    )
    packed = (f"{name}\0{kind}\0".encode() + struct.pack("<i", len(value)) + value for name, kind, value in attributes)
    return EXR_MAGIC + struct.pack("<i", VERSION | flags) + b"".join(packed) + b"\0"


def write_chunks(file: BinaryIO, planes: Sequence[Plane], height: int) -> None:
    """Write the chunks of a picture, and before them where each begins."""
    lines = LINES_OF_CHUNK[ZIP]
    starts = range(0, height, lines)
    table = file.tell()
    file.write(bytes(8 * len(starts)))
    offsets = []
    for start in starts:
        offsets.append(file.tell())
        # A line after the other, in each all of a channel's pixels before those of the next.
        rows = np.stack([plane[start : start + lines] for plane in planes], axis=1)
        content = compress(rows.astype("<f4").tobytes())
        file.write(struct.pack("<ii", start, len(content)) + content)
    file.seek(table)
    file.write(struct.pack(f"<{len(offsets)}Q", *offsets))


def compress(raw: bytes) -> bytes:
    """Return a chunk's content: deflated differences, or the bytes themselves where that is no shorter.

    Of the bytes b, those of even places come first, then those of odd ones; then b_i - b_(i-1) + 128 modulo 256.
    """
    octets = np.frombuffer(raw, np.uint8)
    parted = np.concatenate([octets[0::2], octets[1::2]])
    parted[1:] = parted[1:] - parted[:-1] + np.uint8(128)
    packed = zlib.compress(parted.tobytes())
    return packed if len(packed) < len(raw) else raw
