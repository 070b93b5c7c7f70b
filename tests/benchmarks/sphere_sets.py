"""Spheres and rays on which sphere formulas differ, and who answers: the formulas and the ray tracer's precisions.

Rays are float64, so float32 formulas meet rays rounded to their own precision: what they lose begins there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

import raytracer
from tests.benchmarks.peers import Answer
from tests.benchmarks.peers_formulas import SPHERE_FORMULAS
from tests.benchmarks.peers_ours import CERTIFIED, FLOAT32, FLOAT64, PREFIX, read

# (3, 4, 5) and its like: points of a circle of radius 5 in whole numbers, so that a tangent is exact.
LATTICE_CIRCLE = np.array([(5, 0), (0, 5), (3, 4), (4, 3)], dtype=np.float64)
NEARLY_TANGENT = 1e-11


@dataclass(frozen=True, eq=False)
class SphereSet:
    """Rays (n, 3) and one sphere, centre (3,) and radius."""

    name: str
    origins: np.ndarray
    directions: np.ndarray
    centre: np.ndarray
    radius: float


def turn(generator, count):
    """Random orthonormal frames, (n, 3, 3): rows are axes."""
    return np.linalg.qr(generator.normal(size=(count, 3, 3)))[0]


def aim_from_afar(generator, count, distance):
    """Rays from a distance towards points of a disc 1.2 times as wide as the unit sphere."""
    across, up, away = np.moveaxis(turn(generator, count), 1, 0)
    x, y = generator.uniform(-1.2, 1.2, (2, count, 1))
    origins = distance * away
    return origins, x * across + y * up - origins


def aim_nearly_tangent(generator, count, distance):
    """Rays along x that pass the unit sphere's centre at 1 -+ 1e-11, from a distance."""
    angle = generator.uniform(0, 2 * np.pi, count)
    reach = 1 + NEARLY_TANGENT * generator.choice([-1.0, 1.0], count)
    origins = np.stack([np.full(count, -distance), reach * np.cos(angle), reach * np.sin(angle)], axis=1)
    return origins, np.tile((1.0, 0.0, 0.0), (count, 1))


def aim_tangent(generator, count):
    """Rays along x that touch a sphere of radius 5 exactly: D = 0 in exact arithmetic."""
    touching = LATTICE_CIRCLE[generator.integers(4, size=count)] * generator.choice([-1.0, 1.0], (count, 2))
    origins = np.concatenate([-generator.integers(6, 1 << 20, (count, 1)), touching], axis=1)
    return origins, np.tile((1.0, 0.0, 0.0), (count, 1))


def aim_from_above(generator, count, height):
    """Rays into the ground of a sphere of radius 1e6 whose highest point is the origin, from `height` above it."""
    origins = np.tile((0.0, 0.0, height), (count, 1))
    return origins, generator.normal(size=(count, 3)) * (1, 1, 0) + (0, 0, -0.5)


def make_sphere_sets(seed, count):
    """Return the sphere sets, `count` rays each."""
    generator = np.random.default_rng(seed)
    zero, below = np.zeros(3), np.array((0.0, 0.0, -1e6))
    return [
        SphereSet("unit sphere from 3", *aim_from_afar(generator, count, 3.0), zero, 1.0),
        SphereSet("unit sphere from 1e4", *aim_from_afar(generator, count, 1e4), zero, 1.0),
        SphereSet("unit sphere from 1e8", *aim_from_afar(generator, count, 1e8), zero, 1.0),
        SphereSet("radius 1e6 from 1e-3", *aim_from_above(generator, count, 1e-3), below, 1e6),
        SphereSet("radius 1e6 from 1e-6", *aim_from_above(generator, count, 1e-6), below, 1e6),
        SphereSet("tangent -+ 1e-11 from 1e6", *aim_nearly_tangent(generator, count, 1e6), zero, 1.0),
        SphereSet("exact tangent", *aim_tangent(generator, count), zero, 5.0),
    ]


def answer_by_formula(intersect, rays):
    """Return the Answer of a sphere formula."""
    t = intersect(rays.origins, rays.directions, rays.centre, rays.radius).astype(np.float64)
    return Answer(t, np.where(np.isfinite(t), 0, -1))


def answer_by_raytracer(precision, rays):
    """Return the Answer of the ray tracer."""
    scene = raytracer.Scene(spheres=raytracer.Spheres(rays.centre[None], [rays.radius]))
    return read(raytracer.build(scene, precision=precision).closest_hit(rays.origins, rays.directions))


SPHERE_PEERS = {
    name: partial(answer_by_raytracer, name.removeprefix(PREFIX)) for name in (CERTIFIED, FLOAT64, FLOAT32)
} | {name: partial(answer_by_formula, intersect) for name, intersect in SPHERE_FORMULAS.items()}
