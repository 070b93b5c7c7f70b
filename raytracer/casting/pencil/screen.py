"""A view's rays sorted into the cells of a grid, eight by eight cells to a tile, with how near a hit must be.

Cells are numbered tile by tile and row by row within a tile, so the rays of a tile, and those of neighbouring cells of
a row in it, lie next to each other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats
from raytracer.casting.bvh.tree import round_down
from raytracer.casting.pencil.pencil import View

TILE_BITS = 3
TILE = 1 << TILE_BITS
# Cells of all tiles fit 16 bits, which are sorted several times faster than 32.
MOST_CELLS = 1 << 16
# Relative error of nearness computed from t and image points rounded to float32, generously.
SLACK = 2.0**-20


class Screen:
    """k rays of a view on a grid; arrays are in the grid's order.

    ray : (k,) index of each ray among those given
    x, y : (k,) float32 image points
    limit : (k,) float32, a hit that is less near cannot be the answer; rises as certain hits are found
    margin : (k,) float32, a nearness above limit + margin is certainly within the ray's range
    ceiling : (k,) float32, a nearness below this is certainly within the range's other end
    first : (cells + 1,) int32, where each cell's rays begin
    tile_limit : (tiles,) the least limit of each tile's rays; tile_sure, tile_ceiling : what is certain for all of them
    """

    def __init__(self, view: View, rows: slice, t_min: Floats, best: Floats) -> None:
        image = view.image[:, rows]
        self.low, self.high = image.min(axis=1), image.max(axis=1)
        size = np.maximum(self.high - self.low, np.float32(2.0**-20))
        self.tiles_x, self.tiles_y = _count_tiles(image.shape[1], float(size[0] / size[1]) * _aspect(view))
        self.scale = (np.array([self.tiles_x, self.tiles_y]) * TILE / size).astype(np.float32)
        cell_x, cell_y = self.find_cells(image[0], 0), self.find_cells(image[1], 1)
        cell = self.number_cells(cell_x, cell_y).astype(np.uint16)
        self.ray = np.argsort(cell, kind="stable")
        self.first = np.zeros(self.tiles_x * self.tiles_y * TILE * TILE + 1, np.int32)
        np.cumsum(np.bincount(cell, minlength=len(self.first) - 1), out=self.first[1:])
        self.x, self.y = image[0].take(self.ray), image[1].take(self.ray)
        ranges = _nearness_range(view, view.depth[rows], view.step[rows], t_min, best)
        self.limit, self.margin, self.ceiling = (values.take(self.ray) for values in ranges)
        self.tile_sure = self._reduce(np.maximum, self.limit + self.margin)
        self.tile_ceiling = self._reduce(np.minimum, self.ceiling)
        self.refresh_tiles()

    def find_cells(self, coordinate: NDArray[np.float32], axis: int) -> NDArray[np.int32]:
        """The column (axis 0) or row of cells of image coordinates, clipped to the grid; monotone."""
        count = (self.tiles_x, self.tiles_y)[axis] * TILE
        cell = (coordinate - self.low[axis]) * self.scale[axis]
        return np.clip(cell, np.float32(0), np.float32(count - 1)).astype(np.int32)

    def number_cells(self, x: NDArray[np.int32], y: NDArray[np.int32]) -> NDArray[np.int32]:
        """Number cells by column and row."""
        tile = (y >> TILE_BITS) * np.int32(self.tiles_x) + (x >> TILE_BITS)
        return (((tile << TILE_BITS) + (y & TILE - 1)) << TILE_BITS) + (x & TILE - 1)

    def refresh_tiles(self) -> None:
        """Bring `tile_limit` up to date."""
        self.tile_limit = self._reduce(np.minimum, self.limit)

    def _reduce(self, operation: np.ufunc, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """(tiles,) minimum or maximum over the rays of each tile; infinite where there are none."""
        starts = self.first[: -1 : TILE * TILE]
        filled = np.flatnonzero(np.diff(np.append(starts, self.first[-1])))
        result = np.full(len(starts), np.float32(np.inf))
        result[filled] = operation.reduceat(values, starts[filled])
        return result


def _aspect(view: View) -> float:
    """Width over height of the image square in true proportions: rows of the matrix are scaled by one over them."""
    width, height = (1.0 / np.linalg.norm(np.cross(row, view.matrix[2])) for row in view.matrix[:2])
    return float(width / height)


def _count_tiles(count: int, aspect: float) -> tuple[int, int]:
    """About one cell per ray, square on the image."""
    tiles = min(count, MOST_CELLS) / TILE**2
    wide = int(np.clip(np.ceil(np.sqrt(tiles * aspect)), 1, MOST_CELLS // TILE**2))
    high = int(np.clip(np.ceil(tiles / wide), 1, max(1, MOST_CELLS // TILE**2 // wide)))
    return wide, high


@np.errstate(all="ignore")
def _nearness_range(view: View, depth: Floats, step: Floats, t_min: Floats, best: Floats) -> tuple[NDArray, ...]:
    """Limit, margin and ceiling of rays, (k,) float32 each: nearness at the far and at the near end of their range."""
    start, end = depth + step * t_min, depth + step * best
    if view.pencil.parallel:
        size = SLACK * (1 + np.abs(depth) + np.abs(step) * np.where(np.isfinite(best), best, 0.0))
        limit, sure = -end - size, -end + size
        ceiling = -start - SLACK * (1 + np.abs(depth) + np.abs(step) * t_min)
    else:
        # Arriving rays are seen from their end: what they meet last is nearest.
        far, near = (depth, np.maximum(end, view.blurred)) if view.pencil.arriving else (end, start)
        limit, ceiling = (1 - SLACK) / far, (1 - SLACK) / near
        sure = (1 + SLACK) / (start if view.pencil.arriving else end)
    limit = np.where(best >= t_min, limit, np.inf)
    margin = np.where(sure > limit, (1 + SLACK) * (sure - limit), np.where(sure == limit, 0.0, np.inf))
    return round_down(limit), -round_down(-margin), round_down(ceiling)
