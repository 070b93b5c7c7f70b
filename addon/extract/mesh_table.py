"""The scene's meshes: each evaluated mesh read once, and only if it may have changed since the last extraction.

What is read and turns out to be the same stays the same arrays, so that trees over them need not be built again.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import raytracer

from .adaptive import Adaptive, attach_base
from .attributes import Values, read_mesh_attribute
from .kept import Kept
from .meshes import Geometry, assign_materials, extract_geometry
from .warnings import Warning, WarningList

# What a mesh is called from one extraction to the next: the object it was met at first, and which of its meshes it is.
MeshKey = tuple[int, int]
# A record's materials, and the addresses of its attributes' arrays by name.
RecordKey = tuple[tuple[int, ...], tuple[tuple[str, int], ...]]


@dataclass(eq=False)
class MeshEntry:
    """One evaluated mesh.

    pointer : its address, which tells it from others of the same extraction; of a volume, with what is read of it
    geometry : its triangles, or None where it has none
    attributes : what materials read of it, by name; None = it has none of that name
    records : the scene's meshes made of it
    last : the same mesh in the last extraction, if it had the same triangles
    """

    pointer: Hashable
    geometry: Geometry | None
    warnings: tuple[Warning, ...]
    attributes: dict[str, Values | None] = field(default_factory=dict)
    records: dict[RecordKey, raytracer.Mesh] = field(default_factory=dict)
    last: MeshEntry | None = None


class MeshTable:
    """The scene's meshes: one per evaluated mesh and material assignment; assignments share their arrays."""

    def __init__(self, with_uvs: bool, warnings: WarningList, kept: Kept | None = None) -> None:
        self.records: list[raytracer.Mesh] = []
        self.geometries: list[Geometry] = []
        self.entries: dict[MeshKey, MeshEntry] = {}
        self._by_pointer: dict[Hashable, MeshEntry] = {}
        self._indices: dict[int, int] = {}
        self._count: Counter[int] = Counter()
        self._with_uvs, self._warnings, self._kept = with_uvs, warnings, kept or Kept()

    def find_entry(self, source: Any, pointer: int, mesh: Any, adaptive: Adaptive | None = None) -> MeshEntry:
        """Return the entry of an evaluated mesh.

        source : the object that has it
        pointer : the mesh's address; `mesh` may be a copy of it for reading
        adaptive : how `mesh`, which is what it was before its subdivision, is to be diced; None where it is not
        """
        if pointer not in self._by_pointer:
            key = self._make_key(source)
            last = self._kept.meshes.get(key)
            if last is not None and last.pointer == pointer and self._is_trusted(source, mesh):
                entry = last
            else:
                entry = self._read(source, pointer, mesh, last, adaptive)
            self._add(key, entry)
        return self._by_pointer[pointer]

    def find_volume(
        self, source: Any, pointer: Hashable, read: Callable[[Geometry | None, WarningList], Geometry | None]
    ) -> MeshEntry:
        """Return the entry of a volume.

        pointer : its data's address, with what is read of it
        read : makes its geometry, or returns that of the last extraction, which it is given, where it is the same
        """
        if pointer not in self._by_pointer:
            key, own = self._make_key(source), WarningList()
            last = self._kept.meshes.get(key)
            before = None if last is None else last.geometry
            geometry = read(before, own)
            is_same = geometry is not None and geometry is before
            self._add(key, MeshEntry(pointer, geometry, own.records, last=last if is_same else None))
        return self._by_pointer[pointer]

    def is_diced(self, index: int | None) -> bool:
        """Return whether one of the scene's meshes is to be diced."""
        return index is not None and self.geometries[index].base is not None

    def reuse(self, source: Any, last: MeshEntry) -> MeshEntry:
        """Return the entry of a mesh that is as it was in the last extraction."""
        if last.pointer not in self._by_pointer:
            self._add(self._make_key(source), last)
        return self._by_pointer[last.pointer]

    def find_index(self, entry: MeshEntry, mesh: Any, materials: tuple[int, ...], names: Iterable[str]) -> int:
        """Return the index of the scene's mesh with these materials for its used slots and the attributes `names`.

        mesh : to read attributes from; None where those of the last extraction hold
        """
        assert entry.geometry is not None
        found = {name: self._find_attribute(entry, mesh, name) for name in sorted(names)}
        attributes = {name: values for name, values in found.items() if values is not None}
        key = materials, tuple((name, id(values)) for name, values in attributes.items())
        if key not in entry.records:
            entry.records[key] = self._make_record(entry, key, attributes)
        record = entry.records[key]
        if id(record) not in self._indices:
            self._indices[id(record)] = len(self.records)
            self.records.append(record)
            self.geometries.append(entry.geometry)
        return self._indices[id(record)]

    def _make_key(self, source: Any) -> MeshKey:
        identity = source.original.session_uid
        self._count[identity] += 1
        return identity, self._count[identity]

    def _is_trusted(self, source: Any, mesh: Any) -> bool:
        original = source.original  # an evaluated mesh does not know its own
        return not mesh.is_editmode and self._kept.trusts_shapes(original.session_uid, original.data.session_uid)

    def _read(
        self, source: Any, pointer: int, mesh: Any, last: MeshEntry | None, adaptive: Adaptive | None
    ) -> MeshEntry:
        own = WarningList()
        geometry = extract_geometry(mesh, source.name, self._with_uvs, own, last.geometry if last else None)
        if geometry is not None:
            geometry = attach_base(geometry, mesh, adaptive)
        is_same = last is not None and geometry is last.geometry
        return MeshEntry(pointer, geometry, own.records, last=last if is_same else None)

    def _add(self, key: MeshKey, entry: MeshEntry) -> None:
        self._warnings.include(entry.warnings)
        self.entries[key] = entry
        self._by_pointer[entry.pointer] = entry

    def _find_attribute(self, entry: MeshEntry, mesh: Any, name: str) -> Values | None:
        if name in entry.attributes:
            return entry.attributes[name]
        assert entry.geometry is not None
        values = read_mesh_attribute(mesh, entry.geometry, name)
        known = entry.last.attributes.get(name) if entry.last else None
        is_same = known is not None and values is not None and np.array_equal(known, values)
        entry.attributes[name] = known if is_same else values
        return entry.attributes[name]

    def _make_record(self, entry: MeshEntry, key: RecordKey, attributes: dict[str, Values]) -> raytracer.Mesh:
        if entry.last is not None and key in entry.last.records:
            return entry.last.records[key]
        assert entry.geometry is not None
        return assign_materials(entry.geometry, key[0], attributes)

    def finish(self) -> dict[MeshKey, MeshEntry]:
        """Return what to keep: the entries, without those before them, and without meshes that are not in the scene."""
        for entry in self.entries.values():
            entry.last = None
            entry.records = {key: record for key, record in entry.records.items() if id(record) in self._indices}
        return self.entries
