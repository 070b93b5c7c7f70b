"""Shadow rays: what share of a light's radiance reaches a shading point.

Rays that share the point they end at, or their direction, are cast in calls of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from raytracer.arrays.rows import any_column
from raytracer.arrays.types import Booleans, Counts, Floats, Indices, Keys
from raytracer.casting.order import Order
from raytracer.casting.ray_visibility import Cast, RayCaster, classify_shadows, find_any
from raytracer.casting.rays import Rays, join_rays
from raytracer.integrator.light_sources import ALONE
from raytracer.shading.materials import MaterialTable, find_transparency
from raytracer.surfaces.surface import make_surface
from raytracer.surfaces.surface_tables import SurfaceTables

# What shadow rays, after so many straight passages of their paths, let through: (n, 1) or (n, 3); where the third is
# True, transparent surfaces let light through even if their material says that they stop it.
Visibility = Callable[[Rays, Counts, Booleans], Floats]


@dataclass(frozen=True, eq=False, slots=True)
class ShadowRays:
    """k shadow rays of one source.

    row : (k,) int64, of the batch, that they light
    light : (k, 3) float64, what arrives if nothing is in the way
    key : (k,) int32, as in KeyedSamples
    passages : (k,) int32, as in ShadingPoints
    rays : None where the source throws no shadows
    unstopped, chance : as in LightSource
    """

    row: Indices
    light: Floats
    key: Keys
    passages: Counts
    rays: Rays | None
    unstopped: bool = False
    chance: float = 1.0


def cast_shadows(visibility: Visibility, shadow_rays: Sequence[ShadowRays]) -> list[Floats]:
    """Return what share of its light each source's rays let through, (k, 1) or (k, 3); 1 where there are no shadows.

    Rays of one key of one source are cast in a call of their own, all others together.
    """
    casting = [of_source for of_source in shadow_rays if of_source.rays is not None and len(of_source.row)]
    rays = join_rays([of_source.rays for of_source in casting if of_source.rays is not None])
    key = np.concatenate([np.zeros(0, np.int32), *_number_keys(casting)])
    passages = np.concatenate([np.zeros(0, np.int32), *(of_source.passages for of_source in casting)])
    unstopped = np.concatenate(
        [np.zeros(0, np.bool_), *(np.full(len(of_source.row), of_source.unstopped) for of_source in casting)]
    )
    seen = None
    for rows in _split_by_key(key):
        part = visibility(rays.select(rows), passages[rows], unstopped[rows])
        seen = np.empty((len(rays), part.shape[1])) if seen is None else seen
        seen[rows] = part
    shares, start = [], 0
    for of_source in shadow_rays:
        stop = start + (len(of_source.row) if of_source.rays is not None else 0)
        shares.append(np.ones((len(of_source.row), 1)) if seen is None or of_source.rays is None else seen[start:stop])
        start = stop
    return shares


def _number_keys(sources: Sequence[ShadowRays]) -> Iterator[Keys]:
    """Yield each source's keys, no key of one like a key of another."""
    first = 0
    for of_source in sources:
        yield np.where(of_source.key == ALONE, ALONE, of_source.key + first).astype(np.int32)
        first += int(of_source.key.max()) + 1


def _split_by_key(key: Keys) -> Iterator[Indices | slice]:
    """Yield the rows of each key."""
    if not len(key):
        return
    if (key == key[0]).all():
        yield slice(None)
        return
    order = np.argsort(key, kind="stable")
    ends = np.flatnonzero(np.diff(key[order])) + 1
    yield from np.split(order, ends)


def opaque_visibility(caster: RayCaster, cast: Cast | None = None, order: Order | None = None) -> Visibility:
    """Shadow rays where every surface stops the light: (n, 1), 1 or 0.

    cast : needed where some objects throw no shadows
    order : of surfaces at one place, or None
    """

    def see(rays: Rays, passages: Counts, unstopped: Booleans) -> Floats:
        blocked = find_any(caster, rays, order) if cast is None else cast(rays, classify_shadows(rays)).hit
        return np.where(blocked, 0.0, 1.0)[:, np.newaxis]

    return see


def transparent_visibility(cast: Cast, tables: SurfaceTables, materials: MaterialTable, most: int) -> Visibility:
    """Shadow rays that pass through transparent surfaces: (n, 3), the share of light that is left.

    most : straight passages that a path may make together with its shadow ray
    """
    return partial(_see_through, cast, tables, materials, most)


def _see_through(
    cast: Cast,
    tables: SurfaceTables,
    materials: MaterialTable,
    most: int,
    rays: Rays,
    passages: Counts,
    unstopped: Booleans,
) -> Floats:
    left = np.ones((len(rays), 3))
    rows = np.arange(len(rays))
    while len(rows):
        hits = cast(rays, classify_shadows(rays))
        met = np.flatnonzero(hits.hit)
        rays, hits, rows = rays.select(met), hits.select(met), rows[met]
        surface = make_surface(tables, rays, hits)
        left[rows] *= find_transparency(materials, surface, unstopped[rows])
        left[rows[passages[rows] >= most]] = 0.0
        passages = passages + 1
        open_ = np.flatnonzero(any_column(left[rows] > 0))
        rays, rows = replace(rays.select(open_), after=hits.select(open_)), rows[open_]
    return left
