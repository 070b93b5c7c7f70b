"""The limit surface of a cage: cubic B-splines wherever rules are regular, and ever smaller pieces around the rest.

Around a quadrilateral whose vertices have four edges each the surface is a bicubic B-spline of the 16 vertices of it
and its neighbors; across a border, or an edge that stays sharp, the missing row is 2 a - b. Other quadrilaterals are
refined, and one quarter of each stays irregular, down to `MOST_REFINEMENTS`: what is left, 2^-8 of a polygon's edge, is
bilinear between limit points. With a curvature of about one over the edge it is 2^-16 / 8 of the edge off, below a
hundredth of a pixel for polygons as large as a picture. (Where a sharp edge ends inside the surface, the limit point of
its end is not exactly known: what is taken converges with the refinements.)

References
----------
J. Stam, "Exact evaluation of Catmull-Clark subdivision surfaces at arbitrary parameter values", SIGGRAPH 1998.
M. Niessner et al., "Feature-adaptive GPU rendering of Catmull-Clark subdivision surfaces", ACM TOG 31(1), 2012.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.arrays.vectors import normalize
from raytracer.lecture import cross
from raytracer.subdivision.cage import Cage, Polygons
from raytracer.subdivision.catmull_clark import Level, find_rules, make_level, project, refine

MOST_REFINEMENTS = 7  # after the first, which makes quadrilaterals
BLOCK = 1 << 15  # points evaluated at once
# Gives the weights of control points at places, and their derivatives.
Weigh = Callable[[Floats], tuple[Floats, Floats]]


class Limit(NamedTuple):
    """The limit surface of the quadrilaterals of a cage.

    child : (nodes, 4) the nodes of the quarters of a node, -1 for those without; nodes from 0 are the quadrilaterals
    patch : (nodes,) the patch that a node is; from len(splines) on, the flat ones
    splines : (p, 16, k) control points, row after row in v; flats : (q, 4, k) corners
    """

    child: Indices
    patch: Indices
    splines: Floats
    flats: Floats


class Points(NamedTuple):
    """Points of a surface: values (n, k), and their derivatives along u and v, up to a positive factor."""

    values: Floats
    along_u: Floats
    along_v: Floats


def make_limit(cage: Cage, values: Floats) -> Limit:
    """Return the limit surface of a cage with values (v, k) at its vertices."""
    level = refine(make_level(cage, values), turns=False)
    wanted = np.arange(len(level.polygons.start) - 1)
    nodes = wanted.copy()
    count, splines, flats, patches = len(nodes), [], [], []
    children: list[tuple[Indices, Indices]] = []
    for step in range(MOST_REFINEMENTS + 1):
        regular = find_regular(level)[wanted]
        splines.append(gather_controls(level, wanted[regular]))
        patches.append(nodes[regular])
        wanted, nodes = wanted[~regular], nodes[~regular]
        if not len(wanted) or step == MOST_REFINEMENTS:
            break
        part, within = cut_out(level, wanted)
        level = refine(part, turns=True)
        wanted = (4 * within[:, np.newaxis] + np.arange(4)).ravel()
        new = count + np.arange(len(wanted))
        children.append((nodes, new.reshape(-1, 4)))
        nodes, count = new, count + len(new)
    if len(wanted):
        # Rows of corners in v, as of splines.
        flats.append(project(level)[level.polygons.vertex.reshape(-1, 4)[wanted][:, [0, 1, 3, 2]]])
    return join(count, children, [*patches, nodes], splines, flats)


def join(
    count: int,
    children: list[tuple[Indices, Indices]],
    patches: list[Indices],
    splines: list[Floats],
    flats: list[Floats],
) -> Limit:
    """Return the parts of all levels as one table; patches : the nodes of all patches, in order."""
    child = np.full((count, 4), -1)
    for parent, found in children:
        child[parent] = found
    patch = np.full(count, -1)
    numbered = np.concatenate(patches)
    patch[numbered] = np.arange(len(numbered))
    width = splines[0].shape[2]
    return Limit(child, patch, np.concatenate(splines), np.concatenate([np.zeros((0, 4, width)), *flats]))


def cut_out(level: Level, wanted: Indices) -> tuple[Level, Indices]:
    """Return the part of a level that surrounds polygons: all that touch them, and where those are in it."""
    quads = level.polygons.vertex.reshape(-1, 4)
    touched = np.zeros(len(level.values), np.bool_)
    touched[quads[wanted]] = True
    kept = np.flatnonzero(touched[quads].any(axis=1))
    vertices, vertex = np.unique(quads[kept], return_inverse=True)
    polygons = Polygons(vertex.reshape(-1).astype(np.intp), np.arange(0, 4 * len(kept) + 1, 4))
    _, edge = polygons.sides
    _, before = level.polygons.sides
    sharpness = np.zeros(len(polygons.sides[0]))
    # At the rim of the part edges have lost a polygon: they are not asked for, and keep what they were.
    sharpness[edge] = level.edge_sharpness[before.reshape(-1, 4)[kept].ravel()]
    part = Level(polygons, level.values[vertices], sharpness, level.vertex_sharpness[vertices])
    return part, np.searchsorted(kept, wanted)


def find_regular(level: Level) -> Booleans:
    """Return (f,) True for quadrilaterals that are B-splines: at each corner all edges stay as they are, and between
    those that are sharp lie as many polygons as in a grid."""
    polygons = level.polygons
    edges, edge = polygons.sides
    count = len(level.values)
    rules = find_rules(level, 0.0)
    for_ever = np.isinf(level.edge_sharpness)
    fading = (level.edge_sharpness > 0) & ~for_ever
    steady = np.bincount(edges[fading].ravel(), minlength=count) == 0
    steady &= (level.vertex_sharpness == 0) | np.isinf(level.vertex_sharpness)
    sharp = np.bincount(edges[for_ever].ravel(), minlength=count)
    inner = steady & (sharp == 0) & ~rules.corner & (level.valence == 4)
    ok = inner[polygons.vertex]
    here, before = for_ever[edge], for_ever[edge[polygons.previous]]
    corner = steady & rules.corner
    ok |= corner[polygons.vertex] & here & before
    ok |= (steady & rules.crease)[polygons.vertex] & has_two(level, here, before)
    return ok.reshape(-1, 4).all(axis=1)


def has_two(level: Level, here: Booleans, before: Booleans) -> Booleans:
    """Return (c,) True where two polygons lie between the sharp edges at a corner's vertex.

    here, before : (c,) True where the edge from a corner, and that to it, stays sharp
    """
    polygons, twins = level.polygons, level.twins
    across_before = twins[polygons.previous]  # the corner at the same vertex, counter-clockwise
    across_here = polygons.following[twins]  # and clockwise
    return (~before & here & before[across_before]) | (~here & before & here[across_here])


def gather_controls(level: Level, wanted: Indices) -> Floats:
    """Return (p, 16, k) the control points of regular quadrilaterals, row after row in v.

    Each is taken from the neighbors, or, where an edge stays sharp, carried on from the two rows inside it.
    """
    polygons, values, twins = level.polygons, level.values, level.twins
    corner = 4 * wanted[:, np.newaxis] + np.arange(4)
    vertex = polygons.vertex
    inner = values[vertex[corner]]  # (p, 4, k)
    twin = twins[corner]  # across each side, from its end to its start
    open_side = (twin < 0)[:, :, np.newaxis]
    beyond_start = values[vertex[polygons.following[polygons.following[twin]]]]
    beyond_end = values[vertex[polygons.previous[twin]]]
    opposite_start, opposite_end = inner[:, [3, 0, 1, 2]], inner[:, [2, 3, 0, 1]]
    beyond_start = np.where(open_side, 2.0 * inner - opposite_start, beyond_start)
    beyond_end = np.where(open_side, 2.0 * inner[:, [1, 2, 3, 0]] - opposite_end, beyond_end)
    diagonal = find_diagonals(level, corner, beyond_start, beyond_end)
    return arrange(inner, beyond_start, beyond_end, diagonal)


def find_diagonals(level: Level, corner: Indices, starts: Floats, ends: Floats) -> Floats:
    """Return (p, 4, k) the control points diagonally beyond each corner.

    starts, ends : (p, 4, k) those beyond the start and the end of each side
    """
    polygons, twins = level.polygons, level.twins
    twin, twin_before = twins[corner], twins[np.roll(corner, 1, axis=1)]
    # Across the side from the corner, then around its vertex to the polygon opposite.
    around = twins[polygons.following[twin]]
    across = level.values[polygons.vertex[polygons.previous[around]]]
    # Where that side is sharp, the row beyond it is 2 a - b in the column beyond the side before, and the like.
    over_here = 2.0 * np.roll(ends, 1, axis=1) - np.roll(starts, 1, axis=1)
    over_before = 2.0 * starts - ends
    beside = np.where((twin < 0)[:, :, np.newaxis], over_here, over_before)
    return np.where(((twin >= 0) & (twin_before >= 0))[:, :, np.newaxis], across, beside)


def arrange(inner: Floats, starts: Floats, ends: Floats, diagonals: Floats) -> Floats:
    """Return (p, 16, k) control points in rows of four, v by v, from those at the corners and beyond them (p, 4, k).

    Sides: 0 towards +u at v = 0, 1 towards +v at u = 1, 2 towards -u at v = 1, 3 towards -v at u = 0.
    """
    a, b, c, d = np.moveaxis(inner, 1, 0)
    corners = np.moveaxis(diagonals, 1, 0)
    start, end = np.moveaxis(starts, 1, 0), np.moveaxis(ends, 1, 0)
    rows = (
        (corners[0], start[0], end[0], corners[1]),
        (end[3], a, b, start[1]),
        (start[3], d, c, end[1]),
        (corners[3], end[2], start[2], corners[2]),
    )
    return np.stack([point for row in rows for point in row], axis=1)


def evaluate_limit(limit: Limit, quad: Indices, uv: Floats) -> Points:
    """Return the points at places (u, v) (n, 2), 0 to 1, of quadrilaterals (n,)."""
    blocks = [
        evaluate_block(limit, quad[first : first + BLOCK], uv[first : first + BLOCK])
        for first in range(0, max(len(quad), 1), BLOCK)
    ]
    return Points(*(np.concatenate(parts) for parts in zip(*blocks, strict=True)))


def evaluate_block(limit: Limit, quad: Indices, uv: Floats) -> Points:
    """Return what `evaluate_limit` does, of few points."""
    node, place = quad.copy(), uv.copy()
    while True:
        inner = np.flatnonzero(limit.child[node, 0] >= 0)
        if not len(inner):
            break
        half = place[inner] >= 0.5
        corner = np.where(half[:, 1], 3 - half[:, 0], half[:, 0])  # 0 1 / 3 2
        node[inner] = limit.child[node[inner], corner]
        place[inner] = 2.0 * place[inner] - half
    patch, width = limit.patch[node], limit.splines.shape[2]
    found = Points(*(np.empty((len(quad), width)) for _ in range(3)))
    smooth = patch < len(limit.splines)
    for rows, evaluate, controls in (
        (np.flatnonzero(smooth), weigh_cubic, limit.splines),
        (np.flatnonzero(~smooth), weigh_linear, limit.flats),
    ):
        if len(rows):
            chosen = controls[patch[rows] - (0 if evaluate is weigh_cubic else len(limit.splines))]
            for target, values in zip(found, evaluate_patches(chosen, place[rows], evaluate), strict=True):
                target[rows] = values
    return found


def evaluate_patches(controls: Floats, place: Floats, weigh: Weigh) -> Points:
    """Return the points of patches of controls (n, m * m, k) at (u, v) (n, 2); sums have one order."""
    (of_u, slope_u), (of_v, slope_v) = weigh(place[:, 0]), weigh(place[:, 1])
    found = Points(*(np.zeros((len(place), controls.shape[2])) for _ in range(3)))
    for row in range(len(of_v)):
        for column in range(len(of_u)):
            control = controls[:, len(of_u) * row + column]
            for target, weight in zip(
                found,
                (of_u[column] * of_v[row], slope_u[column] * of_v[row], of_u[column] * slope_v[row]),
                strict=True,
            ):
                target += weight[:, np.newaxis] * control
    return found


def weigh_cubic(t: Floats) -> tuple[Floats, Floats]:
    """Return the weights (4, n) of the uniform cubic B-spline at t (n,), and their derivatives."""
    s = 1.0 - t
    weights = (s**3, 3.0 * t**3 - 6.0 * t * t + 4.0, 3.0 * s**3 - 6.0 * s * s + 4.0, t**3)
    slopes = (-s * s, 3.0 * t * t - 4.0 * t, -3.0 * s * s + 4.0 * s, t * t)
    return np.stack(weights) / 6.0, 0.5 * np.stack(slopes)


def weigh_linear(t: Floats) -> tuple[Floats, Floats]:
    """Return the weights (2, n) of what is linear between 0 and 1, and their derivatives."""
    return np.stack([1.0 - t, t]), np.stack([-np.ones_like(t), np.ones_like(t)])


def find_normals(along_u: Floats, along_v: Floats) -> Floats:
    """Return unit normals (n, 3) of derivatives (n, 3); (0, 0, 1), as in Cycles, where these have no plane."""
    normals = normalize(cross(along_u, along_v))
    return np.where(normals.any(axis=1)[:, np.newaxis], normals, np.array([0.0, 0.0, 1.0]))
