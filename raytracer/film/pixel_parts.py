"""Numbers of a picture's pixels that are not held: a part of them at a time, made anew each time they are asked for.

What is asked of all at once are sums, the largest ones, and their order at one place: each is told in one pass.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from raytracer.arrays.types import Floats
from raytracer.film.counts import iterate_parts

# Pixels whose numbers are held at a time.
PART = 1 << 16


@dataclass(frozen=True)
class Parts:
    """A number of each pixel, along rows from the lower left corner.

    pixels : how many
    make : returns the numbers (n,) float64 of some pixels

    Examples
    --------
    >>> [part.tolist() for part in Parts(3, np.array([1.0, 4.0, 9.0]).__getitem__)]
    [[1.0, 4.0, 9.0]]
    """

    pixels: int
    make: Callable[[slice], Floats]

    def __iter__(self) -> Iterator[Floats]:
        return map(self.make, iterate_parts(self.pixels, PART))


@dataclass(frozen=True, eq=False)
class Tally:
    """What is asked of numbers of all pixels at once.

    total, largest : their sum, and the largest
    worst : which pixel has that, the first
    most : (k,) the largest ones
    """

    total: float
    largest: float
    worst: int
    most: Floats


def tally_parts(parts: Parts, count: int) -> Tally:
    """Return the Tally of numbers, with the `count` largest ones."""
    total, largest, worst, start, most = 0.0, -np.inf, 0, 0, np.zeros(0)
    for values in parts:
        total += float(values.sum())
        if values.max() > largest:
            largest, worst = float(values.max()), start + int(values.argmax())
        most = keep_largest(np.concatenate([most, values]), count)
        start += len(values)
    return Tally(total, largest, worst, most)


def keep_largest(values: Floats, count: int) -> Floats:
    """Return the `count` largest of values, in any order; all where there are no more."""
    return np.partition(values, len(values) - count)[-count:].copy() if len(values) > count else values


def mean_without(parts: Parts, most: Floats) -> float:
    """Return the mean of the numbers without the largest ones (k,); 0 where that leaves none.

    Of numbers as large as the least of those, it has as many as are left.
    """
    left = parts.pixels - len(most)
    if not left:
        return 0.0
    limit, total, number = float(most.min()), 0.0, 0
    for values in parts:
        below = values[values < limit]
        total, number = total + float(below.sum()), number + len(below)
    return (total + limit * (left - number)) / left


@dataclass(frozen=True, eq=False)
class Spread:
    """Sums of numbers v of pixels.

    pixels : how many
    total, of_squares : of v and of v^2
    of_sets : (k,) those of v of each set of pixels that take different points of lights, or times; None where each has
        its own
    """

    pixels: int
    total: float
    of_squares: float
    of_sets: Floats | None


def sum_squares(parts: Parts, width: int, interleaving: int = 0, largest: float = 1.0) -> Spread:
    """Return the Spread of numbers over `largest`, so that their squares do not underflow; parameters as
    `error.measure_error`."""
    total, of_squares, start, sets = 0.0, 0.0, 0, interleaving * interleaving
    of_sets, members = np.zeros(sets), np.zeros(sets, dtype=np.intp)
    for part in parts:
        scaled = part / largest
        # By sums, for they may end a render: BLAS, to which a product goes, rounds them in its processor's way.
        total, of_squares = total + float(scaled.sum()), of_squares + float((scaled * scaled).sum())
        if sets:
            row, column = np.divmod(np.arange(start, start + len(part)), width)
            number = row % interleaving * interleaving + column % interleaving
            of_sets += np.bincount(number, scaled, sets)
            members += np.bincount(number, minlength=sets)
        start += len(part)
    shared = of_sets[members > 0] if sets else None  # a small picture lacks some sets
    return Spread(parts.pixels, total, of_squares, shared)
