"""Lobes of hair: what all of them share, the frame of a strand, and its longitudinal scattering.

Light that meets a strand leaves it on cones around it. Directions are told by their angle theta to the plane across the
strand, and by their azimuth phi around it. A lobe's value is what its model calls f |cos|: the cosine of the surface is
no part of it, for a strand is thinner than what is looked at, and light goes through it to the other side.

Colors are those of the light that a strand does not absorb; Blender asks for absorption in three ways.

References
----------
M. J.-Y. Chiang, B. Bitterli, C. Tappan, B. Burley, "A Practical and Controllable Hair and Fur Model for Production Path
Tracing", Computer Graphics Forum 35(2), 2016: absorption by color.
E. d'Eon, G. Francois, M. Hill, J. Letteri, J.-M. Aubry, "An Energy-Conserving Hair Reflectance Model", EGSR 2011.
Blender, intern/cycles/kernel/closure/bsdf_util.h: absorption by melanin; kernel/types.h: what is a reflection.
"""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import any_column, take_rows
from raytracer.arrays.types import Booleans, Floats, Kinds
from raytracer.arrays.vectors import make_frame, normalize
from raytracer.lecture import cross

# Up to here NumPy's I0 is finite; beyond, the first terms left out of its expansion are below this number's fourth
# power times 0.11: 2e-12.
LARGEST_BESSEL = 500.0
# Light absorbed by eumelanin and pheomelanin, per radius and concentration (bsdf_util.h).
EUMELANIN, PHEOMELANIN = np.array([0.506, 0.841, 1.653]), np.array([0.343, 0.733, 1.924])
# The least share of light that melanin leaves, where hair is black: svm/closure.h takes as much, and 1 - melanin would
# absorb infinitely much at 1.
LEAST_LEFT = 1e-4
# The colors that Chiang and others found strands to have, as ln c = sqrt(absorption) p(radial roughness): a polynomial,
# highest power first.
ALBEDO_FIT = (0.245, 5.574, -10.73, 2.532, -0.215, 5.969)


@dataclass(frozen=True, eq=False, slots=True)
class HairSamples:
    """One incoming direction for each of m lobes.

    direction : (m, 3) float64, unit
    valid : (m,) bool, False where the lobe sends nothing on
    kind : (m,) uint8, of the bounce
    weight : (m, 3) float64, the light that is sent on, times the lobe's own, of lobes that walk; None of others
    """

    direction: Floats
    valid: Booleans
    kind: Kinds
    weight: Floats | None = None


@dataclass(frozen=True, eq=False)
class HairLobes(ABC):
    """m lobes of strands, at most one for each point of a batch, with the fields that `microfacet.Microfacets` has.

    hit : (m,) int64, ascending, the point in its batch
    weight : (m, 3) float64, the lobe's factor
    normal : (m, 3) float64, unit, the surface's on the side of the viewer
    tangent : (m, 3) float64, unit, along the strand
    """

    hit: NDArray[np.int64]
    weight: Floats
    normal: Floats
    tangent: Floats

    # Whether samples are ways of light with weights of their own, for want of a density.
    walks: ClassVar[bool] = False

    def __len__(self) -> int:
        return len(self.hit)

    def select(self, rows: Any) -> Self:
        """Return some of the lobes: index or boolean array."""
        fields = {item.name: take_rows(getattr(self, item.name), rows) for item in dataclasses.fields(self)}
        return dataclasses.replace(self, **fields)

    @property
    def is_perfect(self) -> Booleans:
        """(m,) False: strands scatter light in all directions."""
        return np.zeros(len(self), dtype=np.bool_)

    @property
    def alpha(self) -> Floats:
        """(m,) the roughness that denoisers are told: strands are rough, as in Cycles."""
        return np.ones(len(self))

    @property
    def energy_scale(self) -> Floats:
        """(m,) 1: nothing is lost that `weight` would give back."""
        return np.ones(len(self))

    @property
    def reflects(self) -> Booleans:
        """(m,) True where light comes back to the side of the normal."""
        return any_column(self.reflection > 0)

    @property
    def transmits(self) -> Booleans:
        """(m,) True where light goes through to the other side."""
        return any_column(self.transmission > 0)

    def show_normal(self, outgoing: Floats) -> Floats:
        """Return (m, 3) what passes of normals show where strands are seen from unit directions (m, 3)."""
        return self.normal

    @property
    def reflection(self) -> Floats:
        """(m, 3) 1 where light comes back to the side of the normal, else 0."""
        return np.ones((len(self), 3))

    @property
    def transmission(self) -> Floats:
        """(m, 3) 1 where light goes through to the other side, else 0."""
        return np.ones((len(self), 3))

    @property
    @abstractmethod
    def albedo(self) -> Floats:
        """(m,) estimate of the share of light that the lobe sends on, without `weight`."""

    @abstractmethod
    def estimate_color(self) -> Floats:
        """Return the estimate (m, 3) of the share of white light that the lobe sends on, without `weight`."""

    @abstractmethod
    def evaluate(self, outgoing: Floats, incoming: Floats) -> tuple[Floats, Floats]:
        """Return the value (m, 3), times `weight`, for light from unit directions (m, 3), and the density (m,) with
        which `sample` takes them."""

    @abstractmethod
    def sample(self, outgoing: Floats, choice: Floats, pair: Floats) -> HairSamples:
        """Return a direction for each lobe; choice, pair : (m,), (m, 2) uniform numbers."""

    def claim_density(self) -> Floats:
        """Return the density (m,) that walks are taken to have, in any direction."""
        return np.ones(len(self))

    @abstractmethod
    def blur(self, least: Floats) -> Self:
        """Return lobes that are no smoother than `least` (m,)."""


def find_tangents(tangent: Floats, normal: Floats) -> Floats:
    """Return directions (m, 3) along strands, unit; any across the normal where there is none."""
    tangent = normalize(tangent)
    missing = np.flatnonzero(~tangent.any(axis=1))
    if len(missing):
        tangent[missing] = make_frame(normal[missing])[0]
    return tangent


def make_strand_frame(tangent: Floats, outgoing: Floats) -> tuple[Floats, Floats]:
    """Return the axes y = x cross o and z = x cross y, (m, 3) each, of strands along x seen from o."""
    across = normalize(cross(tangent, outgoing))
    along_view = np.flatnonzero(~across.any(axis=1))
    if len(along_view):
        across[along_view] = make_frame(tangent[along_view])[0]
    return across, cross(tangent, across)


def cosine_of(sine: Floats) -> Floats:
    """sqrt(1 - sin^2); 0 where rounding takes the sine beyond 1."""
    return np.sqrt(np.maximum(1.0 - sine * sine, 0.0))


# Longitudinal scattering ---------------------------------------------------------------------------------------------


def scaled_bessel(x: Floats) -> Floats:
    """Return exp(-x) I0(x) of the modified Bessel function, x >= 0: (1 + 1/(8x) + 9/(128 x^2) + 225/(3072 x^3)) /
    sqrt(2 pi x) where x is large."""
    small = np.minimum(x, LARGEST_BESSEL)
    near = np.i0(small) * np.exp(-small)
    u = 1.0 / (8.0 * np.maximum(x, LARGEST_BESSEL))
    far = (1.0 + u * (1.0 + u * (4.5 + u * 37.5))) * np.sqrt(4.0 * u / np.pi)
    return np.where(x <= LARGEST_BESSEL, near, far)


def longitudinal(sine: Floats, cosine: Floats, sine_out: Floats, cosine_out: Floats, variance: Floats) -> Floats:
    """Return how light from theta is scattered to theta_o, M = exp(-s s_o / v) I0(c c_o / v) / (2 v sinh(1 / v)).

    The integral of M cos over theta is 1. All (m,); written so that nothing overflows, however small v is:
    exp((c c_o - s s_o - 1) / v) times the scaled Bessel function.
    """
    both = cosine * cosine_out
    spread = np.exp((both - sine * sine_out - 1.0) / variance)
    return spread * scaled_bessel(both / variance) / (variance * -np.expm1(-2.0 / variance))


def sample_longitudinal(
    sine_out: Floats, cosine_out: Floats, variance: Floats, first: Floats, second: Floats
) -> Floats:
    """Return sines (m,) of theta with the density M cos; first, second : (m,) uniform numbers.

    M is a von Mises-Fisher distribution around the cone's direction, seen from the side: u = 1 + v ln(x + (1 - x)
    exp(-2 / v)) is the cosine to it, sin = -u s_o + sqrt(1 - u^2) cos(2 pi y) c_o.
    """
    rest = 1.0 - first
    u = 1.0 + variance * np.log(rest + (1.0 - rest) * np.exp(-2.0 / variance))
    sine = -u * sine_out + cosine_of(u) * np.cos(2.0 * np.pi * second) * cosine_out
    return np.clip(sine, -1.0, 1.0)


# Colors --------------------------------------------------------------------------------------------------------------


def absorb_by_color(color: Any, radial_roughness: Any) -> Floats:
    """Return the absorption (..., 3) per radius of strands that look like a color (..., 3) where many scatter light.

    (ln c / p(radial roughness))^2. What is black would absorb infinitely much: the smallest positive number stands
    for 0.
    """
    fit = np.polyval(ALBEDO_FIT, np.asarray(radial_roughness, dtype=np.float64))
    root = np.log(np.maximum(color, np.finfo(np.float64).tiny)) / fit[..., np.newaxis]
    return root * root


def absorb_by_melanin(melanin: Any, redness: Any) -> Floats:
    """Return the absorption (..., 3) per radius of strands that hold melanin, from 0 for none to 1 for black, of which
    `redness` is pheomelanin.

    The concentration is -ln(1 - melanin), of LEAST_LEFT at least.
    """
    amount = -np.log(np.maximum(1.0 - np.asarray(melanin, dtype=np.float64), LEAST_LEFT))
    redness = np.asarray(redness, dtype=np.float64)
    dark, red = (amount * (1.0 - redness))[..., np.newaxis], (amount * redness)[..., np.newaxis]
    return np.maximum(dark * EUMELANIN + red * PHEOMELANIN, 0.0)
