"""What is read of strands in motion: their points and radii at its steps, or how fast their points move.

Between two steps of k and k' points of one strand, point i of the first is where i (k' - 1) / (k - 1) is among those of
the second, straight between two of them. Those with velocities go straight on (`velocities`).
All particles of what may deform are read at each step, which no modifier tells to be needless: 10,000 strands of 17
points take 0.13 s each time. Objects whose Deformation is switched off are not read.

Radii change as points do: so do Cycles' own data, of which it takes the radii of the middle on processors (Embree).

References
----------
Blender, intern/cycles/blender/curves.cpp: which strands change their shape (sync_hair_motion), what they are at a step
(export_hair_curves_motion, ExportCurveSegmentsMotion);
kernel/geom/motion_curve.h, scene/hair.cpp (keys_for_step): radii.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import raytracer

from .strands import Strands, Values, list_hair, read_curves, read_hair
from .velocities import move_points, read_velocity
from .warnings import WarningList

# Metres that points of particles may be off their place, which Blender knows in world space: Cycles' number.
SAME_PLACE = 1e-5


@dataclass(frozen=True)
class PlacedStrands:
    """Strands: the placement that they are, themselves in their own space, and the matrix (4, 4) that places them."""

    row: int
    strands: Strands
    world_from_object: NDArray[np.float64]


@dataclass
class StrandTrack:
    """Strands of an object in motion.

    changes : True where their shape may change, and is read at each step
    velocity : (p, 3) float64, metres per second in their own space, of a Curves object's points; None without
    shapes : by time, the strands of each particle system by its name, of a Curves object by ""
    """

    changes: bool
    velocity: Values | None = None
    shapes: dict[float, dict[str, Strands]] = field(default_factory=dict)


class FollowedStrands(NamedTuple):
    """What is known of the motion of a group of curves.

    group : its number among the scene's; placed : what it is in the middle of the time
    track : of the strands' shape, None where that stays the same or shall not be blurred
    times : of the object's steps; matrices : (4, 4) at each of them, None where they are all the same
    name : the object's
    """

    group: int
    placed: PlacedStrands
    track: StrandTrack | None
    times: list[float]
    matrices: list[NDArray[np.float64]] | None
    name: str


def start_track(shown: Any, changes: bool) -> StrandTrack:
    """Return the track of an object whose deformation shall be seen; velocities take the place of shapes."""
    velocity = read_velocity(shown.data) if shown.type == "CURVES" else None
    return StrandTrack(changes and velocity is None, velocity)


def read_shapes(shown: Any, source: Any, is_render: bool) -> dict[str, Strands]:
    """Return the strands that an object shows, as they are now, by `Strands.system`."""
    if shown.type == "CURVES":
        found = [read_curves(shown.data)]
    else:
        found = [read_hair(source, system, is_render) for _, system in list_hair(source, is_render)]
    return {strands.system: strands for strands in found if strands is not None}


def make_curves_motion(
    followed: Iterable[FollowedStrands], seconds: float, warnings: WarningList
) -> list[raytracer.CurvesMotion]:
    """Return the motion of the strands that move or change their shape, in the seconds that the shutter is open."""
    motion, known = [], {}  # shapes by the strands, once for all instances
    for each in followed:
        strands = each.placed.strands
        if id(strands) not in known:
            known[id(strands)] = list_shapes(each, seconds, warnings)
        points, radii = known[id(strands)]
        if each.matrices is not None or len(points) > 1:
            matrices = each.matrices or [each.placed.world_from_object] * 2
            motion.append(raytracer.CurvesMotion(each.group, points, radii, matrices))
    return motion


def list_shapes(followed: FollowedStrands, seconds: float, warnings: WarningList) -> tuple[Values, Values]:
    """Return points (steps, p, 3) and radii (steps, p) of strands; a single step where they keep their shape."""
    strands = followed.placed.strands
    steps = list_steps(followed.track, strands, followed.times, seconds) if followed.track else []
    if steps is None:
        warnings.add("strands that come, go or are not finite: they keep their shape in motion", followed.name)
    steps = steps or [strands]
    return np.array([step.points for step in steps]), np.array([step.radii for step in steps])


def list_steps(track: StrandTrack, strands: Strands, times: list[float], seconds: float) -> list[Strands] | None:
    """Return what strands are at each step; [] where they keep their shape, None where they cannot be followed.

    strands : as they are in the middle; a step at which they are not there is as that
    """
    if track.velocity is not None:
        moved = move_points(strands.points, track.velocity, seconds)
        return None if moved is None else [replace(strands, points=points) for points in moved]
    if not track.changes:
        return []
    steps: list[Strands] = []
    for time in times:
        shape = track.shapes.get(time, {}).get(strands.system, strands)
        fitting = fit(shape, strands)
        if fitting is None:
            return None
        steps.append(fitting)
    return steps if any(differ(step, strands) for step in steps) else []


def fit(shape: Strands, middle: Strands) -> Strands | None:
    """Return strands with the points of those in the middle; None where they are more or fewer, or not finite."""
    if len(shape) != len(middle) or not (np.isfinite(shape.points).all() and np.isfinite(shape.radii).all()):
        return None
    return shape if np.array_equal(shape.first, middle.first) else resample(shape, middle.first)


def resample(shape: Strands, first: NDArray[np.int32]) -> Strands:
    """Return as many strands with other numbers of points, `first` as of Strands."""
    counts, wanted = np.diff(shape.first), np.diff(first)
    number = np.arange(first[-1]) - np.repeat(first[:-1], wanted)  # (p,) of a point on its strand
    place = number * np.repeat((counts - 1) / np.maximum(wanted - 1, 1), wanted)
    last = np.repeat(counts - 1, wanted)
    before = np.minimum(place.astype(np.int32), last)
    share = place - before
    start = np.repeat(shape.first[:-1], wanted)
    rows, following = start + before, start + np.minimum(before + 1, last)
    points, radii = (
        values[rows] + (share * (values[following] - values[rows]).T).T for values in (shape.points, shape.radii)
    )
    return replace(shape, points=points, radii=radii, first=first)


def differ(one: Strands, other: Strands) -> bool:
    """Return whether strands with equally many points are others: particles by more than rounding makes of them."""
    change = np.square(one.points - other.points).sum(axis=1) + np.square(one.radii - other.radii)
    return bool((change > (SAME_PLACE**2 if other.system else 0.0)).any())
