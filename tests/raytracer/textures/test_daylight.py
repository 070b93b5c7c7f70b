"""The skies of Preetham and of Hosek and Wilkie: what their papers say of them, term by term in plain numbers."""

import math

import numpy as np
import pytest

from raytracer.textures import daylight
from raytracer.textures.daylight import DATA, evaluate_hosek_wilkie, evaluate_preetham, find_coefficients

UP = np.array([[0.0, 0.0, 1.0]])


def turn(elevation, azimuth=0.3):
    across = math.cos(elevation)
    return np.array((across * math.cos(azimuth), across * math.sin(azimuth), math.sin(elevation)))


@pytest.mark.parametrize("elevation", [0.1, 0.7, 1.5])
def test_the_zenith_of_preetham_is_that_of_the_paper(elevation):
    """Y_z = (4.0453 T - 4.9710) tan chi - 0.2155 T + 2.4192 thousand candela, chi = (4/9 - T/120) (pi - 2 theta)."""
    turbidity, sun = 3.0, turn(elevation)
    chi = (4 / 9 - turbidity / 120) * 2 * elevation
    luminance = (4.0453 * turbidity - 4.9710) * math.tan(chi) - 0.2155 * turbidity + 2.4192
    assert np.isclose(evaluate_preetham(UP, sun, turbidity)[0, 1], 0.06 * luminance, rtol=1e-12)


def test_perez_function_of_preetham_is_that_of_the_paper():
    turbidity, sun, seen = 2.5, turn(0.8), turn(0.4, 1.9)
    a, b, c, d, e = (first * turbidity + rest for first, rest in daylight.PEREZ[0])

    def shine(direction):
        gamma = math.acos(direction @ sun)
        near = 1 + c * math.exp(d * gamma) + e * math.cos(gamma) ** 2
        return (1 + a * math.exp(b / direction[2])) * near

    found = evaluate_preetham(np.stack([seen, UP[0]]), sun, turbidity)[:, 1]
    assert np.isclose(found[0] / found[1], shine(seen) / shine(UP[0]), rtol=1e-12)


def test_coefficients_at_whole_turbidities_and_ends_of_the_curve_are_those_of_the_data():
    data = np.loadtxt(DATA).reshape(3, 2, 10, 6, 10)
    for turbidity in range(1, 11):
        for albedo in (0, 1):
            for elevation, point in ((0.0, 0), (math.pi / 2, 5)):
                found = np.column_stack(find_coefficients(elevation, turbidity, albedo))
                np.testing.assert_allclose(found, data[:, albedo, turbidity - 1, point], rtol=1e-12)
    assert data[0, 0, 0, 0, 0] == -1.117001  # the first and the last that were published
    assert data[2, 1, 9, 5, 9] == 31.10255


def test_coefficients_are_linear_in_turbidity_and_albedo():
    ends = [np.column_stack(find_coefficients(0.6, turbidity, 0.25)) for turbidity in (4, 5, 4.3)]
    np.testing.assert_allclose(ends[2], 0.7 * ends[0] + 0.3 * ends[1], rtol=1e-12)
    ends = [np.column_stack(find_coefficients(0.6, 4.3, albedo)) for albedo in (0, 1, 0.2)]
    np.testing.assert_allclose(ends[2], 0.8 * ends[0] + 0.2 * ends[1], rtol=1e-12)


def test_turbidities_beyond_the_data_are_those_at_its_ends():
    for beyond, end in ((0.0, 1.0), (30.0, 10.0)):
        np.testing.assert_array_equal(find_coefficients(0.6, beyond, 0.3)[0], find_coefficients(0.6, end, 0.3)[0])


def test_hosek_and_wilkies_function_is_that_of_the_paper():
    sun, seen = turn(0.8), turn(0.4, 1.9)
    (a, b, c, d, e, f, g, h, i), radiance = (part[1] for part in find_coefficients(0.8, 2.5, 0.3))
    gamma, up = math.acos(seen @ sun), seen[2]
    glow = (1 + math.cos(gamma) ** 2) / (1 + i * i - 2 * i * math.cos(gamma)) ** 1.5
    around = c + d * math.exp(e * gamma) + f * math.cos(gamma) ** 2 + g * glow + h * math.sqrt(up)
    expected = (1 + a * math.exp(b / (up + 0.01))) * around * radiance * 2 * math.pi / 683
    assert np.isclose(evaluate_hosek_wilkie(seen[np.newaxis], sun, 2.5, 0.3)[0, 1], expected, rtol=1e-9)


@pytest.mark.parametrize("sun", [turn(-0.3), turn(-1.2), np.array((0.0, 0.0, -1.0))])
def test_a_sun_below_the_horizon_counts_as_on_it(sun):
    found = evaluate_hosek_wilkie(UP, sun, 2.5, 0.3)
    np.testing.assert_allclose(found, evaluate_hosek_wilkie(UP, turn(0.0), 2.5, 0.3), rtol=1e-12)


@pytest.mark.parametrize("evaluate", [evaluate_preetham, lambda *given: evaluate_hosek_wilkie(*given, 0.3)])
def test_what_is_below_the_horizon_goes_on_as_it_is_there(evaluate):
    """At the same angle to the sun, that is: here a right one."""
    sun = np.array((0.0, 1.0, 0.0))
    around = np.array([(math.cos(angle), 0.0, math.sin(angle)) for angle in (-1e-9, -0.3, -1.5)])
    found = evaluate(around, sun, 2.5)
    np.testing.assert_allclose(found, np.broadcast_to(found[0], found.shape), rtol=1e-6)
