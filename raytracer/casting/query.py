"""What is known of a batch of rays while candidates come in, and the decision at the end.

A *candidate* is a pair (ray, primitive id) that culling could not exclude. Every accelerator, and brute force, only
offers candidates; which of them is the closest hit, or whether there is one, is decided here, in one place, for all
of them. Three precisions share the path and differ in what they trust:

    float32, float64   a sign or a distance is what the arithmetic gives
    certified          a sign or a distance is believed beyond its error bound (`predicates`); candidates that remain
                       possible wait in a pool, and where more than one is left, or one in doubt, integers decide
                       (`exact`)
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.casting.edges import judge_edges, name_axis_planes, name_meeting_points
from raytracer.casting.geometry import Ids, Kind
from raytracer.casting.measure import TURNS, Chosen, gather_lines, gather_turned, measure_hits
from raytracer.casting.primitives import Primitives, gather_corners, gather_spheres
from raytracer.casting.rays import Hits, Rays
from raytracer.predicates import exact, filtered
from raytracer.predicates.rounding import gamma

NO_ID = np.iinfo(np.int64).max


class Candidates(NamedTuple):
    """k candidates with what is known of them.

    t : (k,) the distance as computed; low : (k,) certainly no more than the exact one
    certain : (k,) bool, the primitive is hit within the ray's range beyond doubt
    """

    ray: Indices
    primitive_id: Ids
    t: Floats
    low: Floats
    certain: Booleans

    def select(self, index: Indices | Booleans | slice) -> Candidates:
        return Candidates(
            self.ray[index], self.primitive_id[index], self.t[index], self.low[index], self.certain[index]
        )

    def sort(self) -> Candidates:
        """By ray, then by id."""
        return self.select(np.lexsort((self.primitive_id, self.ray)))


def _join(parts: list[Candidates]) -> Candidates:
    return Candidates(*(np.concatenate(column) for column in zip(*parts, strict=True)))


class Search:
    """The state of a batch of n valid rays.

    closed : edges and vertices belong to their triangles
    narrows : what lies beyond a certain hit does not matter
    axis : (n,) int8, the main axis: the one along which the direction is largest
    best : (n,) float64; nothing farther than this can be the answer. Starts at t_max; -inf once an any-hit ray is
        decided. Traversal culls with it.
    """

    closed = True
    narrows = True

    def __init__(self, primitives: Primitives, rays: Rays, any_hit: bool) -> None:
        self.primitives = primitives
        self.rays = rays
        self.any_hit = any_hit
        self.certified = primitives.precision == "certified"
        self.axis = _main_axis(rays.directions)
        self.axes = np.flatnonzero(np.bincount(self.axis, minlength=3)).tolist()
        self.t_min = np.maximum(rays.t_min, 0.0)
        self.best = np.where(self.t_min <= rays.t_max, rays.t_max, -np.inf)
        self.best_id = np.full(len(rays), NO_ID)
        self.pool: list[Candidates] = []
        self.settled: list[Candidates] = []
        self.exact_count = 0

    def _by_axis(self, ray: Indices) -> Iterator[tuple[int, Any]]:
        """Yield each main axis with the positions of its rays among `ray`."""
        if len(self.axes) == 1:
            yield self.axes[0], slice(None)
            return
        axis_of_ray = self.axis.take(ray)
        for axis in self.axes:
            index = np.flatnonzero(axis_of_ray == axis)
            if len(index):
                yield axis, index

    def _bound_edges(self, lines: NDArray, axis: int) -> Floats:
        """(k,) a bound on edge functions per line, from the farthest coordinate of any triangle; else 0."""
        if not self.certified:
            return np.zeros(lines.shape[1], self.primitives.dtype)
        low, high = self.primitives.bounds[:, TURNS[axis], np.newaxis]
        away = np.maximum(high - lines[:3], lines[:3] - low)
        reach = np.maximum(np.maximum(away[0], away[1]), away[2])
        # Three roundings: two differences and the product that absorbs them.
        return filtered.edge_error_of_ray(lines[6:], reach * (1 + gamma(3)))

    def _turned_spheres(self, primitive_id: Ids, axis: int) -> tuple[NDArray, NDArray]:
        centre, radius = gather_spheres(self.primitives, primitive_id)
        return centre[TURNS[axis]], radius

    def settle(self, ray: Indices, primitive_id: Ids) -> None:
        """Take in triangles that are certainly hit; if the closest are asked for, the only candidates of their rays."""
        if self.any_hit:
            self.best[ray], self.best_id[ray] = -np.inf, primitive_id
        else:
            nothing = np.full(len(ray), np.nan)
            self.settled.append(Candidates(ray, primitive_id, nothing, nothing, np.ones(len(ray), bool)))

    @np.errstate(over="ignore", invalid="ignore")
    def offer(self, ray: Indices, primitive_id: Ids) -> Indices:
        """Take in candidates, rays by index and primitives by id; return rays whose `best` may have changed.

        Overflow shows as infinity or NaN, of which nothing is certain.
        """
        changed = [self._offer_turned(ray[part], primitive_id[part], axis) for axis, part in self._by_axis(ray)]
        return np.concatenate(changed) if changed else ray[:0]

    def _offer_turned(self, ray: Indices, primitive_id: Ids, axis: int) -> Indices:
        if not len(self.primitives.geometry.radii):
            return self._offer_triangles(ray, primitive_id, axis)
        sphere = self.primitives.geometry.is_kind(primitive_id, Kind.SPHERE)
        triangles = self._offer_triangles(ray[~sphere], primitive_id[~sphere], axis)
        return np.concatenate([triangles, self._offer_spheres(ray[sphere], primitive_id[sphere], axis)])

    def _offer_triangles(self, ray: Indices, primitive_id: Ids, axis: int) -> Indices:
        corners = gather_turned(self.primitives, primitive_id, axis)
        lines = gather_lines(self.primitives, self.rays, ray, axis)
        bound = self._bound_edges(lines, axis)
        edges = filtered.edge_functions(*(filtered.shear(corner - lines[:3], lines[6:]) for corner in corners))
        highest = np.maximum(np.maximum(edges[0], edges[1]), edges[2])
        lowest = np.minimum(np.minimum(edges[0], edges[1]), edges[2])
        index = np.flatnonzero(~((highest > bound) & (lowest < -bound)))
        inside = (lowest[index] > bound[index]) | (highest[index] < -bound[index])
        corners, lines = corners.take(index, axis=2), lines.take(index, axis=1)
        ray, primitive_id = ray.take(index), primitive_id.take(index)
        direction, relative = lines[3:6], corners[0] - lines[:3]
        side_b, side_c = corners[1] - corners[0], corners[2] - corners[0]
        if not self.certified:
            return self._accept(ray, primitive_id, filtered.plane_distance(direction, relative, side_b, side_c))
        plane = filtered.intersect_plane_certified(direction, relative, side_b, side_c)
        possible = np.ones(len(ray), dtype=bool)
        doubtful = np.flatnonzero(~inside)
        if len(doubtful):
            lines, corners = lines.take(doubtful, axis=1), corners.take(doubtful, axis=2)
            inside[doubtful], possible[doubtful] = judge_edges(lines, corners, self.closed)
        return self._weigh(ray, primitive_id, plane.t, plane.t_error, inside, possible)

    def _offer_spheres(self, ray: Indices, primitive_id: Ids, axis: int) -> Indices:
        centre, radius = self._turned_spheres(primitive_id, axis)
        lines = gather_lines(self.primitives, self.rays, ray, axis)
        roots = filtered.intersect_sphere_certified(lines[3:6], centre - lines[:3], radius)
        t_min = self.t_min[ray]
        if not self.certified:
            t = np.where(roots.near >= t_min, roots.near, roots.far)
            return self._accept(ray, primitive_id, np.where(roots.discriminant >= 0, t, np.nan))
        passed = roots.near + roots.error < t_min  # the first root lies before the range beyond doubt
        t = np.where(passed, roots.far, roots.near)
        sure = roots.discriminant > roots.discriminant_error
        possible = ~(roots.discriminant < -roots.discriminant_error)
        # Where doubt remains which root is the first in range, the near one's interval reaches below it: not certain.
        return self._weigh(ray, primitive_id, t, roots.error, sure, possible)

    def _accept(self, ray: Indices, primitive_id: Ids, t: Floats) -> Indices:
        """Plain precisions: believe t (NaN = no hit); nearest first, then the lowest id."""
        index = np.flatnonzero((t >= self.t_min[ray]) & (t <= self.best[ray]))
        ray, primitive_id, t = ray[index], primitive_id[index], t[index].astype(np.float64)
        if self.any_hit:
            self.best_id[ray], self.best[ray] = primitive_id, -np.inf
            return ray
        before = self.best[ray]
        np.minimum.at(self.best, ray, t)
        nearer = self.best[ray] < before
        self.best_id[ray[nearer]] = NO_ID
        winner = t == self.best[ray]
        np.minimum.at(self.best_id, ray[winner], primitive_id[winner])
        return ray

    def _weigh(
        self, ray: Indices, primitive_id: Ids, t: Floats, error: Floats, inside: Booleans, possible: Booleans
    ) -> Indices:
        """Certified: drop what is certainly out, keep the rest in the pool, lower `best` by what is certainly in."""
        with np.errstate(invalid="ignore"):
            low, high = t - error, t + error
        in_doubt = np.isnan(low) | np.isnan(high)
        low[in_doubt], high[in_doubt] = -np.inf, np.inf
        possible &= ~((high < self.t_min[ray]) | (low > self.best[ray]))
        certain = possible & inside & (low >= self.t_min[ray]) & (high <= self.rays.t_max[ray])
        if self.any_hit:
            self.best[ray[certain]], self.best_id[ray[certain]] = -np.inf, primitive_id[certain]
            possible &= ~certain
        else:
            np.minimum.at(self.best, ray[certain], high[certain])
        self.pool.append(Candidates(ray, primitive_id, t, low, certain).select(np.flatnonzero(possible)))
        return ray[certain]

    def _remaining(self) -> Candidates:
        """The pool's candidates that are still possible."""
        if not self.pool:
            nothing = np.zeros(0)
            return Candidates(nothing.astype(np.intp), nothing.astype(np.int64), nothing, nothing, nothing > 0)
        everything = _join(self.pool)
        return everything.select(np.flatnonzero(everything.low <= self.best.take(everything.ray)))

    def found_any(self) -> Booleans:
        """(n,) bool: the answers of an any-hit search."""
        found = self.best_id != NO_ID
        if self.certified:
            left = self._remaining()
            left = left.select(np.flatnonzero(~found[left.ray])).sort()  # a certain hit leaves no doubt
            for start, stop in _runs(left.ray):
                found[left.ray[start]] = self._decide(left, start, stop).chosen >= 0
        return found

    @np.errstate(all="ignore")
    def closest(self) -> Hits:
        """The closest hit of each ray."""
        count = len(self.rays)
        hits = Hits(
            distance=np.full(count, np.inf),
            distance_error=np.zeros(count),
            instance=np.full(count, -1, np.int32),
            primitive=np.full(count, -1, np.int32),
            barycentric=np.zeros((count, 2)),
            valid=np.ones(count, dtype=bool),
        )
        if self.certified:
            self._close_certified()
        else:
            ray = np.flatnonzero(self.best_id != NO_ID)
            t = self.best[ray]
            self.settled.append(Candidates(ray, self.best_id[ray], t, t, np.ones(len(ray), bool)))
        if self.settled:
            self._measure(hits, _join(self.settled))
        return hits

    def _close_certified(self) -> None:
        """Choose the first of each ray's candidates that are left."""
        left = self._remaining()
        alone = np.bincount(left.ray, minlength=len(self.rays)).take(left.ray) == 1
        clear = left.certain & alone
        decided = self._choose(left.select(np.flatnonzero(~clear)).sort())
        self.settled += [left.select(np.flatnonzero(clear)), decided]

    def _choose(self, left: Candidates) -> Candidates:
        """The first of each ray's candidates, sorted; rays that hit none are left out."""
        runs = _runs(left.ray)
        chosen = runs[:, 0].copy()
        for run in np.flatnonzero(~self._are_settled(left, runs)):
            chosen[run] += self._decide(left, *runs[run]).chosen
        return left.select(chosen[chosen >= runs[:, 0]])

    def _measure(self, hits: Hits, chosen: Candidates) -> None:
        """Fill in the hits of rays with their one chosen candidate each; what float64 cannot measure, integers do."""
        measure_hits(hits, self.primitives, self.rays, self.axis, Chosen(chosen.ray, chosen.primitive_id, chosen.t))
        if not self.certified:
            return
        for k in np.flatnonzero(~(chosen.certain & np.isfinite(hits.distance_error.take(chosen.ray)))):
            ray, decision = chosen.ray[k], self._decide(chosen, k, k + 1)
            hits.distance[ray], hits.distance_error[ray] = decision.t, decision.t_error
            hits.barycentric[ray] = decision.barycentric

    def _are_settled(self, left: Candidates, runs: NDArray[np.intp]) -> Booleans:
        """(g,) True for runs of one certain candidate, or of certain ones that all meet the ray in one point."""
        if not len(runs):
            return np.zeros(0, dtype=bool)
        first, size = runs[:, 0], runs[:, 1] - runs[:, 0]
        certain = np.logical_and.reduceat(left.certain, first)
        member = np.flatnonzero(np.repeat(certain & (size > 1), size))
        first_member = np.searchsorted(member, np.repeat(first, size)[member])
        together = np.repeat(size == 1, size)
        together[member] = False
        for name in self._name_places(left.select(member)):
            together[member] |= (name == name[:, first_member]).all(axis=0)
        return certain & np.logical_and.reduceat(together, first)

    def _name_places(self, candidates: Candidates) -> tuple[Floats, Floats]:
        """`edges.name_meeting_points` (6, k) and `edges.name_axis_planes` (2, k) of candidates; NaN for spheres."""
        points, planes = np.full((6, len(candidates.ray)), np.nan), np.full((2, len(candidates.ray)), np.nan)
        triangle = np.flatnonzero(self.primitives.geometry.is_kind(candidates.primitive_id, Kind.TRIANGLE))
        ray, primitive_id = candidates.ray[triangle], candidates.primitive_id[triangle]
        for axis, part in self._by_axis(ray):
            corners = gather_turned(self.primitives, primitive_id[part], axis)
            points[:, triangle[part]] = name_meeting_points(
                gather_lines(self.primitives, self.rays, ray[part], axis), corners
            )
            planes[:, triangle[part]] = name_axis_planes(corners)
        return points, planes

    def _decide(self, left: Candidates, start: int, stop: int) -> exact.ExactHit:
        """Settle one ray's candidates in integers."""
        self.exact_count += 1
        ray, primitive_id = left.ray[start], left.primitive_id[start:stop]
        triangle = self.primitives.geometry.is_kind(primitive_id, Kind.TRIANGLE)
        corners = gather_corners(self.primitives, primitive_id[triangle]).T.reshape(-1, 3, 3)
        centre, radius = gather_spheres(self.primitives, primitive_id[~triangle])
        return exact.closest_candidate(
            self.rays.origins[ray].tolist(),
            self.rays.directions[ray].tolist(),
            float(self.t_min[ray]),
            float(self.rays.t_max[ray]),
            corners,
            np.vstack([centre, radius]).T,
        )


def _main_axis(directions: Floats) -> NDArray[np.int8]:
    """(n,) the axis of each direction's largest component; the last of equals."""
    size = np.abs(directions).T
    axis = np.where(size[1] >= size[0], np.int8(1), np.int8(0))
    return np.where(size[2] >= np.maximum(size[0], size[1]), np.int8(2), axis)


def _runs(sorted_values: Indices) -> NDArray[np.intp]:
    """(g, 2) start and stop of each run of equal values."""
    if not len(sorted_values):
        return np.zeros((0, 2), np.intp)
    starts = np.flatnonzero(np.concatenate([[True], sorted_values[1:] != sorted_values[:-1]]))
    return np.stack([starts, np.append(starts[1:], len(sorted_values))], axis=1)
