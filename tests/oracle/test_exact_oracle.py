"""The judge itself, on cases with an answer known by hand, and against independent exact arithmetic."""

from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests import meshes
from tests.oracle import exact_oracle as oracle
from tests.oracle.exact_numbers import Surd, exact_distance_error, is_within, round_to_float

TRIANGLE = np.array([[(0, 0, 1), (4, 0, 1), (0, 4, 1)]], dtype=np.float64)
UP = (0.0, 0.0, 1.0)
CUBE = meshes.make_cube()
CUBE_CORNERS = CUBE[0][CUBE[1]]


def cast(origin, direction, corners=None, centres=None, radii=None, **ranges):
    hits = oracle.closest_hit([origin], [direction], corners, centres, radii, **ranges)
    return hits.distance[0], int(hits.index[0])


# Numbers ------------------------------------------------------------------------------------------------------------

rationals = st.fractions(-5, 5, max_denominator=12)
surds = st.builds(Surd, rationals, st.sampled_from([-1, 1]), rationals.map(abs))


def to_decimal(number):
    with localcontext() as context:
        context.prec = 80
        if isinstance(number, Fraction):
            return Decimal(number.numerator) / Decimal(number.denominator)
        return to_decimal(number.a) + number.s * to_decimal(number.q).sqrt()


@given(surds, st.one_of(surds, rationals))
def test_surds_compare_as_80_digit_decimals_do(x, y):
    with localcontext() as context:
        context.prec = 80
        difference = to_decimal(x) - to_decimal(y)
    equal = abs(difference) < Decimal(10) ** -60  # numbers of these heights differ by far more, or not at all
    assert (x == y) == equal
    assert (x < y) == (difference < 0 and not equal)
    assert (y > x) == (x < y)


@given(surds)
def test_enclosure_contains_the_surd_and_rounds_to_the_nearest_float(x):
    low, high = x.enclose(64)
    assert low <= x <= high
    nearest = round_to_float(x)
    error = abs(to_decimal(x) - Decimal(nearest))
    for neighbour in (np.nextafter(nearest, -np.inf), np.nextafter(nearest, np.inf)):
        assert error <= abs(to_decimal(x) - Decimal(float(neighbour)))


def test_rounding_takes_ties_to_even_and_overflows_to_infinity():
    assert round_to_float(1 + Fraction(1, 2**53)) == 1
    assert round_to_float(Surd(Fraction(1), 1, Fraction(1, 2**106))) == 1
    assert round_to_float(Fraction(10**400)) == np.inf
    assert round_to_float(Fraction(-(10**400))) == -np.inf


def test_distance_error_is_exact():
    assert exact_distance_error(0.5, Fraction(1, 3)) == Fraction(1, 6)
    root = Surd(Fraction(0), 1, Fraction(2))
    assert abs(exact_distance_error(1.5, root) - (Fraction(3, 2) - root.enclose(1200)[0])) < Fraction(1, 2**1000)
    assert is_within(0.5, Fraction(1, 6), Fraction(1, 3))
    assert not is_within(0.5, Fraction(1, 6) - Fraction(1, 2**200), Fraction(1, 3))
    assert is_within(1.5, 0.0857865, root)
    assert not is_within(1.5, 0.0857864, root)


# Triangles ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("x", "y", "index"),
    [
        (1, 1, 0),
        (0, 0, 0),
        (4, 0, 0),
        (0, 4, 0),
        (2, 0, 0),
        (0, 2, 0),
        (2, 2, 0),
        (-5e-324, 1, -1),
        (2, 2.0000000000000004, -1),
        (5, 5, -1),
    ],
)
@pytest.mark.parametrize("order", [(0, 1, 2), (0, 2, 1)], ids=["front", "back"])
def test_triangle_is_a_closed_set_seen_from_both_sides(x, y, index, order):
    t, found = cast((x, y, 0), UP, TRIANGLE[:, order])
    assert found == index
    assert t == (1 if index == 0 else None)


@pytest.mark.parametrize("scale", [2.0**-900, 1e-40, 1.0, 1e25, 2.0**900])
@pytest.mark.parametrize("direction_length", [1e-30, 1.0, 1e30, 5e-324])
def test_distance_scales_exactly_with_the_scene_and_the_direction(scale, direction_length):
    t, index = cast((1 * scale, 1 * scale, 0), (0, 0, direction_length), TRIANGLE * scale)
    assert index == 0
    assert t == Fraction(scale) / Fraction(direction_length)


def test_range_is_inclusive_and_a_negative_t_min_counts_as_zero():
    for t_min, t_max, index in [
        (1, 1, 0),
        (0, np.nextafter(1, 0), -1),
        (np.nextafter(1, 2), np.inf, -1),
        (-3, 1, 0),
        (2, 1, -1),
        (np.nan, np.inf, -1),
        (0, np.nan, -1),
        (np.inf, np.inf, -1),
    ]:
        assert cast((1, 1, 0), UP, TRIANGLE, t_min=t_min, t_max=t_max)[1] == index
    assert cast((1, 1, 2), UP, TRIANGLE, t_min=-5)[1] == -1


def test_origin_on_the_triangle_hits_at_zero():
    assert cast((1, 1, 1), UP, TRIANGLE) == (0, 0)


@pytest.mark.parametrize("origin", [(-1, 1, 1), (0, 0, 1), (-1, 0, 1), (-1, 1, 0)])
def test_ray_parallel_to_the_plane_misses(origin):
    assert cast(origin, (1, 0, 0), TRIANGLE)[1] == -1


@pytest.mark.parametrize("corners", [[(0, 0, 1)] * 3, [(0, 0, 1), (1, 1, 1), (3, 3, 1)]])
def test_triangle_without_area_misses(corners):
    assert cast((0, 0, 0), UP, [corners])[1] == -1


def test_nearest_triangle_wins_and_ties_go_to_the_lowest_index():
    stack = np.concatenate([TRIANGLE + np.array((0, 0, 2)), TRIANGLE, TRIANGLE, TRIANGLE + np.array((0, 0, 1))])
    assert cast((1, 1, 0), UP, stack) == (1, 1)
    nearer = TRIANGLE.copy()
    nearer[..., 2] = np.nextafter(1, 0)
    assert cast((1, 1, 0), UP, np.concatenate([TRIANGLE, nearer]))[1] == 1


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_invalid_rays_miss_and_leave_the_others_alone(bad):
    origins = [(bad, 1, 0), (1, 1, 0), (1, 1, 0), (1, 1, 0)]
    directions = [UP, (0, 0, bad), (0, 0, 0), UP]
    hits = oracle.closest_hit(origins, directions, TRIANGLE)
    np.testing.assert_array_equal(hits.index, [-1, -1, -1, 0])
    np.testing.assert_array_equal(hits.rounded(), [np.inf, np.inf, np.inf, 1])
    np.testing.assert_array_equal(oracle.any_hit(origins, directions, TRIANGLE), [False, False, False, True])
    np.testing.assert_array_equal(oracle.crossings(origins, directions, TRIANGLE), [0, 0, 0, 1])


def fraction_hit(origin, direction, triangle):
    """The same question by solving a 3x3 system with Fractions and Gauss-Jordan elimination; None for a miss."""
    a, b, c = ([Fraction(x) for x in corner] for corner in triangle)
    rows = [[b[i] - a[i], c[i] - a[i], -Fraction(direction[i]), Fraction(origin[i]) - a[i]] for i in range(3)]
    for column in range(3):
        pivot = next((row for row in range(column, 3) if rows[row][column] != 0), None)
        if pivot is None:
            return None
        rows[column], rows[pivot] = rows[pivot], rows[column]
        rows[column] = [value / rows[column][column] for value in rows[column]]
        for row in range(3):
            if row != column:
                factor = rows[row][column]
                rows[row] = [x - factor * y for x, y in zip(rows[row], rows[column], strict=True)]
    beta, gamma, t = (row[3] for row in rows)
    return t if beta >= 0 and gamma >= 0 and beta + gamma <= 1 and t >= 0 else None


coordinates = st.one_of(st.integers(-3, 3).map(float), st.floats(-10, 10, allow_nan=False, allow_subnormal=False))
vectors = st.tuples(coordinates, coordinates, coordinates)


@settings(max_examples=300)
@given(vectors, vectors, st.lists(st.tuples(vectors, vectors, vectors), min_size=1, max_size=4))
def test_closest_hit_agrees_with_elimination_in_fractions(origin, direction, triangles):
    found = [(fraction_hit(origin, direction, triangle), i) for i, triangle in enumerate(triangles)]
    expected = min([(t, i) for t, i in found if t is not None], default=(None, -1))
    if not any(direction):
        expected = (None, -1)
    assert cast(origin, direction, np.array(triangles)) == expected


def test_closest_hit_names_all_that_are_hit_at_the_same_distance():
    positions, triangles = meshes.make_quad()
    origins, directions = [(0, 0, 1), (0.25, 0.1, 1), (0, 0, -1), (3, 0, 1)], [(0, 0, -1)] * 4
    doubled = np.concatenate([positions[triangles], positions[triangles] - (0, 0, 1), positions[triangles]])
    assert oracle.closest_hit(origins, directions, doubled).tied == [(0, 1, 4, 5), (0, 4), (2, 3), ()]


def test_filter_drops_no_hit_of_a_mesh_aimed_at_vertices_and_edges():
    mesh = meshes.make_icosphere(1)
    corners = mesh[0][mesh[1]]
    generator = np.random.default_rng(4)
    for origin in [(0.1, 0.2, 0.3), (3, -2, 1)]:
        for origins, directions in (
            meshes.rays_at_vertices(mesh, origin),
            meshes.rays_at_edges(mesh, origin, generator, 50),
        ):
            index = oracle.closest_hit(origins, directions, corners).index
            for ray in range(0, len(origins), 7):
                hits = [(fraction_hit(origins[ray], directions[ray], corner), i) for i, corner in enumerate(corners)]
                assert index[ray] == min((hit for hit in hits if hit[0] is not None), default=(None, -1))[1]


# Spheres ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("origin", "t_min", "expected"),
    [
        ((-3, 0, 0), 0, 2),
        ((-3, 0, 0), 2, 2),
        ((-3, 0, 0), np.nextafter(2, 3), 4),
        ((-3, 0, 0), 4, 4),
        ((-3, 0, 0), np.nextafter(4, 5), None),
        ((0, 0, 0), 0, 1),
        ((-1, 0, 0), 0, 0),
        ((1, 0, 0), 0, 0),
        ((2, 0, 0), 0, None),
        ((-3, 1, 0), 0, 3),
        ((-3, np.nextafter(1, 2), 0), 0, None),
        ((-3, np.nextafter(1, 2), 0), 2, None),
    ],
)
def test_sphere_is_hit_at_its_first_root_in_range(origin, t_min, expected):
    t, index = cast(origin, (1, 0, 0), centres=[(0, 0, 0)], radii=[1], t_min=t_min)
    assert index == (-1 if expected is None else 0)
    assert t == expected


def test_sphere_beyond_t_max_misses():
    assert cast((-3, 0, 0), (1, 0, 0), centres=[(0, 0, 0)], radii=[1], t_max=2)[1] == 0
    assert cast((-3, 0, 0), (1, 0, 0), centres=[(0, 0, 0)], radii=[1], t_max=np.nextafter(2, 0))[1] == -1


def test_irrational_root_has_the_exact_value():
    t, _ = cast((-3, 0.5, 0), (1, 0, 0), centres=[(0, 0, 0)], radii=[1])
    assert t == Surd(Fraction(3), -1, Fraction(3, 4))
    assert round_to_float(t) == pytest.approx(3 - np.sqrt(0.75), rel=1e-15)


def test_spheres_and_triangles_are_ordered_exactly():
    # The root is 3 - sqrt(3/4) exactly; triangles one ulp before and behind, then a sphere with the same root.
    t = round_to_float(cast((-3, 0.5, 0), (1, 0, 0), centres=[(0, 0, 0)], radii=[1])[0])
    wall = np.array([[(0, -9, -9), (0, 9, -9), (0, 0, 9)]], dtype=np.float64)
    for x, index in ((np.nextafter(t, 0) - 3, 0), (np.nextafter(t, 9) - 3, 1)):
        assert cast((-3, 0.5, 0), (1, 0, 0), wall + np.array((x, 0, 0)), [(0, 0, 0)], [1])[1] == index
    assert cast((-3, 0.5, 0), (1, 0, 0), centres=[(5, 0, 0), (0, 0, 0), (0, 0, 0)], radii=[1, 1, 1])[1] == 1
    touching = np.array([[(-1, -9, -9), (-1, 9, -9), (-1, 0, 9)]], dtype=np.float64)
    assert cast((-3, 0, 0), (1, 0, 0), touching, [(0, 0, 0)], [1]) == (2, 0)


# Crossings ----------------------------------------------------------------------------------------------------------


def test_ray_through_an_inner_edge_or_vertex_crosses_once():
    quad = meshes.make_quad()
    origins = [(0, 0, -1), (0.25, 0.25, -1), (0.25, 0.1, -1), (2, 2, -1)]
    np.testing.assert_array_equal(oracle.crossings(origins, [UP] * 4, quad[0][quad[1]]), [1, 1, 1, 0])


def test_crossings_of_a_closed_mesh_are_odd_inside_and_even_outside():
    generator = np.random.default_rng(5)
    for origin, parity in (((0.5, 0.25, 0.125), 1), ((0, 0, 0), 1), ((3, 0, 0), 0), ((3, 3, 3), 0), ((1.5, 1, -1), 0)):
        rays = [
            meshes.rays_at_vertices(CUBE, origin),
            meshes.rays_at_edges(CUBE, origin, generator, 60),
            meshes.aim(origin, CUBE_CORNERS.mean(axis=1)),
            (np.tile(origin, (6, 1)), np.concatenate([np.eye(3), -np.eye(3)])),
        ]
        for origins, directions in rays:
            np.testing.assert_array_equal(oracle.crossings(origins, directions, CUBE_CORNERS) % 2, parity)


def test_crossings_from_a_point_of_the_surface_are_those_of_the_moved_point():
    # (e, e^2, e^3) moves a point of the x = -1 face into the cube, and one of the x = 1 face out of it.
    for x, parity in ((-1, 1), (1, 0)):
        for direction in [(1, 0, 0), (-1, 0, 0), (1, 1, 1), (0, 0, 1)]:
            assert oracle.crossings([(x, 0, 0)], [direction], CUBE_CORNERS)[0] % 2 == parity


# Scenes -------------------------------------------------------------------------------------------------------------


def test_place_rounds_every_operation():
    matrix = [(1e16, 1, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)]
    np.testing.assert_array_equal(oracle.place(np.array([(1.0, 1.0, 0.0)]), matrix), [(1e16, 1, 0)])
