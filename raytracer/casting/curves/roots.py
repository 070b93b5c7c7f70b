"""Where rays meet segments: all roots are isolated by their number, then refined, and each has a bound on its error.

An interval of u is divided until the changes of sign of its polynomial, which bound the number of its roots, are as
many as the changes of sign that its ends show: then there is exactly one root where the ends differ, and none
elsewhere. What is left in doubt after LEVELS divisions are roots closer together than 2^-LEVELS: rays that touch, to
rounding.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.casting.curves import bernstein
from raytracer.casting.curves.ray_space import (
    Points,
    SeenSegments,
    evaluate,
    find_bends,
    find_foot_polynomials,
    find_tube_polynomials,
    measure_ends,
)
from raytracer.predicates.rounding import UNIT_ROUNDOFF

LEVELS = 32
# Halving an interval so often leaves no bit of u; Newton's steps in between are shorter each time.
STEPS = 128
# Steps below this do not change what is computed at u, which is at most 1.
SMALLEST_STEP = 2.0 * UNIT_ROUNDOFF


class Brackets(NamedTuple):
    """Intervals with one root each.

    segment : (m,) number of the segment among those seen
    low, high : (m,) float64, u
    negative : (m,) bool, True where the equation's left side is below 0 at `low`
    side : (m,) float64, the sign s of the equation g - s z' sqrt(r^2 - X^2) = 0 and of the depth z + s sqrt(r^2 - X^2):
        0 for ribbons, -1 for the near side of round ones, 1 for their far side
    """

    segment: NDArray[np.intp]
    low: Floats
    high: Floats
    negative: Booleans
    side: Floats


def isolate_roots(seen: SeenSegments) -> Brackets:
    """Return the intervals of all roots of k segments."""
    flat, thick = np.flatnonzero(~seen.thick), np.flatnonzero(seen.thick)
    parts = []
    if len(flat):
        parts += _isolate_ribbons(seen.select(flat), flat)
    if len(thick):
        parts += _isolate_tubes(seen.select(thick), thick)
    if not parts:
        nothing = np.zeros(0)
        return Brackets(nothing.astype(np.intp), nothing, nothing, nothing > 0, nothing)
    return Brackets(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _isolate_ribbons(seen: SeenSegments, number: NDArray[np.intp]) -> list[Brackets]:
    """Return the brackets of roots of g."""
    foot, parts = find_foot_polynomials(seen), []
    low, width = np.zeros(len(seen)), 1.0
    for level in range(LEVELS + 1):
        changes = bernstein.count_changes(foot)
        differ = (foot[0] < 0) != (foot[-1] < 0)
        found = np.flatnonzero(differ & ((changes == 1) | (level == LEVELS)))
        bracket = low[found], low[found] + width, foot[0, found] < 0
        parts.append(Brackets(number[found], *bracket, np.zeros(len(found))))
        rest = np.flatnonzero(changes > 1)
        if not len(rest):
            break
        foot, width = np.concatenate(bernstein.divide(foot[:, rest]), axis=1), width / 2.0
        number, low = np.tile(number[rest], 2), np.concatenate([low[rest], low[rest] + width])
    return parts


@dataclass(frozen=True, eq=False)
class _Tubes:
    """Intervals of round segments: Bernstein coefficients of X^2 - r^2 and of F, and whether g -+ s z' h is negative at
    both ends of each, (2, k), for s = -1 (near) and s = 1 (far)."""

    segment: NDArray[np.intp]
    low: Floats
    outside: Floats
    tube: Floats
    near: Booleans
    far: Booleans

    def count_changes(self) -> NDArray[np.intp]:
        """Return the changes of sign of F, which is the product of both equations: at the ends that is known better."""
        signs = self.tube.copy()
        for row in (0, -1):
            signs[row] = np.where(self.near[row] != self.far[row], -1.0, 1.0)
        return bernstein.count_changes(signs)

    def divide(self, rows: Indices, seen: SeenSegments, width: float) -> _Tubes:
        """Return the halves, `width` wide, of some of the intervals."""
        segment, low = self.segment[rows], self.low[rows]
        middle = evaluate(seen.select(segment), low + width)
        lift = middle.slope_z * middle.height
        near, far = middle.foot + lift < 0, middle.foot - lift < 0
        return _Tubes(
            np.tile(segment, 2),
            np.concatenate([low, low + width]),
            np.concatenate(bernstein.divide(self.outside[:, rows]), axis=1),
            np.concatenate(bernstein.divide(self.tube[:, rows]), axis=1),
            *(
                np.concatenate([[ends[0, rows], between], [between, ends[1, rows]]], axis=1)
                for ends, between in ((self.near, near), (self.far, far))
            ),
        )


def _isolate_tubes(seen: SeenSegments, number: NDArray[np.intp]) -> list[Brackets]:
    """Return the brackets of roots of both sides' equations where |X| <= r."""
    outside, tube = find_tube_polynomials(seen, find_foot_polynomials(seen))
    foot, lift = measure_ends(seen)
    parts, width = [], 1.0
    work = _Tubes(np.arange(len(seen)), np.zeros(len(seen)), outside, tube, foot + lift < 0, foot - lift < 0)
    for level in range(LEVELS + 1):
        changes = work.count_changes()
        near, far = work.near[0] != work.near[1], work.far[0] != work.far[1]
        # Outside the radius both equations are g = 0, whose roots are none of F: divided until they lie apart. A double
        # root of F, as of rays at right angles to the strand, may show no change of sign.
        within = (work.outside <= 0).all(axis=0)
        nothing = (work.outside > 0).all(axis=0) | ((changes == 0) & ~near & ~far)
        done = within & (changes <= near.astype(np.intp) + far) | (level == LEVELS)
        for side, differ, ends in ((-1.0, near, work.near), (1.0, far, work.far)):
            found = np.flatnonzero(done & ~nothing & differ)
            bracket = work.low[found], work.low[found] + width, ends[0, found]
            parts.append(Brackets(number[work.segment[found]], *bracket, np.full(len(found), side)))
        rest = np.flatnonzero(~(done | nothing))
        if not len(rest):
            break
        width /= 2.0
        work = work.divide(rest, seen, width)
    return parts


def find_values(points: Points, side: Floats) -> Floats:
    """Return g - s z' h."""
    return points.foot - side * points.slope_z * points.height


def find_slopes(seen: SeenSegments, points: Points, u: Floats, side: Floats) -> Floats:
    """Return the derivative of g - s z' h by u, with h' = (r r' - g) / h, which is left out where h is 0."""
    x, y, z = find_bends(seen, u)
    slope = points.slope_x**2 + points.slope_y**2 + points.x * x + points.y * y
    grows = np.divide(
        points.radius * points.slope_radius - points.foot, points.height, out=np.zeros(len(u)), where=points.height > 0
    )
    return slope - side * (z * points.height + points.slope_z * grows)


@np.errstate(all="ignore")
def refine_roots(seen: SeenSegments, brackets: Brackets) -> Floats:
    """Return the root u (m,) in each bracket, to rounding; seen : of each bracket.

    Newton's method within the bracket, which shrinks at each step; it is halved where a step would lead out of it, or
    is more than half as long as the one before.
    """
    _, low, high, negative, side = brackets
    first, last = (find_values(evaluate(seen, u), side) for u in (low, high))
    share = first / (first - last)
    # Within the interval: where points coincide, its ends may be roots too.
    root = low + np.where((share > 0) & (share < 1), share, 0.5) * (high - low)
    active, u, longest = np.arange(len(root)), root, high - low
    for _ in range(STEPS):
        points = evaluate(seen, u)
        value = find_values(points, side)
        below = (value < 0) == negative
        low, high = np.where(below, u, low), np.where(below, high, u)
        step = -value / find_slopes(seen, points, u, side)
        following = u + step
        kept = ((following > low) & (following < high)) | (following == u)
        kept &= np.abs(step) <= np.maximum(longest / 2.0, SMALLEST_STEP)
        following = np.where(value == 0, u, np.where(kept, following, (low + high) / 2.0))
        longest = np.abs(following - u)
        root[active] = following
        going = np.flatnonzero(longest > SMALLEST_STEP)
        if not len(going):
            break
        active, seen, u = active[going], seen.select(going), following[going]
        low, high, longest, side = low[going], high[going], longest[going], side[going]
        negative = negative[going]
    return root
