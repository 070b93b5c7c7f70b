"""Hits measured: the distance of each ray's one chosen primitive, its bound, and the barycentric weights.

How a hit was found leaves no trace here: the same formulas, in the same order of operations, whatever the accelerator.
Hits are measured in the order of their rays, in blocks that fit the cache: neighbours meet the same triangles, and what
is written lies side by side.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats
from raytracer.casting.geometry import Ids, Kind, split_id
from raytracer.casting.primitives import Primitives, find_corners, gather_corners, gather_spheres
from raytracer.casting.rays import Hits, Rays
from raytracer.predicates import filtered, refine

Indices = NDArray[np.intp]

# The order of coordinates that brings each axis to the last place; cyclic, so that orientations stay.
TURNS = ([1, 2, 0], [2, 0, 1], [0, 1, 2])
# Of each place the coordinate that each main axis brings there, (3 places, 3 axes).
TURNED = np.ascontiguousarray(np.transpose(TURNS))
# Hits measured at a time: fewer pay more for calls, more leave the cache. 95 ns a hit; 110 at 4096, 134 at 2048.
MEASURE_BLOCK = 8192


class Chosen(NamedTuple):
    """The primitives that k rays hit, one each.

    ray : (k,) index of the ray; primitive_id : (k,); t : (k,) the distance as it was found, NaN where unknown
    """

    ray: Indices
    primitive_id: Ids
    t: Floats

    def select(self, mask: Booleans) -> Chosen:
        if mask.all():
            return self
        index = np.flatnonzero(mask)
        return Chosen(self.ray.take(index), self.primitive_id.take(index), self.t.take(index))

    def sort(self, count: int) -> Chosen:
        """By ray, of `count` rays."""
        if (self.ray[1:] > self.ray[:-1]).all():
            return self
        place = np.full(count, -1, np.intp)
        place[self.ray] = np.arange(len(self.ray))
        order = place[place >= 0]
        return Chosen(self.ray.take(order), self.primitive_id.take(order), self.t.take(order))


def measure_hits(hits: Hits, primitives: Primitives, rays: Rays, axis: NDArray[np.int8], chosen: Chosen) -> None:
    """Fill in the hits of rays with a chosen primitive.

    axis : (n,) int8, the main axis of each ray
    """
    chosen = chosen.sort(len(rays))
    hits.instance[chosen.ray], hits.primitive[chosen.ray] = split_id(primitives.geometry, chosen.primitive_id)
    for start in range(0, len(chosen.ray), MEASURE_BLOCK):
        some = slice(start, start + MEASURE_BLOCK)
        block = Chosen(chosen.ray[some], chosen.primitive_id[some], chosen.t[some])
        _measure_some(hits, primitives, rays, axis.take(block.ray), block)


def gather_lines(primitives: Primitives, rays: Rays, ray: Indices, axis: int) -> NDArray:
    """The (8, k) planes of rays of one main axis: origin, direction and slopes, turned so that it comes last."""
    lines = np.empty((8, len(ray)))
    for first, vectors in ((0, rays.origins), (3, rays.directions)):
        rows = vectors.take(ray, axis=0)
        for place, coordinate in enumerate(TURNS[axis], start=first):
            lines[place] = rows[:, coordinate]
    np.divide(lines[3:5], lines[5], out=lines[6:])
    return lines.astype(primitives.dtype, copy=False)


def gather_turned(primitives: Primitives, primitive_id: Ids, axis: int) -> NDArray:
    """The (3 corners, 3, k) planes of triangles, the main axis last."""
    return gather_corners(primitives, primitive_id, TURNS[axis]).reshape(3, 3, -1)


def _gather_mixed_lines(primitives: Primitives, rays: Rays, ray: Indices, axis: NDArray[np.int8]) -> NDArray:
    """As `gather_lines`, each ray of its own main axis (k,)."""
    lines = np.empty((8, len(ray)))
    for first, vectors in ((0, rays.origins), (3, rays.directions)):
        rows, columns = ray, vectors.T
        if not columns.flags.c_contiguous and not vectors.flags.c_contiguous:
            vectors, rows = vectors.take(ray, axis=0), np.arange(len(ray))
            columns = vectors.T
        # As one row of numbers, in the order of memory: steps there from ray to ray, and to the next coordinate.
        by_rows = vectors.flags.c_contiguous
        numbers = (vectors if by_rows else columns).reshape(-1)
        places, step = (rows * 3, 1) if by_rows else (rows, len(vectors))
        for place, turned in enumerate(TURNED * step, start=first):
            numbers.take(places + turned.take(axis), out=lines[place], mode="clip")
    np.divide(lines[3:5], lines[5], out=lines[6:])
    return lines.astype(primitives.dtype, copy=False)


def _gather_mixed_corners(primitives: Primitives, primitive_id: Ids, axis: NDArray[np.int8]) -> NDArray:
    """As `gather_turned`, each for a ray of its own main axis (k,)."""
    numbers, rows = find_corners(primitives, primitive_id)
    corners = np.empty((3, 3, len(rows)), numbers.dtype)
    rows = rows * 9
    for place, turned in enumerate(TURNED):
        index = rows + turned.take(axis)
        for corner in corners:
            numbers.take(index, out=corner[place], mode="clip")
            index += 3
    return corners


def _measure_some(hits: Hits, primitives: Primitives, rays: Rays, axis: NDArray[np.int8], chosen: Chosen) -> None:
    """Measure hits of rays with main axes `axis` (k,)."""
    if len(primitives.geometry.radii):
        sphere = primitives.geometry.is_kind(chosen.primitive_id, Kind.SPHERE)
        for one in np.flatnonzero(np.bincount(axis[sphere], minlength=3)):
            _measure_spheres(hits, primitives, rays, one, chosen.select(sphere & (axis == one)))
        chosen, axis = chosen.select(~sphere), axis[~sphere]
    lines = _gather_mixed_lines(primitives, rays, chosen.ray, axis)
    corners = _gather_mixed_corners(primitives, chosen.primitive_id, axis)
    certified = primitives.precision == "certified"
    measured = measure_block(lines, corners, certified)
    hits.distance[chosen.ray], hits.distance_error[chosen.ray] = measured.distance, measured.error
    # As one number a row: rows of two take eight times as long.
    hits.barycentric.view(np.complex128)[chosen.ray, 0] = measured.weights.astype(np.float64, copy=False).view(
        np.complex128
    )[:, 0]
    if certified:
        wide = np.flatnonzero(refine.is_wide(measured.distance, measured.error))
        _narrow_bounds(hits, primitives, rays, chosen.ray.take(wide), chosen.primitive_id.take(wide))


def _measure_spheres(hits: Hits, primitives: Primitives, rays: Rays, axis: int, chosen: Chosen) -> None:
    if primitives.precision != "certified":
        hits.distance[chosen.ray], hits.distance_error[chosen.ray] = chosen.t, np.nan
        return
    lines = gather_lines(primitives, rays, chosen.ray, axis)
    centre, radius = gather_spheres(primitives, chosen.primitive_id)
    hits.distance[chosen.ray], hits.distance_error[chosen.ray] = refine.sphere_distance(
        lines[:3], lines[3:6], centre[TURNS[axis]], radius, chosen.t
    )


class Measured(NamedTuple):
    """distance, error : (k,) float64, error NaN unless the precision is certified; weights : (k, 2) of corners 1, 2"""

    distance: Floats
    error: Floats
    weights: Floats


def measure_block(lines: NDArray, corners: NDArray, certified: bool = True) -> Measured:
    """Measure hits of triangles, of rays with one main axis.

    The weights are E_b / (E_a + E_b + E_c) and E_c over the same (`predicates`), within [0, 1]; the distance is
    `refine.correct_distance`'s.

    lines : (8, k) planes, `gather_lines`; corners : (3 corners, 3, k) planes, `gather_turned`
    """
    relative = corners - lines[:3]
    weights = _weigh_corners(relative, lines[6:])
    if certified:
        return Measured(*refine.correct_distance(lines[:3], lines[3:6], *corners), weights)
    t = filtered.plane_distance(lines[3:6], relative[0], corners[1] - corners[0], corners[2] - corners[0])
    return Measured(t, np.full_like(t, np.nan), weights)


def _weigh_corners(relative: NDArray, slope: NDArray) -> NDArray:
    """(k, 2) weights of corners 1 and 2, of corners (3, 3, k) relative to the origin; 0 where there are none."""
    sheared = slope * relative[:, 2:]
    np.subtract(relative[:, :2], sheared, out=sheared)
    edge_a, edge_b, edge_c = filtered.edge_functions(*sheared)
    total = edge_a
    total += edge_b
    total += edge_c
    weights = np.empty((len(total), 2), relative.dtype)
    np.divide(edge_b, total, out=weights[:, 0])
    np.divide(edge_c, total, out=weights[:, 1])
    if not np.isfinite(weights.sum()):
        np.nan_to_num(weights, copy=False)
    np.maximum(weights, 0.0, out=weights)
    return np.minimum(weights, 1.0, out=weights)


def _narrow_bounds(hits: Hits, primitives: Primitives, rays: Rays, ray: Indices, primitive_id: Ids) -> None:
    """Measure triangles whose distance has a wide bound once more, in pairs."""
    if not len(ray):
        return
    distance, error = _divide_determinants(primitives, rays, ray, primitive_id)
    better = ~(hits.distance_error[ray] <= error)
    hits.distance[ray[better]], hits.distance_error[ray[better]] = distance[better], error[better]


def lie_out_of_range(primitives: Primitives, rays: Rays, t_min: Floats, ray: Indices, primitive_id: Ids) -> Booleans:
    """(k,) True for candidates that are triangles whose planes their rays meet outside their range for certain, as far
    as pairs of float64 can tell.

    Rays to emissive geometry end so little before it that float64 is in doubt; in integers each such costs 60 us.
    No tolerance is needed to compare: a difference that is rounded is beyond a limit that is a float64 only if the
    exact one is, for rounding keeps order.

    t_min : (n,) the begin of the rays' ranges
    """
    out = np.zeros(len(ray), dtype=np.bool_)
    index = np.flatnonzero(primitives.geometry.is_kind(primitive_id, Kind.TRIANGLE))
    for start in range(0, len(index), MEASURE_BLOCK):
        some = index[start : start + MEASURE_BLOCK]
        of_ray = ray.take(some)
        distance, error = _divide_determinants(primitives, rays, of_ray, primitive_id.take(some))
        out[some] = (distance - error > rays.t_max.take(of_ray)) | (distance + error < t_min.take(of_ray))
    return out


def lie_out_in_float64(primitives: Primitives, rays: Rays, t_min: Floats, ray: Indices, primitive_id: Ids) -> Booleans:
    """(k,) True for triangles whose planes their rays meet outside their range for certain, as far as float64 can tell
    (`filtered.intersect_plane_certified`).

    t_min : (n,) the begin of the rays' ranges
    """
    out = np.empty(len(ray), dtype=np.bool_)
    for start in range(0, len(ray), MEASURE_BLOCK):
        some = slice(start, start + MEASURE_BLOCK)
        of_ray = ray[some]
        origin, direction = (
            np.ascontiguousarray(vectors.take(of_ray, axis=0).T) for vectors in (rays.origins, rays.directions)
        )
        a, b, c = gather_corners(primitives, primitive_id[some]).reshape(3, 3, -1)
        plane = filtered.intersect_plane_certified(direction, a - origin, b - a, c - a)
        out[some] = (plane.t - plane.t_error > rays.t_max.take(of_ray)) | (plane.t + plane.t_error < t_min.take(of_ray))
    return out


def _divide_determinants(primitives: Primitives, rays: Rays, ray: Indices, primitive_id: Ids) -> tuple[Floats, Floats]:
    """Where k rays meet the planes of triangles, and a bound, as `refine.divide_determinants`."""
    origin, direction = (
        np.ascontiguousarray(vectors.take(ray, axis=0).T) for vectors in (rays.origins, rays.directions)
    )
    corners = gather_corners(primitives, primitive_id).reshape(3, 3, -1)
    return refine.divide_determinants(origin, direction, corners[0], corners[1], corners[2])
