"""How wrong a picture is, told from itself.

A pixel's samples form two independent replications (`sampling.sobol`), whose means A and B scatter around the truth
like the errors a and b of A and B. Weighed by their numbers of samples m and n, their mean has the error
e = (m a + n b) / (m + n), and

    d = (A - B) sqrt(m n) / (m + n)

is as large: where m = n, or the variance of a mean falls as one over its number of samples, E d^2 = E e^2. So d^2 is an
unbiased estimate of the squared error, whatever distribution the samples have. Alone it says little of a pixel, for it
has one degree of freedom; over a picture it says much.

With m = n it is e^2 - d^2 = a b, of which the mean is 0 and the variance, over independent pixels, 4 sum v^2, with
v = E d^2. So the ratio of the true to the estimated square is that of two independent chi-squares of
nu = (sum v)^2 / sum v^2 degrees of freedom each (F. E. Satterthwaite), an F distribution, which gives the
interval. Since v^2 is unknown, d^4 / 3 stands for it, as of normal numbers: with heavier tails that is more, and the
interval wider.

What no sample has met, nothing can tell. The interval's upper end allows for one more pixel as noisy as the noisiest;
and where a few pixels hold most of the noise, others like them may have been missed, which is said beside the number.

Few pixels are not always told by d^2. Where the two means of a pixel have met a bright light equally often, d is 0.
How the samples of a pixel scatter around their mean does not forget that they are few: s^2 / n, of n samples of the
variance s^2, is the squared error that they would have were they independent, and more than what sequences have. So
the pixels that hold most of it count as well; and where they are few, the interval reaches as far as its sum says.

Of light that samples might have met and have not, in reflections (`unmet`) or straight (`missed`), an error is added at
the interval's upper end.

References
----------
F. E. Satterthwaite, "An Approximate Distribution of Estimates of Variance Components", 1946.
B. L. Welch, "The Generalization of 'Student's' Problem when Several Different Population Variances are Involved", 1947.
E. B. Wilson, M. M. Hilferty, "The Distribution of Chi-Square", 1931.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from raytracer.arrays.types import Counts, Floats
from raytracer.film.pixel_parts import Parts, Spread, Tally, keep_largest, mean_without, sum_squares, tally_parts

# The confidence of intervals, 95%, as a two-sided quantile of the normal distribution.
QUANTILE = 1.959964
# E d^4 / (E d^2)^2 of normal numbers.
NORMAL_KURTOSIS = 3.0
# The share of the pixels that `error_p99` leaves out, the noisiest ones.
NOISIEST = 0.01
# Where so few pixels hold so much of the noise, chance decides whether there are any: the user is told.
FEW = 50
MOST_NOISE = 0.9
# Weights of a pixel and its neighbors, in each direction, where they share what they know of their noise.
NEIGHBORS = np.array([1.0, 2.0, 1.0]) / 4.0


@dataclass(frozen=True)
class PictureError:
    """How wrong a picture is.

    error : root mean square error, over all pixels and color channels, divided by the mean level of the picture
    interval : (low, high) of 95% confidence, of the error of this very picture
    error_p99 : the same of the pixels without the noisiest 1%
    few : number of pixels that hold 90% of the noise (of the mean square error), 0 where they are more than FEW
    worst : (x, y) of the noisiest pixel, counted from the lower left corner of the full picture
    is_unmet : True where light that no sample has met can be most of the error
    is_one_draw : True where all pixels take the same points of lights, and can all be wrong together
    is_missed : True where light in sight that no sample has met is most of the error
    """

    error: float = np.inf
    interval: tuple[float, float] = (0.0, np.inf)
    error_p99: float = np.inf
    few: int = 0
    worst: tuple[int, int] = (0, 0)
    is_unmet: bool = False
    is_one_draw: bool = False
    is_missed: bool = False

    @property
    def note(self) -> str:
        """Words where the estimate rests on few pixels or one draw of lights' points, or lacks light; or nothing."""
        if self.is_one_draw:
            return "all pixels take the same points of lights (interleaving 1): the error has no upper bound"
        reasons = []
        if self.few:
            held = "1 pixel holds" if self.few == 1 else f"{self.few} pixels hold"
            x, y = self.worst
            reasons.append(f"{held} {MOST_NOISE:.0%} of the noise, the worst at ({x}, {y}) from the lower left")
        if self.is_unmet:
            reasons.append("no reflection has met the brightest light yet")
        if self.is_missed:
            reasons.append("no sample has met a small light that is in sight")
        return f"{', and '.join(reasons)}: the error can be underestimated" if reasons else ""


def format_error(error: float) -> str:
    """Return an error as a share with two digits: '2.3%'.

    Examples
    --------
    >>> format_error(0.0234), format_error(0.3), format_error(2.5), format_error(float("inf"))
    ('2.3%', '30%', '250%', 'unknown')
    """
    if not np.isfinite(error):
        return "unknown"
    return f"{100.0 * error:.0f}%" if error >= 0.0995 else f"{100.0 * error:.2g}%"


def format_interval(interval: tuple[float, float]) -> str:
    """Return an interval of errors in words.

    Examples
    --------
    >>> format_interval((0.021, 0.025)), format_interval((0.021, float("inf"))), format_interval((0.0, float("inf")))
    ('2.1% to 2.5%', '2.1% or more', 'any')
    """
    low, high = map(format_error, interval)
    if np.isfinite(interval[1]):
        return f"{low} to {high}"
    return f"{low} or more" if interval[0] > 0 else "any"


def square_errors(first: Floats, second: Floats, weight: Floats) -> Floats:
    """Return d^2 (n, c) of means (n, c) of two replications, where `weight` is m n / (m + n)^2, (n,)."""
    difference = first - second
    difference *= difference
    difference *= weight[:, np.newaxis]
    return difference


def weigh_difference(first: Counts, second: Counts, even: bool = False) -> Floats:
    """Return m n / (m + n)^2 (n,) of numbers of samples; inf where one of them is 0 and nothing can be told.

    even : True where both replications count the same, whatever their numbers: 1 / 4
    """
    known = (first > 0) & (second > 0)
    if even:
        return np.where(known, 0.25, np.inf)
    share = first / np.maximum(first + second, 1)
    return np.where(known, share * (1.0 - share), np.inf)


@dataclass(frozen=True, eq=False)
class Scatter:
    """How the samples of a picture scatter within its pixels.

    squares : s^2 / n of each pixel, what the square of its error would be, were its samples independent
    unmet : what a pixel may lack of light that no sample has met
    missed : the sum over pixels of the squares of what they lack of small light that is in sight, and its upper end
        (`missed`)
    """

    squares: Parts
    unmet: float = 0.0
    missed: tuple[float, float] = (0.0, 0.0)


def find_deviations(sums: Floats, square_sums: Floats, counts: Counts) -> Floats:
    """Return sum (x - mean)^2 (n,) of the samples x of pixels, each the mean of its channels.

    Parameters
    ----------
    sums, square_sums : (n,) float64, of samples and of their squares
    counts : (n, 2), numbers of samples of both replications
    """
    count = np.maximum(counts, 1).sum(axis=1).astype(np.float64)
    deviations = square_sums - sums * sums / count
    # What is left of a constant is rounding: of two sums of so many numbers, one of them squared.
    rounding = 3.0 * count * np.finfo(np.float64).eps * square_sums
    return np.where(deviations > rounding, deviations, 0.0)


def spread_samples(deviations: Floats, counts: Counts) -> Floats:
    """Return s^2 / n (n,) of pixels, by sum (x - mean)^2 (n,) of the numbers of samples (n, 2) of replications."""
    first, second = np.maximum(counts, 1).T.astype(np.float64)
    return deviations / np.maximum(first + second - 1.0, 1.0) * (1.0 / first + 1.0 / second) / 4.0


def measure_error(
    squares: Parts, level: float, width: int, interleaving: int = 0, scatter: Scatter | None = None
) -> PictureError:
    """Return how wrong a picture is.

    Parameters
    ----------
    squares : d^2 of each pixel, the mean of its channels
    level : the mean of the picture's channels
    width : pixels of a row
    interleaving : side of the squares of pixels that take different points of lights (`lights.shared_points`), or times
        (`film.shutter`); 0 where each has its own
    scatter : None where it is not known
    """
    noisiest = max(1, round(NOISIEST * squares.pixels))
    found = tally_parts(squares, max(noisiest, FEW))
    if not np.isfinite(found.total + level):
        return PictureError()
    error = relate(found.total / squares.pixels, level)
    if error == np.inf:
        return PictureError(error, (error, error), error)
    scattered = None if scatter is None else tally_parts(scatter.squares, FEW)
    unmet = 0.0 if scatter is None else scatter.unmet**2
    missed, most_missed = (0.0, 0.0) if scatter is None else scatter.missed
    low, high = find_interval(squares, found, error, width, interleaving)
    few, worst = find_few(found, scattered)
    if few and scattered is not None:
        high = max(high, relate(scattered.total / squares.pixels, level))
    row, column = divmod(worst, width)
    return PictureError(
        error,
        (low, float(np.hypot(high, relate((unmet + most_missed) / squares.pixels, level)))),
        relate(mean_without(squares, keep_largest(found.most, noisiest)), level),
        few,
        (column, row),
        is_unmet=unmet > found.total,
        is_one_draw=interleaving == 1 and found.total > 0,
        is_missed=missed > found.total,
    )


def find_interval(squares: Parts, found: Tally, error: float, width: int, interleaving: int) -> tuple[float, float]:
    """Return (low, high), by what samples have met: parameters as `measure_error`."""
    if error == 0:
        return 0.0, 0.0
    spread = sum_squares(squares, width, interleaving, found.largest)
    low = error / spread_ratio(count_freedom(spread))
    missed = count_freedom(spread, missed=1.0)
    return low, error * ((1.0 + 1.0 / spread.total) ** 0.5 * spread_ratio(missed))


def find_few(found: Tally, scattered: Tally | None) -> tuple[int, int]:
    """Return how many pixels hold MOST_NOISE, by either estimate, the fewer of both, 0 where those are more than FEW;
    and which one has most of it."""
    holders = [
        (count_holders(keep_largest(one.most, FEW), one.total) if 0 < one.total < np.inf else 0, one.worst)
        for one in (found, scattered)
        if one is not None
    ]
    return min(filter(lambda one: one[0], holders), default=holders[0])


def relate(square: float, level: float) -> float:
    """Return the root of a mean square over the mean level; inf where there is noise around 0."""
    if square == 0:
        return 0.0
    return float(np.sqrt(square) / abs(level)) if level else np.inf


def count_freedom(spread: Spread, missed: float = 0.0) -> float:
    """Return the degrees of freedom of the sum of squares v, and one more of `missed`, (sum v)^2 / sum v^2.

    They are no more than there are numbers, which d^4 / 3 of few pixels does not know.

    Pixels that share points of lights, or times, are wrong together. Where they do, each of the G sets of pixels that
    take different ones has a sum S of its own, numbers from one distribution, of the variance s^2: their total has the
    variance G s^2, that of a chi-square would be 2 total^2 / nu. Since s^2 is known from G numbers alone, it is taken
    as much larger as Student's quantile is than the normal one, squared. Of one set no s^2 is known: one degree is
    left.
    """
    total, sums = spread.total + missed, spread.of_sets
    freedom = NORMAL_KURTOSIS * total * total / (spread.of_squares + missed * missed)
    freedom = min(freedom, float(spread.pixels + (missed > 0)))
    if sums is None:
        return freedom
    if len(sums) < 2:
        return min(freedom, 1.0)
    variance = float(sums.var(ddof=1)) * (student_quantile(len(sums) - 1) / QUANTILE) ** 2
    return min(freedom, 2.0 * len(sums) * float(sums.mean()) ** 2 / variance) if variance else freedom


def student_quantile(freedom: int) -> float:
    """Return Student's t at 97.5%, to 1% from 3 degrees of freedom on.

    The first terms of its series in 1 / freedom around the normal quantile.

    References
    ----------
    M. Abramowitz, I. Stegun, "Handbook of Mathematical Functions", 1964, 26.7.5.

    Examples
    --------
    >>> round(student_quantile(15), 3)
    2.131
    """
    z = QUANTILE
    first = (z**3 + z) / 4.0
    second = (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / 96.0
    third = (3.0 * z**7 + 19.0 * z**5 + 17.0 * z**3 - 15.0 * z) / 384.0
    return z + first / freedom + second / freedom**2 + third / freedom**3


def spread_ratio(freedom: float) -> float:
    """Return the factor by which a root mean square of `freedom` squares may differ from another one, at 95%.

    By Wilson and Hilferty (chi^2 / nu)^(1/3) is normal, of the mean 1 - c and the variance c = 2 / (9 nu). So f^3 is
    the quantile of the ratio of two of them where (f - 1) (1 - c) = z sqrt(c (1 + f^2)), a quadratic equation.
    """
    variance = 2.0 / (9.0 * freedom)
    mean_square, limit = (1.0 - variance) ** 2, QUANTILE**2 * variance
    if mean_square <= limit:
        return np.inf
    root = np.sqrt(mean_square**2 - (mean_square - limit) ** 2)
    return float(((mean_square + root) / (mean_square - limit)) ** 1.5)


def count_holders(noisiest: Floats, total: float) -> int:
    """Return how many of the noisiest pixels hold MOST_NOISE of the total, 0 where all of them do not."""
    held = np.cumsum(np.sort(noisiest)[::-1])
    return int(np.searchsorted(held, MOST_NOISE * total)) + 1 if held[-1] >= MOST_NOISE * total else 0


def share_with_neighbors(values: Floats) -> Floats:
    """Return the means (h, w) of each value and its eight neighbors, weighed by 4 : 2 : 1; edges count themselves."""
    padded = np.pad(values, 1, mode="edge")
    rows = sum(weight * padded[k : k + len(values)] for k, weight in enumerate(NEIGHBORS))
    return sum(weight * rows[:, k : k + values.shape[1]] for k, weight in enumerate(NEIGHBORS))
