"""Blender's Hair BSDF: one lobe on a cone around the strand, that comes back (Reflection) or goes through
(Transmission).

    f |cos| = C(theta) N(phi) / cos theta_i,  C = r / (2 (t^2 + r^2) (a - b)),  t = (theta_i + theta_o) / 2 - offset,

a Cauchy distribution of the half angle between where it is at its ends, a = atan((pi/2 + theta_o)/2 - offset)/r) and b
likewise; around the strand N = cos(phi / (2 s)) / (4 s) about the side that light is seen from, or a Cauchy
distribution of width s about the other, of which half the circle counts 1: where the surface's normal points to the
viewer, that is all that it sends on.

References
----------
S. R. Marschner and others, "Light Scattering from Human Hair Fibers", SIGGRAPH 2003.
Blender, intern/cycles/kernel/closure/bsdf_hair.h (after Open Shading Language).

Notes
-----
The lobe is what Cycles says of the light of lamps: nothing comes back from, or goes through to, the wrong side of the
surface's normal, nor comes back from beyond a right angle around the strand. Directions that Cycles finds by following
the lobe are not cut so there, and they count more often than by their density where the lobe is narrow around the
strand; its pictures depend on which of the two finds the light. Here both are the same.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Self

import numpy as np

from raytracer.arrays.rows import repeat_column
from raytracer.arrays.types import Floats
from raytracer.arrays.vectors import make_frame, normalize
from raytracer.bsdfs.bounce_kinds import GLOSSY, TRANSMITTED
from raytracer.bsdfs.hair import HairLobes, HairSamples
from raytracer.lecture import cross, dot

# Cycles' range of roughnesses, and how close to the strand's own direction, in radians, nothing is sent: the cosine
# that it divides by is as small there.
SMOOTHEST, CLOSEST = 0.001, 0.001


@dataclass(frozen=True, eq=False)
class CauchyHair(HairLobes):
    """m lobes of one kind; further fields, (m,) float64.

    along, around : widths r and s
    offset : of the cone, radians
    passes : 1 where light goes through, 0 where it comes back
    """

    along: Floats
    around: Floats
    offset: Floats
    passes: Floats

    @property
    def reflection(self) -> Floats:
        return repeat_column(1.0 - self.passes)

    @property
    def transmission(self) -> Floats:
        return repeat_column(self.passes)

    @property
    def albedo(self) -> Floats:
        return np.ones(len(self))

    def estimate_color(self) -> Floats:
        return np.ones((len(self), 3))

    def blur(self, least: Floats) -> Self:
        along, around = np.maximum(self.along, least), np.maximum(self.around, least)
        return dataclasses.replace(self, along=along, around=around)

    def evaluate(self, outgoing: Floats, incoming: Floats) -> tuple[Floats, Floats]:
        view, side = find_side(self, outgoing)
        sine = np.clip(dot(self.tangent, incoming), -1.0, 1.0)
        theta = np.arcsin(sine)
        flat = normalize(incoming - sine[:, np.newaxis] * self.tangent)
        cosine = np.clip(dot(flat, side), -1.0, 1.0)
        sent = np.pi / 2.0 - np.abs(theta) >= CLOSEST
        passes = self.passes > 0
        sent &= (dot(self.normal, incoming) < 0) == passes
        sent &= passes | (cosine >= 0)
        density = around_density(self, np.arccos(cosine)) * along_density(self, view, theta)
        density = np.where(sent, density / np.maximum(np.cos(theta), np.sin(CLOSEST)), 0.0)
        gain = np.where(passes, np.arctan(np.pi / self.around) / np.arctan(np.pi / 2.0 / self.around), 1.0)
        return self.weight * (gain * density)[:, np.newaxis], density

    def sample(self, outgoing: Floats, choice: Floats, pair: Floats) -> HairSamples:
        view, side = find_side(self, outgoing)
        high, low = find_ends(self, view)
        theta = 2.0 * (self.along * np.tan(low + pair[:, 0] * (high - low)) + self.offset) - view
        passes = self.passes > 0
        back = 2.0 * np.arcsin(1.0 - 2.0 * pair[:, 1]) * self.around
        through = np.pi + self.around * np.tan(2.0 * np.arctan(np.pi / self.around) * (pair[:, 1] - 0.5))
        phi = np.where(passes, through, back)
        other = cross(side, self.tangent)
        cosine = np.cos(theta)[:, np.newaxis]
        direction = np.sin(theta)[:, np.newaxis] * self.tangent
        direction += cosine * (np.cos(phi)[:, np.newaxis] * side - np.sin(phi)[:, np.newaxis] * other)
        kind = np.where(passes, GLOSSY | TRANSMITTED, GLOSSY).astype(np.uint8)
        return HairSamples(direction, np.ones(len(self), dtype=np.bool_), kind)


def limit_width(roughness: Floats) -> Floats:
    """Return the widths (m,) that a lobe may have."""
    return np.clip(roughness, SMOOTHEST, 1.0)


def find_side(hair: CauchyHair, outgoing: Floats) -> tuple[Floats, Floats]:
    """Return theta (m,) of the view, and the unit vectors (m, 3) across the strand that it is seen from."""
    sine = np.clip(dot(hair.tangent, outgoing), -1.0, 1.0)
    side = normalize(outgoing - sine[:, np.newaxis] * hair.tangent)
    along_view = np.flatnonzero(~side.any(axis=1))
    if len(along_view):
        side[along_view] = make_frame(hair.tangent[along_view])[0]
    return np.arcsin(sine), side


def find_ends(hair: CauchyHair, view: Floats) -> tuple[Floats, Floats]:
    """Return a and b (m,), the arc tangents of the ends of the half angle."""
    high, low = (np.arctan(((end + view) / 2.0 - hair.offset) / hair.along) for end in (np.pi / 2.0, -np.pi / 2.0))
    return high, low


def along_density(hair: CauchyHair, view: Floats, theta: Floats) -> Floats:
    """Return C (m,), the density of theta."""
    high, low = find_ends(hair, view)
    t = (theta + view) / 2.0 - hair.offset
    return hair.along / (2.0 * (t * t + hair.along**2) * (high - low))


def around_density(hair: CauchyHair, phi: Floats) -> Floats:
    """Return the density (m,) of phi from 0 to pi, to each side, that is sampled: N, or for what goes through the same
    Cauchy distribution of the whole circle."""
    back = np.cos(np.minimum(phi / hair.around, np.pi) / 2.0) / (4.0 * hair.around)
    opposite = np.pi - phi
    through = hair.around / (2.0 * np.arctan(np.pi / hair.around) * (opposite * opposite + hair.around**2))
    return np.where(hair.passes > 0, through, back)
