"""Ways of light through a strand: reflected (R), through (TT), reflected once inside (TRT), and what is left then.

Light meets the cuticle once outside and twice inside (`Strand`, `Ways`); it is told either how much leaves to given
directions (`sum_ways`), or where some of it leaves to (`take_ways`).

What is still inside after that is summed up as a geometric series, and leaves to all sides around the strand, along it
as rough as four times the facets.

References
----------
W. Huang, M. B. Hullin, J. Hanika, "A Microfacet-based Hair Scattering Model", Computer Graphics Forum 41(4), 2022.
M. J.-Y. Chiang and others, "A Practical and Controllable Hair and Fur Model for Production Path Tracing", 2016: what
    is left.
Blender, intern/cycles/kernel/closure/bsdf_principled_hair_huang.h.

Notes
-----
Where scales are tilted, Cycles' answers to these two questions are not quite the same, and so are ours, that pictures
agree whichever finds the light: only the first weighs light by how the surface leans to it (`hair_cuticle.lean`).

For the first, Cycles estimates what leaves later in another way, which comes to more than there is of it, where hair
absorbs nothing twice and more. Here both are the same, and no light is added.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from raytracer.arrays.rows import join_columns, scale_vectors, take_rows
from raytracer.arrays.types import Floats
from raytracer.arrays.vectors import reflect
from raytracer.bsdfs.hair import cosine_of, longitudinal, sample_longitudinal
from raytracer.bsdfs.hair_cuticle import (
    Cuticle,
    lean,
    leave_to,
    meet_cuticle,
    pass_through,
    reflect_off,
    reflect_to,
    sample_facets,
    shadow_way_out,
)
from raytracer.bsdfs.hair_ellipse import cross_ellipse, measure_azimuth, measure_cosine, meet_ellipse

# Variance of what is summed up, along the strand, in roughnesses.
REST_VARIANCE = 4.0
# The least share T of it that gets out at once. Where facets reflect all and nothing is absorbed, A T / (1 - A (1 - T))
# would be 0 / 0; with this T it is 1, as with any other, to the rounding of 1 - (1 - T), 2^-53 / 1e-5 = 1e-11. Where a
# way leaves A < 1 of light it adds T A / (1 - A) at most, 1e-3 at A = .99.
LEAST_TRANSMITTANCE = 1e-5


@dataclass(frozen=True, eq=False, slots=True)
class Strand:
    """n strands that light comes to, all of it told in their own frames; (n,) float64 but the first two.

    incoming : (n, 3) float64, unit; absorption : (n, 3) float64, per half axis
    alpha, aspect, tilt, eta : of facets, of the cross section, of the scales, index of refraction
    """

    incoming: Floats
    absorption: Floats
    alpha: Floats
    aspect: Floats
    tilt: Floats
    eta: Floats

    def select(self, rows: Any) -> Strand:
        """Return some of the strands, also several times."""
        return Strand(*(take_rows(getattr(self, item.name), rows) for item in dataclasses.fields(self)))


@dataclass(frozen=True, eq=False, slots=True)
class Ways:
    """Ways of light in n strands.

    outside, second, third : where it meets the cuticle
    halves : of each, normals (n, 3) of facets that it meets
    rest : (n, 3) float64, what leaves later
    """

    outside: Cuticle
    second: Cuticle
    third: Cuticle
    halves: tuple[Floats, Floats, Floats]
    rest: Floats


def follow_light(strand: Strand, turn: Floats, pairs: Floats, leans: bool) -> Ways:
    """Return ways of light that comes to sin(turn) (n,) of half the width.

    pairs : (n, 6) uniform numbers; leans : whether light is weighed by how tilted surfaces lean to it
    """
    angle = meet_ellipse(turn, measure_azimuth(strand.incoming), strand.aspect)
    ones = np.ones_like(strand.absorption)
    outside = meet_cuticle(strand.incoming, angle, strand.aspect, strand.tilt, strand.alpha, strand.eta, ones, leans)
    first = sample_facets(outside, pairs[:, 0:2])
    direction, share = pass_through(outside, first)
    if leans:
        share = share * lean(outside, -direction)
    second, passed = _cross(strand, outside, direction, share, angle, leans)
    half = sample_facets(second, pairs[:, 2:4])
    back, share = reflect_off(second, half)
    if leans:
        share = share * lean(second, back)
    third, again = _cross(strand, second, back, share, second.angle + np.pi, leans)
    last = sample_facets(third, pairs[:, 4:6])
    rest = sum_rest(third, last, second.reflectance(half), np.sqrt(passed * again))
    return Ways(outside, second, third, (first, half, last), rest)


def _cross(
    strand: Strand, cuticle: Cuticle, direction: Floats, share: Floats, angle: Floats, leans: bool
) -> tuple[Cuticle, Floats]:
    """Return where a share (n,) of light that leaves the cuticle inwards, to directions (n, 3), meets it from inside,
    and what is not absorbed (n, 3); angle : (n,) of the normal that looks outwards where it comes from."""
    inwards, way = cross_ellipse(angle, direction, strand.aspect)
    across = np.maximum(measure_cosine(direction), np.finfo(np.float64).eps)
    passed = np.exp(-scale_vectors(strand.absorption, way / across))
    light = scale_vectors(cuticle.light, share) * passed
    inner = meet_cuticle(-direction, inwards, strand.aspect, -strand.tilt, strand.alpha, 1.0 / strand.eta, light, leans)
    return inner, passed


def sum_ways(strand: Strand, ways: Ways, gains: Floats, outgoing: Floats) -> Floats:
    """Return the light (n, 3) that leaves to directions (n, 3) per solid angle; gains : (n, 3) of R, TT and TRT."""
    parts = (reflect_to(ways.outside, outgoing), leave_to(ways.second, outgoing), leave_to(ways.third, outgoing))
    total = np.zeros_like(strand.absorption)
    for column, part in enumerate(parts):
        total += scale_vectors(part, gains[:, column])
    sine, cosine = strand.incoming[:, 1], measure_cosine(strand.incoming)
    spread = longitudinal(outgoing[:, 1], measure_cosine(outgoing), sine, cosine, REST_VARIANCE * strand.alpha)
    return total + scale_vectors(ways.rest, spread / (2.0 * np.pi))


def take_ways(strand: Strand, ways: Ways, gains: Floats, numbers: Floats) -> list[tuple[Floats, Floats]]:
    """Return a direction (n, 3) for each of the four ways, and the light (n, 3) that goes there.

    numbers : (n, 3) uniform, for what leaves later
    """
    places = (ways.outside, ways.second, ways.third)
    found = []
    for column, leave in enumerate((reflect_off, pass_through, pass_through)):
        direction, share = leave(places[column], ways.halves[column])
        found.append((direction, scale_vectors(places[column].light, share * gains[:, column])))
    sine, cosine = strand.incoming[:, 1], measure_cosine(strand.incoming)
    sine = sample_longitudinal(sine, cosine, REST_VARIANCE * strand.alpha, numbers[:, 0], numbers[:, 1])
    cosine, azimuth = cosine_of(sine), 2.0 * np.pi * numbers[:, 2]
    direction = join_columns(cosine * np.sin(azimuth), sine, cosine * np.cos(azimuth))
    return [*found, (direction, ways.rest)]


def sum_rest(third: Cuticle, half: Floats, before: Floats, passed: Floats) -> Floats:
    """Return what leaves later (n, 3) of light that facets with normals (n, 3) reflect inside, the second time.

    A T / (1 - A (1 - T)) of it. As in Cycles, light that facets send out of the surface where they reflect it counts.

    before : (n,) what facets reflected the time before, which with what they do now is 1 - T in the mean
    passed : (n, 3) A, what a way inside leaves of light
    """
    now = third.reflectance(half)
    left = np.maximum(1.0 - (before + now) / 2.0, LEAST_TRANSMITTANCE)[:, np.newaxis]
    share = third.scale * now * shadow_way_out(third, reflect(third.incoming, half))
    return scale_vectors(third.light, share) * passed * left / (1.0 - passed * (1.0 - left))
