"""Which media paths are inside: a short list for each path, changed where it goes through a surface.

As in Cycles a medium belongs to a material of an object: a path is inside from where it comes in through a front of
that material until it goes out through a back of it; coming in again changes nothing. What media a scene has is known
when it is prepared, and each has a number; the world's is everywhere, and in no list.

References
----------
Blender, intern/cycles/kernel/integrator/volume_stack.h.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import take_rows
from raytracer.arrays.types import Booleans, Integers

# More media than this at one place are forgotten, as in Cycles (its list has 32 places, one of them the end).
DEEPEST = 31
# A place of a list that no medium takes.
NOTHING = -1


@dataclass(frozen=True, eq=False)
class MediaIndex:
    """The media of a scene, by number.

    key : (media,) int64, rising, instance * materials + material
    material_count : of the scene
    is_border : (materials,) bool, True for surfaces that are nothing but the border of their volume
    """

    key: NDArray[np.int64]
    material_count: int
    is_border: Booleans

    def find(self, instance: Integers, material: Integers) -> Integers:
        """Return the numbers (k,) of the media behind surfaces; NOTHING where there is none."""
        key = instance.astype(np.int64) * self.material_count + material
        place = np.minimum(np.searchsorted(self.key, key), max(len(self.key) - 1, 0))
        found = self.key[place] == key if len(self.key) else np.zeros(len(key), np.bool_)
        return np.where(found, place, NOTHING).astype(np.int32)


@dataclass(frozen=True, eq=False, slots=True)
class MediaStack:
    """What k paths are inside.

    index : the media of the scene
    inside : (k, d) int32, numbers of media; NOTHING for an empty place
    """

    index: MediaIndex
    inside: Integers

    def __len__(self) -> int:
        return len(self.inside)

    def select(self, rows: Any) -> MediaStack:
        """Return those of some of the paths: index or boolean array."""
        return MediaStack(self.index, take_rows(self.inside, rows))

    def cross(self, instance: Integers, material: Integers, front: Booleans, crosses: Booleans) -> MediaStack:
        """Return the media of paths behind surfaces.

        instance, material : (k,) of the surfaces
        front : (k,) True where the paths came to the front, and go in
        crosses : (k,) True where they go through
        """
        medium = self.index.find(instance, material)
        rows = np.flatnonzero(crosses & (medium != NOTHING))
        if not len(rows):
            return self
        inside, medium = self.inside.copy(), medium[rows, np.newaxis]
        there = inside[rows] == medium
        leaving = ~front[rows]
        inside[rows] = np.where(there & leaving[:, np.newaxis], NOTHING, inside[rows])
        coming = np.flatnonzero(~leaving & ~there.any(axis=1))
        empty = inside[rows[coming]] == NOTHING
        coming = coming[empty.any(axis=1)]
        place = (inside[rows[coming]] == NOTHING).argmax(axis=1)
        inside[rows[coming], place] = medium[coming, 0]
        return MediaStack(self.index, inside)


@dataclass(frozen=True, eq=False, slots=True)
class Immersed:
    """What k shadow rays start inside of, and the (k,) streams of random numbers by which they get through."""

    stack: MediaStack
    noise: NDArray[np.uint64]

    def select(self, rows: Any) -> Immersed:
        """Return those of some of the rays: index or boolean array."""
        return Immersed(self.stack.select(rows), self.noise[rows])


def join_immersed(parts: list[Immersed | None]) -> Immersed | None:
    """Return those of several records of rays as one, in order; None where nobody keeps any."""
    kept = [part for part in parts if part is not None]
    stack = join_stacks([part.stack for part in kept])
    return None if stack is None else Immersed(stack, np.concatenate([part.noise for part in kept]))


def join_stacks(parts: list[MediaStack | None]) -> MediaStack | None:
    """Return the media of several records of paths as one, in order; None where nobody keeps any."""
    kept = [part for part in parts if part is not None]
    if not kept:
        return None
    return MediaStack(kept[0].index, np.concatenate([part.inside for part in kept]))


def start_outside(index: MediaIndex, count: int) -> MediaStack:
    """Return the media of paths that are inside nothing."""
    return MediaStack(index, np.full((count, max(1, min(len(index.key), DEEPEST))), NOTHING, np.int32))
