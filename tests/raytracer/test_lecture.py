"""The lecture's worked examples with their numbers, its case distinctions, and what the docstrings correct in it."""

import numpy as np
import pytest

from raytracer import lecture
from raytracer.lecture import Region

# The example triangle of the lecture, "Barycentric Coordinates".
A, B, C = (1, 0, 0), (0, 1, 0), (0, 0, 1)
ULP = np.finfo(np.float64).eps


# Worked examples ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("t", [0, 1, -2, 0.5])
def test_line_through_1_m1_4_along_3_5_m1_has_the_lectures_equations(t):
    np.testing.assert_array_equal(lecture.point_on_line((1, -1, 4), (3, 5, -1), t), (1 + 3 * t, -1 + 5 * t, 4 - t))


def test_line_through_two_points_starts_at_the_first_and_ends_at_the_second():
    origin, direction = lecture.line_through((1, 2, 3), (4, 3, 8))
    np.testing.assert_array_equal(origin, (1, 2, 3))
    np.testing.assert_array_equal(direction, (3, 1, 5))
    np.testing.assert_array_equal(lecture.point_on_line(origin, direction, 1), (4, 3, 8))


def test_line_from_1_2_3_to_4_3_8_meets_x_2y_z_6_at_t_minus_one_fifth():
    # 1 + 3 t + 2 (2 + t) + 3 + 5 t = 8 + 10 t = 6
    origin, direction = lecture.line_through((1, 2, 3), (4, 3, 8))
    t = lecture.intersect_plane(origin, direction, (1, 2, 1), 6)
    assert t == -2 / 10
    np.testing.assert_allclose(lecture.point_on_line(origin, direction, t), (0.4, 1.8, 2.0), rtol=2 * ULP)


def test_example_triangle_weights_are_the_coordinates():
    for point in [(1, 0, 0), (0.25, 0.25, 0.5), (0, 0.5, 0.5), (2, -0.5, -0.5)]:
        np.testing.assert_array_equal(lecture.barycentric(point, A, B, C), point)


def test_eye_m3_1_along_08_m06_gives_the_quadratic_t2_6t_9():
    coefficients = lecture.circle_quadratic((-3, 1), (0.8, -0.6), 1)
    np.testing.assert_allclose(coefficients, (1, -6, 9), rtol=4 * ULP)


def test_eye_m3_1_tangent_to_the_unit_circle_gives_t_3_3():
    # (4, -3) / 5 is the lecture's direction without its rounding: t = 3 / 5 of that length, twice.
    np.testing.assert_array_equal(lecture.intersect_circle((-3, 1), (4, -3), 1), (0.6, 0.6))
    # (.8, -.6) is rounded: D / 4 = |d|^2 - (P x d)^2 is off by up to 4 u + 2 (2.6 * 2 + 1) u < 10 ulp, its root by the
    # square root of that.
    roots = lecture.intersect_circle((-3, 1), (0.8, -0.6), 1)
    np.testing.assert_allclose(roots, (3, 3), atol=np.sqrt(10 * ULP), rtol=0)


def test_cramers_rule_example_has_determinant_3_and_solution_1_m2_3():
    matrix = [[2, 1, 1], [1, -1, -1], [1, 2, 1]]
    assert lecture.determinant(matrix) == 3
    np.testing.assert_array_equal(lecture.solve_cramer(matrix, (3, 0, 0)), (1, -2, 3))


def test_distance_from_1_4_m2_to_line_through_3_1_m2_and_6_m2_1_is_sqrt_14_thirds():
    origin, direction = lecture.line_through((3, 1, -2), (6, -2, 1))
    np.testing.assert_array_equal(np.abs(lecture.cross((-2, 3, 0), direction)), (9, 6, 3))
    distance = lecture.distance_point_line((1, 4, -2), origin, direction)
    assert distance == pytest.approx(np.sqrt(14 / 3), rel=4 * ULP, abs=0)


# Where the lecture is wrong or silent -------------------------------------------------------------------------------


def test_distance_divides_by_the_length_not_by_its_square_as_printed():
    # Twice as long a direction spans the same line: the printed formula would halve the distance.
    assert lecture.distance_point_line((0, 3, 0), (0, 0, 0), (1, 0, 0)) == 3
    assert lecture.distance_point_line((0, 3, 0), (0, 0, 0), (2, 0, 0)) == 3


def test_strict_inequalities_leave_out_edges_which_the_closed_triangle_includes():
    through_edge = lecture.intersect_triangle((0.5, 0.5, -1), (0, 0, 1), A, B, (0, 0, 0))
    assert through_edge.t == 1
    weights = (1 - through_edge.beta - through_edge.gamma, through_edge.beta, through_edge.gamma)
    assert not all(0 < weight < 1 for weight in weights)
    assert lecture.classify_barycentric(weights) == Region.EDGE


def test_a_zero_weight_beyond_the_corners_is_outside():
    assert lecture.classify_barycentric((0, 2, -1)) == Region.OUTSIDE


def test_alpha_of_an_exact_edge_point_is_exactly_zero():
    # 1 - beta - gamma would leave 1 - 0.1 - 0.9 = -2.8e-17 here.
    assert lecture.barycentric((0, 0.1, 0.9), A, B, C)[0] == 0


# Cases --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("weights", "region"),
    [
        ((0.25, 0.25, 0.5), Region.INSIDE),
        ((0, 0.5, 0.5), Region.EDGE),
        ((0.5, 0, 0.5), Region.EDGE),
        ((0.5, 0.5, -0.0), Region.EDGE),
        ((1, 0, 0), Region.VERTEX),
        ((0, 1, 0), Region.VERTEX),
        ((0, 0, 1), Region.VERTEX),
        ((1.5, -0.5, 0), Region.OUTSIDE),
        ((2, -0.5, -0.5), Region.OUTSIDE),
        ((0.5, 0.5, -5e-324), Region.OUTSIDE),
        ((0, 0, 0), Region.OUTSIDE),
        ((np.nan, np.nan, np.nan), Region.OUTSIDE),
    ],
)
def test_classify_tells_inside_edge_vertex_outside(weights, region):
    assert lecture.classify_barycentric(weights) == region


def test_classify_counts_weights_within_the_tolerance_as_zero():
    weights = (0.5 + ULP, 0.5, -ULP)
    assert lecture.classify_barycentric(weights) == Region.OUTSIDE
    assert lecture.classify_barycentric(weights, tolerance=ULP) == Region.EDGE
    assert lecture.classify_barycentric(weights, tolerance=ULP / 2) == Region.OUTSIDE
    np.testing.assert_array_equal(
        lecture.classify_barycentric([weights, weights], [0, ULP]), [Region.OUTSIDE, Region.EDGE]
    )


def test_barycentric_takes_the_projection_of_a_point_beside_the_plane():
    np.testing.assert_array_equal(
        lecture.barycentric((0.25, 0.25, 7), (0, 0, 0), (1, 0, 0), (0, 1, 0)), (0.5, 0.25, 0.25)
    )


@pytest.mark.parametrize("c", [A, B, (0.5, 0.5, 0)])
def test_barycentric_of_a_triangle_without_area_is_nan(c):
    assert np.isnan(lecture.barycentric((0, 0, 0), A, B, c)).all()


@pytest.mark.parametrize("offset", [0, 1], ids=["in the plane", "beside it"])
def test_line_parallel_to_a_plane_is_nan(offset):
    assert np.isnan(lecture.intersect_plane((1, 2, 0), (1, 1, 0), (0, 0, 1), offset))


def test_circle_discriminant_has_three_cases():
    y = np.array([2, 1, 0.0])  # D < 0, D = 0, D > 0
    roots = lecture.intersect_circle(np.stack([np.full(3, -3), y], axis=-1), (2, 0), 1)
    np.testing.assert_array_equal(roots, [(np.nan, np.nan), (1.5, 1.5), (1, 2)])


@pytest.mark.parametrize("sign", [1, -1])
def test_circle_and_sphere_around_the_origin_of_the_ray_have_a_root_on_either_side(sign):
    np.testing.assert_array_equal(lecture.intersect_circle((0, 0), (0, sign * 2), 1), (-0.5, 0.5))
    np.testing.assert_array_equal(lecture.intersect_circle((0.5, 0), (sign, 0), 1), np.sort((-1.5 * sign, 0.5 * sign)))
    np.testing.assert_array_equal(lecture.intersect_sphere((1, 1, 1), (0, sign * 2, 0), (1, 1, 1), 1), (-0.5, 0.5))


def test_sphere_is_hit_where_the_distance_is_below_the_radius_and_touched_where_equal():
    y = np.array([0, 0.6, 1, np.nextafter(1, 2)])
    roots = lecture.intersect_sphere(np.stack([-3 + 0 * y, y, 0 * y], axis=-1), (1, 0, 0), (0, 0, 0), 1)
    expected = [(2, 4), (2.2, 3.8), (3, 3), (np.nan, np.nan)]
    np.testing.assert_allclose(roots, expected, rtol=2 * ULP)
    assert roots[2, 0] == roots[2, 1]


@pytest.mark.parametrize("scale", [1e-60, 1, 1e60])
def test_sphere_just_missed_is_missed_at_every_scale(scale):
    # The discriminant of the tiny one underflows; the comparison of distance and radius does not.
    y = scale * np.nextafter(1, 2)
    assert np.isnan(lecture.intersect_sphere((-scale, y, 0), (1e-90, 0, 0), (0, 0, 0), scale)).all()


@pytest.mark.parametrize("radius", [-1, np.nan])
def test_negative_radius_is_nan(radius):
    assert np.isnan(lecture.intersect_circle((-3, 0), (1, 0), radius)).all()
    assert np.isnan(lecture.intersect_sphere((-3, 1, 0), (1, 0, 0), (0, 0, 0), radius)).all()


@pytest.mark.parametrize("seed", range(5))
def test_origin_on_the_surface_is_a_root_of_exactly_zero(seed):
    direction = np.random.default_rng(seed).normal(size=(100, 3))
    roots = lecture.intersect_sphere((3, 4, 0), direction, (0, 0, 0), 5)
    np.testing.assert_array_equal((roots == 0).any(axis=-1), True)
    np.testing.assert_array_equal((lecture.intersect_circle((3, 4), direction[:, :2], 5) == 0).any(axis=-1), True)


def test_distant_unit_sphere_keeps_its_roots_where_b2_4ac_has_lost_them():
    # b^2 - 4 a c rounds to 0 or below for c = 1e16 - 1 + 0.25: the schoolbook form misses or merges the roots.
    roots = lecture.intersect_sphere((-1e8, 0.5, 0), (1, 0, 0), (0, 0, 0), 1)
    np.testing.assert_allclose(roots, (1e8 - np.sqrt(0.75), 1e8 + np.sqrt(0.75)), rtol=2 * ULP, atol=0)
    assert roots[0] < 1e8 < roots[1]


@pytest.mark.parametrize(
    ("origin", "direction"),
    [
        ((0.6, 0.6, -1), (0, 0, 1)),  # beside the far edge
        ((-0.1, 0.5, -1), (0, 0, 1)),
        ((0.25, 0.25, 1), (0, 0, 1)),  # behind the origin
        ((0.25, 0.25, 1), (1, 0, 0)),  # parallel
        ((-1, 0.25, 0), (1, 0, 0)),  # in the plane
        ((0.25, 0.25, 0), (0, 0, 0)),
    ],
)
def test_triangle_missed_is_all_nan(origin, direction):
    assert np.isnan(lecture.intersect_triangle(origin, direction, (0, 0, 0), (1, 0, 0), (0, 1, 0))).all()


@pytest.mark.parametrize(("second", "third", "weights"), [(B, C, (0.25, 0.5)), (C, B, (0.5, 0.25))])
def test_triangle_is_hit_from_both_sides_and_in_both_windings(second, third, weights):
    for side in (1, -1):
        origin, direction = (0.25 + side, 0.25 + side, 0.5 + side), (-2 * side, -2 * side, -2 * side)
        assert lecture.intersect_triangle(origin, direction, A, second, third) == (0.5, *weights)


@pytest.mark.parametrize("point", [(0, 0), (1, 0), (0, 1), (0.5, 0), (0.5, 0.5), (0, 0.5), (0.75, 0.25)])
def test_triangle_is_hit_at_its_vertices_and_edges(point):
    hit = lecture.intersect_triangle((*point, -2), (0, 0, 1), (0, 0, 0), (1, 0, 0), (0, 1, 0))
    assert hit == (2, *point)


def test_singular_matrix_is_nan():
    assert np.isnan(lecture.solve_cramer([[1, 2, 3], [2, 4, 6], [0, 0, 1]], (1, 2, 3))).all()


def test_zero_direction_is_nan():
    zero = (0, 0, 0)
    assert np.isnan(lecture.intersect_plane((1, 2, 3), zero, (0, 0, 1), 1))
    assert np.isnan(lecture.intersect_circle((0, 0), (0, 0), 1)).all()
    assert np.isnan(lecture.distance_point_line((1, 2, 3), (0, 0, 0), zero))
    assert np.isnan(lecture.intersect_sphere((0, 0, 0), zero, (0, 0, 0), 1)).all()


def test_direction_whose_square_underflows_is_nan_not_infinite():
    assert np.isnan(lecture.intersect_circle((-3, 0), (1e-200, 0), 1)).all()


# Shapes -------------------------------------------------------------------------------------------------------------

VECTOR, NUMBER = 3, None
FUNCTIONS = {
    "point_on_line": (lecture.point_on_line, (VECTOR, VECTOR, NUMBER)),
    "line_through": (lecture.line_through, (VECTOR, VECTOR)),
    "intersect_plane": (lecture.intersect_plane, (VECTOR, VECTOR, VECTOR, NUMBER)),
    "barycentric": (lecture.barycentric, (VECTOR, VECTOR, VECTOR, VECTOR)),
    "classify_barycentric": (lecture.classify_barycentric, (VECTOR, NUMBER)),
    "intersect_circle": (lecture.intersect_circle, (2, 2, NUMBER)),
    "intersect_triangle": (lecture.intersect_triangle, (VECTOR,) * 5),
    "determinant": (lecture.determinant, ((3, 3),)),
    "solve_cramer": (lecture.solve_cramer, ((3, 3), VECTOR)),
    "distance_point_line": (lecture.distance_point_line, (VECTOR, VECTOR, VECTOR)),
    "intersect_sphere": (lecture.intersect_sphere, (VECTOR, VECTOR, VECTOR, NUMBER)),
}


def results(answer):
    return [np.asarray(part) for part in (answer if isinstance(answer, tuple) else (answer,))]


def as_tail(tail):
    return () if tail is NUMBER else tuple(np.atleast_1d(tail))


def random_argument(random, tail, shape):
    return random.normal(size=(*shape, *as_tail(tail))) + (2 if tail is NUMBER else 0)


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("shape", [(), (2,), (2, 3), (0,)], ids=str)
def test_batch_equals_its_elements_bit_for_bit(name, shape):
    function, tails = FUNCTIONS[name]
    random = np.random.default_rng(21)
    arguments = [random_argument(random, tail, shape) for tail in tails]
    batch = results(function(*arguments))
    for index in np.ndindex(shape):
        for part, single in zip(batch, results(function(*(value[index] for value in arguments))), strict=True):
            np.testing.assert_array_equal(part[index], single, strict=True)
    assert all(part.shape[: len(shape)] == shape for part in batch)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_arguments_broadcast_against_each_other(name):
    function, tails = FUNCTIONS[name]
    random = np.random.default_rng(22)
    arguments = [random_argument(random, tail, (4, 1) if i % 2 else (3,)) for i, tail in enumerate(tails)]
    shape = np.broadcast_shapes(*((4, 1) if i % 2 else (3,) for i in range(len(tails))))
    full = [np.broadcast_to(value, (*shape, *as_tail(tail))) for value, tail in zip(arguments, tails, strict=True)]
    for part, expected in zip(results(function(*arguments)), results(function(*full)), strict=True):
        np.testing.assert_array_equal(part, expected, strict=True)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_nothing_warns_on_nan_infinity_or_zero(name):
    function, tails = FUNCTIONS[name]
    for value in (np.nan, np.inf, 0.0, 1e300, 5e-324):
        function(*(np.full((2, *as_tail(tail)), value) for tail in tails))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_numbers_in_give_numbers_out_where_the_answer_is_a_number(name):
    function, tails = FUNCTIONS[name]
    random = np.random.default_rng(23)
    for part in results(function(*(random_argument(random, tail, ()) for tail in tails))):
        assert part.ndim <= 1
        assert part.dtype == (np.int8 if name == "classify_barycentric" else np.float64)


def test_who_asks_for_errors_still_gets_them_afterwards():
    with np.errstate(all="raise"):
        assert np.isnan(lecture.dot((np.inf, 1.0), (0.0, 1.0)))
        with pytest.raises(IndexError):
            lecture.dot((1.0, 2.0), (1.0, 2.0, 3.0))
        with pytest.raises(FloatingPointError):
            np.float64(1.0) / np.zeros(1)
