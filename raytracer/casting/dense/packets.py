"""Pairs of ray and node sorted by node into packets of equally many rays, and what packets meet, by matrix products.

What a product costs beside its arithmetic is shared by a packet's rays; the last packet of a node is filled up with a
ray that meets nothing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans

# Rays of a packet: as many as half the rays that a node has in the mean.
LANES = (4, 8, 16, 32, 64)
# Rays tested together: what they need fits the cache.
LANE_BLOCK = 4096
ZERO, ONE = np.float32(0), np.float32(1)


class Packets(NamedTuple):
    """p packets of l rays each.

    ray : (p, l) intp; node : (p,) the node that all of a packet's rays are at
    """

    ray: NDArray[np.intp]
    node: NDArray[np.intp]


def make_packets(ray: NDArray, node: NDArray[np.uint16], node_count: int, nothing: int) -> Packets:
    """Sort k pairs by node, of which there are `node_count`; `nothing` is the ray that fills up."""
    count = np.bincount(node, minlength=node_count)
    mean = len(ray) / max(1, np.count_nonzero(count))
    lanes = max((lanes for lanes in LANES if 2 * lanes <= mean), default=LANES[0])
    packets = -(-count // lanes)
    # Where each pair goes: its place in the order of nodes, and what was filled up before its node.
    free = packets * lanes - count
    place = np.repeat(np.cumsum(free) - free, count)
    place += np.arange(len(ray))
    filled = np.full(int(packets.sum()) * lanes, nothing, np.intp)
    filled[place] = ray.take(np.argsort(node, kind="stable"))
    return Packets(filled.reshape(-1, lanes), np.repeat(np.arange(node_count), packets))


def enter_boxes(table: NDArray[np.float32], slabs: NDArray[np.float32]) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Which boxes rays enter, as places in (p, f, l), and at which distance.

    table : (p, 3, 2 f, 3) of the nodes' children; slabs : (p, l, 9) of the packets' rays
    """
    packets, lanes = slabs.shape[:2]
    times = np.matmul(table, slabs.reshape(packets, lanes, 3, 3).transpose(0, 2, 3, 1))  # (p, 3, 2 f, l)
    fan = times.shape[2] // 2
    entry = np.maximum(times[:, 0, :fan], times[:, 1, :fan])
    minus_exit = np.maximum(times[:, 0, fan:], times[:, 1, fan:])
    np.maximum(entry, times[:, 2, :fan], out=entry)
    np.maximum(minus_exit, times[:, 2, fan:], out=minus_exit)
    # Entry before exit, and exit not behind the start.
    late = entry + minus_exit
    np.maximum(late, minus_exit, out=late)
    index = np.flatnonzero(late <= ZERO)
    return index, entry.ravel().take(index)


def cross_triangles(edges: NDArray[np.float32], lines: NDArray[np.float32]) -> tuple[NDArray[np.intp], Booleans]:
    """Which triangles rays' lines may meet, as places in (p, k, l), and whether they certainly do.

    edges : (p, 3 k, 6) of the blocks; lines : (p, l, 8) of the packets' rays
    """
    products = np.matmul(edges, lines[:, :, :6].transpose(0, 2, 1))  # (p, 3 k, l)
    size = products.shape[1] // 3
    # False for NaN: what fills up is never met.
    low, high = products <= ONE, products >= -ONE
    low_a, low_b, low_c = low[:, :size], low[:, size : 2 * size], low[:, 2 * size :]
    high_a, high_b, high_c = high[:, :size], high[:, size : 2 * size], high[:, 2 * size :]
    met = low_a & low_b
    met &= low_c
    positive = high_a & high_b
    positive &= high_c
    met |= positive
    index = np.flatnonzero(met)
    # In doubt where some function may be negative or zero, and some may be positive or zero.
    low_a |= low_b
    low_a |= low_c
    high_a |= high_b
    high_a |= high_c
    doubt = low_a & high_a
    return index, ~doubt.ravel().take(index)
