"""Many lights in a binary tree: its nodes are groups of lights that lie together (`light_importance`).

From each point the tree is cut as coarsely as the point allows: groups that look small from there stay whole, what is
near comes apart. `light_picks` picks by such cuts; rays find the lights that they may meet.

References
----------
A. Conty Estevez, C. Kulla, "Importance Sampling of Many Lights with Adaptive Tree Splitting", HPG 2018.
Blender, intern/cycles/scene/light_tree.cpp.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.lecture import dot
from raytracer.lights.light_bounds import LightBounds, join_bounds
from raytracer.lights.light_importance import LightClusters, measure_clusters
from raytracer.predicates.rounding import gamma

# Groups stay whole where the square of their radius is at most this share of the square of their distance: distances to
# their lights are within a factor of 3, for which what is picked inside of them makes up.
OPENNESS = 0.25
# Cuts from lights' places hold so many groups on average, at most: else larger groups stay whole.
LARGEST_CUT = 64
LARGEST_OPENNESS = 2.0**6
# Places that cuts are tried from.
TRIED_PLACES = 256
# Rays that look for lights together: what bounds the memory for pairs of a ray and a node.
RAYS_AT_ONCE = 1 << 14


@dataclass(frozen=True, eq=False)
class LightTree:
    """A binary tree of lights; the first half of node k is node k + 1.

    clusters : the lights of each node
    within : (nodes,) float64, square metres, nodes whose middle is nearer by its square come apart; -1 of lights
    second : (nodes,) intp, the other half; -1 of nodes that are a light
    size : (nodes,) float64, how many lights
    light : (nodes,) int32, number of that light; -1 of others
    parent : (nodes,) intp; -1 of the root
    leaf : (lights,) intp, the node of each light
    """

    clusters: LightClusters
    within: Floats
    second: Indices
    size: Floats
    light: NDArray[np.int32]
    parent: Indices
    leaf: Indices


# Building ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Nodes:
    """The shape of a tree, its nodes in the order of `LightTree`.

    order : (lights,) intp, so that each node has consecutive lights, `size` from the place `start` on
    level : (nodes,) how far from the root; start, size : (nodes,); second, parent : as of LightTree
    """

    order: Indices
    level: Indices
    start: Indices
    size: Indices
    second: Indices
    parent: Indices


def _halve(middle: Floats) -> _Nodes:
    """Return the tree of lights whose boxes have middles (lights, 3): halved by number, across the longest side."""
    count = len(middle)
    order, second = np.arange(count), np.full(2 * count - 1, -1, np.intp)
    found: list[tuple[int, int, int, int]] = []
    waiting = [(0, count, -1, 0)]
    while waiting:
        start, stop, parent, level = waiting.pop()
        node = len(found)
        if node != parent + 1:
            second[parent] = node
        found.append((start, parent, level, stop - start))
        if stop - start > 1:
            places = middle[order[start:stop]]
            longest = np.argmax(places.max(axis=0) - places.min(axis=0))
            order[start:stop] = order[start:stop][np.argsort(places[:, longest], kind="stable")]
            half = (start + stop) // 2
            waiting += [(half, stop, node, level + 1), (start, half, node, level + 1)]
    start_of, parent_of, level_of, size_of = (np.array(column, np.intp) for column in zip(*found, strict=True))
    return _Nodes(order, level_of, start_of, size_of, second, parent_of)


def make_light_tree(leaves: LightBounds) -> LightTree:
    """Return the tree of lights of such bounds."""
    nodes = _halve((leaves.low + leaves.high) / 2.0)
    is_light, bounds = nodes.size == 1, leaves.select(np.zeros(len(nodes.level), np.intp))
    for level in range(int(nodes.level.max()) + 1):
        # Lights that are nodes further up are joined once more, with none.
        rows = np.flatnonzero((nodes.level == level) | (is_light & (nodes.level < level)))
        rows = rows[np.argsort(nodes.start[rows])]
        bounds.overwrite(rows, join_bounds(leaves.select(nodes.order), nodes.start[rows]))
    light = np.full(len(nodes.level), -1, np.int32)
    light[is_light] = nodes.order[nodes.start[is_light]]
    leaf = np.empty(len(leaves.low), np.intp)
    leaf[light[is_light]] = np.flatnonzero(is_light)
    clusters = measure_clusters(bounds)
    within, size = _choose_within(clusters, nodes.second), nodes.size.astype(np.float64)
    return LightTree(clusters, within, nodes.second, size, light, nodes.parent, leaf)


def _choose_within(clusters: LightClusters, second: Indices) -> Floats:
    """Return square distances (nodes,) as of `LightTree` by which cuts are fine, but not too large."""
    lights = np.flatnonzero(second < 0)
    tried = clusters.middle[:, lights[:: -(-len(lights) // TRIED_PLACES)]]
    openness = OPENNESS
    while True:
        within = np.where(second < 0, -1.0, clusters.square_radius / openness)
        row, _ = cut_nodes(clusters, within, second, tried)
        if len(row) <= LARGEST_CUT * tried.shape[1] or openness >= LARGEST_OPENNESS:
            return within
        openness *= 2.0


# Cutting -------------------------------------------------------------------------------------------------------------


def cut_nodes(clusters: LightClusters, within: Floats, second: Indices, position: Floats) -> tuple[Indices, Indices]:
    """Return pairs of a point's row (k,) and a node (k,): for each of n points nodes that hold every light once.

    Pairs are ordered by level of the tree; those of one point are in an order of its own.

    position : (3, n) float64; the others as of `LightTree`
    """
    row, node = np.arange(position.shape[1]), np.zeros(position.shape[1], np.intp)
    rows, nodes = [], []
    while len(row):
        apart = come_apart(clusters, within, node, position, row)
        whole, open_ = np.flatnonzero(~apart), np.flatnonzero(apart)
        rows.append(row.take(whole))
        nodes.append(node.take(whole))
        row, node = row.take(open_), node.take(open_)
        row, node = np.concatenate([row, row]), np.concatenate([node + 1, second.take(node)])
    return np.concatenate([np.zeros(0, np.intp), *rows]), np.concatenate([np.zeros(0, np.intp), *nodes])


def come_apart(clusters: LightClusters, within: Floats, node: Indices, position: Floats, row: Indices) -> Booleans:
    """True for nodes (k,) that cuts from points by their rows (k,) do not leave whole; arguments as of `cut_nodes`."""
    x, y, z = (middle.take(node) - place.take(row) for middle, place in zip(clusters.middle, position, strict=True))
    apart: Booleans = within.take(node) > x * x + y * y + z * z
    return apart


# Meeting -------------------------------------------------------------------------------------------------------------


def find_near_lights(tree: LightTree, origins: Floats, directions: Floats) -> tuple[Indices, NDArray[np.int32]]:
    """Return pairs of a ray (k,) and a light (k,) that it comes near; every light that it meets is there.

    Pairs are ordered by light, then by ray.
    """
    found = [
        _walk(tree, origins[first : first + RAYS_AT_ONCE], directions[first : first + RAYS_AT_ONCE], first)
        for first in range(0, len(origins), RAYS_AT_ONCE)
    ]
    rays = np.concatenate([np.zeros(0, np.intp), *(pair[0] for pair in found)])
    lights = np.concatenate([np.zeros(0, np.int32), *(pair[1] for pair in found)])
    order = np.lexsort((rays, lights))
    return rays[order], lights[order]


def _walk(tree: LightTree, origins: Floats, directions: Floats, first: int) -> tuple[Indices, NDArray[np.int32]]:
    """Return the pairs of some rays, numbered from `first`, level by level."""
    ray, node = np.arange(len(origins)), np.zeros(len(origins), np.intp)
    rays, lights = [], []
    while len(ray):
        met = np.flatnonzero(_comes_near(tree, node, origins.take(ray, axis=0), directions.take(ray, axis=0)))
        ray, node = ray[met], node[met]
        is_light = tree.second[node] < 0
        rays.append(ray[is_light] + first)
        lights.append(tree.light[node[is_light]])
        ray, node = ray[~is_light], node[~is_light]
        node = np.concatenate([node + 1, tree.second[node]])
        ray = np.concatenate([ray, ray])
    return np.concatenate([np.zeros(0, np.intp), *rays]), np.concatenate([np.zeros(0, np.int32), *lights])


def _comes_near(tree: LightTree, node: Indices, origins: Floats, directions: Floats) -> Booleans:
    """True where the middle of a node's box is no further from a ray (n,), or from where it starts if that is beyond,
    than the radius of the sphere around the box."""
    offset = tree.clusters.middle.T[node] - origins
    square, along = dot(offset, offset), dot(offset, directions)
    nearest = np.where(along > 0, square - along * along / dot(directions, directions), square)
    # Squares of a rounded offset, and their difference: to within gamma(16) of the larger.
    near: Booleans = nearest <= tree.clusters.square_radius[node] + gamma(16) * square
    return near
