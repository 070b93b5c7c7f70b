"""FLIP: the properties its paper states, and values computed by the authors' own tool."""

import numpy as np
import pytest

from addon.compare.cycles import flip

# Kernel weights sum to 0 and 1 with about 32 roundings, and the feature error is the square root of what remains.
ROOT_OF_ROUNDING = np.sqrt(32 * 2.0**-53)


def draw_gradient(height=48, width=64):
    y, x = np.mgrid[0:height, 0:width]
    return np.stack([x / (width - 1), y / (height - 1), np.full((height, width), 0.5)], axis=-1)


def test_flip_of_equal_pictures_is_zero():
    # 0 ** (1 - features) is 0; the two color pipelines are the same computation, so nothing rounds apart.
    assert flip.flip(draw_gradient(), draw_gradient()).max() == 0.0


def test_flip_is_symmetric():
    image, reference = draw_gradient(), draw_gradient() ** 2
    np.testing.assert_array_equal(flip.flip(image, reference), flip.flip(reference, image))


def test_flip_of_green_and_blue_is_one():
    # The largest distance of the color space; flat pictures have no features to compare.
    green, blue = np.zeros((40, 40, 3)), np.zeros((40, 40, 3))
    green[..., 1] = 1
    blue[..., 2] = 1
    np.testing.assert_allclose(flip.flip(green, blue), 1.0, rtol=ROOT_OF_ROUNDING)


def test_flip_of_black_and_white_is_below_one():
    black, white = np.zeros((40, 40, 3)), np.ones((40, 40, 3))
    lightness = 100**flip.COLOR_EXPONENT
    largest = flip.measure_color_distance(np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    share = (lightness / largest - flip.COLOR_KNEE) / (1 - flip.COLOR_KNEE)
    expected = flip.COLOR_KNEE_VALUE + share * (1 - flip.COLOR_KNEE_VALUE)
    np.testing.assert_allclose(flip.flip(black, white), expected, rtol=ROOT_OF_ROUNDING)


def test_flip_values_lie_between_zero_and_one():
    rng = np.random.default_rng(7)
    error = flip.flip(rng.random((33, 70, 3)) * 3 - 1, rng.random((33, 70, 3)))
    assert error.shape == (33, 70)
    assert 0 <= error.min() <= error.max() <= 1


def test_flip_falls_with_the_viewing_distance():
    checker = (np.indices((64, 64)).sum(axis=0) % 2)[..., None] * np.ones(3)
    grey = np.full((64, 64, 3), 0.5)
    errors = [flip.mean_flip(checker, grey, pixels) for pixels in (10, 30, 67)]
    assert errors[0] > errors[1] > errors[2]


def test_flip_of_an_edge_exceeds_that_of_a_flat_difference():
    reference = np.full((64, 64, 3), 0.2)
    flat, edge = reference + 0.1, reference.copy()
    edge[:, 32:] += 0.1
    assert flip.flip(edge, reference)[:, 33:37].min() > flip.flip(flat, reference).max()


# flip-evaluator 1.7, LDR, 67.0206 pixels per degree, of a linear picture encoded to sRGB; it computes in float32.
@pytest.mark.parametrize(
    ("power", "brightness", "published"),
    [(2.0, 1.0, 0.5861034989356995), (1.1, 1.0, 0.1389232575893402), (1.0, 0.9, 0.20438683032989502)],
)
def test_flip_agrees_with_the_authors_tool(power, brightness, published):
    reference = draw_gradient()
    assert flip.mean_flip(reference**power * brightness, reference) == pytest.approx(published, abs=1e-5)
