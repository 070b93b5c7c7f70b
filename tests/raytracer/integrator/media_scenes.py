"""Scenes of media for closed forms: boxes, spheres and a camera that looks along one line."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import raytracer
from raytracer import Camera, Material, Mesh, Program, Register, Scene, Step, Volume, VolumeClosure, World

CORNERS = np.array([(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=np.float64)
# Counter-clockwise seen from outside.
TRIANGLES = [
    *((0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4)),
    *((2, 6, 7), (2, 7, 3), (0, 4, 6), (0, 6, 2), (1, 3, 7), (1, 7, 5)),
]


def make_box(half: Any = 1.0, middle: Any = (0.0, 0.0, 0.0), material: int = 0, **fields: Any) -> Mesh:
    """Return a box of half sides `half` around `middle`."""
    positions = CORNERS * np.broadcast_to(half, 3) + middle
    return Mesh(positions=positions, triangles=TRIANGLES, material=material, **fields)


def fill(*closures: VolumeClosure, program: Any = None, **fields: Any) -> Material:
    """Return a material that is nothing but a volume."""
    return Material(volume=Volume(closures, program), only_volume=True, **fields)


def look(position: Any = (0.0, -10.0, 0.0), scale: float = 1e-3) -> Camera:
    """Return a camera that looks along +y, orthographic: all its rays are as good as one."""
    matrix = np.eye(4)
    matrix[:3, :3] = [(1, 0, 0), (0, 0, -1), (0, 1, 0)]
    matrix[:3, 3] = position
    return Camera(matrix, projection="orthographic", ortho_scale=scale)


def measure(scene: Scene, samples: int = 16, size: int = 8, seed: int = 0, **settings: Any) -> Any:
    """Return the mean color (3,) of a picture, and its standard error (3,) over its pixels."""
    pixels = show(scene, samples, size, seed, **settings)["Combined"][..., :3].reshape(-1, 3).astype(np.float64)
    return pixels.mean(axis=0), pixels.std(axis=0, ddof=1) / np.sqrt(len(pixels))


def show(scene: Scene, samples: int = 16, size: int = 8, seed: int = 0, **settings: Any) -> Any:
    """Return the film of a small picture."""
    options = {"integrator": "path", "pixel_filter": "box", "seed": seed, "interleaving": 0, **settings}
    return raytracer.render(scene, size, size, samples, **options)


def assert_close(found: Any, expected: Any, deviations: float = 4.0, least: float = 1e-12) -> None:
    """Fail where a mean is further from what it should be than its standard error explains."""
    mean, error = found
    assert (np.abs(mean - expected) <= deviations * error + least).all(), (mean, error, expected)


# float32 pictures, and sums of a few exponentials.
TOLERANCE = 1e-6
COLORS = np.array([0.2, 0.5, 0.9])
WHITE = World(1.0)
# 2 (y + 1), which rises from 0 to 4 through a box of half side 1.
RISING = Program(
    (
        Step("NEW_GEOMETRY Position"),
        Step("SEPXYZ", (Register(0, "Position"),)),
        Step("MATH", (Register(1, "Y"), 1.0, 0.0), {"operation": "ADD", "use_clamp": False}),
        Step("MATH", (Register(2, "Value"), 2.0, 0.0), {"operation": "MULTIPLY", "use_clamp": False}),
    )
)
DENSITY = Register(3, "Value")


def absorb(density: Any = 0.7, **fields: Any) -> VolumeClosure:
    return VolumeClosure("absorption", color=COLORS, density=density, **fields)


def decay(depth: Any) -> Any:
    """Return what is left of white light after so many metres of `absorb` at density 1."""
    return np.exp(-np.asarray(depth) * (1.0 - COLORS))


SCATTERING, ABSORPTION, ANISOTROPY = 0.6, 0.3, 0.4
GREY = fill(VolumeClosure("coefficients", scattering=SCATTERING, absorption=ABSORPTION, anisotropy=ANISOTROPY))
INTEGRATORS = pytest.mark.parametrize("integrator", ["direct", "path"])


def turn(cosine: Any) -> Any:
    g = ANISOTROPY
    return (1.0 - g * g) / (4.0 * np.pi * (1.0 + g * g - 2.0 * g * cosine) ** 1.5)


def sum_midpoints(value: Any, count: int = 200_000) -> float:
    """Return the integral of a function from y = -1 to 1."""
    y = (np.arange(count) + 0.5) / count * 2.0 - 1.0
    return float(value(y).mean() * 2.0)
