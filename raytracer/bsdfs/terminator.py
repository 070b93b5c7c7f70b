"""Where matte surfaces turn away from light: how it fades out over bumps, and over meshes coarser than they look."""

from __future__ import annotations

import numpy as np

from raytracer.arrays.types import Booleans, Floats
from raytracer.bsdfs.closures import TiltedDiffuse
from raytracer.lecture import dot

# The reciprocals of squared cosines stay finite, and so do their products.
SMALLEST_SQUARE = 2.0**-500


def fall_faster(cosine: Floats, frequency: Floats) -> Floats:
    """Return max(cos(f a), 0) / cos a (n,) for cosines of angles a; 0 at a right angle and beyond.

    References
    ----------
    Cycles, closure/bsdf.h: shift_cos_in, after Appleseed.
    """
    shifted = np.maximum(np.cos(frequency * np.arccos(np.clip(cosine, -1.0, 1.0))), 0.0)
    return np.divide(shifted, cosine, out=np.zeros_like(cosine), where=cosine > 0)


def evaluate_tilted(part: TiltedDiffuse, normal: Floats, incoming: Floats, fades: Booleans | None = None) -> Floats:
    """Return f |cos| (m, 3) of Lambertian parts with normals b of their own, for light from `incoming` i (m, 3).

    Light from behind the surface's own `normal` n (m, 3) is cut; before that it fades out as if the bumps were facets
    that shadow each other: by 2 / (1 + sqrt(1 + a^2 tan^2(n, i))) with a^2 = tan^2(n, b) / 8, at most 1. A normal at a
    right angle, as a Bevel node's may be, faces either side.

    fades : (m,) bool, False where it arrives undimmed; None where it always fades

    References
    ----------
    A. Conty Estevez, P. Lecocq, C. Stein, "A Microfacet-Based Shadowing Function to Solve the Bump Terminator
    Problem", Ray Tracing Gems, 2019; Cycles' bump_shadowing_term since Blender 5.0 (before, another fading).
    """
    across, bend = dot(normal, incoming), dot(normal, part.normal)
    roughness = np.minimum(_squared_tangent(bend) / 8.0, 1.0)
    fading = 2.0 / (1.0 + np.sqrt(1.0 + roughness * _squared_tangent(across)))
    if fades is not None:
        fading = np.where(fades, fading, 1.0)
    return part.evaluate(incoming) * np.where(across * bend >= 0, fading, 0.0)[:, np.newaxis]


def _squared_tangent(cosine: Floats) -> Floats:
    """tan^2 of angles, from their cosines (m,); a huge number at a right angle."""
    square = np.clip(cosine * cosine, SMALLEST_SQUARE, 1.0)
    return (1.0 - square) / square
