"""Matrices between steps of time: rotations turn, what is left is linear, as Cycles has it.

A matrix' linear part M is R S, the nearest rotation R (or rotation and reflection, which goes to S) and a stretch S.
Between two steps R turns about one axis, evenly and the shorter way (slerp), S and the translation change linearly. So
a wheel stays round, and the origin of an object goes straight on.

References
----------
K. Shoemake, T. Duff, "Matrix Animation and Polar Decomposition", Graphics Interface 1992.
K. Shoemake, "Animating Rotation with Quaternion Curves", SIGGRAPH 1985.
Blender, intern/cycles/util/transform.cpp (transform_motion_decompose), util/transform.h
(transform_motion_array_interpolate).
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.types import Booleans, Floats
from raytracer.predicates.rounding import UNIT_ROUNDOFF

# Newton's iteration doubles its correct digits; what has not settled so late is singular, or about.
MOST_ITERATIONS = 100
# Of a rotation's entries, below which two iterations are the same but for rounding.
SETTLED = 8 * UNIT_ROUNDOFF


def find_step(time: float, steps: int) -> tuple[int, float]:
    """Return the step before a time, and how far it is to the next one, 0 to 1."""
    place = time * (steps - 1)
    step = min(int(place), steps - 2)
    return step, place - step


def interpolate(first: Floats, second: Floats, share: float) -> Floats:
    """Return a + share (b - a), float64, rounded after each operation; a itself where b is the same, b where share = 1.

    What stands still between two steps keeps its bits.
    """
    return second if share == 1.0 else first + share * (second - first)


def interpolate_matrices(steps: Floats, time: float) -> Floats:
    """Return affine matrices (k, 4, 4) at a time, 0 to 1, of (steps, k, 4, 4): at a step, and where a matrix stays the
    same, those themselves.

    Where a matrix squeezes everything flat there is no rotation to be told, and all its entries change linearly.
    """
    step, share = find_step(time, len(steps))
    first, second = steps[step], steps[step + 1]
    found = interpolate(first, second, share)
    moves = (first[:, :3, :3] != second[:, :3, :3]).any(axis=(1, 2))
    if share in (0.0, 1.0) or not moves.any():
        return found
    rotations, turnable = split_rotations(np.stack([first[moves, :3, :3], second[moves, :3, :3]]))
    stretches = multiply(np.swapaxes(rotations, -1, -2), np.stack([first[moves, :3, :3], second[moves, :3, :3]]))
    turned = to_matrices(slerp(to_quaternions(rotations[0]), to_quaternions(rotations[1]), share))
    rows = np.flatnonzero(moves)[turnable]
    found[rows, :3, :3] = multiply(turned, interpolate(stretches[0], stretches[1], share))[turnable]
    return found


def split_rotations(matrices: Floats) -> tuple[Floats, Booleans]:
    """Return the rotations (2, k, 3, 3) nearest to matrices, and (k,) True where both of a pair have one.

    Newton's iteration for the polar decomposition, R <- (R + R^-T) / 2. Of a mirrored matrix R is -R: a rotation.
    """
    rotations = matrices.copy()
    with np.errstate(all="ignore"):  # singular ones come to nothing, and are told by that
        for _ in range(MOST_ITERATIONS):
            following = 0.5 * (rotations + invert_transposed(rotations))
            change = np.abs(following - rotations).max(axis=(-1, -2))
            rotations = following
            if not (change > SETTLED).any():
                break
        determinant = find_determinants(rotations)
        is_rotation = np.abs(np.abs(determinant) - 1.0) < np.sqrt(UNIT_ROUNDOFF)
    turnable: Booleans = is_rotation.all(axis=0)
    rotations *= np.sign(determinant)[..., np.newaxis, np.newaxis]
    rotations[:, ~turnable] = np.eye(3)
    return rotations, turnable


def find_determinants(matrices: Floats) -> Floats:
    """Return the determinants (...) of (..., 3, 3)."""
    return (matrices[..., 0, :] * find_cofactors(matrices)[..., 0, :]).sum(axis=-1)


def invert_transposed(matrices: Floats) -> Floats:
    """Return the transposed inverses (..., 3, 3): the cofactors over the determinant."""
    return find_cofactors(matrices) / find_determinants(matrices)[..., np.newaxis, np.newaxis]


def find_cofactors(matrices: Floats) -> Floats:
    """Return the cofactors (..., 3, 3): each row is the cross product of the two others."""
    rows = [matrices[..., row, :] for row in range(3)]
    return np.stack([np.cross(rows[(row + 1) % 3], rows[(row + 2) % 3]) for row in range(3)], axis=-2)


def multiply(first: Floats, second: Floats) -> Floats:
    """Return the products (..., 3, 3) of matrices, without BLAS, whose rounding is its processor's own."""
    columns: list[Floats] = [first[..., :, inner, np.newaxis] * second[..., inner, np.newaxis, :] for inner in range(3)]
    return (columns[0] + columns[1]) + columns[2]


def to_quaternions(rotations: Floats) -> Floats:
    """Return unit quaternions (k, 4), x, y, z, w, of rotations (k, 3, 3): by the largest of their four squares.

    The squares are 4 x^2 = 1 + m00 - m11 - m22 and so on, 4 w^2 = 1 + m00 + m11 + m22.
    """
    m = rotations
    sums = [m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]]
    xy, yz, zx = m[:, 0, 1] + m[:, 1, 0], m[:, 1, 2] + m[:, 2, 1], m[:, 2, 0] + m[:, 0, 2]
    x, y, z = (m[:, axis, axis] for axis in range(3))
    # Row j is the quaternion times 4 of its j-th component.
    products = np.array(
        [
            [1.0 + x - y - z, xy, zx, sums[0]],
            [xy, 1.0 + y - x - z, yz, sums[1]],
            [zx, yz, 1.0 + z - x - y, sums[2]],
            [sums[0], sums[1], sums[2], 1.0 + x + y + z],
        ]
    )  # (4, 4, k)
    largest = np.argmax(products[range(4), range(4)], axis=0)
    found = products[largest, :, np.arange(len(m))]  # (k, 4)
    return found / np.sqrt((found * found).sum(axis=1, keepdims=True))


def slerp(first: Floats, second: Floats, share: float) -> Floats:
    """Return unit quaternions (k, 4) on the shorter way from one to another: cos(share a) p + sin(share a) q, where a
    is the angle between them and q the part of the second that is perpendicular to the first, of length 1."""
    cosine = (first * second).sum(axis=1, keepdims=True)
    second, cosine = np.where(cosine < 0.0, -second, second), np.abs(cosine)
    beside = second - first * cosine
    sine = np.sqrt((beside * beside).sum(axis=1, keepdims=True))
    beside = np.divide(beside, sine, out=np.zeros_like(beside), where=sine > 0.0)
    angle = share * np.arctan2(sine, cosine)
    return first * np.cos(angle) + beside * np.sin(angle)


def to_matrices(quaternions: Floats) -> Floats:
    """Return the rotations (k, 3, 3) of unit quaternions (k, 4)."""
    x, y, z, w = quaternions.T
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)
