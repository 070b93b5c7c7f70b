"""Films of a processor with wide instructions and of one without: they are of one picture, and may be merged.

NumPy takes other functions for exp, log, pow, sin and cos where it has AVX-512; `NPY_DISABLE_CPU_FEATURES` makes it
another processor's. Their last bits differ, and so do float64 sums; a float32 picture is the same, or next to it where
a sum is within those bits of the border between two numbers.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import raytracer
from tests.folders import ROOT
from tests.raytracer.rendering.rendering_fixtures import make_lit_scene

try:
    from numpy._core._multiarray_umath import __cpu_dispatch__ as dispatched
    from numpy._core._multiarray_umath import __cpu_features__ as present
except ImportError:  # NumPy 1
    from numpy.core._multiarray_umath import __cpu_dispatch__ as dispatched
    from numpy.core._multiarray_umath import __cpu_features__ as present

OPTIONAL = [name for name in dispatched if present.get(name)]
WIDE = [name for name in OPTIONAL if name.startswith("AVX512")]
# As shares of sums: what a hundred roundings of functions a few ulps off, along a path, may come to. Measured: 1e-11.
MOST_OFF = 1e-9

pytestmark = [
    pytest.mark.skipif(not OPTIONAL, reason="NumPy has no instructions here that it could do without"),
    pytest.mark.skipif("NPY_DISABLE_CPU_FEATURES" in os.environ, reason="NumPy does without already"),
]


def render_without(features: list[str], output: Path, *options: str) -> raytracer.Film:
    """Render the second tile of `output.parent / "scene.npz"` by a NumPy without some instructions."""
    environment = {**os.environ, "NPY_DISABLE_CPU_FEATURES": " ".join(features), "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "raytracer", "render", output.parent / "scene.npz", "-o", output, *options]
    subprocess.run(list(map(str, command)), env=environment, check=True, capture_output=True, timeout=300)
    return raytracer.load_film(output)


@pytest.mark.parametrize("features", [WIDE, OPTIONAL], ids=["without AVX-512", "without all"])
def test_films_of_two_processors_are_merged_into_the_picture(tmp_path: Path, features: list[str]) -> None:
    if not features:
        pytest.skip("this processor has no AVX-512")
    raytracer.save(make_lit_scene(), tmp_path / "scene.npz")
    whole, first = (raytracer.render(make_lit_scene(), 24, 16, 4, tile=tile) for tile in (None, (1, 2)))
    second = render_without(
        features, tmp_path / "second.npz", "--size", "24x16", "--samples", "4", "--tile", "2/2"
    )  # fmt: skip
    merged = raytracer.merge([first, second])
    assert merged.key.digest == whole.key.digest
    largest = float(whole.arrays["Combined"].max())
    for name, sums in whole.arrays.items():
        # What tells the error is float32: each of 4 samples, and each of their sums, may round to the other side.
        off = MOST_OFF if sums.dtype == np.float64 else 8 * 2.0**-24 * max(largest, largest**2)
        np.testing.assert_allclose(merged.arrays[name], sums, rtol=MOST_OFF, atol=off)
    expected, picture = whole["Combined"], merged["Combined"]
    assert (np.abs(picture - expected) <= np.spacing(np.abs(expected))).all()
    assert (picture != expected).mean() < 0.01
    # And on: samples of one processor after those of another.
    further = raytracer.render(make_lit_scene(), 24, 16, 6, film=merged)
    whole = raytracer.render(make_lit_scene(), 24, 16, 6)
    assert (np.abs(further["Combined"] - whole["Combined"]) <= np.spacing(np.abs(whole["Combined"]))).all()
