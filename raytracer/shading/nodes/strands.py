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

from raytracer.arrays.rows import join_columns
from raytracer.arrays.vectors import normalize
from raytracer.bsdfs.hair import absorb_by_color, absorb_by_melanin, make_strand_frame
from raytracer.bsdfs.hair_ellipse import measure_radius
from raytracer.lecture import cross, dot
from raytracer.sampling.streams import draw, hash_columns
from raytracer.scene.materials import SMALLEST_ASPECT
from raytracer.shading.nodes.operation import Array, Operation
from raytracer.shading.site import Site

# The attributes of strands that nodes read: of points how far up they are, from 0 to 1, and the longer axis of their
# cross section, in object space; the others of strands.
INTERCEPT, AXIS, LENGTH, RANDOM = "strand intercept", "strand axis", "strand length", "strand random"


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


def find_axis(site: Site) -> Array:
    """The longer axis of the cross section of strands, across them, unit: as Blender turns them, or where it says
    nothing one that only the strand decides on, as in Cycles (util/math_float3.h: make_orthonormals); 0 elsewhere."""
    tangent = normalize(site.find_edges()[0])
    axis = site.to_world(site.read_attribute(AXIS)[:, :3], "OBJECT", "VECTOR")
    axis = normalize(axis - dot(axis, tangent)[:, np.newaxis] * tangent)
    x, y, z = tangent.T
    even = (x == y) & (x == z)
    third = normalize(join_columns(z - y, np.where(even, x + z, x - z), np.where(even, -y - x, y - x)))
    axis = np.where(axis.any(axis=1)[:, np.newaxis], axis, cross(tangent, third))
    return np.where(site.is_strand[:, np.newaxis], axis, 0.0)


def find_aspect(aspect: Any) -> Array:
    """The shorter axis of a cross section over the longer one; as in Cycles it does not matter which is which."""
    aspect = np.maximum(np.asarray(aspect, dtype=np.float64), SMALLEST_ASPECT)
    return np.minimum(aspect, 1.0 / aspect)


def find_inside(site: Site, axis: Any, aspect: Any, across: Any) -> Array:
    """1 where a strand is met within the width that its cross section is seen with, else 0."""
    across_strand = site.outgoing - project(site.outgoing, normalize(site.find_edges()[0]))
    sine = np.clip(dot(normalize(across_strand), np.broadcast_to(axis, across_strand.shape)), -1.0, 1.0)
    return (np.abs(across) < measure_radius(np.arcsin(sine), np.asarray(aspect))).astype(np.float64)


def project(vectors: Array, onto: Array) -> Array:
    """The parts (n, 3) of vectors that lie along unit vectors, both (n, 3)."""
    return dot(vectors, onto)[:, np.newaxis] * onto


def measure_coverage(site: Site) -> Array:
    """Half the width of a pixel, in radii of the strand; 1, far away, where the camera does not see it by itself."""
    radius, seen = site.find_radius(), site.read_path("camera") > 0
    return np.divide(site.footprint / 2.0, radius, out=np.ones_like(radius), where=seen & (radius > 0))


def draw_chance(site: Site) -> Array:
    """A uniform number that no two places share."""
    return draw(hash_columns(*site.position.T), 0)


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
    "STRAND Axis": Operation(find_axis, (), ("Axis",), reads_site=True, attributes=lambda settings: (AXIS,)),
    "STRAND Aspect": Operation(find_aspect, ("Aspect",), ("Aspect",)),
    "STRAND Inside": Operation(find_inside, ("Axis", "Aspect", "Across"), ("Inside",), reads_site=True),
    "STRAND Coverage": Operation(measure_coverage, (), ("Coverage",), reads_site=True),
    "STRAND Chance": Operation(draw_chance, (), ("Chance",), reads_site=True),
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
