"""The BSDF of a point: the mixture of all its lobes, evaluated and weighed (`bsdf_samples` samples it).

A point's lobes are its passage (transparency, and portals), its microfacet lobes and those of hair, and, where diffuse
reflection is followed, its Lambertian parts; one is chosen at random, in proportion to the light it sends on. The
direct-light integrator leaves out the last, and takes the light of diffuse surfaces by sampling lights alone.

References
----------
E. Veach, "Robust Monte Carlo Methods for Light Transport Simulation", 1997, chapter 9: multiple importance sampling.
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.rows import (
    add_rows,
    keep_rows,
    make_zeros,
    mean_column,
    shorten_rows,
    sum_columns,
    take_rows,
)
from raytracer.arrays.types import Floats, Indices
from raytracer.bsdfs.closures import Lobes, Shading
from raytracer.bsdfs.hair import HairLobes
from raytracer.bsdfs.microfacet import Microfacets, evaluate_microfacets
from raytracer.bsdfs.terminator import evaluate_tilted, fall_faster
from raytracer.lecture import dot


def lobe_probabilities(shading: Shading, with_diffuse: bool = False, through_only: bool = False) -> Floats:
    """Return the probability of each lobe: the passage first, then the lobes, (n, 1 + lobes); rows of 0 have none.

    with_diffuse : True appends the Lambertian parts, that of the surface's normal first: (n, 2 + lobes + tilted)
    through_only : True gives a chance to those alone of them that light comes through
    """
    shares = lobe_shares(shading, with_diffuse, through_only)
    total = sum_columns(shares)
    if (total > 0).all():
        shares /= total[:, np.newaxis]
        return shares
    total = total[:, np.newaxis]
    return np.divide(shares, total, out=np.zeros_like(shares), where=total > 0)


def lobe_shares(shading: Shading, with_diffuse: bool = False, through_only: bool = False) -> Floats:
    """Return about how much light each lobe sends on, by the columns of `lobe_probabilities`, if it may."""
    count = 1 + len(shading.lobes)
    shares = make_zeros(len(shading), count + (1 + len(shading.tilted) if with_diffuse else 0))
    shares[:, 0] = mean_column(shading.passage)
    for column, lobes in enumerate(shading.lobes, start=1):
        shares[:, column][lobes.hit] = mean_column(lobes.weight) * lobes.albedo
    if with_diffuse:
        shares[:, count] = 0.0 if through_only else mean_column(shading.diffuse)
        for column, part in enumerate(shading.tilted, start=count + 1):
            if part.transmits or not through_only:
                shares[:, column][part.hit] = mean_column(part.albedo)
    return shares


def includes_diffuse(shading: Shading, probabilities: Floats) -> bool:
    """True where the Lambertian parts are among the lobes."""
    return probabilities.shape[1] > 1 + len(shading.lobes)


def evaluate_lobes(
    shading: Shading, probabilities: Floats, incoming: Floats, part: str | None = None
) -> tuple[Floats, Floats]:
    """Return f |cos| (n, 3) of all lobes at each point for light from `incoming` (n, 3), unit, and the density (n,) per
    solid angle with which `sample_bsdf` takes that direction.

    part : 'glossy' leaves only what is reflected in f, 'diffuse' nothing
    """
    specular, density = make_zeros(len(shading)), np.zeros(len(shading))
    for column, lobes in enumerate(shading.lobes, start=1):
        if isinstance(lobes, Microfacets):
            lobes = _select_facing(shading, lobes, incoming)
        if not len(lobes):
            continue
        rows = shorten_rows(lobes.hit, len(shading))
        value, lobe_density = _evaluate(shading, lobes, incoming, rows)
        if part is not None:
            reflects = dot(lobes.normal, take_rows(incoming, rows)) > 0
            value = value * (reflects & (part == "glossy"))[:, np.newaxis]
        add_rows(specular, rows, value)
        density[rows] += probabilities[:, column][rows] * lobe_density
    return specular, density


def _evaluate(shading: Shading, lobes: Lobes, incoming: Floats, rows: Indices | slice) -> tuple[Floats, Floats]:
    """Return f |cos| (m, 3) and the density (m,) of some of the lobes, which are at some `rows`, for light from
    `incoming` (n, 3)."""
    vectors = (shading.outgoing, incoming, shading.geometric_normal)
    outgoing, incoming, geometric_normal = (take_rows(values, rows) for values in vectors)
    if isinstance(lobes, HairLobes):
        return lobes.evaluate(outgoing, incoming)
    return evaluate_microfacets(lobes, outgoing, incoming, geometric_normal)


def evaluate_diffuse(shading: Shading, incoming: Floats, cosine: Floats | None = None) -> Floats:
    """Return f |cos| (n, 3) of all Lambertian parts for light from `incoming` (n, 3), unit.

    cosine : (n,) of `incoming` and the normals, where that is known
    """
    cosine = dot(shading.normal, incoming) if cosine is None else cosine
    value = shading.diffuse * (np.maximum(cosine, 0.0) / np.pi)[:, np.newaxis]
    if shading.frequency is not None:
        value *= fall_faster(cosine, shading.frequency)[:, np.newaxis]
    for part in shading.tilted:
        fades = None if shading.fades_bumps is None else shading.fades_bumps[part.hit]
        arriving = take_rows(incoming, part.hit)
        light = evaluate_tilted(part, take_rows(shading.normal, part.hit), arriving, fades)
        if shading.frequency is not None:
            light *= fall_faster(dot(part.normal, arriving), shading.frequency[part.hit])[:, np.newaxis]
        add_rows(value, part.hit, light)
    return value


def diffuse_density(shading: Shading, probabilities: Floats, incoming: Floats, cosine: Floats | None = None) -> Floats:
    """Return the density (n,) with which `sample_bsdf` takes `incoming` for one of the Lambertian parts.

    It is cos / pi about each part's normal, but nothing on the surface's other side, where directions are refused.

    cosine : as of `evaluate_diffuse`
    """
    first = 1 + len(shading.lobes)
    cosine = dot(shading.normal, incoming) if cosine is None else cosine
    above = dot(shading.geometric_normal, incoming) > 0
    density = keep_rows(probabilities[:, first] * np.maximum(cosine, 0.0), above)
    for column, part in enumerate(shading.tilted, start=first + 1):
        cosine = np.maximum(dot(part.normal, take_rows(incoming, part.hit)), 0.0)
        chance = probabilities[:, column][part.hit]
        density[part.hit] += np.where(above[part.hit] != part.transmits, chance * cosine, 0.0)
    density /= np.pi
    return density


def evaluate_bsdf(
    shading: Shading, probabilities: Floats, incoming: Floats, part: str | None = None
) -> tuple[Floats, Floats]:
    """Return f |cos| (n, 3) and the density (n,) of all lobes but the passage, as `evaluate_lobes`.

    part : 'diffuse' or 'glossy' leaves only that in f; the density is always that of all
    """
    if not includes_diffuse(shading, probabilities):
        return evaluate_lobes(shading, probabilities, incoming, part)
    cosine = dot(shading.normal, incoming)
    density = diffuse_density(shading, probabilities, incoming, cosine)
    value = make_zeros(len(shading)) if part == "glossy" else evaluate_diffuse(shading, incoming, cosine)
    if shading.lobes:
        specular, lobe_density = evaluate_lobes(shading, probabilities, incoming, part)
        value += specular
        density += lobe_density
    return value, density


def _select_facing(shading: Shading, lobes: Microfacets, incoming: Floats) -> Microfacets:
    """Return the lobes that may send light from `incoming` (n, 3) back: perfect ones never, others to the side of the
    surface that they reflect or transmit to."""
    facing = dot(lobes.normal, take_rows(incoming, shorten_rows(lobes.hit, len(shading)))) > 0
    if lobes.transmission is not None:
        facing = (facing & lobes.reflects) | (~facing & lobes.transmits)
    elif lobes.reflection is not None:
        facing &= lobes.reflects
    facing &= ~lobes.is_perfect
    return lobes if facing.all() else lobes.select(np.flatnonzero(facing))
