"""Certified hits equal exact arithmetic on generated scenes: any scale, offset, direction, tie and degeneracy.

Triangles and spheres of hypothesis are small, often degenerate or coinciding, scaled by 1e-30 to 1e30 and moved away;
rays are aimed at corners, at edges or anywhere, with zeros of both signs, denormals and huge numbers among the
components. Beside the comparison with integers stand properties that need no oracle.
"""

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import raytracer
from tests.oracle import exact_oracle
from tests.oracle.exact_numbers import round_to_float
from tests.oracle.judging import ACCELERATORS, assert_same_hits, build_with, judge_hits

# Derandomised: the quick tier runs the same examples every time.
PROPERTY = settings(max_examples=200, deadline=None, derandomize=True)

# Few different numbers make edges, planes and distances coincide; any numbers do not.
round_numbers = st.sampled_from([-2.0, -1.0, -0.5, -0.0, 0.0, 0.25, 1.0, 1.0 + 2.0**-52, 2.0, 3.0])
any_numbers = st.floats(-3, 3, allow_subnormal=False).filter(lambda x: x == 0 or abs(x) > 1e-30)
numbers = st.one_of(round_numbers, any_numbers)
points = st.tuples(numbers, numbers, numbers)
triangles = st.tuples(points, points, points)
spheres = st.tuples(points, st.sampled_from([0.5, 1.0, 1.5, 0.1]))
scales = st.sampled_from([1.0, 1e-30, 1e-10, 2.0**-7, 1e10, 1e30])
components = st.one_of(numbers, st.sampled_from([0.0, -0.0, 5e-324, -1e-310, 1e-300, -1e-30, 1e-8, 1e30, -1e100]))
rays = st.tuples(points, st.sampled_from(["free", "corner", "edge"]), st.tuples(components, components, components))


@st.composite
def scenes_and_rays(draw, components=None, offsets=(0.0, 1.0, 1e6), spheres=spheres):
    """Corners (t, 3, 3), centres (s, 3), radii (s,), origins and directions (n, 3); every array float64."""
    scale, offset = draw(scales), draw(st.sampled_from(offsets))
    corners = np.array(draw(st.lists(triangles, min_size=1, max_size=5)))
    balls = draw(st.lists(spheres, max_size=2))
    shot = draw(st.lists(rays, min_size=1, max_size=4))
    corners = (corners + offset) * scale
    centres = (np.array([centre for centre, _ in balls]).reshape(-1, 3) + offset) * scale
    radii = np.array([radius for _, radius in balls]) * scale
    origins = (np.array([origin for origin, _, _ in shot]) + offset) * scale
    directions = np.array([direction for _, _, direction in shot])
    for ray, (_, aim, _) in enumerate(shot):
        a, b, _ = corners[ray % len(corners)]
        if aim != "free":
            directions[ray] = (a if aim == "corner" else a * 0.5 + b * 0.5) - origins[ray]
    return corners, centres, radii, origins, directions


def make_scene(corners, centres, radii, **content):
    groups = [raytracer.Spheres(centres, radii)] if len(radii) else []
    mesh = raytracer.Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    return raytracer.Scene(meshes=[mesh], spheres=groups, **content)


def cast(corners, centres, radii, origins, directions):
    return raytracer.build(make_scene(corners, centres, radii)).closest_hit(origins, directions)


def assert_same_distances(hits, expected):
    """Distances that agree within their bounds; 2^-50 makes up for the sums' own roundings."""
    near = np.isfinite(hits.distance)
    np.testing.assert_array_equal(near, np.isfinite(expected.distance))
    bound = (hits.distance_error + expected.distance_error)[near] * (1 + 2.0**-50)
    assert (np.abs(hits.distance[near] - expected.distance[near]) <= bound).all()


@PROPERTY
@given(scenes_and_rays())
def test_hits_of_generated_scenes_equal_exact_arithmetic(generated):
    scene, rays = make_scene(*generated[:3]), generated[3:]
    casters = [build_with(name, scene) for name in ACCELERATORS]
    hits = casters[0].closest_hit(*rays)
    judge_hits(casters[0], hits, *rays)
    for caster in casters:
        assert_same_hits(caster.closest_hit(*rays), hits)
        np.testing.assert_array_equal(caster.any_hit(*rays), hits.hit)
        np.testing.assert_array_equal(caster.crossings(*rays), exact_oracle.crossings(*rays, generated[0]))


@settings(PROPERTY, max_examples=80)
@given(scenes_and_rays(), st.sampled_from([-np.inf, None, np.inf]), st.sampled_from([-np.inf, None, np.inf]))
def test_ranges_of_generated_scenes_equal_exact_arithmetic(generated, low_side, high_side):
    """t_min and t_max at the first hit's distance, one float below it or one above."""
    scene, rays = make_scene(*generated[:3]), generated[3:]
    exact = exact_oracle.pack_scene(scene).closest_hit(*rays).distance
    t = np.array([0.0 if distance is None else round_to_float(distance) for distance in exact])
    low, high = (t if side is None else np.nextafter(t, side) for side in (low_side, high_side))
    casters = [build_with(name, scene) for name in ACCELERATORS]
    empty = ({"t_max": -np.inf}, {"t_min": np.inf}, {"t_min": -2.0, "t_max": -1.0})
    for ranges in ({"t_max": high}, {"t_min": low}, {"t_min": low, "t_max": high}, {"t_min": -1.0}, *empty):
        hits = casters[0].closest_hit(*rays, **ranges)
        judge_hits(casters[0], hits, *rays, **ranges)
        for caster in casters:
            assert_same_hits(caster.closest_hit(*rays, **ranges), hits)
            np.testing.assert_array_equal(caster.any_hit(*rays, **ranges), hits.hit)


@PROPERTY
@given(scenes_and_rays(), st.integers(-60, 60), st.integers(-60, 60))
def test_powers_of_two_scale_distances_exactly(generated, scene_exponent, direction_exponent):
    *places, directions = generated
    size = np.abs(directions[directions != 0])
    assume((size > 1e-250).all() and (size < 1e250).all())
    scaled = [array * 2.0**scene_exponent for array in places]
    hits = cast(*places, directions)
    expected = cast(*scaled, directions * 2.0**direction_exponent)
    exponent = scene_exponent - direction_exponent
    np.testing.assert_array_equal(hits.primitive, expected.primitive)
    np.testing.assert_array_equal(hits.instance, expected.instance)
    np.testing.assert_array_equal(np.ldexp(hits.distance, exponent), expected.distance)


@PROPERTY
@given(scenes_and_rays(), st.randoms(use_true_random=False))
def test_permuted_triangles_have_permuted_indices_with_ties_to_the_lowest(generated, random):
    corners, centres, radii, *rays = generated
    order = np.array(random.sample(range(len(corners)), len(corners)))
    scene = make_scene(corners[order], centres, radii)
    caster = raytracer.build(scene)
    hits, before = caster.closest_hit(*rays), cast(*generated)
    judge_hits(caster, hits, *rays)
    np.testing.assert_array_equal(hits.hit, before.hit)
    triangle = hits.instance == 0
    np.testing.assert_array_equal(triangle, before.instance == 0)
    same = ~triangle | (order[np.where(triangle, hits.primitive, 0)] == before.primitive)
    np.testing.assert_array_equal(hits.distance[same], before.distance[same])
    assert_same_distances(hits.select(~same), before.select(~same))


@PROPERTY
@given(scenes_and_rays())
def test_reversed_winding_changes_no_decision_and_no_distance(generated):
    corners, *others = generated
    hits, expected = cast(corners[:, [0, 2, 1]], *others), cast(corners, *others)
    for name in ("distance", "distance_error", "instance", "primitive"):
        np.testing.assert_array_equal(getattr(hits, name), getattr(expected, name))


@PROPERTY
@given(scenes_and_rays(), st.permutations([0, 1, 2]), st.tuples(*[st.sampled_from([1.0, -1.0])] * 3))
def test_turned_and_mirrored_worlds_have_the_same_hits(generated, axes, signs):
    """Exchanging and negating axes is exact: every decision stays, distances move within their bounds at most."""
    corners, centres, radii, origins, directions = generated
    turned = [(array[..., axes] * signs) for array in (corners, centres, origins, directions)]
    hits, expected = cast(turned[0], turned[1], radii, *turned[2:]), cast(*generated)
    np.testing.assert_array_equal(hits.instance, expected.instance)
    np.testing.assert_array_equal(hits.primitive, expected.primitive)
    assert_same_distances(hits, expected)


@PROPERTY
@given(scenes_and_rays())
def test_identity_instance_changes_nothing(generated):
    scene, rays = make_scene(*generated[:3]), generated[3:]
    instances = raytracer.Instances([0], [np.eye(4)])
    placed = raytracer.build(make_scene(*generated[:3], instances=instances))
    assert_same_hits(placed.closest_hit(*rays), raytracer.build(scene).closest_hit(*rays))
