"""What one extraction leaves for the next, so that only what changed is read again.

Blender announces changes to viewports; what was announced, or whatever may have changed where nothing is announced, is
read and compared, and stays the same record where it is the same. Only arrays and records are kept, no handle to
Blender's data; with addresses go the `session_uid` of the owners.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

# Data-blocks that materials are made of, besides themselves.
MATERIAL_PARTS = frozenset({"NODETREE", "IMAGE", "TEXTURE"})


@dataclass(frozen=True)
class Changes:
    """What changed since the last extraction, by `session_uid` of the originals.

    ids : data-blocks, but for objects that only moved
    shapes : those whose geometry changed
    kinds : `ID.id_type` of all that changed, moved objects included; objects that are cameras count as "CAMERA"
    """

    ids: frozenset[int] = frozenset()
    shapes: frozenset[int] = frozenset()
    kinds: frozenset[str] = frozenset()

    @property
    def is_view_only(self) -> bool:
        """True where nothing changed but cameras."""
        return self.kinds == {"CAMERA"}


def read_changes(depsgraph: Any) -> Changes:
    """Return what a depsgraph announces; valid within Blender's callbacks only."""
    ids, shapes, kinds = set(), set(), set()
    for update in depsgraph.updates:
        identity = update.id.original.session_uid
        kind = update.id.id_type
        kinds.add("CAMERA" if kind == "OBJECT" and update.id.type == "CAMERA" else kind)
        has_moved = kind == "OBJECT" and update.is_updated_transform
        if update.is_updated_geometry:
            shapes.add(identity)
        if update.is_updated_geometry or update.is_updated_shading or not has_moved:
            ids.add(identity)
    return Changes(frozenset(ids), frozenset(shapes), frozenset(kinds))


@dataclass
class Kept:
    """The last extraction's parts, meshes, materials and images by key, and diced and displaced meshes; replaced by the
    next.

    changes : what happened since, or None where anything may have
    trusts_files : True where files stay as they are, so that images need not be read again to see whether they changed
    """

    parts: dict[Any, Any] = field(default_factory=dict)
    meshes: dict[Any, Any] = field(default_factory=dict)
    materials: dict[Any, Any] = field(default_factory=dict)
    images: dict[Any, Any] = field(default_factory=dict)
    displaced: list[Any] = field(default_factory=list)
    diced: list[Any] = field(default_factory=list)
    changes: Changes | None = None
    trusts_files: bool = False

    def replace(self, parts: dict[Any, Any], meshes: dict[Any, Any], materials: Any) -> None:
        """Keep what an extraction met; anything may have changed until it is said what did.

        materials : its MaterialTable
        """
        self.parts, self.meshes = parts, meshes
        self.materials = {entry.key: entry for entry in materials.entries if not entry.moves}
        self.images = materials.images.readings
        self.changes = None

    def trusts(self, *identities: int) -> bool:
        """True where none of these data-blocks changed, but for the place of an object."""
        return self.changes is not None and self.changes.ids.isdisjoint(identities)

    def trusts_shapes(self, *identities: int) -> bool:
        """True where none of these objects or meshes changed its shape."""
        return self.changes is not None and self.changes.shapes.isdisjoint(identities)

    @property
    def trusts_parts(self) -> bool:
        """True where nothing changed that is said once for many objects, such as holdouts of collections."""
        return self.changes is not None and self.changes.kinds.isdisjoint({"SCENE", "COLLECTION"})

    @property
    def trusts_materials(self) -> bool:
        """True where no material changed but those announced."""
        return self.changes is not None and self.changes.kinds.isdisjoint(MATERIAL_PARTS)
