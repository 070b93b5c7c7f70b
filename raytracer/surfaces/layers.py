"""Which of the surfaces that lie at one place a ray meets, and in which order.

A glass on a table, a decal on a wall, a label on a bottle: modellers lay surfaces exactly upon each other, and the
picture must not depend on which was made first. Their order along a ray is that of surfaces a hair apart:

    first   what the ray leaves: glass and the like, seen from behind
    then    sheets: what lets light through without being a boundary of glass (transparent, alpha below 1, translucent)
    then    what the ray enters: glass and the like, seen from the front
    last    what nothing passes; among those shadow catchers come after all others, and holdouts after these

So light that comes down through a glass leaves it before it meets the table, and what the table sends back enters the
glass. Seen from the other side the order of the first three is reversed, as it must be for light to go both ways; what
nothing passes stays last: it is met from either side, and what lies upon it is met before.

Within a class the numbers of instances decide, and Blender's are those of `addon.extract.instance_order`: smaller ones
first. Glass comes in from the last number to the first and goes out from the first to the last, so that the smaller is
inside the larger; of sheets the lower comes first from its front, last from its back, and those of one object at one
place are one; of surfaces that nothing passes the lowest (instance, primitive) is met, a label and not its bottle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.scene.materials import Closure, Material
from raytracer.scene.scene import Scene

OPAQUE, SHEET, MEDIUM = range(3)


@dataclass(frozen=True, eq=False)
class LayerTable:
    """What the order of surfaces at one place goes by.

    kind : (materials,) int8, OPAQUE, SHEET or MEDIUM
    stage : (instances + groups,) int64, 1 for shadow catchers, 2 for holdouts, else 0
    """

    kind: NDArray[np.int8]
    stage: NDArray[np.int64]


def make_layer_table(scene: Scene) -> LayerTable | None:
    """Return the table of a scene; None where it makes no difference which of the surfaces at one place is met."""
    kind = np.array([classify_material(material) for material in scene.materials], dtype=np.int8)
    stage = np.maximum(_gather_flags(scene, "shadow_catcher"), 2 * _gather_flags(scene, "holdout"))
    return LayerTable(kind, stage) if kind.any() or stage.any() else None


def _gather_flags(scene: Scene, name: str) -> NDArray[np.int64]:
    """Return a property of all instances and groups as 0 or 1."""
    flags = None if scene.instances is None else getattr(scene.instances, name)
    placed = np.zeros(scene.instance_count, np.int64) if flags is None else flags.astype(np.int64)
    return np.concatenate([placed, np.array([getattr(group, name) for group in scene.groups], dtype=np.int64)])


def classify_material(material: Material) -> int:
    """Return OPAQUE, SHEET or MEDIUM; what a program computes may be anything."""
    closures = [closure for closure in material.closures if _may(closure, "weight", lambda weight: weight > 0)]
    if any(map(_refracts, closures)):
        return MEDIUM
    return SHEET if any(map(_lets_through, closures)) else OPAQUE


def _refracts(closure: Closure) -> bool:
    principled = closure.kind == "principled" and _may(closure, "transmission", lambda share: share > 0)
    return principled or closure.kind in ("glass", "refraction")


def _lets_through(closure: Closure) -> bool:
    principled = closure.kind == "principled" and _may(closure, "alpha", lambda alpha: alpha < 1)
    return principled or closure.kind in ("transparent", "translucent")


def _may(closure: Closure, name: str, predicate: Callable[[Any], Any]) -> bool:
    return name in closure.registers or bool(predicate(getattr(closure, name)))
