"""What the closures of volumes absorb, scatter and emit, and the phase functions that they mix.

References
----------
Blender, intern/cycles/kernel/svm/closure.h.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from raytracer.arrays.rows import mean_column, take_rows
from raytracer.arrays.types import Floats
from raytracer.media.mixtures import Mixture, make_nothing
from raytracer.media.phases import DRAINE, FOURNIER_FORAND, HENYEY_GREENSTEIN, RAYLEIGH, fit_drops
from raytracer.scene.media import MEDIUM_COLORS, MEDIUM_LIGHTS, MEDIUM_RANGES, Volume, VolumeClosure
from raytracer.scene.programs import Register
from raytracer.shading.nodes.blackbody import find_blackbody_color

# Cycles' radiance of a black body at 1 K: Stefan and Boltzmann's constant, W / (m^2 K^4), over pi, times 1e-6.
BLACKBODY_RADIANCE = 5.670373e-8 * 1e-6 / np.pi


def list_lobes(volume: Volume) -> list[tuple[int, int]]:
    """Return (closure, part) of each lobe of a volume; drops have two."""
    found = []
    for number, closure in enumerate(volume.closures):
        if closure.kind in SCATTERING:
            found += [(number, 0), (number, 1)] if _phase_of(closure) == "mie" else [(number, 0)]
    return found


def _phase_of(closure: VolumeClosure) -> str:
    return "henyey_greenstein" if closure.kind == "principled" else closure.phase


def mix_closures(volume: Volume, values: Mapping[Register, Any], count: int, columns: int) -> Mixture:
    """Return the sums (n,) of a volume's closures, without the object's factor; values : of its registers."""
    whole, column = make_nothing(count, columns), 0
    for closure in volume.closures:
        read = _make_reader(closure, values, count)
        parts = MEASURED[closure.kind](read)
        weight = read("weight")[:, np.newaxis]
        absorption, scattering, emission = (weight * part for part in parts)
        whole.extinction[:] += absorption + scattering
        whole.scattering[:] += scattering
        whole.emission[:] += emission
        if closure.kind in SCATTERING:
            for kind, first, second, share in _describe_phase(_phase_of(closure), read):
                whole.lobes.kind[:, column] = kind
                whole.lobes.first[:, column], whole.lobes.second[:, column] = first, second
                whole.lobes.weight[:, column] = scattering * share
                column += 1
    return whole


Read = Callable[[str], Floats]


def _make_reader(closure: VolumeClosure, values: Mapping[Register, Any], count: int) -> Read:
    """Return what gives a closure's parameters as (n,) or (n, 3), cut to their ranges; what is not finite is 0."""

    def read(name: str) -> Floats:
        value = getattr(closure, name)
        found = np.asarray(values[value] if isinstance(value, Register) else value, dtype=np.float64)
        is_color = name in MEDIUM_COLORS or name in MEDIUM_LIGHTS
        if is_color and found.shape in ((), (count,)) and found.shape != (3,):
            found = found[..., np.newaxis]
        elif not is_color and found.ndim and found.shape[-1] == 3 and found.shape != (count,):
            found = mean_column(found.reshape(-1, 3))
        found = np.broadcast_to(found, (count, 3) if is_color else (count,))
        if isinstance(value, Register):
            low, high = MEDIUM_RANGES.get(name, (-np.inf if name in MEDIUM_LIGHTS else 0.0, np.inf))
            found = np.clip(np.nan_to_num(found, nan=0.0, posinf=0.0, neginf=0.0), low, high)
        return found

    return read


Parts = tuple[Floats, Floats, Floats]


def _measure_absorption(read: Read) -> Parts:
    absorption = read("density")[:, np.newaxis] * np.maximum(1.0 - read("color"), 0.0)
    return absorption, np.zeros_like(absorption), np.zeros_like(absorption)


def _measure_scatter(read: Read) -> Parts:
    scattering = read("density")[:, np.newaxis] * read("color")
    return np.zeros_like(scattering), scattering, np.zeros_like(scattering)


def _measure_principled(read: Read) -> Parts:
    density, color = read("density")[:, np.newaxis], read("color")
    absorption = np.maximum(1.0 - color, 0.0) * np.maximum(1.0 - np.sqrt(read("absorption_color")), 0.0)
    return density * absorption, density * color, read("emission") + _glow(read)


def _glow(read: Read) -> Floats:
    """Return what a black body adds, (n, 3): 1 + b (T^4 - 1) times the radiance at 1 K, where b is above 0."""
    share, temperature = read("blackbody"), read("temperature")
    rows = np.flatnonzero(share > 0)
    light = np.zeros((len(share), 3))
    if len(rows):
        intensity = BLACKBODY_RADIANCE * (1.0 + share[rows] * (temperature[rows] ** 4 - 1.0))
        color = find_blackbody_color(temperature[rows]) * take_rows(read("blackbody_tint"), rows)
        light[rows] = np.maximum(intensity, 0.0)[:, np.newaxis] * color
    return light


def _measure_coefficients(read: Read) -> Parts:
    return read("absorption"), read("scattering"), read("emission")


def _measure_emission(read: Read) -> Parts:
    emission = read("emission")
    return np.zeros_like(emission), np.zeros_like(emission), emission


# What closures of each kind absorb, scatter and emit, and those that scatter.
MEASURED: dict[str, Callable[[Read], Parts]] = {
    "absorption": _measure_absorption,
    "scatter": _measure_scatter,
    "principled": _measure_principled,
    "coefficients": _measure_coefficients,
    "emission": _measure_emission,
}
SCATTERING = ("scatter", "principled", "coefficients")

Share = float | Floats


def _describe_phase(phase: str, read: Read) -> list[tuple[int, Share, Share, Share]]:
    """Return kind, parameters and share of each lobe of a closure."""
    if phase == "rayleigh":
        return [(RAYLEIGH, 0.0, 0.0, 1.0)]
    if phase == "draine":
        return [(DRAINE, read("anisotropy"), read("alpha"), 1.0)]
    if phase == "fournier_forand":
        return [(FOURNIER_FORAND, read("ior"), read("backscatter"), 1.0)]
    if phase == "mie":
        first, second, alpha, share = fit_drops(read("diameter"))
        share = share[:, np.newaxis]
        return [(HENYEY_GREENSTEIN, first, 0.0, 1.0 - share), (DRAINE, second, alpha, share)]
    return [(HENYEY_GREENSTEIN, read("anisotropy"), 0.0, 1.0)]
