"""Segments as rays see them: cubic polynomials in a frame whose third axis is the ray.

The ray is the z axis, its origin the origin, and z counts metres. Of a point of the centre line, X = (x, y) is its
offset from the ray and z its depth; ' is the derivative by u. What is solved is

    ribbon   g(u) = X . X' = 0          with |X| <= r:   the ray meets the ribbon X + v r n, n at right angles to X', in
                                        v = -+ |X| / r, at the depth z
    thick    g + z' sqrt(r^2 - X^2) = 0 with |X| <= r:   the near side of the discs of radius r around the centre line,
                                        at right angles to it: at the depth z - sqrt(r^2 - X^2)

For the latter, (q - P) . P' = 0 and |q - P| = r with the point q = (0, 0, t) of the ray give z' (t - z) = g and
(t - z)^2 = r^2 - X^2; its square, and that of the far side's, g - z' sqrt(r^2 - X^2), is the polynomial of degree 10

    F(u) = z'^2 (X^2 - r^2) + g^2.

Coordinates are taken relative to the ray's origin, and those of a key depend on nothing but the key and the ray: two
segments that share it agree on it bit for bit, and so on which of them a root at their joint belongs to.

Errors. With u = 2^-53 and R the largest |p - o| over the four keys, computed offsets and depths are those of keys that
are moved by at most POSITION_ERROR R: p - o rounds once, products with axes that are orthonormal to 8 u take 3 + 2
roundings in each of three terms, the Bezier points and Horner's rule 8 more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import take_rows
from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.arrays.vectors import make_frame, normalize
from raytracer.casting.curves import bernstein
from raytracer.casting.curves.strands import find_bezier
from raytracer.predicates.rounding import gamma

POSITION_ERROR = gamma(32)


def make_axes(directions: Floats) -> Floats:
    """Return the frames (n, 3 axes, 3) of rays, the last axis along them."""
    forward = normalize(directions)
    right, up = make_frame(forward)
    return np.stack([right, up, forward], axis=1)


@dataclass(frozen=True, eq=False)
class SeenSegments:
    """k segments, each in the frame of a ray.

    bezier : (4, 4, k) Bezier points 0 to 3 of x, y, z and the radius
    slopes : (4, 3, k) Bezier points of their derivatives; at the ends (p2 - p0) / 2 and (p3 - p1) / 2
    reach : (k,) metres, R
    thick : (k,) bool
    """

    bezier: Floats
    slopes: Floats
    reach: Floats
    thick: Booleans

    def __len__(self) -> int:
        return len(self.reach)

    def select(self, rows: Indices | Booleans) -> SeenSegments:
        """Return some of the segments."""
        bezier, slopes = self.bezier.take(rows, axis=2), self.slopes.take(rows, axis=2)
        return SeenSegments(bezier, slopes, take_rows(self.reach, rows), take_rows(self.thick, rows))


def see_segments(origins: Floats, axes: Floats, keys: Floats, thick: Booleans) -> SeenSegments:
    """Return segments of keys (k, 4 keys, 4) as rays of origins (k, 3) and axes (k, 3, 3) see them."""
    seen: Floats = np.empty((4, 4, len(keys)))
    x, y, z = (np.ascontiguousarray((keys[:, :, c] - origins[:, c, np.newaxis]).T) for c in range(3))  # (4, k) each
    for axis in range(3):
        a, b, c = np.ascontiguousarray(axes[:, axis].T)
        seen[axis] = a * x + b * y + c * z
    seen[3] = keys[:, :, 3].T
    bezier = find_bezier(seen)
    slopes: Floats = np.empty((4, 3, len(keys)))
    slopes[:, 0] = (seen[:, 2] - seen[:, 0]) / 2.0
    slopes[:, 1] = 3.0 * (bezier[:, 2] - bezier[:, 1])
    slopes[:, 2] = (seen[:, 3] - seen[:, 1]) / 2.0
    reach = np.sqrt((x * x + y * y + z * z).max(axis=0))
    return SeenSegments(bezier, slopes, reach, thick)


def find_passing(seen: SeenSegments, nearest: Floats, farthest: Floats) -> NDArray[np.intp]:
    """Return the segments that may come within their radius of the ray, at depths from `nearest` to `farthest` (k,).

    Their points lie within the hull of the Bezier points; it is looked at along its chord, across it and along the ray.
    """
    bezier = seen.bezier
    radius = np.maximum(bezier[3].max(axis=0), 0.0) + 4.0 * POSITION_ERROR * seen.reach
    x, y, z = bezier[0], bezier[1], bezier[2]
    chord_x, chord_y = x[3] - x[0], y[3] - y[0]
    size = np.hypot(chord_x, chord_y)
    across, along = chord_x * y - chord_y * x, chord_x * x + chord_y * y  # (4, k)
    # Their roundings are three, relative to the chord times R.
    margin = size * (radius + gamma(8) * seen.reach)
    passing = (across.min(axis=0) <= margin) & (across.max(axis=0) >= -margin)
    passing &= (along.min(axis=0) <= margin) & (along.max(axis=0) >= -margin)
    passing &= (z.min(axis=0) - radius <= farthest) & (z.max(axis=0) + radius >= nearest)
    return np.flatnonzero(passing)


def find_foot_polynomials(seen: SeenSegments) -> Floats:
    """Return g = X . X', (6, k) Bernstein coefficients."""
    bezier, slopes = seen.bezier, seen.slopes
    return bernstein.multiply(bezier[0], slopes[0]) + bernstein.multiply(bezier[1], slopes[1])


def find_tube_polynomials(seen: SeenSegments, foot: Floats) -> tuple[Floats, Floats]:
    """Return X^2 - r^2, (7, k), and F, (11, k), Bernstein coefficients; foot : (6, k), of g."""
    bezier, slopes = seen.bezier, seen.slopes
    outside = bernstein.multiply(bezier[0], bezier[0]) + bernstein.multiply(bezier[1], bezier[1])
    outside -= bernstein.multiply(bezier[3], bezier[3])
    climb = bernstein.multiply(slopes[2], slopes[2])
    return outside, bernstein.multiply(climb, outside) + bernstein.multiply(foot, foot)


@dataclass(frozen=True, eq=False)
class Points:
    """What k segments are at u: each (k,).

    x, y, z, radius, and their derivatives by u; `foot` is g, and `height` sqrt(r^2 - X^2), 0 where |X| > r; the radius
    is 0 where its spline is below
    """

    x: Floats
    y: Floats
    z: Floats
    radius: Floats
    slope_x: Floats
    slope_y: Floats
    slope_z: Floats
    slope_radius: Floats
    foot: Floats
    height: Floats

    @property
    def square(self) -> Floats:
        """X^2."""
        return self.x * self.x + self.y * self.y


def evaluate(seen: SeenSegments, u: Floats) -> Points:
    """Return the points of k segments at u (k,)."""
    s = 1.0 - u
    b0, b1, b2, b3 = seen.bezier.transpose(1, 0, 2)  # (4, k) each
    x, y, z, radius = ((b0 * s + 3.0 * u * b1) * s + (3.0 * u * u) * b2) * s + (u * u * u) * b3
    d0, d1, d2 = seen.slopes.transpose(1, 0, 2)
    slope_x, slope_y, slope_z, slope_radius = (d0 * s + 2.0 * u * d1) * s + (u * u) * d2
    slope_radius = np.where(radius > 0, slope_radius, 0.0)
    radius = np.maximum(radius, 0.0)
    foot = x * slope_x + y * slope_y
    height = np.sqrt(np.maximum((radius * radius - x * x) - y * y, 0.0))
    return Points(x, y, z, radius, slope_x, slope_y, slope_z, slope_radius, foot, height)


def find_bends(seen: SeenSegments, u: Floats) -> Floats:
    """Return the second derivatives of x, y and z by u, (3, k), of segments at u (k,)."""
    d0, d1, d2 = seen.slopes[:3].transpose(1, 0, 2)
    bends: Floats = 2.0 * ((d1 - d0) * (1.0 - u) + (d2 - d1) * u)
    return bends


def measure_ends(seen: SeenSegments) -> tuple[Floats, Floats]:
    """Return g and z' sqrt(r^2 - X^2) at both ends, (2, k) each, from what the neighbors share."""
    x, y, _, radius = seen.bezier[:, [0, 3]]
    slope_x, slope_y, slope_z, _ = seen.slopes[:, [0, 2]]
    height = np.sqrt(np.maximum((radius * radius - x * x) - y * y, 0.0))
    return x * slope_x + y * slope_y, slope_z * height
