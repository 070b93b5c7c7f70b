"""All that rays meet, surface after surface: for multi-echo scans, glass, thickness.

A *layer* is the next surface of each ray. What is met at one t of one instance is one surface, whether one triangle or
all those around an edge or a vertex; surfaces of different instances at one t are met one after the other. Both are
decided exactly: rays go on in the exact order of (t, instance, primitive) (`order`), never from a rounded point, which
would lie before the surface that it was meant to lie on about half of the time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytracer.arrays.types import Booleans, Indices
from raytracer.casting.edges import name_axis_planes, name_meeting_points
from raytracer.casting.geometry import Kind, join_id
from raytracer.casting.measure import gather_lines, gather_turned
from raytracer.casting.passed import bound_distances
from raytracer.casting.primitives import Primitives, gather_corners
from raytracer.casting.ray_visibility import SceneCaster
from raytracer.casting.rays import Hits, Rays, make_misses, make_rays, select_rows
from raytracer.predicates import exact


@dataclass(frozen=True, eq=False)
class AllHits:
    """The m surfaces that n rays meet, ray by ray, and along each ray in order.

    hits : Hits of m surfaces
    ray : (m,) int64, the ray that meets each
    layer : (m,) int64, how many surfaces that ray has met before
    count : (n,) int64, how many surfaces each ray meets
    """

    hits: Hits
    ray: NDArray[np.int64]
    layer: NDArray[np.int64]
    count: NDArray[np.int64]


def iterate_layers(
    caster: SceneCaster,
    origins: ArrayLike,
    directions: ArrayLike,
    t_min: ArrayLike = 0.0,
    t_max: ArrayLike = np.inf,
) -> Iterator[Hits]:
    """Yield the hits of n rays with the next surface each, until all miss; the first are those of `closest_hit`.

    Parameters
    ----------
    caster : of any precision; surfaces at one t are told apart exactly where it is certified
    origins, directions : (n, 3) or (3,) float64, metres, world
    t_min, t_max : scalar or (n,), inclusive

    Yields
    ------
    Hits of n rays; those that meet no more miss.

    Notes
    -----
    A sphere is met twice. Two hits of one instance whose intervals t +- error overlap are compared exactly, by the
    corners or the plane that their triangles share, else in integers.
    """
    rays = make_rays(origins, directions, t_min, t_max)
    valid = rays.valid()
    going = np.flatnonzero(valid)  # rays that may meet more
    rays, last = rays.select(going), None
    while len(rays):
        found = _find_next(caster, rays, last)
        rows = np.flatnonzero(found.hit)
        if not len(rows):
            return
        going, rays, last = going[rows], rays.select(rows), found.select(rows)
        layer = make_misses(valid)
        layer.put(going, last)
        yield layer


def find_all_hits(
    caster: SceneCaster,
    origins: ArrayLike,
    directions: ArrayLike,
    t_min: ArrayLike = 0.0,
    t_max: ArrayLike = np.inf,
    most: int | None = None,
) -> AllHits:
    """Return all surfaces that rays meet, at most `most` for each ray; parameters as `iterate_layers`.

    Raises
    ------
    ValueError
        If `most` is no whole number of at least 1.
    """
    if most is not None and (isinstance(most, bool) or not isinstance(most, int | np.integer) or most < 1):
        raise ValueError(f"most: expected a whole number of at least 1, or None, got {most!r}")
    count = len(make_rays(origins, directions, t_min, t_max))
    rays, layers, parts = [], [], []
    for number, hits in enumerate(islice(iterate_layers(caster, origins, directions, t_min, t_max), most)):
        rows = np.flatnonzero(hits.hit)
        rays.append(rows)
        layers.append(np.full(len(rows), number))
        parts.append(hits.select(rows))
    ray = np.concatenate([np.zeros(0, np.int64), *rays])
    layer = np.concatenate([np.zeros(0, np.int64), *layers])
    order = np.argsort(ray, kind="stable")
    joined = make_misses(np.ones(len(ray), dtype=np.bool_))
    start = 0
    for part in parts:
        joined.put(slice(start, start + len(part)), part)
        start += len(part)
    return AllHits(select_rows(joined, order), ray[order], layer[order], np.bincount(ray, minlength=count))


def _find_next(caster: SceneCaster, rays: Rays, last: Hits | None) -> Hits:
    """Return the next surface of each ray behind the `last`, all of which are hits."""
    hits = caster.closest_hit(rays.origins, rays.directions, rays.t_min, rays.t_max, after=last)
    if last is None:
        return hits
    again = np.flatnonzero(find_same_surface(caster.primitives, rays, hits, last))
    while len(again):
        some, before = rays.select(again), hits.select(again)
        more = caster.closest_hit(some.origins, some.directions, some.t_min, some.t_max, after=before)
        hits.put(again, more)
        again = again[find_same_surface(caster.primitives, some, more, before)]
    return hits


def find_same_surface(primitives: Primitives, rays: Rays, hits: Hits, last: Hits) -> Booleans:
    """Return (n,) True where two hits of a ray are triangles of one instance at exactly the same t."""
    same = hits.hit & (hits.instance == last.instance)
    same &= bound_distances(hits)[0] <= bound_distances(last)[1]
    same &= primitives.geometry.belongs_to_kind(hits.instance, Kind.TRIANGLE)
    if primitives.precision != "certified":
        return same & (hits.distance == last.distance)
    near = np.flatnonzero(same)
    if len(near):
        same[near] = _are_level(primitives, rays.select(near), hits.select(near), last.select(near))
    return same


def _are_level(primitives: Primitives, rays: Rays, hits: Hits, last: Hits) -> Booleans:
    """Return (k,) True where two triangles lie at exactly the same t: by a name that they share, else in integers."""
    here, there = (join_id(primitives.geometry, part.instance, part.primitive) for part in (hits, last))
    level = np.zeros(len(rays), dtype=np.bool_)
    axis = np.abs(rays.directions).argmax(axis=1)
    for one in range(3):
        rows: Indices = np.flatnonzero(axis == one)
        corners = [gather_turned(primitives, ids[rows], one) for ids in (here, there)]
        lines = gather_lines(primitives, rays, rows, one)
        meeting = [name_meeting_points(lines, some) for some in corners]
        planes = [name_axis_planes(some) for some in corners]
        level[rows] = (meeting[0] == meeting[1]).all(axis=0) | (planes[0] == planes[1]).all(axis=0)
    for row in np.flatnonzero(~level):
        both = gather_corners(primitives, np.array([here[row], there[row]])).T.reshape(2, 3, 3)
        level[row] = exact.meets_at_one_place(rays.origins[row].tolist(), rays.directions[row].tolist(), both)
    return level
