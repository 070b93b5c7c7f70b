"""Voronoi cells in one to four dimensions: which of the points scattered over a lattice is nearest, or second.

Each cell of the lattice of whole coordinates holds one point, at the cell's hash times a randomness; the nearest is
looked for in the 3^k cells around. Points are (n, k) float64. What else the cells are asked for stands in
`voronoi_edges`.

References
----------
S. Worley, "A Cellular Texture Basis Function", SIGGRAPH 1996.
M. Jarzynski and M. Olano, "Hash Functions for GPU Rendering", Journal of Computer Graphics Techniques 9(3), 2020: PCG.
Blender, intern/cycles/kernel/svm/voronoi.h, util/hash.h: which hash where, the octaves and their sums.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats
from raytracer.textures.noise import MOST_DETAIL, hash_numbers

PCG_FACTOR, PCG_SUMMAND = np.int32(1664525), np.int32(1013904223)


LARGEST_INT = 0x7FFFFFFF


# One round of PCG in 2, 3 and 4 dimensions: to each word the product of two others is added; -1 is the factor.
ROUNDS = {
    2: ((0, 1, -1), (1, 0, -1)),
    3: ((0, 1, 2), (1, 2, 0), (2, 0, 1)),
    4: ((0, 1, 3), (1, 2, 0), (2, 0, 1), (3, 1, 2)),
}


# Orders of four coordinates that are hashed for a point, and for a color.
POINT_ORDERS = ((0, 1, 2, 3), (3, 0, 1, 2), (2, 3, 0, 1), (1, 2, 3, 0))


COLOR_ORDERS = ((0, 1, 2, 3), (2, 0, 3, 1), (3, 2, 1, 0))


@dataclass(frozen=True)
class Cells:
    """How points are scattered and distances measured.

    randomness : (n,) from 0 to 1; exponent : (n,), of Minkowski's metric
    metric : a key of METRICS; second : True looks for the second nearest
    whole : True hashes cells as whole numbers, as since Blender 5.0; False as float32
    smoothness : (n,) of the smooth minimum, or None for the minimum itself
    """

    randomness: Floats
    exponent: Floats
    metric: str
    second: bool
    whole: bool
    smoothness: Floats | None = None


METRICS: dict[str, Callable[[Floats, Floats], Floats]] = {
    "EUCLIDEAN": lambda offset, exponent: np.sqrt((offset**2).sum(axis=-1)),
    "MANHATTAN": lambda offset, exponent: np.abs(offset).sum(axis=-1),
    "CHEBYCHEV": lambda offset, exponent: np.abs(offset).max(axis=-1),
    "MINKOWSKI": lambda offset, exponent: (
        (np.abs(offset) ** exponent[..., np.newaxis]).sum(axis=-1) ** (1.0 / exponent)
    ),
}


def measure(offset: Floats, cells: Cells) -> Floats:
    """Return the length (n,) of offsets (n, k)."""
    return METRICS["MANHATTAN" if offset.shape[1] == 1 else cells.metric](offset, cells.exponent)


def hash_cells(cell: Floats, count: int, whole: bool) -> Floats:
    """Return `count` numbers (n, count) from 0 to 1 of cells (n, k): k for its point, 3 for its color."""
    dimensions = cell.shape[1]
    if whole and dimensions > 1:
        words = np.pad(cell, ((0, 0), (0, max(count - dimensions, 0)))).astype(np.int32)
        return _scatter(words)[:, :count] / LARGEST_INT
    numbers = list(cell.T)
    if dimensions == 4:
        orders = POINT_ORDERS if count == 4 else COLOR_ORDERS
        return np.stack([hash_numbers(*(numbers[k] for k in order)) for order in orders], axis=1)
    return np.stack([hash_numbers(*numbers, *([float(k)] if k else [])) for k in range(count)], axis=1)


def _scatter(words: NDArray[np.int32]) -> NDArray[np.int32]:
    """PCG of (n, k) words: a step of a linear generator, and two rounds of mixing."""
    parts = list((words * PCG_FACTOR + PCG_SUMMAND).T)
    _mix(parts)
    parts = [part ^ (part >> np.int32(16)) for part in parts]
    _mix(parts)
    return np.stack(parts, axis=1) & np.int32(LARGEST_INT)


def _mix(parts: list[NDArray[np.int32]]) -> None:
    for to, first, second in ROUNDS[len(parts)]:
        parts[to] = parts[to] + parts[first] * (PCG_FACTOR if second < 0 else parts[second])


def list_neighbors(cell: Floats, cells: Cells, reach: int = 1) -> Iterator[tuple[Floats, Floats]]:
    """Yield the cells (n, k) as far as `reach` around cells (n, k), the first coordinate first, and their points."""
    for reverse in product(np.arange(-float(reach), reach + 1), repeat=cell.shape[1]):
        other = cell + reverse[::-1]
        yield other, other + hash_cells(other, cell.shape[1], cells.whole) * cells.randomness[:, np.newaxis]


def find_point(points: Floats, cells: Cells) -> tuple[Floats, Floats, Floats]:
    """Return of the nearest, or second nearest, point the distance (n,), the color (n, 3) and the place (n, k)."""
    if cells.smoothness is not None:
        return blend_points(points, cells, cells.smoothness)
    best = [(np.full(len(points), np.inf), np.zeros_like(points), np.zeros_like(points)) for _ in range(2)]
    for other, place in list_neighbors(np.floor(points), cells):
        found = (measure(place - points, cells), other, place)
        nearer, nearest = found[0] < best[0][0], best[0]
        best[0] = _take(nearer, found, nearest)
        later = _take(nearer, nearest, found)
        best[1] = _take(later[0] < best[1][0], later, best[1])
    distance, other, place = best[1 if cells.second else 0]
    return distance, hash_cells(other, 3, cells.whole), place


def blend_points(points: Floats, cells: Cells, smoothness: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the same as `find_point`, but with a smooth minimum of the distances to the 5^k points around.

    Of one cell after the other, h = smoothstep(1/2 + (d - d_cell) / (2 s)) of what is known, d, is replaced by the
    cell's, less s h (1 - h); color and place by (1 + 3 s)-th of that. Where the smoothness s is 0, the nearest counts.
    """
    cell, width = np.floor(points), np.where(smoothness > 0, smoothness, 1.0)
    distance, color, place = np.zeros(len(points)), np.zeros((len(points), 3)), np.zeros_like(points)
    for number, (other, found) in enumerate(list_neighbors(cell, cells, reach=2)):
        length = measure(found - points, cells)
        step = np.clip(0.5 + 0.5 * (distance - length) / width, 0.0, 1.0) if number else np.ones(len(points))
        share = step * step * (3.0 - 2.0 * step)
        less = width * share * (1.0 - share)
        distance = distance + (length - distance) * share - less
        share, less = share[:, np.newaxis], (less / (1.0 + 3.0 * width))[:, np.newaxis]
        color = color + (hash_cells(other, 3, cells.whole) - color) * share - less
        place = place + (found - cell - place) * share - less
    sharp = smoothness <= 0
    if sharp.any():
        nearest = find_point(points, replace(cells, smoothness=None))
        return _take(sharp, nearest, (distance, color, place + cell))
    return distance, color, place + cell


def _take(rows: NDArray[np.bool_], first: Any, second: Any) -> Any:
    column = rows[:, np.newaxis]
    return tuple(np.where(rows if a.ndim == 1 else column, a, b) for a, b in zip(first, second, strict=True))


def sum_octaves(
    points: Floats, cells: Cells, detail: Floats, roughness: Floats, lacunarity: Floats, normalize: bool
) -> tuple[Floats, Floats, Floats]:
    """Return the distance (n,), color (n, 3) and place (n, k) of octaves, each lacunarity times as fine and roughness
    times as strong as the one before; the last counts as much as detail's fraction says."""
    detail = np.where(roughness == 0, 0.0, np.clip(detail, 0.0, MOST_DETAIL))
    distance, color, place = np.zeros(len(points)), np.zeros((len(points), 3)), np.zeros_like(points)
    total, amplitude, scale = np.zeros(len(points)), np.ones(len(points)), np.ones(len(points))
    for octave in range(int(np.ceil(detail.max(initial=0.0))) + 1):
        weight = amplitude * np.clip(detail + 1.0 - octave, 0.0, 1.0)
        found = find_point(points * scale[:, np.newaxis], cells)
        total, distance = total + weight, distance + weight * found[0]
        color = color + weight[:, np.newaxis] * found[1]
        place = place + weight[:, np.newaxis] * (found[2] / scale[:, np.newaxis] - place)
        amplitude, scale = amplitude * roughness, scale * lacunarity
    if normalize:
        corner = np.repeat(0.5 + 0.5 * cells.randomness[:, np.newaxis], points.shape[1], axis=1)
        distance = distance / (total * measure(corner, cells) * (2.0 if cells.second else 1.0))
        color = color / total[:, np.newaxis]
    return distance, color, place
