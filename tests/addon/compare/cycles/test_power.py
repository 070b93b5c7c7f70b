"""The power of Student's t: closed forms, and a simulation with numbers of known distribution."""

import math

import numpy as np
import pytest

from addon.compare.cycles import metrics, power

# A rate of DRAWS numbers is off by so many standard errors: 1 in 16,000 runs, were the seeds not fixed.
SIGMAS, DRAWS = 4.0, 400_000


def normal_below(value):
    return math.erfc(-value / math.sqrt(2)) / 2


@pytest.mark.parametrize("shift", [0.0, 0.7, 3.0, 12.0])
@pytest.mark.parametrize("quantile", [0.5, 3.0, 9.0])
def test_power_with_two_degrees_is_the_closed_form(quantile, shift):
    """S^2 of two degrees is exponential: P(S <= x) = 1 - exp(-x^2), and the integral over Z is Gaussian.

    P(T >= q) = Phi(D) - exp(-D^2 / (q^2 + 2)) Phi(D / sqrt(a)) / sqrt(a), a = 1 + 2 / q^2.
    """
    a = 1 + 2 / quantile**2

    def upper(shift):
        return normal_below(shift) - math.exp(-(shift**2) / (quantile**2 + 2)) * normal_below(
            shift / math.sqrt(a)
        ) / math.sqrt(a)

    assert power.find_power(shift, quantile, 2) == pytest.approx(upper(shift) + upper(-shift), abs=1e-3)


@pytest.mark.parametrize("degrees", [7, 14, 62])
@pytest.mark.parametrize("significance", [0.01, 1e-5])
def test_power_without_a_difference_is_the_significance(significance, degrees):
    quantile = metrics.student_quantile(significance, degrees)
    assert power.find_power(0.0, quantile, degrees) == pytest.approx(significance, rel=1e-3)


def test_shift_with_many_degrees_is_the_sum_of_two_normal_quantiles():
    # Phi(1.2816) = 0.9, Phi(-2.5758) = 0.005 (Abramowitz and Stegun, table 26.5); what is left is of the order 1 / n.
    assert power.find_shift(0.01, 4000) == pytest.approx(2.5758 + 1.2816, abs=10 / 4000)


@pytest.mark.parametrize(("significance", "degrees"), [(0.01, 3), (1e-4, 7), (1e-5, 14), (1e-5, 40)])
def test_a_difference_of_the_shift_is_found_with_the_power(rng, significance, degrees):
    """With few degrees the sum of two quantiles, q + t, is found less often: the difference is not the smallest one."""
    shift, quantile = power.find_shift(significance, degrees), metrics.student_quantile(significance, degrees)
    statistic = (rng.normal(size=DRAWS) + shift) / np.sqrt(rng.chisquare(degrees, size=DRAWS) / degrees)
    error = math.sqrt(power.POWER * (1 - power.POWER) / DRAWS)
    assert (np.abs(statistic) >= quantile).mean() == pytest.approx(power.POWER, abs=SIGMAS * error + 1e-3)


def test_shifts_of_an_array_are_those_of_its_numbers():
    degrees = np.array([[7, 14], [9, 7]])
    expected = [[power.find_shift(0.01, int(number)) for number in row] for row in degrees]
    np.testing.assert_array_equal(power.find_shifts(0.01, degrees), expected)
