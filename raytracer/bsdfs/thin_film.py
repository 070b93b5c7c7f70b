"""Thin films: what a coat of some hundred nanometres makes of a surface's reflection, by interference.

Light of wavelength w that a film of index n and thickness d sends back from its lower side comes later by the optical
path difference D = 2 n d cos_2. With the reflectances R12 of its upper and R23 of its lower side, r^2 = R12 R23,
T = 1 - R12, Rs = T^2 R23 / (1 - r^2), and the phase phi that both reflections shift by, Airy's sum is, for one
polarization,

    R(w) = R12 + Rs + 2 sum_{m >= 1} (Rs - T) r^m cos(m (2 pi D / w + phi)).

Seen by a channel of weights s(w), of integral 1, the cosine becomes Re(exp(i m phi) S(m D)), where the *sensitivity*
S(D) = integral s(w) exp(2 pi i D / w) dw is a table: three terms stand for an endless number of wavelengths.

References
----------
L. Belcour, P. Barla, "A Practical Extension to Microfacet Theory for the Modeling of Varying Iridescence", 2017.
M. Born, E. Wolf, "Principles of Optics", 7th ed., sections 1.6.4 and 14.4.
Blender, intern/cycles/kernel/closure/bsdf_util.h: fresnel_iridescence, with as many terms; bsdf_microfacet.h:
microfacet_fresnel, the metals and tints; svm/closure.h: films seen from within.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats
from raytracer.arrays.vectors import transform
from raytracer.bsdfs.fresnel import (
    CONDUCTOR,
    DIELECTRIC,
    METAL,
    SMALLEST_INDEX,
    metal_reflectance,
    metal_slope,
    normal_reflectance,
    transmitted_cosine,
)
from raytracer.textures.color_matching import RGB_FROM_XYZ, SHORTEST, STEP, read_color_matching

Complexes = NDArray[np.complex128]

# Nanometres. Cycles' limits: thinner films are none; up to the second their index approaches that of what is around.
THINNEST, THIN = 0.1, 1.0
# Terms of Airy's sum. The rest is below 2 r^4 / (1 - r) of Rs - T: 0.004 of a film of index 2 on glass or on silver.
TERMS = 3
# Nanometres: path differences of the table, from 0 to where nothing interferes any more. Linear between, cosines of
# period 400 are off by 1 - cos(pi 2 / 400) = 1.3e-4.
TABLE_STEP, LARGEST_DIFFERENCE = 2.0, 30000.0
# Of the quadrature over wavelengths, nanometres: a cosine at the largest difference has a period of 5 (at 400).
QUADRATURE_STEP = 1.0
# Rows of the table that are computed at a time.
BLOCK_ROWS = 256
# As near to grazing as a square root of a float64's last place: seen so, all surfaces reflect all.
SMALLEST_COSINE = 2.0**-26
# Reflectances at normal incidence below which a tint of it makes no difference, and above which a metal has no index.
FAINTEST, BRIGHTEST = 1e-5, 0.999


@dataclass(frozen=True, eq=False, slots=True)
class Film:
    """Films on m lobes.

    thickness : (m,) float64, nanometres; THINNEST or less is none
    ior : (m,) float64, index of refraction over that of the side that light comes from
    """

    thickness: Floats
    ior: Floats

    def select(self, rows: Any) -> Film:
        """Return some of the films: index or boolean array."""
        return Film(self.thickness[rows], self.ior[rows])


def film_reflectance(kind: int, cosine: Floats, film: Film, f0: Floats, f82: Floats | None, eta: Floats) -> Floats:
    """Return the reflectance (m, 3) of facets of one kind under films; fields as in `microfacet.Microfacets`."""
    if kind == DIELECTRIC:
        substrate = eta[:, np.newaxis] + 0.0j
        return tint_reflectance(interfere(cosine, film, substrate), f0, normal_reflectance(eta)[:, np.newaxis])
    assert f82 is not None
    if kind == CONDUCTOR:
        return interfere(cosine, film, np.maximum(f0, SMALLEST_INDEX) + 1j * f82)
    assert kind == METAL
    bent = metal_reflectance(np.array(1.0 / 7.0), f0, f82)
    return interfere(cosine, film, estimate_index(f0, bent), bent)


def tint_reflectance(reflectance: Floats, f0: Floats, own: Floats) -> Floats:
    """Return the reflectance (m, 3) of films on dielectrics whose own reflectance at normal incidence (m, 1) is said to
    be f0 (m, 3): scaled by f0 / own where it is as low as that, and less the nearer it is to 1."""
    tinted = own > FAINTEST
    own = np.where(tinted, own, FAINTEST)
    share = np.clip((1.0 - reflectance) / (1.0 - own), 0.0, 1.0)
    return np.where(tinted, reflectance * (1.0 + share * (f0 / own - 1.0)), reflectance)


def estimate_index(f0: Floats, bent: Floats) -> Complexes:
    """Return the index n + i k (m, 3) of a metal that reflects f0 at normal incidence, and `bent` at 82 degrees.

    O. Gulbrandsen, "Artist Friendly Metallic Fresnel", 2014, where `bent` is the edge tint.
    """
    r = np.minimum(f0, BRIGHTEST)
    root = np.sqrt(r)
    highest, lowest = (1.0 + root) / (1.0 - root), (1.0 - r) / (1.0 + r)
    n = highest + bent * (lowest - highest)
    k = np.sqrt(np.maximum(r * (n + 1.0) ** 2 - (n - 1.0) ** 2, 0.0) / (1.0 - r))
    return n + 1j * k


def interfere(cosine: Floats, film: Film, substrate: Complexes, bent: Floats | None = None) -> Floats:
    """Return the reflectance (m, 3) of films seen at cosines (m,), on substrates of index (m, 1) or (m, 3).

    bent : of metals, (m, 3): they reflect by the curve to it at 82 degrees, and their index gives phases alone; or None
    """
    ior = np.where(film.thickness < THIN, 1.0 + (film.ior - 1.0) * smoothstep(film.thickness / THIN), film.ior)
    cosine = np.maximum(cosine, SMALLEST_COSINE)
    below = transmitted_cosine(cosine, ior)
    inside = below > 0  # elsewhere nothing enters the film
    difference = 2.0 * ior * film.thickness * below
    above, under, index = (row[:, np.newaxis] for row in (cosine, np.where(inside, below, 1.0), ior))
    deeper = np.sqrt(1.0 - (1.0 - under * under) * (index / substrate) ** 2)
    total = np.zeros((len(cosine), 3))
    for polarization in (reflect_across, reflect_along):
        upper = polarization(above, index, under).real
        lower = polarization(under, substrate / index, deeper)
        strength: Floats = lower.real * lower.real + lower.imag * lower.imag
        if bent is not None:
            own = normal_metal_reflectance(substrate / index)
            strength = metal_reflectance(under, own, metal_slope(own, bent))
        # From within, the upper side reflects with the opposite sign.
        phase = np.exp(1j * np.angle(lower)) * np.where(upper > 0, -1.0, 1.0)
        total += sum_airy(upper * upper, strength, phase, difference) / 2.0
    return np.where(inside[:, np.newaxis], np.clip(total, 0.0, 1.0), 1.0)


def smoothstep(share: Floats) -> Floats:
    """3 s^2 - 2 s^3."""
    return share * share * (3.0 - 2.0 * share)


def reflect_across(front: Any, eta: Any, behind: Any) -> Complexes:
    """Return Fresnel's amplitude r_s = (c - eta c') / (c + eta c') for cosines c before and c' behind."""
    return np.asarray((front - eta * behind) / (front + eta * behind), dtype=np.complex128)


def reflect_along(front: Any, eta: Any, behind: Any) -> Complexes:
    """Return Fresnel's amplitude r_p = (eta c - c') / (eta c + c')."""
    return np.asarray((eta * front - behind) / (eta * front + behind), dtype=np.complex128)


def normal_metal_reflectance(index: Complexes) -> Floats:
    """Return |(m - 1) / (m + 1)|^2 for a complex index m."""
    amplitude = np.abs((index - 1.0) / (index + 1.0))
    return amplitude * amplitude


def sum_airy(upper: Floats, lower: Floats, phase: Complexes, difference: Floats) -> Floats:
    """Return the reflectance (m, 3) of one polarization.

    upper, lower : (m, 1) and (m, 1) or (m, 3), R12 and R23
    phase : like `lower`, exp(i phi)
    difference : (m,) D, nanometres
    """
    through = 1.0 - upper
    once = np.minimum(upper * lower, 1.0 - np.finfo(np.float64).eps)
    returned = through * through * lower / (1.0 - once)
    total: Floats = np.zeros((len(difference), 3)) + upper + returned
    factor, turned = 2.0 * (returned - through), np.ones_like(phase)
    for order in range(1, TERMS + 1):
        factor, turned = factor * np.sqrt(once), turned * phase
        total += factor * (turned * read_sensitivity(order * difference)).real
    return total


@cache
def sensitivity_table() -> Complexes:
    """Return (k, 3) S(D) of red, green and blue for D in steps of TABLE_STEP."""
    matching = read_color_matching()
    rows = SHORTEST + STEP * np.arange(len(matching))
    wavelengths = np.arange(rows[0], rows[-1] + QUADRATURE_STEP, QUADRATURE_STEP)
    xyz = np.stack([np.interp(wavelengths, rows, column) for column in matching.T], axis=1)
    weights = transform(RGB_FROM_XYZ, xyz)
    weights /= weights.sum(axis=0)
    differences = np.arange(0.0, LARGEST_DIFFERENCE + TABLE_STEP, TABLE_STEP)
    table = np.empty((len(differences), 3), dtype=np.complex128)
    for start in range(0, len(differences), BLOCK_ROWS):
        part = slice(start, start + BLOCK_ROWS)
        waves = np.exp(2j * np.pi * differences[part, np.newaxis] / wavelengths)
        for channel, weight in enumerate(weights.T):
            table[part, channel] = (waves * weight).sum(axis=1)
    return table


def read_sensitivity(difference: Floats) -> Complexes:
    """Return (m, 3) the table at path differences (m,), nanometres; linear between its rows, at its end the last."""
    table = sensitivity_table()
    place = np.minimum(difference / TABLE_STEP, len(table) - 1.0)
    row = np.minimum(place.astype(np.intp), len(table) - 2)
    share = (place - row)[:, np.newaxis]
    return table[row] * (1.0 - share) + table[row + 1] * share
