"""What instances share: entries of objects, what they are made with, and what all kinds of them are asked."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.scene.fields import SEEN_BY, SEEN_BY_ALL

from .. import versions
from ..voxels.process import VoxelReader
from .adaptive import Dicing
from .custom_properties import Color
from .kept import Kept
from .light_nodes import NO_NODES, LightFactor
from .linking import Linked
from .mesh_table import MeshEntry, MeshTable
from .meshes import Points
from .motion import Tracks
from .random_numbers import pack_name
from .shaders.material_table import MaterialKey, MaterialTable
from .strands import Strands
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
    caustics : whether it casts shadow caustics, and whether it receives them
    density_by_scale : True for a volume whose density is by metre of object space
    light_factor : of a light, what its nodes make of it
    name_word : what Cycles makes of the object's name, for its random number where it is no instance
    properties : names of those that its materials, or the nodes of a light, read of instances
    instancer : `session_uid` of the original that shows it, which may be itself
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
    caustics: tuple[bool, bool] = (False, False)
    properties: frozenset[str] = frozenset()
    density_by_scale: bool = False
    instancer: int = 0


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
    dicing : what the scene says of adaptive subdivision; None where meshes are shown as Blender has them
    is_bake : True where a surface is wanted, whatever the view layer shows
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
    dicing: Dicing | None = None
    is_bake: bool = False

    @property
    def shows_strands(self) -> bool:
        """True where hair is shown: what casts rays passes it."""
        return self.materials is not None and bool(self.view_layer.use_strand)

    @property
    def shows_surfaces(self) -> bool:
        """True where meshes are shown: what casts rays heeds no view layer's filter, as Blender's own casts do not, and
        neither does a bake."""
        return self.materials is None or self.is_bake or self.view_layer.use_solid


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
        caustics=versions.read_caustics(shown),
        instancer=instancer.original.session_uid,
    )


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


def find_visibility(shown: Any, instancer: Any, view_layer: Any) -> int:
    """Return the classes of rays that see an object, as bits of SEEN_BY."""
    seen_by = sum(
        SEEN_BY[label] for name, label in RAY_VISIBILITY.items() if getattr(shown, name) and getattr(instancer, name)
    )
    if not instancer.holdout_get(view_layer=view_layer) and instancer.indirect_only_get(view_layer=view_layer):
        seen_by &= ~SEEN_BY["camera"]
    return seen_by
