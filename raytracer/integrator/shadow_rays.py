"""Shadow rays: what share of a light's radiance reaches a shading point.

Rays of all sources are cast together, but for those of which very many share the point they end at.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import any_column
from raytracer.arrays.types import Booleans, Counts, Floats, Indices, Integers, Keys, Masks
from raytracer.bsdfs.bounce_kinds import DIFFUSE, GLOSSY
from raytracer.casting.order import Order
from raytracer.casting.ray_visibility import CastLinked, CastRays, RayCaster, find_any
from raytracer.casting.rays import Hits, Rays, join_rays
from raytracer.integrator.light_sources import ALONE
from raytracer.integrator.parts import Split
from raytracer.lecture import length
from raytracer.media.stack import Immersed, join_immersed
from raytracer.scene.fields import ALL_SETS, SEEN_BY
from raytracer.scene.light_groups import NO_GROUP
from raytracer.shading.light_path import Depths, LightPath, describe_reflected, describe_shadow_rays
from raytracer.shading.materials import MaterialTable, find_transparency
from raytracer.surfaces.surface import make_surface
from raytracer.surfaces.surface_tables import SurfaceTables

# So many rays that share a point or a direction are cast in a call of their own: from there on a view from the light
# costs less than the tree, which shares what it costs between all rays of a call.
SMALLEST_SHARED = 1 << 16

# The share of light (n, 1) or (n, 3) that shadow rays let through.
Visibility = Callable[["Shadows"], Floats]


@dataclass(frozen=True, eq=False, slots=True)
class Shadows:
    """n shadow rays that are cast together.

    depths : of their paths
    unstopped : (n,) bool, True where transparent surfaces let light through even if their material says that they stop
        it
    cast_as : (n,) uint8, bits of SEEN_BY, the classes whose objects they meet
    blockers : (n,) int64, the sets of objects that they meet, as bits; None where all meet all
    immersed : what they start inside of; None where the scene has no media
    """

    rays: Rays
    depths: Depths
    unstopped: Booleans
    cast_as: Masks
    blockers: NDArray[np.int64] | None = None
    immersed: Immersed | None = None

    def select(self, rows: Any) -> Shadows:
        """Return some of the rays: index or boolean array."""
        blockers = None if self.blockers is None else self.blockers[rows]
        immersed = None if self.immersed is None else self.immersed.select(rows)
        depths, unstopped, cast_as = self.depths.select(rows), self.unstopped[rows], self.cast_as[rows]
        return Shadows(self.rays.select(rows), depths, unstopped, cast_as, blockers, immersed)


@dataclass(frozen=True, eq=False, slots=True)
class ShadowRays:
    """k shadow rays of one source.

    row : (k,) int64, of the batch, that they light
    light : (k, 3) float64, what arrives if nothing is in the way
    key : (k,) int32, as in KeyedSamples
    source : number of the source, whose keys these are
    depths : of the paths
    rays : None where the source throws no shadows
    unstopped, cast_as, chance : as in LightSource
    blockers : the sets of objects that shadow the light, as bits, one for all or (k,)
    split : the light in parts; None where no pass asks
    light_group : number of the group of the light, one for all or (k,)
    immersed : what the rays start inside of; None where the scene has no media
    from_medium : True where media send the light on, not surfaces
    """

    row: Indices
    light: Floats
    key: Keys
    depths: Depths
    rays: Rays | None
    source: int = 0
    unstopped: bool = False
    cast_as: int = SEEN_BY["shadow"]
    chance: float = 1.0
    split: Split | None = None
    light_group: Integers | int = NO_GROUP
    blockers: NDArray[np.int64] | int = ALL_SETS
    immersed: Immersed | None = None
    from_medium: bool = False


def cast_shadows(visibility: Visibility, shadow_rays: Sequence[ShadowRays]) -> list[Floats]:
    """Return what share of its light each source's rays let through, (k, 1) or (k, 3); 1 where there are no shadows.

    Rays of one key of one source are cast in a call of their own if they are many, all others together.
    """
    casting = [of_source for of_source in shadow_rays if of_source.rays is not None and len(of_source.row)]
    seen = None
    if casting:
        shadows = join_shadows(casting)
        for rows in _split_by_key(_number_keys(casting)):
            part = visibility(shadows.select(rows))
            seen = np.empty((len(shadows.rays), part.shape[1])) if seen is None else seen
            seen[rows] = part
    shares, start = [], 0
    for of_source in shadow_rays:
        stop = start + (len(of_source.row) if of_source.rays is not None else 0)
        shares.append(np.ones((len(of_source.row), 1)) if seen is None or of_source.rays is None else seen[start:stop])
        start = stop
    return shares


def join_shadows(sources: Sequence[ShadowRays]) -> Shadows:
    """Return the rays of all sources, in order."""
    counts = [len(of_source.row) for of_source in sources]
    bounces = [of_source.depths.bounces for of_source in sources if of_source.depths.bounces is not None]
    return Shadows(
        join_rays([of_source.rays for of_source in sources if of_source.rays is not None]),
        Depths(
            np.concatenate([of_source.depths.passages for of_source in sources]),
            np.concatenate(bounces) if len(bounces) == len(sources) else None,
        ),
        np.repeat([of_source.unstopped for of_source in sources], counts),
        np.repeat(np.array([of_source.cast_as for of_source in sources], np.uint8), counts),
        _join_blockers(sources),
        join_immersed([of_source.immersed for of_source in sources]),
    )


def _join_blockers(sources: Sequence[ShadowRays]) -> NDArray[np.int64] | None:
    """Return which sets of objects block the rays of all sources (n,), in order; None where all block all."""
    if all(isinstance(of_source.blockers, int) and of_source.blockers == ALL_SETS for of_source in sources):
        return None
    return np.concatenate([np.broadcast_to(of_source.blockers, len(of_source.row)) for of_source in sources])


def _number_keys(sources: Sequence[ShadowRays]) -> Keys:
    """Return the keys of all sources' rays, no key of one source like a key of another."""
    count = 1 + max(int(of_source.key.max()) for of_source in sources)
    keys = [np.where(of_source.key == ALONE, ALONE, of_source.key + of_source.source * count) for of_source in sources]
    return np.concatenate(keys).astype(np.int32)


def _split_by_key(key: Keys) -> Iterator[Indices | slice]:
    """Yield the rows of each key that has many, then all others."""
    counts = np.bincount(key[key != ALONE])
    many = np.flatnonzero(counts >= SMALLEST_SHARED)
    if not len(many) or counts.max() == len(key):
        yield slice(None)
        return
    for one in many:
        yield np.flatnonzero(key == one)
    others = np.flatnonzero(~np.isin(key, many))
    if len(others):
        yield others


# Closest hits of shadow rays with what they meet.
CastShadows = Callable[[Shadows], Hits]


def make_shadow_cast(cast: CastRays, cast_linked: CastLinked | None = None) -> CastShadows:
    """Return what finds the closest hits of shadow rays; cast_linked : needed where some objects shadow some lights."""

    def meet(shadows: Shadows) -> Hits:
        if shadows.blockers is None or cast_linked is None:
            return cast(shadows.rays, shadows.cast_as)
        return cast_linked(shadows.rays, shadows.cast_as, shadows.blockers)

    return meet


def opaque_visibility(caster: RayCaster, cast: CastShadows | None = None, order: Order | None = None) -> Visibility:
    """Shadow rays where every surface stops the light: (n, 1), 1 or 0.

    cast : needed where some objects throw no shadows, or not of all lights
    order : of surfaces at one place, or None
    """

    def see(shadows: Shadows) -> Floats:
        blocked = find_any(caster, shadows.rays, order) if cast is None else cast(shadows).hit
        return (~blocked).astype(np.float64)[:, np.newaxis]

    return see


def transparent_visibility(cast: CastShadows, tables: SurfaceTables, materials: MaterialTable, most: int) -> Visibility:
    """Shadow rays that pass through transparent surfaces: (n, 3), the share of light that is left.

    most : straight passages that a path may make together with its shadow ray
    """
    return partial(_see_through, cast, tables, materials, most)


def _see_through(
    cast: CastShadows, tables: SurfaceTables, materials: MaterialTable, most: int, shadows: Shadows
) -> Floats:
    left = np.ones((len(shadows.rays), 3))
    rows, passed = np.arange(len(shadows.rays)), 0
    while len(rows):
        hits = cast(shadows)
        met = np.flatnonzero(hits.hit)
        shadows, hits, rows = shadows.select(met), hits.select(met), rows[met]
        surface = make_surface(tables, shadows.rays, hits)
        path = None
        if materials.computed is not None:
            path = describe_shadows(shadows, hits.distance * length(shadows.rays.directions), passed)
        left[rows] *= find_transparency(materials, surface, shadows.unstopped, path)
        left[rows[shadows.depths.passages + passed >= most]] = 0.0
        passed += 1
        open_ = np.flatnonzero(any_column(left[rows] > 0))
        shadows, rows = shadows.select(open_), rows[open_]
        shadows = replace(shadows, rays=replace(shadows.rays, after=hits.select(open_)))
    return left


def describe_shadows(shadows: Shadows, metres: Floats, passed: Counts | int) -> LightPath:
    """Return what programs can ask of shadow rays that meet surfaces after so many metres (n,), and as many passed
    before: of those that are cast as reflected rays, what those would tell."""
    path = describe_shadow_rays(metres, shadows.depths, passed)
    rows = np.flatnonzero(shadows.cast_as != SEEN_BY["shadow"])
    if len(rows):
        kind = np.where(shadows.cast_as[rows] == SEEN_BY["diffuse"], DIFFUSE, GLOSSY).astype(np.uint8)
        before = passed if isinstance(passed, int) else passed[rows]
        reflected = describe_reflected(kind, metres[rows], shadows.depths.select(rows), before).values
        path.values["shadow"][rows] = 0.0
        for name, values in reflected.items():
            path.values.setdefault(name, np.zeros(len(metres)))[rows] = values
    return path
