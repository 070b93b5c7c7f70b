"""What hair shaders and Curves Info read of strands, and what colors and melanin say of the light that hair absorbs.

Hair shaders may be used on surfaces as well: along the strand is there along a triangle's first edge, as in Cycles.

References
----------
Blender, intern/cycles/kernel/geom/curve.h and triangle.h: what runs along a surface; svm/geometry.h: Curves Info;
svm/closure.h: hair shaders.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from raytracer.arrays.vectors import normalize
from raytracer.bsdfs.hair import absorb_by_color, absorb_by_melanin, make_strand_frame
from raytracer.lecture import cross, dot
from raytracer.shading.nodes.operation import Array, Operation
from raytracer.shading.site import Site

# The attributes of strands that nodes read: how far up, from 0 to 1, of points; the others of strands.
INTERCEPT, LENGTH, RANDOM = "strand intercept", "strand length", "strand random"


def find_across(site: Site) -> Array:
    """h, where strands are met across their width: of ribbons -v; else the sine of the angle around the strand, (n x t)
    . z, in the frame (t, y, z) of the strand and the view, with the normal n: of what is flat the geometric one."""
    tangent = normalize(site.find_edges()[0])
    _, z = make_strand_frame(tangent, site.outgoing)
    normal = np.where(site.is_strand[:, np.newaxis], site.normal, site.geometric_normal)
    across = dot(cross(normal, tangent), z)
    if site.surface.across is not None:
        across = np.where(np.isnan(site.surface.across), across, -site.surface.across)
    return np.clip(across, -1.0, 1.0)


def find_tangent_normal(site: Site) -> Array:
    """The direction to the viewer, laid across the strand, unit; 0 elsewhere."""
    if site.surface.tangent is None:
        return np.zeros((len(site), 3))
    tangent = normalize(site.surface.tangent)
    across = normalize(site.outgoing - dot(site.outgoing, tangent)[:, np.newaxis] * tangent)
    return np.where(site.is_strand[:, np.newaxis], across, 0.0)


def _strand_attribute(output: str, name: str) -> Operation:
    """An output of Curves Info that is an attribute of strands; 0 elsewhere."""

    def read(site: Site) -> Array:
        return np.where(site.is_strand, site.read_attribute(name)[:, 0], 0.0)

    return Operation(read, (), (output,), reads_site=True, attributes=lambda settings: (name,))


def read_random(site: Site, random: Any) -> Array:
    """The random number of a strand; where there is none, another."""
    return np.where(site.has_attribute(RANDOM), site.read_attribute(RANDOM)[:, 0], random)


def vary(amount: Any, random: Any) -> Array:
    """The factor 1 + 2 (r - 1/2) a of a value that varies by an amount a from strand to strand, by numbers r."""
    return 1.0 + 2.0 * (np.asarray(random) - 0.5) * amount


OPERATIONS = {
    "HAIR_INFO Is Strand": Operation(
        lambda site: site.is_strand.astype(np.float64), (), ("Is Strand",), reads_site=True
    ),
    "HAIR_INFO Intercept": _strand_attribute("Intercept", INTERCEPT),
    "HAIR_INFO Length": _strand_attribute("Length", LENGTH),
    "HAIR_INFO Thickness": Operation(lambda site: 2.0 * site.find_radius(), (), ("Thickness",), reads_site=True),
    "HAIR_INFO Tangent Normal": Operation(find_tangent_normal, (), ("Tangent Normal",), reads_site=True),
    "HAIR_INFO Random": _strand_attribute("Random", RANDOM),
    "STRAND Along": Operation(lambda site: site.find_edges()[0], (), ("Along",), reads_site=True),
    "STRAND Aside": Operation(lambda site: site.find_edges()[1], (), ("Aside",), reads_site=True),
    "STRAND Across": Operation(find_across, (), ("Across",), reads_site=True),
    "STRAND Random": Operation(
        read_random, ("Random",), ("Random",), reads_site=True, attributes=lambda settings: (RANDOM,)
    ),
    "STRAND Offset": Operation(
        lambda site, offset: np.where(site.is_strand, offset, 0.0), ("Offset",), ("Offset",), reads_site=True
    ),
    "STRAND Vary": Operation(vary, ("Amount", "Random"), ("Factor",)),
    "STRAND Absorption by Color": Operation(absorb_by_color, ("Color", "Radial Roughness"), ("Absorption",)),
    "STRAND Absorption by Melanin": Operation(absorb_by_melanin, ("Melanin", "Melanin Redness"), ("Absorption",)),
}
