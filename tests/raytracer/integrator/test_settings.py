"""Settings: defaults, and one clear sentence for whatever does not fit."""

import dataclasses

import numpy as np
import pytest

from raytracer.integrator.settings import Settings


def test_defaults_are_blenders():
    settings = Settings()
    assert (settings.samples, settings.passes, settings.workers) == (64, ("Combined",), 1)
    assert settings.filter_width == 1.5
    assert Settings(pixel_filter="box").filter_width == 1.0


def test_settings_are_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        Settings().samples = 2


def test_numpy_numbers_and_lists_become_plain_ones():
    settings = Settings(samples=np.int64(3), passes=["Depth"], border=np.array([0, 1, 2, 3]))
    assert settings == Settings(samples=3, passes=("Depth",), border=(0, 1, 2, 3))
    assert type(settings.samples) is int
    assert Settings(transparent=np.True_).transparent is True
    assert Settings(passes="Depth").passes == ("Depth",)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"samples": 0}, "samples: expected a whole number from 1 to 4294967295, got 0"),
        ({"samples": 1.5}, "samples: expected a whole number, got 1.5"),
        ({"samples": True}, "samples: expected a whole number, got True"),
        ({"max_bounces": -1}, "max_bounces: expected a whole number of 0 or more, got -1"),
        ({"seed": 2**32}, "seed: expected a whole number from 0 to 4294967295, got 4294967296"),
        ({"workers": 0}, "workers: expected a whole number of 1 or more, got 0"),
        ({"block_size": 0}, "block_size: expected a whole number of 1 or more, got 0"),
        ({"passes": ("Combined", "Dept")}, "passes: expected one of Combined, Depth"),
        ({"passes": ()}, "passes: expected one or more different names"),
        ({"passes": ("Depth", "Depth")}, "passes: expected one or more different names"),
        ({"passes": None}, "passes: expected one or more different names, got None"),
        ({"adaptive": "no"}, "adaptive: expected True or False, got 'no'"),
        ({"transparent": 1}, "transparent: expected True or False, got 1"),
        ({"precision": "exact"}, "precision: expected one of certified, float64, float32, got 'exact'"),
        ({"pixel_filter": "gauss"}, "pixel_filter: expected one of blackman_harris, box, got 'gauss'"),
        ({"filter_width": -1}, "filter_width: expected a finite number of 0 or more, got -1"),
        ({"filter_width": float("nan")}, "filter_width: expected a finite number of 0 or more, got nan"),
        ({"filter_width": "wide"}, "filter_width: expected a number, got 'wide'"),
        ({"border": (0, 0, 1)}, r"border: expected \(x_min, y_min, x_max, y_max\), got \(0, 0, 1\)"),
        ({"border": 7}, r"border: expected \(x_min, y_min, x_max, y_max\), got 7"),
        ({"border": (2, 0, 2, 1)}, "border: expected x_min < x_max and y_min < y_max"),
        ({"border": (0.0, 0, 2, 1)}, "border: expected a whole number, got 0.0"),
    ],
)
def test_what_does_not_fit_is_named(fields, message):
    with pytest.raises(ValueError, match=f"^Settings: {message}"):
        Settings(**fields)
