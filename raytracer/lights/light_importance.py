"""What groups of lights promise points: the guess by which a few of many lights are picked.

    importance = intensity max(<cos a>, c) max(<cos b>, c) / max(d^2, R^2),

d the distance to the middle of the box around the lights, R its radius as a sphere, a the angle between the way to the
point and the direction that the lights point to, b the one between the normal and the way to the lights. <> is what is
left of a cosine on average over the box, where that crosses the horizon: of heights h above the horizon, even between
m - r and m + r, the mean of max(h, 0) is

    m  for m >= r,    (m + r)^2 / (4 r)  for |m| < r,    0  below.

Nothing is promised where no light of the group shines: beyond all their cones, or to objects that they are kept from.
All else has a promise above 0, so that what is picked by it has no bias, however poor the guess. Square roots are the
worst that is computed, so every processor promises the same.

References
----------
A. Conty Estevez, C. Kulla, "Importance Sampling of Many Lights with Adaptive Tree Splitting", HPG 2018.
Blender, intern/cycles/kernel/light/tree.h.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.lecture import dot
from raytracer.lights.light_bounds import LightBounds

# What is seen from aside keeps this share of its importance, for surfaces that are no matt ones; and what is behind the
# surface this, for those that light comes through.
LEAST_COSINE = 2.0**-6
SHARE_BEHIND = 2.0**-4
# A point on a light that is a point itself: as bright as a float64 can tell.
SMALLEST = np.finfo(np.float64).tiny


@dataclass(frozen=True, eq=False, slots=True)
class Receivers:
    """n points that are lit.

    position, normal : (3, n) float64, by axis; the normal, unit, on the side that the light is reflected to
    sets : (n,) int64, of the objects that they are on; None where all lights light all
    """

    position: Floats
    normal: Floats
    sets: NDArray[np.int64] | None

    def __len__(self) -> int:
        return self.position.shape[1]

    def select(self, rows: Any) -> Receivers:
        """Return some of the points: slice or index array."""
        sets = None if self.sets is None else self.sets[rows]
        return Receivers(self.position[:, rows], self.normal[:, rows], sets)


@dataclass(frozen=True, eq=False)
class LightClusters:
    """k groups of lights, each as its box and the cone that it shines in.

    middle, half : (3, k) float64, metres, of the boxes, by axis
    radius, square_radius : (k,) float64, of spheres around them
    intensity : (k,) float64, W/sr
    axis : (3, k) float64, unit, by axis
    cos_turn, sin_turn : (k,) float64, of the angle from the axis that the lights point in
    extent : (k,) float64, metres, how far from the box's middle the lights are, along the directions they point in
    cos_reach : (k,) float64, of the angle from the axis that they shine in
    is_aimed : (k,) bool, False where some point in all directions
    receivers : (k,) int64, the sets of objects that any of them lights, as bits
    """

    middle: Floats
    half: Floats
    radius: Floats
    square_radius: Floats
    intensity: Floats
    axis: Floats
    cos_turn: Floats
    sin_turn: Floats
    extent: Floats
    cos_reach: Floats
    is_aimed: Booleans
    receivers: NDArray[np.int64]


def measure_clusters(bounds: LightBounds) -> LightClusters:
    """Return groups of lights as `find_importance` needs them.

    Along an axis n the box reaches sum_i half_i |n_i|, along one that is turned from it by t at most 2 sin(t / 2) R
    further, and R along any.
    """
    half = (bounds.high - bounds.low) / 2.0
    square_radius = dot(half, half)
    radius = np.sqrt(square_radius)
    along = dot(half, np.abs(bounds.axis)) + 2.0 * np.sin(bounds.turn / 2.0) * radius
    return LightClusters(
        middle=np.ascontiguousarray((bounds.low + half).T),
        half=np.ascontiguousarray(half.T),
        radius=radius,
        square_radius=square_radius,
        intensity=bounds.intensity,
        axis=np.ascontiguousarray(bounds.axis.T),
        cos_turn=np.cos(bounds.turn),
        sin_turn=np.sin(bounds.turn),
        extent=np.minimum(along, radius),
        cos_reach=np.cos(np.minimum(bounds.turn + bounds.reach, np.pi)),
        is_aimed=bounds.turn < np.pi,
        receivers=bounds.receivers,
    )


def find_importance(clusters: LightClusters, group: Indices, points: Receivers, row: Indices) -> Floats:
    """Return how much groups (k,) promise points by their rows (k,)."""
    offset = [
        middle.take(group) - place.take(row) for middle, place in zip(clusters.middle, points.position, strict=True)
    ]
    square = offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2]
    around = clusters.square_radius.take(group)
    nearness = 1.0 / np.maximum(np.maximum(square, around), SMALLEST)
    closeness = np.sqrt(nearness)
    importance = (
        clusters.intensity.take(group) * nearness * _find_facing(clusters, group, points, row, offset, closeness)
    )
    aimed = np.flatnonzero(clusters.is_aimed.take(group) & (square > around))
    if len(aimed):
        away = [-values.take(aimed) for values in offset]
        importance[aimed] *= _find_cone_factor(clusters, group.take(aimed), away, np.sqrt(square.take(aimed)))
    if points.sets is not None:
        importance[(clusters.receivers.take(group) >> points.sets.take(row)) & 1 == 0] = 0.0
    return importance


def _find_facing(
    clusters: LightClusters, group: Indices, points: Receivers, row: Indices, offset: list[Floats], closeness: Floats
) -> Floats:
    """Return max(<cos b>, c) (k,); what lies behind counts less. Arguments as of `find_importance`.

    offset : to the middle of the group, three of (k,), and closeness : (k,) the inverse of its length
    """
    normal = [values.take(row) for values in points.normal]
    height = offset[0] * normal[0] + offset[1] * normal[1] + offset[2] * normal[2]
    half = [values.take(group) for values in clusters.half]
    extent = half[0] * np.abs(normal[0]) + half[1] * np.abs(normal[1]) + half[2] * np.abs(normal[2])
    before = average_above(height, extent)
    facing = np.maximum(before, SHARE_BEHIND * (before - height)) * closeness
    return np.minimum(np.maximum(facing, LEAST_COSINE), 1.0)


def average_above(height: Floats, extent: Floats) -> Floats:
    """Return the mean (k,) of max(h, 0) over heights h even between `height` - `extent` and `height` + `extent`."""
    above = np.minimum(np.maximum(height, -extent), extent) + extent
    return above * above / (4.0 * extent + SMALLEST) + np.maximum(height - extent, 0.0)


def _find_cone_factor(clusters: LightClusters, group: Indices, offset: list[Floats], distance: Floats) -> Floats:
    """Return max(<cos a>, c) of groups (k,) for points outside the spheres around them; 0 where none of their lights
    shines that far aside.

    offset : from the middle of the group, three of (k,), and distance : (k,) its length
    """
    axis = [values.take(group) for values in clusters.axis]
    cosine = (offset[0] * axis[0] + offset[1] * axis[1] + offset[2] * axis[2]) / distance
    sine = np.sqrt(np.maximum(1.0 - cosine * cosine, 0.0))
    # The light that points nearest to the way to the point.
    cos_turn = clusters.cos_turn.take(group)
    nearest = np.where(cosine >= cos_turn, 1.0, cosine * cos_turn + sine * clusters.sin_turn.take(group))
    factor = average_above(nearest * distance, clusters.extent.take(group)) / distance
    # The sphere is seen at a half angle w: cos(a - w), where a > w.
    sin_width = clusters.radius.take(group) / distance
    cos_width = np.sqrt(np.maximum(1.0 - sin_width * sin_width, 0.0))
    beyond = (cosine < cos_width) & (cosine * cos_width + sine * sin_width < clusters.cos_reach.take(group))
    return np.where(beyond, 0.0, np.minimum(np.maximum(factor, LEAST_COSINE), 1.0))
