"""Scenes on their way to another process: only arrays that it does not have yet are sent.

A scene is pickled with numbers in place of its larger arrays, which both sides keep as long as the last scene holds
them; new ones travel beside it. Nothing here knows of rendering.
"""

from __future__ import annotations

import io
import pickle
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Arrays of fewer bytes are cheaper to send again than to remember.
SMALLEST_KEPT = 1 << 10

# What tells an array that is kept alive from all others: address, shape, strides, type.
Identity = tuple[int, tuple[int, ...], tuple[int, ...], str]


@dataclass(frozen=True)
class Parcel:
    """What a `Sender` says of one object.

    outline : the object, pickled, with numbers in place of arrays
    arrays : the new arrays by number; they must not change before they have left
    dropped : numbers of arrays that are not needed any more
    """

    outline: bytes
    arrays: dict[int, NDArray[Any]]
    dropped: tuple[int, ...]


class Sender:
    """Packs one object after the other, each time without what the last one had in common with it."""

    def __init__(self) -> None:
        self._kept: dict[Identity, tuple[int, NDArray[Any]]] = {}
        self._count = 0

    def pack(self, content: Any) -> Parcel:
        """Return what the receiver needs."""
        used: dict[Identity, tuple[int, NDArray[Any]]] = {}
        stream = io.BytesIO()
        _Pickler(stream, self._number, used).dump(content)
        new = {number: array for identity, (number, array) in used.items() if identity not in self._kept}
        dropped = [number for identity, (number, _) in self._kept.items() if identity not in used]
        self._kept = used
        return Parcel(stream.getvalue(), new, tuple(dropped))

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


class Receiver:
    """Unpacks what one `Sender` packed, in the same order."""

    def __init__(self) -> None:
        self._kept: dict[int, NDArray[Any]] = {}

    def unpack(self, parcel: Parcel) -> Any:
        """Return the object; its larger arrays can only be read."""
        for number in parcel.dropped:
            del self._kept[number]
        for number, array in parcel.arrays.items():
            array.flags.writeable = False
            self._kept[number] = array
        return _Unpickler(io.BytesIO(parcel.outline), self._kept).load()


class _Unpickler(pickle.Unpickler):
    def __init__(self, stream: io.BytesIO, kept: dict[int, NDArray[Any]]) -> None:
        super().__init__(stream)
        self._kept = kept

    def persistent_load(self, number: Any) -> NDArray[Any]:
        return self._kept[number]
