"""Which clusters of triangles a grid of rays may see, nearest first, and where their vertices are on its image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats
from raytracer.casting.pencil.clusters import Clusters
from raytracer.casting.pencil.grids import Grid
from raytracer.casting.pencil.patches import BEFORE

# Vertices projected at a time: what they need fits the cache.
VERTEX_BLOCK = 4096
# Nearness beyond this is not float32's.
LARGEST_NEARNESS = 2.0**100


def project_vertices(grid: Grid, vertices: Floats) -> NDArray[np.float32]:
    """(3, v) float32 x, y and nearness of vertices; NaN where they are not certainly before the plane of the point."""
    points = np.empty(vertices.shape, np.float32)
    share = BEFORE * float(np.abs(grid.matrix[2]).max())
    for start in range(0, vertices.shape[1], VERTEX_BLOCK):
        part = slice(start, start + VERTEX_BLOCK)
        relative = vertices[:, part] - grid.centre[:, np.newaxis]
        x, y, depth = mapped = _map(grid.matrix, relative)
        sizes = np.abs(relative, out=relative)
        sizes[0] += sizes[1]
        sizes[0] += sizes[2]
        sizes[0] *= share
        nearness = 1.0 / depth
        nearness[~((depth > sizes[0]) & (nearness < LARGEST_NEARNESS))] = np.nan
        x *= nearness
        y *= nearness
        mapped[2] = nearness
        points[:, part] = mapped
    return points


def _map(matrix: Floats, vectors: Floats) -> Floats:
    """M v of planes (3, k): (m0 x + m1 y) + m2 z."""
    mapped, term = np.empty_like(vectors), np.empty_like(vectors[0])
    for row, out in zip(matrix, mapped, strict=True):
        np.multiply(vectors[0], row[0], out=out)
        out += np.multiply(vectors[1], row[1], out=term)
        out += np.multiply(vectors[2], row[2], out=term)
    return mapped


def list_sides(grid: Grid) -> Floats:
    """(5, 3) planes through the point with all rays on their positive side: its own, and a cell beside each border."""
    x, y, z = grid.matrix
    beside = 1.0 + grid.jitter
    low, high = grid.low[:, 0] - beside, grid.low[:, 0] + (grid.wide, grid.high) + beside
    return np.stack([z, x - low[0] * z, high[0] * z - x, y - low[1] * z, high[1] * z - y])


def cull_clusters(grid: Grid, clusters: Clusters) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Clusters that the rays may see, nearest first, and their boxes (5, k): low x, y, high x, y in cells from the
    grid's corner, and the most nearness; infinite where they cross the plane of the point.

    The support of a box (c, e) along n is n . c +- |n| . e; both are widened by more than float64 rounds.
    """
    relative = clusters.centre - grid.centre
    half = clusters.half * (1 + 2.0**-40) + 2.0**-45 * np.abs(relative).sum(axis=1, keepdims=True)
    seen = np.ones(len(relative), bool)
    for side in list_sides(grid):
        seen &= relative @ side + half @ np.abs(side) >= 0
    index = np.flatnonzero(seen)
    middle, extent = relative.take(index, axis=0) @ grid.matrix.T, half.take(index, axis=0) @ np.abs(grid.matrix).T
    order = np.argsort(middle[:, 2] - extent[:, 2], kind="stable")
    middle, extent = middle.take(order, axis=0).T, extent.take(order, axis=0).T
    near, far = middle[2] - extent[2], middle[2] + extent[2]
    box, beside = np.empty((5, len(index))), 1.0 + grid.jitter
    box[4] = (1 + 2.0**-20) / near
    for axis, low in enumerate(grid.low[:, 0]):
        least, most = middle[axis] - extent[axis], middle[axis] + extent[axis]
        box[axis] = np.minimum(least / near, least / far) - low - beside
        box[2 + axis] = np.maximum(most / near, most / far) - low + beside
    crossing = np.flatnonzero(~(near > 2.0**-30 * far))
    box[:2, crossing], box[2:, crossing] = -np.inf, np.inf
    return index.take(order), box.astype(np.float32)


def are_hidden(tiles: NDArray[np.float32], box: NDArray[np.float32], tile: int) -> Booleans:
    """(k,) True where all rays in a box ask for something nearer: at most 2 x 2 entries of one level of a pyramid.

    tiles : (h, w) least limit of each tile of so many cells a side; box : (5, k), `cull_clusters`
    """
    last = np.array(tiles.shape[::-1], np.float32)[:, np.newaxis] - 1
    low, high = (np.clip(corner / np.float32(tile), 0, last).astype(np.int32) for corner in (box[:2], box[2:4]))
    least = np.full(box.shape[1], np.inf, np.float32)
    left = np.arange(box.shape[1])
    while len(left):
        (x0, y0), (x1, y1) = low.take(left, axis=1), high.take(left, axis=1)
        fits = np.flatnonzero((x1 - x0 <= 1) & (y1 - y0 <= 1))
        x0, y0, x1, y1 = x0[fits], y0[fits], x1[fits], y1[fits]
        pairs = np.minimum(tiles[y0, x0], tiles[y0, x1]), np.minimum(tiles[y1, x0], tiles[y1, x1])
        least[left[fits]] = np.minimum(*pairs)
        left = np.delete(left, fits)
        low, high, tiles = low >> 1, high >> 1, _halve(tiles)
    return box[4] < least


def _halve(tiles: NDArray[np.float32]) -> NDArray[np.float32]:
    """The least of every 2 x 2 entries."""
    rows, columns = tiles.shape
    padded = np.pad(tiles, ((0, rows % 2), (0, columns % 2)), constant_values=np.inf)
    pairs = np.minimum(padded[0::2], padded[1::2])
    return np.minimum(pairs[:, 0::2], pairs[:, 1::2])
