"""The scene's materials, each extracted once and kept while it stays as it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

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

# Operations that read the random number or the color of an object.
OBJECT_READERS = frozenset(f"OBJECT_INFO {output}" for output in ("Color", "Alpha", "Random"))


@dataclass(frozen=True)
class MaterialEntry:
    """One material.

    identity : its `session_uid`, 0 for the default grey
    object_name : where it was met first, which its warnings say
    attributes, properties : names of those of meshes and of instances that it reads
    warnings : what could not be honoured
    displacement : what moves its surface, or None
    aovs : the passes that it was read for
    moves : True where it shows an image sequence or properties of the view layer, which change though nothing says so
    """

    identity: int
    object_name: str
    record: raytracer.Material
    attributes: frozenset[str]
    warnings: tuple[Warning, ...]
    moves: bool = False
    properties: frozenset[str] = frozenset()
    displacement: Displacement | None = None
    aovs: tuple[str, ...] = ()


class MaterialTable:
    """The scene's materials, each extracted once, numbered in the order they are met.

    aovs : the passes that materials may write
    """

    def __init__(
        self, warnings: WarningList, kept: Kept | None = None, frame: int = 1, aovs: tuple[str, ...] = ()
    ) -> None:
        self._aovs = aovs
        self.entries: list[MaterialEntry] = []
        self._indices: dict[int, int] = {}
        self._warnings, self._kept = warnings, kept or Kept()
        self.images = ImageTable(self._kept, frame)

    @property
    def records(self) -> list[raytracer.Material]:
        return [entry.record for entry in self.entries]

    def find_index(self, material: Any, object_name: str) -> int:
        """Return the index of an evaluated material, or of Cycles' default, grey, for None."""
        identity = material.original.session_uid if material is not None else 0
        if not self.can_reuse(identity, object_name):
            self._add(self._read(material, identity, object_name))
        return self.reuse(identity)

    def can_reuse(self, identity: int, object_name: str) -> bool:
        """True where a material is known, or is as it was in the last extraction."""
        last = self._kept.materials.get(identity)
        if identity in self._indices or last is None:
            return identity in self._indices
        says_same = not last.warnings or last.object_name == object_name
        return says_same and last.aovs == self._aovs and self._kept.trusts_materials and self._kept.trusts(identity)

    def reuse(self, identity: int) -> int:
        """Return the index of a material that can be reused."""
        if identity not in self._indices:
            self._add(self._kept.materials[identity])
        return self._indices[identity]

    def _read(self, material: Any, identity: int, object_name: str) -> MaterialEntry:
        own, sequences, layer = WarningList(), self.images.sequences, find_layer()
        reads, displacement = layer.reads, None
        if material is None:
            record = raytracer.Material((raytracer.Closure(versions.default_shader(), color=GREY),), name="default")
        else:
            record = extract_material(material, object_name, self.images, own, self._aovs)
            place = WarningContext(own, object_name, material.name)
            displacement = read_displacement(material, place, self.images)
        programs = list(record.programs)
        attributes: set[str] = set()
        if displacement is not None:
            programs.append(displacement.program)
            attributes = {VERTEX_NORMAL, SMOOTH}
        attributes |= {name for program in programs for name in list_attributes(program)}
        properties = frozenset(name for program in programs for name in list_properties(program))
        moves = self.images.sequences > sequences or layer.reads > reads
        return MaterialEntry(
            *(identity, object_name, record, frozenset(attributes), own.records, moves, properties, displacement),
            aovs=self._aovs,
        )

    def _add(self, entry: MaterialEntry) -> None:
        self._indices[entry.identity] = len(self.entries)
        self.entries.append(entry)
        self._warnings.include(entry.warnings)

    def find_identity(self, index: int) -> int:
        """Return the `session_uid` of a material, 0 for the default grey."""
        return self.entries[index].identity

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

    def find_slots(self, slots: Any, used: Sequence[int], override: Any, object_name: str) -> tuple[int, ...]:
        """Return the material index of each slot number in `used`; numbers beyond the last slot mean the last.

        slots : an object's material slots (data- or object-linked)
        override : the view layer's material for everything, or None
        """
        chosen = [slot.material for slot in slots] or [None]
        return tuple(self.find_index(override or chosen[min(slot, len(chosen) - 1)], object_name) for slot in used)
