"""Paths of rays on their way through the scene: how they start, go on, and are joined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import find_mode, lay_columns, make_zeros, shorten_rows, take_rows
from raytracer.arrays.types import Booleans, Colors, Counts, Indices, Integers, Kinds, Masks, Numbers, Vectors
from raytracer.bsdfs.bounce_kinds import COUNTED, STRAIGHT, count_bounces
from raytracer.bsdfs.bsdf_samples import BsdfSample
from raytracer.bsdfs.closures import Shading
from raytracer.bsdfs.portals import Portals, find_exits
from raytracer.casting.order import join_departures
from raytracer.casting.rays import Hits, Rays, join_rays
from raytracer.lecture import dot, length
from raytracer.media.stack import MediaStack, join_stacks
from raytracer.surfaces.departing import depart, leave
from raytracer.surfaces.surface import Surface


@dataclass(frozen=True, eq=False, slots=True)
class Paths:
    """k rays on their way, each the last stretch of a path.

    row : (k,) int64, the ray of the batch that the path began with
    rays : their directions are unit vectors once they are scattered
    throughput : (k, 3) float64, what the light from here counts
    kind : (k,) uint8, of its last bounce; STRAIGHT before the first
    bounces : (k, 4) int32, how many it has taken of each kind in `bounce_kinds.COUNTED`
    passages : (k,) int32, how often it went straight through a surface, or through a portal
    scatter_origin, scatter_normal : (k, 3) float64, where it was scattered last, which light sampling was done from, or
        where it has come out of a portal since
    density : (k,) float64, with which it was scattered into this direction; inf where light sampling could not
    rarest : (k,) float64, the least density of its bounces; inf before the first
    scatterer : (k,) int32, instance that it was scattered by last; -1 before the first
    travelled : (k,) float64, metres from scatter_origin to where this stretch begins: a path that goes straight
        through a surface keeps its ray, and goes on `after` what it has met
    media : what it is inside of; None where the scene has no media
    portals : (k,) int32, how many it has gone through; None before any path has
    received : (k,) uint8, bits of `caustics`, whether receivers of caustics have scattered it; None before any has
    beyond : (k,) float64, by what light from beyond the next surface counts more; 0 where chance ends the path there
        (`late_roulette`); None where it ends none, for all 1
    """

    row: NDArray[np.int64]
    rays: Rays
    throughput: Colors
    kind: Kinds
    bounces: Counts
    passages: NDArray[np.int32]
    scatter_origin: Vectors
    scatter_normal: Vectors
    density: Numbers
    rarest: Numbers
    scatterer: NDArray[np.int32]
    travelled: Numbers
    media: MediaStack | None = None
    portals: NDArray[np.int32] | None = None
    received: Masks | None = None
    beyond: Numbers | None = None

    def __len__(self) -> int:
        return len(self.row)

    @property
    def direct(self) -> Booleans:
        """(k,) True where the path has gone straight so far, as the camera sees."""
        return self.kind == STRAIGHT

    def count_portals(self) -> NDArray[np.int32]:
        """Return how many portals (k,) paths have gone through."""
        return np.zeros(len(self), np.int32) if self.portals is None else self.portals

    def find_received(self) -> Masks:
        """Return whether receivers of caustics have scattered (k,) paths, as bits."""
        return np.zeros(len(self), np.uint8) if self.received is None else self.received

    def select(self, rows: Any) -> Paths:
        """Return some of the paths: index or boolean array."""
        if isinstance(rows, np.ndarray) and rows.dtype == np.bool_:
            rows = rows.nonzero()[0]  # once for all arrays
        mode = find_mode(rows, len(self))
        columns = {name: take_rows(getattr(self, name), rows, mode) for name in COLUMNS}
        return Paths(
            **columns,
            rays=self.rays.select(rows),
            media=None if self.media is None else self.media.select(rows),
            portals=None if self.portals is None else self.portals[rows],
            received=None if self.received is None else self.received[rows],
            beyond=None if self.beyond is None else self.beyond[rows],
        )


# What there is of all paths, in an array each.
NO_COLUMNS = ("rays", "media", "portals", "received", "beyond")
COLUMNS = tuple(name for name in Paths.__slots__ if name not in NO_COLUMNS)


@dataclass(frozen=True, eq=False, slots=True)
class Wave:
    """k paths where they have hit: all that a stage of the loop needs to know of them, row by row."""

    paths: Paths
    hits: Hits
    surface: Surface
    shading: Shading

    def __len__(self) -> int:
        return len(self.paths)

    def select(self, rows: Indices) -> Wave:
        """Return some of the paths, in their order."""
        paths, hits = self.paths.select(rows), self.hits.select(rows)
        return Wave(paths, hits, self.surface.select(rows), self.shading.select(rows))


def join_paths(parts: Sequence[Paths]) -> Paths:
    """Return the paths of several records as one, in order."""
    if len(parts) == 1:
        return parts[0]
    if not parts:
        return start_paths(join_rays([]))
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in COLUMNS}
    media, portals = join_stacks([part.media for part in parts]), None
    if any(part.portals is not None for part in parts):
        portals = np.concatenate([part.count_portals() for part in parts])
    received = None
    if any(part.received is not None for part in parts):
        received = np.concatenate([part.find_received() for part in parts])
    beyond = None
    if any(part.beyond is not None for part in parts):
        beyond = np.concatenate([np.ones(len(part)) if part.beyond is None else part.beyond for part in parts])
    rays = join_rays([part.rays for part in parts])
    return Paths(rays=rays, media=media, portals=portals, received=received, beyond=beyond, **joined)


def start_paths(rays: Rays, first: int = 0) -> Paths:
    """Return the paths that begin with camera rays, those of the batch's rows from `first` on."""
    count = len(rays)
    return Paths(
        row=np.arange(first, first + count),
        rays=rays,
        throughput=np.ones((3, count)).T,
        kind=np.full(count, STRAIGHT, dtype=np.uint8),
        bounces=np.zeros((len(COUNTED), count), dtype=np.int32).T,
        passages=np.zeros(count, dtype=np.int32),
        scatter_origin=lay_columns(rays.origins),
        scatter_normal=make_zeros(count),
        density=np.full(count, np.inf),
        rarest=np.full(count, np.inf),
        scatterer=np.full(count, -1, dtype=np.int32),
        travelled=np.zeros(count),
    )


def advance(wave: Wave, sample: BsdfSample, beyond: Numbers | None = None) -> Paths:
    """Return the paths of a wave that go on, at the start of their next stretch; beyond : (n,), as of Paths."""
    alive = np.flatnonzero(sample.alive)
    rows = shorten_rows(alive, len(wave))
    old, surface = wave.paths, leave(wave.surface, rows)
    direction, kind, density = take_rows(sample.direction, rows), sample.kind[rows], sample.density[rows]
    going_on = Paths(
        row=old.row[rows],
        rays=depart(surface, direction),
        throughput=take_rows(old.throughput, rows) * take_rows(sample.weight, rows),
        kind=kind,
        bounces=count_bounces(take_rows(old.bounces, rows), kind),
        passages=old.passages[rows],
        scatter_origin=surface.position,
        scatter_normal=take_rows(wave.shading.normal, rows),
        density=density,
        rarest=np.minimum(old.rarest[rows], density),
        scatterer=wave.surface.instance[rows],
        travelled=np.zeros(len(alive)),
        portals=None if old.portals is None else old.portals[rows],
        received=None if old.received is None else old.received[rows],
        beyond=None if beyond is None else beyond[rows],
    )
    straight = sample.goes_straight[rows]
    if straight.any():
        going_on = go_straight(going_on, wave, alive, straight)
    if old.media is not None:
        media = cross_surfaces(old.media.select(alive), wave.surface.select(alive), direction, straight)
        going_on = replace(going_on, media=media)
    return going_on if sample.portals is None else leave_portals(going_on, wave, sample.portals, alive)


def go_straight(going_on: Paths, wave: Wave, rows: Indices, straight: Booleans) -> Paths:
    """Return paths, those at `rows` (k,) of a wave, of which some go on `straight` (k,), as if nothing had been met."""
    old, hits = wave.paths.select(rows), wave.hits.select(rows)
    across = straight[:, np.newaxis]
    return replace(
        going_on,
        rays=keep_straight(going_on.rays, old.rays, hits, straight),
        kind=np.where(straight, old.kind, going_on.kind),
        passages=old.passages + find_counted(old.media, wave.surface.material[rows], straight),
        scatter_origin=np.where(across, old.scatter_origin, going_on.scatter_origin),
        scatter_normal=np.where(across, old.scatter_normal, going_on.scatter_normal),
        density=np.where(straight, old.density, going_on.density),
        scatterer=np.where(straight, old.scatterer, going_on.scatterer),
        travelled=np.where(straight, hits.distance * length(old.rays.directions), 0.0),
    )


def leave_portals(paths: Paths, wave: Wave, portals: Portals, rows: Indices) -> Paths:
    """Return paths of which some have gone through portals, at the start of their next stretch.

    What they meet from there on no light sample has counted on, as after a perfect mirror.

    rows : (k,) of the paths in their wave
    """
    number = np.full(len(wave), -1)
    number[rows] = np.arange(len(rows))
    portals = portals.select(np.flatnonzero(number[portals.hit] >= 0))
    through = number[portals.hit]
    surface = wave.surface.select(portals.hit)
    leaving = emerge(depart(surface, portals.direction), find_exits(portals.position, surface.position))
    order = np.arange(len(paths))
    order[through] = len(paths) + np.arange(len(through))
    columns = {name: getattr(paths, name).copy("K") for name in ("scatter_origin", "density", "travelled")}
    columns["scatter_origin"][through] = leaving.origins
    columns["density"][through] = np.inf
    columns["travelled"][through] = 0.0
    count = paths.count_portals().copy()
    count[through] += 1
    return replace(paths, rays=join_rays([paths.rays, leaving]).select(order), portals=count, **columns)


def emerge(rays: Rays, exits: Vectors) -> Rays:
    """Return rays that start at `exits` (n, 3), from no surface, instead; where these are NaN, as they are."""
    away = ~np.isnan(exits[:, 0])
    departure = rays.departure
    if departure is not None:
        departure = replace(departure, reach=np.where(away, -1.0, departure.reach))
    return replace(rays, origins=np.where(away[:, np.newaxis], exits, rays.origins), departure=departure)


def find_counted(media: MediaStack | None, material: Integers, straight: Booleans) -> Booleans:
    """Return (n,) True where going straight through a surface counts: not through the mere border of a medium."""
    return straight if media is None else straight & ~media.index.is_border[material]


def cross_surfaces(media: MediaStack, surface: Surface, direction: Vectors, straight: Booleans) -> MediaStack:
    """Return what paths are inside of that leave n points of a surface in directions (n, 3), or go on straight (n,)."""
    crosses = straight | (surface.front == (dot(surface.geometric_normal, direction) < 0))
    return media.cross(surface.instance, surface.material, surface.front, crosses)


def keep_straight(rays: Rays, old: Rays, hits: Hits, straight: Booleans) -> Rays:
    """Return `rays`, but where they pass (n,) straight through what they have hit the old ones, behind the hits."""
    departure, count = None, len(rays)
    if rays.departure is not None or old.departure is not None:
        departure = join_departures([rays.departure, old.departure], [count, count])
    rows = np.arange(count) + count * straight
    return Rays(
        np.where(straight[:, np.newaxis], old.origins, rays.origins),
        np.where(straight[:, np.newaxis], old.directions, rays.directions),
        np.where(straight, old.t_min, rays.t_min),
        np.where(straight, old.t_max, rays.t_max),
        hits.forget(~straight),
        None if departure is None else departure.select(rows),
    )
