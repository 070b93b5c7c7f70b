"""Groups of what shines, whose light pictures show by itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from raytracer.arrays.checks import require_range
from raytracer.scene.fields import require_text, set_array, set_field

# The number of what belongs to no group: the last of a table that has one row more.
NO_GROUP = -1


@dataclass(frozen=True, eq=False)
class LightGroups:
    """Which group each light, each object and the world belongs to, as an index into `names`; -1 for none.

    lights : (lights,) int32, of the scene's lights
    objects : (i + g,) int32, of its instances, or meshes where it has none, then of its groups of spheres and of curves
    """

    names: Sequence[str]
    lights: Any = ()
    objects: Any = ()
    world: int = NO_GROUP

    def __post_init__(self) -> None:
        names = tuple(self.names) if isinstance(self.names, Sequence) and not isinstance(self.names, str) else ()
        for name in names:
            require_text(name, "LightGroups: names")
        if not names or len(set(names)) < len(names):
            raise ValueError(f"LightGroups: names: expected one or more different names, got {self.names!r:.80}")
        set_field(self, "names", names)
        for name in ("lights", "objects"):
            if not np.size(getattr(self, name)):
                set_field(self, name, np.zeros(0, np.int32))
            numbers = set_array(self, name, np.int32, ("n",), "LightGroups")
            require_range(numbers, NO_GROUP, len(names) - 1, f"LightGroups: {name}")
        world = set_array(self, "world", np.int32, (), "LightGroups")
        require_range(world, NO_GROUP, len(names) - 1, "LightGroups: world")
        set_field(self, "world", int(world))
