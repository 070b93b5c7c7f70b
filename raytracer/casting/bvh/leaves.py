"""The triangles of leaves in float32, and a test that leaves little more than the hits for `query` to decide.

With R = d x (a - o), the edges e = b - a, f = c - a, N = e x f and D = d . N, the edge functions of `predicates` are
E_b = -R . f, E_c = R . e and E_a = D - E_b - E_c, and the distance is t = (a - o) . N / D. Two edge functions of
opposite signs beyond the tolerance rule a triangle out; three of equal signs beyond twice that make a hit sure.

    tolerance = TOLERANCE P h (1 + h),    |error of t| <= TOLERANCE P h^2 / |D|

P is the row's largest pad (`culling`), h the largest component of e and f, and d has the largest component 1.

Why that is conservative. With u = 2^-24, r = 1 + |o| >= |a - o|, P >= 4 u r, and h <= 2 in a frame:

- Moved lines. A ray that meets the true triangle meets the float32 one at the same t after a move w, |w| <= 2.01 P:
  the row's origin is off by its pad and one rounding, its direction by u over a way of r, corners by 3 u. A move
  changes E_b and E_c by (d x w) . f, at most 2 |w| 3 h = 12.1 P h, E_a by twice that, and t by w . N / D, at most
  |w| 6 h^2 / |D| = 12.1 P h^2 / |D|.
- Rounding of E. R is off by 6 u r, which changes E_b and E_c by 18 u r h <= 4.5 P h; further roundings are 9 u |R| h,
  those of D 30 u h^2, and those of the last differences u (|D| + 2 |E_b| + |E_c|). Where the triangle is hit, a is no
  farther from the line than the sides are long: |R| <= 3 h, and these roundings together are below 123 u h^2
  <= 31 P h^2. E_a is off by (24.2 + 9) P h + 31 P h^2 at most. Where it is not hit, |R| <= 2 r and E_a is off by
  24.2 P h + 174 u r h <= 68 P h.
- Rounding of t. (a - o) . N is off by 36 u r h^2, t D by 30 u r h^2; quotient, scale and bounds are four more roundings
  of t, 24 u r h^2 / |D|. In all (12.1 + 22.5) P h^2 / |D|.

Sizes below SMALLEST_SIZE are replaced by it, so that no product underflows below the tolerance. Infinity and NaN decide
nothing. Whatever is no triangle has h = infinity and is always possible; empty slots have h = -1 and never are.

A leaf is ten rows of four floats, one per slot: a, e, f, h (1 + h).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans
from raytracer.casting.bvh.tree import NO_ITEM, WIDTH, Frame, Tree
from raytracer.predicates.filtered import cross, dot

LEAF_ROWS = 10
SIZE_ROW = 9
TOLERANCE = 36.0
SMALLEST_SIZE = 2.0**-100
# Leaves packed at a time.
BLOCK = 1 << 13


def pack_leaves(tree: Tree, corners: NDArray) -> NDArray[np.float32]:
    """Return the (b, 10, 4) float32 rows of a tree's leaves; items beyond the (t, 9) corners are no triangles."""
    packed = np.empty((len(tree.leaves), LEAF_ROWS, WIDTH), np.float32)
    for start in range(0, len(packed), BLOCK):
        items = tree.leaves[start : start + BLOCK]
        _pack_block(packed[start : start + BLOCK], items, corners, tree.frame)
    return packed


def _pack_block(packed: NDArray[np.float32], items: NDArray, corners: NDArray, frame: Frame) -> None:
    triangle = (items != NO_ITEM) & (items < len(corners))
    points = corners.take(items[triangle], axis=0).reshape(-1, 3, 3).astype(np.float64)
    planes = np.zeros((9, *items.shape))
    planes[:, triangle] = frame.place(points).reshape(-1, 9).T
    planes[3:6] -= planes[:3]
    planes[6:] -= planes[:3]
    size = np.maximum(np.abs(planes[3:]).max(axis=0), SMALLEST_SIZE)
    packed[:, :SIZE_ROW] = planes.transpose(1, 0, 2)
    packed[:, SIZE_ROW] = np.where(items == NO_ITEM, -1.0, np.where(triangle, size * (1 + size), np.inf))


class LeafHits(NamedTuple):
    """What is known of c rays and the four slots of a leaf each, all (c, 4).

    possible : False where the ray certainly misses
    sure : True where the ray's line certainly meets the triangle
    low, high : float32 bounds of the distance, in units of the row; NaN where nothing is known
    """

    possible: Booleans
    sure: Booleans
    low: NDArray[np.float32]
    high: NDArray[np.float32]


def test_leaves(table: NDArray[np.float32], leaf: NDArray[np.intp], lines: NDArray) -> LeafHits:
    """Test c rays against the triangles of a leaf each.

    table : (10 b, 4) float32 rows of all leaves
    lines : (8, c, 4) float32 origin, unit direction, TOLERANCE P and scale of each ray, the same in all four columns
    """
    row = leaf * LEAF_ROWS
    planes: NDArray = np.empty((LEAF_ROWS, *lines.shape[1:]), np.float32)
    for k in range(LEAF_ROWS):
        table[k:].take(row, axis=0, out=planes[k], mode="clip")
    relative, direction = np.subtract(planes[:3], lines[:3], out=planes[:3]), lines[3:6]
    moment, normal = cross(direction, relative), cross(planes[3:6], planes[6:9])
    edge_b, edge_c, denominator = -dot(moment, planes[6:9]), dot(moment, planes[3:6]), dot(direction, normal)
    edge_a = denominator - edge_b - edge_c
    highest = np.maximum(np.maximum(edge_a, edge_b), edge_c)
    lowest = np.minimum(np.minimum(edge_a, edge_b), edge_c)
    size = planes[SIZE_ROW]
    tolerance = size * lines[6]
    scale = lines[7] / denominator
    t, error = dot(relative, normal) * scale, tolerance * size * np.abs(scale)
    possible = ~((highest > tolerance) & (lowest < -tolerance))
    return LeafHits(
        possible=possible,
        sure=possible & ((lowest > 2 * tolerance) | (highest < -2 * tolerance)),
        low=t - error,
        high=t + error,
    )
