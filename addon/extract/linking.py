"""Light and shadow linking: which objects a light, or an emissive object, lights, and which of them shadow its light.

An object's receiver collection says what it lights: where objects are included, only those, else all but the excluded
ones. What is in a collection within it has the state of that one; said twice, the last counts. Its blocker collection
says in the same way what shadows its light. The raytracer wants two sets for each object, and those that each emitter
lights or is shadowed by.

References
----------
Blender, source/blender/depsgraph/intern/depsgraph_light_linking.cc; intern/cycles/blender/light_linking.cpp.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from raytracer.scene.fields import ALL_SETS, SET_COUNT

from .warnings import WarningList

# An object's state in each collection of one kind; what is in none has state None.
States = tuple[str | None, ...]


@dataclass(frozen=True)
class Linked:
    """What tells how an object is linked: original objects, and the collections of what it lights and of what shadows
    its light, or None for all."""

    source: Any
    instancer: Any
    receivers: Any
    blockers: Any


@dataclass(frozen=True)
class LinkSets:
    """The sets that an ObjectEntry belongs to, for light and for shadow, and those that it lights and that shadow its
    light, as bits."""

    light_set: int = 0
    receivers: int = ALL_SETS
    shadow_set: int = 0
    blockers: int = ALL_SETS


# What becomes of objects in more sets than there are.
IN_NO_SET = {
    "receivers": f"more than {SET_COUNT} light-linking groups: lights take the remaining objects for linked to nothing",
    "blockers": f"more than {SET_COUNT} shadow-linking groups: lights take the remaining objects for linked to nothing",
}


def read_linking(source: Any, instancer: Any) -> Linked:
    """Return how an object is linked."""
    linking = source.light_linking
    return Linked(source.original, instancer.original, linking.receiver_collection, linking.blocker_collection)


def make_link_sets(parts: Sequence[Linked], warnings: WarningList) -> list[LinkSets]:
    """Return the sets of each Part; without collections all are in the first set, light it and shadow its light."""
    lit, blocking = (_number_sets(parts, name, warnings) for name in ("receivers", "blockers"))
    return [LinkSets(*light, *shadow) for light, shadow in zip(lit, blocking, strict=True)]


def _number_sets(parts: Sequence[Linked], name: str, warnings: WarningList) -> list[tuple[int, int]]:
    """Return the set that each Part belongs to and, as bits, those that its own collection of a kind is of."""
    given = [getattr(part, name) for part in parts]
    collections = {collection.original.session_uid: collection for collection in given if collection is not None}
    if not collections:
        return [(0, ALL_SETS)] * len(parts)
    links = [read_states(collection) for collection in collections.values()]
    numbers: dict[States, int] = {(None,) * len(links): 0}
    own = [number_set(part, links, numbers) for part in parts]
    if len(numbers) > SET_COUNT:
        warnings.add(IN_NO_SET[name])
    sets = [(number, states) for states, number in numbers.items() if number < SET_COUNT]
    masks = {
        uid: sum(1 << number for number, states in sets if is_named(links[k], states[k]))
        for k, uid in enumerate(collections)
    }
    return [
        (
            number if number < SET_COUNT else 0,
            ALL_SETS if collection is None else masks[collection.original.session_uid],
        )
        for collection, number in zip(given, own, strict=True)
    ]


def read_states(collection: Any) -> dict[Any, str]:
    """Return the state, INCLUDE or EXCLUDE, of all objects in a collection of links."""
    states = {}
    for child, linked in zip(collection.children, collection.collection_children, strict=True):
        states.update({thing.original: linked.light_linking.link_state for thing in child.all_objects})
    for thing, linked in zip(collection.objects, collection.collection_objects, strict=True):
        states[thing.original] = linked.light_linking.link_state
    return states


def number_set(part: Linked, links: Sequence[dict[Any, str]], numbers: dict[States, int]) -> int:
    """Return the number of the set of objects that share a Part's states; its instancer's, if that is linked."""
    states = tuple(link.get(part.instancer) for link in links)
    if not any(states):
        states = tuple(link.get(part.source) for link in links)
    return numbers.setdefault(states, len(numbers))


def is_named(link: dict[Any, str], state: str | None) -> bool:
    """Return whether what has a state in a collection of links is lit, or shadows."""
    return state == "INCLUDE" if "INCLUDE" in link.values() else state is None
