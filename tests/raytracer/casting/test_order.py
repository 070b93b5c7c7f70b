"""What comes after a hit: every surface that a ray meets, once, in the exact order of (t, instance, primitive)."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import raytracer
from raytracer.casting.brute_force import offer_all
from raytracer.casting.caster import Caster
from raytracer.casting.geometry import world_corners
from raytracer.casting.primitives import make_primitives
from raytracer.casting.query import Query
from raytracer.casting.rays import make_rays

FIELDS = ("distance", "distance_error", "instance", "primitive", "barycentric", "valid")
UP = (0.0, 0.0, 1.0)


def list_hits(caster, origin, direction, **ranges):
    """All (instance, primitive, distance) of one ray, by asking for what comes after."""
    found, after = [], None
    while True:
        after = caster.closest_hit(origin, direction, after=after, **ranges)
        if not after.hit[0]:
            return found
        found.append((int(after.instance[0]), int(after.primitive[0]), float(after.distance[0])))
        assert len(found) < 1000


def exact_order(caster, origin, direction):
    """The same by fractions: all triangles that a ray meets, sorted by exact t, then by place."""
    geometry, found = caster.geometry, []
    o, d = ([Fraction(float(x)) for x in vector] for vector in (origin, direction))
    for instance in range(len(geometry.instance_mesh)):
        for primitive in range(int(geometry.mesh_count[geometry.instance_mesh[instance]])):
            corners = world_corners(geometry, np.array([instance]), np.array([primitive]))
            a, b, c = ([Fraction(float(x)) - s for x, s in zip(corner[0], o, strict=True)] for corner in corners)
            edges = [dot(d, cross(p, q)) for p, q in ((b, c), (c, a), (a, b))]
            if sum(edges) == 0 or (max(edges) > 0 and min(edges) < 0):
                continue
            t = dot(a, cross(b, c)) / sum(edges)
            if t >= 0:
                found.append((t, instance, primitive))
    return [(instance, primitive, float(t)) for t, instance, primitive in sorted(found)]


def dot(p, q):
    return sum(x * y for x, y in zip(p, q, strict=True))


def cross(p, q):
    return [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]


def brute_force(caster):
    everything = np.ones(caster.scene.instance_count, dtype=bool)
    primitives = make_primitives(caster.geometry, caster.primitives.precision, everything)
    return Caster(caster.scene, primitives, offer_all)


def make_lattice(rng, count, size=3):
    """Triangles with corners on a lattice: many lie in common planes, share edges, or are the same."""
    corners = rng.integers(0, size, size=(count, 3, 3)).astype(np.float64)
    return raytracer.Mesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("count", [40, 300])
def test_hits_after_hits_are_all_in_exact_order(rng, count, turned):
    """Two instances at one place, few triangles and many; rays through lattice points, edges and planes."""
    matrix = np.eye(4)
    if turned:
        matrix[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    instances = raytracer.Instances([0, 0], [matrix, matrix])
    scene = raytracer.Scene(meshes=[make_lattice(rng, count)], instances=instances)
    caster = raytracer.build(scene)
    for _ in range(6):
        start, end = rng.integers(0, 7, size=(2, 3)) / 2.0 - 0.5
        start[2] -= 3.0
        origin, direction = matrix[:3, :3] @ start, matrix[:3, :3] @ (end - start)
        found, expected = list_hits(caster, origin, direction), exact_order(caster, origin, direction)
        assert [hit[:2] for hit in found] == [hit[:2] for hit in expected]
        np.testing.assert_allclose([hit[2] for hit in found], [hit[2] for hit in expected], rtol=1e-15)


@pytest.mark.parametrize("precision", ["certified", "float64", "float32"])
@pytest.mark.parametrize("count", [40, 300, 3000])
def test_every_accelerator_goes_on_as_brute_force_does(rng, precision, count):
    """Step by step, in batches in which some rays have met something and others not yet."""
    scene = raytracer.Scene(meshes=[make_lattice(rng, count, 5), make_lattice(rng, 20, 5)])
    caster = raytracer.build(scene, precision)
    slow = brute_force(caster)
    origins = rng.integers(-1, 6, size=(200, 3)) / 2.0 - (0.0, 0.0, 5.0)
    directions = rng.integers(0, 9, size=(200, 3)) / 2.0 - origins
    after, seen = None, set()
    for step in range(40):
        found = caster.closest_hit(origins, directions, after=after)
        expected = slow.closest_hit(origins, directions, after=after)
        for name in FIELDS:
            if precision != "float32":  # there even first hits differ: a matrix product settles some
                np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)
        rows = np.flatnonzero(found.hit)
        pairs = set(zip(rows, found.instance[rows], found.primitive[rows], strict=True))
        assert not pairs & seen
        seen |= pairs
        if step == 0:
            after = found.forget(np.arange(100, 200))
            seen = {pair for pair in pairs if pair[0] < 100}
            continue
        origins, directions, after = origins[rows], directions[rows], found.select(rows)
        seen = {(np.searchsorted(rows, row), *rest) for row, *rest in seen if row in set(rows)}
        if not len(rows):
            break
    assert step > 5


def test_spheres_are_met_twice_and_at_a_tangent_once():
    spheres = raytracer.Spheres([[0, 0, 3.0], [0, 0, 3.0], [1.0, 0, 8.0]], [1.0, 1.0, 1.0])
    mesh = raytracer.Mesh([[-1, -1, 2], [3, -1, 2], [-1, 3, 2]], [[0, 1, 2]])
    scene = raytracer.Scene(meshes=[mesh], spheres=[spheres])
    for precision in ("certified", "float64", "float32"):
        found = list_hits(raytracer.build(scene, precision), (0, 0, 0), UP)
        assert found[:5] == [(0, 0, 2.0), (1, 0, 2.0), (1, 1, 2.0), (1, 0, 4.0), (1, 1, 4.0)]
        # Only exact roots of a tangent are one.
        assert precision != "certified" or found[5:] == [(1, 2, 8.0)]


def test_after_keeps_to_the_range():
    mesh = raytracer.Mesh([[-1, -1, 2], [3, -1, 2], [-1, 3, 2]], [[0, 1, 2]] * 3)
    caster = raytracer.build(raytracer.Scene(meshes=[mesh]))
    assert [hit[1] for hit in list_hits(caster, (0, 0, 0), UP, t_min=2.0, t_max=2.0)] == [0, 1, 2]
    assert not list_hits(caster, (0, 0, 0), UP, t_max=np.nextafter(2.0, 0))
    assert not list_hits(caster, (0, 0, 0), UP, t_min=np.nextafter(2.0, 3))


def test_ties_of_planes_need_no_integers(rng):
    """A million pixels may look at a box on a floor."""
    square = [[-1, -1, 2.0], [1, -1, 2], [1, 1, 2], [-1, 1, 2]]
    meshes = [raytracer.Mesh(square, [[0, 1, 2], [0, 2, 3]]), raytracer.Mesh(2 * np.array(square), [[0, 1, 2]])]
    meshes[1] = raytracer.Mesh(np.array(square) * (3, 3, 1), [[0, 1, 2], [0, 2, 3]])
    caster = raytracer.build(raytracer.Scene(meshes=meshes))
    rays = make_rays(np.zeros((500, 3)), np.column_stack([rng.uniform(-0.4, 0.4, size=(500, 2)), np.ones(500)]))
    first = caster.closest_hit(rays.origins, rays.directions)
    query = Query(caster.primitives, replace(rays, after=first), any_hit=False)
    caster.offer(query)
    second = query.closest()
    assert (first.instance == 0).all()
    assert (second.instance == 1).all()
    assert query.exact_count == 0
