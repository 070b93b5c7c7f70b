"""The product's distances: within their bounds of exact arithmetic, and not far wider than what rounding costs.

Tried: each constant of the bound a hundredth of what it is, the low halves of the pairs left out, no least bound,
normals that underflow, and the bound that it was before (of corners moved to the middle of a frame), which kept rays
from leaving the wall they start on; each turned red.
"""

from fractions import Fraction

import numpy as np
import pytest

import raytracer
from raytracer.casting.geometry import pack_geometry
from raytracer.casting.matrix_form import MatrixForm
from raytracer.casting.planes import PAIRS_ROUNDINGS, cross_sides, make_lines, meet_planes
from raytracer.casting.primitives import make_primitives
from raytracer.casting.rays import make_rays
from raytracer.predicates.rounding import UNIT_ROUNDOFF
from raytracer.surfaces.departing import spawn_origin
from raytracer.surfaces.surface import make_surface
from raytracer.surfaces.surface_tables import make_surface_tables

COUNT = 100


def make_form(corners):
    """The matrix form of triangles (t, 3 corners, 3)."""
    mesh = raytracer.Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    geometry = pack_geometry(raytracer.Scene(meshes=[mesh]))
    return MatrixForm(make_primitives(geometry, "certified", np.ones(1, bool)))


def exact_normal(corners):
    """The world triangle's N = (b - a) x (c - a), and a."""
    a, b, c = ([Fraction(float(x)) for x in vector] for vector in corners)
    p, q = ([x - y for x, y in zip(u, a, strict=True)] for u in (b, c))
    return [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]], a


def exact_distance(origin, direction, corners):
    """T / D of the world's triangle and ray; None where D = 0."""
    o, d = ([Fraction(float(x)) for x in vector] for vector in (origin, direction))
    normal, a = exact_normal(corners)
    denominator = sum(x * y for x, y in zip(d, normal, strict=True))
    return sum((x - z) * y for x, y, z in zip(a, normal, o, strict=True)) / denominator if denominator else None


def make_cases(rng, flatness, offset):
    """Triangles (t, 3, 3), and rays that start next to them or elsewhere."""
    corners = rng.normal(size=(COUNT, 3, 3))
    slide = rng.random((COUNT, 1))
    corners[:, 2] = corners[:, 0] + slide * (corners[:, 1] - corners[:, 0]) + flatness * rng.normal(size=(COUNT, 3))
    corners *= 10.0 ** rng.uniform(-2, 0, size=(COUNT, 1, 1))
    corners += offset
    origins = np.einsum("tk,tkj->tj", rng.dirichlet(np.ones(3), COUNT), corners)
    origins[::3] += rng.normal(size=origins[::3].shape)
    return corners, origins, rng.normal(size=(COUNT, 3))


def measure_slack(form, corners, origins, directions):
    """The largest error of rays' distances to the planes of their triangles as a share of its bound, where there is
    one; and how many have one."""
    lines = make_lines(np.ldexp(origins.T, form.frame.exponent), directions.T, 0.0)
    with np.errstate(all="ignore"):
        distance, error = meet_planes(form.planes[: len(corners)].T, lines.T)
    unit = Fraction(2) ** form.frame.exponent
    rows = np.flatnonzero(np.isfinite(error))
    shares = []
    for k in rows:
        off = abs(Fraction(float(distance[k])) - exact_distance(origins[k], directions[k], corners[k]) * unit)
        shares.append(float(off / Fraction(float(error[k]))))
    return max(shares, default=0.0), len(rows)


@pytest.mark.parametrize("flatness", [1.0, 1e-4, 1e-9])
@pytest.mark.parametrize("offset", [0.0, 3.7, 1e6])
def test_distances_are_within_their_bounds(rng, flatness, offset):
    corners, origins, directions = make_cases(rng, flatness, offset)
    directions /= np.abs(directions).max(axis=1, keepdims=True)
    largest, count = measure_slack(make_form(corners), corners, origins, directions)
    assert largest <= 1
    assert count > COUNT / 2
    # Derived, not generous: roundings that add up at random come this near; sizes are wide of the mark for slivers.
    assert largest > 1 / 256 or flatness < 1.0


def test_rays_within_their_planes_have_no_distance(rng):
    """Along an edge, exactly: D is zero, and what float64 makes of it must not count."""
    corners = rng.integers(-(2**20), 2**20, size=(COUNT, 3, 3)).astype(float)
    directions = (corners[:, 1] - corners[:, 0]) / 2**22
    form = make_form(corners)
    lines = make_lines(np.ldexp(rng.normal(size=(3, COUNT)), form.frame.exponent), directions.T, 0.0)
    with np.errstate(all="ignore"):
        distance, error = meet_planes(form.planes.T, lines.T)
    assert np.isfinite(distance).sum() > COUNT / 4
    assert not np.isfinite(error).any()


def test_distances_that_underflow_are_within_their_bounds(rng):
    """Next to the middle of coordinates a difference may be so small that its products are none."""
    corners, origins, directions = make_cases(rng, 1.0, 0.0)
    directions /= np.abs(directions).max(axis=1, keepdims=True)
    corners[:, 1:] -= corners[:, :1]
    corners[:, 0] = 1e-312 * rng.normal(size=(COUNT, 3))
    largest, count = measure_slack(make_form(corners), corners, 1e-312 * origins, directions)
    assert 0 < largest <= 1
    assert count > COUNT / 2


@pytest.mark.parametrize("flatness", [1.0, 1e-3, 1e-9, 0.0])
@pytest.mark.parametrize("size", [1.0, 1e-6])
def test_normals_are_within_their_bounds(rng, flatness, size):
    """Of slivers, too, down to those that are only by their corners' roundings; small ones stay in float64."""
    corners = make_cases(rng, flatness, 0.0)[0] * size
    frame = np.array([[[-4.0, 0, 0], [4, 0, 0], [0, 4, 0]]])
    planes = make_form(np.concatenate([corners, frame])).planes
    shares = []
    for row, triangle in zip(planes[:COUNT], corners, strict=True):
        normal, _ = exact_normal(triangle)
        largest = int(np.abs(row[:3]).argmax())
        if not (np.isfinite(row[6]) and row[6] < 0.01 and normal[largest]):
            continue
        off = max(
            abs(Fraction(float(x)) - y / normal[largest] * int(row[largest]))
            for x, y in zip(row[:3], normal, strict=True)
        )
        # Without the six roundings of products and sums; twice, as both components of a quotient are off.
        shares.append(float(off) / (2 * (row[6] - 6 * UNIT_ROUNDOFF)))
    assert len(shares) > COUNT / 4
    assert 1 / 256 < max(shares) <= 1


def test_normals_that_underflow_are_known_to_be_none(rng):
    corners = make_cases(rng, 1.0, 0.0)[0] * 1e-160
    planes = make_form(np.concatenate([corners, [[[-4.0, 0, 0], [4, 0, 0], [0, 4, 0]]]])).planes
    assert np.isinf(planes[:COUNT, 6]).all()
    assert planes[COUNT, 6] < 1e-14


def test_normals_in_pairs_are_within_their_bound(rng):
    """Of the flattest of many slivers that are none but for their corners' roundings."""
    corners = rng.normal(size=(3, 3, 100_000))
    corners[2] = corners[0] + rng.random(100_000) * (corners[1] - corners[0])
    normals = cross_sides(corners, 0)
    flattest = np.argsort(np.abs(normals).max(axis=0))[:200]
    shares = []
    for triangle, found in zip(corners.take(flattest, axis=2).T, normals.take(flattest, axis=1).T, strict=True):
        exact, _ = exact_normal(triangle.T)
        extent = float(np.abs(triangle.T[1:] - triangle.T[0]).max())
        for x, y in zip(found, exact, strict=True):
            off = float(abs(Fraction(float(x)) - y)) - UNIT_ROUNDOFF * abs(float(x))
            shares.append(off / (PAIRS_ROUNDINGS * UNIT_ROUNDOFF**2 * extent**2))
    assert 1 / 100 < max(shares) <= 1


def test_rays_that_leave_a_wall_do_not_meet_it(rng):
    """So that the triangle a shadow ray starts on needs no closer look: the surface's step is wider than the bound."""
    corners = rng.normal(size=(30, 3, 3))
    mesh = raytracer.Mesh(corners.reshape(-1, 3), np.arange(90).reshape(-1, 3))
    scene = raytracer.Scene(meshes=[mesh])
    caster = raytracer.build(scene)
    origins = rng.normal(size=(4000, 3)) * 4
    rays = make_rays(origins, corners[rng.integers(30, size=4000)].mean(axis=1) - origins)
    hits = caster.closest_hit(rays.origins, rays.directions)
    rows = np.flatnonzero(hits.hit)
    tables = make_surface_tables(scene, caster.geometry, False, uvs=False, barycentric=False, roundoff=caster.roundoff)
    surface = make_surface(tables, rays.select(rows), hits.select(rows))
    directions = rng.normal(size=(len(rows), 3))
    directions /= np.abs(directions).max(axis=1, keepdims=True)
    starts = spawn_origin(surface, directions)
    form = caster.offer
    planes = form.planes.take(surface.primitive, axis=0)
    assert len(rows) > 1000
    distance, error = meet_planes(planes.T, make_lines(np.ldexp(starts.T, form.frame.exponent), directions.T, 0.0).T)
    assert (distance + error < 0).mean() > 0.999
