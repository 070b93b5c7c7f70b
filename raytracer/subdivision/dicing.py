"""Dicing: triangles cut in halves until no edge is too long, without cracks.

All start from the two halves of each quadrilateral. In each round every edge that is too long gets a vertex in its
middle (of u and v), and triangles with one, two or three such edges become two, three or four. Whether an edge is too
long depends on its two ends alone, and its middle is one vertex for all triangles beside it: so none leaves a gap.

Cycles dices by DiagSplit: it finds for each edge of a patch how many equal parts it needs, splits patches whose edges
are uneven, fills them with grids, and stitches these to the edges. Its vertices lie elsewhere on the same surface, and
its diagonals may be longer than what was asked. Both surfaces are that of the limit, sampled at least as finely as
asked: colors agree in tiles, and depths, positions and normals to what changes between vertices a pixel apart. Where a
displacement is smooth, edges half as long bring points 2.6 times closer.

References
----------
M. Fisher et al., "DiagSplit: parallel, crack-free, adaptive tessellation for micropolygon rendering", ACM TOG 28(5),
2009. Blender, intern/cycles/subd/split.cpp and dice.cpp.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.subdivision.cage import unique_pairs

# Where points of quadrilaterals (n,), (n, 2) lie, (n, 3); and whether edges between points (n, 3) are too long.
Place = Callable[[Indices, Floats], Floats]
IsLong = Callable[[Floats, Floats], Booleans]

# The triangles of one with corners 0 to 2 and middles 3, 4, 5 of its sides 0-1, 1-2, 2-0.
HALVES = ((0, 3, 2), (3, 1, 2))
THIRDS = ((3, 1, 4), (0, 3, 4), (0, 4, 2)), ((3, 1, 4), (3, 4, 2), (0, 3, 2))  # by the diagonal 0-4, by 3-2
QUARTERS = ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5))


class Dice(NamedTuple):
    """Triangles on quadrilaterals.

    triangles : (t, 3) vertices; quad : (t,) of each; uv : (t, 3, 2) of their corners
    positions : (v, 3); vertex_quad : (v,) and vertex_uv : (v, 2), a place of each vertex
    """

    triangles: Indices
    quad: Indices
    uv: Floats
    positions: Floats
    vertex_quad: Indices
    vertex_uv: Floats


def dice(quads: Indices, place: Place, is_long: IsLong, rounds: int, most: int) -> Dice | None:
    """Return quadrilaterals (q, 4), given by their vertices, diced; None where that takes more than `most` triangles.

    rounds : no edge of a quadrilateral is halved more often
    """
    active = make_halves(quads, place)
    done = [active._replace(triangles=active.triangles[:0], quad=active.quad[:0], uv=active.uv[:0])]
    for _ in range(rounds):
        still, active = split(active, place, is_long)
        done.append(still)
        if sum(len(each.quad) for each in done) + len(active.quad) > most:
            return None
        if not len(active.quad):
            break
    return active._replace(
        triangles=np.concatenate([each.triangles for each in (*done, active)]),
        quad=np.concatenate([each.quad for each in (*done, active)]),
        uv=np.concatenate([each.uv for each in (*done, active)]),
    )


def make_halves(quads: Indices, place: Place) -> Dice:
    """Return the two halves of each quadrilateral, along the shorter diagonal."""
    _, first, vertex = np.unique(quads, return_index=True, return_inverse=True)
    vertex = vertex.reshape(-1, 4)
    corners = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    vertex_quad, vertex_uv = first // 4, corners[first % 4]
    positions = place(vertex_quad, vertex_uv)
    a, b, c, d = (positions[vertex[:, corner]] for corner in range(4))
    is_other = measure_squares(b, d) < measure_squares(a, c)
    cut = np.where(is_other[:, np.newaxis, np.newaxis], ((0, 1, 3), (1, 2, 3)), ((0, 1, 2), (0, 2, 3)))
    triangles = np.take_along_axis(vertex[:, np.newaxis], cut, axis=2).reshape(-1, 3)
    uv = corners[cut].reshape(-1, 3, 2)
    return Dice(triangles, np.repeat(np.arange(len(quads)), 2), uv, positions, vertex_quad, vertex_uv)


def measure_squares(one: Floats, other: Floats) -> Floats:
    """Return the squared distances (n,) of points (n, 3)."""
    x, y, z = (one - other).T
    return x * x + y * y + z * z


def split(active: Dice, place: Place, is_long: IsLong) -> tuple[Dice, Dice]:
    """Return the triangles without an edge that is too long, and what the others are split into; vertices are all."""
    ends = np.stack([active.triangles, np.roll(active.triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    edges, side = unique_pairs(np.sort(ends, axis=1))
    long = is_long(active.positions[edges[:, 0]], active.positions[edges[:, 1]])
    count = len(active.positions)
    middle = np.where(long, count + np.cumsum(long) - 1, -1)
    whole = add_middles(active, np.flatnonzero(long), side, place)
    middles = middle[side].reshape(-1, 3)
    number = (middles >= 0).sum(axis=1)
    still = take(whole, np.flatnonzero(number == 0))
    parts = [cut_triangles(whole, np.flatnonzero(number == sides), middles, sides) for sides in (1, 2, 3)]
    return still, whole._replace(
        triangles=np.concatenate([part.triangles for part in parts]),
        quad=np.concatenate([part.quad for part in parts]),
        uv=np.concatenate([part.uv for part in parts]),
    )


def add_middles(active: Dice, long: Indices, side: Indices, place: Place) -> Dice:
    """Return the triangles with the middles of edges as further vertices.

    long : the edges; side : (3 t,) the edge that each side of the triangles is
    """
    first = np.zeros(int(side.max(initial=-1)) + 1, np.intp)
    first[side[::-1]] = np.arange(len(side))[::-1]  # the first side that is each edge
    triangle, corner = np.divmod(first[long], 3)
    quad = active.quad[triangle]
    uv = 0.5 * (active.uv[triangle, corner] + active.uv[triangle, (corner + 1) % 3])
    return active._replace(
        positions=np.concatenate([active.positions, place(quad, uv)]),
        vertex_quad=np.concatenate([active.vertex_quad, quad]),
        vertex_uv=np.concatenate([active.vertex_uv, uv]),
    )


def take(found: Dice, rows: Indices) -> Dice:
    """Return some of the triangles."""
    return found._replace(triangles=found.triangles[rows], quad=found.quad[rows], uv=found.uv[rows])


def cut_triangles(whole: Dice, rows: Indices, middles: Indices, sides: int) -> Dice:
    """Return what triangles become of which so many sides are split.

    middles : (t, 3) the vertices in the middles of sides, -1 where they stay
    """
    is_split = middles[rows] >= 0
    # Turned so that the sides that are split come first.
    start = np.argmax(is_split & ~np.roll(is_split, 1, axis=1), axis=1)
    order = (start[:, np.newaxis] + np.arange(3)) % 3
    vertex = np.take_along_axis(whole.triangles[rows], order, axis=1)
    uv = np.take_along_axis(whole.uv[rows], order[:, :, np.newaxis], axis=1)
    points = np.concatenate([vertex, np.take_along_axis(middles[rows], order, axis=1)], axis=1)  # (n, 6)
    places = np.concatenate([uv, 0.5 * (uv + np.roll(uv, -1, axis=1))], axis=1)  # (n, 6, 2)
    cut = choose_cut(whole.positions, points, sides)
    triangles = np.take_along_axis(points[:, np.newaxis], cut, axis=2).reshape(-1, 3)
    of_corners = places[np.arange(len(rows))[:, np.newaxis, np.newaxis], cut].reshape(-1, 3, 2)
    return whole._replace(triangles=triangles, quad=np.repeat(whole.quad[rows], cut.shape[1]), uv=of_corners)


def choose_cut(positions: Floats, points: Indices, sides: int) -> Indices:
    """Return (n, parts, 3) how triangles are cut: of two diagonals the shorter."""
    count = len(points)
    if sides != 2:
        pattern = np.array(HALVES if sides == 1 else QUARTERS)
        return np.broadcast_to(pattern, (count, *pattern.shape))
    one = measure_squares(positions[points[:, 0]], positions[points[:, 4]])
    other = measure_squares(positions[points[:, 3]], positions[points[:, 2]])
    return np.array(THIRDS)[(one > other).astype(np.intp)]
