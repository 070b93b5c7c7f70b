"""What pictures say of their error, against the error that they have, over many seeds of six scenes.

The truth is the mean of all seeds. Where few pixels hold the noise, or light has been missed, a picture says so, and
its interval is wide.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

import raytracer
from raytracer.film.error import PictureError
from raytracer.rendering.render import render
from tests.raytracer.rendering.error_scenes import HEIGHT, SCENES, WIDTH

# A pixel of which one seed of many holds so much of all squared errors is a firefly: nothing could have known of it.
FIREFLY = 0.1


@dataclass(frozen=True)
class Truth:
    """Of k seeds: the pictures' true relative errors and what they say of them; the share of the errors of each pixel's
    channels that are within 1.96 times its standard error, and which pixels are no fireflies and have noise."""

    errors: np.ndarray
    told: list[PictureError]
    within: np.ndarray
    is_plain: np.ndarray


def find_truth(name: str, seeds: int, samples: int) -> Truth:
    make, integrator = SCENES[name]
    scene, pictures, deviations, told = make(), [], [], []
    caster = raytracer.build(scene)
    for seed in range(seeds):
        options = {"caster": caster, "integrator": integrator, "passes": ("Combined", "Error"), "seed": seed}
        film = render(scene, WIDTH, HEIGHT, samples, **options)
        pictures.append(film["Combined"][..., :3].astype(np.float64).reshape(-1, 3))
        deviations.append(film["Error"].reshape(-1, 1))
        told.append(film.measure_error())
    seen = np.stack(pictures)
    # Each picture is 1 / k of the mean that it is compared with.
    difference = (seen - seen.mean(axis=0)) * np.sqrt(seeds / (seeds - 1))
    square = (difference**2).mean(axis=2)
    errors = np.sqrt(square.mean(axis=1)) / seen.mean(axis=(1, 2))
    total = square.sum(axis=0)
    has_noise = total > seeds * (np.finfo(np.float32).eps * seen.max()) ** 2  # pictures are rounded to float32
    is_plain = has_noise & (square.max(axis=0) < FIREFLY * total)
    within = (np.abs(difference) <= 1.96 * np.stack(deviations)).mean(axis=(0, 2))
    return Truth(errors, told, within, is_plain)


def share_held(truth: Truth, noted: bool = False) -> tuple[float, int]:
    """Return the share of the pictures without a note, or with one, whose interval holds their error, and how many they
    are."""
    pairs = zip(truth.errors, truth.told, strict=True)
    held = [told.interval[0] <= error <= told.interval[1] for error, told in pairs if bool(told.note) == noted]
    return float(np.mean(held)) if held else np.nan, len(held)


def test_intervals_hold_the_error_of_a_scene_without_fireflies():
    """95% of 60, within three standard deviations of that share; and the mean square told is that of the errors."""
    truth = find_truth("penumbra", 60, 8)
    held, count = share_held(truth)
    assert count == 60
    assert held > 0.95 - 3 * np.sqrt(0.95 * 0.05 / 60)
    squares = [told.error**2 for told in truth.told]
    assert np.mean(squares) == pytest.approx(np.mean(truth.errors**2), rel=0.1)
    assert 0.85 < truth.within[truth.is_plain].mean() < 0.99


@pytest.mark.parametrize("samples", [8, 16])
def test_a_scene_of_fireflies_says_so(samples):
    truth = find_truth("blur", 12, samples)
    assert all(told.note for told in truth.told)


def test_a_picture_whose_two_halves_met_as_much_says_so():
    """Seed 84 of the balls out of focus: both replications have met them equally often."""
    make, integrator = SCENES["blur"]
    told = render(make(), WIDTH, HEIGHT, 16, integrator=integrator, seed=84).measure_error()
    assert 0 < told.few <= 3
    assert told.interval[1] > 8 * told.error


def test_a_picture_that_has_missed_its_light_says_so():
    """Seed 1 of glass and a mirror: none of its samples has met the lamp, which others show as 13 times its error."""
    make, integrator = SCENES["fireflies"]
    told = render(make(), WIDTH, HEIGHT, 16, integrator=integrator, seed=1).measure_error()
    assert told.is_unmet
    assert told.interval[1] > 13 * told.error


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_pictures_know_their_error(name):
    """Of 200 seeds: 93 to 97% of intervals, give or take what 200 cannot tell; 90 to 99% of the pixels' errors."""
    truth = find_truth(name, 200, 16)
    (held, count), (noted, noted_count) = share_held(truth), share_held(truth, noted=True)
    print(
        f"{name}: {held:.3f} of {count} intervals, {noted:.3f} of {noted_count} with a note, "
        f"{truth.within[truth.is_plain].mean():.3f} of pixels"
    )
    assert 0.9 < truth.within[truth.is_plain].mean() < 0.99
    for share, pictures in ((held, count), (noted, noted_count)):
        assert not pictures or abs(share - 0.95) < 0.02 + 2 * np.sqrt(0.95 * 0.05 / pictures)
    assert (noted_count == 200) == (name in ("glossy", "fireflies", "blur"))
    assert count in (0, 200)
