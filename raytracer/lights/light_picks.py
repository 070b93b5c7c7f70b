"""Which of many lights are aimed at from points: the tree is cut for each point, and what it is cut into picked from.

Node c of a point's cut, of m_c lights and the importance I_c, gets a slot of the length min(I_c / t, m_c): no light
needs more than one sample. With t such that the slots fill `count` units, one light is picked from each unit, at the
same place u of all: where a group promises more than t a light all its lights are taken, of the rest a few, evenly
spread over the cut (systematic sampling). A group's two halves, and theirs, share its slot by their importance, as far
as they have lights. So a light is aimed at with the probability that is the length of its part.

References
----------
W. G. Madow, "On the Theory of Systematic Sampling, II", 1949.
A. Conty Estevez, C. Kulla, "Importance Sampling of Many Lights with Adaptive Tree Splitting", HPG 2018.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats, Indices
from raytracer.lights.light_importance import Receivers, find_importance
from raytracer.lights.light_tree import LightTree, come_apart, cut_nodes

# Points whose cuts are in memory together: twice as many rows fit a uint16, which sorts fastest.
POINTS_AT_ONCE = 1 << 12
# How often t is found anew, without the groups that promise more than the last one.
ROUNDS = 3
# Slots are shorter by this than what fits, so that no sum's rounding leaves one without its place.
MARGIN = 1.0 + 2.0**-20


class Picks(NamedTuple):
    """The lights (count, n) that n points aim at, -1 for none, and the probabilities (count, n) of aiming at them."""

    light: NDArray[np.int32]
    chance: Floats


def pick_lights(tree: LightTree, points: Receivers, choice: Floats, count: int) -> Picks:
    """Pick so many lights for each of n points, none twice.

    choice : (n,) uniform numbers, below 1
    """
    picks = Picks(np.full((count, len(points)), -1, np.int32), np.zeros((count, len(points))))
    for first in range(0, len(points), POINTS_AT_ONCE):
        part = slice(first, first + POINTS_AT_ONCE)
        some = points.select(part)
        slots = _fill_slots(tree, _cut_tree(tree, some, count), choice[part])
        light, chance = _descend(tree, some, slots)
        picks.light[slots.number, first + slots.row] = light
        picks.chance[slots.number, first + slots.row] = chance
    return picks


def find_chances(tree: LightTree, light: NDArray[np.integer], row: Indices, points: Receivers, count: int) -> Floats:
    """Return the probabilities (k,) with which lights (k,) are aimed at from points by their rows (k,)."""
    parts = [
        _cut_tree(tree, points.select(slice(first, first + POINTS_AT_ONCE)), count).unit
        for first in range(0, len(points), POINTS_AT_ONCE)
    ]
    unit = np.concatenate([np.zeros(0), *parts]).take(row)
    # The ways up to the root; cuts go through the last node on them that stays whole.
    node = tree.leaf.take(light)
    way, top = [node], np.zeros(len(node), np.intp)
    while (tree.parent.take(node) >= 0).any():
        node = np.where(tree.parent.take(node) >= 0, tree.parent.take(node), node)
        top[~come_apart(tree.clusters, tree.within, node, points.position, row)] = len(way)
        way.append(node)
    node = np.choose(top, way) if len(node) else node
    length = _measure_slots(tree, node, find_importance(tree.clusters, node, points, row), unit)
    # Down again, as picks go.
    for level in range(len(way) - 1, 0, -1):
        rows = np.flatnonzero((top >= level) & (way[level - 1] != way[level]))
        node = way[level].take(rows)
        halves = _halve_slots(tree, node, length.take(rows), points, row.take(rows))
        length[rows] = np.where(way[level - 1].take(rows) == node + 1, halves.first, halves.second)
    return np.minimum(length, 1.0)


def _divide(values: Floats, by: Floats) -> Floats:
    """Return quotients (k,), 0 where the divisor is."""
    return np.divide(values, by, out=np.zeros_like(values), where=by > 0)


# Cuts ----------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, slots=True)
class _Cut:
    """The cuts of n points, k nodes of them in all, and what each promises.

    row, node : (k,) intp; importance : (k,) float64
    unit : (n,) float64, t: what a light promises that has a slot of length 1; 0 where nothing shines
    """

    row: Indices
    node: Indices
    importance: Floats
    unit: Floats


def _cut_tree(tree: LightTree, points: Receivers, count: int) -> _Cut:
    """Return the cuts of n points, of whose lights so many are to be picked."""
    row, node = cut_nodes(tree.clusters, tree.within, tree.second, points.position)
    importance = find_importance(tree.clusters, node, points, row)
    return _Cut(row, node, importance, _find_unit(row, importance, tree.size.take(node), len(points), count))


def _find_unit(row: Indices, importance: Floats, size: Floats, points: int, count: int) -> Floats:
    """Return t (n,): what the rest of the groups promise to each of the units that those leave that are taken whole.

    These promise more than MARGIN / m of what is there to each of m units, so they have fewer than m lights, and units
    are left as long as anything is. Sums go in the order of the cut's pairs, and do not depend on the other points.
    """
    unit = np.bincount(row, importance, points) * (MARGIN / count)
    for _ in range(ROUNDS):
        is_whole = importance > size * unit.take(row)
        left = count - np.bincount(row, size * is_whole, points)
        rest = np.bincount(row, np.where(is_whole, 0.0, importance), points)
        unit = np.where(rest > 0, MARGIN * rest / left, unit)
    return unit


# Slots ---------------------------------------------------------------------------------------------------------------


class _Slots(NamedTuple):
    """The slots that the picks of points fall into, k in all.

    row, number : (k,) intp, of the point, and of its pick
    node : (k,) intp; length : (k,) float64
    place : (k,) float64, how far from the beginning of the slot the pick lies
    """

    row: Indices
    number: Indices
    node: Indices
    length: Floats
    place: Floats


def _measure_slots(tree: LightTree, node: Indices, importance: Floats, unit: Floats) -> Floats:
    """Return the lengths (k,) of the slots of nodes (k,) of cuts; unit : (k,) of the point's cut."""
    return np.minimum(_divide(importance, unit), tree.size.take(node))


class _Halves(NamedTuple):
    """The halves of slots: the place (k,) where the second begins, and their lengths (k,), 0 where nothing shines."""

    border: Floats
    first: Floats
    second: Floats


def _halve_slots(tree: LightTree, node: Indices, length: Floats, points: Receivers, row: Indices) -> _Halves:
    """Return how the two halves of nodes (k,) share slots (k,), for points by their rows (k,)."""
    first, second = node + 1, tree.second.take(node)
    own = find_importance(tree.clusters, first, points, row)
    other = find_importance(tree.clusters, second, points, row)
    border = np.maximum(_divide(own, own + other) * length, length - tree.size.take(second))
    border = np.minimum(border, tree.size.take(first))
    return _Halves(border, np.where(own > 0, border, 0.0), np.where(other > 0, length - border, 0.0))


def _fill_slots(tree: LightTree, cut: _Cut, choice: Floats) -> _Slots:
    """Return where the picks fall, for uniform numbers (n,): pick j of a point lies at j + u.

    The slots of lights that are certain come first, so that each has a number of its own.
    """
    length = _measure_slots(tree, cut.node, cut.importance, cut.unit.take(cut.row))
    order = np.argsort((2 * cut.row + (length < tree.size.take(cut.node))).astype(np.uint16), kind="stable")
    row, node, length = cut.row.take(order), cut.node.take(order), length.take(order)
    rank = _count_up(np.bincount(row, minlength=len(choice)))
    # Slots side by side, those of a point in a column, so that each point's are summed up alone.
    ends = np.zeros((rank.max(initial=0) + 2, len(choice)))
    ends[rank + 1, row] = length
    ends = np.cumsum(ends, axis=0)
    begin, at = ends[rank, row], choice.take(row)
    first = np.ceil(begin - at).astype(np.intp)
    hits = np.ceil(ends[rank + 1, row] - at).astype(np.intp) - first
    slot = np.repeat(np.arange(len(hits)), hits)
    number = first.take(slot) + _count_up(hits)
    place = number + at.take(slot) - begin.take(slot)
    return _Slots(row.take(slot), number, node.take(slot), length.take(slot), place)


def _count_up(counts: Indices) -> Indices:
    """Return 0, 1, ... for each of `counts` one after the other: [2, 3] gives [0, 1, 0, 1, 2]."""
    return np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)


def _descend(tree: LightTree, points: Receivers, slots: _Slots) -> tuple[NDArray[np.int32], Floats]:
    """Return the light (k,) that has the part of each slot around its place, and the length (k,) of the part."""
    node, length, place = slots.node.copy(), slots.length.copy(), slots.place.copy()
    rows = np.flatnonzero(tree.second.take(node) >= 0)
    while len(rows):
        above = node.take(rows)
        halves = _halve_slots(tree, above, length.take(rows), points, slots.row.take(rows))
        takes_second = place.take(rows) >= halves.border
        length[rows] = np.where(takes_second, halves.second, halves.first)
        place[rows] -= np.where(takes_second, halves.border, 0.0)
        node[rows] = np.where(takes_second, tree.second.take(above), above + 1)
        rows = rows.take(np.flatnonzero(tree.second.take(node.take(rows)) >= 0))
    light = np.where(length > 0, tree.light.take(node), np.int32(-1))
    return light, np.minimum(length, 1.0)
