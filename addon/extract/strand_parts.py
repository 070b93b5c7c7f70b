"""Entries of strands: Curves objects, and hair that grows on objects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from .parts import (
    Context,
    ObjectEntry,
    PartEntry,
    describe_object,
    find_materials,
    find_visibility,
    list_attributes,
    list_keys,
    list_properties,
    renew_part,
)
from .strands import Strands, extract_curves, extract_hair, list_hair, list_particles
from .warnings import WarningList


def make_curves_part(shown: Any, source: Any, instancer: Any, context: Context) -> PartEntry | None:
    """Return what to show of a Curves object, or None without strands."""
    own, thick = WarningList(), context.thick_strands
    sources = (source.original, instancer.original, source.original.data)
    entry = make_strand_part(
        (shown, source, instancer),
        0,
        sources,
        lambda names: extract_curves(shown.data, source.name, thick, names, own),
        own,
        context,
    )
    context.warnings.include(own.records)
    return entry


def find_hair(shown: Any, source: Any, instancer: Any, context: Context) -> list[ObjectEntry]:
    """Return the hair on an object, one ObjectEntry for each particle system; as in the last extraction where nothing
    of it changed."""
    found: list[ObjectEntry] = []
    number = 0
    if not find_visibility(shown, instancer, context.view_layer):
        return found
    for row, (modifier, system) in enumerate(list_hair(source, context.is_render)):
        key = source.original.session_uid, instancer.original.session_uid, -1 - row
        entry = context.kept.parts.get(key)
        entry = renew_part(entry, source, context) if entry else None
        if entry is None:
            own = WarningList()
            sources = (source.original, instancer.original, source.original.data, system.settings.original)
            entry = make_strand_part(
                (shown, source, instancer),
                system.settings.material - 1,
                sources,
                partial(extract_hair, source, modifier, context.is_render, context.thick_strands, number, own),
                own,
                context,
            )
            context.warnings.include(own.records)
        number += len(list_particles(system, context.is_render))
        if entry is not None:
            context.entries[key] = entry
            found.append(entry.part)
    return found


def make_strand_part(
    objects: tuple[Any, Any, Any],
    slot: int,
    sources: tuple[Any, ...],
    extract: Callable[[set[str]], Strands | None],
    own: WarningList,
    context: Context,
) -> PartEntry | None:
    """Return an ObjectEntry of strands, or None without any.

    objects : what is shown, its source and its instancer; slot : of the material
    sources : the data-blocks that the strands are made of; extract : what reads them, given names of attributes
    """
    shown, source, instancer = objects
    materials = find_materials(shown, source, (max(slot, 0),), context)
    names = list_attributes(materials, context)
    strands = extract(names)
    if strands is None:
        return None
    part = describe_object(*objects, context, find_visibility(shown, instancer, context.view_layer))
    part = replace(part, material=materials[0], strands=strands, properties=list_properties(materials, context))
    identities = tuple(each.session_uid for each in sources)
    return PartEntry(part, None, list_keys(materials, context), tuple(names), identities, own.records)
