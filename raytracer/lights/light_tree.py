"""Many lights: a tree that picks one of them for a point, and tells which of them rays can meet.

Where there are many lights few matter at a point. A light is picked with a probability near to its share of the light
there, by walking down a binary tree of the lights. Of the two halves of a node one is taken in proportion to

    importance = intensity max(cos a, c) max(cos b, c) / max(d^2, R^2),

d the distance to the middle of the box around the half's lights, R its radius as a sphere, a the least angle between
the point and any direction that one of them shines in, and 0 beyond their cones, b the least angle between the normal
at the point and the way to one of them. Every light that reaches a point has a probability there, so that light over
probability is an unbiased estimate however poor the guess.

References
----------
A. Conty Estevez, C. Kulla, "Importance Sampling of Many Lights with Adaptive Tree Splitting", HPG 2018.
Blender, intern/cycles/scene/light_tree.cpp, kernel/light/tree.h.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.lecture import dot
from raytracer.lights.light_bounds import LightBounds, bound_lights, join_bounds
from raytracer.predicates.rounding import gamma
from raytracer.scene.lights import Light

# What is seen from aside keeps this share of its importance, for surfaces that are no matt ones; and what is behind the
# surface this, for those that light comes through.
LEAST_COSINE = 2.0**-6
SHARE_BEHIND = 2.0**-4
# Rays that look for lights together: what bounds the memory for pairs of a ray and a node.
RAYS_AT_ONCE = 1 << 14


@dataclass(frozen=True, eq=False)
class LightTree:
    """A binary tree of lights; the first half of node k is node k + 1.

    lights : those that have a place
    bounds : of all nodes
    middle : (3, nodes) float64, of the boxes, by axis; square_radius : (nodes,) float64, of spheres around them
    second : (nodes,) int32, the other half; -1 of nodes that are a light
    light : (nodes,) int32, number of that light; -1 of others
    parent : (nodes,) int32; -1 of the root
    leaf : (lights,) int32, the node of each light
    """

    lights: tuple[Light, ...]
    bounds: LightBounds
    middle: Floats
    square_radius: Floats
    second: NDArray[np.int32]
    light: NDArray[np.int32]
    parent: NDArray[np.int32]
    leaf: NDArray[np.int32]


# Building ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Nodes:
    """The shape of a tree, its nodes in the order of `LightTree`.

    order : (lights,) intp, so that each node has consecutive lights, from the place `start` on
    level : (nodes,) how far from the root; start : (nodes,); second, parent : as of LightTree
    is_light : (nodes,) bool
    """

    order: Indices
    level: Indices
    start: Indices
    second: NDArray[np.int32]
    parent: NDArray[np.int32]
    is_light: Booleans


def _halve(middle: Floats) -> _Nodes:
    """Return the tree of lights whose boxes have middles (lights, 3): halved by number, across the longest side."""
    count = len(middle)
    order, second = np.arange(count), np.full(2 * count - 1, -1, np.int32)
    found: list[tuple[int, int, int, bool]] = []
    waiting = [(0, count, -1, 0)]
    while waiting:
        start, stop, parent, level = waiting.pop()
        node = len(found)
        if node != parent + 1:
            second[parent] = node
        found.append((start, parent, level, stop - start == 1))
        if stop - start > 1:
            places = middle[order[start:stop]]
            longest = np.argmax(places.max(axis=0) - places.min(axis=0))
            order[start:stop] = order[start:stop][np.argsort(places[:, longest], kind="stable")]
            half = (start + stop) // 2
            waiting += [(half, stop, node, level + 1), (start, half, node, level + 1)]
    start_of, parent_of, level_of, is_light = (np.array(column) for column in zip(*found, strict=True))
    return _Nodes(order, level_of, start_of, second, parent_of.astype(np.int32), is_light)


def make_light_tree(lights: tuple[Light, ...]) -> LightTree:
    """Return the tree of lights that have a place."""
    leaves = bound_lights(lights)
    nodes = _halve((leaves.low + leaves.high) / 2.0)
    bounds = leaves.select(np.zeros(len(nodes.level), np.intp))
    for level in range(int(nodes.level.max()) + 1):
        # Lights that are nodes further up are joined once more, with none.
        rows = np.flatnonzero((nodes.level == level) | (nodes.is_light & (nodes.level < level)))
        rows = rows[np.argsort(nodes.start[rows])]
        bounds.overwrite(rows, join_bounds(leaves.select(nodes.order), nodes.start[rows]))
    light = np.full(len(nodes.level), -1, np.int32)
    light[nodes.is_light] = nodes.order[nodes.start[nodes.is_light]]
    leaf = np.empty(len(lights), np.int32)
    leaf[light[nodes.is_light]] = np.flatnonzero(nodes.is_light)
    half = (bounds.high - bounds.low) / 2.0
    return LightTree(
        lights=lights,
        bounds=bounds,
        middle=np.ascontiguousarray((bounds.low + half).T),
        square_radius=dot(half, half),
        second=nodes.second,
        light=light,
        parent=nodes.parent,
        leaf=leaf,
    )


# Picking -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, slots=True)
class Receivers:
    """n points that are lit.

    position, normal : (n, 3) float64; the normal, unit, on the side that the light is reflected to
    sets : (n,) int64, of the objects that they are on; None where all lights light all
    """

    position: Floats
    normal: Floats
    sets: NDArray[np.int64] | None

    def __len__(self) -> int:
        return len(self.position)

    def select(self, rows: Indices) -> Receivers:
        """Return some of the points."""
        sets = None if self.sets is None else self.sets[rows]
        return Receivers(self.position.take(rows, axis=0), self.normal.take(rows, axis=0), sets)


def _find_importance(tree: LightTree, node: NDArray[np.integer], points: Receivers) -> Floats:
    """Return how much nodes (n,) promise n points."""
    offset = [tree.middle[axis].take(node) - points.position[:, axis] for axis in range(3)]
    square = offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2]
    around = tree.square_radius.take(node)
    # A point on a light that is a point itself: as bright as a float64 can tell.
    nearest = np.maximum(np.maximum(square, around), np.finfo(np.float64).tiny)
    facing = sum(values * points.normal[:, axis] for axis, values in enumerate(offset)) / np.sqrt(nearest)
    importance = tree.bounds.intensity.take(node) * _find_facing(facing, around / nearest) / nearest
    aimed = np.flatnonzero((tree.bounds.turn.take(node) < np.pi) & (square > around))
    if len(aimed):
        away = -np.stack([values[aimed] for values in offset], axis=1)
        importance[aimed] *= _find_cone_factor(tree, node[aimed], away, square[aimed])
    if points.sets is not None:
        importance[(tree.bounds.receivers[node] >> points.sets) & 1 == 0] = 0.0
    return importance


def _find_facing(cosine: Floats, square_sine: Floats) -> Floats:
    """Return max(cos b, c) (n,) for the cosine between normals and the ways to the middles of nodes, whose spheres are
    seen at a half angle w of a squared sine: cos b is cos(a - w), and 1 where a < w. What lies behind counts less."""
    width = np.sqrt(1.0 - square_sine)
    aside = np.sqrt(np.maximum(1.0 - cosine * cosine, 0.0) * square_sine)
    before = np.where(cosine >= width, 1.0, cosine * width + aside)
    behind = np.where(cosine <= -width, 1.0, aside - cosine * width)
    return np.maximum(np.maximum(before, SHARE_BEHIND * behind), LEAST_COSINE)


def _find_cone_factor(tree: LightTree, node: NDArray[np.integer], offset: Floats, square: Floats) -> Floats:
    """Return max(cos a, c) of the least angle a between points outside the spheres around nodes (n,) and the
    directions that their lights point to; 0 where none of them shines that far aside.

    offset : (n, 3) from the middle of the node, and square : (n,) its squared length
    """
    bounds, distance = tree.bounds, np.sqrt(square)
    angle = np.arccos(np.clip(dot(offset, bounds.axis.take(node, axis=0)) / distance, -1.0, 1.0))
    width = np.arcsin(np.minimum(np.sqrt(tree.square_radius.take(node)) / distance, 1.0))
    angle = np.maximum(angle - bounds.turn.take(node) - width, 0.0)
    return np.where(angle <= bounds.reach.take(node), np.maximum(np.cos(angle), LEAST_COSINE), 0.0)


def _find_share(
    tree: LightTree, node: NDArray[np.integer], other: NDArray[np.integer], points: Receivers
) -> tuple[Floats, Booleans]:
    """Return the probability (n,) of nodes against their other halves, and (n,) False where neither has any."""
    own = _find_importance(tree, node, points)
    total = own + _find_importance(tree, other, points)
    return np.divide(own, total, out=np.zeros_like(own), where=total > 0), total > 0


class Picked(NamedTuple):
    """A light (n,) for each of n points, the probability (n,) with which it is picked there, 0 where no light reaches
    the point, and how far (n,) the number that it was picked by lies within its part of the unit interval."""

    light: NDArray[np.int32]
    probability: Floats
    depth: Floats


def pick_lights(tree: LightTree, points: Receivers, choice: Floats) -> Picked:
    """Pick a light for each of n points.

    choice : (n,) uniform numbers; what is left of one after each step decides the next
    """
    node, probability, choice = np.zeros(len(points), np.int32), np.ones(len(points)), choice.copy()
    while True:
        rows = np.flatnonzero(tree.second.take(node) >= 0)
        if not len(rows):
            return Picked(tree.light[node], probability, choice * probability)
        first, second = node[rows] + np.int32(1), tree.second.take(node[rows])
        share, shines = _find_share(tree, first, second, points.select(rows))
        at = choice[rows]
        takes_second = at >= share
        part = np.where(takes_second, 1.0 - share, share)
        rest = np.divide(at - np.where(takes_second, share, 0.0), part, out=np.zeros_like(at), where=part > 0)
        choice[rows] = np.minimum(rest, np.nextafter(1.0, 0.0))
        probability[rows] *= np.where(shines, part, 0.0)
        node[rows] = np.where(takes_second, second, first)


def find_probability(tree: LightTree, light: NDArray[np.integer], points: Receivers) -> Floats:
    """Return the probability (n,) with which `pick_lights` picks a `light` (n,) for n points."""
    node, probability = tree.leaf[light], np.ones(len(points))
    while True:
        rows = np.flatnonzero(tree.parent[node] >= 0)
        if not len(rows):
            return probability
        above = tree.parent[node[rows]]
        is_first = node[rows] == above + 1
        other = np.where(is_first, tree.second[above], above + 1)
        probability[rows] *= _find_share(tree, node[rows], other, points.select(rows))[0]
        node[rows] = above


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
    ray, node = np.arange(len(origins)), np.zeros(len(origins), np.int32)
    rays, lights = [], []
    while len(ray):
        met = np.flatnonzero(_comes_near(tree, node, origins.take(ray, axis=0), directions.take(ray, axis=0)))
        ray, node = ray[met], node[met]
        is_light = tree.second[node] < 0
        rays.append(ray[is_light] + first)
        lights.append(tree.light[node[is_light]])
        ray, node = ray[~is_light], node[~is_light]
        node = np.concatenate([node + np.int32(1), tree.second[node]])
        ray = np.concatenate([ray, ray])
    return np.concatenate([np.zeros(0, np.intp), *rays]), np.concatenate([np.zeros(0, np.int32), *lights])


def _comes_near(tree: LightTree, node: NDArray[np.integer], origins: Floats, directions: Floats) -> Booleans:
    """True where the middle of a node's box is no further from a ray (n,), or from where it starts if that is beyond,
    than the radius of the sphere around the box."""
    offset = tree.middle.T[node] - origins
    square, along = dot(offset, offset), dot(offset, directions)
    nearest = np.where(along > 0, square - along * along / dot(directions, directions), square)
    # Squares of a rounded offset, and their difference: to within gamma(16) of the larger.
    near: Booleans = nearest <= tree.square_radius[node] + gamma(16) * square
    return near
