"""Maps of UV as surfaces of their own: cut where the map is, with borders that stay straight or become round.

References
----------
OpenSubdiv, opensubdiv/sdc/options.h (FVarLinearInterpolation) and vtr/fvarLevel.cpp; Blender, cycles/subd/osd.cpp.
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.subdivision.cage import Cage, Polygons

# How borders of a map follow: "none" has all of it linear, "corners" keeps vertices of one polygon, "junctions" those
# of three pieces or more as well, "concave" those where another piece has a corner or a cut ends, "boundaries" whole
# borders, and "all" is smooth everywhere.
RULES = ("none", "corners", "junctions", "concave", "boundaries", "all")


def make_map_cage(cage: Cage, at_corners: Floats, rule: str) -> tuple[Cage, Floats]:
    """Return a map as a cage, and its values (n, 2) at the vertices there.

    at_corners : (c, 2) at the corners of the cage's polygons; those of one vertex that are equal are one
    """
    polygons = cage.polygons
    rows = np.column_stack([polygons.vertex, at_corners])
    found, first, vertex = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    of_map = Polygons(vertex.reshape(-1).astype(np.intp), polygons.start)
    base = polygons.vertex[first]
    sharpness = cage.vertex_sharpness[base]
    sharpness = np.where(find_sharp(of_map, polygons, base, rule), np.inf, sharpness)
    creases, crease_sharpness = split_creases(cage, of_map)
    return Cage(of_map, len(found), creases, crease_sharpness, sharpness), found[:, 1:]


def find_sharp(of_map: Polygons, polygons: Polygons, base: Indices, rule: str) -> Booleans:
    """Return (n,) True for vertices of a map that stay where they are.

    of_map, polygons : of the map and of the mesh; base : (n,) the vertex of the mesh of each of the map
    """
    count = len(base)
    if rule == "boundaries":
        return find_border(of_map, count)
    if rule == "all":
        return np.zeros(count, np.bool_)
    sharp = np.bincount(of_map.vertex, minlength=count) == 1
    pieces = np.bincount(base)
    if rule in ("junctions", "concave"):
        sharp |= pieces[base] > 2
    if rule == "concave":
        sharp |= np.bincount(base, weights=sharp)[base] > 0
        # Where a cut ends.
        sharp |= find_border(of_map, count) & (pieces[base] == 1) & ~find_border(polygons, len(pieces))[base]
    return sharp


def find_border(polygons: Polygons, count: int) -> Booleans:
    """Return (count,) True for vertices of edges that do not have two polygons."""
    edges, edge = polygons.sides
    border = np.bincount(edge, minlength=len(edges)) != 2
    return np.bincount(edges[border].ravel(), minlength=count) > 0


def split_creases(cage: Cage, of_map: Polygons) -> tuple[Indices, Floats]:
    """Return the creases of a cage between the vertices of its map."""
    edges, edge = cage.polygons.sides
    factor = cage.count + 1
    sharpness = np.zeros(len(edges))
    wanted = np.sort(cage.creases, axis=1)
    keys = edges[:, 0] * factor + edges[:, 1]
    place = np.searchsorted(keys, wanted[:, 0] * factor + wanted[:, 1])
    known = (place < len(keys)) & (keys[np.minimum(place, len(keys) - 1)] == wanted[:, 0] * factor + wanted[:, 1])
    sharpness[place[known]] = cage.crease_sharpness[known]
    pairs, side = of_map.sides
    of_pair = np.zeros(len(pairs))
    of_pair[side] = sharpness[edge]
    creased = of_pair > 0
    return pairs[creased], of_pair[creased]
