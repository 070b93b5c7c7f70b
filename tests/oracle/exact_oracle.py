"""An exact ray caster by brute force: the judge of every accelerator, predicate and precision.

Every finite float64 is an integer times a power of two, so all coordinates are scaled to integers once and every
decision is made in integers (NumPy object arrays of Python ints). The triangle test is the determinant form of
Moeller and Trumbore, the sphere test the quadratic formula with its square root kept symbolic; it shares no code and no
formula with the ray tracer. A float64 filter first throws out pairs that are far from a hit, see `_may_hit_triangles`.

Semantics: triangles are closed sets (edges and vertices belong to both neighbours); a ray parallel to a triangle's
plane misses it, and so does every ray a triangle without area; t_min and t_max are inclusive, a negative t_min counts
as 0; the nearest exact t wins, ties go to the lowest index (triangles before spheres); a sphere is hit at its first
root of at least t_min, a tangent counts. NaN, infinite and zero-direction rays miss.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from tests.oracle.exact_numbers import Surd, round_to_float

# The filter's values carry fewer than 16 roundings of terms of which at most 6 times the bound are summed: their error
# is below 96 u = 2^-46.4 of the bound. Anything within 2^-40 goes to exact arithmetic.
FILTER_MARGIN = 2.0**-40
# Below this product of magnitudes underflow could matter; such pairs go to exact arithmetic.
FILTER_FLOOR = 1e-200
PAIRS_PER_BLOCK = 1 << 17


# Integers -----------------------------------------------------------------------------------------------------------


def _lowest_exponent(*arrays):
    """Return e such that every element of the arrays is an integer times 2^e."""
    exponents = [np.frexp(array[array != 0])[1] - 53 for array in arrays]
    return int(min((e.min() for e in exponents if e.size), default=0))


def _to_integers(values, exponent):
    """Return values / 2^exponent as an object array of Python ints."""
    mantissa, shift = np.frexp(values)
    digits = (mantissa * 2.0**53).astype(np.int64).astype(object)
    shifts = np.where(mantissa == 0, 0, shift - 53 - exponent).astype(object)
    return digits << shifts if digits.size else digits


def _dot(u, v):
    return u[..., 0] * v[..., 0] + u[..., 1] * v[..., 1] + u[..., 2] * v[..., 2]


def _cross(u, v):
    components = [u[..., i] * v[..., j] - u[..., j] * v[..., i] for i, j in ((1, 2), (2, 0), (0, 1))]
    return np.stack(components, axis=-1)


def _power_of_two(exponent):
    return Fraction(1 << exponent) if exponent >= 0 else Fraction(1, 1 << -exponent)


# Filter -------------------------------------------------------------------------------------------------------------


def _normalise(*arrays):
    """Scale arrays by one power of two so that the largest magnitude is in [0.5, 1); exact but for underflow."""
    largest = max((np.abs(array).max(initial=0.0) for array in arrays), default=0.0)
    return [np.ldexp(array, -int(np.frexp(largest)[1])) for array in arrays]


def _size(vectors):
    return np.abs(vectors).max(axis=-1)


def _may_hit_triangles(origins, directions, corners):
    """Return pairs (ray, triangle) that are not certainly beside the triangle.

    The three weights times D (edge functions) are computed in float64. A pair is dropped only if one is positive and
    another negative, each by more than FILTER_MARGIN times a bound on the sum of its terms' magnitudes.
    """
    a = corners[np.newaxis, :, 0]
    edge_b, edge_c = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    offset = origins[:, np.newaxis] - a
    direction = directions[:, np.newaxis]
    whole = _dot(direction, _cross(edge_b, edge_c))
    beta = -_dot(direction, _cross(offset, edge_c))
    gamma = _dot(direction, _cross(offset, edge_b))
    reach = np.maximum(_size(offset), np.maximum(_size(edge_b), _size(edge_c)))
    bound = _size(direction) * reach * np.maximum(_size(edge_b), _size(edge_c))
    positive, negative = np.zeros((2, *bound.shape), dtype=bool)
    # alpha D = D - beta D - gamma D sums three times as many terms.
    for value, terms in ((-whole - beta - gamma, 3), (beta, 1), (gamma, 1)):
        positive |= value > FILTER_MARGIN * terms * bound
        negative |= value < -FILTER_MARGIN * terms * bound
    return np.nonzero(~(positive & negative & (bound > FILTER_FLOOR)))


def _may_hit_spheres(origins, directions, centres, radii):
    """Return pairs (ray, sphere) whose line is not certainly farther from the centre than the radius."""
    offset = origins[:, np.newaxis] - centres
    direction = directions[:, np.newaxis]
    moment = _cross(offset, direction)
    squared = _dot(direction, direction)
    excess = _dot(moment, moment) - radii * radii * squared
    bound = squared * (_dot(offset, offset) + radii * radii)
    return np.nonzero(~((excess > FILTER_MARGIN * bound) & (bound > FILTER_FLOOR)))


# Casting ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class ExactHits:
    """distance : list of Fraction, Surd or None (a miss); index : (n,) int64, triangle, then spheres, or -1;
    tied : list of tuples, all that are hit at exactly that distance, ascending: `index` is the first of them.
    """

    distance: list
    index: np.ndarray
    tied: list

    def rounded(self):
        """(n,) float64, the correctly rounded distances, infinity for a miss."""
        return np.array([np.inf if t is None else round_to_float(t) for t in self.distance])


def closest_hit(origins, directions, corners=None, centres=None, radii=None, t_min=0.0, t_max=np.inf):
    """Return the ExactHits of rays (n, 3) with triangles (t, 3, 3) and spheres (s, 3), (s,)."""
    best = {}
    for ray, index, t in all_hits(origins, directions, corners, centres, radii, t_min, t_max):
        if ray not in best or t < best[ray][0]:
            best[ray] = (t, [index])
        elif t == best[ray][0]:
            best[ray][1].append(index)
    found = [best.get(ray, (None, [])) for ray in range(len(origins))]
    tied = [tuple(sorted(indices)) for _, indices in found]
    index = np.array([indices[0] if indices else -1 for indices in tied], dtype=np.int64)
    return ExactHits([t for t, _ in found], index, tied)


def any_hit(origins, directions, corners=None, centres=None, radii=None, t_min=0.0, t_max=np.inf):
    """Return (n,) bool, True where the ray hits anything within its range."""
    hit = np.zeros(len(origins), dtype=bool)
    for ray, _, _ in all_hits(origins, directions, corners, centres, radii, t_min, t_max):
        hit[ray] = True
    return hit


def all_hits(origins, directions, corners, centres, radii, t_min, t_max):
    """Yield (ray, index, exact t) of every triangle and sphere within the ray's range."""
    origins, directions = (np.asarray(value, dtype=np.float64).reshape(-1, 3) for value in (origins, directions))
    corners = np.zeros((0, 3, 3)) if corners is None else np.asarray(corners, dtype=np.float64)
    centres = np.zeros((0, 3)) if centres is None else np.asarray(centres, dtype=np.float64)
    radii = np.zeros(0) if radii is None else np.asarray(radii, dtype=np.float64)
    low, high = (np.broadcast_to(np.asarray(value, dtype=np.float64), len(origins)) for value in (t_min, t_max))
    rays = np.flatnonzero(_is_valid(origins, directions) & (low < np.inf) & (np.maximum(low, 0) <= high))
    ranges = {int(ray): (Fraction(max(low[ray], 0.0)), high[ray]) for ray in rays}
    for ray, index, t in _triangle_hits(rays, origins, directions, corners):
        if ranges[ray][0] <= t <= ranges[ray][1]:
            yield ray, index, t
    for ray, index, roots in _sphere_hits(rays, origins, directions, centres, radii):
        t = next((root for root in roots if root >= ranges[ray][0]), None)
        if t is not None and (ranges[ray][1] == np.inf or t <= ranges[ray][1]):
            yield ray, len(corners) + index, t


def _is_valid(origins, directions):
    return np.isfinite(origins).all(axis=1) & np.isfinite(directions).all(axis=1) & (directions != 0).any(axis=1)


def _candidates(may_hit, rays, origins, directions, *primitives):
    """Yield blocks (ray, primitive) of index arrays that pass the filter, and all in normalised float64."""
    origins, directions = origins[rays], directions[rays]
    if not len(rays) or not len(primitives[0]):
        return
    scaled_origins, *scaled = _normalise(origins, *primitives)
    scaled_directions = np.ldexp(directions, -np.frexp(_size(directions))[1][:, np.newaxis])
    step = max(1, PAIRS_PER_BLOCK // len(primitives[0]))
    for first in range(0, len(rays), step):
        block = slice(first, first + step)
        ray, primitive = may_hit(scaled_origins[block], scaled_directions[block], *scaled)
        yield rays[first + ray], primitive


def _scaled_rays(ray, origins, directions, exponent):
    """Return the rays' integers and the exponent of t: coordinates count in 2^exponent, each direction in its own."""
    unique, place = np.unique(ray, return_inverse=True)
    direction_exponent = np.array([_lowest_exponent(directions[i]) for i in unique], dtype=np.int64)
    integers = np.array(
        [_to_integers(directions[i], int(e)) for i, e in zip(unique, direction_exponent, strict=True)], dtype=object
    ).reshape(-1, 3)
    return _to_integers(origins[ray], exponent), integers[place], exponent - direction_exponent[place]


def _triangle_numbers(rays, origins, directions, corners):
    """Yield blocks of candidate pairs: ray, triangle, exponent of t, and in integers origin, direction, a, b, c."""
    exponent = _lowest_exponent(origins[rays], corners)
    integers = _to_integers(corners, exponent)
    for ray, triangle in _candidates(_may_hit_triangles, rays, origins, directions, corners):
        origin, direction, t_exponent = _scaled_rays(ray, origins, directions, exponent)
        a, b, c = np.moveaxis(integers[triangle], 1, 0)
        yield ray, triangle, t_exponent, origin, direction, a, b, c


def _triangle_hits(rays, origins, directions, corners):
    """Yield (ray, triangle, t) for every triangle the line meets: o + t d = a + beta (b - a) + gamma (c - a)."""
    for ray, triangle, t_exponent, origin, direction, a, b, c in _triangle_numbers(rays, origins, directions, corners):
        offset, edge_b, edge_c = origin - a, b - a, c - a
        across = _cross(direction, edge_c)
        whole = _dot(edge_b, across)
        flip = np.where(whole < 0, -1, 1).astype(object)
        around = _cross(offset, edge_b)
        whole, beta, gamma = flip * whole, flip * _dot(offset, across), flip * _dot(direction, around)
        t = flip * _dot(edge_c, around)
        inside = (whole != 0) & (beta >= 0) & (gamma >= 0) & (beta + gamma <= whole)
        for i in np.flatnonzero(inside):
            exact = Fraction(t[i], whole[i]) * _power_of_two(int(t_exponent[i]))
            yield int(ray[i]), int(triangle[i]), exact


def _sphere_hits(rays, origins, directions, centres, radii):
    """Yield (ray, sphere, (first, second root)) for every sphere the ray's line meets."""
    exponent = _lowest_exponent(origins[rays], centres, radii)
    centres_int, radii_int = _to_integers(centres, exponent), _to_integers(radii, exponent)
    for ray, sphere in _candidates(_may_hit_spheres, rays, origins, directions, centres, radii):
        origin, direction, t_exponent = _scaled_rays(ray, origins, directions, exponent)
        offset = origin - centres_int[sphere]
        a, b = _dot(direction, direction), -_dot(offset, direction)
        c = _dot(offset, offset) - radii_int[sphere] * radii_int[sphere]
        discriminant = b * b - a * c
        for i in np.flatnonzero(discriminant >= 0):
            unit = _power_of_two(int(t_exponent[i])) / a[i]
            roots = tuple(Surd(b[i] * unit, s, discriminant[i] * unit * unit) for s in (-1, 1))
            yield int(ray[i]), int(sphere[i]), roots


# Crossings ----------------------------------------------------------------------------------------------------------


def _perturbed_sign(value, gradient):
    """Sign of value + (e, e^2, e^3) . gradient for infinitesimal e > 0: (n,), (n, 3) objects -> (n,)."""
    result = np.sign(value)
    for axis in range(3):
        result = np.where(result == 0, np.sign(gradient[:, axis]), result)
    return result


def crossings(origins, directions, corners):
    """Return (n,) int32: how many triangles each ray crosses, its origin moved by an infinitesimal (e, e^2, e^3).

    The move changes the edge function E(p, q) = d . (P x Q) by (e, e^2, e^3) . (d x (q - p)), exactly, and the distance
    of the plane, T = (a - o) . N, by -(e, e^2, e^3) . N. After it no ray meets an edge, a vertex, or starts on a
    triangle, so that a closed mesh is crossed an even or odd number of times as its outside and inside demand.
    """
    origins, directions = (np.asarray(value, dtype=np.float64).reshape(-1, 3) for value in (origins, directions))
    count = np.zeros(len(origins), dtype=np.int32)
    rays = np.flatnonzero(_is_valid(origins, directions))
    for ray, _, _, origin, direction, a, b, c in _triangle_numbers(rays, origins, directions, np.asarray(corners)):
        normal = _cross(b - a, c - a)
        facing = np.sign(_dot(direction, normal))
        crossed = (facing != 0) & (_perturbed_sign(_dot(a - origin, normal), -normal) == facing)
        for p, q in ((a, b), (b, c), (c, a)):
            edge = _perturbed_sign(_dot(direction, _cross(p - origin, q - origin)), _cross(direction, q - p))
            crossed &= edge == facing
        np.add.at(count, ray[crossed.astype(bool)], 1)
    return count


# Scenes -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class ExactScene:
    """World-space primitives of a scene, in the order that breaks ties.

    corners : (t, 3, 3) float64; centres : (s, 3), radii : (s,) float64
    instance, primitive : (t + s,) int32, what `Hits` should report for each index
    """

    corners: np.ndarray
    centres: np.ndarray
    radii: np.ndarray
    instance: np.ndarray
    primitive: np.ndarray

    def closest_hit(self, origins, directions, t_min=0.0, t_max=np.inf):
        return closest_hit(origins, directions, self.corners, self.centres, self.radii, t_min, t_max)

    def any_hit(self, origins, directions, t_min=0.0, t_max=np.inf):
        return any_hit(origins, directions, self.corners, self.centres, self.radii, t_min, t_max)

    def crossings(self, origins, directions):
        return crossings(origins, directions, self.corners)


def place(positions, matrix):
    """Return ((m0 x + m1 y) + m2 z) + m3 for each world coordinate, every operation rounded to float64."""
    x, y, z = positions[:, 0], positions[:, 1], positions[:, 2]
    rows = [((row[0] * x + row[1] * y) + row[2] * z) + row[3] for row in np.asarray(matrix)[:3]]
    return np.stack(rows, axis=-1)


def pack_scene(scene):
    """Return the ExactScene of a raytracer.Scene."""
    if scene.instances is None:
        placed = [(mesh, np.eye(4)) for mesh in scene.meshes]
    else:
        placements = zip(scene.instances.mesh, scene.instances.world_from_object, strict=True)
        placed = [(scene.meshes[index], matrix) for index, matrix in placements]
    corners = [place(mesh.positions, matrix)[mesh.triangles] for mesh, matrix in placed]
    counts = [len(group) for group in corners] + [len(group.radii) for group in scene.spheres]
    return ExactScene(
        corners=np.concatenate([np.zeros((0, 3, 3)), *corners]),
        centres=np.concatenate([np.zeros((0, 3)), *(group.centres for group in scene.spheres)]),
        radii=np.concatenate([np.zeros(0), *(group.radii for group in scene.spheres)]),
        instance=np.repeat(np.arange(len(counts), dtype=np.int32), counts),
        primitive=np.concatenate([np.zeros(0, np.int32), *(np.arange(n, dtype=np.int32) for n in counts)]),
    )
