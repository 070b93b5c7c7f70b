"""Properties that Attribute nodes read of objects, instancers, the view layer, the scene: each a color with alpha.

As in Blender, a custom property comes first, then a path such as `location` or `modifiers["Wave"].height`, and what is
neither number nor up to four numbers counts as missing.

References
----------
Blender, source/blender/blenkernel/intern/object_dupli.cc (find_property_rgba, BKE_object_dupli_find_rgba_attribute,
BKE_view_layer_find_rgba_attribute), intern/cycles/blender/object.cpp (sync_object_attributes).
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable, Iterator
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Color = NDArray[np.float64]

# An element of an array at the end of a path: Blender finds none (rendered with 5.0).
ELEMENT = re.compile(r"(\[\d+\]|\.[xyzwrgba])$")


def find_property(owner: Any, name: str) -> Color | None:
    """Return (4,) a property of a data-block or a view layer by name or path, or None where it has none."""
    if owner is None:
        return None
    if name in owner.keys():  # noqa: SIM118 - a data-block is no dictionary
        return make_color(owner[name])
    value = resolve(owner, name)
    array = ELEMENT.sub("", name)
    if array != name and make_color(value) is not None and make_color(resolve(owner, array)) is not None:
        return None
    return make_color(value)


def resolve(owner: Any, path: str) -> Any:
    """Return what a path from a data-block leads to, or None."""
    try:
        return owner.path_resolve(path)
    except ValueError:
        return None


def make_color(value: Any) -> Color | None:
    """Return a number as grey, up to four as red, green, blue and alpha, which is 1 if it is not given; else None."""
    if isinstance(value, (bool, int, float)):
        return np.array([np.float32(value)] * 3 + [1.0], dtype=np.float64)
    try:
        numbers = list(value)
    except TypeError:
        return None
    if not 0 < len(numbers) <= 4 or not all(type(number) in (int, float) for number in numbers):
        return None
    return np.array([*np.array(numbers, dtype=np.float32), *(0.0, 0.0, 0.0, 1.0)[len(numbers) :]], dtype=np.float64)


def find_first(owners: Iterable[Any], name: str) -> Color:
    """Return the property of the first of the owners that has it; 0, and alpha 0, where none has."""
    found = (find_property(owner, name) for owner in owners)
    return next((color for color in found if color is not None), np.zeros(4))


@dataclass
class LayerOwners:
    """Who may have a property that is the same for the whole picture, in Blender's order.

    depsgraph : whose they are; None without any
    reads : how often they were asked
    """

    depsgraph: Any = None
    reads: int = 0

    def find(self, name: str) -> Color:
        """Return (4,) the property of the first owner that has it; 0 where none has."""
        self.reads += 1
        if self.depsgraph is None:
            return find_first((), name)
        scene = self.depsgraph.scene_eval  # asked for anew: a change of frames may have copied its view layers
        return find_first((self.depsgraph.view_layer_eval, scene, scene.world), name)


# While a scene is extracted: its view layer, itself and its world; by thread, as it renders.
_layer: ContextVar[LayerOwners | None] = ContextVar("layer", default=None)


@contextlib.contextmanager
def read_layer_of(depsgraph: Any) -> Iterator[None]:
    """Let materials, lights and worlds that are read inside the block find properties of this view layer."""
    token = _layer.set(LayerOwners(depsgraph))
    try:
        yield
    finally:
        _layer.reset(token)


def find_layer() -> LayerOwners:
    """Return the owners of the scene that is being extracted; none outside of `read_layer_of`."""
    return _layer.get() or LayerOwners()
