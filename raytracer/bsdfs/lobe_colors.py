"""The color of lobes: the share of white light from all around that they reflect, and that they let through.

As passes of colors show it, which is an estimate: that of a smooth surface, but where the mean over the facets of a
reflecting dielectric is tabulated.

References
----------
Blender, intern/cycles/kernel/closure/bsdf_microfacet.h: bsdf_microfacet_estimate_albedo.
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.rows import make_zeros, take_rows
from raytracer.arrays.types import Floats
from raytracer.bsdfs.closures import Lobes, Shading
from raytracer.bsdfs.fresnel import DIELECTRIC
from raytracer.bsdfs.hair import HairLobes
from raytracer.bsdfs.microfacet import evaluate_fresnel
from raytracer.bsdfs.microfacet_albedo import read_schlick_share
from raytracer.bsdfs.thin_film import THINNEST
from raytracer.lecture import dot


def sum_lobe_colors(shading: Shading, all_tabulated: bool = False) -> tuple[Floats, Floats]:
    """Return what all lobes reflect, and what they transmit, of white light, (n, 3) each.

    all_tabulated : True reads the table for glass as well, as Cycles does: its table is that of the outside on either
        side, so that where all is reflected inside, some is lost
    """
    reflected, transmitted = np.zeros((len(shading), 3)), np.zeros((len(shading), 3))
    for lobes in shading.lobes:
        cosine = np.clip(dot(take_rows(shading.outgoing, lobes.hit), lobes.normal), 0.0, 1.0)
        # The factor for light lost between facets is none of the color.
        weight = lobes.weight / lobes.energy_scale[:, np.newaxis]
        for total, color in zip((reflected, transmitted), estimate_color(lobes, cosine, all_tabulated), strict=True):
            total[lobes.hit] += weight * color
    return reflected, transmitted


def estimate_color(lobes: Lobes, cosine: Floats, all_tabulated: bool = False) -> tuple[Floats, Floats]:
    """Return reflectance and transmittance (m, 3) of lobes seen at `cosine` (m,) from their normals; hair that does
    both is of its whole color in both, as in Cycles."""
    if isinstance(lobes, HairLobes):
        color = lobes.estimate_color()
        return color * lobes.reflection, color * lobes.transmission
    reflectance, transmittance = evaluate_fresnel(lobes, cosine)
    is_tabulated = all_tabulated | (~lobes.is_perfect & ~lobes.transmits)
    if lobes.film is not None:
        is_tabulated &= lobes.film.thickness <= THINNEST
    rows = np.flatnonzero(is_tabulated)
    if len(rows) and lobes.fresnel == DIELECTRIC:
        share = read_schlick_share(np.sqrt(lobes.alpha[rows]), cosine[rows], lobes.eta[rows])[:, np.newaxis]
        f0, tint = lobes.f0[rows], 1.0 if lobes.reflection is None else lobes.reflection[rows]
        reflectance[rows] = (f0 + (1.0 - f0) * share) * tint
    return reflectance, make_zeros(len(lobes)) if transmittance is None else transmittance
