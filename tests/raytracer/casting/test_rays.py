"""Rays and hits: what users may pass, what is refused and how, which rays are valid."""

import numpy as np
import pytest

from raytracer.casting.caster import build
from raytracer.casting.rays import Hits, make_rays
from raytracer.scene.scene import Scene

NAN, INF = np.nan, np.inf


@pytest.mark.parametrize(
    ("origins", "directions", "count"),
    [
        ((0, 0, 0), (0, 0, 1), 1),
        (np.zeros((4, 3)), (0, 0, 1), 4),
        ((0, 0, 0), np.ones((4, 3)), 4),
        (np.zeros((1, 3)), np.ones((4, 3)), 4),
        (np.zeros((4, 3)), np.ones((4, 3)), 4),
        (np.zeros((0, 3)), np.ones((0, 3)), 0),
        (np.zeros((0, 3)), (0, 0, 1), 0),
    ],
)
def test_make_rays_broadcasts_single_vectors(origins, directions, count):
    rays = make_rays(origins, directions)
    assert len(rays) == count
    for array, source in ((rays.origins, origins), (rays.directions, directions)):
        np.testing.assert_array_equal(array, np.broadcast_to(np.float64(source), (count, 3)), strict=True)
        assert array.flags.c_contiguous
    np.testing.assert_array_equal(rays.t_min, np.zeros(count), strict=True)
    np.testing.assert_array_equal(rays.t_max, np.full(count, INF), strict=True)


@pytest.mark.parametrize("value", [2, 2.0, [2], (2, 2, 2), np.float32(2), np.full(3, 2, dtype=np.int16)])
def test_make_rays_takes_a_range_for_all_rays_or_one_for_each(value):
    rays = make_rays(np.zeros((3, 3)), (0, 0, 1), value, value)
    np.testing.assert_array_equal(rays.t_min, np.full(3, 2.0), strict=True)
    np.testing.assert_array_equal(rays.t_max, np.full(3, 2.0), strict=True)


@pytest.mark.parametrize("dtype", [np.float32, np.int64, np.bool_])
def test_make_rays_converts_to_float64_without_change(dtype):
    origins = np.array([(1, 0, 1)], dtype=dtype)
    np.testing.assert_array_equal(make_rays(origins, origins).origins, [(1.0, 0.0, 1.0)], strict=True)


class Column:
    """What hands out its own array, as a column of a table (pandas) does."""

    def __init__(self, values):
        self.values = values

    def __array__(self, dtype=None, copy=None):
        return self.values


def test_make_rays_leaves_the_callers_arrays_writeable():
    origins, distances = np.zeros((2, 3)), np.ones(2)
    make_rays(origins, Column(origins), 0.0, Column(distances))
    assert origins.flags.writeable
    assert distances.flags.writeable


def test_make_rays_takes_an_empty_list_for_no_rays():
    assert make_rays([], (0, 0, 1)).origins.shape == make_rays([], []).directions.shape == (0, 3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((0, 0), (0, 0, 1)), r"origins: expected shape \(n, 3\) float64, got \(1, 2\)"),
        (((0, 0, 0), np.ones((2, 2, 3))), r"directions: expected shape \(n, 3\) float64, got \(2, 2, 3\)"),
        ((np.zeros((2, 3)), np.ones((3, 3))), r"directions: expected as many rows as origins, 2, got 3"),
        ((np.zeros((0, 3)), np.ones((3, 3))), r"directions: expected as many rows as origins, 0, got 3"),
        (([(0, 0, 0), (1, 2)], (0, 0, 1)), r"origins: expected an array \(n, 3\) float64, got list"),
        ((("a", "b", "c"), (0, 0, 1)), r"origins: expected an array \(n, 3\) float64, got <U1"),
        (((0, 0, 1j), (0, 0, 1)), r"origins: expected an array \(n, 3\) float64, got complex128"),
        ((np.zeros((3, 3)), (0, 0, 1), (1, 2)), r"t_min: expected a number or an array \(3,\), got shape \(2,\)"),
        ((np.zeros((3, 3)), (0, 0, 1), 0, np.zeros((3, 1))), r"t_max: expected shape \(n,\) float64, got \(3, 1\)"),
        ((np.zeros((3, 3)), (0, 0, 1), 0, "far"), r"t_max: expected an array \(\) float64, got str"),
    ],
)
def test_make_rays_refuses_in_one_sentence(arguments, message):
    with pytest.raises(ValueError, match=f"^{message}$"):
        make_rays(*arguments)


@pytest.mark.parametrize(
    ("origin", "direction", "t_min", "t_max", "valid"),
    [
        ((0, 0, 0), (0, 0, 1), 0, INF, True),
        ((0, 0, 0), (0, 0, 5e-324), 0, INF, True),
        ((1e308, 0, 0), (-1e308, 0, 0), -INF, INF, True),
        ((0, 0, 0), (0, 0, 1), 5, 1, True),  # an empty range is a miss, not an invalid ray
        ((0, 0, 0), (0, -0.0, 0), 0, INF, False),
        ((NAN, 0, 0), (0, 0, 1), 0, INF, False),
        ((0, INF, 0), (0, 0, 1), 0, INF, False),
        ((0, 0, 0), (0, NAN, 1), 0, INF, False),
        ((0, 0, 0), (-INF, 0, 1), 0, INF, False),
        ((0, 0, 0), (0, 0, 1), NAN, INF, False),
        ((0, 0, 0), (0, 0, 1), 0, NAN, False),
    ],
)
def test_rays_are_valid_when_finite_with_a_direction(origin, direction, t_min, t_max, valid):
    assert make_rays(origin, direction, t_min, t_max).valid().tolist() == [valid]


def test_hits_of_other_rays_are_none_to_go_on_behind():
    caster = build(Scene())
    hits = caster.closest_hit(np.zeros((3, 3)), (0, 0, 1))
    for after, got in ((hits, "of 3"), (hits.select(slice(1)), "of 1"), ("hits", "str")):
        with pytest.raises(ValueError, match=f"^after: expected the Hits of these 2 rays, got {got}$"):
            caster.closest_hit(np.zeros((2, 3)), (0, 0, 1), after=after)


def test_hits_tell_hits_from_misses_by_the_primitive():
    zeros = np.zeros(2)
    index = np.array([0, -1], dtype=np.int32)
    hits = Hits(zeros, zeros, index, index, np.zeros((2, 2)), np.ones(2, dtype=bool))
    assert len(hits) == 2
    assert hits.hit.tolist() == [True, False]
