"""The numbers of instances, which decide between surfaces at one place where nothing else does.

Of two surfaces that nothing passes, or of two glasses, the ray tracer goes by the numbers of their instances
(`raytracer.surfaces.layers`). Blender hands instances over in the order in which their objects were made; a picture
that followed it would change with a copy and paste. So they are numbered by what they are: smaller ones first, so that
a label is seen on its bottle and a rug on the floor, then by name, then by place; and what has all these in common, but
for the number that Blender gives a copy, by its shape and its materials, whatever order comes of that. (Cycles meets
whichever its tree holds first, and shades it by the shadow of the other: black.)
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from hashlib import blake2b
from typing import Any

import numpy as np
from numpy.typing import NDArray

import raytracer
from raytracer.arrays.types import Floats, Indices
from raytracer.scene.materials import Material

# So many sizes to a doubling: what differs by less than 4% counts as equal, for matrices in float32 round, and what
# turns or shakes must not change places with its like from frame to frame.
SIZES_PER_OCTAVE = 16
# What Blender adds to the name of a copy.
COPY_NUMBER = re.compile(r"\.\d{3,}$")


@dataclasses.dataclass(frozen=True)
class Shapes:
    """What instances show.

    extents : (meshes, 3) float64, metres, of the meshes along the axes of object space
    """

    meshes: Sequence[raytracer.Mesh]
    extents: Floats
    materials: Sequence[Material]


@dataclasses.dataclass(frozen=True)
class Traits:
    """What i instances are told apart by.

    part : (i,) numbers of what their objects are
    names, meshes : for each of these the object's name, and the number of its mesh
    world_from_object : (i, 4, 4) float64
    random : (i,) Blender's random numbers
    """

    part: Indices
    names: Sequence[str]
    meshes: Indices
    world_from_object: Floats
    random: Floats


def order_instances(traits: Traits, shapes: Shapes) -> NDArray[np.intp]:
    """Return the order (i,) of instances."""
    mesh = traits.meshes[traits.part]
    size = measure_sizes(traits.world_from_object, shapes.extents[mesh])
    keys: tuple[NDArray[Any], ...] = _find_places(traits), _rank_names(traits, COPY_NUMBER), size
    order = np.lexsort(keys)
    same = np.logical_and.reduce([(key[order[1:]] == key[order[:-1]]) for key in keys])  # (i - 1,) as the one before
    if not same.any():
        return order
    different = np.flatnonzero(same & (mesh[order[1:]] != mesh[order[:-1]]))
    if len(different):
        tied = np.unique(mesh[order[np.concatenate([different, different + 1])]])
        keys = (_rank_contents(mesh, tied, shapes), *keys)
    return np.lexsort((traits.random, _rank_names(traits), *keys))


def measure_sizes(world_from_object: Floats, extents: Floats) -> NDArray[np.int16]:
    """Return the sizes (i,) by which instances are told apart: logarithms of their boxes' diagonals, in steps.

    extents : (i, 3) float64, metres, along the axes of object space
    """
    square = sum((world_from_object[:, :3, axis] ** 2).sum(axis=1) * extents[:, axis] ** 2 for axis in range(3))
    with np.errstate(divide="ignore", over="ignore"):
        return np.clip(np.rint(SIZES_PER_OCTAVE / 2 * np.log2(square)), -(2**15), 2**15 - 1).astype(np.int16)


def _find_places(traits: Traits) -> Floats:
    """Return how far (i,) instances stand along an oblique direction, so that hardly two have one."""
    x, y, z = traits.world_from_object[:, :3, 3].T
    return x + np.sqrt(2.0) * y + np.sqrt(3.0) * z


def _rank_names(traits: Traits, without: re.Pattern[str] | None = None) -> NDArray[Any]:
    """Return the ranks (i,) of names in the alphabet."""
    names = [without.sub("", name) if without else name for name in traits.names]
    ranks = {name: rank for rank, name in enumerate(sorted(set(names)))}
    # Short integers are sorted faster.
    return np.array([ranks[name] for name in names]).astype(np.min_scalar_type(len(ranks)))[traits.part]


def _rank_contents(mesh: Indices, tied: Indices, shapes: Shapes) -> Floats:
    """Return ranks (i,) of instances by the contents of their meshes (i,), 0 for those that are not tied."""
    marks: dict[int, bytes] = {}
    contents = {int(index): summarize_mesh(shapes.meshes[index], shapes.materials, marks) for index in tied}
    ranks = {content: rank for rank, content in enumerate(sorted(set(contents.values())))}
    rank_of_mesh = np.zeros(len(shapes.meshes))
    rank_of_mesh[list(contents)] = [ranks[content] for content in contents.values()]
    return rank_of_mesh[mesh]


def summarize_mesh(mesh: raytracer.Mesh, materials: Sequence[Material], marks: dict[int, bytes] | None = None) -> bytes:
    """Return a mark of what a mesh and its materials are: by their contents, not their names and numbers.

    marks : those of materials, by number, that are known already; others join them
    """
    marks = {} if marks is None else marks
    used, first, place = np.unique(np.atleast_1d(mesh.material), return_index=True, return_inverse=True)
    for index in used.tolist():
        if index not in marks:
            marks[index] = summarize(materials[index])
    names = [marks[index] for index in used[np.argsort(first)].tolist()]
    shape = _Record("Mesh", list_fields(mesh) | {"material": 0})
    return summarize([np.argsort(np.argsort(first))[place], names, shape])


@dataclasses.dataclass(frozen=True)
class _Record:
    """The fields of a record, some of them others than its own: a changed copy would be validated as a whole."""

    kind: str
    fields: dict[str, Any]


def list_fields(record: Any) -> dict[str, Any]:
    """Return a record's fields by name, but for that which it is called."""
    return {field.name: getattr(record, field.name) for field in dataclasses.fields(record) if field.name != "name"}


def summarize(value: Any) -> bytes:
    """Return a mark of a record's, table's, list's or array's contents."""
    mark = blake2b((value.kind if isinstance(value, _Record) else type(value).__name__).encode())
    if isinstance(value, _Record):
        value = value.fields
    elif dataclasses.is_dataclass(value):
        value = list_fields(value)
    if isinstance(value, Mapping):
        value = [item for name in sorted(value) for item in (name, value[name])]
    if isinstance(value, np.ndarray):
        mark.update(repr((value.shape, value.dtype.str)).encode() + np.ascontiguousarray(value).tobytes())
    elif isinstance(value, list | tuple):
        for item in value:
            mark.update(summarize(item))
    else:
        mark.update(repr(value).encode())
    return mark.digest()
