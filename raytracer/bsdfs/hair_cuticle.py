"""Light at the rough surface of a strand, its cuticle: facets that reflect it and let it through, in and out.

Facets are those of GGX about normals that the scales tilt, as on glass (`microfacet`), and what gets lost between them
is given back likewise. All directions stand in the frame of the strand, which runs along y (`hair_ellipse`); incoming
and outgoing ones leave the surface, and the incoming one is on the side of the normals.

A tilted surface is as large as what it stands for, and looks larger where it leans towards the light: with the cosines
c to its own normals and C to those of the cross section, c / C of the light that comes is met, and C / c of what goes
on inside meets the cross section again.

References
----------
W. Huang, M. B. Hullin, J. Hanika, "A Microfacet-based Hair Scattering Model", Computer Graphics Forum 41(4), 2022.
B. Walter and others, "Microfacet Models for Refraction through Rough Surfaces", EGSR 2007: densities.
Blender, intern/cycles/kernel/closure/bsdf_principled_hair_huang.h.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from raytracer.arrays.rows import scale_vectors
from raytracer.arrays.types import Booleans, Floats
from raytracer.arrays.vectors import make_frame, normalize, reflect, to_world
from raytracer.bsdfs.distributions import facet_density, sample_visible_normals, shadowing
from raytracer.bsdfs.fresnel import dielectric_reflectance, refract
from raytracer.bsdfs.hair_ellipse import find_normals
from raytracer.bsdfs.microfacet_albedo import read_glass
from raytracer.lecture import dot, length


@dataclass(frozen=True, eq=False, slots=True)
class Cuticle:
    """n points of cuticles that light comes to.

    incoming : (n, 3) float64, unit, to where it comes from
    angle : (n,) of the cross section's normal, which leans by `tilt` (n,)
    alpha : (n,) of facets; eta : (n,) index of refraction behind over that before
    normal, facets : (n, 3) float64, unit, of the cross section, and the mean of the facets'
    cosine : (n,) of the incoming direction to the latter
    light : (n, 3) float64, what gets there of light of 1; 0 where the surface looks away
    scale : (n,) what gives back the light that is lost between facets
    """

    incoming: Floats
    angle: Floats
    alpha: Floats
    eta: Floats
    normal: Floats
    facets: Floats
    cosine: Floats
    light: Floats
    scale: Floats

    def reflectance(self, half: Floats) -> Floats:
        """Return Fresnel's reflectance (n,) of facets with normals (n, 3)."""
        return dielectric_reflectance(np.clip(dot(self.incoming, half), 0.0, 1.0), self.eta)

    def sees(self, direction: Floats, half: Floats) -> Booleans:
        """Return whether facets with normals (n, 3) look to directions (n, 3), as does the surface."""
        return (dot(direction, half) > 0) & (dot(direction, self.normal) > 0) & (dot(direction, self.facets) > 0)

    def sees_both(self, direction: Floats, half: Floats) -> Booleans:
        """Return whether they look to where light comes from as well."""
        return self.sees(self.incoming, half) & self.sees(direction, half)


def meet_cuticle(
    incoming: Floats,
    angle: Floats,
    aspect: Floats,
    tilt: Floats,
    alpha: Floats,
    eta: Floats,
    light: Floats,
    leans: bool,
) -> Cuticle:
    """Return the points that light (n, 3) comes to; leans : whether it is weighed by how the surface leans to it."""
    normal, facets = find_normals(angle, aspect, tilt)
    cosine, plain = dot(incoming, facets), dot(incoming, normal)
    met = (cosine > 0) & (plain > 0)
    share, _ = read_glass(np.sqrt(alpha), np.clip(cosine, 0.0, 1.0), eta)
    if leans:
        light = scale_vectors(light, np.divide(cosine, plain, out=np.zeros_like(cosine), where=met))
    scale = np.where(met, 1.0 / share, 0.0)
    return Cuticle(incoming, angle, alpha, eta, normal, facets, cosine, light, scale)


def sample_facets(cuticle: Cuticle, pair: Floats) -> Floats:
    """Return facets' normals (n, 3), as often as they are seen from where light comes from; pair : (n, 2) uniform."""
    x, y = make_frame(cuticle.facets)
    local = np.stack([dot(cuticle.incoming, axis) for axis in (x, y, cuticle.facets)], axis=1)
    return to_world(sample_visible_normals(local, cuticle.alpha, pair), cuticle.facets)


def shadow_way_out(cuticle: Cuticle, outgoing: Floats) -> Floats:
    """Return G2 / G1 (n,): the share of light leaving a facet, to (n, 3), that the others do not block."""
    before = 1.0 + shadowing(cuticle.alpha, cuticle.cosine)
    return before / (before + shadowing(cuticle.alpha, dot(outgoing, cuticle.facets)))


def reflect_to(cuticle: Cuticle, outgoing: Floats) -> Floats:
    """Return what is reflected (n, 3) per solid angle to directions (n, 3): F D G2 / (4 cos) of what comes."""
    half = normalize(cuticle.incoming + outgoing)
    return _density(cuticle, outgoing, half, cuticle.reflectance(half) / 4.0)


def leave_to(cuticle: Cuticle, direction: Floats) -> Floats:
    """Return what gets through (n, 3) per solid angle to directions (n, 3) behind the surface.

    (1 - F) D G2 eta^2 (i . h) (h . o) / (cos |i + eta o|^2), with h along i + eta o on the side of the normals.
    """
    sign = np.where(cuticle.eta < 1.0, 1.0, -1.0)
    half = scale_vectors(cuticle.incoming + scale_vectors(direction, cuticle.eta), sign)
    size = length(half)
    half = normalize(half)
    before, behind = dot(cuticle.incoming, half), -dot(direction, half)
    factor = (1.0 - cuticle.reflectance(half)) * before * behind
    factor *= np.divide(cuticle.eta, size, out=np.zeros_like(size), where=size > 0) ** 2
    return _density(cuticle, -direction, half, factor)


def _density(cuticle: Cuticle, outgoing: Floats, half: Floats, factor: Floats) -> Floats:
    """Return factor D G2 / cos of the light that comes (n, 3), where the surface shows itself to both sides."""
    seen = cuticle.sees_both(outgoing, half) & (dot(half, cuticle.facets) > 0)
    below = 1.0 + shadowing(cuticle.alpha, cuticle.cosine) + shadowing(cuticle.alpha, dot(outgoing, cuticle.facets))
    value = cuticle.scale * factor * facet_density(cuticle.alpha, dot(half, cuticle.facets)) / below
    share = np.divide(value, cuticle.cosine, out=np.zeros_like(value), where=seen)
    return scale_vectors(cuticle.light, share)


def reflect_off(cuticle: Cuticle, half: Floats) -> tuple[Floats, Floats]:
    """Return the directions (n, 3) to which facets with normals (n, 3) reflect, and how much (n,)."""
    outgoing = reflect(cuticle.incoming, half)
    share = cuticle.scale * cuticle.reflectance(half) * shadow_way_out(cuticle, outgoing)
    return outgoing, np.where(cuticle.sees_both(outgoing, half), share, 0.0)


def pass_through(cuticle: Cuticle, half: Floats) -> tuple[Floats, Floats]:
    """Return the directions (n, 3) behind the surface that facets with normals (n, 3) refract to, and how much (n,)."""
    direction = refract(cuticle.incoming, half, cuticle.eta)
    share = cuticle.scale * (1.0 - cuticle.reflectance(half)) * shadow_way_out(cuticle, -direction)
    return direction, np.where(cuticle.sees_both(-direction, half), share, 0.0)


def lean(cuticle: Cuticle, direction: Floats) -> Floats:
    """Return C / c (n,) for directions (n, 3) on the side of the normals; 0 for others."""
    plain, cosine = dot(direction, cuticle.normal), dot(direction, cuticle.facets)
    return np.divide(plain, cosine, out=np.zeros_like(plain), where=(plain > 0) & (cosine > 0))
