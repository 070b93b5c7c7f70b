"""Arrays by name in one file, an .npz, beside an outline in JSON that says what they are; nothing is pickled.

References
----------
NumPy documentation, "numpy.lib.format": the .npy format, version 1.0.
PKWARE, ".ZIP File Format Specification": entries, their sizes, checksums and flags.
"""

from __future__ import annotations

import contextlib
import errno
import json
import math
import os
import re
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, Any, Literal

import numpy as np
from numpy.typing import NDArray

from raytracer.files.replacing import replace_file

# The outline of a million records takes less.
LARGEST_OUTLINE = 1 << 31

# What a broken file makes its parts raise: zipfile and zlib, JSON that is nested too deep, names that records lack.
FAULTS = (
    *(ValueError, TypeError, KeyError, OverflowError, RecursionError, EOFError),
    *(zipfile.BadZipFile, zlib.error, struct.error, NotImplementedError, RuntimeError),
)
# Deflate stores at most so many bytes in one (zlib's technical details: 1032).
MOST_DEFLATED = 1032
# Bytes that are decompressed at a time: an array is never there twice.
READ_SIZE = 1 << 24
ENCRYPTED = 0x1  # a bit of the flags of a ZIP entry
# The header of an array as `numpy.lib.format` (version 1.0) writes it, of the types that scenes have.
NPY_MAGIC = b"\x93NUMPY\x01\x00"
HEADER = re.compile(
    rb"\{'descr': '(?P<dtype>[<>|](?:[iu][1248]|f[48]|b1|U\d{1,10}))', 'fortran_order': (?P<fortran>True|False), "
    rb"'shape': \((?P<shape>(?:\d{1,18},? ?){0,8})\), \} *\n"
)


def write_archive(path: str | Path, arrays: Mapping[str, NDArray[Any]], compression: int = zipfile.ZIP_STORED) -> None:
    """Write arrays by name as the whole file."""
    with replace_file(path) as new, zipfile.ZipFile(new, "w", compression) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                np.lib.format.write_array(entry, array, allow_pickle=False)


@contextlib.contextmanager
def open_archive(path: str | Path, expected: str) -> Iterator[Archive]:
    """Open the file for the block, in which whatever is wrong with its content becomes one sentence.

    expected : what the file should be, for a sentence

    Raises
    ------
    ValueError
        If the block finds it to be something else, or it does not fit into memory, naming the file.
    OSError
        If it cannot be read, naming the file.
    """
    try:
        if os.path.exists(path) and not os.path.isfile(path) and not os.path.isdir(path):
            raise OSError(errno.EINVAL, "not a file")  # a pipe or a device, whose end may never come
        with open(path, "rb") as stream, zipfile.ZipFile(stream) as archive:
            yield Archive(archive, os.fstat(stream.fileno()).st_size)
    except OSError as error:
        raise OSError(error.errno or errno.EIO, error.strerror or str(error), str(path)) from error
    except MemoryError:
        raise ValueError(f"{path}: what it holds does not fit into memory") from None
    except FAULTS as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{path}: expected {expected}, got {reason}") from None


class Archive:
    """The arrays of a file by name, each read when it is asked for, and once.

    size : bytes of the file

    Headers are taken apart by one strict pattern: `numpy.lib.format` evaluates them as Python, which a broken one makes
    fail in many ways.
    """

    def __init__(self, archive: zipfile.ZipFile, size: int) -> None:
        self._archive, self.size = archive, size
        self._arrays: dict[str, NDArray[Any]] = {}

    def read_outline(self, file_format: str) -> dict[str, Any]:
        """Return the outline of a file of the format `file_format`, a table."""
        text = self.read("outline", LARGEST_OUTLINE)
        if text.shape != () or text.dtype.kind != "U":
            raise ValueError("an outline that is not text")
        content = json.loads(str(text))
        if not isinstance(content, dict) or content.get("format") != file_format:
            raise ValueError(f"format {content.get('format') if isinstance(content, dict) else content!r}")
        return content

    def has(self, name: str) -> bool:
        """True where the file holds an array of this name."""
        return f"{name}.npy" in self._archive.namelist()

    def read(self, name: str, largest: int | None = None, keep: bool = True) -> NDArray[Any]:
        """Return an array.

        largest : most bytes that it may take; None where the size of the file is limit enough
        keep : False where nobody asks for it again
        """
        array = self._arrays.get(name)
        if array is None:
            info = self._archive.getinfo(f"{name}.npy")
            if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) or info.flag_bits & ENCRYPTED:
                raise ValueError(f"{name} compressed or encrypted in another way")
            if info.compress_size > self.size or info.file_size > MOST_DEFLATED * (info.compress_size + 1):
                raise ValueError(f"{name} of a size that the file does not hold")
            with self._archive.open(info) as entry:
                array = self._read_array(name, entry, info.file_size, largest)
            if keep:
                self._arrays[name] = array
        return array

    def _read_array(self, name: str, entry: IO[bytes], size: int, largest: int | None) -> NDArray[Any]:
        start = entry.read(10)
        if len(start) < 10 or start[:8] != NPY_MAGIC:
            raise ValueError(f"{name} without the header of an array")
        header = entry.read(int.from_bytes(start[8:], "little"))
        match = HEADER.fullmatch(header)
        if match is None:
            raise ValueError(f"{name} with a broken header")
        shape = tuple(map(int, match["shape"].replace(b",", b" ").split()))
        dtype, count = np.dtype(match["dtype"].decode()), math.prod(shape)
        if count * dtype.itemsize != size - len(start) - len(header) or count * dtype.itemsize > (
            largest or self._most
        ):
            raise ValueError(f"{name} of {shape} {dtype}, which is not the size of what is stored")
        content = np.empty(count, dtype)
        read_into(entry, content.view(np.uint8))
        order: Literal["C", "F"] = "F" if match["fortran"] == b"True" else "C"
        array = content.reshape(shape, order=order)
        array.flags.writeable = False
        return array

    @property
    def _most(self) -> int:
        """The most bytes that a file of this size can hold."""
        return MOST_DEFLATED * self.size


def read_into(entry: IO[bytes], target: NDArray[np.uint8]) -> None:
    """Fill `target` with the rest of an entry, to its end, where zipfile compares the checksum."""
    for start in range(0, len(target), READ_SIZE):
        piece = entry.read(len(target[start : start + READ_SIZE]))
        target[start : start + len(piece)] = np.frombuffer(piece, np.uint8)
    if entry.read(1):
        raise ValueError("an entry that is longer than it says")


def take_table(value: Any) -> dict[str, Any]:
    """Return a part of the outline that must be a table."""
    if not isinstance(value, dict):
        raise ValueError(f"{type(value).__name__} in place of a table")
    return value
