"""How rays came to points, as the Light Path node tells, for every kind of ray that evaluates a program.

Paths count what they did; rays that only sample light, or see whether it arrives, are described from the path that
casts them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from raytracer.arrays.rows import sum_columns, take_rows
from raytracer.arrays.types import Counts, Floats, Kinds
from raytracer.bsdfs.bounce_kinds import COUNTED, count_bounces, describe_kinds
from raytracer.shading.probes import Probe


@dataclass(frozen=True, eq=False)
class LightPath:
    """How a ray came to n points, as the Light Path node tells: flags as 0 or 1, lengths, depths; all (n,) float64.

    What a field does not say is 0.

    probe : what casts rays from the points, for programs that ask; None where nothing does
    """

    values: dict[str, Floats]
    probe: Probe | None = None

    def select(self, rows: Any) -> LightPath:
        """Return some of the rays: index or boolean array."""
        probe = None if self.probe is None else self.probe.select(rows)
        return LightPath({name: value[rows] for name, value in self.values.items()}, probe)


# How far rays go that hit nothing, as programs see it: Cycles' largest number.
FARTHEST = float(np.finfo(np.float32).max)


@dataclass(frozen=True, eq=False, slots=True)
class Depths:
    """How far paths have come to n points.

    passages : (n,) int32, straight through surfaces
    bounces : (n, 4) int32, of each kind in COUNTED; None where no program asks
    """

    passages: Counts
    bounces: Counts | None = None

    def select(self, rows: Any) -> Depths:
        """Return some of the points: index or boolean array."""
        return Depths(self.passages[rows], None if self.bounces is None else take_rows(self.bounces, rows))


def describe_shadow_rays(length: Floats, depths: Depths | None = None, passed: Counts | int = 0) -> LightPath:
    """Return what programs can ask of shadow rays at n surfaces that they meet.

    length : (n,) float64, metres from where the rays start
    depths : of the paths that cast the rays
    passed : surfaces that the rays have passed before
    """
    return LightPath({"shadow": np.ones(len(length)), **describe_sampling(length, depths, passed).values})


def describe_reflected(kind: Kinds, length: Floats, depths: Depths, passed: Counts | int = 0) -> LightPath:
    """Return what programs can ask of rays that are reflected in ways (n,) of `bounce_kinds`; other arguments as of
    `describe_shadow_rays`."""
    path = describe_sampling(length, depths, passed)
    if depths.bounces is None:
        return path
    return LightPath({**path.values, **describe_kinds(kind, count_bounces(depths.bounces, kind))})


def put_further(path: LightPath) -> LightPath:
    """Return what programs of the world can ask of rays that see it: for Cycles it is one bounce further."""
    return LightPath({**path.values, "depth": path.values["depth"] + 1.0}) if "depth" in path.values else path


def describe_sampling(length: Floats, depths: Depths | None = None, passed: Counts | int = 0) -> LightPath:
    """Return what programs can ask of rays by which light is sampled; arguments as of `describe_shadow_rays`.

    What kind of ray it is they are not told, for one sample serves all ways of reflection; and the light is one bounce
    further than the point that it lights, but counted as of no kind (svm/light_path.h).
    """
    values = {"length": length, "travelled": np.zeros(len(length))}
    if depths is None or depths.bounces is None:
        return LightPath(values)
    counted = depths.bounces.astype(np.float64)
    return LightPath(
        {
            **values,
            "depth": sum_columns(counted) + 1.0,
            **{f"{name}_depth": counted[:, column] for column, name in enumerate(COUNTED)},
            "transparent_depth": depths.passages.astype(np.float64) + passed,
        }
    )
