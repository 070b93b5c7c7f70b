"""Hair after Chiang and others: a rough, absorbing cylinder whose scales are tilted.

Light is reflected (R), goes through (TT), or is reflected once (TRT) or more often inside, which is summed up (TRRT+).
Each of these lobes is a product of the light that is left, of longitudinal scattering M_p around a cone that the scales
tilt, and of azimuthal scattering N_p around where a smooth cylinder would send it:

    f |cos| = sum_p A_p M_p(theta, theta_o + d_p) N_p(phi - phi_o - Phi_p),   Phi_p = 2 p gamma_t - 2 gamma_o + p pi

with tilts d_p of 2 a, -a, -4 a and 0 and h = sin gamma_o, where across its width the strand is met.

References
----------
M. J.-Y. Chiang, B. Bitterli, C. Tappan, B. Burley, "A Practical and Controllable Hair and Fur Model for Production Path
Tracing", Computer Graphics Forum 35(2), 2016.
Blender, intern/cycles/kernel/closure/bsdf_principled_hair_chiang.h: parameters, and which lobe the coat smooths. Cycles
takes I0 with an error of up to 3% of a lobe's peak; here it is exact.

Notes
-----
The tilts turn the view, as in Cycles since about Blender 4.3; in the paper, and in Cycles before, they turn the light,
which is nearly the same. So M_p is a density whatever the tilt, and all light that is not absorbed is sent on.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import mean_column
from raytracer.arrays.types import Floats
from raytracer.bsdfs.bounce_kinds import GLOSSY, TRANSMITTED
from raytracer.bsdfs.fresnel import dielectric_reflectance
from raytracer.bsdfs.hair import (
    HairLobes,
    HairSamples,
    cosine_of,
    longitudinal,
    make_strand_frame,
    sample_longitudinal,
)
from raytracer.lecture import dot

# The lobes R, TT and TRT; the last sums up the others.
LAST = 3
# Tilts of the lobes, in tilts of the scales.
TILTS = (2.0, -1.0, -4.0, 0.0)
# Cycles' range of roughnesses.
SMOOTHEST = 0.001
# exp of more overflows.
LARGEST_EXPONENT = 700.0
# Where both sides have the same index, or the inner one the lower, no light inside runs along the strand.
SMALLEST_COSINE = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class ChiangHair(HairLobes):
    """m strands; further fields, (m,) float64 but `absorption`, which is (m, 3), per radius.

    across : h, from -1 to 1
    variance, reflected_variance : of longitudinal scattering, and of that of R, which a coat smooths
    scale : of azimuthal scattering, a logistic distribution
    tilt : of the scales, radians; ior : index of refraction inside
    """

    across: Floats
    absorption: Floats
    variance: Floats
    reflected_variance: Floats
    scale: Floats
    tilt: Floats
    ior: Floats

    def show_normal(self, outgoing: Floats) -> Floats:
        """Return the axis across strand and view: Cycles' model keeps its frame where others keep their normal
        (kernel/closure/bsdf_principled_hair_chiang.h), and passes show that."""
        return make_strand_frame(self.tangent, outgoing)[0]

    @property
    def albedo(self) -> Floats:
        return mean_column(self.estimate_color())

    def estimate_color(self) -> Floats:
        """Return the light (m, 3) that is left of all lobes if the strand is met at a right angle."""
        across = np.zeros(len(self))
        return sum(attenuate(self, across, np.ones(len(self)))[0], start=np.zeros((len(self), 3)))

    def blur(self, least: Floats) -> Self:
        names = ("variance", "reflected_variance", "scale")
        return dataclasses.replace(self, **{name: np.maximum(getattr(self, name), least) for name in names})

    def evaluate(self, outgoing: Floats, incoming: Floats) -> tuple[Floats, Floats]:
        view, light = find_angles(self, outgoing, outgoing), find_angles(self, outgoing, incoming)
        attenuation, chances, inner = describe_lobes(self, view)
        value, density = np.zeros((len(self), 3)), np.zeros(len(self))
        for order in range(LAST + 1):
            around = azimuthal(self, order, light.azimuth - view.azimuth, inner)
            cone = turn(view, TILTS[order] * self.tilt)
            sent = longitudinal(light.sine, light.cosine, *cone, variance_of(self, order)) * around
            value += attenuation[order] * sent[:, np.newaxis]
            density += chances[order] * sent
        return self.weight * value, density

    def sample(self, outgoing: Floats, choice: Floats, pair: Floats) -> HairSamples:
        view = find_angles(self, outgoing, outgoing)
        _, chances, inner = describe_lobes(self, view)
        order, rest = choose_order(chances, choice)
        tilt = np.array(TILTS)[order] * self.tilt
        variance = np.choose(order, [variance_of(self, number) for number in range(LAST + 1)])
        sine = sample_longitudinal(*turn(view, tilt), variance, rest, pair[:, 0])
        logistic = np.choose(order, [*(center_of(number, self.across, inner) for number in range(LAST)), 0.0 * inner])
        logistic += sample_trimmed_logistic(self.scale, pair[:, 1])
        azimuth = view.azimuth + np.where(order == LAST, 2.0 * np.pi * pair[:, 1], logistic)
        y, z = make_strand_frame(self.tangent, outgoing)
        cosine = cosine_of(sine)
        direction = sine[:, np.newaxis] * self.tangent
        direction += (cosine * np.cos(azimuth))[:, np.newaxis] * y + (cosine * np.sin(azimuth))[:, np.newaxis] * z
        kind = np.where(order == 0, GLOSSY, GLOSSY | TRANSMITTED).astype(np.uint8)
        return HairSamples(direction, np.ones(len(self), dtype=np.bool_), kind)


def find_variance(roughness: Floats) -> Floats:
    """Return the variance (m,) of longitudinal scattering for an even scale of roughness from 0 to 1."""
    b = np.clip(roughness, SMOOTHEST, 1.0)
    return (0.726 * b + 0.812 * b**2 + 3.7 * b**20) ** 2


def find_scale(roughness: Floats) -> Floats:
    """Return the scale (m,) of azimuthal scattering, likewise."""
    b = np.clip(roughness, SMOOTHEST, 1.0)
    return np.sqrt(np.pi / 8.0) * (0.265 * b + 1.194 * b**2 + 5.372 * b**22)


# Angles --------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, slots=True)
class Angles:
    """Directions seen from strands: sine and cosine of theta, and phi, all (m,)."""

    sine: Floats
    cosine: Floats
    azimuth: Floats


def find_angles(hair: ChiangHair, outgoing: Floats, direction: Floats) -> Angles:
    """Return the angles of unit directions (m, 3) in the frames of strands seen from `outgoing`."""
    y, z = make_strand_frame(hair.tangent, outgoing)
    sine = np.clip(dot(direction, hair.tangent), -1.0, 1.0)
    return Angles(sine, cosine_of(sine), np.arctan2(dot(direction, z), dot(direction, y)))


def turn(angles: Angles, tilt: Floats) -> tuple[Floats, Floats]:
    """Return sine and cosine (m,) of theta + tilt; beyond the strand's own direction it is folded back."""
    sine = angles.sine * np.cos(tilt) + angles.cosine * np.sin(tilt)
    cosine = angles.cosine * np.cos(tilt) - angles.sine * np.sin(tilt)
    return np.clip(sine, -1.0, 1.0), np.abs(cosine)


# Lobes ---------------------------------------------------------------------------------------------------------------


def describe_lobes(hair: ChiangHair, view: Angles) -> tuple[list[Floats], list[Floats], Floats]:
    """Return what is left of light in each lobe (m, 3), how often it is chosen (m,), and gamma_t (m,), the angle that
    light goes through the strand at, seen along it."""
    attenuation, inner = attenuate(hair, view.sine, view.cosine)
    energy = [mean_column(light) for light in attenuation]
    total = sum(energy, start=np.zeros(len(hair)))
    # Nothing is reflected, and all is absorbed: any lobe sends on nothing.
    chances = [np.divide(part, total, out=np.full_like(total, 0.25), where=total > 0) for part in energy]
    return attenuation, chances, inner


def attenuate(hair: ChiangHair, sine: Floats, cosine: Floats) -> tuple[list[Floats], Floats]:
    """Return what is left of light in each lobe (m, 3), seen at theta, and gamma_t (m,).

    With F = Fresnel's reflectance and T = exp(-absorption 2 cos gamma_t / cos theta_t): F, (1 - F)^2 T, that times F T,
    and of that the sum of all that follows, F T / (1 - F T).
    """
    inner_cosine = np.maximum(cosine_of(sine / hair.ior), SMALLEST_COSINE)
    bend = np.sqrt(np.maximum(hair.ior**2 - sine**2, SMALLEST_COSINE))
    inner_across = np.clip(hair.across * cosine / bend, -1.0, 1.0)
    reflected = dielectric_reflectance(cosine * cosine_of(hair.across), hair.ior)[:, np.newaxis]
    way = 2.0 * cosine_of(inner_across) / inner_cosine
    passed = np.exp(-hair.absorption * way[:, np.newaxis])
    through = (1.0 - reflected) ** 2 * passed
    once, again = through * passed * reflected, passed * reflected
    further = np.divide(once * again, 1.0 - again, out=np.zeros_like(once), where=again < 1)
    return [np.broadcast_to(reflected, through.shape), through, once, further], np.arcsin(inner_across)


def variance_of(hair: ChiangHair, order: int) -> Floats:
    """Return the variance (m,) of one lobe's longitudinal scattering."""
    return hair.reflected_variance if order == 0 else hair.variance * (0.25 if order == 1 else 4.0)


def choose_order(chances: list[Floats], choice: Floats) -> tuple[NDArray[np.intp], Floats]:
    """Return the lobe (m,) whose interval holds `choice` (m,), and where in it, in [0, 1)."""
    upper = np.cumsum(np.stack(chances), axis=0)
    order = np.minimum((choice * upper[-1] >= upper).sum(axis=0), LAST)
    rows = np.arange(len(choice))
    width = np.stack(chances)[order, rows]
    rest = choice * upper[-1] - (upper[order, rows] - width)
    rest = np.divide(rest, width, out=np.zeros_like(rest), where=width > 0)
    return order, np.clip(rest, 0.0, np.nextafter(1.0, 0.0))


# Azimuthal scattering ------------------------------------------------------------------------------------------------


def center_of(order: int, across: Floats, inner: Floats) -> Floats:
    """Return Phi_p (m,), by how much a smooth cylinder turns light round itself."""
    return 2.0 * order * inner - 2.0 * np.arcsin(np.clip(across, -1.0, 1.0)) + order * np.pi


def azimuthal(hair: ChiangHair, order: int, azimuth: Floats, inner: Floats) -> Floats:
    """Return N_p (m,), a density of the azimuth: logistic, within half a turn; even for what is summed up."""
    if order == LAST:
        return np.full(len(hair), 0.5 / np.pi)
    away = azimuth - center_of(order, hair.across, inner)
    away -= 2.0 * np.pi * np.rint(away / (2.0 * np.pi))
    fall = np.exp(-np.abs(away) / hair.scale)
    return fall / (hair.scale * (1.0 + fall) ** 2 * np.tanh(np.pi / (2.0 * hair.scale)))


def sample_trimmed_logistic(scale: Floats, number: Floats) -> Floats:
    """Return azimuths (m,) within half a turn with that density, by inversion."""
    lowest = 1.0 / (1.0 + np.exp(np.pi / np.maximum(scale, np.pi / LARGEST_EXPONENT)))
    at = lowest + number * (1.0 - 2.0 * lowest)
    at = np.clip(at, np.finfo(np.float64).tiny, np.nextafter(1.0, 0.0))
    return np.clip(scale * (np.log(at) - np.log1p(-at)), -np.pi, np.pi)
