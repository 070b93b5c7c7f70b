"""Entries of volumes: Volume objects and domains of smoke."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from .parts import (
    Context,
    ObjectEntry,
    PartEntry,
    list_keys,
    list_properties,
)
from .volume_objects import list_grids, read_geometry
from .warnings import WarningList


def make_volume_part(
    part: ObjectEntry, shown: Any, source: Any, sources: tuple[int, ...], own: WarningList, context: Context
) -> PartEntry | None:
    """Return what to show of a volume: of its materials the first that says what is inside; None without voxels."""
    assert context.materials is not None
    before = len(own.records)
    grids, override = list_grids(shown, source.name, own), context.view_layer.material_override
    if shown.type == "VOLUME" and shown.data.velocity_grid in grids and context.tracks and context.tracks.is_blur:
        own.add("velocities of voxels are not supported: in motion blur it moves as a whole", source.name)
    context.warnings.include(own.records[before:])
    if not grids:
        return None
    slots = tuple(range(max(1, len(shown.material_slots))))
    found = context.materials.find_slots(shown.material_slots, slots, override, source.name, grids)
    material = next((index for index in found if context.materials.records[index].volume is not None), None)
    if material is None:
        return None
    names, interpolation = context.materials.find_grids(material)
    entry = context.meshes.find_volume(
        source,
        (shown.data.as_pointer(), names, interpolation),
        lambda last, warnings: read_geometry(shown, source.name, names, interpolation, context.voxels, warnings, last),
    )
    if entry.geometry is None:
        return None
    index = context.meshes.find_index(entry, None, (material,), ())
    in_object_space = shown.type == "VOLUME" and shown.data.render.space == "OBJECT"
    part = replace(part, mesh=index, properties=list_properties((material,), context), density_by_scale=in_object_space)
    return PartEntry(part, entry, list_keys((material,), context), (), sources, own.records)
