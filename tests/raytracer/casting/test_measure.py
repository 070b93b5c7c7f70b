"""Hits are measured with the bits of the formulas as `predicates` and `refine` state them."""

from dataclasses import replace

import numpy as np
import pytest

import raytracer
from raytracer.casting.brute_force import offer_all
from raytracer.casting.measure import measure_block
from raytracer.casting.query import Query
from raytracer.casting.rays import make_rays
from raytracer.predicates import double_double as dd
from raytracer.predicates import filtered
from raytracer.predicates.refine import correct_distance
from raytracer.predicates.rounding import UNIT_ROUNDOFF, gamma
from tests.meshes import make_icosphere, make_soup


def correct_distance_plainly(origin, direction, a, b, c):
    """`refine.correct_distance` as its docstring derives it, one operation a line."""
    start, rest = dd.two_difference(a, origin)
    normal = filtered.cross(b - a, c - a)
    sizes = filtered.cross_permanent(np.abs(b - a), np.abs(c - a))
    denominator = filtered.dot(direction, normal)
    t = dd.split(filtered.dot(start, normal) / denominator)[0]
    upper, lower = dd.split(direction)
    residual = (start - t * upper) + (rest - t * lower)
    correction = filtered.dot(normal, residual) / denominator
    refined = t + correction
    denominator_error = filtered.DENOMINATOR_BOUND * filtered.dot(np.abs(direction), sizes)
    room = np.abs(denominator) - denominator_error
    reach = gamma(10) * np.abs(residual) + 3 * 2.0**-26 * UNIT_ROUNDOFF * np.abs(start)
    underflow = filtered.UNDERFLOW * (1 + (sizes + np.abs(residual)).sum(axis=0))
    share = np.abs(correction) * (denominator_error + 4 * UNIT_ROUNDOFF * np.abs(denominator))
    error = (filtered.dot(sizes, reach) + underflow + share) / room
    half_ulp = np.maximum(np.spacing(np.abs(refined)) / 2, np.finfo(np.float64).smallest_subnormal)
    error = (half_ulp + error) * (1 + 16 * UNIT_ROUNDOFF)
    usable = (denominator_error > filtered.SMALLEST_PERMANENT) & (room > 0)
    return refined, np.where(usable, error, np.inf)


def weigh_plainly(origin, direction, a, b, c):
    slope = direction[:2] / direction[2]
    edges = filtered.edge_functions(*(filtered.shear(corner - origin, slope) for corner in (a, b, c)))
    weights = np.stack(edges[1:], axis=1) / (edges[0] + edges[1] + edges[2])[:, None]
    return np.clip(np.nan_to_num(weights), 0.0, 1.0)


@pytest.mark.parametrize("scale", [1e-310, 1e-300, 1e-160, 1e-100, 1.0, 1e12, 1e100, 1e155, 1e300])
@pytest.mark.parametrize("flat", [False, True])
def test_measured_blocks_have_the_bits_of_the_plain_formulas(rng, scale, flat):
    corners = rng.normal(size=(3, 3, 4000)) * scale
    lines = np.concatenate([rng.normal(size=(3, 4000)) * scale, rng.normal(size=(5, 4000))])
    if flat:
        corners[2] = corners[0] + (corners[1] - corners[0]) * rng.random(4000)
        corners[0, :, ::5] = lines[:3, ::5]
        lines[3:6, ::3] = np.round(lines[3:6, ::3])
    with np.errstate(all="ignore"):
        lines[6:] = lines[3:5] / lines[5]
        measured = measure_block(lines, corners)
        distance, error = correct_distance_plainly(lines[:3], lines[3:6], *corners)
        weights = weigh_plainly(lines[:3], lines[3:6], *corners)
    for name, plain in (("distance", distance), ("error", error), ("weights", weights)):
        np.testing.assert_array_equal(getattr(measured, name), plain, err_msg=name)


def test_measuring_leaves_its_arguments_alone(rng):
    lines, corners = rng.normal(size=(8, 50)), rng.normal(size=(3, 3, 50))
    arguments = lines.copy(), corners.copy()
    measure_block(*arguments)
    correct_distance(arguments[0][:3], arguments[0][3:6], *arguments[1])
    np.testing.assert_array_equal(arguments[0], lines)
    np.testing.assert_array_equal(arguments[1], corners)


@pytest.mark.parametrize("precision", ["certified", "float64", "float32"])
def test_hits_do_not_depend_on_the_order_in_which_they_were_found(rng, precision):
    spheres = raytracer.Spheres(rng.normal(size=(9, 3)), np.full(9, 0.4))
    meshes = [raytracer.Mesh(*make_icosphere(1)), raytracer.Mesh(*make_soup(rng, 40))]
    caster = replace(raytracer.build(raytracer.Scene(meshes=meshes, spheres=[spheres]), precision), offer=offer_all)
    origins = rng.normal(size=(700, 3)) * 3
    rays = make_rays(origins, rng.normal(size=(700, 3)) * 0.5 - origins)
    query = Query(caster.primitives, rays, any_hit=False)
    offer_all(query)
    true = query.closest()
    triangle = np.flatnonzero(true.hit & (true.instance < 2))
    ids = caster.geometry.first_id[true.instance[triangle]] + true.primitive[triangle]
    settled = Query(caster.primitives, rays, any_hit=False)
    order = rng.permutation(len(triangle))
    for part in (order[::2], order[1::2]):
        settled.settle(triangle[part], ids[part])
    hits = settled.closest()
    for name in ("distance", "distance_error", "instance", "primitive", "barycentric"):
        np.testing.assert_array_equal(getattr(hits, name)[triangle], getattr(true, name)[triangle], err_msg=name)
    assert hits.hit.sum() == len(triangle) > 200
