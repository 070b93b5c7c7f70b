"""Light in parts: what diffuse and glossy reflection and transmission send on where a path is scattered first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from raytracer.arrays.rows import take_rows
from raytracer.arrays.types import Booleans, Floats, Indices


@dataclass(frozen=True, eq=False, slots=True)
class Parts:
    """Light of n rays, or shares of it: (n, 3) float64 by diffuse and by glossy reflection; the rest is transmitted."""

    diffuse: Floats
    glossy: Floats

    def select(self, rows: Indices | Booleans) -> Parts:
        """Return some of the rays: index or boolean array."""
        return Parts(take_rows(self.diffuse, rows), take_rows(self.glossy, rows))

    def scale(self, factor: Floats) -> Parts:
        """Return all parts times (n, 1) or (n, 3)."""
        return Parts(self.diffuse * factor, self.glossy * factor)


@dataclass(frozen=True, eq=False, slots=True)
class Split:
    """How the light of n rays is split.

    parts : shares of those whose path has been scattered before; with light, the light
    unscattered : (n,) bool, where it has not: the surface that sends the light on decides
    """

    parts: Parts
    unscattered: Booleans

    def select(self, rows: Indices | Booleans) -> Split:
        """Return some of the rays: index or boolean array."""
        return Split(self.parts.select(rows), self.unscattered[rows])


def start_parts(count: int) -> Parts:
    """Return the shares of n rays that nothing has scattered."""
    return Parts(np.zeros((count, 3)), np.zeros((count, 3)))
