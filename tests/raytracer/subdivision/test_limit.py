"""The limit surface: against refinement of everything, against splines in closed form, and its derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from raytracer.subdivision.cage import number_quads
from raytracer.subdivision.catmull_clark import make_level, project, refine
from raytracer.subdivision.limit import evaluate_limit, find_normals, make_limit
from tests.raytracer.subdivision.shapes import CAGES, CUBE, CUBE_FACES, make_cage, make_grid

REFINEMENTS = 4
# The rounding of sums of sixteen products, refinement after refinement.
ROUNDING = 1e-13


def refine_all(cage, values):
    """Brute force: the whole cage refined, and the limit points at the corners of all quadrilaterals by place.

    Returns places (p, 2) of each quadrilateral, and their points (q, p, k).
    """
    level = refine(make_level(cage, values), turns=False)
    offset, size = np.zeros((1, 2)), 1.0
    for _ in range(REFINEMENTS - 1):
        level = refine(level, turns=True)
        size *= 0.5
        quarters = size * np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
        offset = (offset[:, np.newaxis] + quarters).reshape(-1, 2)
    corners = size * np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    places = (offset[:, np.newaxis] + corners).reshape(-1, 2)
    points = project(level)[level.polygons.vertex]
    return places, points.reshape(-1, len(places), values.shape[1])


@pytest.mark.parametrize("name", CAGES)
def test_points_of_the_limit_are_those_of_refining_everything(name):
    cage, values = CAGES[name]
    places, expected = refine_all(cage, values)
    quads, count = expected.shape[:2]
    found = evaluate_limit(make_limit(cage, values), np.repeat(np.arange(quads), count), np.tile(places, (quads, 1)))
    np.testing.assert_allclose(found.values.reshape(expected.shape), expected, atol=ROUNDING)


def test_a_regular_grid_is_a_cubic_spline():
    """Control points z = x^2 at whole numbers make z = x^2 + 1/3, and straight lines stay what they are."""
    faces, places = make_grid(5, 5)
    values = places + np.stack([0 * places[:, 0], 0 * places[:, 0], places[:, 0] ** 2], axis=1)
    quad = np.repeat(np.arange(4 * 12, 4 * 13), 50)  # of the cell in the middle
    uv = np.random.default_rng(0).random((len(quad), 2))
    found = evaluate_limit(make_limit(make_cage(faces, len(places)), values), quad, uv)
    x, y, z = found.values.T
    np.testing.assert_allclose(z, x * x + 1 / 3, atol=ROUNDING)
    assert ((x > 2) & (x < 3) & (y > 2) & (y < 3)).all()
    slope = np.stack([-2 * x, 0 * x, 1 + 0 * x], axis=1)
    expected = slope / np.linalg.norm(slope, axis=1, keepdims=True)
    np.testing.assert_allclose(find_normals(found.along_u, found.along_v), expected, atol=ROUNDING)


def test_a_flat_border_is_kept():
    """The border of a flat grid stays in its lines, but for its corners, which become round unless they are kept."""
    faces, places = make_grid(2, 2)
    quad, uv = np.zeros(9, np.intp), np.stack([np.linspace(0, 1, 9), np.zeros(9)], axis=1)  # from (0, 0) to (0.5, 0)
    kept = evaluate_limit(make_limit(make_cage(faces, 9, keeps_corners=True), places), quad, uv).values
    round_ = evaluate_limit(make_limit(make_cage(faces, 9), places), quad, uv).values
    np.testing.assert_allclose(kept[:, 1], 0.0, atol=ROUNDING)
    np.testing.assert_allclose(kept[0], 0.0, atol=ROUNDING)
    np.testing.assert_allclose(round_[0], (1 / 6, 1 / 6, 0), atol=ROUNDING)


@pytest.mark.parametrize("name", CAGES)
def test_derivatives_are_those_of_points(name):
    cage, values = CAGES[name]
    limit = make_limit(cage, values)
    generator = np.random.default_rng(1)
    quad = generator.integers(0, len(number_quads(cage)[0]), 300)
    uv = 0.05 + 0.9 * generator.random((300, 2))
    step = 2.0**-20
    found = evaluate_limit(limit, quad, uv)
    for axis, slopes in enumerate((found.along_u, found.along_v)):
        ahead, behind = uv.copy(), uv.copy()
        ahead[:, axis] += step
        behind[:, axis] -= step
        change = evaluate_limit(limit, quad, ahead).values - evaluate_limit(limit, quad, behind).values
        along = change / np.linalg.norm(change, axis=1, keepdims=True)
        # Central differences: rounding over the step, and the step's square.
        np.testing.assert_allclose(slopes / np.linalg.norm(slopes, axis=1, keepdims=True), along, atol=1e-6)


def test_a_cube_becomes_what_it_must():
    """The middle of a face of a cube: by hand, from the weights of a vertex of four edges after one refinement."""
    cage = make_cage(CUBE_FACES, 8)
    found = evaluate_limit(make_limit(cage, CUBE), np.arange(24), np.ones((24, 2))).values
    # Face point 1, edge points 3/4 (two) of the face, vertex points 5/9: (16 * 1 + 4 * 4 * 3/4 + 4 * 5/9) / 36.
    np.testing.assert_allclose(np.abs(found).max(axis=1), (16 + 12 + 20 / 9) / 36, atol=ROUNDING)


@pytest.mark.parametrize(("sharpness", "expected"), [(1.0, 0.75), (2.0, 0.875)])
def test_a_crease_lasts_as_many_refinements_as_it_is_sharp(sharpness, expected):
    """A cube whose edges are all sharp stays a cube for so long; then its corner v, of the edges' next points e and the
    opposite ones f, tends to (9 v + 4 sum(e) + sum(f)) / 24: 18 / 24 and 21 / 24."""
    edges = [(0, 1), (1, 3), (3, 2), (2, 0), (4, 5), (5, 7), (7, 6), (6, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
    cage = make_cage(CUBE_FACES, 8, [(*edge, sharpness) for edge in edges])
    found = evaluate_limit(make_limit(cage, CUBE), np.arange(24), np.zeros((24, 2))).values
    np.testing.assert_allclose(np.abs(found), expected, atol=ROUNDING)
