"""What tells scenes apart: SHA-256 of all that decides their pictures, one for each field of the scene."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.scene.scene import Scene

# What tells an array that is kept alive from all others: address, shape, strides, type.
Identity = tuple[int, tuple[int, ...], tuple[int, ...], str]


def digest_scene(scene: Scene) -> dict[str, str]:
    """Return the SHA-256 of each field of a scene, in hexadecimal digits; names of records do not count.

    Examples
    --------
    >>> import raytracer
    >>> one, other = (raytracer.Scene(lights=[raytracer.PointLight((0, 0, 3), power)]) for power in (10, 20))
    >>> one, other = digest_scene(one), digest_scene(other)
    >>> [name for name in one if one[name] != other[name]]
    ['lights']
    """
    known: dict[Identity, tuple[str, NDArray[Any]]] = {}
    return {name: _digest(_outline(getattr(scene, name), known)) for name in _list_fields(scene)}


def _list_fields(record: Any) -> list[str]:
    return [item.name for item in dataclasses.fields(record) if item.name != "name"]


def _digest(outline: Any) -> str:
    return hashlib.sha256(json.dumps(outline).encode()).hexdigest()


def _outline(value: Any, known: dict[Identity, tuple[str, NDArray[Any]]]) -> Any:
    """Return records, sequences and plain values as JSON has them, with digests in place of arrays.

    An array is kept with its digest: another one must not come to lie where it was.
    """
    if dataclasses.is_dataclass(value):
        return [type(value).__name__, {name: _outline(getattr(value, name), known) for name in _list_fields(value)}]
    if isinstance(value, np.ndarray):
        identity = (value.__array_interface__["data"][0], value.shape, value.strides, value.dtype.str)
        if identity not in known:
            known[identity] = (_digest_array(value), value)
        return known[identity][0]
    if isinstance(value, tuple | list):
        return [_outline(item, known) for item in value]
    if isinstance(value, dict):
        return {name: _outline(item, known) for name, item in sorted(value.items())}
    return value.item() if isinstance(value, np.generic) else value


def _digest_array(array: NDArray[Any]) -> str:
    """Return the digest of an array: type, shape, and bytes in the order of little-endian processors."""
    little = np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
    head = f"{little.dtype.str} {array.shape} ".encode()
    digest = hashlib.sha256(head)
    digest.update(little.reshape(-1).view(np.uint8))  # type: ignore[arg-type]
    return digest.hexdigest()
