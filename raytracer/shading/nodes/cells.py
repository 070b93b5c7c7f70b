"""Textures of what is scattered over the cells of a lattice: Voronoi and Gabor.

References
----------
Blender, intern/cycles/kernel/svm/voronoi.h, gabor.h.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from raytracer.arrays.vectors import normalize as normalize_rows
from raytracer.shading.nodes.arithmetic import separate
from raytracer.shading.nodes.operation import Array, Operation, divide, saturate, spread
from raytracer.textures.gabor import Waves, sum_waves
from raytracer.textures.voronoi import Cells, sum_octaves
from raytracer.textures.voronoi_edges import find_sphere, sum_edges

VORONOI_FEATURES = ("F1", "F2", "SMOOTH_F1", "DISTANCE_TO_EDGE", "N_SPHERE_RADIUS")
LOWEST_FREQUENCY = 0.001


def make_voronoi(
    vector: Any,
    w: Any,
    scale: Any,
    detail: Any,
    roughness: Any,
    lacunarity: Any,
    smoothness: Any,
    exponent: Any,
    randomness: Any,
    *,
    feature: str,
    distance: str,
    normalize: bool,
    voronoi_dimensions: str,
    whole: bool,
) -> tuple[Array, ...]:
    """What scattered points are asked for: of the nearest, second nearest or a smooth mixture the distance, its cell's
    color, and where it is (place and w); the distance to the cell's edge; or the radius of the largest sphere."""
    inputs = (*separate(vector), w, scale, detail, roughness, lacunarity, smoothness, exponent, randomness)
    numbers = np.broadcast_arrays(*inputs)
    x, y, z, w, scale, detail, roughness, lacunarity, smoothness, exponent, randomness = map(np.atleast_1d, numbers)
    axes = {"1D": (3,), "2D": (0, 1), "3D": (0, 1, 2), "4D": (0, 1, 2, 3)}[voronoi_dimensions]
    points = (np.stack([x, y, z, w], axis=1) * spread(scale))[:, axes]
    smooth = saturate(smoothness) / 2.0 if feature == "SMOOTH_F1" else None
    cells = Cells(saturate(randomness), exponent, distance, feature == "F2", whole, smooth)
    octaves = detail, saturate(roughness), lacunarity, normalize
    length_, radius, color, place = np.zeros(len(points)), np.zeros(len(points)), np.zeros((1, 3)), np.zeros((1, 4))
    if feature == "DISTANCE_TO_EDGE":
        length_ = sum_edges(points, cells, *octaves)
    elif feature == "N_SPHERE_RADIUS":
        radius = find_sphere(points, cells)
    else:
        length_, color, found = sum_octaves(points, cells, *octaves)
        place = np.zeros((len(points), 4))
        place[:, axes] = divide(found, spread(scale))
    return tuple(_shape_rows(a, numbers[0].shape) for a in (length_, color, place[:, :3], place[:, 3], radius))


def _shape_rows(values: Array, shape: tuple[int, ...]) -> Array:
    """Return values of one row for each point, or of one for all, as one for each point, or as a single one."""
    return np.broadcast_to(values, (int(np.prod(shape)), *values.shape[1:])).reshape((*shape, *values.shape[1:]))


def make_gabor(
    vector: Any,
    scale: Any,
    frequency: Any,
    anisotropy: Any,
    orientation: Any,
    direction: Any,
    *,
    gabor_type: str,
) -> tuple[Array, ...]:
    """Waves of one frequency that come and go: their value from 0 to 1, their phase as a share of a turn, and how
    strong they are."""
    axes = 2 if gabor_type == "2D" else 3
    points = np.asarray(vector, float) * spread(scale)
    shape = np.broadcast_shapes(
        points.shape[:-1], *map(np.shape, (frequency, anisotropy, orientation)), np.shape(direction)[:-1]
    )
    count = int(np.prod(shape))
    frequency, anisotropy, orientation = (
        np.broadcast_to(number, shape).reshape(count) for number in (frequency, anisotropy, orientation)
    )
    direction = np.broadcast_to(direction, (*shape, 3)).reshape(count, 3)
    along = orientation if axes == 2 else normalize_rows(direction)
    waves = Waves(np.maximum(frequency, LOWEST_FREQUENCY), 1.0 - saturate(anisotropy), along)
    sine, cosine = sum_waves(np.broadcast_to(points, (*shape, 3)).reshape(count, 3)[:, :axes], waves)
    found = (sine * 0.5 + 0.5, np.arctan2(sine, cosine) / (2.0 * np.pi) + 0.5, np.hypot(sine, cosine))
    return tuple(values.reshape(shape) for values in found)


_VECTOR = {"Vector": "ATTRIBUTE Vector generated"}

OPERATIONS = {
    "TEX_VORONOI": Operation(
        make_voronoi,
        ("Vector", "W", "Scale", "Detail", "Roughness", "Lacunarity", "Smoothness", "Exponent", "Randomness"),
        ("Distance", "Color", "Position", "W", "Radius"),
        ("feature", "distance", "normalize", "voronoi_dimensions", "whole"),
        links=_VECTOR,
        choices={"feature": VORONOI_FEATURES},
    ),
    "TEX_GABOR": Operation(
        make_gabor,
        ("Vector", "Scale", "Frequency", "Anisotropy", "Orientation 2D", "Orientation 3D"),
        ("Value", "Phase", "Intensity"),
        ("gabor_type",),
        links=_VECTOR,
        choices={"gabor_type": ("2D", "3D")},
    ),
}
