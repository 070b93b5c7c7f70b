"""What nodes answer at the limits of what they take, where formulas have no answer: as Cycles 5.0 does."""

import numpy as np
import pytest

from raytracer import Step
from raytracer.shading.evaluate import OPERATIONS, fold_step


def compute(name, /, *inputs, **settings):
    found = fold_step(Step(name, tuple(np.asarray(value, dtype=float) for value in inputs), settings))
    return found[OPERATIONS[name].outputs[0]]


def test_no_power_of_0_is_infinite():
    powers = [compute("MATH", 0.0, exponent, 0.0, operation="POWER") for exponent in (-2.0, -0.5, 0.0, 2.0)]
    assert powers == [0.0, 0.0, 1.0, 0.0]
    assert compute("MATH", -2.0, -1.0, 0.0, operation="POWER") == -0.5
    of_vectors = compute("VECT_MATH Vector", (0.0, 0.0, 4.0), (-1.0, 0.0, -0.5), np.zeros(3), 1.0, operation="POWER")
    np.testing.assert_array_equal(of_vectors, (0.0, 1.0, 0.5))


@pytest.mark.parametrize("kind", ["LINEAR", "STEPPED", "SMOOTHSTEP", "SMOOTHERSTEP"])
def test_an_empty_range_gives_0_which_is_clamped(kind):
    inputs, settings = (0.3, 1.0, 1.0, 0.5, 2.0, 4.0), {"interpolation_type": kind}
    assert compute("MAP_RANGE Result", *inputs, **settings, clamp=False) == 0.0
    assert compute("MAP_RANGE Result", *inputs, **settings, clamp=True) == 0.5


@pytest.mark.parametrize("color", [(0.0, -1.0, -0.5), (0.0, 0.0, -1.0), (-2.0, 0.0, -1.0)])
def test_a_color_of_value_0_has_no_hue(color):
    assert compute("SEPARATE_COLOR", color, mode="HSV") == 0.0


@pytest.mark.parametrize("turns", [-3.0, -1.0, 0.0, 2.0])
def test_hues_turn_on_beyond_a_whole_turn(turns):
    color = np.array((0.8, 0.3, 0.1))
    turned = compute("HUE_SAT", 0.75 + turns, 1.0, 1.0, 1.0, color)
    np.testing.assert_allclose(turned, compute("HUE_SAT", 0.75, 1.0, 1.0, 1.0, color), atol=1e-12)
    np.testing.assert_allclose(compute("HUE_SAT", 0.5 + turns, 1.0, 1.0, 1.0, color), color, atol=1e-12)
