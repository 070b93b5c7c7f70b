"""Bounds of extinction, in cells: how densely rays look for collisions in media that vary.

What nodes compute has no bound that could be proven. It is looked at in each cell of a coarse grid, at several places,
and the largest found is taken, with some to spare. `tracking` is right on average even where there is more than that:
such a bound decides on noise alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import largest_column
from raytracer.arrays.types import Booleans, Floats, Integers, Numbers, Vectors
from raytracer.casting.geometry import invert_matrices, transform_points
from raytracer.lecture import dot
from raytracer.media.mixtures import Mixture

# Cells along the longest side of an object, and places that are looked at along each side of a cell. Where many objects
# vary they share what a few would take, down to the least number of cells.
CELLS, LOOKS = 16, 4
MANY, LEAST_CELLS = 16, 4
# The largest value found, times this: smooth densities are little larger between the places.
SPARE = 1.25
# The least bound of a cell, as a share of its neighbors': what has been missed there is met seldom, but it is met. And
# wherever nothing is near, about one collision is looked for on the way through the whole grid.
LEAST_SHARE = 2.0**-4
# The least step of a ray through cells, in cells: rounding must not hold it at a border.
LEAST_STEP = 2.0**-20
# Points that are evaluated at a time.
POINTS_AT_ONCE = 1 << 16

# The mixtures of media (n,) by number at points (n, 3).
Evaluate = Callable[[Integers, Vectors], Mixture]


@dataclass(frozen=True, eq=False)
class Majorants:
    """Bounds of all media by number.

    even : (media,) float64, per metre, of those that are the same everywhere; 0 of others
    varies : (media,) bool
    cells : (media, 3) int64, of the grids of those that vary
    first : (media,) int64, of their values among `values`
    grid_from_box, grid_from_world : (media, 4, 4) float64, from each medium's own space and from world space to numbers
        of cells
    values : (cells of all,) float64, per metre
    """

    even: Floats
    varies: Booleans
    cells: NDArray[np.int64]
    first: NDArray[np.int64]
    grid_from_box: Floats
    grid_from_world: Floats
    values: Floats


def make_majorants(
    even: Floats, varies: Booleans, boxes: Floats, world_from_box: Floats, evaluate: Evaluate
) -> Majorants:
    """Look at all media that vary.

    boxes : (media, 2, 3) float64, each medium's bounds in its own space; world_from_box : (media, 4, 4)
    """
    count = len(even)
    cells, first = np.ones((count, 3), np.int64), np.zeros(count, np.int64)
    grid_from_box, values = np.zeros((count, 4, 4)), [np.zeros(1)]
    found = np.flatnonzero(varies & (np.linalg.det(world_from_box[:, :3, :3]) != 0))  # what is flat has no inside
    most = max(LEAST_CELLS, int(CELLS * min(1.0, MANY / max(len(found), 1)) ** (1 / 3)))
    for medium in found:
        low, high = boxes[medium]
        cells[medium] = _choose_cells(world_from_box[medium], high - low, most)
        size = np.where(high > low, high - low, 1.0)
        grid_from_box[medium] = np.eye(4)
        grid_from_box[medium, :3, :3] = np.diag(cells[medium] / size)
        grid_from_box[medium, :3, 3] = -low * cells[medium] / size
        first[medium] = sum(map(len, values))
        values.append(_look(int(medium), cells[medium], low, high, world_from_box[medium], evaluate))
    grids = _place_grids(varies, grid_from_box, world_from_box)
    return Majorants(even, varies, cells, first, grid_from_box, grids, np.concatenate(values))


def place_majorants(majorants: Majorants, world_from_box: Floats) -> Majorants:
    """Return the bounds of media that have moved: their grids go with them, and nothing is looked at anew."""
    grids = _place_grids(majorants.varies, majorants.grid_from_box, world_from_box)
    return replace(majorants, grid_from_world=grids)


def _place_grids(varies: Booleans, grid_from_box: Floats, world_from_box: Floats) -> Floats:
    grids = np.zeros_like(grid_from_box)
    box_from_world = invert_matrices(world_from_box)
    for medium in np.flatnonzero(varies):
        grids[medium] = _combine(grid_from_box[medium], box_from_world[medium])
    return grids


def _combine(second: Floats, first: Floats) -> Floats:
    """Return the matrix of one affine map after another."""
    return np.stack([dot(first.T, row) for row in second])


def _choose_cells(world_from_box: Floats, size: Floats, most: int) -> NDArray[np.int64]:
    """Return how many cells along each side, at most so many, make them about cubes."""
    sides = size * np.sqrt((world_from_box[:3, :3] ** 2).sum(axis=0))
    longest = sides.max()
    if not longest > 0:
        return np.ones(3, np.int64)
    return np.clip(np.ceil(most * sides / longest), 1, most).astype(np.int64)


def _look(
    medium: int, cells: NDArray[np.int64], low: Floats, high: Floats, matrix: Floats, evaluate: Evaluate
) -> Floats:
    """Return the bounds of a medium's cells, flat."""
    axes = [low[axis] + (high - low)[axis] * (np.arange(n * LOOKS) + 0.5) / (n * LOOKS) for axis, n in enumerate(cells)]
    x, y, z = np.meshgrid(*axes, indexing="ij")
    points = transform_points(matrix, np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1))
    found = np.concatenate([_rate(medium, part, evaluate) for part in _split(points)], axis=1)
    a, b, c = cells
    extinction, emission = found.reshape(2, a, LOOKS, b, LOOKS, c, LOOKS).max(axis=(2, 4, 6))
    sides = (high - low) / cells * np.sqrt((matrix[:3, :3] ** 2).sum(axis=0))
    # The cells that shine brightest are met about once on the way through, whatever they absorb; others less often.
    once = emission / (_at_least(emission.max(initial=0.0)) * _at_least(np.sqrt((sides**2).sum())))
    rate = np.maximum(SPARE * extinction, once)
    whole = np.sqrt(((sides * cells) ** 2).sum())
    return np.maximum(np.maximum(rate, LEAST_SHARE * _find_largest_around(rate)), 1.0 / _at_least(whole)).ravel()


def _find_largest_around(values: Floats) -> Floats:
    """Return for each cell (a, b, c) the largest value of itself and its neighbors."""
    for axis in range(3):
        padded = np.pad(values, [(1, 1) if one == axis else (0, 0) for one in range(3)], mode="edge")
        a, b, c = (np.take(padded, np.arange(values.shape[axis]) + step, axis) for step in range(3))
        values = np.maximum(np.maximum(a, b), c)
    return values


def _at_least(size: float) -> float:
    return float(np.maximum(size, np.finfo(np.float64).tiny))


def _split(points: Vectors) -> list[Vectors]:
    return [points[start : start + POINTS_AT_ONCE] for start in range(0, len(points), POINTS_AT_ONCE)]


def _rate(medium: int, points: Vectors, evaluate: Evaluate) -> Floats:
    mixture = evaluate(np.full(len(points), medium, np.int32), points)
    return np.stack([largest_column(mixture.extinction), largest_column(np.abs(mixture.emission))])


def find_local(
    majorants: Majorants, inside: Integers, origin: Vectors, direction: Vectors, at: Numbers
) -> tuple[Numbers, Numbers]:
    """Return the bounds (n,) per metre of all media together where rays are, and how far along the ray they hold (n,).

    inside : (n, d) int32, numbers of media
    origin, direction : (n, 3) float64, unit; at : (n,) metres along the rays
    """
    rate, end = np.zeros(len(at)), np.full(len(at), np.inf)
    for column in inside.T:
        rate += majorants.even[column]
        rows = np.flatnonzero(majorants.varies[column])
        if not len(rows):
            continue
        medium = column[rows]
        matrix, cells = majorants.grid_from_world[medium], majorants.cells[medium]
        step = dot(matrix[:, :3, :3], direction[rows, np.newaxis])
        place = transform_points(matrix, origin[rows]) + at[rows, np.newaxis] * step
        cell = np.clip(np.floor(place + LEAST_STEP * np.sign(step)), 0, cells - 1).astype(np.int64)
        flat = (cell[:, 0] * cells[:, 1] + cell[:, 1]) * cells[:, 2] + cell[:, 2]
        rate[rows] += majorants.values[majorants.first[medium] + flat]
        end[rows] = np.minimum(end[rows], at[rows] + _find_way_out(place, step, cell, cells))
    return rate, end


def _find_way_out(place: Vectors, step: Vectors, cell: NDArray[np.int64], cells: NDArray[np.int64]) -> Numbers:
    """Return how far (n,) rays at places (n, 3), in cells, go until they leave a cell (n, 3) for another one; what lies
    beyond a grid belongs to the cells at its border."""
    last = np.where(step > 0, cell == cells - 1, cell == 0) | (step == 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        way = np.where(last, np.inf, (cell + (step > 0) - place) / step)
        least = LEAST_STEP / np.abs(step).max(axis=1)
    return np.maximum(way.min(axis=1), least)
