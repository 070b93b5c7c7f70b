"""Signs of edge functions beyond doubt, zero included, and where rays meet edges and vertices exactly.

Three stages, each for what the one before left open: float64 with the pair's own bound, exact zeros of rays through a
corner, pairs of float64 (all from `predicates` and `refine`). Rays through edges and vertices meet several triangles
at one distance, and so do rays at boxes that stand on a floor: such ties are recognised here by the corners or the
plane that triangles share, without computing the distance.

Lines are (8, k) planes, origin, direction, slopes; corners (3 corners, 3, k) planes; the main axis comes last.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans
from raytracer.predicates import filtered, refine

# The edge opposite corner i runs from corner FIRST[i] to corner SECOND[i].
FIRST, SECOND = [1, 2, 0], [2, 0, 1]


def judge_edges(lines: NDArray, corners: NDArray, closed: bool) -> tuple[Booleans, Booleans]:
    """Return (certainly inside, possibly inside) of k lines and triangles, (k,) each.

    closed : edges and vertices belong to the triangle; else a line through one stays in doubt
    """
    signs, known = edge_signs(lines, corners)
    highest, lowest = signs.max(axis=0), signs.min(axis=0)
    if not closed:
        return (lowest > 0) | (highest < 0), ~((highest > 0) & (lowest < 0))
    # All zero: D is their sum, so the line lies in the triangle's plane and misses it.
    decided = known.all(axis=0)
    inside = decided & ((highest > 0) != (lowest < 0))
    return inside, ~((decided & ~inside) | ((highest > 0) & (lowest < 0)))


def edge_signs(lines: NDArray, corners: NDArray) -> tuple[NDArray[np.int8], Booleans]:
    """Signs (3, k) int8 of the edge functions over the main axis' direction, and whether each is known; 0 if not."""
    origin, direction, slope = lines[:3], lines[3:6], lines[6:]
    relative = [corner - origin for corner in corners]
    edges = np.stack(filtered.edge_functions(*(filtered.shear(corner, slope) for corner in relative)))
    error = np.stack([filtered.edge_error(relative[p], relative[q], slope) for p, q in zip(FIRST, SECOND, strict=True)])
    signs = (edges > error).astype(np.int8) - (edges < -error)
    known = signs != 0
    # A line through a corner leaves both edges there in doubt.
    corner, lane = np.nonzero(~known[FIRST] & ~known[SECOND])
    touched = np.zeros_like(known)
    touched[corner, lane] = refine.passes_through(
        origin.take(lane, axis=1), direction.take(lane, axis=1), corners[corner, :, lane].T
    )
    known |= touched[FIRST] | touched[SECOND]
    edge, lane = np.nonzero(~known)
    p, q = corners[np.take(FIRST, edge), :, lane].T, corners[np.take(SECOND, edge), :, lane].T
    refined, known[edge, lane] = refine.edge_sign(origin.take(lane, axis=1), direction.take(lane, axis=1), p, q)
    signs[edge, lane] = refined * np.sign(direction[2, lane]).astype(np.int8)
    return signs, known


def name_meeting_points(lines: NDArray, corners: NDArray) -> NDArray[np.float64]:
    """Name where k lines meet triangles that they hit on an edge or vertex, (6, k); NaN where they do neither.

    The name is the edge's two corners in lexicographic order, or the vertex twice. A line meets the line through two
    points in one point at most: hits of the same name have exactly the same distance.
    """
    signs, known = edge_signs(lines, corners)
    weighted = signs != 0
    exact = known.all(axis=0) & (weighted.sum(axis=0) < 3)
    lane = np.arange(corners.shape[2])
    p = corners[weighted.argmax(axis=0), :, lane].T
    q = corners[2 - weighted[::-1].argmax(axis=0), :, lane].T
    swap = (p[0] > q[0]) | ((p[0] == q[0]) & ((p[1] > q[1]) | ((p[1] == q[1]) & (p[2] > q[2]))))
    return np.where(exact, np.where(swap, np.concatenate([q, p]), np.concatenate([p, q])), np.nan)


def name_axis_planes(corners: NDArray) -> NDArray[np.float64]:
    """Name the planes x_i = constant that triangles lie in exactly, (2, k): axis and constant; NaN where in none.

    A line that is not in it meets a plane in one point: hits in one plane have exactly the same distance.
    """
    flat = (corners[0] == corners[1]) & (corners[0] == corners[2])  # (3, k)
    axis = flat.argmax(axis=0)
    constant = np.take_along_axis(corners[0], axis[np.newaxis], axis=0)[0]
    return np.where(flat.any(axis=0), np.stack([axis, constant]), np.nan)
