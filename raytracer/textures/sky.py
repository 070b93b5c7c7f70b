"""Clear skies: sunlight that air, haze and ozone scatter once, or many times, on its way to an observer.

Both models march along each direction and add what each step scatters of the sunlight that reaches it:
L = integral T(0, t) sigma_s(t) p(mu) T_sun(t) E dt, T the transmittance, p the phase function, E the sun's irradiance.
Skies are tables over azimuth (sun in the middle) and elevation, whose root the rows are even in; CIE XYZ.

References
----------
T. Nishita, T. Sirai, K. Tadamura, E. Nakamae, "Display of the Earth Taking into Account Atmospheric Scattering", 1993.
F. Garcia Linan, "Spectral rendering of the atmosphere with four wavelengths", fgarlin.com, 2024; S. Hillaire,
"Physically Based Sky, Atmosphere and Cloud Rendering in Frostbite", 2016: the second model.
Blender, intern/sky: the constants of both (measured spectra, fits), units and the tables' layout.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats
from raytracer.arrays.vectors import transform
from raytracer.lecture import dot
from raytracer.textures.sky_spectra import (
    AEROSOL_ABSORPTION,
    AEROSOL_SCATTERING,
    COLOR_MATCHING,
    FOUR_MATCHING,
    FOUR_SUN,
    MOLECULAR_SCATTERING,
    OZONE_ABSORPTION,
    OZONE_CROSS_SECTION,
    RAYLEIGH_SCATTERING,
    SUN_IRRADIANCE,
)

Numbers = NDArray[np.float64] | np.float64


TABLE_WIDTH, TABLE_HEIGHT = 512, 256


DEGREES_OF_FREEDOM = 8  # of the quadrature of optical depth


@dataclass(frozen=True)
class Atmosphere:
    """What a sky depends on.

    elevation : radians, of the sun; altitude : metres, of the observer; air, aerosol, ozone : densities, 1 is Earth's
    """

    elevation: float
    altitude: float
    air: float
    aerosol: float
    ozone: float


def exit_sphere(position: Floats, direction: Floats, radius: float) -> Floats:
    """Return the distance (n,) from points inside a sphere around the origin to its surface."""
    along = (position * direction).sum(axis=-1)
    return -along + np.sqrt(np.maximum(along**2 - (position**2).sum(axis=-1) + radius**2, 0.0))


def place_rays(elevation: Numbers, azimuth: Numbers) -> Floats:
    """Return unit directions (..., 3) at elevations and azimuths."""
    across = np.cos(elevation)
    parts = (across * np.cos(azimuth), across * np.sin(azimuth), np.sin(elevation))
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


# Single scattering, 21 wavelengths from 380 to 780 nm ----------------------------------------------------------------

STEP_OF_WAVELENGTH = 20.0


EARTH, TOP = 6360e3, 6420e3  # metres


RAYLEIGH_HEIGHT, MIE_HEIGHT = 8e3, 1.2e3


MIE_SCATTERING, MIE_EXTINCTION, MIE_ANISOTROPY = 2e-5, 1.11 * 2e-5, 0.76


SINGLE_STEPS = 32


# Light from this far up is lost; the last node of the quadrature stays within the atmosphere.
LAGUERRE_END = 25.0


def _list_nodes() -> tuple[Floats, Floats]:
    """Gauss-Laguerre's nodes and weights for integrals without the factor exp(-x), over a length of 1."""
    nodes, weights = np.polynomial.laguerre.laggauss(DEGREES_OF_FREEDOM)
    return nodes / LAGUERRE_END, weights * np.exp(nodes) / LAGUERRE_END


def _measure_densities(position: Floats) -> Floats:
    """(..., 3) of air, haze and ozone, relative to the ground's (ozone: its highest)."""
    height = np.sqrt((position**2).sum(axis=-1)) - EARTH
    ozone = np.maximum(0.0, 1.0 - np.abs(height - 25000.0) / 15000.0)
    return np.stack([np.exp(-height / RAYLEIGH_HEIGHT), np.exp(-height / MIE_HEIGHT), ozone], axis=-1)


def _measure_depth(position: Floats, direction: Floats) -> Floats:
    """(..., 3) the integrals of the densities to the top of the atmosphere, metres."""
    reach = exit_sphere(position, direction, TOP)[..., np.newaxis]
    total = np.zeros(position.shape)
    for node, weight in zip(*_list_nodes(), strict=True):
        total += weight * _measure_densities(position + node * reach * direction)
    return total * reach


def _extinguish(depth: Floats) -> Floats:
    """(..., 21) the share of light left after optical depths (..., 3)."""
    air, aerosol, ozone = np.moveaxis(depth[..., np.newaxis], -2, 0)
    return np.exp(-(air * RAYLEIGH_SCATTERING + aerosol * MIE_EXTINCTION + ozone * OZONE_ABSORPTION))


def _scatter_once(directions: Floats, sun: Floats, atmosphere: Atmosphere) -> Floats:
    """Return the radiance (n, 21) from directions (n, 3)."""
    origin = np.array([0.0, 0.0, EARTH + np.clip(atmosphere.altitude, 1.0, 59999.0)])
    densities = np.array([atmosphere.air, atmosphere.aerosol, atmosphere.ozone])
    step = exit_sphere(origin, directions, TOP)[:, np.newaxis] / SINGLE_STEPS
    cosine, g = dot(directions, sun), MIE_ANISOTROPY
    rayleigh = 3.0 / (16.0 * np.pi) * (1.0 + cosine**2)
    mie = (
        3.0
        * (1.0 - g * g)
        * (1.0 + cosine**2)
        / (8.0 * np.pi * (2.0 + g * g) * (1.0 + g * g - 2.0 * g * cosine) ** 1.5)
    )
    depth, total = np.zeros((len(directions), 3)), np.zeros((len(directions), 21))
    for number in range(SINGLE_STEPS):
        position = origin + (number + 0.5) * step * directions
        density = densities * _measure_densities(position)
        depth += step * density
        scattered = rayleigh[:, np.newaxis] * density[:, :1] * RAYLEIGH_SCATTERING
        scattered += (mie * density[:, 1] * MIE_SCATTERING)[:, np.newaxis]
        sunlit = _sees_sun(position, sun)[:, np.newaxis]
        total += sunlit * _extinguish(depth + densities * _measure_depth(position, sun)) * scattered * step
    return total * SUN_IRRADIANCE


def _sees_sun(position: Floats, sun: Floats) -> NDArray[np.bool_]:
    along = dot(position, sun)
    return (sun[2] >= 0) | (along**2 - (position**2).sum(axis=-1) + EARTH**2 < 0)


# How fast a sky of single scattering fades below the horizon: to nothing 0.4 below it, by the cube of what is left.
FADE = 2.5


def fade_below(sine: Numbers) -> Floats:
    """Return the share that is left of the horizon's light at an elevation below it, of the given sine: (1 + 5/2 z)^3,
    from z = -2/5 on nothing."""
    left: Floats = np.maximum(1.0 + FADE * np.minimum(sine, 0.0), 0.0)
    return left**3


@lru_cache(maxsize=4)
def tabulate_single(atmosphere: Atmosphere, half: bool = False) -> Floats:
    """Return the sky of single scattering as XYZ, (h, w, 3), below the horizon what is left of the horizon's light.

    half : True for the table of Blender before 5.0: its rows reach half a row past the zenith, and what it has below
        the horizon does not fade, which is left to who reads it
    """
    middle = TABLE_HEIGHT // 2
    sun = place_rays(np.float64(atmosphere.elevation), np.float64(0.0))
    zenith = np.pi / 2 * (1.0 + half * 0.5 / middle)
    azimuth = 2.0 * np.pi / TABLE_WIDTH * np.arange(TABLE_WIDTH // 2) - np.pi
    table = np.zeros((TABLE_HEIGHT, TABLE_WIDTH // 2, 3))
    for row, angle in enumerate(zenith * (np.arange(middle) / middle) ** 2, start=middle):
        directions = place_rays(angle, azimuth)
        table[row] = transform(COLOR_MATCHING.T, _scatter_once(directions, sun, atmosphere)) * STEP_OF_WAVELENGTH
    below = -np.pi / 2 * (np.arange(middle) / middle - 1.0) ** 2
    left = np.ones(middle) if half else fade_below(np.sin(below))
    table[:middle] = left[:, np.newaxis, np.newaxis] * table[middle]
    return np.concatenate([table, table[:, ::-1]], axis=1)


def find_single_sun(atmosphere: Atmosphere, elevation: float, solid_angle: float) -> Floats:
    """Return the radiance of the sun's disc at an elevation as XYZ (3,)."""
    origin = np.array([0.0, 0.0, EARTH + np.clip(atmosphere.altitude, 1.0, 59999.0)])
    direction = place_rays(np.float64(max(elevation, 0.0)), np.float64(0.0))
    depth = _measure_depth(origin, direction) * (atmosphere.air, atmosphere.aerosol, 0.0)
    return transform(COLOR_MATCHING.T, SUN_IRRADIANCE * _extinguish(depth) / solid_angle) * STEP_OF_WAVELENGTH


# Multiple scattering, 4 wavelengths ----------------------------------------------------------------------------------

GLOBE, THICKNESS = 6371.0, 100.0  # kilometres


HAZE_ANISOTROPY, GROUND_ALBEDO = 0.8, 0.3


MARCHED_STEPS = 64


SUN_COLUMNS, SUN_ROWS = 256, 64


# A fit of the light that comes from other points of the atmosphere.
ELSEWHERE = 0.02 * np.array([0.217, 0.347, 0.594, 1.0])


# Per kilometre, as in the model: keeps (1 - exp(-e s)) / e defined in empty air. The longest way through the shell has
# 2 sqrt(2 GLOBE THICKNESS) = 2260 km, over which so little takes 0.02% of the light at most.
SMALLEST_EXTINCTION = 1e-7


# Kilometres, as in the model: keeps the logarithm of a height defined. The fit's ozone below it is exp(-840), nothing.
LOWEST_HEIGHT = 1e-4


def _measure_coefficients(height: Numbers, atmosphere: Atmosphere) -> tuple[Floats, Floats, Floats]:
    """(..., 4) scattering of air and of haze, and the extinction, per kilometre, at heights in kilometres."""
    log = np.log(np.maximum(height, LOWEST_HEIGHT))
    air = np.exp(-0.07771971 * height**1.16364243)
    ozone = 3.78547397e20 * np.exp(-((log - 3.22261) ** 2) * 5.55555555 - log)
    haze = 1.3681e20 * np.exp(-height / 0.73) + 2e6
    molecules = (atmosphere.air * air)[..., np.newaxis] * MOLECULAR_SCATTERING
    haze = (atmosphere.aerosol * haze)[..., np.newaxis]
    absorbed = (atmosphere.ozone * ozone)[..., np.newaxis] * OZONE_CROSS_SECTION * 334.5
    extinction = molecules + absorbed + haze * (AEROSOL_SCATTERING + AEROSOL_ABSORPTION)
    return molecules, haze * AEROSOL_SCATTERING, extinction


def _transmit(cosine: Numbers, height: Numbers, atmosphere: Atmosphere) -> Floats:
    """(..., 4) the share of sunlight that comes down to a height, under the cosine of the sun's zenith angle."""
    radius = GLOBE + height
    sine = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
    along, top = radius * cosine, GLOBE + THICKNESS
    step = (-along + np.sqrt(np.maximum(along**2 - radius**2 + top**2, 0.0))) / MARCHED_STEPS
    depth = np.zeros((*np.broadcast_shapes(cosine.shape, height.shape), 4))
    for number in range(MARCHED_STEPS):
        t = (number + 0.5) * step
        at = np.maximum(np.hypot(t * sine, radius + t * cosine) - GLOBE, 0.0)
        depth += step[..., np.newaxis] * _measure_coefficients(at, atmosphere)[2]
    return np.exp(-depth)


def _look_up(table: Floats, cosine: Floats, share: Floats) -> Floats:
    """Interpolate `_transmit`'s table (rows of height, columns of cosine)."""
    x = np.clip(cosine * 0.5 + 0.5, 0.0, 1.0) * (SUN_COLUMNS - 1)
    y = np.clip(share, 0.0, 1.0) * (SUN_ROWS - 1)
    column, row = x.astype(np.int64), y.astype(np.int64)
    right, up = np.minimum(column + 1, SUN_COLUMNS - 1), np.minimum(row + 1, SUN_ROWS - 1)
    across, above = (x - column)[..., np.newaxis], (y - row)[..., np.newaxis]
    low = table[row, column] + across * (table[row, right] - table[row, column])
    high = table[up, column] + across * (table[up, right] - table[up, column])
    return low + above * (high - low)


def _scatter_often(directions: Floats, sun: Floats, table: Floats, atmosphere: Atmosphere) -> Floats:
    """Return the radiance (n, 4) from directions (n, 3), to the ground or to space."""
    origin = np.array([0.0, 0.0, GLOBE + np.clip(atmosphere.altitude, 1.0, 99999.0) / 1000.0])
    along = dot(directions, origin)
    square = along**2 - origin[2] ** 2 + GLOBE**2
    ground = -along - np.sqrt(np.maximum(square, 0.0))
    reach = np.where((square >= 0) & (along < 0), ground, exit_sphere(origin, directions, GLOBE + THICKNESS))
    step = reach / MARCHED_STEPS
    cosine, g = dot(directions, sun), HAZE_ANISOTROPY
    by_air = (3.0 / (16.0 * np.pi) * (1.0 + cosine**2))[:, np.newaxis]
    by_haze = ((1.0 - g * g) / (4.0 * np.pi * (1.0 + g * g - 2.0 * g * cosine) ** 1.5))[:, np.newaxis]
    total, left = np.zeros((len(directions), 4)), np.ones((len(directions), 4))
    for number in range(MARCHED_STEPS):
        position = origin + ((number + 0.5) * step)[:, np.newaxis] * directions
        radius = np.sqrt((position**2).sum(axis=1))
        height, zenith = np.maximum(radius - GLOBE, 0.0), dot(position, sun) / radius
        air, haze, extinction = _measure_coefficients(height, atmosphere)
        direct = _look_up(table, zenith, height / THICKNESS)
        around = _scatter_around(table, zenith, height / THICKNESS, radius)
        source = FOUR_SUN * (air * (by_air * direct + around) + haze * (by_haze * direct + around))
        kept = np.exp(-step[:, np.newaxis] * extinction)
        total += left * source * (1.0 - kept) / np.maximum(extinction, SMALLEST_EXTINCTION)
        left *= kept
    return total


def _scatter_around(table: Floats, zenith: Floats, share: Floats, radius: Floats) -> Floats:
    """(n, 4) light scattered before: by the ground, and by the rest of the atmosphere."""
    solid_angle = 2.0 * np.pi * (1.0 - np.sqrt(np.maximum(1.0 - (GLOBE / radius) ** 2, 0.0)))
    one, zero = np.ones_like(share), np.zeros_like(share)
    up = _look_up(table, one, zero) / _look_up(table, one, share)
    bounced = (solid_angle / (4.0 * np.pi) * GROUND_ALBEDO / np.pi * zenith)[:, np.newaxis]
    elsewhere = ELSEWHERE / (1.0 + 5.0 * np.exp(-17.92 * zenith))[:, np.newaxis]
    return elsewhere + bounced * _look_up(table, zenith, zero) * up


@lru_cache(maxsize=4)
def tabulate_multiple(atmosphere: Atmosphere) -> Floats:
    """Return the sky of multiple scattering, and the ground, as XYZ (h, w, 3)."""
    cosine = 2.0 * np.arange(SUN_COLUMNS) / (SUN_COLUMNS - 1) - 1.0
    height = THICKNESS * np.arange(SUN_ROWS)[:, np.newaxis] / (SUN_ROWS - 1)
    sunlight = _transmit(cosine, height, atmosphere)
    sun = place_rays(np.float64(atmosphere.elevation), np.float64(np.pi))
    level = 2.0 * (np.arange(TABLE_HEIGHT) + 0.5) / TABLE_HEIGHT - 1.0
    azimuth = 2.0 * np.pi * (np.arange(TABLE_WIDTH // 2) + 0.5) / TABLE_WIDTH
    table = np.zeros((TABLE_HEIGHT, TABLE_WIDTH // 2, 3))
    for row, angle in enumerate(np.copysign(level**2, level) * np.pi / 2):
        table[row] = transform(FOUR_MATCHING.T, _scatter_often(place_rays(angle, azimuth), sun, sunlight, atmosphere))
    return np.concatenate([table, table[:, ::-1]], axis=1)


def find_multiple_sun(atmosphere: Atmosphere, elevation: float, solid_angle: float) -> Floats:
    """Return the radiance of the sun's disc at an elevation as XYZ (3,)."""
    height = np.float64(np.clip(atmosphere.altitude, 1.0, 99999.0) / 1000.0)
    left = _transmit(np.float64(np.sin(elevation)), height, atmosphere)
    return transform(FOUR_MATCHING.T, FOUR_SUN * left / solid_angle)
