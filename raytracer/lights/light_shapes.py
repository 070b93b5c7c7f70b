"""What lights send to points, and sampling the shapes that shine: cones, spheres and rectangles, seen from a point.

Directions are taken evenly over the solid angle, which keeps the noise of a diffuse surface to that of its cosine.

References
----------
P. Shirley, C. Wang, K. Zimmerman, "Monte Carlo Techniques for Direct Lighting Calculations", 1996: spheres.
C. Urena, M. Fajardo, A. King, "An Area-Preserving Parametrization for Spherical Rectangles", 2013.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from raytracer.arrays.rows import any_column, join_columns, make_zeros, put_rows, take_rows
from raytracer.arrays.types import Colors, Floats, Indices, Numbers, Vectors
from raytracer.arrays.vectors import normalize, to_world
from raytracer.lecture import dot, intersect_sphere

# Below this solid angle a rectangle is sampled evenly on its area: its solid angle is a difference of angles of order 1
# and would keep fewer than 40 bits, while cos / distance^2 hardly changes over so small a rectangle.
SMALL_SOLID_ANGLE = 2.0**-12


@dataclass(frozen=True, eq=False, slots=True)
class LightSamples:
    """One direction towards a light for each of n points.

    direction : (n, 3) float64, unit, from the point to the light
    distance : (n,) float64, metres, how far a shadow ray has to go; inf for a sun
    weight : (n, 3) float64, radiance / density; for a light without extent the irradiance on a plane that faces it
    density : (n,) float64, per solid angle, by which the sample is weighed against other ways to the light; inf where
        there is none (a light without extent), 0 where nothing was sampled
    target : (n, 3) float64, the point of the light that shadow rays aim at, the same for all points that share it; None
        where each has a direction of its own
    reach : (n,) float64, how far a shadow ray has to go, in units of the way to `target`; None without one
    """

    direction: Vectors
    distance: Numbers
    weight: Colors
    density: Numbers
    target: Vectors | None = None
    reach: Numbers | None = None


@dataclass(frozen=True, eq=False, slots=True)
class LightHits:
    """What n rays see of a light.

    distance : (n,) float64, metres, to the light; inf for a sun and where the light is missed
    radiance : (n, 3) float64, 0 where the light is missed
    density : (n,) float64, with which `sample` would have taken this direction, per solid angle; 0 where missed
    """

    distance: Floats
    radiance: Floats
    density: Floats

    def select(self, rows: Indices) -> LightHits:
        """Return what some of the rays see."""
        return LightHits(self.distance[rows], take_rows(self.radiance, rows), self.density[rows])


def place_hits(
    rows: Indices, count: int, distance: Floats | float, radiance: Floats, density: Floats | float
) -> LightHits:
    """Return what `count` rays see of a light that only `rows` (k,) of them meet; numbers : (k,), or one for all."""
    hits = LightHits(np.full(count, np.inf), make_zeros(count), np.zeros(count))
    hits.distance[rows], hits.density[rows] = distance, density
    put_rows(hits.radiance, rows, radiance)
    return hits


def without_extent(direction: Floats, distance: Floats, irradiance: Floats) -> LightSamples:
    lit = any_column(irradiance != 0)
    return LightSamples(direction, distance, irradiance, np.where(lit, np.inf, 0.0))


def divide_rows(numerator: Floats, denominator: Floats) -> Floats:
    """numerator / denominator by rows, 0 where the denominator is 0 (the point lies on the light itself)."""
    divides = denominator > 0
    if np.all(divides):
        return np.divide(numerator.T, denominator, order="C").T
    quotient = np.zeros(numerator.shape[::-1])
    np.divide(numerator.T, denominator, out=quotient, where=divides)
    return quotient.T


def sample_cone(axis: Floats, versine: Floats, pair: Floats) -> Floats:
    """Return directions (n, 3), even over cones around unit axes (n, 3) with 1 - cos(half angle) = versine (n,)."""
    height = pair[:, 0] * versine  # 1 - cos of the sample, which keeps its digits in a narrow cone
    sine = np.sqrt(np.maximum(height * (2.0 - height), 0.0))
    angle = 2.0 * np.pi * pair[:, 1]
    return to_world(join_columns(sine * np.cos(angle), sine * np.sin(angle), 1.0 - height), axis)


def cone_density(versine: Floats) -> Floats:
    """1 / (2 pi (1 - cos)): one over the solid angle of a cone."""
    return 1.0 / (2.0 * np.pi * np.asarray(versine))


def _visible_versine(offset: Floats, radii: Floats) -> Floats:
    """1 - sqrt(1 - s^2) = s^2 / (1 + sqrt(1 - s^2)), s = r / d: of the cone in which a sphere is seen.

    2, the versine of all directions, for points in the sphere.
    """
    square = dot(offset, offset)
    outside = square > radii * radii
    sine_square = radii * radii / np.where(outside, square, 1.0)
    cosine = np.sqrt(np.maximum(1.0 - sine_square, 0.0))
    return np.where(outside, sine_square / (1.0 + cosine), 2.0)


def sample_sphere_directions(offset: Floats, radii: Floats, pair: Floats) -> Floats:
    """Return directions (n, 3), even over the solid angle of spheres at `offset` (n, 3) with radii (n,)."""
    axis = normalize(offset)
    axis = np.where((axis == 0).all(axis=1, keepdims=True), (0.0, 0.0, 1.0), axis)
    return sample_cone(axis, _visible_versine(offset, radii), pair)


def sphere_density(offset: Floats, radii: Floats) -> Floats:
    """Return the density (n,) of `sample_sphere_directions`, per solid angle."""
    return cone_density(_visible_versine(offset, radii))


def distance_to_sphere(offset: Floats, radii: Floats, directions: Floats) -> Floats:
    """Return the distance (n,) along unit directions to the first point of spheres at `offset` (n, 3); inf for a miss.

    A sampled direction may graze the border of its cone and miss by rounding: it then counts as missed.
    """
    roots = intersect_sphere(np.zeros_like(offset), directions, offset, radii)
    first = np.where(roots[:, 0] > 0, roots[:, 0], roots[:, 1])
    return np.where(first > 0, first, np.inf)


def _rectangle_angles(position: Floats, low: Floats, high: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return (b0, b1, k, S) of the paper for the rectangle low..high (n, 2) in the plane z = 0, seen from `position`
    (n, 3): S is its solid angle."""
    x0, y0 = (low - position[:, :2]).T
    x1, y1 = (high - position[:, :2]).T
    z = np.maximum(np.abs(position[:, 2]), np.finfo(np.float64).tiny)
    # z components of the unit normals of the four planes through the point and the sides
    bottom, right = -y0 / np.hypot(y0, z), x1 / np.hypot(x1, z)
    top, left = y1 / np.hypot(y1, z), -x0 / np.hypot(x0, z)
    corners = [
        np.arccos(np.clip(-first * second, -1.0, 1.0))
        for first, second in ((bottom, right), (right, top), (top, left), (left, bottom))
    ]
    k = 2.0 * np.pi - corners[2] - corners[3]
    return bottom, top, k, corners[0] + corners[1] - k


def rectangle_solid_angle(position: Floats, low: Floats, high: Floats) -> Floats:
    """Return the solid angle (n,) of rectangles low..high (n, 2) in the plane z = 0, seen from `position` (n, 3)."""
    return _rectangle_angles(position, low, high)[3]


def sample_rectangle(position: Floats, low: Floats, high: Floats, pair: Floats) -> tuple[Floats, Floats]:
    """Return points (n, 2) of rectangles low..high (n, 2) in the plane z = 0, even over the solid angle from `position`
    (n, 3), or over the area where that is small; and the solid angles (n,)."""
    b0, b1, k, solid_angle = _rectangle_angles(position, low, high)
    x0, y0 = (low - position[:, :2]).T
    x1, y1 = (high - position[:, :2]).T
    z = np.maximum(np.abs(position[:, 2]), np.finfo(np.float64).tiny)
    with np.errstate(divide="ignore", invalid="ignore"):  # small ones are replaced below
        angle = pair[:, 0] * solid_angle + k
        slope = (np.cos(angle) * b0 - b1) / np.sin(angle)
        cosine = np.clip(np.copysign(1.0, slope) / np.sqrt(slope * slope + b0 * b0), -1.0, 1.0)
        x = np.clip(cosine * z / np.sqrt(1.0 - cosine * cosine), x0, x1)
        across = np.hypot(x, z)
        h0, h1 = y0 / np.hypot(across, y0), y1 / np.hypot(across, y1)
        height = h0 + pair[:, 1] * (h1 - h0)
        y = np.clip(height * across / np.sqrt(1.0 - height * height), y0, y1)
    points = position[:, :2] + join_columns(x, y)
    np.clip(points, low, high, out=points)
    small = solid_angle < SMALL_SOLID_ANGLE
    if small.any():
        points = np.where(small[:, np.newaxis], low + pair * (high - low), points)
    return points, solid_angle
