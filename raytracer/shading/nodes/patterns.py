"""Textures that are computed from coordinates: Checker, Gradient, Wave, Magic, Brick, Noise and White Noise.

References
----------
Blender, intern/cycles/kernel/svm/checker.h, gradient.h, wave.h, magic.h, brick.h, noisetex.h, white_noise.h.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from raytracer.lecture import length
from raytracer.shading.nodes.arithmetic import separate
from raytracer.shading.nodes.operation import Array, Operation, divide, mix, saturate, spread, stack
from raytracer.textures.noise import FRACTALS, Fractal, fractal_sum, hash_numbers, perlin

# Whole coordinates lie on borders: textures step aside from them, by Blender's amounts.
STEP, SHRINK = 0.000001, 0.999999


def make_checker(vector: Any, first: Any, second: Any, scale: Any) -> tuple[Array, Array]:
    """The first color where the sum of the cell's whole coordinates is odd."""
    cells = np.floor((np.asarray(vector, float) * spread(scale) + STEP) * SHRINK)
    odd = np.fmod(np.abs(cells).sum(axis=-1), 2.0)
    return np.where(spread(odd) > 0, first, second), odd


def _quadratic(x: Any, y: Any, z: Any) -> Any:
    return np.maximum(x, 0.0) ** 2


def _easing(x: Any, y: Any, z: Any) -> Any:
    x = saturate(x)
    return x * x * (3.0 - 2.0 * x)


def _ball(x: Any, y: Any, z: Any) -> Any:
    return np.maximum(1.0 - STEP - np.sqrt(x * x + y * y + z * z), 0.0)


GRADIENTS: dict[str, Callable[[Any, Any, Any], Any]] = {
    "LINEAR": lambda x, y, z: x,
    "QUADRATIC": _quadratic,
    "EASING": _easing,
    "DIAGONAL": lambda x, y, z: (x + y) / 2.0,
    "RADIAL": lambda x, y, z: np.arctan2(y, x) / (2.0 * np.pi) + 0.5,
    "QUADRATIC_SPHERE": lambda x, y, z: _ball(x, y, z) ** 2,
    "SPHERICAL": _ball,
}


def make_gradient(vector: Any, *, gradient_type: str) -> tuple[Array, Array]:
    """A number from 0 to 1 that rises along, around or towards the origin."""
    value = saturate(GRADIENTS[gradient_type](*separate(vector)))
    return stack(value, value, value), value


BANDS = {"X": (20.0, 0.0, 0.0), "Y": (0.0, 20.0, 0.0), "Z": (0.0, 0.0, 20.0), "DIAGONAL": (10.0, 10.0, 10.0)}
RINGS = {"X": (0.0, 1.0, 1.0), "Y": (1.0, 0.0, 1.0), "Z": (1.0, 1.0, 0.0), "SPHERICAL": (1.0, 1.0, 1.0)}
PROFILES: dict[str, Callable[[Any], Any]] = {
    "SIN": lambda turns: 0.5 - 0.5 * np.cos(2.0 * np.pi * turns),
    "SAW": lambda turns: turns - np.floor(turns),
    "TRI": lambda turns: np.abs(turns - np.floor(turns + 0.5)) * 2.0,
}


def make_wave(
    vector: Any,
    scale: Any,
    distortion: Any,
    detail: Any,
    detail_scale: Any,
    detail_roughness: Any,
    phase: Any,
    *,
    wave_type: str,
    bands_direction: str,
    rings_direction: str,
    wave_profile: str,
) -> tuple[Array, Array]:
    """Bands or rings, bent by noise."""
    point = (np.asarray(vector, float) * spread(scale) + STEP) * SHRINK
    if wave_type == "BANDS":
        angle = (point * BANDS[bands_direction]).sum(axis=-1)
    else:
        angle = 20.0 * length(point * RINGS[rings_direction])
    angle = angle + phase
    if np.any(np.asarray(distortion) != 0):
        fractal = Fractal(detail, np.maximum(detail_roughness, 0.0), 2.0)
        angle = angle + distortion * (2.0 * _on_rows(fractal_sum, point * spread(detail_scale), fractal) - 1.0)
    value = PROFILES[wave_profile](angle / (2.0 * np.pi))
    return stack(value, value, value), value


def _on_rows(compute: Callable[[Any, Fractal], Array], points: Array, fractal: Fractal) -> Array:
    """Call a fractal with points (n, k), or a single one (k,), which may have n ways to be shaped."""
    found = compute(_repeat_point(np.atleast_2d(points), fractal), fractal)
    return found if np.ndim(points) == 2 or len(found) > 1 else found[0]


def _repeat_point(points: Array, fractal: Fractal) -> Array:
    """Return points (n, k); a single one is repeated where the fractal's numbers are n."""
    shapes = (fractal.detail, fractal.roughness, fractal.lacunarity, fractal.offset, fractal.gain)
    count = max(np.size(numbers) for numbers in shapes)
    return np.repeat(points, count, axis=0) if len(points) == 1 else points


# How Magic turns its three sines, depth by depth: component, function, sign, and the signs of x, y and z in the sum.
_MAGIC = (
    ("y", np.cos, -1, (1, -1, 1)),
    ("x", np.cos, 1, (1, -1, -1)),
    ("z", np.sin, 1, (-1, -1, -1)),
    ("x", np.cos, -1, (-1, 1, -1)),
    ("y", np.sin, -1, (-1, 1, 1)),
    ("y", np.cos, -1, (-1, 1, 1)),
    ("x", np.cos, 1, (1, 1, 1)),
    ("z", np.sin, 1, (1, 1, -1)),
    ("x", np.cos, -1, (-1, -1, 1)),
    ("y", np.sin, -1, (1, -1, 1)),
)


def make_magic(vector: Any, scale: Any, distortion: Any, *, turbulence_depth: int) -> tuple[Array, Array]:
    """Sines of sines of the coordinates."""
    x, y, z = separate(np.fmod(np.asarray(vector, float), 2.0 * np.pi) * spread(scale) * 5.0)
    waves = {"x": np.sin(x + y + z), "y": np.cos(-x + y - z), "z": -np.cos(-x - y + z)}
    strength = np.asarray(distortion, float)
    if turbulence_depth > 0:
        waves = {axis: wave * strength for axis, wave in waves.items()}
    for name, function, sign, (sx, sy, sz) in _MAGIC[: int(turbulence_depth)]:
        waves[name] = sign * function(sx * waves["x"] + sy * waves["y"] + sz * waves["z"]) * strength
    doubled = np.where(strength != 0, 2.0 * strength, 1.0)
    color = stack(*(0.5 - waves[axis] / doubled for axis in "xyz"))
    return color, color.sum(axis=-1) / 3.0


def make_bricks(
    vector: Any,
    first: Any,
    second: Any,
    mortar: Any,
    scale: Any,
    mortar_size: Any,
    mortar_smooth: Any,
    bias: Any,
    width: Any,
    height: Any,
    *,
    offset: float,
    offset_frequency: int,
    squash: float,
    squash_frequency: int,
) -> tuple[Array, Array]:
    """Rows of bricks, each of a random mixture of two colors, with mortar between them."""
    x, y, _ = separate(np.asarray(vector, float) * spread(scale))
    row = np.floor(divide(y, height))
    shift: Any = 0.0
    if squash_frequency and offset_frequency:
        width = np.where(np.fmod(row, squash_frequency) == 0, width * squash, width)
        shift = np.where(np.fmod(row, offset_frequency) == 0, width * offset, 0.0)
    brick = np.floor(divide(x + shift, width))
    x, y = x + shift - width * brick, y - height * row
    tint = saturate(_brick_noise(row, brick) + bias)
    edge = np.minimum(np.minimum(x, y), np.minimum(width - x, height - y))
    depth = 1.0 - divide(edge, mortar_size)
    smooth = np.where(np.asarray(mortar_smooth) > 0, _easing(divide(depth, mortar_smooth), 0.0, 0.0), 1.0)
    factor = np.where(edge >= mortar_size, 0.0, smooth)
    color = mix(np.asarray(first, float), np.asarray(second, float), spread(tint))
    return mix(color, np.asarray(mortar, float), spread(factor)), factor


def _brick_noise(row: Array, brick: Array) -> Array:
    """A random number for each brick, by the linear congruence and bit shuffle that Blender uses."""
    word = ((row.astype(np.int64) << 16) + (brick.astype(np.int64) & 0xFFFF)).astype(np.int64)
    number = (word + 1013) & 0x7FFFFFFF
    number = (number >> 13) ^ number
    nudged = (number * (number * number * 60493 + 19990303) + 1376312589) & 0x7FFFFFFF
    return 0.5 * (nudged / 1073741824.0)


def _place_noise(vector: Any, w: Any, scale: Any, distortion: Any, dimensions: int) -> Array:
    """Return the points (n, k) at which noise of k dimensions is read: scaled, then moved by noise."""
    rows = np.broadcast_shapes(np.shape(vector)[:-1], np.shape(w))
    point = np.concatenate([np.broadcast_to(vector, (*rows, 3)), np.broadcast_to(spread(w), (*rows, 1))], -1)
    point = np.atleast_2d(point[..., 3:] if dimensions == 1 else point[..., :dimensions]) * spread(scale)
    if np.any(np.asarray(distortion) != 0):
        moved = [perlin(point + _offset(seed, dimensions)) for seed in range(dimensions)]
        point = point + np.stack(moved, axis=-1) * spread(distortion)
    return point


def make_noise_color(
    vector: Any,
    w: Any,
    scale: Any,
    detail: Any,
    roughness: Any,
    lacunarity: Any,
    offset: Any,
    gain: Any,
    distortion: Any,
    *,
    noise_dimensions: str,
    noise_type: str,
    normalize: bool,
    parts: int = 3,
) -> Array:
    """Fractal noise of one to four coordinates; the parts of the color are the same noise in different places."""
    dimensions = int(noise_dimensions[0])
    point = _place_noise(vector, w, scale, distortion, dimensions)
    fractal = Fractal(detail, np.maximum(roughness, 0.0), lacunarity, offset, gain, normalize)
    point = _repeat_point(point, fractal)
    places = [point, *(point + _offset(dimensions + k, dimensions) for k in range(parts - 1))]
    color = np.stack([FRACTALS[noise_type](place, fractal) for place in places], axis=-1)
    return color[0] if np.ndim(vector) == 1 and len(color) == 1 else color


def make_noise(*inputs: Any, **settings: Any) -> Array:
    """The first part of `make_noise_color`."""
    return make_noise_color(*inputs, **settings, parts=1)[..., 0]


def _offset(seed: int, dimensions: int) -> Array:
    """Where noise of another seed is read: each coordinate from 100 to 200."""
    if dimensions == 1:
        return 100.0 + 100.0 * hash_numbers(seed)[np.newaxis]
    return np.array([100.0 + 100.0 * float(hash_numbers(seed, axis)) for axis in range(dimensions)])


def make_white_noise(vector: Any, w: Any, *, noise_dimensions: str) -> tuple[Array, Array]:
    """A random number and color for each distinct coordinate."""
    x, y, z = separate(vector)
    numbers = {"1D": (w,), "2D": (x, y), "3D": (x, y, z), "4D": (x, y, z, w)}[noise_dimensions]
    if noise_dimensions == "4D":
        orders = ((0, 1, 2, 3), (2, 0, 3, 1), (3, 2, 1, 0))
        parts = [hash_numbers(*(numbers[k] for k in order)) for order in orders]
    else:
        parts = [hash_numbers(*numbers), hash_numbers(*numbers, 1.0), hash_numbers(*numbers, 2.0)]
    return parts[0], stack(*parts)


_NOISE = ("Vector", "W", "Scale", "Detail", "Roughness", "Lacunarity", "Offset", "Gain", "Distortion")
_NOISE_KINDS = ("noise_dimensions", "noise_type", "normalize")
_VECTOR = {"Vector": "ATTRIBUTE Vector generated"}

OPERATIONS = {
    "TEX_CHECKER": Operation(make_checker, ("Vector", "Color1", "Color2", "Scale"), ("Color", "Fac"), links=_VECTOR),
    "TEX_GRADIENT": Operation(make_gradient, ("Vector",), ("Color", "Fac"), ("gradient_type",), links=_VECTOR),
    "TEX_WAVE": Operation(
        make_wave,
        ("Vector", "Scale", "Distortion", "Detail", "Detail Scale", "Detail Roughness", "Phase Offset"),
        ("Color", "Fac"),
        ("wave_type", "bands_direction", "rings_direction", "wave_profile"),
        links=_VECTOR,
    ),
    "TEX_MAGIC": Operation(
        make_magic, ("Vector", "Scale", "Distortion"), ("Color", "Fac"), ("turbulence_depth",), links=_VECTOR
    ),
    "TEX_BRICK": Operation(
        make_bricks,
        (
            *("Vector", "Color1", "Color2", "Mortar", "Scale"),
            *("Mortar Size", "Mortar Smooth", "Bias", "Brick Width", "Row Height"),
        ),
        ("Color", "Fac"),
        ("offset", "offset_frequency", "squash", "squash_frequency"),
        links=_VECTOR,
    ),
    "TEX_NOISE Fac": Operation(make_noise, _NOISE, ("Fac",), _NOISE_KINDS, links=_VECTOR),
    "TEX_NOISE Color": Operation(make_noise_color, _NOISE, ("Color",), _NOISE_KINDS, links=_VECTOR),
    # Unlike other textures its own vector, one place, is what an unlinked input takes.
    "TEX_WHITE_NOISE": Operation(make_white_noise, ("Vector", "W"), ("Value", "Color"), ("noise_dimensions",)),
}
