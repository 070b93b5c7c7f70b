"""Microfacet lobes of closures: how rough they are, which way they are stretched, and what further bounces add.

References
----------
Blender, intern/cycles/kernel/svm/closure.h: roughness, anisotropy and rotation of each node.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from raytracer.arrays.rows import mean_column, put_rows, shorten_rows, take_rows
from raytracer.arrays.types import Floats, Indices
from raytracer.bsdfs.closures import Closures, Points
from raytracer.bsdfs.distributions import Stretch, make_stretch, rotate
from raytracer.bsdfs.fresnel import CONSTANT
from raytracer.bsdfs.microfacet import Microfacets, evaluate_fresnel
from raytracer.bsdfs.microfacet_albedo import compensate, read_glass, read_reflection
from raytracer.bsdfs.thin_film import Film

# A rough lobe is picked at least so often, as a share of its weight.
SMALLEST_PICK = 2.0**-6
# Cycles stretches no highlight by less (svm/closure.h): its width would change by a share of 1e-4, which no picture
# of 8 or 10 bits shows, and a tangent would be needed for it.
SMALLEST_ANISOTROPY = 1e-4
# Cycles' largest for the Glossy BSDF, which divides by 1 minus it, and the share of theirs that other nodes take.
LARGEST_GLOSSY, STRONGEST_ASPECT = 0.99, 0.9


@dataclass(frozen=True, eq=False, slots=True)
class Facets:
    """What the facets of k lobes do with light; fields as in `microfacet.Microfacets`."""

    fresnel: int
    f0: Floats
    f82: Floats | None = None
    reflection: Floats | None = None
    transmission: Floats | None = None
    film: Film | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Grain:
    """How rough k lobes are.

    roughness : (k,) float64, the root of alpha, or of the geometric mean of both
    multiscatter : (k,) float64, share of the light lost between facets that is given back
    beckmann : Beckmann's distribution instead of GGX
    along, across : (k,) float64, alpha along the tangent and across it; None where nothing is stretched
    """

    roughness: Floats
    multiscatter: Floats
    beckmann: bool = False
    along: Floats | None = None
    across: Floats | None = None


def read_grain(closures: Closures, beckmann: bool = False) -> Grain:
    """Return the grain of lobes that nothing stretches."""
    return Grain(closures.roughness, 0.0 * closures.weight if beckmann else closures.multiscatter, beckmann)


def stretch_grain(grain: Grain, closures: Closures, points: Points, glossy: bool = False) -> Grain:
    """Return grain that the anisotropy of the closures stretches along their tangents, if they have any.

    glossy : the Glossy BSDF divides by 1 - anisotropy across the tangent (along it where negative) and multiplies along
        it; other nodes divide along it by sqrt(1 - 0.9 anisotropy)
    """
    if "tangent" not in points.vectors or not closures.uses("anisotropy"):
        return grain
    amount, alpha = closures.anisotropy, grain.roughness**2
    if glossy:
        amount = np.clip(amount, -LARGEST_GLOSSY, LARGEST_GLOSSY)
        aspect = np.where(amount < 0, 1.0 / (1.0 - np.abs(amount)), 1.0 - np.abs(amount))
    else:
        aspect = 1.0 / np.sqrt(1.0 - STRONGEST_ASPECT * np.maximum(amount, 0.0))
    aspect = np.where(np.abs(amount) <= SMALLEST_ANISOTROPY, 1.0, aspect)
    along, across = np.minimum(alpha * aspect, 1.0), np.minimum(alpha / aspect, 1.0)
    return Grain((along * across) ** 0.25, grain.multiscatter, grain.beckmann, along, across)


def read_film(closures: Closures, outside: Floats | float = 1.0) -> Film | None:
    """Return the thin films of closures, if they have any.

    outside : (k,) index of refraction of the side that light comes from, over that outside. Light from within meets
        the film as Cycles has it: all indices are divided by it, also that of the path through the film, which is too
        short by that factor.
    """
    if not closures.uses("film_thickness"):
        return None
    return Film(closures.film_thickness, closures.film_ior / outside)


def split_distributions(closures: Closures, points: Points) -> Iterator[tuple[Closures, Points, bool]]:
    """Yield the closures of each distribution, and whether it is Beckmann's."""
    if not closures.uses("beckmann"):
        yield closures, points, False
        return
    chosen = closures.beckmann > 0
    for beckmann in (False, True):
        part = chosen == beckmann
        if part.any():
            yield closures.select(part), points.select(part), beckmann


def make_lobes(
    closures: Closures,
    points: Points,
    weight: Floats,
    eta: Floats,
    facets: Facets,
    grain: Grain,
    mean_color: Floats | None,
    normal_name: str = "normal",
) -> Microfacets:
    """Return lobes whose weight includes the bounces after the first, of color `mean_color`; None leaves them out.

    Where a refracting surface has the same index on both sides nothing bends: the lobe is made perfect.
    """
    normal, cosine = points.specular_normal(normal_name)
    cosine = np.clip(cosine, 0.0, 1.0)
    roughness = grain.roughness
    lobes = Microfacets(
        hit=points.rows,
        weight=weight,
        normal=normal,
        alpha=roughness * roughness,
        eta=eta,
        fresnel=facets.fresnel,
        f0=facets.f0,
        f82=facets.f82,
        reflection=facets.reflection,
        transmission=facets.transmission,
        albedo=np.ones(len(points.rows)),
        energy_scale=np.ones(len(points.rows)),
        beckmann=grain.beckmann,
        stretch=_lay_stretch(closures, points, normal, grain),
        film=facets.film,
    )
    refracts = lobes.transmits
    if lobes.transmission is not None:
        lobes.alpha[lobes.passes_straight] = 0.0
    returned = ~lobes.is_perfect & (grain.multiscatter > 0)
    for rows, read in ((returned & ~refracts, read_reflection), (returned & refracts, read_glass)):
        if mean_color is not None and rows.any():
            places = shorten_rows(np.flatnonzero(rows), len(lobes))
            weight = _return_lost(weight, lobes, grain, mean_color, cosine, places, read)
    return dataclasses.replace(lobes, weight=weight, albedo=_estimate_albedo(lobes, cosine))


def _return_lost(
    weight: Floats,
    lobes: Microfacets,
    grain: Grain,
    mean_color: Floats,
    cosine: Floats,
    rows: Indices | slice,
    read: Callable[[Floats, Floats, Floats], tuple[Floats, Floats]],
) -> Floats:
    """Return the weight (k, 3) of lobes with the light of further bounces at some `rows`, and note it in their
    energy_scale; `read` : returns what share a single bounce sends on, and its mean."""
    share, mean = read(grain.roughness[rows], cosine[rows], lobes.eta[rows])
    added = compensate(share, mean, np.minimum(take_rows(mean_color, rows), 1.0)) - 1.0
    multiscatter = grain.multiscatter[rows]
    lobes.energy_scale[rows] += multiscatter * (1.0 / share - 1.0)
    scaled = weight.copy("K")
    put_rows(scaled, rows, take_rows(weight, rows) * (1.0 + multiscatter[:, np.newaxis] * added))
    return scaled


def _lay_stretch(closures: Closures, points: Points, normal: Floats, grain: Grain) -> Stretch | None:
    if grain.along is None or grain.across is None:
        return None
    tangent = points.vectors["tangent"]
    if closures.uses("rotation"):
        tangent = rotate(tangent, points.normal, 2.0 * np.pi * closures.rotation)
    return make_stretch(normal, tangent, grain.along, grain.across)


def _estimate_albedo(lobes: Microfacets, cosine: Floats) -> Floats:
    """Return about how much light (m,) each lobe sends on, by which one of them is picked.

    The estimate is that of a smooth surface. Rough lobes keep a small share where that is black, for some of their
    facets are met at other angles; refraction keeps its full share in total reflection.
    """
    tints = _sum_sides(len(lobes), lobes.reflection, lobes.transmission)
    smooth = tints if lobes.fresnel == CONSTANT else _sum_sides(len(lobes), *evaluate_fresnel(lobes, cosine))
    return np.where(lobes.is_perfect, smooth, np.maximum(smooth, SMALLEST_PICK * tints))


def _sum_sides(count: int, reflected: Floats | None, transmitted: Floats | None) -> Floats:
    """Return the mean (k,) over the channels of what `count` lobes reflect, None for all, and transmit, None for
    nothing, (k, 3)."""
    if reflected is None:
        return np.ones(count) if transmitted is None else mean_column(1.0 + transmitted)
    return mean_column(reflected if transmitted is None else reflected + transmitted)
