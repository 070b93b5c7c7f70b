"""Which objects are cast into: those of a list or a collection, and those that viewports, renders or cameras show.

A viewport's depsgraph holds nothing that viewports have disabled: what only renders show cannot be hit there, and is
listed (`list_missing`). Facts: Blender's blenkernel/intern/layer.cc (`layer_collection_objects_sync`: an object is
rendered where one of its collections is, and all above that) and object.cc (`BKE_object_visibility`: instancers and
emitters of particles hide themselves).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import bpy

from raytracer.arrays.checks import require_choice
from raytracer.scene.fields import SEEN_BY

from .. import versions
from ..extract.parts import find_visibility

VISIBILITIES = ("viewport", "render", "camera")


@dataclass(frozen=True)
class Selection:
    """What can be hit.

    visibility : 'viewport' as Scene.ray_cast, 'render' what renders show, 'camera' of that what cameras see
    only : `session_uid` of objects that can be hit themselves, and by the instances that they make; None = all
    without : `session_uid` of an object that cannot, 0 = none
    """

    visibility: str = "viewport"
    only: frozenset[int] | None = None
    without: int = 0

    def includes(self, *originals: Any) -> bool:
        """Return True where one of the objects is selected."""
        if any(original.session_uid == self.without for original in originals):
            return False
        return self.only is None or any(original.session_uid in self.only for original in originals)

    def sees(self, shown: Any, source: Any, instancer: Any, view_layer: Any) -> bool:
        """Return True where an evaluated object can be hit.

        shown : the object, or what stands for it as an instance
        source : the object, or the one that is instanced
        instancer : the object, or the one that makes the instance
        """
        if self.visibility == "viewport":
            return not versions.is_hidden_from_picking(source)
        if source.original.hide_render:
            return False
        if shown is instancer and not shows_itself(source.original):
            return False
        return self.visibility == "render" or bool(find_visibility(shown, instancer, view_layer) & SEEN_BY["camera"])


def make_selection(objects: Any, collection: Any, visibility: str) -> Selection:
    """Return the Selection of a call's arguments.

    Raises
    ------
    ValueError
        If `objects` are no objects, `collection` is none, or `visibility` is not one of VISIBILITIES.
    """
    require_choice(visibility, VISIBILITIES, "visibility")
    if objects is None and collection is None:
        return Selection(visibility)
    chosen: list[Any] = []
    if objects is not None:
        chosen += list_objects(objects)
    if collection is not None:
        if not isinstance(collection, bpy.types.Collection):
            raise ValueError(f"collection: expected a bpy.types.Collection, got {type(collection).__name__}")
        chosen += collection.all_objects
    return Selection(visibility, frozenset(thing.original.session_uid for thing in chosen))


def list_objects(objects: Any) -> list[Any]:
    """Return the objects of a list, or of one object."""
    chosen = [objects] if isinstance(objects, bpy.types.Object) else objects
    if not isinstance(chosen, Iterable) or isinstance(chosen, str):
        raise ValueError(f"objects: expected a list of bpy.types.Object, got {type(objects).__name__}")
    found = list(chosen)
    wrong = next((thing for thing in found if not isinstance(thing, bpy.types.Object)), None)
    if wrong is not None:
        raise ValueError(f"objects: expected a list of bpy.types.Object, got one of {type(wrong).__name__}")
    return found


def list_shown(selection: Selection, view_layer: Any) -> list[Any]:
    """Return the original objects of a view layer that are shown, or make instances that are, in its order."""
    if selection.visibility == "viewport":
        return [thing for thing in view_layer.objects if thing.visible_get(view_layer=view_layer)]
    rendered = list_rendered(view_layer)
    return [thing for thing in view_layer.objects if thing.session_uid in rendered]


def list_rendered(view_layer: Any) -> set[int]:
    """Return the `session_uid` of the objects that renders of a view layer show."""
    return {
        thing.session_uid
        for layer_collection in walk_rendered(view_layer.layer_collection)
        for thing in layer_collection.collection.objects
        if not thing.hide_render
    }


def walk_rendered(layer_collection: Any) -> Iterator[Any]:
    """Yield the layer collections that renders show."""
    if layer_collection.collection.hide_render:
        return
    if not layer_collection.exclude:
        yield layer_collection
    for child in layer_collection.children:
        yield from walk_rendered(child)


def shows_itself(original: Any) -> bool:
    """Return True where renders show an object besides what it makes instances of."""
    makes_others = original.instance_type != "NONE" or len(original.particle_systems) > 0
    return not makes_others or bool(original.show_instancer_for_render)


def list_missing(selection: Selection, depsgraph: Any) -> tuple[Any, ...]:
    """Return the original objects that renders show and this depsgraph does not hold: those disabled in viewports."""
    if selection.visibility == "viewport":
        return ()
    shown = list_shown(selection, depsgraph.view_layer)
    return tuple(
        thing for thing in shown if selection.includes(thing) and not thing.evaluated_get(depsgraph).is_evaluated
    )
