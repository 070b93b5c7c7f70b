"""Meshes and rays of the accuracy benchmark, chosen so that every peer gets exactly the same problem.

All coordinates and directions are float64 numbers that float32 holds, so converting them to a peer's precision changes
nothing. Vertices and origins lie on a lattice fine enough for the shape and coarse enough that origin-to-vertex
directions, and small integer combinations of two of them, are float32 numbers as well: rays "at a vertex" or "at an
edge" go through it *exactly*, in float32, in float64 and in the oracle's integers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tests import meshes

FAR = (148376.0, 1234.0, -223423.0)
FARTHER = (1e6, 1e6, 1e6)
# Lattice of shapes of size 1 around the origin: differences have up to 19 bits, 5 remain for combinations.
FINE = 2.0**-18
# The needles are 1e-5 apart; differences have up to 23 bits.
FINEST = 2.0**-22
LARGEST_WEIGHT = 7
NEEDLE_ASPECT = 1e5
SLIVER_WIDTH = 1e-5
GRAZING_RISE = np.tan(np.radians(0.57))


@dataclass(frozen=True, eq=False)
class Target:
    """A mesh to be shot at.

    positions (v, 3) float64 on the lattice, triangles (t, 3) int32
    centre (3,), size : where it is, and a length that all of it lies within
    start : (generator, n) -> (n, 3) origins to aim from, before they are put on the lattice
    families : names in AIMS
    """

    name: str
    positions: np.ndarray
    triangles: np.ndarray
    lattice: float
    centre: np.ndarray
    size: float
    start: Callable
    families: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class RaySet:
    """Rays (n, 3) of one family at one target."""

    target: Target
    family: str
    origins: np.ndarray
    directions: np.ndarray

    @property
    def name(self):
        return f"{self.target.name}, {self.family}"


def snap(points, lattice):
    """Return the nearest points of the lattice, coordinates k * lattice."""
    return np.round(np.asarray(points) / lattice) * lattice


def is_float32(vectors):
    """(n,) bool: does float32 hold each row exactly?"""
    return (vectors.astype(np.float32) == vectors).all(axis=-1)


# Targets ------------------------------------------------------------------------------------------------------------


def start_in_box(centre, half):
    """Origins uniform in a cube."""
    return lambda generator, count: centre + generator.uniform(-half, half, (count, 3))


def start_above(generator, count):
    """Origins above a grid of size 16; the aim replaces x and y."""
    return generator.uniform((-8, -8, 4), (8, 8, 12), (count, 3))


def start_in_tube(generator, count):
    """Origins around the core circle of `meshes.make_torus`."""
    angle = generator.uniform(0, 2 * np.pi, count)
    core = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
    return core + generator.uniform(-0.15, 0.15, (count, 3))


def make_target(name, mesh, lattice, size, start, families, centre=(0.0, 0.0, 0.0)):
    """Put a mesh on the lattice."""
    return Target(name, snap(mesh[0], lattice), mesh[1], lattice, np.asarray(centre), size, start, families)


def make_icosphere(offset, name):
    """The icosphere of 1280 triangles; far from the origin, float32's own spacing is the lattice."""
    largest = np.float32(np.abs(offset).max() + 1)
    lattice = max(FINE, float(np.spacing(largest)))
    mesh = meshes.make_icosphere(3, centre=offset)
    families = ("vertex", "edge", "random", "camera")
    return make_target(name, mesh, lattice, 1.0, start_in_box(np.asarray(offset), 0.3), families, offset)


def make_slivers(generator, count=64):
    """Triangles of aspect 1e5 turned at random, each in a cell of its own."""
    turns = np.linalg.qr(generator.normal(size=(count, 3, 3)))[0]
    cells = np.stack(np.unravel_index(np.arange(count), (4, 4, 4)), axis=1) * 2.0 - 3.0
    corners = np.array([(-0.5, 0, 0), (0.5, 0, 0), (0, SLIVER_WIDTH, 0)])
    positions = (cells[:, None] + np.einsum("kij,cj->kci", turns, corners)).astype(np.float32).astype(np.float64)
    return positions.reshape(-1, 3), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def make_targets(generator):
    """Return all targets."""
    everything = ("vertex", "edge", "random", "camera")
    lens = meshes.make_needle_lens(aspect=NEEDLE_ASPECT)
    slivers = make_slivers(generator)
    at_zero = start_in_box(np.zeros(3), 0.05)
    return (
        make_icosphere((0.0, 0.0, 0.0), "icosphere"),
        make_icosphere(FAR, "icosphere at 2e5"),
        make_icosphere(FARTHER, "icosphere at 1e6"),
        make_target("torus", meshes.make_torus(), FINE, 1.4, start_in_tube, everything),
        make_target("needle lens", lens, FINEST, 1.0, at_zero, ("vertex", "edge", "random")),
        make_target("grid", meshes.make_grid(), FINE, 8.0, start_above, ("vertical vertex", "vertical edge", "random")),
        Target("slivers", *slivers, FINEST, np.zeros(3), 3.5, at_zero, ("grazing",)),
    )


# Rays ---------------------------------------------------------------------------------------------------------------


def aim_at_vertices(target, generator, count):
    """Exactly through random vertices, from random origins."""
    origins = snap(target.start(generator, count), target.lattice)
    return origins, target.positions[generator.integers(len(target.positions), size=count)] - origins


def aim_at_edges(target, generator, count):
    """Exactly through random points of random edges: d = i (a - o) + j (b - o) with small integers i, j > 0."""
    edges = meshes.unique_edges(target.triangles)
    origins = snap(target.start(generator, count), target.lattice)
    a, b = np.moveaxis(target.positions[edges[generator.integers(len(edges), size=count)]], 1, 0)
    weights = generator.integers(1, LARGEST_WEIGHT + 1, size=(2, count, 1)).astype(np.float64)
    directions = weights[0] * (a - origins) + weights[1] * (b - origins)
    halves = (a - origins) + (b - origins)  # one bit more than a difference: the edge's middle
    return origins, np.where(is_float32(directions)[:, None], directions, halves)


def aim_down_at_vertices(target, generator, count):
    """Straight down through random vertices, those on the border included."""
    origins, vertices = snap(target.start(generator, count), target.lattice), target.positions
    origins[:, :2] = vertices[generator.integers(len(vertices), size=count), :2]
    return origins, np.tile((0.0, 0.0, -1.0), (count, 1))


def aim_down_at_edges(target, generator, count):
    """Straight down through random points of random edges, those of the border included."""
    edges = meshes.unique_edges(target.triangles)
    origins = snap(target.start(generator, count), target.lattice)
    a, b = np.moveaxis(target.positions[edges[generator.integers(len(edges), size=count)]], 1, 0)
    share = snap(generator.random((count, 1)), 2.0**-8)
    origins[:, :2] = (a + share * (b - a))[:, :2]
    return origins, np.tile((0.0, 0.0, -1.0), (count, 1))


def aim_at_random(target, generator, count):
    """Between random points of a box twice as large as the target."""
    points = target.centre + 2 * target.size * generator.uniform(-1, 1, (2, count, 3))
    origins = points[0].astype(np.float32).astype(np.float64)
    return origins, points[1] - origins


def aim_by_camera(target, generator, count):
    """A pinhole that sees all of the target, about `count` pixels."""
    side = max(2, int(np.sqrt(count)))
    eye = snap(target.centre + target.size * np.array((1.7, -2.6, 1.4)), target.lattice)
    forward = (target.centre - eye) / np.linalg.norm(target.centre - eye)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    x, y = (axis.ravel()[:, None] for axis in np.meshgrid(*2 * [np.linspace(-0.4, 0.4, side)]))
    directions = generator.permutation(forward + x * right + y * np.cross(right, forward))
    return np.tile(eye, (len(directions), 1)), directions


def aim_grazing(target, generator, count):
    """At 0.57 degrees to slivers, at points within a few widths of them."""
    corners = target.positions[target.triangles[generator.integers(len(target.triangles), size=count)]]
    along, side = corners[:, 1] - corners[:, 0], corners[:, 2] - (corners[:, 0] + corners[:, 1]) / 2
    side = side / np.linalg.norm(side, axis=1, keepdims=True)
    normal = np.cross(along, side)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    share, shift = generator.uniform((-0.1, -0.2), (1.1, 1.2), (count, 2)).T[..., None]
    angle = generator.uniform(0, 2 * np.pi, (count, 1))
    heading = np.cos(angle) * along + np.sin(angle) * side - GRAZING_RISE * normal
    through = corners[:, 0] + share * along + shift * SLIVER_WIDTH * side
    origins = (through - 10 * heading).astype(np.float32).astype(np.float64)
    return origins, through - origins


AIMS = {
    "vertex": aim_at_vertices,
    "edge": aim_at_edges,
    "vertical vertex": aim_down_at_vertices,
    "vertical edge": aim_down_at_edges,
    "random": aim_at_random,
    "camera": aim_by_camera,
    "grazing": aim_grazing,
}
# Families whose directions must be float32 numbers already; the others are rounded, which aims them elsewhere.
AIMED_EXACTLY = ("vertex", "edge", "vertical vertex", "vertical edge")


def make_rays(target, family, generator, count):
    """Return a RaySet of about `count` rays, rounded to float32.

    Raises
    ------
    ValueError
        If a family that aims exactly would be rounded: the target's lattice is too fine.
    """
    origins, directions = AIMS[family](target, generator, count)
    if family in AIMED_EXACTLY and not (is_float32(origins) & is_float32(directions)).all():
        raise ValueError(f"{target.name}, {family}: directions have more bits than float32: the lattice is too fine")
    directions = directions.astype(np.float32).astype(np.float64)
    usable = (directions != 0).any(axis=1)
    return RaySet(target, family, origins[usable], directions[usable])


def make_ray_sets(seed, count):
    """Return the ray sets of all targets and families."""
    generator = np.random.default_rng(seed)
    return [
        make_rays(target, family, generator, count) for target in make_targets(generator) for family in target.families
    ]
