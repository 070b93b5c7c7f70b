"""Whether a picture on disk is whole: its size, and that it goes on to its end. PNG and OpenEXR, without decoding.

A full disk cuts a picture short wherever it likes, and what writes it (Blender) may not say so.

References
----------
"Portable Network Graphics (PNG) Specification", W3C, third edition, 2025: chunks, their checksums, IEND.
"OpenEXR File Layout", openexr.com: headers, offset tables, chunks, lines per chunk of each compression.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import BinaryIO, NamedTuple

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
EXR_MAGIC = struct.pack("<i", 20000630)
# Bits of the version of an OpenEXR file; pictures of several parts number the chunks of each.
TILED, DEEP, MULTIPART = 0x200, 0x800, 0x1000
# By number of the compression: none, RLE, ZIPS, ZIP, PIZ, PXR24, B44, B44A, DWAA, DWAB.
LINES_OF_CHUNK = (1, 1, 1, 16, 32, 16, 32, 32, 32, 256)
# More than any name or attribute of a header takes; a broken one may claim anything.
LARGEST_ATTRIBUTE = 1 << 20


def check_picture(path: Path, width: int, height: int) -> None:
    """Raise ValueError unless a .png or .exr is whole and has so many pixels."""
    found = measure_picture(path)
    if found != (width, height):
        raise ValueError(f"expected a picture of {width} x {height} pixels, got {found[0]} x {found[1]}")


def measure_picture(path: Path) -> tuple[int, int]:
    """Return the width and height of a .png or .exr; ValueError where it is not whole."""
    measure = measure_png if path.suffix.lower() == ".png" else measure_exr
    with path.open("rb") as file:
        try:
            return measure(file)
        except (struct.error, IndexError, KeyError):
            raise ValueError("the picture ends too early") from None


def measure_png(file: BinaryIO) -> tuple[int, int]:
    """Return the width and height of a PNG; ValueError where it is broken, or does not end with its last chunk."""
    if file.read(8) != PNG_SIGNATURE:
        raise ValueError("the picture does not begin as a PNG")
    size, kind = None, b""
    while kind != b"IEND":
        length, kind = struct.unpack(">I4s", file.read(8))
        content = file.read(length)
        if struct.pack(">I", zlib.crc32(kind + content)) != file.read(4):
            raise ValueError("the picture ends too early, or is broken")
        size = struct.unpack(">II", content[:8]) if kind == b"IHDR" else size
    if size is None or file.read(1):
        raise ValueError("the picture goes on after its end")
    return size


class Part(NamedTuple):
    """One part of an OpenEXR picture: its size in pixels, and how many chunks its lines stand in."""

    width: int
    height: int
    chunks: int


def measure_exr(file: BinaryIO) -> tuple[int, int]:
    """Return the width and height of an OpenEXR picture of scanlines; ValueError where it is broken.

    The offset table says where each chunk begins, and each chunk how long it is: the last one ends the file.
    """
    if file.read(4) != EXR_MAGIC:
        raise ValueError("the picture does not begin as an OpenEXR")
    (version,) = struct.unpack("<i", file.read(4))
    if version & (TILED | DEEP):
        raise ValueError("expected an OpenEXR of scanlines")
    parts = []
    while (part := read_part(file)) is not None:
        parts.append(part)
        if not version & MULTIPART:
            break
    chunks = sum(part.chunks for part in parts)
    offsets = struct.unpack(f"<{chunks}Q", file.read(8 * chunks))
    numbers, end = ("<iii" if version & MULTIPART else "<ii"), file.tell()
    for offset in offsets:
        file.seek(offset)
        *_, length = struct.unpack(numbers, file.read(struct.calcsize(numbers)))
        end = max(end, file.tell() + length)
        if offset == 0 or length < 0:
            raise ValueError("the picture ends too early")
    if file.seek(0, 2) != end:
        raise ValueError("the picture ends too early" if file.tell() < end else "the picture goes on after its end")
    return parts[0].width, parts[0].height


def read_part(file: BinaryIO) -> Part | None:
    """Read the header of one part; None at the empty header that ends the list."""
    attributes: dict[bytes, bytes] = {}
    while name := read_name(file):
        read_name(file)  # the attribute's type
        (length,) = struct.unpack("<i", file.read(4))
        if not 0 <= length <= LARGEST_ATTRIBUTE:
            raise ValueError("the picture is broken")
        attributes[name] = file.read(length)
    if not attributes:
        return None
    left, top, right, bottom = struct.unpack("<iiii", attributes[b"dataWindow"])
    lines, height = LINES_OF_CHUNK[attributes[b"compression"][0]], bottom - top + 1
    return Part(right - left + 1, height, -(-height // lines))


def read_name(file: BinaryIO) -> bytes:
    """Read a name that ends with a zero byte."""
    name = b""
    while (letter := file.read(1)) != b"\0":
        if not letter or len(name) > LARGEST_ATTRIBUTE:
            raise ValueError("the picture ends too early")
        name += letter
    return name
