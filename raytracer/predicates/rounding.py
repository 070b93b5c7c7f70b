"""Rounding: the unit roundoff, Higham's bound on n rounded operations, and the precisions of a caster.

References
----------
N. J. Higham, "Accuracy and Stability of Numerical Algorithms", 2nd edition, 2002, chapter 3.
"""

from __future__ import annotations

PRECISIONS = ("certified", "float64", "float32")


UNIT_ROUNDOFF = 2.0**-53


def gamma(n: int, unit_roundoff: float = UNIT_ROUNDOFF) -> float:
    """Return n u / (1 - n u), the relative error of n roundings in sequence (Higham 2002, lemma 3.1)."""
    return n * unit_roundoff / (1 - n * unit_roundoff)
