"""What NumPy works out of columns depends on their numbers alone, not on where memory was free for the result."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from raytracer.arrays.rows import split_columns
from raytracer.film.panorama import locate_cube_face, locate_cylinder, locate_equirectangular
from raytracer.sampling.direction_map import find_equirectangular
from raytracer.scene.camera import Panorama
from raytracer.shading.nodes.patterns import make_gradient
from raytracer.shading.nodes.photometry import read_luminaire
from raytracer.textures.radial_tiling import tile_radially

TABLE = np.linspace(0.0, 1.0, 4)
PANORAMA = Panorama("equirectangular")
FUNCTIONS: dict[str, Callable[[Any], Any]] = {
    "direction map": find_equirectangular,
    "panorama": lambda rows: locate_equirectangular(PANORAMA, (36.0, 24.0), rows),
    "cylinder": lambda rows: locate_cylinder(PANORAMA, (36.0, 24.0), rows),
    "cube face": lambda rows: locate_cube_face(PANORAMA, (36.0, 24.0), rows),
    "gradient": lambda rows: make_gradient(rows, gradient_type="RADIAL"),
    "radial tiling": lambda rows: tile_radially(rows, np.float64(5.0), np.float64(0.5), normalize=True),
    "luminaire": lambda rows: read_luminaire(
        rows, 1.0, horizontal=TABLE * 2 * np.pi, vertical=TABLE * np.pi, intensity=np.ones((4, 4))
    ),
}


def make_rows() -> Any:
    """Return points (64, 3), row by row in memory: their columns are views with gaps."""
    return np.random.default_rng(3).normal(size=(64, 3))


def test_columns_have_no_gaps_and_the_same_numbers() -> None:
    rows = make_rows()
    columns = split_columns(rows)
    assert all(column.flags.c_contiguous for column in columns)
    np.testing.assert_array_equal(np.stack(columns, axis=1), rows)
    assert [float(number) for number in split_columns(rows[0])] == rows[0].tolist()
    laid = np.asfortranarray(rows)
    assert all(np.shares_memory(column, laid) for column in split_columns(laid))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_arctangents_take_no_views_with_gaps(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def watch(*operands: Any) -> Any:
        calls.append(all(np.ndim(part) == 0 or part.flags.c_contiguous for part in operands))
        return arctan2(*operands)

    arctan2 = np.arctan2
    monkeypatch.setattr(np, "arctan2", watch)
    FUNCTIONS[name](make_rows())
    assert calls
    assert all(calls)
