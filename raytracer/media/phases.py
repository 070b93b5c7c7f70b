"""Phase functions: how media turn the light that they scatter.

Each is a density over directions that depends on the cosine c to the way that the light went, rotates around it, and is
sampled exactly: by the inverse of its distribution in c, in closed form or by bisection. Numbers are those of n points.

    henyey_greenstein   (1 - g^2) / (4 pi (1 + g^2 - 2 g c)^(3/2))
    rayleigh            3 (1 + c^2) / (16 pi)
    draine              henyey_greenstein (1 + a c^2) / (1 + a (1 + 2 g^2) / 3)
    fournier_forand     of spheres of all sizes, of an index of refraction and a share of light thrown back
    mie                 of water drops of a diameter: (1 - w) henyey_greenstein + w draine

References
----------
L. Henyey, J. Greenstein, "Diffuse radiation in the Galaxy", 1941.
B. Draine, "Scattering by Interstellar Dust Grains in the Optical and Ultraviolet", 2003.
G. Fournier, M. Jonasz, "Computer-based underwater imaging analysis", 1999: the density, its distribution.
J. Jendersie, E. d'Eon, "An Approximate Mie Scattering Function for Fog and Cloud Rendering", SIGGRAPH 2023 Talks, and
    its supplement: the mixture for drops.
Blender, intern/cycles/kernel/closure/volume_util.h: limits of the parameters.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats
from raytracer.arrays.vectors import normalize, to_world

HENYEY_GREENSTEIN, RAYLEIGH, DRAINE, FOURNIER_FORAND = range(4)
# Below this mean cosine light goes all ways alike, as Cycles has it; the distribution of Draine's would lose digits.
SMALLEST_ANISOTROPY = 1e-3
# Of Fournier and Forand, as in Cycles: the least index of refraction, and the largest share thrown back.
SMALLEST_IOR, LARGEST_BACKSCATTER = 1.001, 0.499
# Their formula is 0 / 0 where delta is 1; closer than this the mean of what is left and right of it stands in.
NEAR_ONE = 1e-4
# Steps of a bisection down to the last place of float64.
BISECTIONS = 54


def evaluate_henyey_greenstein(anisotropy: Floats, cosine: Floats) -> Floats:
    """Return Henyey and Greenstein's density (k,) per solid angle, (1 - g^2) / (4 pi (1 + g^2 - 2 g c)^(3/2))."""
    g = anisotropy
    base = np.maximum(1.0 + g * g - 2.0 * g * cosine, (1.0 - np.abs(g)) ** 2)
    return (1.0 - g * g) / (4.0 * np.pi * base * np.sqrt(base))


def sample_henyey_greenstein(anisotropy: Floats, number: Floats) -> Floats:
    """Return cosines (k,) of Henyey and Greenstein's density, by inversion: (1 + g^2 - ((1 - g^2) / (1 - g + 2 g u))^2)
    / 2 g, and 1 - 2 u without g."""
    g = np.where(anisotropy == 0, 1.0, anisotropy)
    root = (1.0 - g * g) / np.where(anisotropy == 0, 1.0, 1.0 - g + 2.0 * g * number)
    bent = (1.0 + g * g - root * root) / (2.0 * g)
    return np.clip(np.where(anisotropy == 0, 1.0 - 2.0 * number, bent), -1.0, 1.0)


def lift_cosine(cosine: Floats, number: Floats) -> Floats:
    """Return unit vectors (k, 3) at `cosine` (k,) to the z axis, turned around it by `number` (k,) rounds."""
    sine, angle = np.sqrt(np.maximum(1.0 - cosine * cosine, 0.0)), 2.0 * np.pi * number
    return np.stack([sine * np.cos(angle), sine * np.sin(angle), cosine], axis=1)


def turn_directions(direction: Floats, cosine: Floats, number: Floats) -> Floats:
    """Return unit directions (k, 3) at `cosine` (k,) to others (k, 3), turned around these by `number` (k,) rounds."""
    return normalize(to_world(lift_cosine(cosine, number), direction))


def evaluate_phase(kind: NDArray[np.int8], first: Floats, second: Floats, cosine: Floats) -> Floats:
    """Return the densities (n,) of phase functions.

    kind : (n,) HENYEY_GREENSTEIN and so on
    first, second : (n,) their parameters: g; g and a of Draine's; index of refraction and share thrown back
    cosine : (n,)
    """
    density = np.zeros(len(kind))
    for number, evaluate in EVALUATED.items():
        rows = np.flatnonzero(kind == number)
        if len(rows):
            density[rows] = evaluate(first[rows], second[rows], cosine[rows])
    return density


def sample_phase(kind: NDArray[np.int8], first: Floats, second: Floats, number: Floats) -> Floats:
    """Return cosines (n,) of those densities, for uniform numbers (n,); arguments as of `evaluate_phase`."""
    cosine = np.zeros(len(kind))
    for which, sample in SAMPLED.items():
        rows = np.flatnonzero(kind == which)
        if len(rows):
            cosine[rows] = sample(first[rows], second[rows], number[rows])
    return cosine


def _evaluate_rayleigh(first: Floats, second: Floats, cosine: Floats) -> Floats:
    return 3.0 / (16.0 * np.pi) * (1.0 + cosine * cosine)


def _sample_rayleigh(first: Floats, second: Floats, number: Floats) -> Floats:
    """c^3 + 3 c = 8 u - 4 =: 2 q is solved by c = r - 1 / r, r^3 = q + sqrt(q^2 + 1), of the sign of q."""
    half = np.abs(4.0 * number - 2.0)
    root = np.cbrt(half + np.sqrt(half * half + 1.0))
    return np.clip(np.copysign(root - 1.0 / root, 4.0 * number - 2.0), -1.0, 1.0)


def _evaluate_draine(anisotropy: Floats, alpha: Floats, cosine: Floats) -> Floats:
    g = np.where(np.abs(anisotropy) < SMALLEST_ANISOTROPY, 0.0, anisotropy)
    shape = (1.0 + alpha * cosine * cosine) / (1.0 + alpha * (1.0 + 2.0 * g * g) / 3.0)
    return evaluate_henyey_greenstein(g, cosine) * shape


def _sample_draine(anisotropy: Floats, alpha: Floats, number: Floats) -> Floats:
    """With s^2 = 1 + g^2 - 2 g c the distribution is, but for a constant, (A / s + B s - C s^3) / g with
    A = 1 + a (1 + g^2)^2 / 4 g^2, B = a (1 + g^2) / 2 g^2, C = a / 12 g^2; without g it is c + a c^3 / 3."""
    even = np.abs(anisotropy) < SMALLEST_ANISOTROPY
    g = np.where(even, 1.0, anisotropy)
    square, around = g * g, 1.0 + g * g
    a, b, c = 1.0 + alpha * around**2 / (4.0 * square), alpha * around / (2.0 * square), alpha / (12.0 * square)

    def distribute(cosine: Floats) -> Floats:
        s = np.sqrt(np.maximum(around - 2.0 * g * cosine, 0.0))
        s = np.where(s > 0, s, 1.0)
        return np.where(even, cosine + alpha * cosine**3 / 3.0, (a / s + b * s - c * s**3) / g)

    low, high = distribute(np.full(len(g), -1.0)), distribute(np.ones(len(g)))
    return 2.0 * bisect(lambda x: distribute(2.0 * x - 1.0), low + number * (high - low)) - 1.0


def bisect(rising: Callable[[Floats], Floats], value: Floats) -> Floats:
    """Return where in [0, 1] a rising function takes values (n,)."""
    low, high = np.zeros(len(value)), np.ones(len(value))
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        below = rising(middle) < value
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return 0.5 * (low + high)


def _find_exponents(ior: Floats, backscatter: Floats) -> tuple[Floats, Floats, Floats]:
    """Return 4 / (3 (n - 1)^2), the exponent v that throws the share B back, and the last term's factor.

    v = -log(2 B (d - 1) + 1) / log d, at delta's value d for a right angle; ((d180^-v) - 1) / (d180 - 1).
    """
    steepness = 4.0 / (3.0 * (np.maximum(ior, SMALLEST_IOR) - 1.0) ** 2)
    right = 0.5 * steepness
    exponent = -np.log(2.0 * np.minimum(backscatter, LARGEST_BACKSCATTER) * (right - 1.0) + 1.0) / np.log(right)
    return steepness, exponent, (steepness**-exponent - 1.0) / (steepness - 1.0)


def _keep_off(delta: Floats) -> Floats:
    return np.where(np.abs(1.0 - delta) < NEAR_ONE, 1.0 + np.copysign(NEAR_ONE, delta - 1.0), delta)


def _evaluate_fournier_forand(ior: Floats, backscatter: Floats, cosine: Floats) -> Floats:
    """With x = sin^2(angle / 2), d = 4 x / (3 (n - 1)^2), p = d^v, density 4 pi (1 - d)^2 p times
    v (1 - d) - (1 - p) + (d (1 - p) - v (1 - d)) / x, and the last term (3 c^2 - 1) / 16 pi."""
    steepness, v, factor = _find_exponents(ior, backscatter)
    x = np.maximum(0.5 * (1.0 - cosine), np.finfo(np.float64).eps)
    delta = _keep_off(steepness * x)
    x = delta / steepness
    power, off = delta**v, 1.0 - delta
    density = v * off - (1.0 - power) + (delta * (1.0 - power) - v * off) / x
    density /= 4.0 * np.pi * off * off * power
    return np.maximum(density + factor * (3.0 * cosine * cosine - 1.0) / (16.0 * np.pi), 0.0)


def _sample_fournier_forand(ior: Floats, backscatter: Floats, number: Floats) -> Floats:
    """Light turned by less than an angle has the share (1 - d p - (1 - p) x) / ((1 - d) p) + k c (1 - c^2) / 8.

    Most goes nearly straight: x = t^4 is found by its root t.
    """
    steepness, v, factor = _find_exponents(ior, backscatter)

    def distribute(root: Floats) -> Floats:
        x = np.maximum(root**4, np.finfo(np.float64).tiny)
        delta = _keep_off(steepness * x)
        x = delta / steepness
        power, cosine = delta**v, 1.0 - 2.0 * x
        share = (1.0 - power * delta - (1.0 - power) * x) / ((1.0 - delta) * power)
        return share + factor * cosine * (1.0 - cosine * cosine) / 8.0

    return 1.0 - 2.0 * bisect(distribute, number) ** 4


def fit_drops(diameter: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return what mixes the phase function of water drops of diameters (n,) in micrometres: g of Henyey and
    Greenstein's, g and a of Draine's, and the share of the latter; Jendersie and d'Eon, equations 7 to 22."""
    d = np.maximum(diameter, 0.0)
    parts = (_fit_tiny(np.minimum(d, 0.1)), _fit_small(np.clip(d, 0.1, 1.5)), _fit_middle(np.clip(d, 1.5, 5.0)))
    last = _fit_large(np.maximum(d, 5.0))
    chosen = [d <= 0.1, d < 1.5, d < 5.0]
    first, second, alpha, share = (
        np.select(chosen, [part[column] for part in parts], last[column]) for column in range(4)
    )
    return first, second, alpha, np.clip(share, 0.0, 1.0)


def _fit_tiny(d: Floats) -> tuple[Floats, ...]:
    return 13.8 * d * d, 1.1456 * d * np.sin(9.29044 * d), np.full_like(d, 250.0), 0.252977 - 312.983 * d**4.3


def _fit_small(d: Floats) -> tuple[Floats, ...]:
    log = np.log(d)
    inner = (log - 0.238604) * (log + 1.00667) / (0.507522 - 0.15677 * log)
    angle = 1.19692 * np.cos(inner) + 1.37932 * log + 0.0625835
    share = 0.146209 * np.cos(3.38707 * log + 2.11193) + 0.316072 + 0.0778917 * log
    return 0.862 - 0.143 * log * log, 0.379685 * np.cos(angle) + 0.344213, np.full_like(d, 250.0), share


def _fit_middle(d: Floats) -> tuple[Floats, ...]:
    log = np.log(d)
    twice = np.log(log)
    g = 0.500411 - 0.081287 / (np.tan(log) - 2.0 * log + 1.27551)
    share = 0.026914 * (log - np.cos(5.68947 * (twice - 0.0292149))) + 0.3764
    return 0.0604931 * twice + 0.940256, g, 7.30354 * log + 6.31675, share


def _fit_large(d: Floats) -> tuple[Floats, ...]:
    return (
        np.exp(-0.0990567 / (d - 1.67154)),
        np.exp(-2.20679 / (d + 3.91029) - 0.428934),
        np.exp(3.62489 - 8.29288 / (d + 5.52825)),
        np.exp(-0.599085 / (d - 0.641583) - 0.665888),
    )


Function = Callable[[Floats, Floats, Floats], Floats]

EVALUATED: dict[int, Function] = {
    HENYEY_GREENSTEIN: lambda first, second, cosine: evaluate_henyey_greenstein(first, cosine),
    RAYLEIGH: _evaluate_rayleigh,
    DRAINE: _evaluate_draine,
    FOURNIER_FORAND: _evaluate_fournier_forand,
}
SAMPLED: dict[int, Function] = {
    HENYEY_GREENSTEIN: lambda first, second, number: sample_henyey_greenstein(first, number),
    RAYLEIGH: _sample_rayleigh,
    DRAINE: _sample_draine,
    FOURNIER_FORAND: _sample_fournier_forand,
}
