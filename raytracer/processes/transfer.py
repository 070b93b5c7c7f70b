"""Scenes on their way to another process: only arrays that it does not have yet are sent.

A scene is pickled with numbers in place of its larger arrays, which both sides keep as long as the last scene holds
them; new ones go into a file that the receiver maps. Nothing here knows of rendering.
"""

from __future__ import annotations

import io
import mmap
import pickle
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Arrays of fewer bytes are cheaper to send again than to remember.
SMALLEST_KEPT = 1 << 10
# NumPy arrays are fastest on whole cache lines.
ALIGNMENT = 64

# What tells an array that is kept alive from all others: address, shape, strides, type.
Identity = tuple[int, tuple[int, ...], tuple[int, ...], str]


@dataclass(frozen=True)
class Parcel:
    """What a `Sender` says of one object; small.

    outline : the object, pickled, with numbers in place of arrays
    arrays : for each new array its number, type, shape and place in the file, bytes from its beginning
    dropped : numbers of arrays that are not needed any more
    path : the file of new arrays, or None without any
    """

    outline: bytes
    arrays: tuple[tuple[int, str, tuple[int, ...], int], ...]
    dropped: tuple[int, ...]
    path: Path | None


class Sender:
    """Packs one object after the other, each time without what the last one had in common with it."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._kept: dict[Identity, tuple[int, NDArray[Any]]] = {}
        self._count = self._files = 0

    def pack(self, content: Any) -> Parcel:
        """Return what the receiver needs; new arrays are written to a file."""
        used: dict[Identity, tuple[int, NDArray[Any]]] = {}
        stream = io.BytesIO()
        _Pickler(stream, self._number, used).dump(content)
        new = [entry for identity, entry in used.items() if identity not in self._kept]
        dropped = [number for identity, (number, _) in self._kept.items() if identity not in used]
        self._kept = used
        path = None
        if new:
            self._files += 1
            path = self._directory / f"arrays-{self._files}"
        return Parcel(stream.getvalue(), _write_arrays(new, path), tuple(dropped), path)

    def _number(self, array: NDArray[Any], used: dict[Identity, tuple[int, NDArray[Any]]]) -> int:
        identity = (array.ctypes.data, array.shape, array.strides, array.dtype.str)
        if identity not in used:
            if identity not in self._kept:
                self._count += 1
            used[identity] = self._kept.get(identity, (self._count, array))
        return used[identity][0]


class _Pickler(pickle.Pickler):
    def __init__(self, stream: io.BytesIO, number: Any, used: Any) -> None:
        super().__init__(stream, protocol=pickle.HIGHEST_PROTOCOL)
        self._number, self._used = number, used

    def persistent_id(self, value: Any) -> int | None:
        if type(value) is np.ndarray and value.nbytes >= SMALLEST_KEPT and not value.dtype.hasobject:
            return self._number(value, self._used)
        return None


def _write_arrays(entries: list[tuple[int, NDArray[Any]]], path: Path | None) -> tuple[Any, ...]:
    """Write arrays one after the other; return `Parcel.arrays`."""
    if path is None:
        return ()
    places, start = [], 0
    with open(path, "wb") as file:
        for number, array in entries:
            places.append((number, array.dtype.str, array.shape, start))
            file.write(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)
            file.write(bytes(-array.nbytes % ALIGNMENT))
            start += array.nbytes + -array.nbytes % ALIGNMENT
    return tuple(places)


class Receiver:
    """Unpacks what one `Sender` packed, in the same order."""

    def __init__(self) -> None:
        self._kept: dict[int, NDArray[Any]] = {}

    def unpack(self, parcel: Parcel) -> Any:
        """Return the object; its larger arrays are read-only views of the file, which may be deleted afterwards."""
        for number in parcel.dropped:
            del self._kept[number]
        if parcel.path is not None:
            with open(parcel.path, "rb") as file:
                data = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
            for number, dtype, shape, start in parcel.arrays:
                count = int(np.prod(shape))
                self._kept[number] = np.frombuffer(data, np.dtype(dtype), count, start).reshape(shape)
        return _Unpickler(io.BytesIO(parcel.outline), self._kept).load()


class _Unpickler(pickle.Unpickler):
    def __init__(self, stream: io.BytesIO, kept: dict[int, NDArray[Any]]) -> None:
        super().__init__(stream)
        self._kept = kept

    def persistent_load(self, number: Any) -> NDArray[Any]:
        return self._kept[number]
