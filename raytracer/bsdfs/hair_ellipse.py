"""Cross sections of strands: ellipses, and the directions in their planes.

A strand runs along y; across it an ellipse x = sin g, z = b cos g is met at the angle g, with its longer half axis, 1,
along x. What it is not for b = 1, a circle, is how g and the azimuth of the ellipse's normal differ: tan phi = b tan g.
Seen from a direction, the ellipse reaches from -r to r, with r^2 = 1 - (1 - b^2) sin^2 phi.

References
----------
W. Huang, M. B. Hullin, J. Hanika, "A Microfacet-based Hair Scattering Model", Computer Graphics Forum 41(4), 2022.
Blender, intern/cycles/kernel/closure/bsdf_principled_hair_huang.h.
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.rows import join_columns
from raytracer.arrays.types import Floats


def find_azimuth(angle: Floats, aspect: Floats) -> Floats:
    """Return phi (n,) of the normal at angles (n,), or of a chord in the circle that the ellipse is squeezed from."""
    return np.arctan2(aspect * np.sin(angle), np.cos(angle))


def measure_azimuth(direction: Floats) -> Floats:
    """Return phi (n,) of directions (n, 3)."""
    return np.arctan2(direction[:, 0], direction[:, 2])


def measure_cosine(direction: Floats) -> Floats:
    """Return cos theta (n,), how far directions (n, 3) lie across the strand."""
    return np.hypot(direction[:, 0], direction[:, 2])


def find_normals(angle: Floats, aspect: Floats, tilt: Floats) -> tuple[Floats, Floats]:
    """Return unit normals (n, 3) at angles (n,), and those that lean by a tilt (n,) along the strand."""
    x, z = aspect * np.sin(angle), np.cos(angle)
    size, cosine = np.hypot(x, z), np.cos(tilt)
    x, z = x / size, z / size
    return join_columns(x, np.zeros_like(x), z), join_columns(x * cosine, np.sin(tilt), z * cosine)


def measure_radius(azimuth: Floats, aspect: Floats) -> Floats:
    """Return r (n,), half the width that an ellipse is seen with from azimuths (n,)."""
    return np.sqrt(1.0 - (1.0 - aspect**2) * np.sin(azimuth) ** 2)


def measure_chord(first: Floats, second: Floats, aspect: Floats) -> Floats:
    """Return the distance (n,) between the points at two angles: 2 |sin((g - g') / 2)| of the circle, of which the part
    along z is squeezed."""
    half, middle = (first - second) / 2.0, (first + second) / 2.0
    return 2.0 * np.abs(np.sin(half)) * np.hypot(np.cos(middle), aspect * np.sin(middle))


def meet_ellipse(turn: Floats, azimuth: Floats, aspect: Floats) -> Floats:
    """Return the angle (n,) at which the ellipse is met from azimuths (n,), h = r sin(turn) across its width.

    As in Blender, h grows towards falling angles.
    """
    return find_azimuth(azimuth, aspect) - turn


def cross_ellipse(angle: Floats, direction: Floats, aspect: Floats) -> tuple[Floats, Floats]:
    """Return the angle (n,) of the normal that looks inwards where a ray leaves the ellipse, and the length (n,) of its
    way, seen along the strand.

    angle : (n,) of the normal that looks outwards where it comes from; direction : (n, 3) of the ray, inwards
    """
    inwards = 2.0 * find_azimuth(measure_azimuth(direction), aspect) - angle
    return inwards, measure_chord(angle, inwards + np.pi, aspect)
