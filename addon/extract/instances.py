"""What stands where: one walk over the depsgraph's object instances.

An iterator's items die with its next step, so the walk turns each distinct combination of object, instancer and data
into an ObjectEntry and copies matrices as it goes: reading all at once with `foreach_get` leaks memory in Blender 4.2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.scene.fields import SEEN_BY, SEEN_BY_ALL

from .. import versions
from ..voxels.process import VoxelReader
from .attributes import read_point_attributes
from .custom_properties import Color
from .instance_properties import InstanceReader
from .kept import Kept
from .left_out import warn_left_out
from .light_nodes import NO_NODES, LightFactor, read_light_nodes
from .linking import Linked, read_linking
from .mesh_table import MeshEntry, MeshTable
from .meshes import Points, extract_points, open_mesh
from .motion import Tracks
from .random_numbers import fill_random, pack_name, read_random
from .shaders.material_table import MaterialKey, MaterialTable
from .shaders.nodes import WarningContext
from .strands import Strands, extract_curves, extract_hair, list_hair, list_particles
from .volume_objects import is_volume, list_grids, read_geometry
from .warnings import Warning, WarningList

RAY_VISIBILITY = {
    "visible_camera": "camera",
    "visible_diffuse": "diffuse",
    "visible_glossy": "glossy",
    "visible_transmission": "transmission",
    "visible_volume_scatter": "volume",
    "visible_shadow": "shadow",
}


class ObjectKey(NamedTuple):
    """The object that an instance shows: its name with library, and `session_uid` of the original (0 if generated)."""

    name: str
    session_uid: int


@dataclass(frozen=True)
class ObjectEntry:
    """What all instances of one object, instancer and data share: a mesh, points or strands with their material, or a
    light.

    terminator : Blender's offsets of the shadow terminator, of geometry and of shading
    density_by_scale : True for a volume whose density is by metre of object space
    light_factor : of a light, what its nodes make of it
    name_word : what Cycles makes of the object's name, for its random number where it is no instance
    properties : names of those that its materials, or the nodes of a light, read of instances
    """

    object: ObjectKey
    pass_index: int = 0
    holdout: bool = False
    shadow_catcher: bool = False
    color: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)
    seen_by: int = SEEN_BY_ALL
    mesh: int | None = None
    points: Points | None = None
    strands: Strands | None = None
    material: int = 0
    light: Any = None
    light_factor: LightFactor = NO_NODES
    name_word: int = 0
    terminator: tuple[float, float] = (0.0, 0.0)
    properties: frozenset[str] = frozenset()
    density_by_scale: bool = False


# What an ObjectEntry is called from one extraction to the next: `session_uid` of object and instancer, the data's
# address.
PartKey = tuple[int, int, int]


@dataclass(frozen=True)
class PartEntry:
    """An ObjectEntry, and what its numbers stand for.

    mesh : its mesh, or None for points and strands
    materials : what the material of each used slot is called
    attributes : names of those that the materials read
    sources : `session_uid` of the other data-blocks that it was read from
    """

    part: ObjectEntry
    mesh: MeshEntry | None
    materials: tuple[MaterialKey, ...]
    attributes: tuple[str, ...]
    sources: tuple[int, ...]
    warnings: tuple[Warning, ...]

    def renumber(self, mesh: int | None, material: int) -> PartEntry:
        """Return the entry with other numbers for its mesh and its material; itself where they are the same."""
        if (mesh, material) == (self.part.mesh, self.part.material):
            return self
        return replace(self, part=replace(self.part, mesh=mesh, material=material))


@dataclass
class Placements:
    """The parts and how they are linked, and of each instance worth keeping the number of its part, its (4, 4) matrix
    in the world, random number, and what its materials read of it by name."""

    parts: list[ObjectEntry] = field(default_factory=list)
    links: list[Linked] = field(default_factory=list)
    part: list[int] = field(default_factory=list)
    world_from_object: list[NDArray[np.float64]] = field(default_factory=list)
    random: list[float] = field(default_factory=list)
    properties: list[dict[str, Color]] = field(default_factory=list)


@dataclass(frozen=True)
class Context:
    """What an entry is made with; `materials` is None where only geometry is wanted, `space` the viewport or None.

    kept : the last extraction
    entries : what this one leaves to the next
    tracks : notes what may move; None where nothing shall
    is_render, thick_strands : the depsgraph's mode; True for strands that are round
    voxels : reads those of volumes
    """

    view_layer: Any
    meshes: MeshTable
    materials: MaterialTable | None
    warnings: WarningList
    space: Any = None
    kept: Kept = field(default_factory=Kept)
    entries: dict[PartKey, PartEntry] = field(default_factory=dict)
    tracks: Tracks | None = None
    is_render: bool = True
    thick_strands: bool = False
    voxels: VoxelReader = field(default_factory=VoxelReader)

    @property
    def shows_strands(self) -> bool:
        """True where hair is shown: what casts rays passes it."""
        return self.materials is not None and bool(self.view_layer.use_strand)

    @property
    def shows_surfaces(self) -> bool:
        """True where meshes are shown: what casts rays heeds no view layer's filter, as Blender's own casts do not."""
        return self.materials is None or self.view_layer.use_solid


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
                note = context.tracks.note if part.strands is None else context.tracks.pass_over
                note(instance, source, instancer, part.mesh)
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
        return make_light_part(shown, source, context) if shown.type == "LIGHT" else None
    if shown.type == "MESH" and not of_voxels and not context.shows_surfaces:
        warn_left_out(source, context.warnings)
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


def renew_part(last: PartEntry, source: Any, context: Context) -> PartEntry | None:
    """Return an ObjectEntry of the last extraction with this one's numbers, or None where it may have changed."""
    kept, materials = context.kept, context.materials
    if materials is None or not kept.trusts_parts or not kept.trusts(*last.sources):
        return None
    if not all(materials.can_reuse(key, source.name) for key in last.materials):
        return None
    context.warnings.include(last.warnings)
    entry = context.meshes.reuse(source, last.mesh) if last.mesh else None
    indices = tuple(materials.reuse(key) for key in last.materials)
    if entry is None:
        return last.renumber(None, indices[0])
    return last.renumber(context.meshes.find_index(entry, None, indices, last.attributes), last.part.material)


def make_part(shown: Any, source: Any, instancer: Any, context: Context, of_voxels: bool) -> PartEntry | None:
    """Return what to show of an object with a mesh, points, strands or voxels, or None: nothing in it, or hidden from
    all rays."""
    own = WarningList()
    seen_by = find_visibility(shown, instancer, context.view_layer)
    if seen_by:
        warn_left_out(source, own)
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
    with open_mesh(source, shown.data) as mesh:
        entry = context.meshes.find_entry(source, shown.data.as_pointer(), mesh)
        if entry.geometry is None:
            return None
        materials = find_materials(shown, source, entry.geometry.used_slots, context)
        names = list_attributes(materials, context)
        index = context.meshes.find_index(entry, mesh, materials, names)
    part = replace(part, mesh=index, properties=list_properties(materials, context))
    return PartEntry(part, entry, list_keys(materials, context), tuple(names), sources, own.records)


def describe_object(shown: Any, source: Any, instancer: Any, context: Context, seen_by: int) -> ObjectEntry:
    """Return an ObjectEntry of an object, without what it shows."""
    return ObjectEntry(
        object=ObjectKey(source.name_full, source.original.session_uid),
        pass_index=shown.pass_index,
        holdout=instancer.holdout_get(view_layer=context.view_layer),
        shadow_catcher=shown.is_shadow_catcher or instancer.is_shadow_catcher,
        color=tuple(instancer.color),
        seen_by=seen_by,
        name_word=pack_name(source.name),
        terminator=versions.read_terminator(shown),
    )


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


def make_volume_part(
    part: ObjectEntry, shown: Any, source: Any, sources: tuple[int, ...], own: WarningList, context: Context
) -> PartEntry | None:
    """Return what to show of a volume: of its materials the first that says what is inside; None without voxels."""
    assert context.materials is not None
    before = len(own.records)
    grids, override = list_grids(shown, source.name, own), context.view_layer.material_override
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


def list_keys(materials: tuple[int, ...], context: Context) -> tuple[MaterialKey, ...]:
    """Return what materials, given by number, are called."""
    return tuple(context.materials.find_key(index) for index in materials) if context.materials else ()


def list_attributes(materials: tuple[int, ...], context: Context) -> set[str]:
    """Return the names of the attributes that materials, given by number, read."""
    return context.materials.list_attributes(materials) if context.materials else set()


def list_properties(materials: tuple[int, ...], context: Context) -> frozenset[str]:
    """Return the names of the properties of instances that materials, given by number, read."""
    return context.materials.list_properties(materials) if context.materials else frozenset()


def find_materials(shown: Any, source: Any, used_slots: tuple[int, ...], context: Context) -> tuple[int, ...]:
    """Return the scene's material for each used slot; 0 for all where only geometry is wanted."""
    if context.materials is None:
        return (0,) * len(used_slots)
    override = context.view_layer.material_override
    return context.materials.find_slots(shown.material_slots, used_slots, override, source.name)


def make_light_part(shown: Any, source: Any, context: Context) -> ObjectEntry | None:
    if context.materials is None:
        return None
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
    )


def find_visibility(shown: Any, instancer: Any, view_layer: Any) -> int:
    """Return the classes of rays that see an object, as bits of SEEN_BY."""
    seen_by = sum(
        SEEN_BY[label] for name, label in RAY_VISIBILITY.items() if getattr(shown, name) and getattr(instancer, name)
    )
    if not instancer.holdout_get(view_layer=view_layer) and instancer.indirect_only_get(view_layer=view_layer):
        seen_by &= ~SEEN_BY["camera"]
    return seen_by
