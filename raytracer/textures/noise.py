"""Perlin's gradient noise in one to four dimensions, and the fractals that are built from it.

Points are (n, k) float64 arrays of k coordinates. Lattice points are hashed with Jenkins' lookup3, as Blender does, so
that the noise is Blender's own.

References
----------
K. Perlin, "Improving Noise", SIGGRAPH 2002.
F. K. Musgrave, "Procedural Fractal Terrains", in D. Ebert et al., "Texturing and Modeling", 3rd edition, 2003.
R. J. Jenkins, "lookup3.c, for hash table lookup", 2006, public domain.
Blender, intern/cycles/kernel/svm/noise.h, fractal_noise.h: choice of gradients, scales and the order of octaves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from raytracer.arrays.rows import pick_columns
from raytracer.arrays.types import Floats, Words

# The noise repeats after so many cells, in Blender, where float32 would run out of digits.
PERIOD = 100000.0


# What brings noise of 1, 2, 3 and 4 dimensions to the range from -1 to 1 (found by experiment for OSL).
SCALES = (0.2500, 0.6616, 0.9820, 0.8344)


LARGEST_WORD = float(2**32 - 1)


# A hybrid multifractal stops where its weight falls below this.
SMALLEST_WEIGHT = 0.001


MOST_DETAIL = 15.0


# lookup3's final steps: by how many bits to rotate, which word to change, and by which.
FINISH = ((14, 2, 1), (11, 0, 2), (25, 1, 0), (16, 2, 1), (4, 0, 2), (14, 1, 0), (24, 2, 1))


def _rotate(words: Words, bits: int) -> Words:
    return (words << np.uint32(bits)) | (words >> np.uint32(32 - bits))


def _finish(a: Words, b: Words, c: Words) -> Words:
    """lookup3's final mixing of three words."""
    words = [a, b, c]
    for rotation, to, by in FINISH:
        words[to] = (words[to] ^ words[by]) - _rotate(words[by], rotation)
    return words[2]


def _churn(a: Words, b: Words, c: Words) -> tuple[Words, Words, Words]:
    """lookup3's mixing of three words before more come."""
    for rotation in (4, 6, 8, 16, 19, 4):
        a = (a - c) ^ _rotate(c, rotation)
        c = c + b
        a, b, c = b, c, a  # the roles move on: next b is mixed by a, then c by b
    return a, b, c


def hash_words(*words: Any) -> Words:
    """Hash one to four unsigned 32-bit words, arrays that broadcast, into one."""
    values = [np.asarray(word).astype(np.uint32) for word in words]
    start = np.uint32((0xDEADBEEF + 4 * len(values) + 13) & 0xFFFFFFFF)
    with np.errstate(over="ignore"):
        a, b, c = (np.atleast_1d(value) + start for value in (*values, *[np.zeros((), np.uint32)] * 2)[:3])
        if len(values) == 4:
            a, b, c = _churn(a, b, c)
            a = a + values[3]
        return _finish(a, b, c).reshape(np.broadcast_shapes(*(value.shape for value in values)))


def hash_numbers(*numbers: Any) -> Floats:
    """Hash one to four numbers, by their bits as float32, to the range from 0 to 1."""
    words = [np.asarray(number, dtype=np.float32) + np.float32(0.0) for number in numbers]
    hashed = hash_words(*(np.asarray(word).view(np.uint32) for word in words))
    return hashed.astype(np.float64) / LARGEST_WORD


# Which of the offsets' components (rows: those that are added up) the low bits of a hash (columns) choose.
CHOSEN = {
    2: np.repeat([[0, 1], [1, 0]], 4, axis=1),
    3: np.array([[0] * 8 + [1] * 8, [1] * 4 + [2] * 8 + [0, 2, 0, 2]]),
    4: np.repeat([[0, 0, 0, 1], [1, 1, 2, 2], [2, 3, 3, 3]], 8, axis=1),
}


def _gradient(word: Words, offset: Floats) -> Floats:
    """The dot product of the lattice point's gradient, chosen by its hash (n,), with the offset (k, n) from it.

    Its components are chosen by index, and negated by their sign's bit: no processor foresees a hash, and `where` takes
    five to twenty times as long for what it does not foresee.
    """
    if len(offset) == 1:
        return _negate((1 + (word & np.uint32(7))) * offset[0], word, 3)
    chosen = CHOSEN[len(offset)]
    low = word & np.uint32(chosen.shape[1] - 1)
    parts = [pick_columns(offset.T, component.take(low)) for component in chosen]
    if len(offset) == 2:
        parts[1] *= 2.0
    return sum(_negate(part, word, bit) for bit, part in enumerate(parts))  # type: ignore[return-value]


def _negate(values: Floats, word: Words, bit: int) -> Floats:
    """Return values (n,), negated where a bit of a word (n,) is set."""
    sign = (word & np.uint32(1 << bit)).astype(np.int64) << np.int64(63 - bit)
    return (values.view(np.int64) ^ sign).view(np.float64)


def perlin(points: Floats) -> Floats:
    """Gradient noise (n,) of about -1 to 1 at points (n, k): gradients at the 2^k corners of the cell, blended by the
    polynomial 6 t^5 - 15 t^4 + 10 t^3 along each axis."""
    columns = np.ascontiguousarray(points.T)
    if not np.abs(columns).max(initial=0.0) < PERIOD:
        columns = np.fmod(columns, PERIOD)
    cells = np.floor(columns)
    inside = columns - cells
    fade = inside**3 * (inside * (inside * 6.0 - 15.0) + 10.0)
    lattice = cells.astype(np.int64)
    # Of the two ends of the cell along each axis: their words, and the way from there.
    words = [((lattice + step) & 0xFFFFFFFF).astype(np.uint32) for step in (0, 1)]
    ways = [inside - step for step in (0, 1)]
    values: list[Floats] = []
    axes = range(len(columns))
    for corner in range(2 ** len(columns)):
        steps = [(corner >> axis) & 1 for axis in axes]
        offset = np.stack([ways[step][axis] for axis, step in enumerate(steps)])
        values.append(_gradient(hash_words(*(words[step][axis] for axis, step in enumerate(steps))), offset))
    for axis in axes:  # corners that differ in the first axis are neighbours
        values = [low + (high - low) * fade[axis] for low, high in zip(values[::2], values[1::2], strict=True)]
    return SCALES[len(columns) - 1] * values[0]


@dataclass(frozen=True, eq=False)
class Fractal:
    """What shapes a fractal.

    detail : octaves after the first, 0 to 15, the last one in part; roughness : weight of an octave over the last's
    lacunarity : frequency of an octave over the last's; offset, gain : of some kinds. Numbers or (n,) float64
    normalize : True brings the sum to 0 to 1
    """

    detail: Any
    roughness: Any
    lacunarity: Any
    offset: Any = 0.0
    gain: Any = 1.0
    normalize: bool = True


def _octaves(points: Floats, fractal: Fractal) -> Iterator[tuple[Floats, Floats]]:
    """Yield the noise of each octave (n,) and its share (n,): 1, a broken part for the last, 0 beyond the detail."""
    detail = np.broadcast_to(np.clip(fractal.detail, 0.0, MOST_DETAIL), len(points))
    whole = np.floor(detail)
    scale = np.ones(len(points))
    for octave in range(int(np.ceil(detail.max(initial=0.0))) + 1):
        share = np.where(octave <= whole, 1.0, np.where(octave == whole + 1, detail - whole, 0.0))
        yield perlin(points * scale[:, np.newaxis]), share
        scale = scale * fractal.lacunarity


def fractal_sum(points: Floats, fractal: Fractal) -> Floats:
    """Fractal Brownian motion: octaves with falling weights, brought to 0 to 1 where it shall be normalized."""
    total = weight = np.zeros(len(points))
    last = total
    amplitude = np.ones(len(points))
    for noise, share in _octaves(points, fractal):
        more, heavier = total + noise * amplitude, weight + amplitude
        fraction = (share > 0) & (share < 1)
        low, high = (total, more) if not fractal.normalize else (_unit(total, weight), _unit(more, heavier))
        last = np.where(fraction, low + (high - low) * share, np.where(share == 1, high, last))
        total, weight = np.where(share == 1, more, total), np.where(share == 1, heavier, weight)
        amplitude = amplitude * fractal.roughness
    return last


def _unit(total: Floats, weight: Floats) -> Floats:
    return 0.5 * np.divide(total, weight, out=np.zeros_like(total), where=weight != 0) + 0.5


def multifractal(points: Floats, fractal: Fractal) -> Floats:
    """The product of octaves."""
    value, power = np.ones(len(points)), np.ones(len(points))
    for noise, share in _octaves(points, fractal):
        value = value * (share * power * noise + 1.0)
        power = power * fractal.roughness
    return value


def hetero_terrain(points: Floats, fractal: Fractal) -> Floats:
    """Octaves that weigh more where the terrain is high already."""
    value, power = np.zeros(len(points)), fractal.roughness
    for octave, (noise, share) in enumerate(_octaves(points, fractal)):
        if octave == 0:
            value = fractal.offset + noise
            continue
        value = value + share * (noise + fractal.offset) * power * value
        power = power * fractal.roughness
    return value


def hybrid_multifractal(points: Floats, fractal: Fractal) -> Floats:
    """Octaves weighed by the product of those before."""
    value, power, weight = np.zeros(len(points)), np.ones(len(points)), np.ones(len(points))
    for noise, share in _octaves(points, fractal):
        alive = weight > SMALLEST_WEIGHT
        weight = np.minimum(weight, 1.0)
        signal = (noise + fractal.offset) * power
        value = value + np.where(alive, share * weight * signal, 0.0)
        weight = np.where(alive, weight * fractal.gain * signal, 0.0)
        power = power * fractal.roughness
    return value


def ridged_multifractal(points: Floats, fractal: Fractal) -> Floats:
    """Ridges where the noise is 0; whole octaves only."""
    value, power, signal = np.zeros(len(points)), fractal.roughness, np.zeros(len(points))
    for octave, (noise, share) in enumerate(_octaves(points, fractal)):
        ridge = (fractal.offset - np.abs(noise)) ** 2
        if octave == 0:
            value = signal = ridge
            continue
        signal = ridge * np.clip(signal * fractal.gain, 0.0, 1.0)
        value = value + np.where(share == 1, signal * power, 0.0)
        power = power * fractal.roughness
    return value


FRACTALS: dict[str, Callable[[Floats, Fractal], Floats]] = {
    "FBM": fractal_sum,
    "MULTIFRACTAL": multifractal,
    "HETERO_TERRAIN": hetero_terrain,
    "HYBRID_MULTIFRACTAL": hybrid_multifractal,
    "RIDGED_MULTIFRACTAL": ridged_multifractal,
}
