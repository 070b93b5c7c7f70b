"""Ray casting in exact integer arithmetic, for the few rays that floating point cannot decide.

Every finite float64 is an integer times a power of two; brought to one exponent, a ray and its candidates are
integers, and all the quantities of `filtered` are integer polynomials in them. Nothing is rounded, so nothing is
uncertain. About 20 microseconds per ray and triangle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from functools import cmp_to_key
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Vector = tuple[int, int, int]

# Half of it is no float64: a number that underflows is off by less than this.
LEAST_FLOAT = math.ulp(0.0)


class Root(NamedTuple):
    """The number (rational + sign sqrt(radicand)) / scale with scale > 0: a triangle's t has radicand 0."""

    rational: int
    sign: int
    radicand: int
    scale: int


def sign_of_surd(rational: int, factor: int, radicand: int) -> int:
    """Sign of rational + factor sqrt(radicand), radicand >= 0."""
    left = (rational > 0) - (rational < 0)
    right = ((factor > 0) - (factor < 0)) if radicand else 0
    if left == right or right == 0:
        return left
    if left == 0:
        return right
    difference = rational * rational - factor * factor * radicand
    return left * ((difference > 0) - (difference < 0))


def compare(one: Root, other: Root) -> int:
    """Sign of one - other, exactly.

    With x = a1 c2 - a2 c1, p = s1 c2 sqrt(n1), q = s2 c1 sqrt(n2): sign(x + p - q). If x and p - q do not agree in
    sign, squares decide: (p - q)^2 = p^2 + q^2 - 2 s1 s2 c1 c2 sqrt(n1 n2) against x^2 is again a surd.
    """
    x = one.rational * other.scale - other.rational * one.scale
    p, q = one.sign * other.scale, other.sign * one.scale
    n, m = one.radicand, other.radicand
    if not m or not q:
        return sign_of_surd(x, p, n)
    if not n or not p:
        return sign_of_surd(x, -q, m)
    left = (x > 0) - (x < 0)
    surds = p * abs(p) * n - q * abs(q) * m
    right = (surds > 0) - (surds < 0)
    if left == right or right == 0:
        return left
    if left == 0:
        return right
    return left * sign_of_surd(x * x - p * p * n - q * q * m, 2 * p * q, n * m)


_ORDER = cmp_to_key(compare)


def to_integers(values: Sequence[float]) -> tuple[list[int], int]:
    """Return integers and one exponent e with value = integer * 2^e for all finite floats given."""
    ratios = [float(value).as_integer_ratio() for value in values]
    shift = max(denominator.bit_length() - 1 for _, denominator in ratios)
    return [number << (shift - denominator.bit_length() + 1) for number, denominator in ratios], -shift


def _cross(p: Vector, q: Vector) -> Vector:
    return (p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0])


def _dot(p: Vector, q: Vector) -> int:
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2]


def _vector(numbers: Sequence[int], first: int) -> Vector:
    return (numbers[first], numbers[first + 1], numbers[first + 2])


def _minus(p: Sequence[int], q: Sequence[int]) -> Vector:
    return (p[0] - q[0], p[1] - q[1], p[2] - q[2])


class TriangleHit(NamedTuple):
    """An exact hit: t in units of the integers' scale, and the edge functions, all with positive sum."""

    t: Root
    edges: tuple[int, int, int]


def intersect_triangle(origin: Vector, direction: Vector, corners: Sequence[Vector]) -> TriangleHit | None:
    """Exact closed-set test of a line and a triangle in integers; None = miss (also D = 0: coplanar or no area)."""
    p, q, r = (_minus(corner, origin) for corner in corners)
    edges = (_dot(direction, _cross(q, r)), _dot(direction, _cross(r, p)), _dot(direction, _cross(p, q)))
    denominator = sum(edges)
    if denominator == 0 or (max(edges) > 0 and min(edges) < 0):
        return None
    numerator = _dot(p, _cross(q, r))  # (a - o) . N = P . (Q x R)
    if denominator < 0:
        numerator, denominator = -numerator, -denominator
        edges = (-edges[0], -edges[1], -edges[2])
    return TriangleHit(Root(numerator, 0, 0, denominator), edges)


def intersect_sphere(origin: Vector, direction: Vector, centre: Vector, radius: int) -> tuple[Root, Root] | None:
    """Exact roots of A t^2 - 2 b t + C = 0, ascending; None = the line misses; equal = tangent."""
    to_centre = _minus(centre, origin)
    quadratic, half_linear = _dot(direction, direction), _dot(to_centre, direction)
    radicand = half_linear * half_linear - quadratic * (_dot(to_centre, to_centre) - radius * radius)
    if radicand < 0:
        return None
    return Root(half_linear, -1, radicand, quadratic), Root(half_linear, 1, radicand, quadratic)


def root_to_float(root: Root) -> tuple[float, float]:
    """Return the nearest float64 of a root and a bound on its error.

    A rational root is one correctly rounded integer division: half a unit in the last place. A surd is first bounded
    by an integer square root with 128 extra bits, then divided the same way.
    """
    numerator, scale = root.rational, root.scale
    if root.radicand:
        shift = 128 + root.scale.bit_length() + abs(root.rational).bit_length()
        numerator = (numerator << shift) + root.sign * math.isqrt(root.radicand << (2 * shift))
        scale <<= shift
    try:
        value = numerator / scale
    except OverflowError:
        return (math.inf if numerator > 0 else -math.inf), math.inf
    # A surd's integer square root is low by less than 1 / scale before rounding: far below the second half unit.
    error = math.ulp(value) * (0.5 if not root.radicand else 0.5 + 2.0**-40)
    return value, max(error, LEAST_FLOAT) if numerator else 0.0


class ExactHit(NamedTuple):
    """The decided closest hit of one ray: which candidate (-1 = miss), t with its bound, weights of corners b and c."""

    chosen: int
    t: float
    t_error: float
    barycentric: tuple[float, float]


MISS = ExactHit(-1, math.inf, 0.0, (0.0, 0.0))


class Behind(NamedTuple):
    """What lies behind a ray, for its k candidates.

    corners, spheres : (1, 3, 3) or (1, 4) float64, the primitive that the ray has met last; none: (0, ...)
    high : its distance is no more than that; of two roots in question it is the far one
    later : (k,) bool, the candidate counts also at the same distance as that
    reach, barred : up to this distance, candidates marked in (k,) do not count
    """

    corners: NDArray[np.float64]
    spheres: NDArray[np.float64]
    high: float
    later: Sequence[bool]
    reach: float
    barred: Sequence[bool]


NOTHING_BEHIND = Behind(np.zeros((0, 3, 3)), np.zeros((0, 4)), -math.inf, (), -math.inf, ())


def _scaled_bound(value: float, exponent: int) -> Root | None:
    """A bound of the ray's range as a Root in the integers' units of t; None = infinite."""
    if math.isinf(value):
        return None
    ratio = Fraction(value) * (Fraction(2) ** exponent)
    return Root(ratio.numerator, 0, 0, ratio.denominator)


def _inside(t: Root, low: Root | None, high: Root | None) -> bool:
    return (low is None or compare(t, low) >= 0) and (high is None or compare(t, high) <= 0)


def closest_candidate(
    origin: Sequence[float],
    direction: Sequence[float],
    t_min: float,
    t_max: float,
    corners: NDArray[np.float64],
    spheres: NDArray[np.float64],
    rank: Sequence[int] | None = None,
    behind: Behind = NOTHING_BEHIND,
) -> ExactHit:
    """Decide the closest of a ray's candidates exactly.

    Parameters
    ----------
    corners : (k, 3, 3) float64, triangles
    spheres : (l, 4) float64, centre and radius; they are numbered after all triangles
    t_min, t_max : inclusive range; infinite bounds are none
    rank : (k + l,) the lowest of equals wins; None: the first
    behind : what candidates must lie beyond
    """
    # Positions share one exponent, the direction has its own: t = T / D is then off by 2^(position - direction).
    shapes = np.concatenate([part.ravel() for part in (corners, behind.corners, spheres, behind.spheres)]).tolist()
    points, point_exponent = to_integers([*origin, *shapes])
    ray_direction, direction_exponent = to_integers(direction)
    exponent = direction_exponent - point_exponent
    if t_min == math.inf or t_max < t_min:
        return MISS
    line = (_vector(points, 0), _vector(ray_direction, 0))
    low, high = _scaled_bound(t_min, exponent), _scaled_bound(t_max, exponent)
    triangles, balls = _meet_all(line, points[3:], len(corners) + len(behind.corners))
    met = triangles[len(corners) :] + balls[len(spheres) :]
    last = _find_last(met[0], _scaled_bound(behind.high, exponent)) if met else None
    reach = _scaled_bound(behind.reach, exponent)
    found: list[tuple[Root, int, Vector]] = []
    for index, (roots, edges) in enumerate(triangles[: len(corners)] + balls[: len(spheres)]):
        for root in roots:
            if not _inside(root, low, high):
                continue
            if last is not None and compare(root, last) < (0 if behind.later[index] else 1):
                continue
            if reach is not None and behind.barred and behind.barred[index] and compare(root, reach) <= 0:
                continue
            found.append((root, index, edges))
            break
    if not found:
        return MISS
    place = {index: index if rank is None else rank[index] for _, index, _ in found}
    t, index, edges = min(sorted(found, key=lambda hit: place[hit[1]]), key=lambda hit: _ORDER(hit[0]))
    value, error = root_to_float(_unscale(t, exponent))
    total = sum(edges)
    return ExactHit(index, value, error, (edges[1] / total, edges[2] / total))


# Where a line meets a shape, ascending, and the edge functions there.
_Met = tuple[tuple[Root, ...], Vector]


def _meet_all(line: tuple[Vector, Vector], numbers: list[int], triangle_count: int) -> tuple[list[_Met], list[_Met]]:
    """Return where a line meets so many triangles, 9 numbers each, and the spheres after them, 4 each."""
    triangles: list[_Met] = []
    for first in range(0, 9 * triangle_count, 9):
        hit = intersect_triangle(*line, [_vector(numbers, first + 3 * corner) for corner in range(3)])
        triangles.append(((), (1, 0, 0)) if hit is None else ((hit.t,), hit.edges))
    balls: list[_Met] = []
    for first in range(9 * triangle_count, len(numbers), 4):
        roots = intersect_sphere(*line, _vector(numbers, first), numbers[first + 3])
        balls.append((roots or (), (1, 0, 0)))
    return triangles, balls


def _find_last(met: _Met, high: Root | None) -> Root | None:
    """Return where a ray has met a shape last: its last root up to `high`; None where exactly it does not meet it."""
    roots = [root for root in met[0] if high is None or compare(root, high) <= 0]
    return roots[-1] if roots else None


def _unscale(t: Root, exponent: int) -> Root:
    """Return t in the ray's own units: divided by 2^exponent."""
    if exponent >= 0:
        return t._replace(scale=t.scale << exponent)
    return t._replace(rational=t.rational << -exponent, radicand=t.radicand << (-2 * exponent) if t.radicand else 0)


def _sign(value: int) -> int:
    return (value > 0) - (value < 0)


def _first_sign(vector: Vector) -> int:
    """Sign of vector . (e, e^2, e^3) for an infinitely small e > 0: that of the first component that is not zero."""
    return _sign(vector[0]) or _sign(vector[1]) or _sign(vector[2])


def meets_at_one_place(origin: Sequence[float], direction: Sequence[float], corners: NDArray[np.float64]) -> bool:
    """Does the line meet two triangles (2, 3, 3), both of which it hits, in one point? Exact."""
    points, _ = to_integers([*origin, *corners.ravel().tolist()])
    heading = _vector(to_integers(direction)[0], 0)
    one, other = (
        intersect_triangle(_vector(points, 0), heading, [_vector(points, first + step) for step in (0, 3, 6)])
        for first in (3, 12)
    )
    return one is not None and other is not None and compare(one.t, other.t) == 0


def crosses(origin: Sequence[float], direction: Sequence[float], corners: NDArray[np.float64]) -> bool:
    """Does the ray from `origin`, moved by (e, e^2, e^3), cross the triangle (3, 3)? Exact.

    Moving the origin by e changes E(p, q) by e . (d x (q - p)) and T by -e . N, and D not at all; where the unmoved
    value is zero, that is its sign.
    """
    points, _ = to_integers([*origin, *corners.ravel().tolist()])
    heading = _vector(to_integers(direction)[0], 0)
    start = _vector(points, 0)
    a, b, c = (_minus(_vector(points, first), start) for first in (3, 6, 9))
    normal = _cross(_minus(b, a), _minus(c, a))
    denominator = _sign(_dot(heading, normal))
    if denominator == 0:
        return False
    for p, q in ((b, c), (c, a), (a, b)):
        side = _sign(_dot(heading, _cross(p, q))) or _first_sign(_cross(heading, _minus(q, p)))
        if side != denominator:
            return False
    ahead = _sign(_dot(a, normal)) or -_first_sign(normal)
    return ahead == denominator
