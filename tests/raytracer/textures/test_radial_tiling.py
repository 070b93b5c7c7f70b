"""Radial tiling: the polygons against their geometry, straight sides and arcs, and coordinates that fit together."""

import numpy as np
import pytest

from raytracer.textures.radial_tiling import tile_radially

SIDES = [2.0, 2.4, 2.9, 3.0, 4.0, 5.7, 7.01]
ROUNDNESS = [0.0, 0.3, 0.8, 1.0]
# Coordinates are of some tens of operations on numbers of about 1.
ROUNDING = 1e-11


def go_round(count, radius=1.0):
    angle = (np.arange(count) + 0.5) / count * 2 * np.pi
    return radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)


def tile(points, sides, roundness, normalize=False):
    return tile_radially(points, np.asarray(sides), np.asarray(roundness), normalize=normalize)


def find_polygon(sides, roundness, count=4096):
    """Points of the polygon of size 1, in order around it."""
    points = go_round(count)
    size = tile(points, sides, roundness, normalize=True).coordinates[:, 1]
    return points[size > 0.05] / size[size > 0.05, np.newaxis]


@pytest.mark.parametrize("roundness", ROUNDNESS)
@pytest.mark.parametrize("sides", SIDES)
def test_scaled_copies_have_their_size(sides, roundness):
    points, scale = go_round(500), np.linspace(0.1, 7.0, 500)[:, np.newaxis]
    one, many = (tile(part, sides, roundness, True) for part in (points, scale * points))
    np.testing.assert_allclose(many.coordinates[:, 1], one.coordinates[:, 1] * scale[:, 0], rtol=ROUNDING)
    for name in ("number", "width", "rotation"):
        np.testing.assert_array_equal(getattr(many, name), getattr(one, name))


@pytest.mark.parametrize("sides", [3, 4, 7])
def test_a_regular_polygon_has_sides_at_one_and_round_corners(sides):
    """Its arcs have the radius r around points at (1 - r) / cos(pi / n) below the corners."""
    for roundness in (0.0, 0.3, 1.0):
        x, y, _ = find_polygon(sides, roundness).T
        middle = 2 * np.pi * (np.round(np.arctan2(y, x) * sides / (2 * np.pi) - 0.5) + 0.5) / sides
        corner = 2 * np.pi * np.round(np.arctan2(y, x) * sides / (2 * np.pi)) / sides
        side = np.cos(middle) * x + np.sin(middle) * y
        away = (1 - roundness) / np.cos(np.pi / sides)
        arc = np.hypot(x - away * np.cos(corner), y - away * np.sin(corner))
        on_side, on_arc = np.abs(side - 1) < ROUNDING, np.abs(arc - roundness) < ROUNDING
        assert (on_side | on_arc).all()
        assert on_side.any() == (roundness < 1)
        assert on_arc.any() == (roundness > 0)


@pytest.mark.parametrize("roundness", [0.3, 0.8, 1.0])
@pytest.mark.parametrize("sides", [2.4, 2.9, 5.7, 7.01])
def test_a_narrow_segment_is_joined_without_bends(sides, roundness):
    """Along the outline, the direction turns by no more than the arcs' curvature lets it."""
    points = find_polygon(sides, roundness, 20_000)[:, :2]
    steps = np.roll(points, -1, axis=0) - points
    length = np.hypot(*steps.T)
    turned = np.arcsin((steps[:, 0] * np.roll(steps[:, 1], -1) - steps[:, 1] * np.roll(steps[:, 0], -1))
                       / (length * np.roll(length, -1)))  # fmt: skip
    assert turned.sum() == pytest.approx(2 * np.pi, abs=1e-6)
    assert np.abs(turned).max() < 0.1  # a corner turns by 2 pi / n at once
    assert turned.min() > -1e-6


@pytest.mark.parametrize("roundness", ROUNDNESS)
@pytest.mark.parametrize("sides", SIDES[2:])
def test_normalized_coordinates_go_from_0_to_1_across_each_segment(sides, roundness):
    """Rising all the way, with the middle of the side at 1/2, on the polygon and on a copy of half its size."""
    for radius in (1.0, 0.5):
        found = tile(radius * find_polygon(sides, roundness, 20_000), sides, roundness, normalize=True)
        across, segment = found.coordinates[:, 0], found.number
        rising = np.diff(across)[np.diff(segment) == 0]
        assert rising.min() > 0
        assert across.min() == pytest.approx(0.0, abs=2e-2)
        assert across.max() == pytest.approx(1.0, abs=2e-2)
        assert set(segment) == set(range(int(np.ceil(sides))))


@pytest.mark.parametrize("sides", [2.0, 3.0, 4.5])
def test_lengths_are_measured_along_straight_sides(sides):
    """Without rounding (p, L) is the point turned so that its side lies above the origin, less 1."""
    points = go_round(300, 1.7)
    found = tile(points, sides, 0.0)
    own = np.stack([np.cos(found.rotation), np.sin(found.rotation)], axis=1)
    last = found.number == np.floor(sides)  # narrow: its side is as far as the corners let it
    narrow = np.where(last, np.cos(np.pi / sides) / np.cos(np.pi - np.floor(sides) * np.pi / sides), 1.0)
    up, along = (points[:, :2] * own).sum(axis=1), points[:, 1] * own[:, 0] - points[:, 0] * own[:, 1]
    np.testing.assert_allclose(found.coordinates[:, 1], up * narrow - 1.0, atol=ROUNDING)
    np.testing.assert_allclose(found.coordinates[:, 0], along * narrow, atol=ROUNDING)


@pytest.mark.parametrize("normalize", [True, False])
def test_numbers_are_finite_everywhere(normalize):
    points = np.array([(0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, -1, 0), (1, -1e-300, 0), (1e30, 1e-30, 5)], dtype=float)
    for sides in (-1.0, 2.0, 2.5, 6.0):
        for roundness in (-1.0, 0.0, 0.5, 1.0, 2.0):
            assert all(np.isfinite(part).all() for part in tile(points, sides, roundness, normalize))
