"""Voronoi cells: closed forms on a lattice, distances by what they are of, hashes in Python's whole numbers."""

import numpy as np
import pytest

from raytracer.textures.voronoi import LARGEST_INT, METRICS, Cells, find_point, hash_cells, measure, sum_octaves

DIMENSIONS = (1, 2, 3, 4)
COUNT = 200


def make_cells(randomness=0.0, metric="EUCLIDEAN", second=False, whole=True):
    return Cells(np.full(COUNT, randomness), np.full(COUNT, 1.5), metric, second, whole)


def place_points(dimensions):
    return np.random.default_rng(dimensions).uniform(-5.0, 5.0, (COUNT, dimensions))


@pytest.mark.parametrize("dimensions", DIMENSIONS)
def test_without_randomness_points_are_the_lattice(dimensions):
    """The nearest whole point is the rounded one; the second is a step away along the axis of the largest rest."""
    points = place_points(dimensions)
    rest = np.abs(points - np.round(points))
    distance, _, place = find_point(points, make_cells())
    np.testing.assert_array_equal(place, np.round(points))
    np.testing.assert_allclose(distance, np.linalg.norm(rest, axis=1), rtol=1e-12)
    second = find_point(points, make_cells(second=True))[0]
    square = (rest**2).sum(axis=1) - rest.max(axis=1) ** 2 + (1.0 - rest.max(axis=1)) ** 2
    np.testing.assert_allclose(second, np.sqrt(square), rtol=1e-12)


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize("whole", [True, False])
def test_a_distance_is_that_of_the_place_and_the_color_that_of_its_cell(metric, whole):
    for dimensions in DIMENSIONS:
        points = place_points(dimensions)
        nearest, second = (make_cells(0.9, metric, second, whole) for second in (False, True))
        distance, color, place = find_point(points, nearest)
        np.testing.assert_allclose(measure(place - points, nearest), distance, rtol=1e-12)
        np.testing.assert_array_equal(color, hash_cells(np.floor(place), 3, whole))
        assert (find_point(points, second)[0] >= distance).all()
        assert color.min() >= 0
        assert color.max() <= 1


def pcg(words):
    """PCG of two to four words, signed 32 bits, in Python's integers."""

    def wrap(number):
        return (number + 2**31) % 2**32 - 2**31

    v = [wrap(word * 1664525 + 1013904223) for word in words]
    for last in (False, True):
        if len(v) == 2:
            pairs = [(0, 1, None), (1, 0, None)]
        else:
            pairs = {3: [(0, 1, 2), (1, 2, 0), (2, 0, 1)], 4: [(0, 1, 3), (1, 2, 0), (2, 0, 1), (3, 1, 2)]}[len(v)]
        for to, a, b in pairs:
            v[to] = wrap(v[to] + v[a] * (1664525 if b is None else v[b]))
        if not last:
            v = [word ^ (word >> 16) for word in v]
    return [(word & LARGEST_INT) / LARGEST_INT for word in v]


@pytest.mark.parametrize("cell", [(3, -7), (-1, 0, 12), (100000, -5, 2, 9)])
def test_hashes_are_those_of_whole_numbers(cell):
    found = hash_cells(np.array([cell], dtype=float), len(cell), whole=True)[0]
    np.testing.assert_array_equal(found, pcg(cell))


def test_octaves_add_finer_cells_by_their_weight():
    """Detail 1.25 takes two octaves and a quarter of the third; normalized, by what the distance can be at most."""
    points, cells, ones = place_points(3), make_cells(0.7), np.ones(COUNT)
    octaves = [find_point(points * 2.0**k, cells) for k in range(3)]
    weights = (1.0, 0.5, 0.25 * 0.25)
    expected = sum(weight * octave[0] for weight, octave in zip(weights, octaves, strict=True))
    found = sum_octaves(points, cells, 1.25 * ones, 0.5 * ones, 2.0 * ones, normalize=False)
    np.testing.assert_allclose(found[0], expected, rtol=1e-12)
    normalized = sum_octaves(points, cells, 1.25 * ones, 0.5 * ones, 2.0 * ones, normalize=True)
    np.testing.assert_allclose(normalized[0], expected / (sum(weights) * 0.85 * np.sqrt(3)), rtol=1e-12)
    np.testing.assert_allclose(normalized[1] * sum(weights), found[1], rtol=1e-12)
    alone = sum_octaves(points, cells, 5.0 * ones, 0.0 * ones, 2.0 * ones, normalize=False)
    np.testing.assert_array_equal(alone[2], octaves[0][2])
