"""Cages for the tests of subdivision: closed, with borders, with polygons of many corners, with creases."""

from __future__ import annotations

import numpy as np

from raytracer.subdivision.cage import Cage, Polygons

CUBE = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
CUBE_FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def make_cage(faces, count, creases=(), keeps_corners=False, corners=()):
    """creases : (first, second, sharpness) of edges; corners : (vertex, sharpness)."""
    start = np.cumsum([0, *map(len, faces)])
    vertex = np.array([corner for face in faces for corner in face])
    edges = np.array([each[:2] for each in creases], dtype=np.intp).reshape(-1, 2)
    of_vertex = np.zeros(count)
    for number, sharpness in corners:
        of_vertex[number] = sharpness
    return Cage(
        Polygons(vertex, start),
        count,
        edges,
        np.array([each[2] for each in creases], dtype=float),
        of_vertex,
        keeps_corners,
    )


def make_grid(columns, rows):
    """Quadrilaterals over (0, 0) to (columns, rows), and the places (v, 3) of their vertices, z = 0."""
    x, y = np.meshgrid(np.arange(columns + 1.0), np.arange(rows + 1.0))
    places = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    first = np.add.outer(np.arange(rows) * (columns + 1), np.arange(columns)).ravel()
    return [(k, k + 1, k + columns + 2, k + columns + 1) for k in first.tolist()], places


def make_prism(sides=5):
    """A prism: two polygons of many corners, and quadrilaterals around."""
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], axis=1)
    places = np.concatenate([ring, ring + np.array([0.1, 0.0, 1.5])])
    around = [(k, (k + 1) % sides, (k + 1) % sides + sides, k + sides) for k in range(sides)]
    return [tuple(range(sides))[::-1], tuple(range(sides, 2 * sides)), *around], places


GRID_FACES, GRID = make_grid(3, 2)
WAVY = GRID + np.stack([0 * GRID[:, 0], 0 * GRID[:, 0], np.sin(1.7 * np.arange(len(GRID)))], axis=1)
PRISM_FACES, PRISM = make_prism()
CAGES = {
    "cube": (make_cage(CUBE_FACES, 8), CUBE),
    "open cube": (make_cage(CUBE_FACES[:5], 8), CUBE),
    "prism": (make_cage(PRISM_FACES, len(PRISM)), PRISM),
    "wavy grid": (make_cage(GRID_FACES, len(GRID)), WAVY),
    "wavy grid that keeps its corners": (make_cage(GRID_FACES, len(GRID), keeps_corners=True), WAVY),
    "cube with a sharp face": (make_cage(CUBE_FACES, 8, [(0, 1, 10), (1, 3, 10), (3, 2, 10), (2, 0, 10)]), CUBE),
    "cube with fading creases": (make_cage(CUBE_FACES, 8, [(0, 1, 0.4), (1, 3, 1.7), (3, 2, 2.5), (4, 6, 2.2)]), CUBE),
    "prism with sharp vertices": (make_cage(PRISM_FACES, len(PRISM), corners=[(0, 10), (6, 1.3)]), PRISM),
    "three faces at an edge": (
        make_cage([(0, 1, 2, 3), (1, 0, 4, 5), (0, 1, 6, 7)], 8),
        np.array([(0, 0, 0), (0, 1, 0), (1, 1, 0), (1, 0, 0), (-1, 0, 1), (-1, 1, 0), (-1, 1, -1), (-1, 0, -1.0)]),
    ),
    "faces that look opposite ways": (
        make_cage([(0, 1, 4, 3), (1, 4, 5, 2)], 6),
        np.array([(0, 0, 0), (1, 0, 0.5), (2, 0, 0), (0, 1, 0), (1, 1, 0.2), (2, 1, 0.1)]),
    ),
}
