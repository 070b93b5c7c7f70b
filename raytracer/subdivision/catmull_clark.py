"""One refinement of polygons by the rules of Catmull and Clark, with creases and borders.

A polygon's new point is its mean F, an edge's is (a + b + F1 + F2) / 4, or (a + b) / 2 where it is sharp. A vertex v of
n edges with other ends e and polygons of middles F becomes

    smooth: (n - 2) / n v + sum(e) / n^2 + sum(F) / n^2
    crease, of two sharp edges: 3/4 v + (e1 + e2) / 8
    corner, of more, or sharp itself: v.

Sharpness is less by one from each refinement to the next; where it falls below one, rules are blended in its share.
Cycles refines three times and takes what is left of a crease for smooth; here it is followed to its end.

References
----------
E. Catmull, J. Clark, "Recursively generated B-spline surfaces on arbitrary topological meshes", 1978.
T. DeRose, M. Kass, T. Truong, "Subdivision surfaces in character animation", SIGGRAPH 1998 (creases).
OpenSubdiv, opensubdiv/sdc/crease.cpp (rules of fractional sharpness).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.subdivision.cage import INFINITE, Cage, Corners, Polygons, mean_of_polygons, sum_by, unique_pairs


@dataclass(frozen=True, eq=False)
class Level:
    """Polygons after some refinements.

    values : (v, k) at the vertices
    edge_sharpness : (e,), infinite at borders and where the surface branches; vertex_sharpness : (v,)
    """

    polygons: Polygons
    values: Floats
    edge_sharpness: Floats
    vertex_sharpness: Floats

    @cached_property
    def twins(self) -> Corners:
        """(c,) The corner whose side is a corner's, from the other polygon; -1 where the edge stays sharp for ever."""
        edges, edge = self.polygons.sides
        total = np.bincount(edge, weights=np.arange(len(edge)), minlength=len(edges)).astype(np.intp)
        return np.where(np.isinf(self.edge_sharpness[edge]), -1, total[edge] - np.arange(len(edge)))

    @cached_property
    def valence(self) -> Indices:
        """(v,) How many edges a vertex has."""
        edges, _ = self.polygons.sides
        return np.bincount(edges.ravel(), minlength=len(self.values))


def make_level(cage: Cage, values: Floats) -> Level:
    """Return a cage as the level that refinement starts from, with values (v, k)."""
    edges, _ = cage.polygons.sides
    sharpness = np.zeros(len(edges))
    both, place = unique_pairs(np.concatenate([edges, np.sort(cage.creases, axis=1)]))
    of_pair = np.full(len(both), -1)
    of_pair[place[: len(edges)]] = np.arange(len(edges))
    found = of_pair[place[len(edges) :]]
    sharpness[found[found >= 0]] = cage.crease_sharpness[found >= 0]
    of_vertex = sharpen_ends(cage, sharpness)
    of_vertex = np.where(of_vertex >= INFINITE, np.inf, of_vertex)
    sharpness = sharpen(cage.polygons, sharpness)
    if cage.keeps_corners:
        of_vertex = np.where(np.bincount(cage.polygons.vertex, minlength=cage.count) == 1, np.inf, of_vertex)
    return Level(cage.polygons, values, sharpness, of_vertex)


def sharpen_ends(cage: Cage, sharpness: Floats) -> Floats:
    """Return the sharpness (v,) of vertices, more for those of two edges alone by the lesser of these, as in Cycles.

    sharpness : (e,) of edges, without what they are as a border
    """
    if not len(cage.creases):
        return cage.vertex_sharpness
    edges, _ = cage.polygons.sides
    least = np.full(cage.count, np.inf)
    np.minimum.at(least, edges.ravel(), np.repeat(sharpness, 2))
    has_two = np.bincount(edges.ravel(), minlength=cage.count) == 2
    return np.where(has_two, np.minimum(cage.vertex_sharpness + least, INFINITE), cage.vertex_sharpness)


def sharpen(polygons: Polygons, sharpness: Floats) -> Floats:
    """Return the sharpness (e,) of edges with those infinite that are sharp for ever: of a border, of three polygons or
    more, or of two that face opposite ways."""
    edges, edge = polygons.sides
    ahead = polygons.vertex < polygons.vertex[polygons.following]
    forwards = np.bincount(edge, weights=ahead, minlength=len(edges))
    inner = (np.bincount(edge, minlength=len(edges)) == 2) & (forwards == 1)
    return np.where((sharpness >= INFINITE) | ~inner, np.inf, sharpness)


def refine(level: Level, turns: bool) -> Level:
    """Return the quadrilaterals of a level's corners, in their order.

    turns : False has each start at its corner's vertex; True, of quadrilaterals, lets their first corners lie where
        those of the whole lie, so that u and v keep their directions
    """
    polygons = level.polygons
    edges, edge = polygons.sides
    count, faces = len(level.values), len(polygons.start) - 1
    middles = mean_of_polygons(polygons, level.values[polygons.vertex])
    values = np.concatenate([move_vertices(level, middles), place_edges(level, middles), middles])
    after = count + edge
    vertex = np.stack([polygons.vertex, after, count + len(edges) + polygons.face, after[polygons.previous]], axis=1)
    if turns:
        vertex = np.take_along_axis(vertex, (np.arange(4) - np.arange(len(vertex))[:, np.newaxis]) % 4, axis=1)
    new = Polygons(vertex.ravel(), np.arange(0, vertex.size + 1, 4))
    halves = np.maximum(level.edge_sharpness - 1.0, 0.0)
    sharpness = np.zeros(len(new.sides[0]))
    pairs, _ = new.sides
    of_edge = (pairs[:, 1] >= count) & (pairs[:, 1] < count + len(edges)) & (pairs[:, 0] < count)
    sharpness[of_edge] = halves[pairs[of_edge, 1] - count]
    of_vertex = np.concatenate([np.maximum(level.vertex_sharpness - 1.0, 0.0), np.zeros(len(edges) + faces)])
    return Level(new, values, sharpen(new, sharpness), of_vertex)


def place_edges(level: Level, middles: Floats) -> Floats:
    """Return (e, k) the new points of edges; middles : (f, k) of polygons."""
    edges, edge = level.polygons.sides
    ends = level.values[edges[:, 0]] + level.values[edges[:, 1]]
    beside = sum_by(edge, middles[level.polygons.face], len(edges))
    share = np.minimum(level.edge_sharpness, 1.0)[:, np.newaxis]
    return share * (0.5 * ends) + (1.0 - share) * (0.25 * (ends + beside))


@dataclass(frozen=True, eq=False)
class Rules:
    """How vertices move: corner and crease (v,) bool, others are smooth; sharp : (e,) bool, the edges that count."""

    corner: Booleans
    crease: Booleans
    sharp: Booleans


def find_rules(level: Level, later: float) -> Rules:
    """Return the rules of vertices for what their sharpness is so many refinements `later`."""
    edges, _ = level.polygons.sides
    sharp = level.edge_sharpness > later
    found = np.bincount(edges[sharp].ravel(), minlength=len(level.values))
    corner = (level.vertex_sharpness > later) | (found > 2)
    return Rules(corner, (found == 2) & ~corner, sharp)


def move_vertices(level: Level, middles: Floats) -> Floats:
    """Return (v, k) where vertices move; middles : (f, k) of polygons."""
    now, then = find_rules(level, 0.0), find_rules(level, 1.0)
    moved = apply_rules(level, middles, now)
    fading = np.flatnonzero((now.corner != then.corner) | (now.crease != then.crease))
    if len(fading):
        share = measure_fading(level)[fading, np.newaxis]
        moved[fading] = share * moved[fading] + (1.0 - share) * apply_rules(level, middles, then)[fading]
    return moved


def measure_fading(level: Level) -> Floats:
    """Return (v,) the mean sharpness of what ceases to be sharp at each vertex: its edges, and itself."""
    edges, _ = level.polygons.sides
    ends = level.edge_sharpness[:, np.newaxis] * np.ones(2)
    of_edge, of_vertex = (ends > 0) & (ends <= 1), (level.vertex_sharpness > 0) & (level.vertex_sharpness <= 1)
    count = len(level.values)
    number = np.bincount(edges[of_edge], minlength=count) + of_vertex
    total = np.bincount(edges[of_edge], weights=ends[of_edge], minlength=count)
    return (total + np.where(of_vertex, level.vertex_sharpness, 0.0)) / np.maximum(number, 1)


def apply_rules(level: Level, middles: Floats, rules: Rules) -> Floats:
    """Return (v, k) the vertices moved by given rules."""
    polygons, values = level.polygons, level.values
    edges, _ = polygons.sides
    count = len(values)
    n = np.maximum(level.valence, 1)[:, np.newaxis].astype(np.float64)
    around = sum_by(edges[:, 0], values[edges[:, 1]], count) + sum_by(edges[:, 1], values[edges[:, 0]], count)
    around += sum_by(polygons.vertex, middles[polygons.face], count)
    moved = (n - 2.0) / n * values + around / (n * n)
    if rules.crease.any():
        moved[rules.crease] = 0.75 * values[rules.crease] + 0.125 * sum_along(level, rules)[rules.crease]
    moved[rules.corner] = values[rules.corner]
    return moved


def sum_along(level: Level, rules: Rules) -> Floats:
    """Return (v, k) the sums of the other ends of edges that count as sharp."""
    edges, _ = level.polygons.sides
    first, second = edges[rules.sharp].T
    count = len(level.values)
    return sum_by(first, level.values[second], count) + sum_by(second, level.values[first], count)


def project(level: Level) -> Floats:
    """Return (v, k) the points of the limit surface of a level of quadrilaterals.

    A smooth vertex of n edges with other ends e and opposite corners f tends to (n^2 v + 4 sum(e) + sum(f)) /
    (n (n + 5)), one of a crease to (4 v + e1 + e2) / 6.
    """
    polygons, values = level.polygons, level.values
    edges, _ = polygons.sides
    rules, count = find_rules(level, 0.0), len(values)
    n = np.maximum(level.valence, 1)[:, np.newaxis].astype(np.float64)
    ends = sum_by(edges[:, 0], values[edges[:, 1]], count) + sum_by(edges[:, 1], values[edges[:, 0]], count)
    opposite = polygons.vertex[polygons.following[polygons.following]]
    across = sum_by(polygons.vertex, values[opposite], count)
    limit = (n * n * values + 4.0 * ends + across) / (n * (n + 5.0))
    if rules.crease.any():
        limit[rules.crease] = (4.0 * values[rules.crease] + sum_along(level, rules)[rules.crease]) / 6.0
    limit[rules.corner] = values[rules.corner]
    return limit
