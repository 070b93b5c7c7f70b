"""All emissive geometry as one source of light (`light_sources`)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import join_columns
from raytracer.arrays.types import Floats, Indices, Integers, Masks
from raytracer.integrator.light_sources import ALONE, GEOMETRY, KeyedSamples, LightSource, ShadingPoints, fill_key
from raytracer.lights.emitter_table import Emitters, locate_emitters
from raytracer.lights.emitters import (
    pick_emitters,
    place_on_triangles,
    sample_picked,
    sample_placed,
    stretch_choice,
    vary_radiance,
)
from raytracer.lights.light_linking import LightLinks

# Emissive primitives that are picked by the number that also tells the place: its steps of 2^-32 are felt as one part
# in a million of their light at most.
MOST_BY_PAIR = 1 << 12


@dataclass(frozen=True, eq=False, kw_only=True)
class EmissiveGeometry(LightSource):
    """All emissive geometry: a number to choose by, and a pair for the place, by which few are chosen as well.

    seen_by_object : (instances + groups,) uint8, bits of SEEN_BY, the ways in which light of each is reflected; None
        for all
    light_groups : (instances + groups,) int32, as of LightSource, of each object; None where nobody asks
    blockers_by_object : (instances + groups,) int64, as of LightSource, of each object; None where all block all
    picks_by_pair : True for no more than MOST_BY_PAIR, so that points are even over all of them together
    """

    dimension_count: ClassVar[int] = 2
    emitters: Emitters
    links: LightLinks | None
    seen_by_object: Masks | None = None
    light_groups: Integers | None = None
    blockers_by_object: NDArray[np.int64] | None = None
    picks_by_pair: bool = False
    kind: int = GEOMETRY

    def sample(self, points: ShadingPoints) -> KeyedSamples:
        """Return samples on primitives picked by power: one that sets of pixels share, or each point's own."""
        emitters, sampler, shared = self.emitters, points.sampler, points.sampler.shared
        if shared is not None and not emitters.has_spheres:
            pair = shared.uniform_pair(sampler.dimension + 1)
            picked, pair = self._pick(pair, partial(shared.uniform, sampler.dimension))
            light = sample_placed(place_on_triangles(emitters, picked, pair).select(shared.key), points.surface)
            picked, pair, key = picked[shared.key], pair[shared.key], shared.key.astype(np.int32)
            vary_radiance(emitters, picked, pair, points.surface, light, points.depths)
        else:
            picked, pair = self._pick(sampler.joined_pair(1), sampler.uniform)
            light, key = sample_picked(emitters, points.surface, picked, pair, points.depths), fill_key(points, ALONE)
        if self.links is not None:
            receivers = self.links.receivers[locate_emitters(emitters, picked)[0]]
            light.weight[~self.links.find_lit(receivers, points.surface.instance)] = 0.0
        by_object = (self.seen_by_object, self.light_groups, self.blockers_by_object)
        return KeyedSamples(light, key, *(self._look_up(table, picked) for table in by_object))

    def _pick(self, pair: Floats, draw: Callable[[], Floats]) -> tuple[Indices, Floats]:
        """Return the numbers (n,) of emitters, and the pairs (n, 2) of places on them.

        pair : (n, 2) uniform numbers; draw : returns (n,) others
        """
        if not self.picks_by_pair:
            return pick_emitters(self.emitters, draw()), pair
        picked = pick_emitters(self.emitters, pair[:, 0])
        return picked, join_columns(stretch_choice(self.emitters, picked, pair[:, 0]), pair[:, 1])

    def _look_up(self, table: NDArray[Any] | None, picked: Indices) -> NDArray[Any] | None:
        """Return what a table by object, if there is one, says of emitters (n,)."""
        return None if table is None else table[locate_emitters(self.emitters, picked)[0]]


def make_geometry_source(
    emitters: Emitters, links: LightLinks | None, seen_by_object: Masks | None, by_pair: bool
) -> EmissiveGeometry:
    """Return all emissive geometry as a source; arguments as of `EmissiveGeometry`.

    by_pair : False where samples stand for the middle of their ranges, as none of the few that are picked then is
    """
    few = emitters.instanced is None and len(emitters.cumulative) <= MOST_BY_PAIR
    return EmissiveGeometry(
        emitters=emitters, links=links, seen_by_object=seen_by_object, picks_by_pair=by_pair and few
    )
