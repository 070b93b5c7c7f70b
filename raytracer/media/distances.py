"""How far light gets in media that are the same all along a ray, in closed form, and where it is scattered.

In a channel of extinction x the share exp(-x t) gets as far as t. Distances are sampled by the density of one channel,
x exp(-x t), chosen by the light that it has to scatter, and weighed by that of all (one-sample balance heuristic). To
lights that have a place distances are sampled as well so that they spread evenly over the angle at which the light sees
them, for near it the light is as strong as that density:

    D / ((b - a) (D^2 + s^2))

at s from the point of the ray that is nearest to the light, D away; a and b are the angles of the ray's ends.

References
----------
C. Kulla, M. Fajardo, "Importance Sampling Techniques for Path Tracing in Participating Media", EGSR 2012: equiangular.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from raytracer.arrays.rows import sum_columns
from raytracer.arrays.types import Booleans, Colors, Floats, Numbers, Vectors
from raytracer.casting.rays import select_rows
from raytracer.lecture import dot, length

# Of the light that a channel carries, so much counts for its choice however little of it is scattered: no channel that
# light gets through by is left to others alone.
LEAST_ALBEDO = 0.1
# A light on the ray itself counts as so far from it, as a share of the way to the ray's further end.
LEAST_OFFSET = 2.0**-20


def find_transmittance(extinction: Colors, distance: Numbers) -> Colors:
    """Return exp(-x t) (n, 3); 1 where nothing is extinguished, however far."""
    depth = np.multiply(extinction, distance[:, np.newaxis], out=np.zeros_like(extinction), where=extinction > 0)
    return np.exp(-depth)


def sum_emission(extinction: Colors, emission: Colors, distance: Numbers) -> Colors:
    """Return e (1 - exp(-x t)) / x, (n, 3), e t where x is 0: what a ray sees of what shines along it.

    What shines without end and absorbs nothing would be infinitely bright: it is left out.
    """
    reach = np.where(np.isfinite(distance), distance, 0.0)[:, np.newaxis]
    clear = emission * reach
    absorbed = 1.0 - find_transmittance(extinction, distance)
    near = -np.expm1(-np.minimum(extinction * reach, 1.0))
    absorbed = np.where((extinction * reach < 1.0) & np.isfinite(distance)[:, np.newaxis], near, absorbed)
    seen = np.divide(absorbed, extinction, out=np.zeros_like(extinction), where=extinction > 0)
    return np.where(extinction > 0, emission * seen, clear)


def weigh_channels(extinction: Colors, scattering: Colors, throughput: Colors) -> Colors:
    """Return the probabilities (n, 3) with which distances are sampled by each channel."""
    albedo = np.divide(scattering, extinction, out=np.ones_like(extinction), where=extinction > 0)
    light = np.abs(throughput) * (LEAST_ALBEDO + (1.0 - LEAST_ALBEDO) * albedo)
    total = sum_columns(light)[:, np.newaxis]
    return np.divide(light, total, out=np.full_like(light, 1.0 / 3.0), where=total > 0)


@dataclass(frozen=True, eq=False, slots=True)
class DistanceSample:
    """Where n rays are scattered.

    distance : (n,) float64, metres from their starts; their ends' where they get through
    scattered : (n,) bool
    weight : (n, 3) float64, what light counts from there of what it has counted before
    """

    distance: Numbers
    scattered: Booleans
    weight: Colors


def sample_distances(
    extinction: Colors, scattering: Colors, channels: Colors, reach: Numbers, pair: Floats
) -> DistanceSample:
    """Sample distances up to `reach` (n,), metres.

    channels : of `weigh_channels`; pair : (n, 2) uniform numbers
    """
    upper = np.cumsum(channels, axis=1)
    column = np.minimum((pair[:, 1:] >= upper).sum(axis=1), 2)
    chosen = extinction[np.arange(len(extinction)), column]
    free = -np.log1p(-pair[:, 0])
    distance = np.divide(free, chosen, out=np.full_like(free, np.inf), where=chosen > 0)
    scattered = distance < reach
    distance = np.where(scattered, distance, reach)
    left = find_transmittance(extinction, distance)
    value = np.where(scattered[:, np.newaxis], scattering, 1.0) * left
    density = sum_columns(channels * left * np.where(scattered[:, np.newaxis], extinction, 1.0))[:, np.newaxis]
    weight = np.divide(value, density, out=np.zeros_like(value), where=density > 0)
    return DistanceSample(distance, scattered, weight)


def find_density(extinction: Colors, channels: Colors, distance: Numbers) -> Numbers:
    """Return the density (n,) per metre with which distances are sampled."""
    return sum_columns(channels * extinction * find_transmittance(extinction, distance))


@dataclass(frozen=True, eq=False, slots=True)
class Angles:
    """Rays as lights see them.

    nearest : (n,) float64, metres from the rays' starts to where they are nearest to the light
    offset : (n,) float64, metres from there to the light
    first, span : (n,) float64, radians, the angle of the start, and from there to the end
    """

    nearest: Numbers
    offset: Numbers
    first: Numbers
    span: Numbers

    def select(self, rows: Any) -> Angles:
        """Return some of the rays: index or boolean array."""
        return select_rows(self, rows)


def measure_angles(start: Vectors, direction: Vectors, reach: Numbers, light: Vectors) -> Angles:
    """Return rays from `start` (n, 3) in unit directions, `reach` (n,) long, as lights at places (3,) see them."""
    towards = light - start
    nearest = dot(towards, direction)
    offset = length(towards - nearest[:, np.newaxis] * direction)
    furthest = np.maximum(np.abs(nearest), np.where(np.isfinite(reach), np.abs(reach - nearest), 0.0))
    offset = np.maximum(offset, np.maximum(LEAST_OFFSET * furthest, np.finfo(np.float64).tiny))
    first = np.arctan2(-nearest, offset)
    return Angles(nearest, offset, first, np.arctan2(reach - nearest, offset) - first)


def sample_angles(angles: Angles, number: Numbers) -> Numbers:
    """Return distances (n,) from the rays' starts, for uniform numbers (n,)."""
    return np.maximum(angles.nearest + angles.offset * np.tan(angles.first + number * angles.span), 0.0)


def find_angle_density(angles: Angles, distance: Numbers) -> Numbers:
    """Return the density (n,) per metre with which `sample_angles` takes distances."""
    beside = distance - angles.nearest
    area = angles.span * (angles.offset * angles.offset + beside * beside)
    return np.divide(angles.offset, area, out=np.zeros_like(area), where=area > 0)
