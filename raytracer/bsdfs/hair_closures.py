"""Blender's hair shaders: closures to lobes of strands.

References
----------
Blender, intern/cycles/kernel/svm/closure.h: what the sockets of the nodes mean.
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.rows import repeat_column, scale_vectors, take_rows
from raytracer.bsdfs.closures import Closures, Points
from raytracer.bsdfs.hair import find_tangents
from raytracer.bsdfs.hair_cauchy import CauchyHair, limit_width
from raytracer.bsdfs.hair_chiang import ChiangHair, find_scale, find_variance
from raytracer.bsdfs.hair_huang import HuangHair


def add_hair(closures: Closures, points: Points) -> list[ChiangHair]:
    """The Principled Hair BSDF by the model of Chiang; a coat makes its first reflection smoother."""
    normal = take_rows(points.shading.normal, points.rows)
    roughness = closures.roughness
    return [
        ChiangHair(
            hit=points.rows,
            weight=repeat_column(closures.weight),
            normal=normal,
            tangent=find_tangents(points.vectors["tangent"], normal),
            across=closures.across,
            absorption=closures.absorption,
            variance=find_variance(roughness),
            reflected_variance=find_variance((1.0 - np.minimum(closures.coat_weight, 1.0)) * roughness),
            scale=find_scale(closures.radial_roughness),
            tilt=closures.tilt,
            ior=closures.ior,
        )
    ]


def add_huang_hair(closures: Closures, points: Points) -> list[HuangHair]:
    """The Principled Hair BSDF by the model of Huang; alpha is 0 beside what is seen of an elliptic strand."""
    normal = take_rows(points.shading.normal, points.rows)
    return [
        HuangHair(
            hit=points.rows,
            weight=repeat_column(closures.weight * closures.alpha),
            normal=normal,
            tangent=find_tangents(points.vectors["tangent"], normal),
            absorption=closures.absorption,
            gains=closures.gains,
            axis=points.vectors.get("axis", np.zeros_like(normal)),
            across=closures.across,
            coverage=closures.coverage,
            roughness=closures.roughness,
            aspect=closures.aspect,
            tilt=closures.tilt,
            ior=closures.ior,
            chance=closures.chance,
        )
    ]


def add_hair_reflection(closures: Closures, points: Points) -> list[CauchyHair]:
    """The Hair BSDF's Reflection."""
    return _make_cauchy(closures, points, passes=False)


def add_hair_transmission(closures: Closures, points: Points) -> list[CauchyHair]:
    """The Hair BSDF's Transmission."""
    return _make_cauchy(closures, points, passes=True)


def _make_cauchy(closures: Closures, points: Points, passes: bool) -> list[CauchyHair]:
    normal = take_rows(points.shading.normal, points.rows)
    return [
        CauchyHair(
            hit=points.rows,
            weight=scale_vectors(closures.color, closures.weight),
            normal=normal,
            tangent=find_tangents(points.vectors["tangent"], normal),
            along=limit_width(closures.roughness),
            around=limit_width(closures.radial_roughness),
            offset=-closures.tilt,
            passes=np.full(len(points.rows), float(passes)),
        )
    ]
