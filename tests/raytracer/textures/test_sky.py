"""Clear skies, against what must hold for any: transmittance in closed form, symmetry, darkness without air."""

import numpy as np
import pytest

from raytracer.textures.sky import (
    THICKNESS,
    Atmosphere,
    _measure_coefficients,
    _transmit,
    exit_sphere,
    find_multiple_sun,
    find_single_sun,
    place_rays,
    tabulate_multiple,
    tabulate_single,
)
from raytracer.textures.sky_spectra import COLOR_MATCHING, FOUR_MATCHING, FOUR_SUN, SUN_IRRADIANCE

NOTHING = Atmosphere(0.5, 100.0, 0.0, 0.0, 0.0)
EARTH = Atmosphere(0.5, 100.0, 1.0, 1.0, 1.0)


def test_distance_to_a_sphere_reaches_its_surface():
    origins, directions = np.array([[0.1, -0.2, 0.3]]), place_rays(np.array([0.7]), np.array([2.0]))
    distance = exit_sphere(origins, directions, 2.0)
    assert np.isclose(np.linalg.norm(origins + distance[:, np.newaxis] * directions), 2.0, rtol=1e-15)


def test_the_sun_without_air_is_the_sun_outside():
    expected = SUN_IRRADIANCE @ COLOR_MATCHING * 20.0
    np.testing.assert_allclose(find_single_sun(NOTHING, 0.5, 1.0), expected, rtol=1e-14)
    np.testing.assert_allclose(find_multiple_sun(NOTHING, 0.5, 1.0), FOUR_SUN @ FOUR_MATCHING, rtol=1e-14)


@pytest.mark.parametrize("tabulate", [tabulate_single, tabulate_multiple])
def test_no_air_scatters_nothing(tabulate):
    assert (tabulate(NOTHING) == 0).all()


@pytest.mark.parametrize("tabulate", [tabulate_single, tabulate_multiple])
def test_a_sky_is_bluest_above_and_brightest_near_the_sun(tabulate):
    sky = tabulate(EARTH)
    np.testing.assert_array_equal(sky, sky[:, ::-1])
    assert (sky[-1, :, 2] > sky[-1, :, 0]).all()
    row = 128 + round(128 * np.sqrt(EARTH.elevation / (np.pi / 2)))
    assert abs(int(sky[row, :, 1].argmax()) - 256) <= 1


def test_a_sky_of_single_scattering_fades_below_the_horizon():
    """The horizon's light times (1 + 5/2 z)^3, rows at elevations -pi/2 (1 - row/128)^2; an old half sky does not."""
    sky = tabulate_single(EARTH)
    left = (1.0 - 2.5 * np.sin(np.pi / 2 * (64 / 128) ** 2)) ** 3
    assert 0 < left < 1
    np.testing.assert_allclose(sky[64], left * sky[128], rtol=1e-12)
    assert (sky[:32] == 0).all()
    half = tabulate_single(EARTH, half=True)
    np.testing.assert_array_equal(half[0], half[128])
    np.testing.assert_array_equal(half[128], sky[128])


def test_transmittance_straight_down_is_that_of_the_column():
    """exp of minus the integral of the extinction over height, by a hundred times finer steps of the midpoint rule."""
    height = (np.arange(6400) + 0.5) / 6400 * THICKNESS
    depth = _measure_coefficients(height, EARTH)[2].sum(axis=0) * THICKNESS / 6400
    found = _transmit(np.float64(1.0), np.float64(0.0), EARTH)
    # Steps of 1.6 km through haze that thins by half every 0.5 km: the midpoint rule loses h^2 / 24 f'' of each.
    step, scale = THICKNESS / 64, 0.73
    haze = _measure_coefficients(np.float64(0.0), EARTH)[2]
    np.testing.assert_array_less(np.abs(-np.log(found) - depth), haze * scale * (step / scale) ** 2 / 8)
