"""Facets of rough surfaces: how their normals are distributed, how they shadow each other, and how they are sampled.

GGX and Beckmann, both even around the normal and stretched along a tangent. A stretched distribution of roughnesses a
and b looks, in any one plane through the normal, like an even one of the roughness that it has there; so all formulas
are written for even ones.

References
----------
B. Walter et al., "Microfacet Models for Refraction through Rough Surfaces", EGSR 2007: Beckmann, its shadowing in a
    rational fit, its sampling.
E. Heitz, "Understanding the Masking-Shadowing Function in Microfacet-Based BRDFs", JCGT 3(2), 2014: GGX, stretching.
J. Dupuy, A. Benyoub, "Sampling Visible GGX Normals with Spherical Caps", High Performance Graphics 2023.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from raytracer.arrays.rows import join_columns, take_rows
from raytracer.arrays.types import Floats
from raytracer.arrays.vectors import make_frame, normalize
from raytracer.lecture import cross, dot

# Walter's fit of Beckmann's shadowing holds below this 1 / (alpha tan); above it there is none.
LARGEST_BECKMANN_SLOPE = 1.6
# exp(-x) of more is 0.
LARGEST_EXPONENT = 700.0


def facet_density(alpha: Floats, cosine: Floats) -> Floats:
    """D = alpha^2 / (pi (sin^2 + alpha^2 cos^2)^2), GGX, per facet normal at `cosine` to the surface normal."""
    square = np.minimum(cosine * cosine, 1.0)
    return alpha**2 / (np.pi * ((1.0 - square) + alpha**2 * square) ** 2)


def shadowing(alpha: Floats, cosine: Floats) -> Floats:
    """Smith's Lambda of GGX, (sqrt(1 + alpha^2 tan^2) - 1) / 2; G1 is 1 / (1 + Lambda)."""
    return (np.sqrt(1.0 + alpha**2 * _squared_tangent(cosine)) - 1.0) / 2.0


def beckmann_density(alpha: Floats, cosine: Floats) -> Floats:
    """D = exp(-tan^2 / alpha^2) / (pi alpha^2 cos^4)."""
    tangent = _squared_tangent(cosine)
    power = np.minimum(tangent / alpha**2, LARGEST_EXPONENT)
    return np.exp(-power) * (1.0 + tangent) ** 2 / (np.pi * alpha**2)


def beckmann_shadowing(alpha: Floats, cosine: Floats) -> Floats:
    """Smith's Lambda of Beckmann facets in Walter's fit, as Cycles has it: (1 - 1.259 a + 0.396 a^2) /
    (3.535 a + 2.181 a^2) of a = 1 / (alpha tan) < 1.6, else 0."""
    slope = np.sqrt(np.maximum(alpha**2 * _squared_tangent(cosine), LARGEST_BECKMANN_SLOPE**-2))
    a = 1.0 / slope
    return np.where(a < LARGEST_BECKMANN_SLOPE, (1.0 + a * (0.396 * a - 1.259)) / (a * (3.535 + 2.181 * a)), 0.0)


def _squared_tangent(cosine: Floats) -> Floats:
    square = np.maximum(cosine * cosine, np.finfo(np.float64).tiny)
    return np.maximum(1.0 / square - 1.0, 0.0)


@dataclass(frozen=True, eq=False, slots=True)
class Stretch:
    """Roughness (m,) along a tangent and along a bitangent, (m, 3) unit, at right angles to a normal."""

    tangent: Floats
    bitangent: Floats
    along: Floats
    across: Floats

    def select(self, rows: Any) -> Stretch:
        along, across = self.along[rows], self.across[rows]
        return Stretch(take_rows(self.tangent, rows), take_rows(self.bitangent, rows), along, across)

    def project(self, directions: Floats) -> tuple[Floats, Floats]:
        """Return the components (m,) of directions (m, 3) along the tangent and the bitangent."""
        return dot(self.tangent, directions), dot(self.bitangent, directions)

    def find_shadowing_roughness(self, directions: Floats) -> Floats:
        """sqrt(a^2 cos^2 p + b^2 sin^2 p) of directions at angles p (m,) around the normal."""
        x, y = self.project(directions)
        return np.sqrt(_average(x, y, self.along**2, self.across**2))

    def find_facet_roughness(self, normals: Floats) -> Floats:
        """1 / sqrt(cos^2 p / a^2 + sin^2 p / b^2) of facets whose normals lie at angles p (m,)."""
        x, y = self.project(normals)
        return 1.0 / np.sqrt(_average(x, y, self.along**-2, self.across**-2))


def _average(x: Floats, y: Floats, first: Floats, second: Floats) -> Floats:
    """Return (x^2 first + y^2 second) / (x^2 + y^2); `first` at the origin, where all angles are as good."""
    square = x * x + y * y
    total = first * x * x + second * y * y
    return np.where(
        square > np.finfo(np.float64).tiny, np.divide(total, square, out=first.copy(), where=square > 0), first
    )


def make_stretch(normals: Floats, tangents: Floats, along: Floats, across: Floats) -> Stretch:
    """Return the Stretch along `tangents` (m, 3), laid into the planes of unit `normals`; any one where they vanish."""
    bitangent = normalize(cross(normals, tangents))
    missing = ~bitangent.any(axis=1)
    bitangent[missing] = make_frame(normals[missing])[1]
    return Stretch(cross(bitangent, normals), bitangent, along, across)


def rotate(vectors: Floats, axes: Floats, angles: Floats) -> Floats:
    """Return vectors (m, 3) turned around unit axes (m, 3): v cos + (n x v) sin + n (n . v) (1 - cos)."""
    cosine, sine = np.cos(angles)[:, np.newaxis], np.sin(angles)[:, np.newaxis]
    along = dot(axes, vectors)[:, np.newaxis] * axes
    return vectors * cosine + cross(axes, vectors) * sine + along * (1.0 - cosine)


# Sampling ------------------------------------------------------------------------------------------------------------


def sample_visible_normals(local_outgoing: Floats, alpha: Floats, pair: Floats, across: Floats | None = None) -> Floats:
    """Return facet normals (m, 3) with the density D G1 max(o . h, 0) / o_z of GGX, seen from `local_outgoing`
    (z = normal); across : roughness along y, if other than along x.

    Stretched by alpha the facets are a hemisphere; the normals halfway between the view and points even on a spherical
    cap are those of the parts that are seen.
    """
    stretch = join_columns(alpha, alpha if across is None else across, np.ones_like(alpha))
    view = normalize(local_outgoing * stretch)
    angle = 2.0 * np.pi * pair[:, 0]
    height = (1.0 - pair[:, 1]) * (1.0 + view[:, 2]) - view[:, 2]
    sine = np.sqrt(np.maximum(1.0 - height * height, 0.0))
    cap = join_columns(sine * np.cos(angle), sine * np.sin(angle), height)
    return normalize((cap + view) * stretch)


def sample_beckmann_normals(alpha: Floats, pair: Floats, across: Floats | None = None) -> Floats:
    """Return facet normals (m, 3), z = normal, with the density D cos: tan^2 = -alpha^2 log(1 - v)."""
    slope, angle = np.sqrt(-np.log1p(-pair[:, 1])), 2.0 * np.pi * pair[:, 0]
    x, y = alpha * slope * np.cos(angle), (alpha if across is None else across) * slope * np.sin(angle)
    return normalize(join_columns(x, y, np.ones_like(x)))
