"""Which points lie inside something: the parity of crossings, object by object.

A mesh has an inside where it has no border: every edge is shared by an even number of triangles (edges of one pair of
positions, so that vertices which lie on each other count as one). Only then is the parity of crossings that of every
ray from a point ("even-odd rule"; Jordan's theorem for closed polyhedra), and a floor or a leaf does not turn what is
below it into an inside. Objects that overlap are told apart: parities are counted for each instance.

Exact, by the symbolic perturbation of `crossings`: a point on a surface counts as moved by (e, e^2, e^3) for an
infinitely small e > 0. A sphere's inside is |p - c| < r, decided in fractions where floating point cannot.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Protocol
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike

from raytracer.arrays.checks import as_rows
from raytracer.arrays.types import Booleans, Floats, Indices
from raytracer.casting.crossings import CrossingQuery
from raytracer.casting.geometry import Ids, Kind, split_id
from raytracer.casting.primitives import Primitives, gather_spheres
from raytracer.casting.rays import Rays, make_rays
from raytracer.predicates.rounding import gamma
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Mesh

# Any direction serves; one along an axis would pass through edges and vertices of what is modelled on a grid, and
# leave those to integers.
DIRECTION = (0.36, 0.48, 0.8)
BATCH_POINTS = 1 << 16
# |p - c|^2 - r^2 in float64: three differences, their squares, two sums, r^2 and the last difference.
SPHERE_ERROR = gamma(6)


class CrossingCaster(Protocol):
    """What finds candidates in a whole scene."""

    @property
    def scene(self) -> Scene: ...

    @property
    def primitives(self) -> Primitives: ...

    @property
    def offer(self) -> Callable[[CrossingQuery], None]: ...


_closed: WeakKeyDictionary[Mesh, bool] = WeakKeyDictionary()


class InsideQuery(CrossingQuery):
    """Counts crossings for each instance that has an inside.

    closed_instance : (instances + groups,) bool, what has one
    """

    def __init__(self, primitives: Primitives, rays: Rays, closed_instance: Booleans) -> None:
        super().__init__(primitives, rays)
        self.closed_instance = closed_instance
        self.crossed: list[Ids] = [np.zeros(0, np.int64)]
        self.inside = np.zeros(len(rays), dtype=np.bool_)

    def offer(self, ray: Indices, primitive_id: Ids) -> Indices:
        """Take in candidates. A ray that starts inside a sphere meets it, so that no such sphere is left out."""
        rows = np.flatnonzero(self.closed_instance[split_id(self.primitives.geometry, primitive_id)[0]])
        ray, primitive_id = ray[rows], primitive_id[rows]
        sphere = np.flatnonzero(self.primitives.geometry.is_kind(primitive_id, Kind.SPHERE))
        if len(sphere):
            within = self._lie_within(ray[sphere], primitive_id[sphere])
            self.inside[ray[sphere[within]]] = True
        return super().offer(ray, primitive_id)

    def add_crossings(self, ray: Indices, primitive_id: Ids) -> None:
        """Remember them as numbers of (ray, instance)."""
        instance, _ = split_id(self.primitives.geometry, primitive_id)
        self.crossed.append(ray.astype(np.int64) * len(self.closed_instance) + instance)

    def _lie_within(self, ray: Indices, primitive_id: Ids) -> Booleans:
        """Return (k,) True where a ray starts inside a sphere."""
        centre, radius = (part.astype(np.float64) for part in gather_spheres(self.primitives, primitive_id))
        origin = self.rays.origins[ray].T
        squared: Floats = ((centre - origin) ** 2).sum(axis=0)
        within: Booleans = squared < radius**2
        for row in np.flatnonzero(np.abs(squared - radius**2) <= SPHERE_ERROR * (squared + radius**2)):
            offset = [Fraction(c) - Fraction(p) for c, p in zip(centre[:, row], origin[:, row], strict=True)]
            within[row] = sum(x * x for x in offset) < Fraction(radius[row]) ** 2
        return within

    def found_inside(self) -> Booleans:
        """(n,) bool: does the ray start inside any one instance? Call once, when all candidates were offered."""
        self.settle_doubts()
        pair, times = np.unique(np.concatenate(self.crossed), return_counts=True)
        self.inside[pair[times % 2 == 1] // len(self.closed_instance)] = True
        return self.inside


def find_inside(caster: CrossingCaster, points: ArrayLike) -> Booleans:
    """Return (n,) bool: which points lie inside a closed mesh or a sphere; exact.

    Parameters
    ----------
    caster : certified
    points : (n, 3) or (3,) float64, metres, world

    Returns
    -------
    (n,) bool. A point that is NaN or infinite lies inside nothing, and nothing lies inside a mesh that has a border.

    Raises
    ------
    ValueError
        If shapes do not fit, or the caster's precision is not 'certified'.
    """
    if caster.primitives.precision != "certified":
        raise ValueError(f"inside: precision: expected 'certified', got {caster.primitives.precision!r}")
    rays = make_rays(as_points(points), DIRECTION)
    inside, valid = np.zeros(len(rays), dtype=np.bool_), np.flatnonzero(rays.valid())
    closed = list_closed(caster.scene)
    if not closed.any():
        return inside
    for start in range(0, len(valid), BATCH_POINTS):
        index = valid[start : start + BATCH_POINTS]
        query = InsideQuery(caster.primitives, rays.select(index), closed)
        caster.offer(query)
        inside[index] = query.found_inside()
    return inside


def as_points(points: ArrayLike) -> Floats:
    """Return (3,) or (n, 3) points as (n, 3); ValueError names `points`."""
    return as_rows(points, "points")


def list_closed(scene: Scene) -> Booleans:
    """Return (instances + groups,) True for what has an inside: meshes without a border, and spheres; no curves."""
    closed = np.array([is_closed(mesh) for mesh in scene.meshes], dtype=np.bool_)
    placed = closed if scene.instances is None else closed[scene.instances.mesh]
    return np.concatenate([placed, np.repeat([True, False], [len(scene.spheres), len(scene.curves)])])


def is_closed(mesh: Mesh) -> bool:
    """Return True for a mesh without a border: every edge belongs to an even number of triangles.

    Vertices at the same position are one; an edge between them is none. Remembered while the mesh exists.
    """
    if mesh not in _closed:
        _closed[mesh] = len(mesh.triangles) > 0 and not find_border(mesh)
    return _closed[mesh]


def find_border(mesh: Mesh) -> bool:
    """Return True where some edge belongs to an odd number of triangles."""
    rows = np.ascontiguousarray(mesh.positions + 0.0)  # -0 becomes 0
    _, place = np.unique(rows.view(np.dtype((np.void, rows.strides[0]))).ravel(), return_inverse=True)
    corners = place[mesh.triangles]  # (t, 3)
    start, end = corners.ravel(), corners[:, [1, 2, 0]].ravel()
    edges = np.minimum(start, end) * len(place) + np.maximum(start, end)
    _, times = np.unique(edges[start != end], return_counts=True)
    return bool((times % 2).any())
