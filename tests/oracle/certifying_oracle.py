"""The exact oracle for millions of rays: float64 certifies what is obvious, integers decide the rest.

Two filters, each with its own error bound, stand before `exact_oracle`. The first tests all rays against all triangles
by matrix products in Pluecker coordinates: with m = o x d, l = q - p and n = p x q, the edge function is

    E(p, q) = d . ((p - o) x (q - o)) = d . n + m . l

A line meets a triangle if its three edge functions agree in sign, and passes it if two disagree. The second computes
t = (a - o) . N / (d . N) of the pairs that are left in long double (64 bits of mantissa where the machine has them).
A ray is *certified* if no triangle can be hit, or if one is hit beyond doubt and before all others; every other ray,
and every distance whose reported bound the long double cannot confirm, is judged by integers. Nothing here imports or
repeats the ray tracer's own bounds.

Bounds, u the unit roundoff of the arithmetic in use, to first order in u (n u / (1 - n u) < (n + 1) u here):

    E   an n or m has 3 roundings, an l has 1, a sum of six products in any order and with or without fused operations
        6 (Higham, *Accuracy and Stability of Numerical Algorithms*, 2002, section 3.1): at most 9 u times the sum of
        the terms' magnitudes
    T, D   differences 2 or 3 to a term, products 2, sums 3: at most 8 u times the terms' magnitudes
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tests.oracle import exact_oracle
from tests.oracle.exact_numbers import is_within
from tests.oracle.judging import assert_miss_is_data

# 9 u and 8 u, rounded up: for second order terms, and because the sums of magnitudes are rounded themselves.
SIDE_BOUND = 12 * 2.0**-53
LONG_ROUNDOFF = np.finfo(np.longdouble).eps / 2
DETERMINANT_BOUND = 12 * LONG_ROUNDOFF
# Sums of magnitudes below this may have lost something to underflow.
FLOOR = 2.0**-300
# Pairs of a block's (rays, 3 triangles) matrix: 8 MB.
PAIRS_PER_BLOCK = 1 << 20


class Certificate(NamedTuple):
    """What the filters know of n rays: the triangle hit first (-1 = none, UNKNOWN = undecided), t and its bound."""

    index: np.ndarray
    t: np.ndarray
    t_error: np.ndarray


UNKNOWN = -2


def _cross_magnitude(p, q):
    """The cross product with every term's absolute value."""
    p, q = np.abs(p), np.abs(q)
    return np.stack([p[..., i] * q[..., j] + p[..., j] * q[..., i] for i, j in ((1, 2), (2, 0), (0, 1))], axis=-1)


def side_products(origins, directions, corners):
    """Return the edge functions (3, n, t) opposite a, b, c, and one error bound per ray (n, 1)."""
    moment, moment_size = np.cross(origins, directions), _cross_magnitude(origins, directions)
    sides, size_n, size_l = [], [], []
    for one, other in ((1, 2), (2, 0), (0, 1)):
        p, q = corners[:, one], corners[:, other]
        sides.append(np.concatenate([np.cross(p, q), q - p], axis=1).T)
        size_n.append(_cross_magnitude(p, q).max(axis=0))
        size_l.append(np.abs(q - p).max(axis=0))
    size = np.abs(directions) @ np.max(size_n, axis=0) + moment_size @ np.max(size_l, axis=0)
    bound = np.where(size > FLOOR, SIDE_BOUND * size, np.inf)
    return np.matmul(np.concatenate([directions, moment], axis=1), np.stack(sides)), bound[:, np.newaxis]


def plane_distances(origins, directions, corners):
    """Return t and its error bound, (k,) long double, of k rays with the planes of k triangles; NaN if unknown."""
    origins, directions, corners = (array.astype(np.longdouble) for array in (origins, directions, corners))
    a = corners[:, 0]
    side_b, side_c, relative = corners[:, 1] - a, corners[:, 2] - a, a - origins
    normal, normal_size = np.cross(side_b, side_c), _cross_magnitude(side_b, side_c)
    numerator, numerator_size = (relative * normal).sum(axis=1), (np.abs(relative) * normal_size).sum(axis=1)
    denominator, denominator_size = (directions * normal).sum(axis=1), (np.abs(directions) * normal_size).sum(axis=1)
    numerator_error, denominator_error = DETERMINANT_BOUND * numerator_size, DETERMINANT_BOUND * denominator_size
    room = np.abs(denominator) - denominator_error
    known = (room > 0) & (denominator_size > FLOOR) & (numerator_size > FLOOR)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        t = numerator / denominator
        error = (numerator_error + np.abs(t) * denominator_error) / room + LONG_ROUNDOFF * np.abs(t)
    # Its own five roundings.
    return np.where(known, t, np.nan), np.where(known, error * (1 + 8 * LONG_ROUNDOFF), np.nan)


def certify(origins, directions, corners):
    """Return the Certificate of rays (n, 3) from t = 0 on, with triangles (t, 3, 3)."""
    step = max(1, PAIRS_PER_BLOCK // len(corners))
    blocks = [slice(first, first + step) for first in range(0, len(origins), step)]
    certificates = [_certify_block(origins[block], directions[block], corners) for block in blocks]
    return Certificate(*(np.concatenate(column) for column in zip(*certificates, strict=True)))


def _certify_block(origins, directions, corners):
    edges, bound = side_products(origins, directions, corners)
    highest, lowest = edges.max(axis=0), edges.min(axis=0)
    ray, triangle = np.nonzero((highest <= bound) | (lowest >= -bound))
    highest, lowest, bound = highest[ray, triangle], lowest[ray, triangle], bound[ray, 0]
    t, error = plane_distances(origins[ray], directions[ray], corners[triangle])
    with np.errstate(invalid="ignore"):
        low, high = t - error, t + error
    ahead = ~(high < 0)  # also where nothing is known
    sure = ((lowest > bound) | (highest < -bound)) & (low >= 0)
    low = np.where(np.isnan(low), -np.inf, low)
    ray, triangle, t, error, low, high, sure = (x[ahead] for x in (ray, triangle, t, error, low, high, sure))
    return _first_of_rays(len(origins), ray, triangle, t, error, low, high, sure)


def _first_of_rays(count, ray, triangle, t, error, low, high, sure):
    """The Certificate of `count` rays from the pairs that may be hit."""
    order = np.lexsort((low, ray))
    ray, triangle, t, error, low, high, sure = (x[order] for x in (ray, triangle, t, error, low, high, sure))
    index = np.full(count, -1, dtype=np.int64)
    distance, distance_error = np.full(count, np.inf, np.longdouble), np.zeros(count, np.longdouble)
    first = np.flatnonzero(np.concatenate([[True], ray[1:] != ray[:-1]])) if len(ray) else np.zeros(0, np.intp)
    following = np.append(low, np.inf)[first + 1]
    alone = np.append(ray, -1)[first + 1] != ray[first]
    with np.errstate(invalid="ignore"):
        decided = sure[first] & (alone | (high[first] < following))
    index[ray[first]] = np.where(decided, triangle[first], UNKNOWN)
    distance[ray[first]], distance_error[ray[first]] = t[first], error[first]
    return Certificate(index, distance, distance_error)


def judge_many(caster, origins, directions):
    """Compare the closest and any hits of a scene of meshes with exact arithmetic; return how many took integers."""
    hits = caster.closest_hit(origins, directions)
    exact_scene = exact_oracle.pack_scene(caster.scene)
    certificate = certify(origins, directions, exact_scene.corners)
    index = certificate.index.copy()
    # A distance is confirmed if the whole interval of the long double lies within its reported bound; the sum's own
    # roundings are made up for by one more u of the largest term.
    with np.errstate(invalid="ignore"):
        off = np.abs(hits.distance.astype(np.longdouble) - certificate.t)
        off += certificate.t_error + 4 * LONG_ROUNDOFF * off
    confirmed = (index == -1) | ((index >= 0) & (off <= hits.distance_error))
    left = np.flatnonzero(~confirmed)
    exact = exact_oracle.closest_hit(origins[left], directions[left], exact_scene.corners)
    known = index[left] != UNKNOWN
    np.testing.assert_array_equal(exact.index[known], index[left][known], err_msg="the oracle contradicts itself")
    index[left] = exact.index
    np.testing.assert_array_equal(hits.instance, np.append(exact_scene.instance, -1)[index])
    np.testing.assert_array_equal(hits.primitive, np.append(exact_scene.primitive, -1)[index])
    assert_miss_is_data(hits, index == -1)
    for ray, t in zip(left, exact.distance, strict=True):
        assert t is None or is_within(hits.distance[ray], hits.distance_error[ray], t), f"ray {ray}: not {t}"
    np.testing.assert_array_equal(caster.any_hit(origins, directions), hits.hit)
    return len(left)
