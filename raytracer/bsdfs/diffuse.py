"""Shapes of light that leaves a surface in all directions, but not evenly as from a Lambertian one.

Rough matte surfaces (Oren-Nayar), sheen of fibres, velvet and toon. Each shape is a record of what is known of k points
seen from given directions; `evaluate` returns f(outgoing, incoming) cos, without the part's albedo, for light from
unit directions (k, 3).

References
----------
M. Oren, S. K. Nayar, "Generalization of Lambert's Reflectance Model", SIGGRAPH 1994.
Y. Fujii, "Improved Oren-Nayar Model", 2012.
OpenPBR Surface specification, 2024: the energy that Oren-Nayar lacks; Blender follows it since 4.3.
T. Zeltner, B. Burley, M. J.-Y. Chiang, "Practical Multiple-Scattering Sheen Using Linearly Transformed Cosines", 2022.
M. Ashikhmin, S. Premoze, "Distribution-based BRDFs", 2007: velvet; Blender, bsdf_ashikhmin_velvet.h and bsdf_toon.h:
    its parameters, and toon.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, Protocol, Self

import numpy as np

from raytracer.arrays.types import Floats
from raytracer.arrays.vectors import normalize
from raytracer.bsdfs.microfacet_albedo import read_plane
from raytracer.bsdfs.sheen_table import sheen_table
from raytracer.lecture import dot

# Cycles' limits of parameters, which are part of the shapes and kept to agree. The table of sheen starts at this
# roughness (bsdf_sheen.h).
SMALLEST_SHEEN = 1e-3
# Velvet's exponent is divided by the square of its width (bsdf_ashikhmin_velvet.h): 1e4 at most.
SMALLEST_VELVET = 0.01
# Toon's value is divided by the solid angle that it lights (bsdf_toon.h), which is this share of a right angle at
# least.
SMALLEST_TOON = 1e-5
# Cycles' velvet is dark where its half vector is so near the normal, or the view's cosine to it so small: within that
# its cotangent and quotients would be rounding alone in float32 (2^-24 over 1e-5 is half a percent). Kept to agree.
VELVET_BORDER = 1e-5
# Fujii's albedo holds (1 - sin^3) / cos, whose rounding error is eps / cos; its expansion to first order in cos is off
# by cos^2. Both errors are equal, 4e-11, at this cosine.
SMALLEST_COSINE = float(np.finfo(np.float64).eps) ** (1 / 3)


class DiffuseShape(Protocol):
    """How light is spread over directions."""

    def select(self, rows: Any) -> Self:
        """Return some of the points: index or boolean array."""

    def evaluate(self, incoming: Floats) -> Floats:
        """Return f cos (k, 1) or (k, 3) for light from directions (k, 3)."""


@dataclass(frozen=True, eq=False)
class _Record:
    """Arrays with one row for each point."""

    def select(self, rows: Any) -> Self:
        return type(self)(*(getattr(self, item.name)[rows] for item in dataclasses.fields(self)))


@dataclass(frozen=True, eq=False)
class RoughMatte(_Record):
    """f = a + b t of Fujii's model, s = i . o - i_z o_z, t = s / max(i_z, o_z) where s > 0, plus what further bounces
    between the facets add: m (1 - E(i)).

    normal, outgoing : (k, 3); a, b : (k,); further : (k, 3), m
    """

    normal: Floats
    outgoing: Floats
    a: Floats
    b: Floats
    further: Floats

    def evaluate(self, incoming: Floats) -> Floats:
        cos_in = np.maximum(dot(self.normal, incoming), 0.0)
        cos_out = np.maximum(dot(self.normal, self.outgoing), 0.0)
        bend = dot(incoming, self.outgoing) - cos_in * cos_out
        larger = np.maximum(np.maximum(cos_in, cos_out), np.finfo(np.float64).tiny)
        once = self.a + self.b * np.where(bend > 0, bend / larger, bend)
        again = self.further * (1.0 - _single_albedo(self.a, self.b, cos_in))[:, np.newaxis]
        return cos_in[:, np.newaxis] * (once[:, np.newaxis] + again)


def make_rough_matte(normal: Floats, outgoing: Floats, roughness: Floats, color: Floats, share: Floats) -> RoughMatte:
    """Return the shape of surfaces of a color (k, 3); share : (k,), of the further bounces that is counted."""
    a = 1.0 / (np.pi + roughness * (np.pi / 2.0 - 2.0 / 3.0))
    b = roughness * a
    mean = a * np.pi + (2.0 * np.pi - 5.6) / 3.0 * b
    color, lost = np.minimum(color, 1.0), (1.0 - mean)[:, np.newaxis]
    # Without roughness nothing is lost, and nothing comes back: 0 / 0.
    strength = np.divide(share * mean, np.pi * (1.0 - mean), out=np.zeros_like(mean), where=roughness > 0)
    further = color**2 * strength[:, np.newaxis] / (1.0 - color * lost)
    cos_out = np.maximum(dot(normal, outgoing), 0.0)
    return RoughMatte(normal, outgoing, a, b, further * (1.0 - _single_albedo(a, b, cos_out))[:, np.newaxis])


def _single_albedo(a: Floats, b: Floats, cosine: Floats) -> Floats:
    """Return E (k,), the share of light at `cosine` (k,) that leaves after one bounce: pi a + b G."""
    sine = np.sqrt(np.maximum(1.0 - cosine * cosine, 0.0))
    safe = np.maximum(cosine, SMALLEST_COSINE)
    g = sine * (np.arccos(np.minimum(cosine, 1.0)) - 2.0 / 3.0 - sine * cosine)
    g += 2.0 / 3.0 * sine / safe * (1.0 - sine**3)
    grazing = np.pi / 2.0 - 2.0 / 3.0 - cosine
    return np.pi * a + b * np.where(cosine < SMALLEST_COSINE, grazing, g)


@dataclass(frozen=True, eq=False)
class Sheen(_Record):
    """A cosine lobe under a linear map: f cos = z / pi (a / |(a x + b z, a y, z)|^2)^2, x towards the view.

    normal, aside : (k, 3), z and x; a, b : (k,)
    """

    normal: Floats
    aside: Floats
    a: Floats
    b: Floats

    def evaluate(self, incoming: Floats) -> Floats:
        x, z = dot(self.aside, incoming), dot(self.normal, incoming)
        square = self.a**2 * (1.0 - z * z) + 2.0 * self.a * self.b * x * z + (self.b**2 + 1.0) * z * z
        ratio = np.divide(self.a, square, out=np.zeros_like(square), where=square > 0)
        return (np.maximum(z, 0.0) / np.pi * ratio**2)[:, np.newaxis]


def make_sheen(normal: Floats, outgoing: Floats, roughness: Floats) -> tuple[Sheen, Floats]:
    """Return the shape of sheen, and its albedo (k,)."""
    cosine = np.clip(dot(normal, outgoing), 0.0, 1.0)
    rough = np.maximum(roughness, SMALLEST_SHEEN)
    albedo, a, b = (read_plane(table, rough, cosine) for table in sheen_table())
    aside = normalize(outgoing - dot(normal, outgoing)[:, np.newaxis] * normal)
    return Sheen(normal, aside, a, b), albedo


@dataclass(frozen=True, eq=False)
class Velvet(_Record):
    """Facets at right angles to the surface: f cos = D G / (4 o_z) with D = exp(-cot^2 / s^2) / (pi s^2 sin^4) of the
    half vector and G = min(1, 2 h_z i_z / h.o, 2 h_z o_z / h.o).

    normal, outgoing : (k, 3); width : (k,), s
    """

    normal: Floats
    outgoing: Floats
    width: Floats

    def evaluate(self, incoming: Floats) -> Floats:
        half = normalize(incoming + self.outgoing)
        cos_in, cos_out = dot(self.normal, incoming), dot(self.normal, self.outgoing)
        cos_half, cos_facet = dot(self.normal, half), np.abs(dot(half, self.outgoing))
        # Cycles' limit of both cosines.
        valid = (cos_in > 0) & (cos_out > 0) & (np.abs(cos_half) < 1.0 - VELVET_BORDER) & (cos_facet > VELVET_BORDER)
        cos_facet, cos_out = np.where(valid, cos_facet, 1.0), np.where(valid, cos_out, 1.0)
        sine = np.where(valid, 1.0 - cos_half**2, 1.0)
        width = np.maximum(self.width, SMALLEST_VELVET) ** 2
        density = np.exp(-(cos_half**2) / (sine * width)) / (np.pi * width * sine**2)
        shadowing = np.minimum(2.0 * np.abs(cos_half / cos_facet) * np.minimum(cos_in, cos_out), 1.0)
        return np.where(valid, density * shadowing / (4.0 * cos_out), 0.0)[:, np.newaxis]


@dataclass(frozen=True, eq=False)
class Toon(_Record):
    """The same in all directions up to an angle from an axis, then fading out: f cos = 1 / (2 pi (1 - cos(w))), for w
    where it ends.

    normal, axis : (k, 3), the axis is the normal or the direction of mirror reflection
    size, smooth : (k,), as shares of a right angle
    """

    normal: Floats
    axis: Floats
    size: Floats
    smooth: Floats

    def evaluate(self, incoming: Floats) -> Floats:
        right = np.pi / 2.0
        size, smooth = np.clip(self.size, SMALLEST_TOON, 1.0) * right, np.clip(self.smooth, 0.0, 1.0) * right
        end = np.minimum(size + smooth, right)
        angle = np.arccos(np.clip(dot(self.axis, incoming), 0.0, 1.0))
        fading = 1.0 - np.divide(angle - size, smooth, out=np.where(angle < size, 0.0, 1.0), where=smooth > 0)
        lit = (angle < end) & (dot(self.normal, incoming) > 0)
        value = np.clip(fading, 0.0, 1.0) / (4.0 * np.pi * np.sin(end / 2.0) ** 2)
        return np.where(lit, value, 0.0)[:, np.newaxis]
