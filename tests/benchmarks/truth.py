"""What is true of a set of rays, by the exact oracle, and how far an answer is from it.

Of every ray: does it hit, which primitives are exactly first (an edge or a vertex has several), and at which t. Nothing
in here rounds before it is compared: distances are split into the nearest float64 and the rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from tests.oracle import exact_oracle
from tests.oracle.exact_numbers import Surd, is_within, round_to_float

# Binary digits of the root when an irrational distance is split: far beyond the 106 of two float64.
ROOT_BITS = 200
# One number for (ray, primitive): any primitive that fits into 32 bits keeps its key apart from other rays'.
STRIDE = 1 << 32


@dataclass(frozen=True, eq=False)
class Truth:
    """The truth about n rays.

    exact : list of Fraction, Surd or None (a miss)
    index : (n,) int64, the lowest of the primitives that are first, -1 = miss
    first : (k,) int64, sorted: ray * STRIDE + primitive for every primitive that is first
    nearest, rest : (n,) float64, exact t = nearest + rest to 106 bits; NaN for a miss
    """

    exact: list
    index: np.ndarray
    first: np.ndarray
    nearest: np.ndarray
    rest: np.ndarray

    def __len__(self):
        return len(self.index)

    def is_first(self, primitive):
        """(n,) bool: is each ray's primitive one of those it hits first?"""
        return (primitive >= 0) & np.isin(np.arange(len(primitive)) * STRIDE + primitive, self.first)


def find_truth(origins, directions, corners=None, centres=None, radii=None):
    """Ask the exact oracle about rays (n, 3) and triangles (t, 3, 3), spheres (s, 3), (s,)."""
    hits = exact_oracle.closest_hit(origins, directions, corners, centres, radii)
    return make_truth(hits.distance, hits.tied)


def make_truth(exact, tied):
    """Return the Truth of exact distances (Fraction, Surd, None) and tuples of first primitives, per ray."""
    count = np.array([len(indices) for indices in tied], dtype=np.int64)
    members = np.array([index for indices in tied for index in indices], dtype=np.int64)
    split = np.array([split_distance(t) for t in exact]).reshape(-1, 2)
    index = np.array([indices[0] if indices else -1 for indices in tied], dtype=np.int64)
    first = np.repeat(np.arange(len(tied)), count) * STRIDE + members
    return Truth(exact, index, first, *split.T)


def split_distance(exact):
    """Return (nearest float64, float64 of the rest) of a Fraction or Surd; NaN for None."""
    if exact is None:
        return np.nan, np.nan
    nearest = round_to_float(exact)
    value = sum(exact.enclose(ROOT_BITS)) / 2 if isinstance(exact, Surd) else exact
    return nearest, float(value - Fraction(nearest))


def measure_ulps(truth, rays, t):
    """Return |t - exact| in units of the last place of the exact t's float64, for `rays` that truly hit."""
    nearest = truth.nearest[rays]
    return np.abs((t - nearest) - truth.rest[rays]) / np.spacing(nearest)


def tally(truth, answer, lowest_index=False):
    """Compare an Answer to the first k rays with the truth; return counts and errors.

    Returns
    -------
    dict with rays, false_misses, false_hits, wrong_primitives (both hit, but a primitive that is not first; with
    `lowest_index`: not the lowest of the first ones), dt_median, dt_p99, dt_max (ulps of float64, over rays that name
    a first primitive and do not start on it, as 0 has no last place), bound_violations (None where nothing is
    promised), bound_median, bound_p99 (ulps, of the promised bounds). A statistic of no values is None.
    """
    count = len(answer.t)
    truth_hit, hit = truth.index[:count] >= 0, answer.primitive >= 0
    both = truth_hit & hit
    first = truth.is_first(answer.primitive)
    right = answer.primitive == truth.index[:count] if lowest_index else first
    rays = np.flatnonzero(both & first)
    measured = rays[truth.nearest[rays] != 0]
    numbers = {
        "rays": count,
        "false_misses": int((truth_hit & ~hit).sum()),
        "false_hits": int((~truth_hit & hit).sum()),
        "wrong_primitives": int((both & ~right).sum()),
    }
    numbers |= summarise("dt", measure_ulps(truth, measured, answer.t[measured]), ("median", "p99", "max"))
    return numbers | tally_bounds(truth, answer, rays)


def tally_bounds(truth, answer, rays):
    """Count promised bounds that do not hold, exactly, and measure how wide they are."""
    if answer.t_error is None:
        return {"bound_violations": None, "bound_median": None, "bound_p99": None}
    broken = sum(not holds(answer.t[ray], answer.t_error[ray], truth.exact[ray]) for ray in rays)
    measured = rays[truth.nearest[rays] != 0]
    widths = answer.t_error[measured] / np.spacing(truth.nearest[measured])
    return {"bound_violations": broken} | summarise("bound", widths, ("median", "p99"))


def holds(t, bound, exact):
    """Decide |t - exact| <= bound exactly; an infinite or NaN number bounds nothing."""
    return bool(np.isfinite(t) and np.isfinite(bound)) and is_within(t, bound, exact)


def summarise(name, values, statistics):
    """Return name_median, name_p99, name_max of values, those asked for; None where there are no values.

    NaN is as bad as infinity; the percentile is a value that occurs, so that infinity needs no interpolation.
    """
    compute = {"median": np.median, "p99": lambda array: np.percentile(array, 99, method="higher"), "max": np.max}
    values = np.where(np.isnan(values), np.inf, values)
    return {f"{name}_{key}": float(compute[key](values)) if len(values) else None for key in statistics}


def count_failures(row):
    """All wrong answers of a row."""
    return row["false_misses"] + row["false_hits"] + row["wrong_primitives"]


def bound_rate(failures, rays):
    """Failures per million, and a bound on the true rate where none was seen: 3 / n with 95% confidence.

    With rate p, no failure in n rays has probability (1 - p)^n <= exp(-p n), which is 5% at p = 3.0 / n ("rule of
    three").
    """
    return {
        "failures_per_million": 1e6 * failures / rays if rays else None,
        "rate_bound_per_million": 3e6 / rays if rays and not failures else None,
    }
