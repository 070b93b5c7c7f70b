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
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.casting.candidates import Candidates, find_runs, join_candidates
from raytracer.casting.decide import decide_exactly
from raytracer.casting.edges import judge_edges
from raytracer.casting.geometry import Ids, Kind
from raytracer.casting.measure import TURNS, Chosen, gather_lines, gather_turned, lie_out_of_range, measure_hits
from raytracer.casting.order import Order
from raytracer.casting.passed import Passed, bound_distances, find_keys
from raytracer.casting.places import name_places
from raytracer.casting.primitives import Primitives, gather_spheres
from raytracer.casting.rays import Hits, Rays, find_main_axis, make_misses
from raytracer.predicates import exact, filtered
from raytracer.predicates.rounding import gamma

NO_ID = np.iinfo(np.int64).max


class Query:
    """The state of a batch of n valid rays.

    closed : edges and vertices belong to their triangles
    narrows : what lies beyond a certain hit does not matter
    axis : (n,) int8, the main axis: the one along which the direction is largest
    best : (n,) float64; nothing farther than this can be the answer. Starts at t_max; -inf once an any-hit ray is
        decided. Traversal culls with it.
    t_min : (n,) float64; nothing nearer than this can be the answer
    surely_begun : (n,) float64; from there on, all that is hit counts: accelerators that settle, or lower the best,
        without an offer go by this
    order : of surfaces at one place; None: by their ids
    passed : what the rays have left behind; None where they all start afresh
    """

    closed = True
    narrows = True

    def __init__(self, primitives: Primitives, rays: Rays, any_hit: bool, order: Order | None = None) -> None:
        self.primitives = primitives
        self.rays = rays
        self.any_hit = any_hit
        self.order = order
        self.certified = primitives.precision == "certified"
        self.axis = find_main_axis(rays.directions)
        self.axes = np.flatnonzero(np.bincount(self.axis, minlength=3)).tolist()
        self.t_min = self.surely_begun = np.maximum(rays.t_min, 0.0)
        self.passed: Passed | None = None
        if rays.after is not None or rays.departure is not None:
            self.passed = Passed(primitives, rays, order)
            self.t_min = np.maximum(self.t_min, self.passed.low)
            # In plain precisions an accelerator may measure otherwise than an offer: nothing is sure.
            gate = self.passed.gate if self.certified else np.where(self.passed.gate >= 0, np.inf, -np.inf)
            self.surely_begun = np.maximum(self.t_min, np.nextafter(gate, np.inf))
        self.best = np.where(self.t_min <= rays.t_max, rays.t_max, -np.inf)
        self.best_id = np.full(len(rays), NO_ID)
        self.tied = np.zeros(len(rays), dtype=np.bool_) if order is not None else None
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
        if self.passed is not None:
            ray, primitive_id = self.passed.leave_out_met(ray, primitive_id)
        changed = [self._offer_turned(ray[part], primitive_id[part], axis) for axis, part in self._by_axis(ray)]
        return np.concatenate(changed) if changed else ray[:0]

    def _offer_turned(self, ray: Indices, primitive_id: Ids, axis: int) -> Indices:
        if not len(self.primitives.geometry.radii):
            return self._offer_triangles(ray, primitive_id, axis)
        sphere = self.primitives.geometry.is_kind(primitive_id, Kind.SPHERE)
        if sphere.all():
            return self._offer_spheres(ray, primitive_id, axis)
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
        centre, radius = gather_spheres(self.primitives, primitive_id)
        lines = gather_lines(self.primitives, self.rays, ray, axis)
        roots = filtered.intersect_sphere_certified(lines[3:6], centre[TURNS[axis]] - lines[:3], radius)
        t_min = self.t_min[ray]
        if not self.certified:
            left = ~(roots.near >= t_min)
            if self.passed is not None:
                left |= self.passed.find_left(ray, primitive_id, roots.near, 0.0 * roots.near, roots.far)
            t = np.where(left, roots.far, roots.near)
            return self._accept(ray, primitive_id, np.where(roots.discriminant >= 0, t, np.nan))
        passed = roots.near + roots.error < t_min  # the first root lies before the range beyond doubt
        if self.passed is not None:
            passed |= self.passed.find_left(ray, primitive_id, roots.near, roots.error, roots.far)
        t = np.where(passed, roots.far, roots.near)
        sure = roots.discriminant > roots.discriminant_error
        possible = ~(roots.discriminant < -roots.discriminant_error)
        # Where doubt remains which root is the first in range, the near one's interval reaches below it: not certain.
        return self._weigh(ray, primitive_id, t, roots.error, sure, possible)

    def _accept(self, ray: Indices, primitive_id: Ids, t: Floats) -> Indices:
        """Plain precisions: believe t (NaN = no hit); nearest first, then the lowest key."""
        index = np.flatnonzero((t >= self.t_min[ray]) & (t <= self.best[ray]))
        ray, primitive_id, t = ray[index], primitive_id[index], t[index].astype(np.float64)
        if self.passed is not None:
            index = np.flatnonzero(~self.passed.judge(ray, primitive_id, t, t, None).out)
            ray, primitive_id, t = ray[index], primitive_id[index], t[index]
        if self.any_hit:
            self.best_id[ray], self.best[ray] = primitive_id, -np.inf
            return ray
        before = self.best[ray]
        np.minimum.at(self.best, ray, t)
        nearer = self.best[ray] < before
        self.best_id[ray[nearer]] = NO_ID
        winner = t == self.best[ray]
        self._keep_first(ray[winner], primitive_id[winner])
        return ray

    def _keep_first(self, ray: Indices, primitive_id: Ids) -> None:
        """Let the one of the lowest key stand among primitives that are at their rays' best distance."""
        if self.order is None:
            np.minimum.at(self.best_id, ray, primitive_id)
            return
        known = np.flatnonzero(self.best_id[ray] != NO_ID)
        ray = np.concatenate([ray[known], ray])
        primitive_id = np.concatenate([self.best_id[ray[: len(known)]], primitive_id])
        sorted_ = self._sort_by_key(ray, primitive_id)
        first = sorted_[find_runs(ray[sorted_])[:, 0]]
        self.best_id[ray[first]] = primitive_id[first]

    def _sort_by_key(self, ray: Indices, primitive_id: Ids) -> Indices:
        """The order of pairs by ray, then by key, then by id."""
        if self.order is None:
            return np.lexsort((primitive_id, ray))
        directions = self.rays.directions.take(ray, axis=0)
        return np.lexsort((primitive_id, find_keys(self.primitives, self.order, directions, primitive_id), ray))

    def _weigh(
        self, ray: Indices, primitive_id: Ids, t: Floats, error: Floats, inside: Booleans, possible: Booleans
    ) -> Indices:
        """Certified: drop what is certainly out, keep the rest in the pool, lower `best` by what is certainly in."""
        with np.errstate(invalid="ignore"):
            low, high = t - error, t + error
        in_doubt = np.isnan(low) | np.isnan(high)
        low[in_doubt], high[in_doubt] = -np.inf, np.inf
        possible &= ~((high < self.t_min[ray]) | (low > self.best[ray]))
        begun = low >= self.t_min[ray]
        if self.passed is not None:
            self._weigh_near(ray, primitive_id, low, high, possible, begun)
        certain = possible & inside & begun & (high <= self.rays.t_max[ray])
        if self.any_hit:
            self.best[ray[certain]], self.best_id[ray[certain]] = -np.inf, primitive_id[certain]
            possible &= ~certain
        else:
            np.minimum.at(self.best, ray[certain], high[certain])
        self.pool.append(Candidates(ray, primitive_id, t, low, certain).select(np.flatnonzero(possible)))
        return ray[certain]

    def _weigh_near(
        self, ray: Indices, primitive_id: Ids, low: Floats, high: Floats, possible: Booleans, begun: Booleans
    ) -> None:
        """Strike out of `possible` the candidates that lie behind the rays, and out of `begun` those that may."""
        assert self.passed is not None
        near = np.flatnonzero(possible & ~(low > self.passed.gate[ray]))
        if not len(near):
            return
        ray, primitive_id, low, high = ray[near], primitive_id[near], low[near], high[near]
        level = self._find_level(ray, primitive_id, (low <= self.passed.high[ray]) & (high >= self.passed.low[ray]))
        verdict = self.passed.judge(ray, primitive_id, low, high, level)
        possible[near] &= ~verdict.out
        # What lies level with the last hit is in the ray's range as that was.
        begun[near] = (begun[near] | level) & ~verdict.doubtful

    def _find_level(self, ray: Indices, primitive_id: Ids, near: Booleans) -> Booleans:
        """(k,) True for those of the candidates `near` that surely lie at the distance of what was met last."""
        assert self.passed is not None
        level, rows = np.zeros(len(ray), dtype=np.bool_), np.flatnonzero(near)
        ray, primitive_id, last = ray[rows], primitive_id[rows], self.passed.met[ray[rows]]
        for name, other in zip(self._name(ray, primitive_id), self._name(ray, last), strict=True):
            level[rows] |= (name == other).all(axis=0)
        return level

    def _remaining(self) -> Candidates:
        """The pool's candidates that are still possible."""
        if not self.pool:
            nothing = np.zeros(0)
            return Candidates(nothing.astype(np.intp), nothing.astype(np.int64), nothing, nothing, nothing > 0)
        everything = join_candidates(self.pool)
        return everything.select(np.flatnonzero(everything.low <= self.best.take(everything.ray)))

    @np.errstate(all="ignore")
    def found_any(self) -> Booleans:
        """(n,) bool: the answers of an any-hit query."""
        found = self.best_id != NO_ID
        if self.certified:
            left = self._remaining()
            left = left.select(np.flatnonzero(~found[left.ray]))  # a certain hit leaves no doubt
            beyond = lie_out_of_range(self.primitives, self.rays, self.t_min, left.ray, left.primitive_id)
            left = self._sort(left.select(np.flatnonzero(~beyond)))
            for start, stop in find_runs(left.ray):
                found[left.ray[start]] = self._decide(left, start, stop).chosen >= 0
        return found

    @np.errstate(all="ignore")
    def closest(self) -> Hits:
        """The closest hit of each ray."""
        hits = make_misses(np.ones(len(self.rays), dtype=bool))
        if self.certified:
            self._close_certified()
        else:
            ray = np.flatnonzero(self.best_id != NO_ID)
            t = self.best[ray]
            self.settled.append(Candidates(ray, self.best_id[ray], t, t, np.ones(len(ray), bool)))
        if self.settled:
            self._measure(hits, join_candidates(self.settled))
        return hits if self.tied is None else replace(hits, tied=self._find_tied(hits))

    def _find_tied(self, hits: Hits) -> Booleans:
        """(n,) False where nothing else lies at the distance of the hit, nor where its ray starts."""
        if not self.certified:
            return hits.hit
        assert self.tied is not None
        if self.passed is not None:
            self.tied |= bound_distances(hits)[0] <= self.passed.gate
        return self.tied & hits.hit

    def _sort(self, candidates: Candidates) -> Candidates:
        return candidates.select(self._sort_by_key(candidates.ray, candidates.primitive_id))

    def _close_certified(self) -> None:
        """Choose the first of each ray's candidates that are left."""
        left = self._remaining()
        alone = np.bincount(left.ray, minlength=len(self.rays)).take(left.ray) == 1
        if self.tied is not None:
            self.tied[left.ray[~alone]] = True
        clear = left.certain & alone
        decided = self._choose(self._sort(left.select(np.flatnonzero(~clear))))
        self.settled += [left.select(np.flatnonzero(clear)), decided]

    def _choose(self, left: Candidates) -> Candidates:
        """The first of each ray's candidates, sorted; rays that hit none are left out."""
        runs = find_runs(left.ray)
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
        for name in self._name(left.ray[member], left.primitive_id[member]):
            together[member] |= (name == name[:, first_member]).all(axis=0)
        return certain & np.logical_and.reduceat(together, first)

    def _name(self, ray: Indices, primitive_id: Ids) -> tuple[Floats, ...]:
        return name_places(self.primitives, self.rays, self.axis, ray, primitive_id)

    def _decide(self, left: Candidates, start: int, stop: int) -> exact.ExactHit:
        """Settle one ray's candidates, sorted by key, in integers."""
        self.exact_count += 1
        ray, primitive_id = int(left.ray[start]), left.primitive_id[start:stop]
        return decide_exactly(self.primitives, self.rays, self.t_min, self.passed, ray, primitive_id)
