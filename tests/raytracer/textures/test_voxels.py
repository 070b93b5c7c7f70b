"""Grids of voxels: values at the points, between and beyond them."""

from __future__ import annotations

import numpy as np
import pytest

from raytracer.scene.media import Grid
from raytracer.textures.voxels import sample_grid

RNG = np.random.default_rng(4)
VALUES = RNG.random((4, 3, 5)).astype(np.float32)


def read(points, interpolation="linear", values=VALUES):
    return sample_grid(Grid(values, np.eye(4), interpolation), np.asarray(points, dtype=np.float64))


def test_values_at_the_points_are_the_voxels() -> None:
    points = np.stack(np.meshgrid(*map(np.arange, VALUES.shape), indexing="ij"), axis=-1).reshape(-1, 3)
    for interpolation in ("linear", "closest"):
        np.testing.assert_array_equal(read(points, interpolation), VALUES.ravel())


def test_linear_is_the_mean_of_the_neighbors_and_fades_out() -> None:
    assert read([(1.5, 2.0, 3.25)])[0] == pytest.approx(
        sum(w * c * VALUES[i, 2, k] for i, w in ((1, 0.5), (2, 0.5)) for k, c in ((3, 0.75), (4, 0.25)))
    )
    assert read([(-0.25, 0.0, 0.0)])[0] == pytest.approx(0.75 * VALUES[0, 0, 0])
    assert read([(-1.0, 0.0, 0.0), (4.0, 1.0, 1.0), (1e9, 0.0, 0.0), (-50.0, 0.0, 2.0)]).tolist() == [0.0] * 4


def test_closest_takes_the_nearest_voxel() -> None:
    assert read([(1.4, 1.6, 0.0)], "closest")[0] == VALUES[1, 2, 0]
    assert read([(-0.6, 0.0, 0.0)], "closest")[0] == 0.0


def test_cubic_keeps_planes_and_is_smooth() -> None:
    """B-splines reproduce what is linear; their value at a point is (1, 4, 1) / 6 of the neighbors along each axis."""
    x = np.arange(8.0)
    plane = (x[:, None, None] + 2 * x[None, :, None] - x[None, None, :]).astype(np.float32)
    points = RNG.uniform(2, 5, (20, 3))
    np.testing.assert_allclose(read(points, "cubic", plane), points @ (1.0, 2.0, -1.0), atol=1e-5)
    spike = np.zeros((5, 5, 5), np.float32)
    spike[2, 2, 2] = 1.0
    assert read([(2.0, 2.0, 2.0)], "cubic", spike)[0] == pytest.approx((4 / 6) ** 3)


def test_colors_are_read_by_channel() -> None:
    colors = RNG.random((3, 3, 3, 3)).astype(np.float32)
    np.testing.assert_allclose(read([(1.0, 0.5, 2.0)], values=colors)[0], colors[1, :2, 2].mean(axis=0), rtol=1e-6)
