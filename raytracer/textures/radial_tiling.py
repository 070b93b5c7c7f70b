"""The plane around the origin in segments of a regular polygon with rounded corners: the Radial Tiling node.

The polygon has n sides at the distance 1 and corners that are rounded by a share r. A *half* segment reaches from the
middle of a side to a corner; of its angle H, the side is straight over c and an arc over b = H - c,

    tan c = (1 - r) tan H.

Where n is no whole number, one segment is narrower, and the corners on both sides of it have arcs of their own, whose
circle touches both sides. Scaled copies of the polygon fill the plane: a point lies on that of the size L. Along its
side, from the middle, goes the length p, which bends over from an arc's length to an angle within a part s = (1 - r) b
of the corner; over p's length at the corner it is normalized.

References
----------
Blender, intern/cycles/kernel/svm/radial_tiling_shared.h (by L. Tönne): the polygon, its lengths and their order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from raytracer.arrays.rows import split_columns
from raytracer.arrays.types import Floats

TURN = 2.0 * np.pi


class Tiling(NamedTuple):
    """What is known of n points: coordinates within the segment (n, 3), and of the segment, (n,) each, its number, how
    wide half of it is where L is 1, and the angle to its middle."""

    coordinates: Floats
    number: Floats
    width: Floats
    rotation: Floats


class Half(NamedTuple):
    """Half segments, numbers (n,) each.

    angle : H, radians; straight : c; arc : b; bent : s; roundness : b's share that p counts as an angle
    scale : the size of the whole polygon where the middle of the side lies at the distance 1
    x, y, radius : of the circle of the arc: its middle, of x axes along the corner and y towards the next segment
    """

    angle: Floats
    straight: Floats
    arc: Floats
    bent: Floats
    roundness: Floats
    scale: Floats
    x: Floats
    y: Floats
    radius: Floats

    def find_size(self, distance: Floats, inward: Floats) -> Floats:
        """Return the size (n,) of the copy whose arc goes through points at a distance from the origin.

        inward : (n,) radians, from the corner
        """
        along = np.cos(inward) * self.x - np.sin(inward) * self.y
        return distance / (along + np.sqrt(np.maximum(along**2 + self.radius**2 - self.x**2 - self.y**2, 0.0)))

    def measure_arc(self, distance: Floats, left: Floats) -> Floats:
        """Return p (n,) of points within arcs, at a distance from the origin, by the angle `left` behind its start."""
        rise = distance * np.cos(self.straight)
        within = rise * left + 0.5 * (1.0 - rise) * left**2 / self.bent
        beyond = self.bent * (0.5 * rise - 0.5) + left
        return distance * np.sin(self.straight) + np.where(left < self.bent, within, beyond)

    def measure_whole(self, side: Floats, rise: Floats) -> Floats:
        """Return p (n,) at the corner; side : of its straight part; rise : of the distance, towards the middle."""
        return side + self.bent * (0.5 * rise + 0.5) + self.roundness * self.arc

    def measure_width(self) -> Floats:
        """Return p (n,) at the corner of the polygon of size 1."""
        rest = self.scale * (self.bent / 2.0 + self.roundness * self.arc)
        return np.tan(self.straight) + self.bent / 2.0 + rest


def tile_radially(vector: Floats, sides: Floats, roundness: Floats, *, normalize: bool) -> Tiling:
    """Return the segments that points (n, 3) lie in; sides, roundness : (n,) or ()."""
    x, y = split_columns(np.asarray(vector, float)[..., :2])
    x, y, sides, roundness = np.broadcast_arrays(x, y, np.maximum(sides, 2.0), np.clip(roundness, 0.0, 1.0))
    # Two sides without an end; in Cycles they turn to noise where they are to be rounded.
    is_strip = (sides == 2.0) & (roundness < 1.0)
    roundness = np.where(is_strip, 0.0, roundness)
    angle, step = np.arctan2(y, x), TURN / sides
    angle = np.where(y < 0, angle + TURN, angle)
    segment = np.floor(angle / step)
    with np.errstate(all="ignore"):
        half, width = _choose_half(angle, step / 2.0, sides, roundness)
        local = angle - segment * step - half.angle  # from the middle of the side
        size, along, whole = _measure(half, np.hypot(x, y), local)
        if normalize:
            along = np.where(is_strip, along, along / whole)
    along = np.where((x == 0) & (y == 0), 0.0, along)
    pair = (0.5 * along + 0.5, size) if normalize else (along, size - 1.0)
    width = np.where(is_strip, 0.0, width)
    return Tiling(np.stack([*pair, np.zeros_like(size)], axis=-1), segment, width, segment * step + half.angle)


def _measure(half: Half, distance: Floats, local: Floats) -> tuple[Floats, Floats, Floats]:
    """Return L, p and p at the corner, (n,) each, of points at a distance from the origin, and angles from the middle
    of their sides."""
    inward = half.angle - np.abs(local)
    left = half.arc - inward
    is_round = left > 0
    size = np.where(is_round, half.find_size(distance, inward), distance * np.cos(local))
    bent = np.copysign(half.measure_arc(distance, left), local)
    along = np.where(is_round, bent, distance * np.sin(local))
    whole = half.measure_whole(size * np.tan(half.straight), size)
    at_corner = half.measure_whole(distance * np.sin(half.straight), distance * np.cos(half.straight))
    whole = np.where(is_round, whole + (at_corner - whole) * left / half.arc, whole)
    return half.scale * size, half.scale * along, half.scale * whole


def _choose_half(angle: Floats, regular: Floats, sides: Floats, roundness: Floats) -> tuple[Half, Floats]:
    """Return the half segments that points at angles (n,) lie in, and p at the corner of their segment.

    regular : (n,) the angle of half a segment
    """
    whole = _make_half(regular, roundness)
    straight = sides % 1.0 != 0
    if not straight.any():
        return whole, whole.measure_width()
    narrow, outer = _join_halves(whole, np.pi - np.floor(sides) * regular, roundness)
    start = TURN - 2.0 * narrow.angle
    is_narrow = straight & (angle >= start)
    is_outer = straight & ~is_narrow & ((angle < regular) | (angle >= start - regular))
    chosen = Half(*(np.select([is_narrow, is_outer], [a, b], c) for a, b, c in zip(narrow, outer, whole, strict=True)))
    return chosen, np.where(is_narrow, narrow.measure_width(), whole.measure_width())


def _make_half(angle: Floats, roundness: Floats) -> Half:
    """Return halves between two like segments, whose circle lies on the line to the corner."""
    straight = np.arctan((1.0 - roundness) * np.tan(angle))
    arc, middle = angle - straight, (1.0 - roundness) / np.cos(angle)
    one = np.ones_like(angle)
    return Half(angle, straight, arc, (1.0 - roundness) * arc, roundness, one, middle, 0.0 * one, roundness)


def _join_halves(regular: Half, narrow: Floats, roundness: Floats) -> tuple[Half, Half]:
    """Return the halves of a narrow segment, of an angle (n,), and those of the segments beside it.

    Both sides of the corner between them touch its circle; lengths are in units of the narrow side's distance first.
    """
    own = _make_half(narrow, roundness)
    scale = np.cos(regular.angle) / np.cos(narrow)
    radius = roundness * np.tan(narrow) / np.tan(0.5 * (regular.angle + narrow))
    start = 1.0 / np.cos(own.straight)  # how far from the origin the arc begins, the angle own.arc below the corner
    x = np.cos(own.arc) * start - radius * np.cos(narrow)
    y = radius * np.sin(narrow) - np.sin(own.arc) * start
    arc = np.arctan((y + radius * np.sin(regular.angle)) / (x + radius * np.cos(regular.angle)))
    straight = regular.angle - arc
    share = 1.0 - np.tan(straight) / np.tan(regular.angle)
    circle = (x / scale, -y / scale, radius / scale)
    outer = Half(regular.angle, straight, arc, (1.0 - share) * arc, share, np.ones_like(arc), *circle)
    return own._replace(scale=scale, x=x, y=y, radius=radius), outer
