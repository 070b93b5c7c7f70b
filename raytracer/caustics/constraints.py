"""What a chain of points has to fulfil to be a path of light, and how far it is from that: Snell's law at each point.

At a point x with unit directions i to the point before it and o to the one behind it, and with the index of refraction
eta of o's side over i's, the half vector h = -(i + eta o) / |i + eta o| is parallel to the normal n if and only if the
law of refraction holds. So its two components in the surface's plane, h . s and h . t, are to vanish at each point.

Their derivatives by the points' positions are 2 x 2 blocks, of which a point has three: for itself, the point before
and the one behind. A direction changes by (I - i i^T) dx / distance, h by -(I - h h^T) (di + eta do) / |i + eta o|, and
the axes s and t turn with the normal: ds = -(s . dn) n.

References
----------
J. Hanika, M. Droske, L. Fascione, "Manifold Next Event Estimation", Computer Graphics Forum 34(4), 2015.
W. Jakob, S. Marschner, "Manifold Exploration", SIGGRAPH 2012: half vectors as constraints.
Blender, intern/cycles/kernel/integrator/mnee.h: mnee_compute_constraint_derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from raytracer.arrays.rows import join_columns
from raytracer.arrays.types import Booleans, Floats, Numbers, Pairs, Vectors
from raytracer.arrays.vectors import make_frame, normalize
from raytracer.casting.rays import select_rows
from raytracer.caustics.blocks import Blocks, join_block
from raytracer.caustics.vertices import Vertex
from raytracer.lecture import dot, length
from raytracer.surfaces.departing import LeavingPoints, spawn_origin

# The points of chains, from where light is asked for to the light.
Chain = Sequence[Vertex]


@dataclass(frozen=True, eq=False, slots=True)
class Ends:
    """What n chains join.

    position : (n, 3) float64, metres, the points that are lit, known to within `error` (n,)
    side : (n, 3) float64, unit, geometric normals there, on the side that is lit
    light : (n, 3) float64, points of the light; unit directions towards it where it is infinitely far away
    distant : (n,) float64, 1 where it is, else 0
    """

    position: Vectors
    error: Numbers
    side: Vectors
    light: Vectors
    distant: Numbers

    def select(self, rows: Any) -> Ends:
        """Return some of them: index or boolean array."""
        return select_rows(self, rows)

    def leave(self, direction: Vectors) -> Vectors:
        """Return where rays (n, 3) that leave the lit points start."""
        return spawn_origin(LeavingPoints(self.position, self.error, self.side), direction)

    def find_way(self, position: Vectors) -> tuple[Vectors, Numbers]:
        """Return unit directions (n, 3) from points (n, 3) to the light, and 1 / distance (n,), 0 of distant lights."""
        distant = self.distant[:, np.newaxis] > 0
        way = np.where(distant, self.light, self.light - position)
        return normalize(way), np.where(distant[:, 0], 0.0, _invert_length(way))


def _invert_length(way: Vectors) -> Numbers:
    size = length(way)
    return np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)


@dataclass(frozen=True, eq=False, slots=True)
class Bend:
    """How n chains bend at one of their points.

    before, behind : (n, 3) float64, unit, directions to the points before and behind
    near, far : (n,) float64, 1 / their distances
    eta : (n,) float64, index of refraction of the side behind over that of the side before
    half : (n, 3) float64, unit, the half vector, and the length (n,) of i + eta o
    """

    before: Vectors
    behind: Vectors
    near: Numbers
    far: Numbers
    eta: Numbers
    half: Vectors
    span: Numbers

    def shift_before(self, motion: Vectors) -> Vectors:
        """Return di (n, 3) where the way to the point before changes by `motion` (n, 3)."""
        return self.near[:, np.newaxis] * (motion - dot(self.before, motion)[:, np.newaxis] * self.before)

    def shift_behind(self, motion: Vectors) -> Vectors:
        """Return eta do (n, 3) where the way to the point behind changes by `motion` (n, 3)."""
        return (self.eta * self.far)[:, np.newaxis] * self.turn_behind(motion)

    def turn_behind(self, motion: Vectors) -> Vectors:
        """Return the part of `motion` (n, 3) at right angles to o."""
        return motion - dot(self.behind, motion)[:, np.newaxis] * self.behind

    def shift_half(self, shift: Vectors) -> Vectors:
        """Return dh (n, 3) where i + eta o changes by `shift` (n, 3)."""
        across = shift - dot(self.half, shift)[:, np.newaxis] * self.half
        return -across / self.span[:, np.newaxis]


def find_bend(vertex: Vertex, before: Vectors, way: tuple[Vectors, Numbers]) -> Bend:
    """Return the Bend at points of chains; before : (n, 3) the points before; way : unit directions (n, 3) to what is
    behind, and 1 / distance (n,)."""
    back = before - vertex.position
    incoming, outgoing = normalize(back), way[0]
    eta = np.where(dot(incoming, vertex.geometric_normal) < 0, 1.0 / vertex.eta, vertex.eta)
    whole = incoming + eta[:, np.newaxis] * outgoing
    span = length(whole)
    span = np.where(span > 0, span, 1.0)
    return Bend(incoming, outgoing, _invert_length(back), way[1], eta, -whole / span[:, np.newaxis], span)


def find_bends(chain: Chain, ends: Ends) -> list[Bend]:
    """Return the Bend at each point of chains."""
    points = [ends.position, *(vertex.position for vertex in chain)]
    bends = []
    for number, vertex in enumerate(chain):
        way = ends.find_way(vertex.position)
        if number + 1 < len(chain):
            ahead = points[number + 2] - vertex.position
            way = normalize(ahead), _invert_length(ahead)
        bends.append(find_bend(vertex, points[number], way))
    return bends


def passes_all(chain: Chain, bends: Sequence[Bend]) -> Booleans:
    """Return (n,) True for chains that go through the surface at each point, and are not thrown back."""
    passing = np.ones(len(chain[0]), dtype=np.bool_)
    for vertex, bend in zip(chain, bends, strict=True):
        passing &= dot(vertex.normal, bend.before) * dot(vertex.normal, bend.behind) < 0
    return passing


def find_misses(chain: Chain, bends: Sequence[Bend]) -> list[Pairs]:
    """Return how far the chains are from Snell's law at each point: the components (n, 2) of h in the surface."""
    misses = []
    for vertex, bend in zip(chain, bends, strict=True):
        s, t = make_frame(vertex.normal)
        misses.append(join_columns(dot(bend.half, s), dot(bend.half, t)))
    return misses


def differentiate(chain: Chain, bends: Sequence[Bend]) -> Blocks:
    """Return the derivatives of `find_misses` by the points' positions in their triangles' planes."""
    before, own, after = [], [], []
    for number, (vertex, bend) in enumerate(zip(chain, bends, strict=True)):
        own.append(_find_own(vertex, bend))
        last, next_ = chain[max(number - 1, 0)], chain[min(number + 1, len(chain) - 1)]
        before.append(_find_block(vertex, bend, [bend.shift_before(axis) for axis in (last.along, last.across)]))
        after.append(_find_block(vertex, bend, [bend.shift_behind(axis) for axis in (next_.along, next_.across)]))
    return Blocks(before, own, after)


def _find_own(vertex: Vertex, bend: Bend) -> Floats:
    """Return the derivatives (n, 2, 2) by the point's own position."""
    shifts = [-bend.shift_before(axis) - bend.shift_behind(axis) for axis in (vertex.along, vertex.across)]
    s, t = make_frame(vertex.normal)
    lean = dot(bend.half, vertex.normal)
    turned = [lean * dot(axis, turn) for axis in (s, t) for turn in (vertex.turn_along, vertex.turn_across)]
    return _find_block(vertex, bend, shifts) - join_block(*turned)


def _find_block(vertex: Vertex, bend: Bend, shifts: Sequence[Vectors]) -> Floats:
    """Return the derivatives (n, 2, 2) of h . s and h . t where i + eta o changes by each of two shifts (n, 3)."""
    halves = [bend.shift_half(shift) for shift in shifts]
    return join_block(*(dot(half, axis) for axis in make_frame(vertex.normal) for half in halves))


def differentiate_by_light(vertex: Vertex, bend: Bend) -> Floats:
    """Return the derivatives (n, 2, 2) at the last point by where the light is: by metres at right angles to the way
    there, or by the direction, in radians, of a distant one."""
    scale = (bend.eta * np.where(bend.far > 0, bend.far, 1.0))[:, np.newaxis]
    return _find_block(vertex, bend, [scale * axis for axis in make_frame(bend.behind)])
