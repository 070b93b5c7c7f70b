"""Arrays to pictures on disk: the panels of a comparison, written as PNG.

The file is written here and not by Blender, whose image datablocks apply the scene's color management: a comparison
shows values. PNG needs a header, zlib and a checksum, all in Python's own library.

References
----------
"Portable Network Graphics (PNG) Specification", W3C, third edition, 2025; IEC 61966-2-1 (the sRGB curve).
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytracer.files.pictures import check_picture
from raytracer.files.replacing import replace_file

# Black, dark red, orange, yellow, white: no error to the largest error.
HEAT = np.array([(0, 0, 0), (120, 0, 40), (230, 90, 0), (255, 215, 60), (255, 255, 255)], dtype=np.float64)


def encode_srgb(linear: ArrayLike) -> NDArray[np.float64]:
    """Return the sRGB code values, 0 to 1, of linear values, clipped to what a screen can show."""
    clipped = np.clip(np.asarray(linear, dtype=np.float64), 0, 1)
    return np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * np.maximum(clipped, 0.0031308) ** (1 / 2.4) - 0.055)


def show_linear(image: ArrayLike) -> NDArray[np.uint8]:
    """Return (h, w, 3) bytes of a linear picture."""
    return np.rint(255 * encode_srgb(image)).astype(np.uint8)


def show_heat(error: ArrayLike) -> NDArray[np.uint8]:
    """Return (h, w, 3) bytes of an error map (h, w), 0 (black) to 1 (white)."""
    stops = np.linspace(0, 1, len(HEAT))
    channels = [np.interp(np.asarray(error), stops, HEAT[:, channel]) for channel in range(3)]
    return np.rint(np.stack(channels, axis=-1)).astype(np.uint8)


def save_png(path: str | Path, pixels: NDArray[np.uint8]) -> None:
    """Write (h, w, 3) bytes, row 0 at the top."""
    height, width, _ = pixels.shape
    rows = b"".join(b"\0" + row.tobytes() for row in pixels)  # each row: filter 0 (none), then its bytes
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)  # 8 bits, RGB
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(rows)), (b"IEND", b""))
    content = b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )
    with replace_file(path, lambda new: check_picture(new, width, height)) as new:
        new.write_bytes(b"\x89PNG\r\n\x1a\n" + content)
