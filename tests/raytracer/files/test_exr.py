"""OpenEXR pictures as written: decoded again by the format's description, number for number."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from raytracer.files.exr import LONG_NAMES, compress, pack_header, write_exr
from raytracer.files.pictures import measure_picture, read_name


def decompress(content: bytes, size: int) -> bytes:
    """Undo what a chunk of ZIP holds, a byte at a time."""
    if len(content) == size:
        return content
    octets = bytearray(zlib.decompress(content))
    for place in range(1, len(octets)):
        octets[place] = (octets[place - 1] + octets[place] - 128) % 256
    half = (len(octets) + 1) // 2
    joined = bytearray(len(octets))
    joined[0::2], joined[1::2] = octets[:half], octets[half:]
    return bytes(joined)


def read_exr(path: Path) -> dict[str, np.ndarray]:
    """Return the channels (h, w) of a picture with float channels and ZIP chunks."""
    with path.open("rb") as file:
        assert file.read(4) == b"\x76\x2f\x31\x01"
        assert struct.unpack("<i", file.read(4))[0] & 0xFF == 2
        attributes = {}
        while name := read_name(file):
            kind = read_name(file)
            attributes[name] = (kind, file.read(struct.unpack("<i", file.read(4))[0]))
        left, bottom, right, top = struct.unpack("<iiii", attributes[b"dataWindow"][1])
        width, height = right - left + 1, top - bottom + 1
        names = [part[:-17].decode() for part in split_channels(attributes[b"channels"][1])]
        offsets = struct.unpack(f"<{-(-height // 16)}Q", file.read(8 * -(-height // 16)))
        rows = []
        for offset in offsets:
            file.seek(offset)
            first, length = struct.unpack("<ii", file.read(8))
            count = min(16, height - first)
            raw = decompress(file.read(length), count * len(names) * width * 4)
            rows.append(np.frombuffer(raw, "<f4").reshape(count, len(names), width))
    picture = np.concatenate(rows)
    return {name: picture[:, number] for number, name in enumerate(names)}


def split_channels(listed: bytes) -> list[bytes]:
    """Return the entries of a list of channels: a name, a zero, sixteen bytes."""
    entries = []
    while listed != b"\0":
        end = listed.index(b"\0") + 17
        assert struct.unpack("<i", listed[end - 16 : end - 12]) == (2,)
        entries.append(listed[:end])
        listed = listed[end:]
    return entries


@pytest.mark.parametrize(("width", "height"), [(1, 1), (3, 16), (5, 17), (40, 50)])
@pytest.mark.parametrize("is_noise", [False, True])
def test_channels_come_back_as_they_were(tmp_path: Path, width: int, height: int, is_noise: bool) -> None:
    rng, path = np.random.default_rng(0), tmp_path / "picture.exr"
    values = rng.normal(size=(3, height, width)) if is_noise else np.linspace(0, 9, 3 * height * width)
    planes = values.reshape(3, height, width).astype(np.float32)
    planes[0, 0, 0], planes[1, -1, -1] = np.inf, -0.0
    write_exr(path, {"R": planes[0], "Normal.X": planes[1], "A": planes[2]})
    assert measure_picture(path) == (width, height)
    again = read_exr(path)
    assert list(again) == ["A", "Normal.X", "R"]
    for name, plane in (("R", planes[0]), ("Normal.X", planes[1]), ("A", planes[2])):
        assert again[name].tobytes() == plane.tobytes()


@pytest.mark.parametrize(
    ("name", "is_long"), [("a" * 31, False), ("a" * 32, True), ("я" * 15, False), ("я" * 16, True)]
)
def test_names_are_long_by_their_bytes(name: str, is_long: bool) -> None:
    """Letters were counted: OpenEXR refuses a file with long names that does not say so."""
    flags = int.from_bytes(pack_header([name], 1, 1)[4:8], "little")
    assert bool(flags & LONG_NAMES) == is_long


def test_smooth_pictures_become_smaller_and_noise_no_larger() -> None:
    smooth = np.linspace(0, 1, 4000, dtype=np.float32).tobytes()
    assert len(compress(smooth)) < 0.7 * len(smooth)
    noise = np.random.default_rng(0).integers(0, 256, 4001, dtype=np.uint8).tobytes()
    assert compress(noise) == noise
