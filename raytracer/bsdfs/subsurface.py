"""Light that enters a surface, is scattered below it, and leaves elsewhere: how it enters, and what it meets there.

A part of the surface's BSDF is replaced by a medium inside the object, of the same index of refraction as the air. Its
colors are those that artists choose: the albedo A of a thick slab, and how far light gets. From these follow, channel
by channel, the single scattering albedo a, the extinction s and the anisotropy g of Henyey and Greenstein's phase
function, by one of two inversions:

- a fit in A and g; the radius is a reduced mean free path, s = 1 / (r (1 - g));
- van de Hulst's similarity: with q(A) = sqrt((1 - a) / (1 - a g)), a = (1 - q^2) / (1 - g q^2), and s = 1 / r.

Where light leaves, the surface is a white Lambertian one (`integrator.subsurface`).

References
----------
M. J.-Y. Chiang, P. Kutz, B. Burley, "Practical and Controllable Subsurface Scattering for Production Path Tracing",
    SIGGRAPH 2016 Talks: colors by inverting the albedo.
M. Wrenninge, R. Villemin, C. Hery, "Path Traced Subsurface Scattering using Anisotropic Phase Functions and
    Non-Exponential Free Flights", 2017: the fit in A and g.
E. d'Eon, "A Hitchhiker's Guide to Multiple Scattering", 2022, equation 53.7: q(A).
H. W. Jensen et al., "A Practical Model for Subsurface Light Transport", SIGGRAPH 2001: the dipole, and its F_dr.
Cycles, kernel/closure/bssrdf.h, kernel/integrator/subsurface.h and subsurface_random_walk.h: ranges, radii, entries.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from raytracer.arrays.rows import any_column, take_rows
from raytracer.arrays.types import Booleans, Colors, Floats, Indices, Numbers, Vectors
from raytracer.arrays.vectors import make_frame, to_world
from raytracer.bsdfs.distributions import sample_visible_normals
from raytracer.bsdfs.fresnel import refract
from raytracer.casting.rays import select_rows
from raytracer.lecture import dot
from raytracer.sampling.warps import sample_cosine_hemisphere

# Cycles' limits: a smaller radius is none, and its light is reflected by a matte surface; indices of refraction that
# light enters by; an albedo of 1 never ends.
SMALLEST_RADIUS = 1e-8
SMALLEST_IOR, LARGEST_IOR = 1.01, 3.8
LARGEST_ALBEDO = 0.999999
# A medium scatters at least so much, and what enters is dimmed instead, so that there is no step at black.
SMALLEST_ALBEDO = 0.2
# Radii of sums of Gaussians that artists are used to, in mean free paths.
FREE_PATH_OF_RADIUS = 0.25 / np.pi
# Of skin: albedos that the dipole calls black and white, and the steps of Cycles' search between them.
BLACK_OF_SKIN, WHITE_OF_SKIN, SKIN_SEARCH_STEPS = 1e-4, 0.995, 12
# Wrenninge, Villemin and Hery's fit: polynomials in g, lowest power first; B and E have one as an exponent.
FIT_A = (
    *(1.8260523782, -1.28451056436, -1.79904629312, 9.19393289202),
    *(-22.8215585862, 32.0234874259, -23.6264803333, 7.21067002658),
)
FIT_B, FIT_B_FACTOR = 4.98511194385, 0.127355959438
FIT_B_EXPONENT = (
    *(0.0, 31.1491581433, -201.847017512, 841.576016723),
    *(-2018.09288505, 2731.71560286, -1935.41424244, 559.009054474),
)
FIT_C = (
    *(1.09686102424, -0.394704063468, 1.05258115941, -8.83963712726),
    *(28.8643230661, -46.8802913581, 38.5402837518, -12.7181042538),
)
FIT_D = (
    *(0.496310210422, 0.360146581622, -2.15139309747, 17.8896899217),
    *(-55.2984010333, 82.065982243, -58.5106008578, 15.8478295021),
)
FIT_E, FIT_E_FACTOR = 4.23190299701, 0.00310603949088
FIT_E_EXPONENT = (
    *(0.0, 76.7316253952, -594.356773233, 2448.8834203),
    *(-5576.68528998, 7116.60171912, -4763.54467887, 1303.5318055),
)
FIT_F = (
    *(2.40602999408, -2.51814844609, 9.18494908356, -79.2191708682),
    *(259.082868209, -403.613804597, 302.85712436, -87.4370473567),
)


@dataclass(frozen=True, eq=False, slots=True)
class Subsurface:
    """What m points of a batch send below their surfaces.

    hit : (m,) int64, ascending, the point in its batch
    normal : (m, 3) float64, unit, that light enters by
    weight : (m, 3) float64, albedo times the share of the material
    albedo : (m, 3) float64, of a thick slab
    radius : (m, 3) float64, metres, as the inversion takes it; 0 in channels that stay at the surface
    anisotropy, ior : (m,) float64
    roughness : (m,) float64, alpha of the facets that light enters by
    is_skin, is_similar : (m,) bool, half of the light enters as through a matte surface; inverted by similarity
    """

    hit: Indices
    normal: Vectors
    weight: Colors
    albedo: Colors
    radius: Colors
    anisotropy: Numbers
    ior: Numbers
    roughness: Numbers
    is_skin: Booleans
    is_similar: Booleans

    def __len__(self) -> int:
        return len(self.hit)

    def select(self, rows: Any) -> Subsurface:
        """Return some of the points: index or boolean array."""
        return select_rows(self, rows)


def join_parts(parts: Sequence[Subsurface]) -> Subsurface:
    """Return several parts, one at least, as one, in order."""
    if len(parts) == 1:
        return parts[0]
    return Subsurface(*(np.concatenate([getattr(part, item.name) for part in parts]) for item in fields(Subsurface)))


@dataclass(frozen=True, eq=False, slots=True)
class Medium:
    """What is below the surfaces of m points.

    extinction : (m, 3) float64, 1 / metre
    albedo : (m, 3) float64, of single scattering, between SMALLEST_ALBEDO and LARGEST_ALBEDO
    anisotropy : (m,) float64, mean cosine of the phase function
    """

    extinction: Colors
    albedo: Colors
    anisotropy: Numbers

    def select(self, rows: Any) -> Medium:
        """Return some of the media: index or boolean array."""
        return select_rows(self, rows)


def split_radii(part: Subsurface) -> tuple[Subsurface, Floats]:
    """Return the part within Cycles' ranges, and the albedo (m, 3) of what stays at the surface.

    part : radii as artists give them
    """
    buried = part.radius >= SMALLEST_RADIUS
    ior = np.clip(part.ior, SMALLEST_IOR, LARGEST_IOR)
    radius = part.radius * FREE_PATH_OF_RADIUS
    skin = np.flatnonzero(part.is_skin)
    if len(skin):
        radius[skin] = part.radius[skin] * find_skin_radius(part.albedo[skin], ior[skin])
    inside = Subsurface(
        part.hit,
        part.normal,
        np.where(buried, part.weight, 0.0),
        part.albedo,
        np.where(buried, radius, 0.0),
        part.anisotropy,
        ior,
        np.where(part.is_skin, 1.0, part.roughness),
        part.is_skin,
        part.is_similar,
    )
    return inside.select(np.flatnonzero(any_column(inside.weight > 0))), np.where(buried, 0.0, part.weight)


def find_skin_radius(albedo: Floats, ior: Floats) -> Floats:
    """Return the factor sqrt(3 (1 - a')) (m, 3) of the radii of skin.

    a' is the reduced albedo whose dipole, R(a') = a' / 2 (1 + exp(-4/3 A s)) exp(-s) with s = sqrt(3 (1 - a')) and
    A = (1 + F_dr) / (1 - F_dr), sends the albedo back. Halving ends after as many steps as in Cycles, for near white
    the rest shows in the radius.
    """
    inverse = 1.0 / ior
    reflected = inverse * (0.710 - 1.440 * inverse) + 0.668 + 0.0636 * ior
    slope = (4.0 / 3.0 * (1.0 + reflected) / (1.0 - reflected))[:, np.newaxis]
    low, high = np.zeros_like(albedo), np.ones_like(albedo)
    middle = low
    for _ in range(SKIN_SEARCH_STEPS):
        middle = 0.5 * (low + high)
        root = np.sqrt(3.0 * (1.0 - middle))
        below = 0.5 * middle * (1.0 + np.exp(-slope * root)) * np.exp(-root) < albedo
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    reduced = np.where(albedo < BLACK_OF_SKIN, 0.0, np.where(albedo >= WHITE_OF_SKIN, LARGEST_ALBEDO, middle))
    return np.sqrt(3.0 * (1.0 - reduced))


def find_medium(part: Subsurface) -> tuple[Medium, Floats]:
    """Return the medium, and the factor (m, 3) of the light that enters it: the part's weight without its albedo."""
    g = part.anisotropy[:, np.newaxis]
    # The fit is of forward scattering only: beyond it Cycles takes similarity, too.
    similar = (part.is_similar | (part.anisotropy < 0.0))[:, np.newaxis]
    albedo = np.where(similar, invert_by_similarity(part.albedo, g), fit_albedo(part.albedo, np.maximum(g, 0.0)))
    albedo = np.clip(albedo, 0.0, LARGEST_ALBEDO)
    extinction = 1.0 / np.maximum(part.radius * np.where(similar, 1.0, 1.0 - g), SMALLEST_RADIUS**2)
    factor = np.divide(part.weight, part.albedo, out=np.zeros_like(albedo), where=part.albedo > 0)
    factor *= np.minimum(albedo / SMALLEST_ALBEDO, 1.0)
    return Medium(extinction, np.maximum(albedo, SMALLEST_ALBEDO), part.anisotropy), factor


def invert_by_similarity(albedo: Floats, anisotropy: Floats) -> Floats:
    """Return the single scattering albedo (m, 3) of van de Hulst's similarity."""
    root = np.sqrt(9.59217 + 41.6808 * albedo + 17.7126 * albedo**2)
    square = (4.20863 * albedo - root + 4.09712) ** 2
    return (1.0 - square) / (1.0 - anisotropy * square)


def fit_albedo(albedo: Floats, anisotropy: Floats) -> Floats:
    """Return the single scattering albedo (m, 3) of the fit, (1 - t) A atan(B x)^C + t D atan(E x)^F, t = x^(1/4)."""
    a, c, d, f = (np.polynomial.polynomial.polyval(anisotropy, fit) for fit in (FIT_A, FIT_C, FIT_D, FIT_F))
    b = FIT_B + FIT_B_FACTOR * np.exp(np.polynomial.polynomial.polyval(anisotropy, FIT_B_EXPONENT))
    e = FIT_E + FIT_E_FACTOR * np.exp(np.polynomial.polynomial.polyval(anisotropy, FIT_E_EXPONENT))
    blend = albedo**0.25
    return (1.0 - blend) * a * np.arctan(b * albedo) ** c + blend * d * np.arctan(e * albedo) ** f


def enter(part: Subsurface, outgoing: Floats, geometric_normal: Floats, pair: Floats) -> tuple[Floats, Booleans]:
    """Return unit directions (m, 3) below the surface, and (m,) False where there is none: that light is lost.

    Light is refracted at a visible facet, all of it: how much a facet reflects is up to the layers above. Half of what
    enters skin is spread as by a matte surface.

    outgoing, geometric_normal : (m, 3) float64, unit, on the side that the ray came from
    pair : (m, 2) uniform numbers
    """
    first = pair[:, 0]
    matte = part.is_skin & (first < 0.5)
    pair = np.stack([np.where(part.is_skin, 2.0 * first - (first >= 0.5), first), pair[:, 1]], axis=1)
    u, v = make_frame(part.normal)
    cosine = dot(part.normal, outgoing)
    facet = sample_visible_normals(np.stack([dot(u, outgoing), dot(v, outgoing), cosine], axis=1), part.roughness, pair)
    half = facet[:, 0:1] * u + facet[:, 1:2] * v + facet[:, 2:3] * part.normal
    direction = refract(outgoing, half, part.ior)
    rows = np.flatnonzero(matte)
    direction[rows] = to_world(sample_cosine_hemisphere(take_rows(pair, rows)), -part.normal[rows])
    return direction, (matte | (cosine > 0)) & (dot(geometric_normal, direction) < 0)
