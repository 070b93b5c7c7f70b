"""The lecture's functions against the same formulas in exact rational arithmetic, with derived error bounds.

Every input is an integer times a power of two, so that nothing underflows and every bound follows from
fl(x op y) = (x op y)(1 + delta), |delta| <= u alone. For a quotient N / D, computed from sums of products, the check
is |t D - N| <= |t| err(D) + err(N) (1 + u) + u |N|: it holds however ill-conditioned D is.
"""

from fractions import Fraction
from itertools import permutations

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from raytracer import lecture
from raytracer.lecture import Region

U = Fraction(1, 2**53)

numbers = st.builds(lambda digits, exponent: digits * 2.0**-exponent, st.integers(-(2**53), 2**53), st.integers(0, 60))
small_numbers = st.integers(-4, 4).map(float)
numbers_or_small = st.one_of(numbers, small_numbers)  # the small ones make exact zeros and ties likely
points = st.tuples(*[st.one_of(numbers, small_numbers)] * 3)
planar_points = st.tuples(*[st.one_of(numbers, small_numbers)] * 2)


def gamma(n):
    """Bound on the relative error of n roundings in a row (Higham, Accuracy and Stability, lemma 3.1)."""
    return n * U / (1 - n * U)


def exact(values):
    return [Fraction(value) for value in values]


def minus(p, q):
    return [x - y for x, y in zip(p, q, strict=True)]


def dot(p, q):
    return sum(x * y for x, y in zip(p, q, strict=True))


def cross(p, q):
    return [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]


def sizes(p):
    return [abs(x) for x in p]


def cross_sizes(p, q):
    """Each component of the cross product with all terms made positive."""
    p, q = sizes(p), sizes(q)
    return [p[1] * q[2] + p[2] * q[1], p[2] * q[0] + p[0] * q[2], p[0] * q[1] + p[1] * q[0]]


def assert_is_quotient(computed, numerator, numerator_error, denominator, denominator_error):
    """Check `computed` against numerator / denominator; NaN is right only where the denominator may round to 0."""
    if np.isnan(computed):
        assert abs(denominator) <= denominator_error
        return
    value = Fraction(float(computed))
    bound = abs(value) * denominator_error + numerator_error * (1 + U) + U * abs(numerator)
    assert abs(value * denominator - numerator) <= bound


@given(points, points, numbers)
def test_point_on_line_is_within_two_roundings(origin, direction, t):
    for p, v, d in zip(lecture.point_on_line(origin, direction, t), origin, direction, strict=True):
        v, d, scale = exact((v, d, t))
        assert abs(Fraction(float(p)) - (v + scale * d)) <= gamma(2) * (abs(v) + abs(scale * d))


@given(points, points)
def test_line_through_rounds_the_direction_once(p, q):
    origin, direction = lecture.line_through(p, q)
    assert tuple(origin) == p
    for d, difference in zip(direction, minus(exact(q), exact(p)), strict=True):
        assert abs(Fraction(float(d)) - difference) <= U * abs(difference)


@given(points, points, points, numbers_or_small)
def test_intersect_plane_agrees_with_exact_arithmetic(origin, direction, normal, offset):
    t = lecture.intersect_plane(origin, direction, normal, offset)
    v, d, n, (k,) = exact(origin), exact(direction), exact(normal), exact((offset,))
    assert_is_quotient(
        t,
        k - dot(n, v),
        gamma(4) * (abs(k) + dot(sizes(n), sizes(v))),
        dot(n, d),
        gamma(3) * dot(sizes(n), sizes(d)),
    )


def exact_areas(p, a, b, c):
    """Numerators of the three weights and their denominator, each with its sum of positive terms."""
    edges = [(minus(c, b), minus(p, b)), (minus(p, a), minus(c, a)), (minus(b, a), minus(p, a))]
    normal, normal_size = cross(minus(b, a), minus(c, a)), cross_sizes(minus(b, a), minus(c, a))
    numerators = [(dot(cross(u, v), normal), dot(cross_sizes(u, v), normal_size)) for u, v in edges]
    return numerators, (dot(normal, normal), dot(normal_size, normal_size))


@given(points, points, points, points)
def test_barycentric_agrees_with_exact_arithmetic(p, a, b, c):
    weights = lecture.barycentric(p, a, b, c)
    numerators, (whole, whole_size) = exact_areas(exact(p), exact(a), exact(b), exact(c))
    for weight, (numerator, size) in zip(weights, numerators, strict=True):
        # 2 differences, product and subtraction in each cross product: 4 + 4; product and two sums of the dot: 3.
        assert_is_quotient(weight, numerator, gamma(11) * size, whole, gamma(11) * whole_size)


@given(points, points, points, st.integers(0, 8), st.integers(0, 8))
def test_classify_with_the_derived_tolerance_accepts_every_point_made_from_weights(a, b, c, beta, gamma_weight):
    assume(beta + gamma_weight <= 8)
    weights = (Fraction(8 - beta - gamma_weight, 8), Fraction(beta, 8), Fraction(gamma_weight, 8))
    corners = [exact(corner) for corner in (a, b, c)]
    point = [sum(w * corner[axis] for w, corner in zip(weights, corners, strict=True)) for axis in range(3)]
    assume(all(Fraction(float(x)) == x for x in point))
    numerators, (whole, whole_size) = exact_areas(point, *corners)
    assume(whole > 2 * gamma(11) * whole_size)
    size = max(size for _, size in numerators)
    tolerance = 2 * gamma(11) * (size + whole_size) / whole  # of numerator and, times a weight <= 1, denominator
    assume(min(w for w in weights if w) > 2 * tolerance)
    computed = lecture.barycentric([float(x) for x in point], a, b, c)
    assert lecture.classify_barycentric(computed, float(tolerance)) == Region.INSIDE + sum(w == 0 for w in weights)


def exact_determinant(matrix, positive=False):
    """Sum over permutations; with `positive`, the permanent of the absolute values."""
    total = Fraction(0)
    for order in permutations(range(3)):
        sign = 1 if positive or order in ((0, 1, 2), (1, 2, 0), (2, 0, 1)) else -1
        term = matrix[0][order[0]] * matrix[1][order[1]] * matrix[2][order[2]]
        total += abs(term) if positive else sign * term
    return total


def replace_column(matrix, axis, rhs):
    return [[*row[:axis], value, *row[axis + 1 :]] for row, value in zip(matrix, rhs, strict=True)]


def assert_is_cramer_solution(solution, matrix, rhs, entry_roundings=0):
    """Two products per term, five sums: gamma(7), plus the roundings already in the entries of each term."""
    relative = gamma(7 + 3 * entry_roundings)
    whole, whole_error = exact_determinant(matrix), relative * exact_determinant(matrix, positive=True)
    for axis, value in enumerate(solution):
        swapped = replace_column(matrix, axis, rhs)
        error = relative * exact_determinant(swapped, positive=True)
        assert_is_quotient(value, exact_determinant(swapped), error, whole, whole_error)


@given(st.tuples(points, points, points), points)
def test_solve_cramer_agrees_with_exact_arithmetic(matrix, rhs):
    assert_is_cramer_solution(lecture.solve_cramer(matrix, rhs), [exact(row) for row in matrix], exact(rhs))


@given(points, points, points, points, points)
def test_intersect_triangle_agrees_with_exact_arithmetic(origin, direction, a, b, c):
    t, beta, gamma_weight = lecture.intersect_triangle(origin, direction, a, b, c)
    p, d, a, b, c = (exact(value) for value in (origin, direction, a, b, c))
    columns = minus(a, b), minus(a, c), d
    matrix, rhs = [list(row) for row in zip(*columns, strict=True)], minus(a, p)
    if not np.isnan(t):
        assert min(t, beta, gamma_weight) >= 0
        assert beta + gamma_weight <= 1
        assert_is_cramer_solution((beta, gamma_weight, t), matrix, rhs, entry_roundings=1)
        return
    # A miss must be a miss: some condition fails, or lies within the rounding error of its quotient.
    whole, error = exact_determinant(matrix), gamma(10) * exact_determinant(matrix, positive=True)
    if abs(whole) <= 2 * error:
        return
    values, slack = [], []
    for axis in range(3):
        swapped = replace_column(matrix, axis, rhs)
        values.append(exact_determinant(swapped) / whole)
        numerator_error = gamma(10) * exact_determinant(swapped, positive=True)
        slack.append(2 * (numerator_error + abs(values[-1]) * error) / abs(whole) + 2 * U * abs(values[-1]))
    inside = [v > s for v, s in zip(values, slack, strict=True)]
    assert not (all(inside) and values[0] + values[1] + slack[0] + slack[1] + 2 * U < 1)


@given(points, points, points)
def test_distance_point_line_agrees_with_exact_arithmetic(point, origin, direction):
    h = lecture.distance_point_line(point, origin, direction)
    u, d = minus(exact(point), exact(origin)), exact(direction)
    if not any(d):
        assert np.isnan(h)
        return
    h, squared = Fraction(float(h)), dot(cross(u, d), cross(u, d)) / dot(d, d)
    # Each component of the cross product is off by gamma(3) of its positive sum; |d| is at least its largest component.
    # A norm (3 roundings under the root, and the root) is off by gamma(3), two norms and the quotient by gamma(7).
    bound = gamma(3) * sum(cross_sizes(u, d)) / max(sizes(d)) * (1 + gamma(7)) + 2 * gamma(7) * h
    assert max(h - bound, 0) ** 2 <= squared <= (h + bound) ** 2


def assert_meets_round_surface(roots, offset, direction, radius):
    """Check the roots t of |f + t d| = r, in exact arithmetic: every point lies within `slack` of the surface.

    With positions x = t |d| along the line, midpoint m and half chord s, r^2 = h^2 + s^2:
    m is off by gamma(8) |f|, h by less than 12 u |f| (see the test of the distance), s^2 accordingly by 2 r 12 u |f|;
    both roots inherit these. The root of smaller size, from c / (a t1), adds gamma(6) (|f|^2 + r^2) / |x1|, which is
    below 12 u (|f| + r) for |f| > 2 r, and else at most 12 u^(1/2) r, as |x1| >= s >= u^(1/2) r where s is not 0; its
    square is 144 u r^2. In the distance from the surface, (x - x1)(x - x2) / (2 r), all this adds up to less than
    256 u (|f| + r). A miss is right where the line's exact distance is above r - slack.
    """
    f, d, (r,) = exact(offset), exact(direction), exact((radius,))
    slack = 256 * U * (sum(sizes(f)) + r)
    a, b = dot(d, d), dot(f, d)
    if np.isnan(roots).any():
        assert np.isnan(roots).all()
        assert a == 0 or dot(f, f) - b * b / a >= max(r - slack, 0) ** 2
        return
    assert roots[0] <= roots[1]
    for t in exact(roots.tolist()):
        assert abs(dot(f, f) + 2 * t * b + t * t * a - r * r) <= 2 * r * slack + slack * slack


@settings(max_examples=300)
@given(planar_points, planar_points, numbers_or_small.map(abs))
def test_intersect_circle_roots_lie_on_the_circle(origin, direction, radius):
    assert_meets_round_surface(lecture.intersect_circle(origin, direction, radius), origin, direction, radius)


@settings(max_examples=300)
@given(points, points, points, numbers_or_small.map(abs))
def test_intersect_sphere_roots_lie_on_the_sphere(origin, direction, centre, radius):
    roots = lecture.intersect_sphere(origin, direction, centre, radius)
    assert_meets_round_surface(roots, minus(exact(origin), exact(centre)), direction, radius)


def test_intersect_sphere_roots_lie_on_a_distant_sphere():
    # The schoolbook discriminant is off the surface by about u |f|^2 / r = 0.5 here, the slack is 3e-6.
    for y in np.linspace(0, 1, 50):
        roots = lecture.intersect_sphere((-1e8, y, 3), (2, 1e-9, -3e-8), (0, 0, 0), 1)
        assert_meets_round_surface(roots, (-1e8, y, 3), (2, 1e-9, -3e-8), 1)
