"""Recognizes rays through the points of a grid, row by row, as a pinhole camera's pixels are, or near them.

Rows may begin anywhere with the first ray and end anywhere with the last. What fits is found first, then every ray is
compared with its place, so nothing rests on the fit: what is left, if it is much less than a cell, counts as an error
of the rays; if it is no more than half a cell, as their jitter.
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.types import Floats
from raytracer.casting.pencil.grids import PixelGrid
from raytracer.casting.pencil.jittered_grid import MOST_JITTER, JitteredGrid
from raytracer.casting.rays import Rays
from raytracer.predicates.rounding import UNIT_ROUNDOFF

# Fewer rays, or rays a row, are not worth the query for a grid.
FEWEST, NARROWEST = 64, 8
# Two rows end within so many rays.
WIDEST = 1 << 15
# Rays of a regular grid are off their points by no more than this, cells; it only widens tolerances.
LARGEST_ERROR = 2.0**-12
# What float64 rounds of a place, cells; h_z of a direction is then far better known than ranges need it (`grids`).
LARGEST_ROUNDING = 2.0**-20
# Rays compared at a time, and rays that a fit is made to.
BLOCK, FITTED = 8192, 4096


def find_pixel_grid(rays: Rays, scale: float) -> PixelGrid | None:
    """Return the grid of rays that share their origin, or None.

    scale : a power of two; `scale` times the distances that count are about one
    """
    directions = rays.directions
    wide, skipped = _measure_rows(directions)
    if not wide:
        return None
    for regular, fit in ((True, _fit_corners), (False, _fit_film)):
        matrix = fit(directions, wide, skipped)
        if matrix is None:
            continue
        matrix *= scale / np.abs(matrix[2]).max()
        if _is_far_off(directions, matrix, wide, skipped, LARGEST_ERROR if regular else MOST_JITTER):
            continue
        points, step = _map_directions(directions, matrix)
        off = points - _list_cells(len(directions), wide, skipped)
        rounding = _bound_rounding(directions, matrix, step, np.abs(points).max())
        if not rounding < LARGEST_ROUNDING:
            return None
        worst = float(np.abs(off).max())
        if worst < LARGEST_ERROR:
            return PixelGrid(rays.origins[0], matrix, step, wide, skipped, worst * (1 + 2.0**-20) + rounding)
        if not regular and worst <= MOST_JITTER:
            return JitteredGrid(rays.origins[0], matrix, step, wide, skipped, rounding, points, worst)
    return None


def _measure_rows(directions: Floats) -> tuple[int, int]:
    """Rays of a row, and how many the first row lacks: steps that are much longer than others end rows; (0, 0) if they
    do not."""
    if len(directions) < FEWEST:
        return 0, 0
    step = np.abs(np.diff(directions[: WIDEST + 1], axis=0))
    length = step[:, 0] + step[:, 1] + step[:, 2]
    jumps = np.flatnonzero(length > length.max() / 2)
    if len(jumps) < 2:
        return 0, 0
    wide, begun = int(jumps[1] - jumps[0]), int(jumps[0]) + 1
    return (wide, wide - begun) if wide >= max(NARROWEST, begun) else (0, 0)


def _list_cells(count: int, wide: int, skipped: int, index: np.ndarray | None = None) -> Floats:
    """(2, n) columns and rows of rays' cells, counted from the middle one."""
    index = np.arange(count) if index is None else index
    row, column = np.divmod(index + skipped, wide)
    high = -(-(skipped + count) // wide)
    return np.stack([column - float(wide // 2), row - float(high // 2)])


def _fit_corners(directions: Floats, wide: int, skipped: int) -> Floats | None:
    """A for which the corner rays d of the whole rows have A d in proportion to (column, row, 1).

    With corners p, q, r, s (first row, last row) a p - b q - c r + s = 0 for some a, b, c > 0 if they span a grid.
    """
    first = wide - skipped if skipped else 0
    last = first + ((len(directions) - first) // wide - 1) * wide
    if last <= first:
        return None
    corners = np.array([first, first + wide - 1, last, last + wide - 1])
    (left, low), _, (_, high), _ = _list_cells(len(directions), wide, skipped, corners).T
    p, q, r, s = directions[corners]
    try:
        a, b, c = np.linalg.solve(np.stack([-p, q, r], axis=1), s)
        if not (a > 0 and b > 0 and c > 0):
            return None
        along, across = (b * q - a * p) / (wide - 1), (c * r - a * p) / (high - low)
        return _invert(along, across, a * p - left * along - low * across)
    except np.linalg.LinAlgError:
        return None


def _fit_film(directions: Floats, wide: int, skipped: int) -> Floats | None:
    """A for rays that end on one plane, as a camera's on its film: the plane's grid that is nearest to their cells."""
    some = np.arange(0, len(directions), max(1, len(directions) // FITTED))
    cells = _list_cells(len(directions), wide, skipped, some)
    design = np.stack([*cells, np.ones(len(some))], axis=1)
    along, across, middle = np.linalg.lstsq(design, directions[some], rcond=None)[0]
    try:
        return _invert(along, across, middle)
    except np.linalg.LinAlgError:
        return None


def _invert(along: Floats, across: Floats, middle: Floats) -> Floats | None:
    matrix = np.linalg.inv(np.stack([along, across, middle], axis=1))
    return matrix if np.isfinite(matrix).all() else None


def _is_far_off(directions: Floats, matrix: Floats, wide: int, skipped: int, most: float) -> bool:
    """True if a few rays already tell that not all are within `most` cells of theirs."""
    some = np.arange(0, len(directions), max(1, len(directions) // 64))
    points, step = _map_directions(directions[some], matrix)
    off = np.abs(points - _list_cells(len(directions), wide, skipped, some))
    return not bool((step > 0).all() and off.max() < most)


def _map_directions(directions: Floats, matrix: Floats) -> tuple[Floats, Floats]:
    """Image points (2, n) and h_z of directions."""
    points, step = np.empty((2, len(directions))), np.empty(len(directions))
    for start in range(0, len(directions), BLOCK):
        part = slice(start, start + BLOCK)
        mapped = np.matmul(matrix, directions[part].T)
        step[part] = mapped[2]
        np.divide(mapped[:2], mapped[2], out=points[:, part])
    return points, step


def _bound_rounding(directions: Floats, matrix: Floats, step: Floats, farthest: float) -> float:
    """How far image points may be off for float64, cells; infinite or NaN if any ray is behind.

    h_i rounds by less than gamma(4) |A_i| |d|, |.| summed and largest, and x = h_x / h_z by that over h_z for both.
    """
    least = float(step.min())
    sizes = np.abs(matrix).sum(axis=1) * np.abs(directions).max()
    bound = 8 * UNIT_ROUNDOFF * (sizes[:2].max() + sizes[2] * farthest) / least + 2 * UNIT_ROUNDOFF * farthest
    return float(bound) if least > 0 else np.inf
