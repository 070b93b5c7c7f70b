"""Scenes as files: one .npz that holds a JSON outline and the arrays it refers to; nothing is pickled."""

from __future__ import annotations

import dataclasses
import errno
import json
import math
import os
import re
import struct
import zipfile
import zlib
from pathlib import Path
from typing import IO, Any, Literal

import numpy as np
from numpy.typing import NDArray

from raytracer.files.replacing import replace_file
from raytracer.scene.camera import Camera, Panorama
from raytracer.scene.lights import AreaLight, LightNodes, PointLight, SpotLight, SunLight, World
from raytracer.scene.materials import Closure, Material
from raytracer.scene.programs import Image, Program, Register, Step, TiledImage
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Instances, Mesh, Spheres

FILE_FORMAT = "reference-raytracer-scene-1"

# What a broken file makes its parts raise: zipfile and zlib, JSON that is nested too deep, names that records lack.
FAULTS = (
    *(ValueError, TypeError, KeyError, OverflowError, RecursionError, EOFError),
    *(zipfile.BadZipFile, zlib.error, struct.error, NotImplementedError, RuntimeError),
)
# Deflate stores at most so many bytes in one (zlib's technical details: 1032).
MOST_DEFLATED = 1032
# The outline of a million records takes less.
LARGEST_OUTLINE = 1 << 31
ENCRYPTED = 0x1  # a bit of the flags of a ZIP entry
# The header of an array as `numpy.lib.format` (version 1.0) writes it, of the types that scenes have.
NPY_MAGIC = b"\x93NUMPY\x01\x00"
HEADER = re.compile(
    rb"\{'descr': '(?P<dtype>[<>|](?:[iu][1248]|f[48]|b1|U\d{1,10}))', 'fortran_order': (?P<fortran>True|False), "
    rb"'shape': \((?P<shape>(?:\d{1,18},? ?){0,8})\), \} *\n"
)

RECORDS = {
    record.__name__: record
    for record in (
        *(Mesh, Spheres, Instances, Closure, Material, PointLight, SpotLight, SunLight, AreaLight),
        *(LightNodes, World, Camera, Panorama, Scene, Program, Step, Register, Image, TiledImage),
    )
}


def save(scene: Scene, path: str | Path) -> None:
    """Write `scene` as one .npz: a JSON outline plus the arrays it refers to; nothing is pickled.

    Arrays that records share in memory are written once.

    Examples
    --------
    >>> import tempfile, pathlib, raytracer
    >>> scene = raytracer.Scene(spheres=raytracer.Spheres([(0, 0, 0)], [1.0]))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "scene.npz"
    ...     raytracer.save(scene, path)
    ...     again = raytracer.load(path)
    >>> again.spheres[0].radii.tolist()
    [1.0]
    """
    arrays: dict[str, NDArray[Any]] = {}
    keys: dict[tuple[int, tuple[int, ...], str], str] = {}

    def outline(value: Any) -> Any:
        if dataclasses.is_dataclass(value):
            fields = {item.name: outline(getattr(value, item.name)) for item in dataclasses.fields(value)}
            return {"record": type(value).__name__, "fields": fields}
        if isinstance(value, np.ndarray):
            memory = (value.__array_interface__["data"][0], value.shape, value.dtype.str)
            arrays[keys.setdefault(memory, f"array_{len(keys)}")] = value
            return {"array": keys[memory]}
        if isinstance(value, tuple):
            return [outline(item) for item in value]
        if isinstance(value, dict):
            return {"table": {name: outline(item) for name, item in value.items()}}
        return value.item() if isinstance(value, np.generic) else value

    if not isinstance(scene, Scene):
        raise ValueError(f"save: expected a Scene, got {type(scene).__name__}")
    text = json.dumps({"format": FILE_FORMAT, "scene": outline(scene)})
    with replace_file(path) as new, zipfile.ZipFile(new, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in {"outline": np.array(text), **arrays}.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                np.lib.format.write_array(entry, array, allow_pickle=False)


def load(path: str | Path) -> Scene:
    """Read a scene written by `save`; every record is validated again.

    Only arrays that the outline names are read, each after its declared size is checked.

    Raises
    ------
    ValueError
        If the file is not such a scene or does not fit into memory, naming the file.
    OSError
        If it cannot be read, naming the file.

    Examples
    --------
    >>> import tempfile, pathlib, raytracer
    >>> scene = raytracer.Scene(spheres=raytracer.Spheres([(0, 0, 0)], [1.0]))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "scene.npz"
    ...     raytracer.save(scene, path)
    ...     again = raytracer.load(path)
    >>> again.spheres[0].radii.tolist()
    [1.0]
    """
    try:
        if os.path.exists(path) and not os.path.isfile(path) and not os.path.isdir(path):
            raise OSError(errno.EINVAL, "not a file")  # a pipe or a device, whose end may never come
        with open(path, "rb") as stream, zipfile.ZipFile(stream) as archive:
            return read_scene(Archive(archive, os.fstat(stream.fileno()).st_size))
    except OSError as error:
        raise OSError(error.errno or errno.EIO, error.strerror or str(error), str(path)) from error
    except MemoryError:
        raise ValueError(f"{path}: the scene does not fit into memory") from None
    except FAULTS as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{path}: expected a scene written by raytracer.save ({FILE_FORMAT}), got {reason}") from None


def read_scene(archive: Archive) -> Scene:
    """Return the scene in an archive; ValueError where it holds something else."""
    text = archive.read("outline", LARGEST_OUTLINE)
    if text.shape != () or text.dtype.kind != "U":
        raise ValueError("an outline that is not text")
    content = json.loads(str(text))
    if not isinstance(content, dict) or content.get("format") != FILE_FORMAT:
        raise ValueError(f"format {content.get('format') if isinstance(content, dict) else content!r}")
    scene = _restore(content.get("scene"), archive)
    if not isinstance(scene, Scene):
        raise ValueError(f"a {type(scene).__name__}")
    return scene


class Archive:
    """The arrays of a scene file by name, each read when it is asked for, and once.

    Headers are taken apart by one strict pattern: `numpy.lib.format` evaluates them as Python, which a broken one makes
    fail in many ways.
    """

    def __init__(self, archive: zipfile.ZipFile, size: int) -> None:
        self._archive, self._size = archive, size
        self._arrays: dict[str, NDArray[Any]] = {}

    def read(self, name: str, largest: int | None = None) -> NDArray[Any]:
        """Return an array.

        largest : most bytes that it may take; None where the size of the file is limit enough
        """
        if name not in self._arrays:
            info = self._archive.getinfo(f"{name}.npy")
            if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) or info.flag_bits & ENCRYPTED:
                raise ValueError(f"{name} compressed or encrypted in another way")
            if info.compress_size > self._size or info.file_size > MOST_DEFLATED * (info.compress_size + 1):
                raise ValueError(f"{name} of a size that the file does not hold")
            with self._archive.open(info) as entry:
                self._arrays[name] = self._read_array(name, entry, info.file_size, largest)
        return self._arrays[name]

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
        content = entry.read()  # to its end, where zipfile compares the checksum
        order: Literal["C", "F"] = "F" if match["fortran"] == b"True" else "C"
        return np.frombuffer(content, dtype).reshape(shape, order=order)

    @property
    def _most(self) -> int:
        """The most bytes that a file of this size can hold."""
        return MOST_DEFLATED * self._size


def _restore(value: Any, archive: Archive) -> Any:
    """Rebuild a record, sequence, array or plain value from its outline."""
    if isinstance(value, list):
        return tuple(_restore(item, archive) for item in value)
    if isinstance(value, dict) and "array" in value:
        if not isinstance(value["array"], str):
            raise ValueError(f"an array named {value['array']!r}")
        return archive.read(value["array"])
    if isinstance(value, dict) and "table" in value:
        return {name: _restore(item, archive) for name, item in take_table(value["table"]).items()}
    if isinstance(value, dict):
        record = RECORDS.get(value.get("record", ""))
        if record is None:
            raise ValueError(f"a record of the kind {value.get('record')!r}")
        return record(**{name: _restore(item, archive) for name, item in take_table(value.get("fields")).items()})
    return value


def take_table(value: Any) -> dict[str, Any]:
    """Return a part of the outline that must be a table."""
    if not isinstance(value, dict):
        raise ValueError(f"{type(value).__name__} in place of a table")
    return value
