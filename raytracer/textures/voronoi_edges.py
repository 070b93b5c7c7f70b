"""Voronoi cells asked for their edges, and for the largest sphere around a point that none other's reaches into.

References
----------
I. Quilez, "Voronoi edges", 2012: the distance to the plane halfway between the nearest point and another.
Blender, intern/cycles/kernel/svm/voronoi.h: which cells are looked at, and what octaves do.
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.types import Floats
from raytracer.lecture import dot
from raytracer.textures.noise import MOST_DETAIL
from raytracer.textures.voronoi import Cells, list_neighbors

# Points nearer to each other than this, squared, have no edge between them.
SMALLEST_GAP = 1e-4
# What is shown where nothing is nearer.
FARTHEST_EDGE = 8.0


def _find_nearest(points: Floats, cells: Cells) -> tuple[Floats, Floats]:
    """Return the cell and the place (n, k) of the point that is nearest as the crow flies."""
    square = np.full(len(points), np.inf)
    cell, nearest = np.zeros_like(points), np.zeros_like(points)
    for other, place in list_neighbors(np.floor(points), cells):
        found = dot(place - points, place - points)
        nearer = (found < square)[:, np.newaxis]
        square = np.minimum(found, square)
        cell, nearest = np.where(nearer, other, cell), np.where(nearer, place, nearest)
    return cell, nearest


def find_edge(points: Floats, cells: Cells) -> Floats:
    """Return how far (n,) points are from the nearest edge of their cell.

    Of the plane halfway between the nearest point a and another, b: (a + b) / 2 . (b - a) / |b - a|, from the point.
    On a line the points of the own cell and of both beside it count.
    """
    if points.shape[1] == 1:
        return _find_edge_on_line(points, cells)
    _, nearest = _find_nearest(points, cells)
    least = np.full(len(points), np.inf)
    for _, place in list_neighbors(np.floor(points), cells):
        across = place - nearest
        square = dot(across, across)
        apart = square > SMALLEST_GAP
        halfway = (nearest - points + place - points) / 2.0
        distance = dot(halfway, across) / np.sqrt(np.where(apart, square, 1.0))
        least = np.where(apart, np.minimum(least, distance), least)
    return least


def _find_edge_on_line(points: Floats, cells: Cells) -> Floats:
    left, middle, right = (place for _, place in list_neighbors(np.floor(points), cells))
    return np.minimum(np.abs((middle + left) / 2.0 - points), np.abs((middle + right) / 2.0 - points))[:, 0]


def find_sphere(points: Floats, cells: Cells) -> Floats:
    """Return half (n,) the way from the nearest point to the point nearest to that."""
    cell, nearest = _find_nearest(points, cells)
    square = np.full(len(points), np.inf)
    for other, place in list_neighbors(cell, cells):
        found = dot(place - nearest, place - nearest)
        square = np.where((other == cell).all(axis=1), square, np.minimum(square, found))
    return np.sqrt(square) / 2.0


def sum_edges(
    points: Floats, cells: Cells, detail: Floats, roughness: Floats, lacunarity: Floats, normalize: bool
) -> Floats:
    """Return the distance (n,) to edges of octaves, each lacunarity times as fine; the nearest edge counts, mixed with
    the coarser ones by its octave's strength, and the last octave by detail's fraction."""
    detail = np.where(roughness == 0, 0.0, np.clip(detail, 0.0, MOST_DETAIL))
    most = 0.5 + 0.5 * cells.randomness
    largest, distance = most, np.full(len(points), FARTHEST_EDGE)
    amplitude, scale = np.ones(len(points)), np.ones(len(points))
    for octave in range(int(np.ceil(detail.max(initial=0.0))) + 1):
        share = np.clip(detail + 1.0 - octave, 0.0, 1.0)
        found = find_edge(points * scale[:, np.newaxis], cells)
        nearer = distance + (np.minimum(distance, found / scale) - distance) * amplitude
        nearer = np.where(share < 1, np.minimum(distance, nearer), nearer)
        distance = distance + (nearer - distance) * share
        largest = largest + (most / scale - largest) * amplitude * share
        amplitude, scale = amplitude * roughness, scale * lacunarity
    distance = np.where(detail == 0, find_edge(points, cells), distance)
    return distance / largest if normalize else distance
