"""Boxes split in halves again and again, into 2^k blocks that differ in size by one at most.

Each part is halved at the median along the axis for which the two halves have the least surface (the surface area
heuristic for equal counts: J. D. MacDonald and K. S. Booth, "Heuristics for ray tracing using space subdivision",
1990). Boxes are sorted once along each axis; a split keeps the three orders by stable partitions (I. Wald and V.
Havran, "On building fast kd-trees for ray tracing, and on doing that in O(N log N)", 2006). A level costs about 60 ns a
box, however many parts it has.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Integers
from raytracer.casting.bvh.clustering import Bounds, half_surface


def split_evenly(bounds: Bounds, levels: int) -> tuple[Integers, NDArray[np.intp]]:
    """Return (order, starts) of 2^levels blocks of t >= 2^levels boxes.

    bounds : (6, t) float32, low and minus high
    order : (t,) int32, the boxes block by block; starts : (2^levels + 1,) where each block begins, then t
    """
    count = bounds.shape[1]
    centres = bounds[:3] - bounds[3:]
    orders = [np.argsort(centre, kind="stable").astype(np.int32) for centre in centres]
    starts = np.array([0, count])
    for _ in range(levels):
        halves = np.append(np.stack([starts[:-1], (starts[:-1] + starts[1:]) // 2], axis=1).ravel(), count)
        axis = _choose_axes(bounds, orders, halves)
        orders = _halve(orders, axis, halves)
        starts = halves
    return orders[0], starts


def _choose_axes(bounds: Bounds, orders: list[Integers], halves: NDArray[np.intp]) -> NDArray[np.intp]:
    """(p,) the axis along which each part's halves have the least surface together."""
    costs = []
    for order in orders:
        boxes = np.stack([np.minimum.reduceat(row.take(order), halves[:-1]) for row in bounds])
        costs.append(half_surface(boxes).reshape(-1, 2).sum(axis=1))
    return np.argmin(costs, axis=0)


def _halve(orders: list[Integers], axis: NDArray[np.intp], halves: NDArray[np.intp]) -> list[Integers]:
    """The orders after every part was halved along its axis."""
    sizes = np.diff(halves)
    # Positions of upper halves: the same in every order, as the parts have their places and sizes.
    upper = np.repeat(np.arange(len(sizes)) % 2 == 1, sizes)
    above, below = np.flatnonzero(upper), np.flatnonzero(~upper)
    axis_above = np.repeat(axis, sizes[1::2])
    is_upper = np.zeros(len(upper), bool)
    for k, order in enumerate(orders):
        is_upper[order.take(above.compress(axis_above == k))] = True
    halved = []
    for order in orders:
        goes_up = is_upper.take(order)
        parted = np.empty_like(order)
        parted[above], parted[below] = order.compress(goes_up), order.compress(~goes_up)
        halved.append(parted)
    return halved
