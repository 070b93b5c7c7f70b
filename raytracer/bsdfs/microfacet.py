"""Microfacet lobes: GGX and Beckmann reflection and refraction, mirror and clear glass at roughness 0.

A lobe is a row of `Microfacets`; all formulas work on m rows at once. `outgoing` points towards where the ray came
from, `incoming` towards the light; both are unit vectors that leave the surface. Everything is in the units of
value = f(outgoing, incoming) |cos|, so that the light reflected is the integral of value times radiance.
Lobes that reflect may be stretched along a tangent.

References
----------
B. Walter et al., "Microfacet Models for Refraction through Rough Surfaces", EGSR 2007.
P. Kutz, M. Hasan, E. Edmondson, "Novel Aspects of the Adobe Standard Material", 2023: the F82 tint.
Blender, intern/cycles/kernel/closure/bsdf_microfacet.h: which Fresnel curve belongs to which node.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import (
    any_column,
    divide_where,
    join_columns,
    keep_rows,
    mean_column,
    put_rows,
    take_rows,
)
from raytracer.arrays.types import Booleans, Floats
from raytracer.arrays.vectors import make_frame, normalize, reflect
from raytracer.bsdfs.distributions import (
    Stretch,
    beckmann_density,
    beckmann_shadowing,
    facet_density,
    sample_beckmann_normals,
    sample_visible_normals,
    shadowing,
)
from raytracer.bsdfs.fresnel import (
    CONSTANT,
    DIELECTRIC,
    METAL,
    conductor_reflectance,
    metal_reflectance,
    refract,
    schlick_share,
    transmitted_cosine,
)
from raytracer.bsdfs.thin_film import THINNEST, Film, film_reflectance
from raytracer.lecture import dot

# Cycles' limit: below it (squared alpha 2e-10) a lobe is a perfect mirror or clear glass.
SMALLEST_ALPHA = 2e-10**0.5
# Cycles' limit (bsdf_microfacet.h): with a relative index of refraction this close to 1 light passes straight on. The
# half vector of refraction, eta i + o, is as short as |eta - 1| there, so that its direction would be off by eps /
# 1e-4, a 1700th in Cycles' float32; and light is bent by no more than 1e-4 tan(theta), a pixel's width at 80 degrees.
SMALLEST_ETA_STEP = 1e-4


@dataclass(frozen=True, eq=False, slots=True)
class Microfacets:
    """m lobes, at most one for each point of a batch.

    hit : (m,) int64, ascending, the point in its batch
    weight : (m, 3) float64, the lobe's factor
    normal : (m, 3) float64, unit, on the side of `outgoing`
    alpha : (m,) float64, roughness; of stretched lobes the geometric mean
    eta : (m,) float64, index of refraction behind the surface over that in front of it
    f0 : (m, 3) float64, reflectance at normal incidence; of a CONDUCTOR the real part of its index of refraction
    albedo : (m,) float64, estimate of the share of light that the lobe sends on, without `weight`
    energy_scale : (m,) float64, the factor in `weight` for what lossless facets would send on only after
        further bounces, 1 / E; 1 where that is left out
    fresnel : CONSTANT, METAL, DIELECTRIC or CONDUCTOR
    f82 : (m, 3) float64, the METAL curve's second coefficient, or the imaginary part of a CONDUCTOR's index; None of
        others
    reflection : (m, 3) float64, tint; 0 switches that side off; None for white
    transmission : (m, 3) float64, tint; None of lobes that only reflect
    beckmann : Beckmann's distribution instead of GGX
    stretch : None where no lobe is stretched
    film : thin films on the facets; None where no lobe has any
    """

    hit: NDArray[np.int64]
    weight: Floats
    normal: Floats
    alpha: Floats
    eta: Floats
    f0: Floats
    albedo: Floats
    energy_scale: Floats
    fresnel: int
    f82: Floats | None = None
    reflection: Floats | None = None
    transmission: Floats | None = None
    beckmann: bool = False
    stretch: Stretch | None = None
    film: Film | None = None

    def __len__(self) -> int:
        return len(self.hit)

    def select(self, rows: Any) -> Microfacets:
        """Return some of the lobes: index or boolean array."""
        if isinstance(rows, np.ndarray) and rows.dtype == np.bool_:
            rows = rows.nonzero()[0]  # once for all arrays
        columns: dict[str, Any] = {name: getattr(self, name) for name in ROW_FIELDS}
        columns = {name: None if values is None else take_rows(values, rows) for name, values in columns.items()}
        stretch = None if self.stretch is None else self.stretch.select(rows)
        film = None if self.film is None else self.film.select(rows)
        return Microfacets(**columns, fresnel=self.fresnel, beckmann=self.beckmann, stretch=stretch, film=film)

    def show_normal(self, outgoing: Floats) -> Floats:
        """Return (m, 3) what passes of normals show: their own, whatever the unit directions (m, 3) of view."""
        return self.normal

    @property
    def is_perfect(self) -> Booleans:
        """(m,) True where the lobe has a single direction per side, which only sampling can find."""
        return self.alpha <= SMALLEST_ALPHA

    @property
    def reflects(self) -> Booleans:
        """(m,) True where the lobe sends light to the side that it comes from."""
        return np.ones(len(self), np.bool_) if self.reflection is None else any_column(self.reflection > 0)

    @property
    def transmits(self) -> Booleans:
        """(m,) True where the lobe sends light to the other side."""
        return np.zeros(len(self), np.bool_) if self.transmission is None else any_column(self.transmission > 0)

    @property
    def passes_straight(self) -> Booleans:
        """(m,) True where light passes to the other side without a bend, however rough the lobe is."""
        return self.transmits & ~(np.abs(self.eta - 1.0) >= SMALLEST_ETA_STEP)


SHARED_FIELDS = ("fresnel", "beckmann", "stretch", "film")
ROW_FIELDS = tuple(item.name for item in dataclasses.fields(Microfacets) if item.name not in SHARED_FIELDS)


def evaluate_fresnel(lobes: Microfacets, cosine: Floats) -> tuple[Floats, Floats | None]:
    """Return reflectance and transmittance, each (m, 3), of facets met at `cosine` (m,) >= 0; None for the latter where
    lobes only reflect."""
    reflectance = _reflect_untinted(lobes, cosine)
    if lobes.film is not None:
        _lay_films(lobes, lobes.film, cosine, reflectance)
    tinted = reflectance if lobes.reflection is None else reflectance * lobes.reflection
    if lobes.transmission is None:
        return tinted, None
    passing = lobes.transmission if lobes.fresnel == CONSTANT else (1.0 - reflectance) * lobes.transmission
    total = (transmitted_cosine(cosine, lobes.eta) == 0)[:, np.newaxis]
    return tinted, np.where(total, 0.0, passing)


def _reflect_untinted(lobes: Microfacets, cosine: Floats) -> Floats:
    """Return the reflectance (m, 3) of bare facets.

    A DIELECTRIC lobe runs from its f0 to 1 as the real curve does, so that a tint of f0 keeps the angle dependence.
    """
    if lobes.fresnel == CONSTANT:
        return np.ones((3, len(lobes))).T
    if lobes.fresnel == DIELECTRIC:
        return lobes.f0 + (1.0 - lobes.f0) * schlick_share(cosine, lobes.eta)[:, np.newaxis]
    assert lobes.f82 is not None
    reflect_conducted = metal_reflectance if lobes.fresnel == METAL else conductor_reflectance
    return reflect_conducted(cosine[:, np.newaxis], lobes.f0, lobes.f82)


def _lay_films(lobes: Microfacets, film: Film, cosine: Floats, reflectance: Floats) -> None:
    """Put the reflectance of films (m, 3) where facets have any."""
    rows = np.flatnonzero(film.thickness > THINNEST)
    if len(rows) and lobes.fresnel != CONSTANT:
        f82 = None if lobes.f82 is None else take_rows(lobes.f82, rows)
        described = (take_rows(lobes.f0, rows), f82, lobes.eta[rows])
        put_rows(reflectance, rows, film_reflectance(lobes.fresnel, cosine[rows], film.select(rows), *described))


# The lobes -----------------------------------------------------------------------------------------------------------


def _half_vectors(lobes: Microfacets, outgoing: Floats, incoming: Floats, passes: Booleans) -> Floats:
    """Return the facet normals (m, 3) that take `outgoing` to `incoming`: along o + i, or +-(o + eta i) for refraction.

    By Snell's law o + eta i points to the side with the higher index of refraction; facets are turned to the viewer.
    """
    if not passes.any():
        return normalize(incoming + outgoing)
    sign = np.where(lobes.eta > 1.0, -1.0, 1.0)[:, np.newaxis]
    bent = sign * (lobes.eta[:, np.newaxis] * incoming + outgoing)
    halfway: Floats = np.where(passes[:, np.newaxis], bent, incoming + outgoing)
    return normalize(halfway)


def evaluate_microfacets(
    lobes: Microfacets, outgoing: Floats, incoming: Floats, geometric_normal: Floats
) -> tuple[Floats, Floats]:
    """Return the value f |cos| (m, 3) and the density (m,) with which `sample_microfacets` takes `incoming`.

    Reflection: F D G2 / (4 cos_o). Refraction: (1 - F) D G2 eta^2 |h.o h.i| / (cos_o |eta i + o|^2), as radiance is
    transported in Cycles, without the factor 1 / eta^2.

    Notes
    -----
    The value is 0 for perfect lobes and for the wrong side of the shading normal. The density is also 0 where the two
    normals disagree on the side: sampling refuses such directions, so that all weight goes to light sampling.
    """
    cos_out, cos_in = dot(lobes.normal, outgoing), dot(lobes.normal, incoming)
    passes = cos_in < 0
    half = _half_vectors(lobes, outgoing, incoming, passes)
    cos_half_out, cos_half_in = dot(half, outgoing), dot(half, incoming)
    cos_facet = dot(lobes.normal, half)
    possible = (cos_out > 0) & (cos_in != 0) & (cos_half_out > 0) & ((cos_half_in < 0) == passes) & ~lobes.is_perfect
    possible &= cos_facet > 0
    value, choice = _choose_side(*evaluate_fresnel(lobes, np.clip(cos_half_out, 0.0, 1.0)), passes)
    facets = _describe_facets(lobes, (half, cos_facet), (outgoing, cos_out), (incoming, cos_in))
    common = 0.25 * facets.density
    rows = np.flatnonzero(passes & possible) if lobes.transmission is not None else ()
    if len(rows):
        span = lobes.eta[rows, np.newaxis] * take_rows(incoming, rows) + take_rows(outgoing, rows)
        bend = lobes.eta[rows] ** 2 * np.abs(cos_half_out[rows] * cos_half_in[rows]) / dot(span, span)
        common[rows] = bend * facets.density[rows]
    if possible.all():
        common /= cos_out
    else:
        common = keep_rows(common / np.where(possible, cos_out, 1.0), possible)
    visible = 1.0 / (1.0 + facets.shadow_out)
    if lobes.beckmann:  # all facets are sampled, with the density D cos of their normals
        visible = cos_out * cos_facet / np.where(possible, cos_half_out, 1.0)
    sampled = ((dot(geometric_normal, incoming) < 0) == passes) & any_column(value > 0)
    density = keep_rows(common * choice * visible, sampled)
    return lobes.weight * value * (common / (1.0 + facets.shadow_out + facets.shadow_in))[:, np.newaxis], density


def _choose_side(reflectance: Floats, transmittance: Floats | None, passes: Booleans) -> tuple[Floats, Floats]:
    """Return what of the light (m, 3) goes to the side that each direction is on, and the probability (m,) with which
    sampling chooses that side.

    passes : (m,) True where it is the other side of the surface
    """
    probability = _reflection_probability(reflectance, transmittance)
    if not passes.any():
        return reflectance, probability
    light = np.where(passes[:, np.newaxis], 0.0 if transmittance is None else transmittance, reflectance)
    return light, np.where(passes, 1.0 - probability, probability)


class _Facets(NamedTuple):
    """The density of the facets that reflect or refract, and what the others shadow, each (m,)."""

    density: Floats
    shadow_out: Floats
    shadow_in: Floats


_Seen = tuple[Floats, Floats]  # directions (m, 3) and their cosines (m,)


def _describe_facets(lobes: Microfacets, half: _Seen, outgoing: _Seen, incoming: _Seen) -> _Facets:
    density, shadow = (beckmann_density, beckmann_shadowing) if lobes.beckmann else (facet_density, shadowing)
    alpha, stretch = np.maximum(lobes.alpha, SMALLEST_ALPHA), lobes.stretch
    if stretch is None:
        return _Facets(density(alpha, half[1]), shadow(alpha, outgoing[1]), shadow(alpha, incoming[1]))
    width = stretch.find_facet_roughness(half[0])
    return _Facets(
        density(width, half[1]) * (width / alpha) ** 2,
        shadow(stretch.find_shadowing_roughness(outgoing[0]), outgoing[1]),
        shadow(stretch.find_shadowing_roughness(incoming[0]), incoming[1]),
    )


def _reflection_probability(reflectance: Floats, transmittance: Floats | None) -> Floats:
    """Return the probability (m,) with which sampling reflects: its share of the light; 1 where all is black."""
    if transmittance is None:
        return np.ones(len(reflectance))
    reflected, passed = mean_column(reflectance), mean_column(transmittance)
    both = reflected + passed
    return divide_where(reflected, both, both > 0, elsewhere=1.0)


@dataclass(frozen=True, eq=False, slots=True)
class LobeSamples:
    """One incoming direction for each of m lobes.

    direction : (m, 3) float64, unit
    valid : (m,) bool, False where the lobe sends nothing on, or the direction falls on the wrong side
    perfect : (m,) bool, True where the direction was the only one; then `weight` (m, 3) is value / probability, and
        `evaluate_microfacets` has nothing to say about it
    """

    direction: Floats
    valid: Booleans
    perfect: Booleans
    weight: Floats


def sample_microfacets(
    lobes: Microfacets, outgoing: Floats, geometric_normal: Floats, choice: Floats, pair: Floats
) -> LobeSamples:
    """Sample a facet normal, reflect or refract about it.

    choice, pair : (m,), (m, 2) uniform numbers, for the side and for the facet
    """
    half = _sample_half_vectors(lobes, outgoing, pair)
    cos_half = np.clip(dot(half, outgoing), 0.0, 1.0)
    reflectance, transmittance = evaluate_fresnel(lobes, cos_half)
    probability = _reflection_probability(reflectance, transmittance)
    passes = choice >= probability
    direction, rows = reflect(outgoing, half), np.flatnonzero(passes)
    if len(rows):
        put_rows(direction, rows, refract(take_rows(outgoing, rows), take_rows(half, rows), lobes.eta[rows]))
    light, taken = _choose_side(reflectance, transmittance, passes)
    valid = (dot(lobes.normal, outgoing) > 0) & any_column(light > 0)
    for normal in (lobes.normal, geometric_normal):
        valid &= (dot(normal, direction) < 0) == passes
    share = taken[:, np.newaxis]
    weight = lobes.weight * np.divide(light, share, out=np.zeros_like(light), where=share > 0)
    return LobeSamples(direction, valid, lobes.is_perfect, weight)


def _sample_half_vectors(lobes: Microfacets, outgoing: Floats, pair: Floats) -> Floats:
    """Return facet normals (m, 3): the surface normal itself for perfect lobes."""
    rough = np.flatnonzero(~lobes.is_perfect & (dot(lobes.normal, outgoing) > 0))
    if len(rough) == len(lobes):
        return normalize(_sample_facets(lobes, outgoing, pair))
    half = lobes.normal.copy("K")
    if len(rough):
        facets = _sample_facets(lobes.select(rough), take_rows(outgoing, rough), take_rows(pair, rough))
        put_rows(half, rough, normalize(facets))
    return half


def _sample_facets(lobes: Microfacets, outgoing: Floats, pair: Floats) -> Floats:
    """Return facet normals (m, 3), of any length close to 1, of rough lobes."""
    normal, stretch, alpha, across = lobes.normal, lobes.stretch, lobes.alpha, None
    u, v = make_frame(normal) if stretch is None else (stretch.tangent, stretch.bitangent)
    if stretch is not None:
        alpha, across = stretch.along, stretch.across
    if lobes.beckmann:
        facet = sample_beckmann_normals(alpha, pair, across)
    else:
        view = join_columns(dot(u, outgoing), dot(v, outgoing), dot(normal, outgoing))
        facet = sample_visible_normals(view, alpha, pair, across)
    return facet[:, 0:1] * u + facet[:, 1:2] * v + facet[:, 2:3] * normal
