"""What is certain of all pairs of rays and a few dozen triangles at once, in float32, without a list of pairs.

A triangle is *left out* if the ray's line certainly passes outside (`matrix_form`), or if its origin o and o + h d are
certainly on one side of the triangle's plane. It is *met* if the line certainly passes inside, and o and o + h d are
certainly on different sides. Of rays that ask for any hit h is the end of their range: one that meets a triangle is
decided, and so is one for which all are left out. Of others h is a little behind what float32 takes to be the nearest
hit, which may be wrong: if the ray meets a triangle and all others are left out, it is the nearest.

Sides, with a triangle's normal N, its corner a, k = 1 / h:

    T = N . (a - o),        Z = k N . (a - o - h d) = k T - D,        D = N . d

In the frame of the scene coordinates of corners are at most 1, of directions too, and those of origins at most F. N has
a largest component of 1, nu = |N_x| + |N_y| + |N_z|, and is off by e - 7 u in each component, see `planes.make_planes`.

T is one product of four columns in float64, u = 2^-53: (N, c) . (-o, 1), c = N . a. Origins and corners are off by u F
and u as they are placed in the frame, c by gamma(3) nu for its own roundings, the product by gamma(4) nu (1 + F) and a
little; with the exact N it would be another by (e - 7 u) 3 (1 + F). So T is off by less than

    (1 + F) (gamma(9) nu + 3 (e - 7 u)).

In an axis plane, N = (0, 0, 1), the triangle's corners have one coordinate z, and T = z - o_z has one rounding beside
those of placing z and o_z in the frame. All keep order: where T is not 0, its sign is true, and a ray leaves a wall,
however near to it it starts.

In Z T is rounded to float32, u = 2^-24, k is off by two roundings, or none, and the product by one; N and d are
rounded, a product and two sums make D; and so is Z. One more pays for what T and N are off by, below u, else the plane
decides nothing:

    Z is off by less than nu gamma(8) (k (1 + F) + 1)

Edge functions are off by gamma(12) (6 + 12 F): as in `matrix_form`, but moments are made in float32 (4 roundings of
terms of 2 F), and scaled there.

A triangle is settled only where `query` would find it certain, or else measure it otherwise. What is met inside lies
in the scene: t <= 2 (1 + F). With |T| = t |D| > 2^-20 (1 + F) and share e < 2^-39 what `planes.meet_planes` leaves in
doubt there, share (3 (1 + F) + 4 t) e / (|D| - 3 e), is below 2^-14 t. The range begins at 0, and ends behind h by 2^-9
of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.casting.bvh.tree import Frame
from raytracer.casting.framed import FramedRays, largest_row
from raytracer.predicates.rounding import UNIT_ROUNDOFF, gamma

FLOAT32_ROUNDOFF = 2.0**-24
# Roundings of a product of six columns, of T in float64 and of Z in float32.
LINE_ROUNDINGS, SIDE_ROUNDINGS, END_ROUNDINGS = 12, 9, 8
# More than what bounds lose as they are computed, and what a few roundings to float32 take away.
ROUND_UP = np.float32(1 + 2.0**-20)
# In axis planes any T but 0 is certain; what is not above this is left in doubt, as underflow may be.
LEAST_SIDE = 2.0**-60
# Edge functions are certain beyond this number, and nothing is certain of rays that start farther away than the other:
# t to the scene is at most 2 (1 + F). So the larger of both orders the triangles that a ray may meet by distance, and
# puts all others behind them.
CERTAIN, FARTHEST = np.float32(2.0**20), 2.0**18
# Ends nearer than the inverse of this bring more doubt than they spare.
NEAREST_END = 32.0
# The end lies behind the guess by a share of it and by so much: all that float32 may be off by, nearly always.
BEHIND_SHARE, BEHIND = 2.0**-12, 2.0**-16
# By what share of it the range ends behind h at least.
RANGE_SHARE = 2.0**-9
# T that is beyond this, per 1 + F, of planes whose bound times share is below the other, make a distance well known.
WELL_BEYOND, LARGEST_DOUBT = 2.0**-20, 2.0**-39
# Rays of a product, as in `matrix_form`; pairs looked at together, which fit the cache.
PACKET, PAIRS = 256, 1 << 16


class Nearest(NamedTuple):
    """What is certain of the nearest hits of n rays.

    row : (n,) the triangle that rays that are `certain` (n,) hit first, well within their reach
    free : (n,) True for rays that hit none
    """

    row: Indices
    certain: Booleans
    free: Booleans


class Occlusion(NamedTuple):
    """Which of n rays hit something.

    met : (n,) True for those that certainly do
    lane, row, inside : (k,) triangles that others may hit, by ray, and whether their lines certainly pass inside
    """

    met: Booleans
    lane: Indices
    row: Indices
    inside: Booleans


class Packets:
    """What p packets of l rays, at most `most`, have with t triangles and with their planes; the same memory for all.

    edges : (p, 3 t, l) float32; outside : (p, t, l) float32, above CERTAIN where the line certainly passes outside,
    below -CERTAIN where inside; time : (p, t, l) float32
    wide : (p, planes, l) float64; side, slope, end : (p, planes, l) float32, T, D and Z; inverse : (p, l) float32, k
    side_error, end_error, well_beyond : (planes, 1) float32, what T and Z are certain beyond, and T well known
    """

    def __init__(self, most: int, triangles: int, planes: int) -> None:
        self.edges = np.empty((most, 3 * triangles, PACKET), np.float32)
        # Each its own memory: of neighbors at whole multiples of so many bytes reads wait for writes.
        self.outside, self.time = (np.empty((most, triangles, PACKET), np.float32) for _ in range(2))
        self.out, self.beside = (np.empty((most, triangles, PACKET), np.bool_) for _ in range(2))
        self.wide = np.empty((most, planes, PACKET))
        self.side, self.slope, self.end = (np.empty((most, planes, PACKET), np.float32) for _ in range(3))
        self.signs = [np.empty((most, planes, PACKET), np.bool_) for _ in range(4)]
        self.inverse = np.empty((most, PACKET), np.float32)
        self.side_error, self.end_error, self.well_beyond = np.empty((3, planes, 1), np.float32)

    def shorten(self, count: int) -> None:
        """Keep only `count` packets."""
        for name in ("edges", "outside", "time", "out", "beside", "wide", "side", "slope", "end", "inverse"):
            setattr(self, name, getattr(self, name)[:count])
        self.signs = [signs[:count] for signs in self.signs]


class CertainForm:
    """The edges and planes of t triangles, and what is certain of rays by them."""

    def __init__(self, edges: NDArray[np.float32], corners: Floats, frame: Frame, planes: Floats) -> None:
        """edges : (3 t, 6), see `matrix_form`; corners : (3, 3, t), of the world; planes : (t, 8), see `make_planes`"""
        self.edges, self.count = edges, len(planes)
        columns, errors, self.plane = _share_planes(corners, frame, planes)
        self.side_columns, self.slope_columns = columns, np.ascontiguousarray(-columns[:, :3], np.float32)
        self.errors = np.split(errors, 3, axis=1)  # (planes, 1) each, per 1 + F, per k (1 + F) + 1, per 1 + F
        self.packets = max(1, PAIRS // (PACKET * self.count))
        self.names = np.arange(1, self.count + 1, dtype=np.min_scalar_type(self.count))[:, np.newaxis]
        self.index_bits = np.uint32((1 << self.count.bit_length()) - 1)
        self.indices = np.repeat(np.arange(self.count, dtype=np.uint32), PACKET).reshape(self.count, PACKET)

    def find_nearest(self, rays: FramedRays, reach: Floats) -> Nearest:
        """Return the nearest triangle of each ray that may be hit within its reach (n,), in the frame."""
        blocks, reached = [], []
        for packets in self._multiply(rays, reach, 1 - 2.0**-20, NEAREST_END):
            reached.append(packets.inverse.copy())
            blocks.append(self._find_nearest(packets))
        least, inverse, met, left = (np.concatenate(part).ravel()[: len(reach)] for part in zip(*blocks, strict=True))
        end = np.concatenate(reached).ravel()[: len(reach)]
        certain = (met > 0) & (left == 1) & (inverse > end * np.float32(1 + RANGE_SHARE))
        # Nothing up to h: that is the end of the range, or beyond the scene, unless it is behind what was found.
        free = (left == 0) & ~((least < CERTAIN.view(np.uint32)) & (inverse > end))
        return Nearest(met.astype(np.intp) - 1, certain, free)

    def find_any(self, rays: FramedRays, reach: Floats) -> Occlusion:
        """Return what is certain of whether rays hit anything between their origin and their reach (n,), in the frame,
        and what is left."""
        # The inverse of what is nearer than this was cut.
        far = np.zeros(-(-len(reach) // PACKET) * PACKET, bool)
        far[: len(reach)] = reach * NEAREST_END > 1.0
        met, parts, start = [], [], 0
        for packets in self._multiply(rays, reach, 1.0):
            found = self._find_any(packets, far[start : start + packets.inverse.size])
            met.append(found.met)
            parts.append((found.lane + start, found.row, found.inside))
            start += len(found.met)
        lane, row, inside = (np.concatenate(column) for column in zip(*parts, strict=True))
        known = np.flatnonzero(lane < len(reach))
        return Occlusion(np.concatenate(met)[: len(reach)], lane.take(known), row.take(known), inside.take(known))

    def _multiply(
        self, rays: FramedRays, reach: Floats, share: float, nearest_end: float | None = None
    ) -> Iterator[Packets]:
        """Yield packets of rays, h their reach over `share`, but `nearest_end` is the largest k that will be set; NaN
        fills the last packet up."""
        count = len(reach)
        padded = -(-count // PACKET) * PACKET
        lines, places, inverse = np.empty((9, padded), np.float32), np.empty((4, padded)), np.zeros(padded, np.float32)
        lines[:, count:], places[:, count:], places[3, :count] = np.nan, np.nan, 1
        places[:3, :count], lines[6:, :count] = rays.origin, rays.direction
        origin = rays.origin.astype(np.float32)
        ox, oy, oz, dx, dy, dz = *origin, *lines[6:, :count]
        lines[3:6, :count] = oy * dz - oz * dy, oz * dx - ox * dz, ox * dy - oy * dx
        farthest = largest_row(np.abs(origin)) * ROUND_UP
        scale = CERTAIN / ((6 + 12 * farthest) * np.float32(ROUND_UP * gamma(LINE_ROUNDINGS, FLOAT32_ROUNDOFF)))
        np.multiply(lines[6:, :count], scale, out=lines[:3, :count])
        lines[3:6, :count] *= scale
        far = np.flatnonzero(~(farthest < FARTHEST))
        lines[:, far], places[:, far], farthest[far] = np.nan, np.nan, 0
        # Ends that are 0, below it, or no number, count as infinitely far.
        inverse[:count] = np.minimum(share / reach, NEAREST_END)
        inverse[~(inverse >= 0)] = 0
        packed = lines.reshape(9, -1, PACKET).swapaxes(0, 1)
        packed_places = places.reshape(4, -1, PACKET).swapaxes(0, 1)
        inverse = inverse.reshape(-1, PACKET)
        packets = Packets(min(self.packets, len(inverse)), self.count, len(self.side_columns))
        self._bound_sides(packets, 1 + float(farthest.max()), nearest_end or float(inverse.max()))
        for start in range(0, len(inverse), self.packets):
            part = slice(start, start + self.packets)
            packets.shorten(len(inverse[part]))
            packets.inverse[:] = inverse[part]
            np.matmul(self.edges, packed[part, :6], out=packets.edges)
            np.matmul(self.side_columns, packed_places[part], out=packets.wide)
            np.copyto(packets.side, packets.wide, casting="same_kind")
            np.matmul(self.slope_columns, packed[part, 6:], out=packets.slope)
            self._pass_edges(packets)
            yield packets

    def _bound_sides(self, packets: Packets, ahead: float, inverse: float) -> None:
        """What T and Z may be off by, for 1 + F and k of no more than these."""
        packets.side_error, packets.end_error, packets.well_beyond = (
            (column * factor * ROUND_UP).astype(np.float32)
            for column, factor in zip(self.errors, (ahead, ahead * inverse + 1, ahead), strict=True)
        )

    def _pass_edges(self, packets: Packets) -> None:
        """Find the lesser of the largest edge function and minus the least."""
        a, b, c = (packets.edges[:, first : first + self.count] for first in range(0, 3 * self.count, self.count))
        outside, largest = np.minimum(a, b, out=packets.outside), np.maximum(a, b, out=packets.time)
        np.minimum(outside, c, out=outside)
        np.maximum(largest, c, out=largest)
        np.negative(outside, out=outside)
        np.minimum(outside, largest, out=outside)

    def _compare_sides(self, packets: Packets) -> tuple[Booleans, Booleans]:
        """(p, planes, l) where rays certainly cross planes before h, and where they certainly do not."""
        side, end, above, below, end_above, end_below = packets.side, packets.end, *packets.signs
        np.multiply(side, packets.inverse[:, np.newaxis], out=end)
        end -= packets.slope
        np.greater(side, packets.side_error, out=above)
        np.less(side, -packets.side_error, out=below)
        np.greater(end, packets.end_error, out=end_above)
        np.less(end, -packets.end_error, out=end_below)
        crossed = above & end_below
        crossed |= below & end_above
        above &= end_above
        below &= end_below
        above |= below
        return crossed, above

    def _leave_out(self, packets: Packets, beside: Booleans) -> Booleans:
        """(p, t, l) True where rays certainly do not meet a triangle up to h: they pass it outside, or stay on one side
        of its plane."""
        beside.take(self.plane, axis=1, out=packets.out, mode="clip")
        np.greater(packets.outside, CERTAIN, out=packets.beside)
        return np.logical_or(packets.out, packets.beside, out=packets.out)

    def _meet(self, packets: Packets, crossed: Booleans) -> Booleans:
        """(p, t, l) True where rays certainly pass inside a triangle of a plane that they cross."""
        crossed.take(self.plane, axis=1, out=packets.out, mode="clip")
        np.less(packets.outside, -CERTAIN, out=packets.beside)
        return np.logical_and(packets.out, packets.beside, out=packets.out)

    def _find_nearest(self, packets: Packets) -> tuple[NDArray, ...]:
        """(p, l) each: the least t, with the triangle's index in its last bits; k behind it; one more than the index of
        a triangle that is met, or 0; how many triangles are left."""
        np.divide(packets.side, packets.slope, out=packets.end)  # t
        packets.end.take(self.plane, axis=1, out=packets.time, mode="clip")
        np.maximum(packets.time, packets.outside, out=packets.time)
        # As integers positive numbers keep their order, negative ones are beyond them.
        order = packets.time.view(np.uint32)
        order &= ~self.index_bits
        order |= self.indices
        least = order.min(axis=1)
        np.minimum(least, CERTAIN.view(np.uint32), out=least)
        inverse = least.view(np.float32) + np.float32(BEHIND)
        np.divide(np.float32(1 - BEHIND_SHARE), inverse, out=inverse)
        np.minimum(inverse, np.float32(NEAREST_END), out=inverse)
        np.maximum(inverse, packets.inverse, out=packets.inverse)
        crossed, beside = self._compare_sides(packets)
        crossed &= np.abs(packets.side, out=packets.side) > packets.well_beyond
        out = self._leave_out(packets, beside)
        left = self.count - np.add.reduce(out.view(np.uint8), axis=1, dtype=self.names.dtype)
        met = (self._meet(packets, crossed) * self.names).max(axis=1)
        return least, packets.inverse.copy(), met, left

    def _find_any(self, packets: Packets, far: Booleans) -> Occlusion:
        crossed, beside = self._compare_sides(packets)
        met = self._meet(packets, crossed).any(axis=1).ravel() & far
        left = self._leave_out(packets, beside)
        np.logical_not(left, out=left)
        left &= ~met.reshape(-1, 1, PACKET)
        index = np.flatnonzero(left)
        place, lane = np.divmod(index, PACKET)
        packet, row = np.divmod(place, self.count)
        return Occlusion(met, packet * PACKET + lane, row, packets.outside.reshape(-1).take(index) < -CERTAIN)


@np.errstate(all="ignore")
def _share_planes(corners: Floats, frame: Frame, planes: Floats) -> tuple[Floats, Floats, Indices]:
    """Columns (p, 4) of planes; what their T and Z are certain beyond, and T well known (p, 3); and the plane of each
    triangle (t,): one for all triangles that lie in the same axis plane, exactly, else one for each."""
    normal, error = planes[:, :3].T, planes[:, 6]
    level = (corners[0] == corners[1]) & (corners[0] == corners[2])  # (3, t)
    flat = level.any(axis=0) & ((normal != 0).sum(axis=0) == 1)
    normal = np.where(flat, np.abs(normal), normal)
    size = np.abs(normal).sum(axis=0)
    off = np.where(flat, 0.0, 3 * (error - 7 * UNIT_ROUNDOFF))
    side = np.where(flat, LEAST_SIDE, gamma(SIDE_ROUNDINGS) * size + off)
    known = (off < FLOAT32_ROUNDOFF) & (error < np.inf)
    side, end = np.where(known, [side, gamma(END_ROUNDINGS, FLOAT32_ROUNDOFF) * size], np.inf)
    beyond = np.where(error * planes[:, 7] < LARGEST_DOUBT, WELL_BEYOND, np.inf)
    offset = (normal * np.ldexp(corners[0] - frame.centre[:, np.newaxis], frame.exponent)).sum(axis=0)
    own = np.where(flat, 0, 1 + np.arange(len(planes)))
    rows = np.stack([*-normal, offset, side, end, beyond, own], axis=1)
    _, first, plane = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    rows = rows.take(first, axis=0)
    return np.ascontiguousarray(rows[:, :4]), rows[:, 4:7], plane.reshape(-1)
