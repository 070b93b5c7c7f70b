"""The error bounds of `predicates`, `refine` and `double_double` against exact arithmetic, and the lecture's twins."""

from fractions import Fraction

import numpy as np
import pytest

import raytracer
from raytracer import lecture
from raytracer.predicates import double_double as dd
from raytracer.predicates import exact, filtered, refine

# Sizes of coordinates, and how flat triangles are: well shaped, skinny, and nearly seen edge-on.
CASES = [(1.0, 1.0), (1e-30, 1.0), (1e30, 1e-3), (1e6, 1e-6), (1e-100, 1e-9)]


def as_fractions(vector):
    return [Fraction(float(x)) for x in vector]


def exact_dot(p, q):
    return sum(x * y for x, y in zip(p, q, strict=True))


def exact_cross(p, q):
    return [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]


def exact_minus(p, q):
    return [x - y for x, y in zip(as_fractions(p), as_fractions(q), strict=True)]


def make_cases(rng, size, flatness, count=150):
    """Rays (3, n) with z as the main axis, aimed near corners of thin triangles (3 corners, 3, n)."""
    corners = rng.normal(size=(3, 3, count))
    corners[2] = corners[0] + (corners[1] - corners[0]) * rng.random(count) + flatness * rng.normal(size=(3, count))
    origin = rng.normal(size=(3, count)) * 3
    aim = corners[rng.integers(3, size=count), :, np.arange(count)].T
    direction = aim + 1e-14 * rng.normal(size=(3, count)) - origin
    main = np.abs(direction).argmax(axis=0)
    turn = (main + np.array([[1], [2], [3]])) % 3
    origin, direction = (np.take_along_axis(vectors, turn, axis=0) for vectors in (origin, direction))
    corners = np.stack([np.take_along_axis(corner, turn, axis=0) for corner in corners])
    return origin * size, direction, corners * size


@pytest.mark.parametrize(("size", "flatness"), CASES)
def test_edge_function_is_within_its_bounds(rng, size, flatness):
    origin, direction, corners = make_cases(rng, size, flatness)
    slope = direction[:2] / direction[2]
    p, q = corners[0] - origin, corners[1] - origin
    edge = filtered.edge_function(filtered.shear(p, slope), filtered.shear(q, slope))
    error = filtered.edge_error(p, q, slope)
    reach = np.abs(corners - origin).max(axis=(0, 1))
    assert (error <= filtered.edge_error_of_ray(slope, reach)).all()
    largest = 0.0
    for k in range(edge.size):
        relative = [exact_minus(corner[:, k], origin[:, k]) for corner in corners[:2]]
        d = as_fractions(direction[:, k])
        true = exact_dot(d, exact_cross(*relative)) / d[2]
        off = abs(Fraction(float(edge[k])) - true)
        assert off <= Fraction(float(error[k]))
        largest = max(largest, float(off / Fraction(float(error[k]))))
    # The bound is derived, not generous: the worst of these cases comes within a factor of 64 of it.
    assert largest > 1 / 64


def test_edge_function_is_antisymmetric_bit_for_bit(rng):
    p, q = rng.normal(size=(2, 2, 1000))
    np.testing.assert_array_equal(filtered.edge_function(p, q), -filtered.edge_function(q, p))


@pytest.mark.parametrize(("size", "flatness"), CASES)
def test_plane_distance_is_within_its_bound(rng, size, flatness):
    origin, direction, corners = make_cases(rng, size, flatness)
    plane = filtered.intersect_plane_certified(
        direction, corners[0] - origin, corners[1] - corners[0], corners[2] - corners[0]
    )
    refined = [
        compute(origin, direction, *corners) for compute in (refine.correct_distance, refine.divide_determinants)
    ]
    bounded = 0
    for k in range(origin.shape[1]):
        true = exact_plane_distance(origin[:, k], direction[:, k], corners[:, :, k])
        for t, error in ((plane.t, plane.t_error), *refined):
            if np.isfinite(error[k]):
                bounded += 1
                assert abs(Fraction(float(t[k])) - true) <= Fraction(float(error[k]))
    # Numerators of size^3 = 1e-300 are refused, and left to integers.
    assert bounded > 2 * origin.shape[1] or size == 1e-100


def test_corrected_distance_is_within_its_bound(rng):
    """Triangles seen from a distance, where the correction of float64 suffices; hits anywhere in them."""
    origin, direction, corners = make_cases(rng, 1.0, 1.0)
    corners[1:] = corners[0] + 0.01 * (corners[1:] - corners[0])
    aim = np.einsum("kn,kin->in", rng.dirichlet(np.ones(3), size=corners.shape[2]).T, corners)
    direction = aim - origin
    t, error = refine.correct_distance(origin, direction, *corners)
    offs = []
    for k in range(len(t)):
        off = abs(Fraction(float(t[k])) - exact_plane_distance(origin[:, k], direction[:, k], corners[:, :, k]))
        offs.append(float(off / Fraction(float(error[k]))))
    assert max(offs) <= 1
    assert max(offs) > 1 / 4
    assert np.median(error / np.spacing(t)) <= 1


@pytest.mark.parametrize(("size", "flatness"), CASES)
def test_denominator_is_within_its_bound(rng, size, flatness):
    origin, direction, corners = make_cases(rng, size, flatness)
    sides = corners[1:] - corners[0]
    plane = filtered.intersect_plane_certified(direction, corners[0] - origin, *sides)
    shares = []
    for k in np.flatnonzero(np.isfinite(plane.denominator_error)):
        normal = exact_cross(*(exact_minus(corners[i, :, k], corners[0, :, k]) for i in (1, 2)))
        true = exact_dot(as_fractions(direction[:, k]), normal)
        off = abs(Fraction(float(plane.denominator[k])) - true)
        shares.append(float(off / Fraction(float(plane.denominator_error[k]))))
    assert max(shares) <= 1
    assert max(shares) > 1 / 64


def exact_plane_distance(origin, direction, corners):
    normal = exact_cross(exact_minus(corners[1], corners[0]), exact_minus(corners[2], corners[0]))
    return exact_dot(exact_minus(corners[0], origin), normal) / exact_dot(as_fractions(direction), normal)


def test_refined_distance_is_half_an_ulp_on_well_shaped_triangles(rng):
    origin, direction, corners = make_cases(rng, 1.0, 1.0)
    t, error = refine.divide_determinants(origin, direction, *corners)
    assert np.median(error / np.spacing(np.abs(t))) <= 0.51


@pytest.mark.parametrize("distance", [1.0, 1e4, 1e8])
@pytest.mark.parametrize("radius", [1.0, 1e-3, 1e3])
def test_sphere_roots_are_within_their_bounds(rng, distance, radius):
    count = 100
    origin = rng.normal(size=(3, count)) * distance
    centre = rng.normal(size=(3, count))
    sideways = rng.normal(size=(3, count))
    direction = centre + radius * rng.random(count) * sideways / np.linalg.norm(sideways, axis=0) - origin
    radii = np.full(count, radius)
    roots = filtered.intersect_sphere_certified(direction, centre - origin, radii)
    refined, refined_error = refine.sphere_distance(origin, direction, centre, radii, roots.near)
    certain = 0
    for k in range(count):
        integers, _ = exact.to_integers([*origin[:, k], *centre[:, k], radius])
        heading, heading_exponent = exact.to_integers(direction[:, k])
        hit = exact.intersect_sphere(tuple(integers[:3]), tuple(heading), tuple(integers[3:6]), integers[6])
        if roots.discriminant[k] < -roots.discriminant_error[k]:
            assert hit is None
        if not roots.discriminant[k] > roots.discriminant_error[k]:
            continue
        assert hit is not None
        _, exponent = exact.to_integers([*origin[:, k], *centre[:, k], radius])
        pairs = [(roots.near[k], roots.error[k], hit[0]), (roots.far[k], roots.error[k], hit[1])]
        pairs.append((refined[k], refined_error[k], hit[0]))
        for t, error, root in pairs:
            if np.isfinite(error):
                certain += 1
                assert_within(float(t), float(error), root, heading_exponent - exponent)
    assert certain > 2 * count


@pytest.mark.parametrize("distance", [1.0, 1e4, 1e8])
def test_discriminant_is_within_its_bound(rng, distance):
    origin, centre = rng.normal(size=(3, 200)) * distance, rng.normal(size=(3, 200))
    radius = rng.random(200) + 0.1
    direction = centre + radius * rng.normal(size=(3, 200)) / 2 - origin
    to_centre = centre - origin
    roots = filtered.intersect_sphere_certified(direction, to_centre, radius)
    shares = []
    for k in range(200):
        away, d = exact_minus(centre[:, k], origin[:, k]), as_fractions(direction[:, k])
        offset = exact_cross(away, d)
        true = Fraction(float(radius[k])) ** 2 * exact_dot(d, d) - exact_dot(offset, offset)
        off = abs(Fraction(float(roots.discriminant[k])) - true)
        shares.append(float(off / Fraction(float(roots.discriminant_error[k]))))
    assert max(shares) <= 1
    assert max(shares) > 1 / 64


def assert_within(t, error, root, exponent):
    """|t - root / 2^exponent| <= error, by exact comparison with both ends of the interval."""
    scale = Fraction(2) ** exponent
    for end, side in ((Fraction(t) + Fraction(error), 1), (Fraction(t) - Fraction(error), -1)):
        scaled = end * scale
        bound = exact.Root(scaled.numerator, 0, 0, scaled.denominator)
        assert side * exact.compare(bound, root) >= 0


@pytest.mark.parametrize("size", [1.0, 1e-40, 1e40])
def test_pairs_of_floats_are_within_their_bounds(rng, size):
    x, y, z, w = (values * size for values in rng.normal(size=(4, 200)) * 10.0 ** rng.integers(-8, 8, size=(4, 200)))
    one, other = dd.two_product(x, y), dd.two_product(z, w)
    results = {"+": dd.add(one, other), "-": dd.subtract(one, other), "*": dd.multiply(one, other)}
    for k in range(200):
        p, q = (Fraction(float(pair[0][k])) + Fraction(float(pair[1][k])) for pair in (one, other))
        assert p == Fraction(float(x[k])) * Fraction(float(y[k]))
        truths = {"+": (p + q, dd.SUM_BOUND * (abs(p) + abs(q))), "-": (p - q, dd.SUM_BOUND * (abs(p) + abs(q)))}
        truths["*"] = (p * q, dd.PRODUCT_BOUND * abs(p * q))
        for name, (true, bound) in truths.items():
            got = Fraction(float(results[name][0][k])) + Fraction(float(results[name][1][k]))
            assert abs(got - true) <= Fraction(bound)


def test_refined_signs_equal_exact_signs(rng):
    origin, direction, corners = make_cases(rng, 1.0, 1e-12)
    sign, certain = refine.edge_sign(origin, direction, corners[0], corners[1])
    for k in range(sign.size):
        relative = [exact_minus(corner[:, k], origin[:, k]) for corner in corners[:2]]
        true = exact_dot(as_fractions(direction[:, k]), exact_cross(*relative))
        assert sign[k] == (certain[k] and (true > 0) - (true < 0))
    assert certain.mean() > 0.9


def test_surds_compare_as_their_values():
    """(3 - sqrt 2) / 2 < 4 / 5 < (1 + sqrt 3) / 3 < (3 + sqrt 2) / 2, and equal numbers in other clothes."""
    roots = [exact.Root(3, -1, 2, 2), exact.Root(4, 0, 0, 5), exact.Root(1, 1, 3, 3), exact.Root(3, 1, 2, 2)]
    for i, one in enumerate(roots):
        for j, other in enumerate(roots):
            assert exact.compare(one, other) == (i > j) - (i < j)
    assert exact.compare(exact.Root(6, -1, 8, 4), roots[0]) == 0
    assert exact.compare(exact.Root(0, 1, 4, 1), exact.Root(2, 0, 0, 1)) == 0


def test_caster_is_the_lectures_triangle_and_sphere(rng):
    """The fast twins against `lecture.intersect_triangle` and `lecture.intersect_sphere` on well-shaped cases."""
    corners = rng.normal(size=(200, 3, 3))
    origins, directions = rng.normal(size=(200, 3)) * 4, rng.normal(size=(200, 3))
    directions[:150] = corners[:150].mean(axis=1) - origins[:150]
    for k in range(200):
        scene = raytracer.Scene(meshes=[raytracer.Mesh(corners[k], [[0, 1, 2]])])
        hits = raytracer.build(scene).closest_hit(origins[k], directions[k])
        t, beta, gamma = lecture.intersect_triangle(origins[k], directions[k], *corners[k])
        assert hits.hit[0] == np.isfinite(t)
        if hits.hit[0]:
            found = [hits.distance[0], *hits.barycentric[0]]
            np.testing.assert_allclose(found, [t, beta, gamma], rtol=1e-9, atol=1e-12)
        sphere = raytracer.Scene(spheres=raytracer.Spheres(corners[k, :1], [0.5]))
        hits = raytracer.build(sphere).closest_hit(origins[k], directions[k])
        near = lecture.intersect_sphere(origins[k], directions[k], corners[k, 0], 0.5)[0]
        if np.isfinite(near) and near >= 0:
            np.testing.assert_allclose(hits.distance[0], near, rtol=1e-9)
        elif not np.isfinite(near):
            assert not hits.hit[0]
