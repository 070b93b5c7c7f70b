"""What stands where: one walk over the depsgraph's object instances.

An iterator's items die with its next step, so the walk turns each distinct combination of object, instancer and data
into an ObjectEntry and copies matrices as it goes: reading all at once with `foreach_get` leaks memory in Blender 4.2.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from raytracer.scene.fields import SEEN_BY

from .. import versions
from .adaptive import read_adaptive
from .attributes import read_point_attributes
from .instance_properties import InstanceReader
from .light_nodes import read_light_nodes
from .linking import read_linking
from .meshes import extract_points, open_mesh
from .parts import (
    RAY_VISIBILITY,
    Context,
    ObjectEntry,
    ObjectKey,
    PartEntry,
    Placements,
    describe_object,
    find_materials,
    find_visibility,
    list_attributes,
    list_keys,
    list_properties,
    renew_part,
)
from .random_numbers import fill_random, pack_name, read_random
from .shaders.nodes import WarningContext
from .strand_parts import find_hair, make_curves_part
from .volume_objects import is_volume
from .volume_parts import make_volume_part
from .warnings import WarningList


def walk_instances(depsgraph: Any, context: Context) -> Placements:
    """Return all that a depsgraph shows and that we can show."""
    placements, reader = Placements(), InstanceReader(depsgraph.scene_eval.frame_current_final)
    known: dict[tuple[int, int, int, bool, bool], range] = {}
    for instance in depsgraph.object_instances:
        shown, data = instance.object, instance.object.data
        what = instance.show_self, instance.show_particles
        if data is None or not any(what):
            continue
        if context.space is not None and not shown.visible_in_viewport_get(context.space):
            continue
        is_instance = instance.is_instance
        source = instance.instance_object if is_instance else shown
        instancer = instance.parent if is_instance else shown
        # `shown` itself is one of two scratch objects while Blender walks instances: no key.
        key = (source.as_pointer(), instancer.as_pointer(), data.as_pointer(), *what)
        if key not in known:
            parts = list_parts(shown, source, instancer, what, context)
            known[key] = range(len(placements.parts), len(placements.parts) + len(parts))
            for part in parts:
                placements.parts.append(part)
                placements.links.append(read_linking(source, instancer))
        for number in known[key]:
            part = placements.parts[number]
            placements.part.append(number)
            placements.world_from_object.append(np.array(instance.matrix_world, dtype=np.float64))
            placements.random.append(read_random(instance.random_id) if is_instance else math.nan)
            placements.properties.append(reader.read(instance, part.properties) if part.properties else {})
            if context.tracks is not None:
                if part.strands is None:
                    is_diced = context.meshes.is_diced(part.mesh)
                    context.tracks.note(instance, source, instancer, part.mesh, is_diced)
                else:
                    context.tracks.note_strands(instance, source, instancer, part.mesh)
    fill_random(placements.random, [placements.parts[index].name_word for index in placements.part])
    return placements


def list_parts(shown: Any, source: Any, instancer: Any, what: tuple[bool, bool], context: Context) -> list[ObjectEntry]:
    """Return what to show of an object: itself, the hair on it, or both."""
    itself = find_part(shown, source, instancer, context) if what[0] else None
    parts = [] if itself is None else [itself]
    if what[1] and context.shows_strands and source.particle_systems:
        parts += find_hair(shown, source, instancer, context)
    return parts


def find_part(shown: Any, source: Any, instancer: Any, context: Context) -> ObjectEntry | None:
    """Return what to show of an object, or None; as in the last extraction where nothing of it changed."""
    of_voxels = context.materials is not None and is_volume(shown)
    if (of_voxels and not context.view_layer.use_volumes) or (shown.type == "CURVES" and not context.shows_strands):
        return None
    if not of_voxels and shown.type not in ("MESH", "POINTCLOUD", "CURVES"):
        return make_light_part(shown, source, instancer, context) if shown.type == "LIGHT" else None
    if shown.type == "MESH" and not of_voxels and not context.shows_surfaces:
        return None
    key = source.original.session_uid, instancer.original.session_uid, shown.data.as_pointer()
    entry = context.kept.parts.get(key)
    entry = renew_part(entry, source, context) if entry else None
    if entry is None:
        entry = make_part(shown, source, instancer, context, of_voxels)
    if entry is None:
        return None
    context.entries[key] = entry
    return entry.part


def make_part(shown: Any, source: Any, instancer: Any, context: Context, of_voxels: bool) -> PartEntry | None:
    """Return what to show of an object with a mesh, points, strands or voxels, or None: nothing in it, or hidden from
    all rays."""
    own = WarningList()
    seen_by = find_visibility(shown, instancer, context.view_layer)
    if shown.type == "CURVES":
        return make_curves_part(shown, source, instancer, context) if seen_by else None
    points = extract_points(shown.data, source.name, own) if seen_by and shown.type == "POINTCLOUD" else None
    context.warnings.include(own.records)
    if not seen_by or (shown.type == "POINTCLOUD" and points is None):
        return None
    part = describe_object(shown, source, instancer, context, seen_by)
    sources = tuple(found.session_uid for found in (source.original, instancer.original, source.original.data))
    if of_voxels:
        return make_volume_part(part, shown, source, sources, own, context)
    if points is not None:
        materials = find_materials(shown, source, (0,), context)
        names = list_attributes(materials, context)
        points = replace(points, attributes=read_point_attributes(shown.data, points, names))
        return PartEntry(
            replace(part, material=materials[0], points=points, properties=list_properties(materials, context)),
            None,
            list_keys(materials, context),
            tuple(names),
            sources,
            own.records,
        )
    adaptive = read_adaptive(source, shown, context.dicing, own)
    context.warnings.include(own.records)
    with open_mesh(source, shown.data, adaptive is not None) as mesh:
        entry = context.meshes.find_entry(source, shown.data.as_pointer(), mesh, adaptive)
        if entry.geometry is None:
            return None
        materials = find_materials(shown, source, entry.geometry.used_slots, context)
        names = list_attributes(materials, context)
        index = context.meshes.find_index(entry, mesh, materials, names)
    part = replace(part, mesh=index, properties=list_properties(materials, context))
    return PartEntry(part, entry, list_keys(materials, context), tuple(names), sources, own.records)


def make_light_part(shown: Any, source: Any, instancer: Any, context: Context) -> ObjectEntry | None:
    if context.materials is None:
        return None
    if versions.hides_lights_like_objects():
        seen_by = find_visibility(shown, instancer, context.view_layer)
    else:
        seen_by = sum(SEEN_BY[label] for name, label in RAY_VISIBILITY.items() if getattr(shown, name))
    if not seen_by & ~SEEN_BY["shadow"]:
        return None
    place = WarningContext(context.warnings, object=source.name_full)
    factor = read_light_nodes(shown.data, place, context.materials.images)
    return ObjectEntry(
        object=ObjectKey(source.name_full, source.original.session_uid),
        pass_index=shown.pass_index,
        color=tuple(shown.color),
        light=shown.data,
        light_factor=factor,
        properties=factor.properties,
        seen_by=seen_by,
        shadow_catcher=shown.is_shadow_catcher,
        name_word=pack_name(source.name),
        instancer=instancer.original.session_uid,
    )
