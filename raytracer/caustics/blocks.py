"""Systems of linear equations of chains: matrices of 2 x 2 blocks, of which only those next to the diagonal are not 0.

    before_i x_(i-1) + own_i x_i + after_i x_(i+1) = y_i,    i = 0 .. k - 1

Elimination from the first row to the last leaves the pivots P_0 = own_0, P_i = own_i - before_i P_(i-1)^-1 after_(i-1);
all of it is done for n systems at once, row by row of NumPy's arrays.

References
----------
W. Jakob, S. Marschner, "Manifold Exploration", SIGGRAPH 2012: the systems that chains of specular points lead to.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from raytracer.arrays.types import Booleans, Floats

# A determinant this small beside the products that it is the difference of has lost half of its digits.
SINGULAR = 2.0**-26


@dataclass(frozen=True, eq=False)
class Blocks:
    """The matrices of n systems of k rows: k blocks (n, 2, 2) each; the first of `before` and the last of `after` are
    not read."""

    before: Sequence[Floats]
    own: Sequence[Floats]
    after: Sequence[Floats]


def join_block(a: Floats, b: Floats, c: Floats, d: Floats) -> Floats:
    """Return the blocks ((a, b), (c, d)) of numbers (n,): (n, 2, 2)."""
    return np.stack([a, b, c, d], axis=-1).reshape(-1, 2, 2)


def multiply(block: Floats, other: Floats) -> Floats:
    """Return the products (n, 2, 2) or (n, 2) of blocks (n, 2, 2) with blocks or with pairs."""
    pairs = other.ndim == 2
    columns: Floats = other[:, :, np.newaxis] if pairs else other
    terms: list[Floats] = [block[:, :, k : k + 1] * columns[:, k : k + 1] for k in range(2)]
    product = terms[0] + terms[1]
    return product[:, :, 0] if pairs else product


def determinant(block: Floats) -> Floats:
    """Return the determinants (n,) of blocks."""
    found: Floats = block[:, 0, 0] * block[:, 1, 1] - block[:, 0, 1] * block[:, 1, 0]
    return found


def invert(block: Floats) -> tuple[Floats, Booleans]:
    """Return the inverses (n, 2, 2) of blocks and where they have one (n,); 0 where not."""
    found = determinant(block)
    size = np.abs(block[:, 0, 0] * block[:, 1, 1]) + np.abs(block[:, 0, 1] * block[:, 1, 0])
    regular = np.abs(found) > SINGULAR * size
    adjugate = join_block(block[:, 1, 1], -block[:, 0, 1], -block[:, 1, 0], block[:, 0, 0])
    share = np.divide(1.0, found, out=np.zeros_like(found), where=regular)
    return adjugate * share[:, np.newaxis, np.newaxis], regular


def _invert_pivots(blocks: Blocks) -> tuple[list[Floats], Booleans]:
    """Return the inverses of the pivots, k of (n, 2, 2), and where all have one (n,)."""
    inverses: list[Floats] = []
    solvable = np.ones(len(blocks.own[0]), dtype=np.bool_)
    for number, own in enumerate(blocks.own):
        pivot = own
        if number:
            pivot = own - multiply(blocks.before[number], multiply(inverses[-1], blocks.after[number - 1]))
        inverse, regular = invert(pivot)
        solvable &= regular
        inverses.append(inverse)
    return inverses, solvable


def solve(blocks: Blocks, values: Sequence[Floats]) -> tuple[list[Floats], Booleans]:
    """Return the solutions x of n systems, k pairs (n, 2), and which of the systems have one (n,).

    values : the right sides y, k pairs (n, 2) or blocks (n, 2, 2)
    """
    inverses, solvable = _invert_pivots(blocks)
    left = [values[0]]
    for number in range(1, len(values)):
        left.append(values[number] - multiply(blocks.before[number], multiply(inverses[number - 1], left[-1])))
    solution = [multiply(inverses[-1], left[-1])]
    for number in range(len(values) - 2, -1, -1):
        rest = left[number] - multiply(blocks.after[number], solution[0])
        solution.insert(0, multiply(inverses[number], rest))
    return solution, solvable
