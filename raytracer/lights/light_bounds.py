"""Where lights are and shine, and where groups of them do: boxes and cones that hold what reaches any point.

References
----------
A. Conty Estevez, C. Kulla, "Importance Sampling of Many Lights with Adaptive Tree Splitting", HPG 2018.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats, Indices
from raytracer.arrays.vectors import normalize
from raytracer.lecture import dot
from raytracer.lights.area_lights import unit_axes
from raytracer.predicates.rounding import gamma
from raytracer.scene.lights import AreaLight, Light, PointLight, SpotLight

# Angles come from cosines, which are rounded: cones are wider by this, about the root of float64's last place.
ANGLE_MARGIN = 2.0**-24
# Light that slats let through runs in a cone of at least this half angle, to guess how bright it is.
NARROWEST_CONE = 2.0**-6
# A matrix whose columns are no further than this from equal lengths and right angles turns a cone into a cone.
SCALE_TOLERANCE = 2.0**-20


@dataclass(frozen=True, eq=False)
class LightBounds:
    """Where k lights, or groups of them, are and shine.

    low, high : (k, 3) float64, metres, boxes
    intensity : (k,) float64, about the brightest of the light's directions, W/sr; the sum of a group's
    axis : (k, 3) float64, unit
    turn : (k,) float64, radians, how far from the axis the lights point
    reach : (k,) float64, radians, how far from where they point they shine
    receivers : (k,) int64, the sets of objects that any of them lights, as bits
    """

    low: Floats
    high: Floats
    intensity: Floats
    axis: Floats
    turn: Floats
    reach: Floats
    receivers: NDArray[np.int64]

    def select(self, rows: Any) -> LightBounds:
        """Return some of the bounds: index array."""
        return LightBounds(*(getattr(self, field.name)[rows] for field in fields(LightBounds)))

    def overwrite(self, rows: Indices, bounds: LightBounds) -> None:
        """Put other bounds at `rows`."""
        for field in fields(LightBounds):
            getattr(self, field.name)[rows] = getattr(bounds, field.name)


def has_place(light: Light) -> bool:
    """True for lights that a tree can hold: all but suns."""
    return isinstance(light, PointLight | AreaLight)


def _bound_light(light: PointLight | AreaLight) -> tuple[Floats, Floats, Floats, float, float]:
    """Return half the size of a light's box (3,), its intensity, axis, turn and reach."""
    if isinstance(light, AreaLight):
        half = (np.abs(light.axis_u) + np.abs(light.axis_v)) / 2.0
        cone = light.spread / 2.0
        narrow = min(max(cone, NARROWEST_CONE), np.pi / 2 - NARROWEST_CONE)
        # How much brighter slats make the axis (`area_spread_factor`): tan h / (tan h - h).
        gain = 1.0 if light.spread >= np.pi else np.tan(narrow) / (np.tan(narrow) - narrow)
        return half, np.abs(light.power) * gain / np.pi, unit_axes(light)[2], 0.0, cone
    half, intensity = np.full(3, light.radius), np.abs(light.power) / (4.0 * np.pi)
    if isinstance(light, SpotLight) and _is_even(light.world_from_light):
        return half, intensity, -normalize(light.world_from_light[:, 2]), light.spot_size / 2.0, 0.0
    return half, intensity, np.array([0.0, 0.0, 1.0]), np.pi, 0.0


def _is_even(matrix: Floats) -> bool:
    """True where a matrix (3, 3) turns and scales alike in all directions: a round cone stays one."""
    product = np.array([[float(dot(u, v)) for u in matrix.T] for v in matrix.T])
    size = np.abs(product).max()
    return bool((np.abs(product / size - np.eye(3)) <= SCALE_TOLERANCE).all())


def bound_lights(lights: tuple[Light, ...]) -> LightBounds:
    """Return the bounds of lights that have a place."""
    half, intensity, axis, turn, reach = zip(*map(_bound_light, lights), strict=True)  # type: ignore[arg-type]
    position = np.array([light.position for light in lights])  # type: ignore[union-attr]
    margin = gamma(4) * (np.abs(position) + np.array(half))
    return LightBounds(
        low=position - half - margin,
        high=position + half + margin,
        intensity=np.array(intensity).mean(axis=1),
        axis=np.array(axis),
        turn=np.array(turn),
        reach=np.array(reach) + ANGLE_MARGIN,
        receivers=np.array([light.receivers for light in lights], np.int64),
    )


def join_bounds(bounds: LightBounds, starts: Indices) -> LightBounds:
    """Return the bounds of groups of lights that follow each other, each from one of `starts` to the next."""
    count = np.diff(np.append(starts, len(bounds.low)))
    group = np.repeat(np.arange(len(starts)), count)
    mean = normalize(np.add.reduceat(bounds.intensity[:, np.newaxis] * bounds.axis, starts, axis=0))
    axis = np.where(mean.any(axis=1, keepdims=True), mean, bounds.axis[starts])
    away = np.arccos(np.clip(dot(bounds.axis, axis[group]), -1.0, 1.0))
    # One light's axis is its own.
    turn = bounds.turn + np.where(count[group] > 1, away + ANGLE_MARGIN, 0.0)
    return LightBounds(
        low=np.minimum.reduceat(bounds.low, starts, axis=0),
        high=np.maximum.reduceat(bounds.high, starts, axis=0),
        intensity=np.add.reduceat(bounds.intensity, starts),
        axis=axis,
        turn=np.minimum(np.maximum.reduceat(turn, starts), np.pi),
        reach=np.maximum.reduceat(bounds.reach, starts),
        receivers=np.bitwise_or.reduceat(bounds.receivers, starts),
    )
