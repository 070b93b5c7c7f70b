"""The scene's materials, each extracted once and kept while it stays as it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import raytracer
from raytracer.shading.displacement import Displacement
from raytracer.shading.evaluate import list_attributes, list_steps
from raytracer.shading.site_tables import TANGENT, UNDEFORMED

from ... import versions
from ..custom_properties import find_layer
from ..displacing import SMOOTH, VERTEX_NORMAL
from ..kept import Kept
from ..warnings import Warning, WarningList
from .closures import GREY
from .images import ImageTable
from .materials import extract_material, list_properties, read_displacement
from .node_settings import DEFAULT_UV
from .nodes import WarningContext
from .volumes import make_default_volume

# Operations that read the random number or the color of an object.
OBJECT_READERS = frozenset(f"OBJECT_INFO {output}" for output in ("Color", "Alpha", "Random"))


class MaterialKey(NamedTuple):
    """What a material is called from one extraction to the next.

    identity : its `session_uid`, 0 for the default one
    grids : names of those of the objects that have it: a program reads a grid that is there otherwise than none; None
        for surfaces, whose default is another one than that of volumes
    """

    identity: int
    grids: frozenset[str] | None = None


@dataclass(frozen=True)
class MaterialEntry:
    """One material.

    object_name : where it was met first, which its warnings say
    attributes, grids, properties : names of those of meshes and of instances that it reads
    warnings : what could not be honoured
    displacement : what moves its surface, or None
    aovs : the passes that it was read for
    interpolation : between the voxels of grids
    moves : True where it shows an image sequence or properties of the view layer, which change though nothing says so
    """

    key: MaterialKey
    object_name: str
    record: raytracer.Material
    attributes: frozenset[str]
    warnings: tuple[Warning, ...]
    moves: bool = False
    properties: frozenset[str] = frozenset()
    displacement: Displacement | None = None
    aovs: tuple[str, ...] = ()
    grids: frozenset[str] = frozenset()
    interpolation: str = "linear"


class MaterialTable:
    """The scene's materials, each extracted once, numbered in the order they are met.

    aovs : the passes that materials may write
    """

    def __init__(
        self, warnings: WarningList, kept: Kept | None = None, frame: int = 1, aovs: tuple[str, ...] = ()
    ) -> None:
        self._aovs = aovs
        self.entries: list[MaterialEntry] = []
        self._indices: dict[MaterialKey, int] = {}
        self._warnings, self._kept = warnings, kept or Kept()
        self.images = ImageTable(self._kept, frame)

    @property
    def records(self) -> list[raytracer.Material]:
        return [entry.record for entry in self.entries]

    def find_index(self, material: Any, object_name: str, grids: frozenset[str] | None = None) -> int:
        """Return the index of an evaluated material, or of Cycles' default for None.

        grids : the names of those of a volume; None for a surface
        """
        key = MaterialKey(material.original.session_uid if material is not None else 0, grids)
        if not self.can_reuse(key, object_name):
            self._add(self._read(material, key, object_name))
        return self.reuse(key)

    def can_reuse(self, key: MaterialKey, object_name: str) -> bool:
        """True where a material is known, or is as it was in the last extraction."""
        last = self._kept.materials.get(key)
        if key in self._indices or last is None:
            return key in self._indices
        says_same = not last.warnings or last.object_name == object_name
        is_same = self._kept.trusts_materials and self._kept.trusts(key.identity)
        return says_same and last.aovs == self._aovs and is_same

    def reuse(self, key: MaterialKey) -> int:
        """Return the index of a material that can be reused."""
        if key not in self._indices:
            self._add(self._kept.materials[key])
        return self._indices[key]

    def _read(self, material: Any, key: MaterialKey, object_name: str) -> MaterialEntry:
        own, sequences, layer = WarningList(), self.images.sequences, find_layer()
        reads, displacement = layer.reads, None
        if material is None and key.grids is not None:
            record = make_default_volume(self.images, key.grids)
        elif material is None:
            record = raytracer.Material((raytracer.Closure(versions.default_shader(), color=GREY),), name="default")
        else:
            record = extract_material(material, object_name, self.images, own, self._aovs, key.grids)
            place = WarningContext(own, object_name, material.name)
            displacement = read_displacement(material, place, self.images)
        inside = None if record.volume is None else record.volume.program
        programs = [program for program in record.programs if program is not inside]
        attributes: set[str] = set()
        if displacement is not None:
            programs.append(displacement.program)
            attributes = {VERTEX_NORMAL, SMOOTH}
        attributes |= {name for program in programs for name in list_attributes(program)}
        programs += [] if inside is None else [inside]
        properties = frozenset(name for program in programs for name in list_properties(program))
        moves = self.images.sequences > sequences or layer.reads > reads
        return MaterialEntry(
            *(key, object_name, record, frozenset(attributes), own.records, moves, properties, displacement),
            aovs=self._aovs,
            grids=frozenset() if inside is None else frozenset(list_attributes(inside)),
            interpolation=versions.read_voxel_interpolation(material),
        )

    def _add(self, entry: MaterialEntry) -> None:
        self._indices[entry.key] = len(self.entries)
        self.entries.append(entry)
        self._warnings.include(entry.warnings)

    def find_key(self, index: int) -> MaterialKey:
        """Return what a material is called from one extraction to the next."""
        return self.entries[index].key

    def find_grids(self, index: int) -> tuple[frozenset[str], str]:
        """Return the names of the grids that a material reads, and how it does so between their voxels."""
        return self.entries[index].grids, self.entries[index].interpolation

    def list_attributes(self, indices: Sequence[int]) -> set[str]:
        """Return the names of the mesh attributes that some of the materials read, or that tangents are made of."""
        names = set[str]().union(*(self.entries[index].attributes for index in indices))
        stand_in = {UNDEFORMED} if TANGENT + DEFAULT_UV in names else set()
        return {name.removeprefix(TANGENT) for name in names} | stand_in

    def list_properties(self, indices: Sequence[int]) -> frozenset[str]:
        """Return the names of the properties of instances that some of the materials read."""
        return frozenset().union(*(self.entries[index].properties for index in indices))

    @property
    def displacements(self) -> dict[int, Displacement]:
        """What moves surfaces, by the index of their material."""
        return {k: entry.displacement for k, entry in enumerate(self.entries) if entry.displacement is not None}

    @property
    def read_object_info(self) -> bool:
        """True where a material reads the random number or the color of its object."""
        programs = [program for record in self.records for program in record.programs]
        programs += [each.program for each in self.displacements.values()]
        return any(step.operation in OBJECT_READERS for program in programs for step in list_steps(program))

    def find_slots(
        self,
        slots: Any,
        used: Sequence[int],
        override: Any,
        object_name: str,
        grids: frozenset[str] | None = None,
    ) -> tuple[int, ...]:
        """Return the material index of each slot number in `used`; numbers beyond the last slot mean the last.

        slots : an object's material slots (data- or object-linked)
        override : the view layer's material for everything, or None
        grids : names of those of a volume; None for a surface
        """
        chosen = [slot.material for slot in slots] or [None]
        found = (override or chosen[min(slot, len(chosen) - 1)] for slot in used)
        return tuple(self.find_index(material, object_name, grids) for material in found)
