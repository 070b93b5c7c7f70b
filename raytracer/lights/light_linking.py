"""Light and shadow linking: lights, and emissive objects, may light, or be shadowed by, some objects only.

Every object belongs to a set, every emitter lights some sets. The camera sees all emitters; a reflected ray sees what
lights the object that reflected it, so both ways of sampling light agree. Its shadows are another matter: see
`shadow_linking`.

References
----------
Blender, intern/cycles/kernel/light/sample.h: light_link_light_match.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Integers
from raytracer.scene.fields import ALL_SETS


@dataclass(frozen=True, eq=False)
class LightLinks:
    """Of each instance and group of spheres:

    light_set : (instances + groups,) int64, the set it belongs to
    receivers : (instances + groups,) int64, the sets that it lights, as bits
    """

    light_set: NDArray[np.int64]
    receivers: NDArray[np.int64]

    def find_lit(self, receivers: int | NDArray[np.int64], instance: Integers) -> Booleans:
        """Return (n,) True where what lights the sets `receivers`, one for all or (n,), lights `instance` (n,)."""
        return (receivers >> self.light_set[instance]) & 1 != 0


@dataclass(frozen=True, eq=False)
class ShadowLinks:
    """Of each instance and group of spheres:

    shadow_set : (instances + groups,) int64, the set it belongs to
    blockers : (instances + groups,) int64, the sets that shadow its light, as bits
    """

    shadow_set: NDArray[np.int64]
    blockers: NDArray[np.int64]

    def is_linked(self, instance: Integers) -> Booleans:
        """Return (n,) True where the light of `instance` (n,) is shadowed by some objects only."""
        return self.blockers[instance] != ALL_SETS
