"""Light linking: which objects a light, or an emissive object, lights.

An object's receiver collection says so: where objects are included, only those are lit, else all but the excluded ones.
What is in a collection within it has the state of that one; said twice, the last counts. The raytracer wants a set for
each object and the sets that each emitter lights.

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

# An object's state in each receiver collection; what is in none has state None.
States = tuple[str | None, ...]


@dataclass(frozen=True)
class Linked:
    """What tells how an object is linked: original objects, and the collection of what it lights or None for all."""

    source: Any
    instancer: Any
    receivers: Any


@dataclass(frozen=True)
class LinkSets:
    """The set that an ObjectEntry belongs to, and the sets that it lights, as bits."""

    light_set: int = 0
    receivers: int = ALL_SETS


def read_linking(source: Any, instancer: Any, warnings: WarningList) -> Linked:
    """Return how an object is linked; warn of what is not followed."""
    linking = source.light_linking
    if linking.blocker_collection is not None:
        warnings.add("shadow linking is not supported, all objects shadow its light", source.name)
    return Linked(source.original, instancer.original, linking.receiver_collection)


def make_link_sets(parts: Sequence[Linked], warnings: WarningList) -> list[LinkSets]:
    """Return the sets of each Part; without receiver collections all are in the first set and light it."""
    collections = {part.receivers.original.session_uid: part.receivers for part in parts if part.receivers is not None}
    if not collections:
        return [LinkSets()] * len(parts)
    links = [read_states(collection) for collection in collections.values()]
    numbers: dict[States, int] = {(None,) * len(links): 0}
    light_set = [number_set(part, links, numbers) for part in parts]
    if len(numbers) > SET_COUNT:
        warnings.add(f"more than {SET_COUNT} light-linking groups: the remaining objects are lit by every light")
    sets = [(number, states) for states, number in numbers.items() if number < SET_COUNT]
    masks = {
        uid: sum(1 << number for number, states in sets if is_lit(links[k], states[k]))
        for k, uid in enumerate(collections)
    }
    return [
        LinkSets(
            number if number < SET_COUNT else 0,
            ALL_SETS if part.receivers is None else masks[part.receivers.original.session_uid],
        )
        for part, number in zip(parts, light_set, strict=True)
    ]


def read_states(collection: Any) -> dict[Any, str]:
    """Return the state, INCLUDE or EXCLUDE, of all objects in a receiver collection."""
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


def is_lit(link: dict[Any, str], state: str | None) -> bool:
    """Return whether what has a state in a receiver collection is lit."""
    return state == "INCLUDE" if "INCLUDE" in link.values() else state is None
