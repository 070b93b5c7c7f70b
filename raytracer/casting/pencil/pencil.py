"""Pencils: rays that share a point or a direction, and how they and the scene are projected along them.

Camera rays leave one point, shadow rays arrive at one, the rays of a sun or of an orthographic camera are parallel.
Seen along such a pencil every ray is a point of a plane, and a triangle is a triangle (the lecture's central and
parallel projection): candidates are found in two dimensions.

A *view* maps a position p to homogeneous coordinates h = A (p - centre), image point (h_x, h_y) / h_z for a shared
point, (h_x, h_y) for a shared direction. Its rays fill [-1, 1]^2. The *nearness* of a point grows towards where the
rays come from: 1 / h_z or -h_z. Both are linear in the image point over a triangle, which is what makes them cheap.

A is any matrix: rays and triangles are mapped by the same one, so only its evaluation rounds.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats
from raytracer.casting.rays import Rays
from raytracer.predicates.rounding import gamma

# Rays arriving at a point are seen from where they end: their ends may lie this far apart, as a share of their length.
LARGEST_SPREAD = 2.0**-28
# What is nearer to an arriving pencil's point than this many spreads is not projected: beyond it, a ray is off its
# image point by less than 2^-22.
SPREADS = 2.0**23
# Rays within a cone of this cosine share one view; others are split between the six faces of a cube.
ONE_VIEW = 0.35
# Angles that are tried for the view's axes, and rays that vote.
SPIN_COUNT, VOTERS = 32, 256


Rows = NDArray[np.intp] | slice


@dataclass(frozen=True, eq=False)
class Pencil:
    """n rays through a common point, or parallel ones.

    centre : (3,) float64, the common point, or one near the rays
    headings : (n, 3) float64, direction of each ray seen from the point; its origin from `centre` where parallel
    parallel : bool
    arriving : bool, the rays end at the point or before it
    spread : of an arriving pencil, how far from the point its rays may pass it, in every coordinate
    reach : (n,) float64, of an arriving pencil, the t at which its rays pass the point
    """

    centre: Floats
    headings: Floats
    parallel: bool
    arriving: bool = False
    spread: float = 0.0
    reach: Floats | None = None

    @property
    def leaving(self) -> bool:
        """True where the rays leave the point."""
        return not (self.parallel or self.arriving)


@dataclass(frozen=True, eq=False)
class View:
    """Some rays of a pencil and how they are projected.

    matrix : (3, 3) float64, A; centre : (3,) float64
    rays : which of the pencil's, k of them
    image : (2, k) float32, in [-1, 1] but for roundings
    depth, step : (k,) float64, h_z of the ray's origin and of its direction; h_z = depth + t step
    blurred : rays of an arriving pencil are off their image points by more than 2^-22 at h_z below this
    """

    pencil: Pencil
    centre: Floats
    matrix: Floats
    rays: Rows
    image: NDArray[np.float32]
    depth: Floats
    step: Floats

    def pick(self, start: int, stop: int) -> Rows:
        """Which of the pencil's rays the view's rays from `start` to before `stop` are."""
        return slice(start, stop) if isinstance(self.rays, slice) else self.rays[start:stop]

    def __len__(self) -> int:
        return len(self.depth)

    @property
    def blurred(self) -> float:
        """The point p of a ray, h = A p, is off by |A| spread; x = h_x / h_z then by twice that over h_z."""
        return SPREADS * self.pencil.spread * float(np.abs(self.matrix).sum(axis=1).max())


def find_pencil(rays: Rays, parallel: bool = True, arriving: bool = True) -> Pencil | None:
    """Return the pencil that rays form, or None: equal origins, or, if such are looked for, equal directions or equal
    ends o + t_max d or o + d (shadow rays to a point within a light, which end on the light's surface)."""
    origins, directions = rays.origins, rays.directions
    if _are_equal(origins):
        return Pencil(origins[0], directions, parallel=False)
    if parallel and _are_equal(directions):
        centre = (origins.min(axis=0) + origins.max(axis=0)) / 2
        return Pencil(centre, origins - centre, parallel=True)
    if not arriving:
        return None
    pencil = _find_arriving(rays, rays.t_max)
    if pencil is None and (rays.t_max <= 1.0).all():
        pencil = _find_arriving(rays, np.ones(len(rays)))
    return pencil


def _are_equal(vectors: Floats) -> bool:
    some = vectors[[0, len(vectors) // 2, -1]]
    return bool((some == some[0]).all() and (vectors == vectors[0]).all())


@np.errstate(over="ignore", invalid="ignore")
def _find_arriving(rays: Rays, reach: Floats) -> Pencil | None:
    """Rays whose points o + reach d nearly coincide, in comparison with the shortest way there."""
    few = np.array([0, len(rays) // 2, -1])
    for some, ends_at in ((rays.select(few), reach[few]), (rays, reach)):
        centre = some.origins[0] + ends_at[0] * some.directions[0]
        headings = np.ascontiguousarray(some.origins.T) - centre[:, np.newaxis]  # (3, n): rows of three take longer
        ends = some.directions.T * ends_at
        ends += headings
        off, sizes = float(np.abs(ends).max()), np.abs(headings)
        shortest = float(np.maximum(np.maximum(sizes[0], sizes[1]), sizes[2]).min())
        if not (off <= LARGEST_SPREAD * shortest and shortest > 0):
            return None
    # Both sums round: relative to the origins' distance and to the coordinates themselves.
    size = np.abs(centre).max() + sizes.max() + max(np.abs(rays.origins.max()), np.abs(rays.origins.min()))
    return Pencil(centre, headings.T, False, True, off + gamma(4) * float(size), reach)


def make_views(pencil: Pencil, rays: Rays, scale: float) -> Iterator[View]:
    """Yield views that together hold every ray of a pencil once.

    scale : a power of two; `scale` times the distances that count are about one
    """
    everyone = slice(0, len(rays))
    if pencil.parallel:
        forward = rays.directions[0]
        yield _make_parallel_view(pencil, _turn_to(forward / np.abs(forward).max()), rays, scale)
        return
    voters = _pick_voters(pencil.headings)
    forward = (voters / np.abs(voters).max(axis=1, keepdims=True)).mean(axis=0)
    if np.abs(forward).max() > ONE_VIEW:
        turn = _turn_to(forward)
        turned = _map_planes(turn, pencil.headings)
        if _fit_one_view(*turned):
            yield _make_view(pencil, turn, turned, everyone, scale)
            return
    axis = np.abs(pencil.headings).argmax(axis=1)
    face = 2 * axis + (np.take_along_axis(pencil.headings, axis[:, np.newaxis], axis=1)[:, 0] < 0)
    for one in np.unique(face):
        turn = (-1.0 if one % 2 else 1.0) * np.roll(np.eye(3), one // 2 + 1, axis=1)
        rows = np.flatnonzero(face == one)
        yield _make_view(pencil, turn, _map_planes(turn, pencil.headings[rows]), rows, scale)


@np.errstate(over="ignore")
def _fit_one_view(x: Floats, y: Floats, z: Floats) -> bool:
    """False also where headings are so long, or so short, that their squares are none."""
    return bool(z.min() > 0 and (z * z > ONE_VIEW**2 * (x * x + y * y + z * z)).all())


def _pick_voters(vectors: Floats) -> Floats:
    return vectors[:: max(1, len(vectors) // VOTERS)]


def _turn_to(forward: Floats) -> Floats:
    """Rows x, y, z of a frame with z along `forward` and y upwards (world z) where that can be."""
    z = forward / np.linalg.norm(forward)
    up = np.array([0.0, 0.0, 1.0]) if abs(z[2]) < 0.999 else np.array([0.0, 1.0, 0.0])
    x = np.cross(up, z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def _make_view(pencil: Pencil, turn: Floats, turned: Floats, rows: Rows, scale: float) -> View:
    """The view whose image rectangle just holds rays with headings `turned` (3, k), turned about z to be small.

    The image points are not those of `matrix` to the last bit: both round, by less than 2^-28 of the rectangle.
    """
    points = turned[:2] / turned[2]
    spin = _choose_spin(_pick_voters(points.T))
    points = spin @ points
    middle, half = _fit(points)
    fit = np.diag([1.0 / half[0], 1.0 / half[1], 1.0])
    fit[:2, 2] = -middle / half
    matrix = scale * (fit @ np.block([[spin, np.zeros((2, 1))], [np.zeros((1, 2)), 1.0]]) @ turn)
    image = ((points - middle[:, np.newaxis]) / half[:, np.newaxis]).astype(np.float32)
    seen = scale * turned[2]
    if pencil.reach is not None:
        return View(pencil, pencil.centre, matrix, rows, image, seen, -seen / pencil.reach[rows])
    return View(pencil, pencil.centre, matrix, rows, image, np.zeros_like(seen), seen)


def _make_parallel_view(pencil: Pencil, turn: Floats, rays: Rays, scale: float) -> View:
    turned = _map_planes(turn, pencil.headings)
    spin = _choose_spin(_pick_voters(turned[:2].T))
    points = spin @ turned[:2]
    middle, half = _fit(points)
    turn = np.concatenate([spin @ turn[:2], turn[2:]])
    centre = pencil.centre + middle @ turn[:2]
    matrix = np.diag([1.0 / half[0], 1.0 / half[1], scale]) @ turn
    image = ((points - middle[:, np.newaxis]) / half[:, np.newaxis]).astype(np.float32)
    depth = _map_planes(matrix[2:], rays.origins - centre)[0]
    step = np.full(len(rays), matrix[2] @ rays.directions[0])
    return View(pencil, centre, matrix, slice(0, len(rays)), image, depth, step)


def _map_planes(matrix: Floats, vectors: Floats) -> Floats:
    """M v of (n, 3) vectors, as planes (rows of M, n)."""
    x, y, z = np.ascontiguousarray(vectors.T)
    return np.stack([(row[0] * x + row[1] * y) + row[2] * z for row in matrix])


def _fit(points: Floats) -> tuple[Floats, Floats]:
    """(2,) the middle and half the size of points (2, k); where they lie in a line, a little beside their size."""
    low, high = points.min(axis=1), points.max(axis=1)
    half = (high - low) / 2
    return (low + high) / 2, np.maximum(half, 2.0**-20 * max(half.max(), np.abs(points).max(), 2.0**-20))


def _choose_spin(points: Floats) -> Floats:
    """The rotation (2, 2) that makes the rectangle around points (k, 2) smallest, of SPIN_COUNT."""
    angles = np.arange(SPIN_COUNT) * (np.pi / 2 / SPIN_COUNT)
    cosine, sine = np.cos(angles), np.sin(angles)
    along = points[:, :1] * cosine + points[:, 1:] * sine
    across = points[:, 1:] * cosine - points[:, :1] * sine
    best = np.argmin(np.ptp(along, axis=0) * np.ptp(across, axis=0))
    return np.array([[cosine[best], sine[best]], [-sine[best], cosine[best]]])
