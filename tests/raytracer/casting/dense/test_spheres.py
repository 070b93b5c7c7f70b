"""Spheres in dense trees: what the table rules out is missed exactly; hits are those of brute force, bit for bit.

Tried: PLACED and TERMS a hundredth of what they are; a certain triangle settled although a sphere is left; a tree of
spheres that have moved taken from the last caster; large spheres left out; each turned red. Slack, measured the same
way: three hundredths of PLACED are too little, six are not; of TERMS one hundredth is, three are not. It costs nothing:
beside the squares of spheres that scenes hold, all of it is small.
"""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import raytracer
from raytracer.casting.brute_force import offer_all
from raytracer.casting.bvh import hierarchy
from raytracer.casting.bvh.tree import Frame, make_frame
from raytracer.casting.dense import spheres as spheres_module
from raytracer.casting.dense import walk as dense_walk
from raytracer.casting.dense.offer import DenseOffer
from raytracer.casting.dense.spheres import SphereRays, build_spheres, meet_spheres, pack_quadrics
from raytracer.casting.framed import frame_rays
from raytracer.casting.pencil.pencil import find_pencil
from raytracer.casting.rays import make_rays
from tests import meshes
from tests.oracle.judging import assert_same_hits, build_with, judge, sphere_scene

PAIRS = 1500
# Coordinates that are multiples of 1 / GRID stay exact for all distances here.
GRID = 2.0**12
# Frames are a little smaller than a power of two, so that coordinates in them come near one.
FRAME, INSIDE = 0.9999, 0.999


def touch(rng, centres, radii, distance, inward):
    """Rays from about `distance` past spheres' sides, nearer to the centers by the share `inward` of the radius."""
    towards = rng.normal(size=centres.shape)
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    aside = np.cross(towards, rng.normal(size=centres.shape))
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    targets = centres + aside * (radii * (1 - inward))[:, np.newaxis]
    origins = targets - towards * distance
    directions = targets - origins
    directions[::5] *= 10.0 ** rng.integers(-20, 20, (len(directions[::5]), 1))
    return origins, directions


def meets_exactly(origin, direction, centre, radius):
    """Whether a line meets a sphere."""
    o, d, c = ([Fraction(float(x)) for x in vector] for vector in (origin, direction, centre))
    way = [p - q for p, q in zip(c, o, strict=True)]
    aside = [way[i - 2] * d[i - 1] - way[i - 1] * d[i - 2] for i in range(3)]
    return sum(x * x for x in aside) <= Fraction(float(radius)) ** 2 * sum(x * x for x in d)


@pytest.mark.parametrize("distance", [0.5, 3.0, 1e3, 1e8, 2.0**40])
@pytest.mark.parametrize("size", [0.9, 1e-2, 1e-5, 1e-13])
@pytest.mark.parametrize(("centre", "scale"), [((0.0, 0.0, 0.0), 1.0), ((4e3, -1.0, 7.0), 0.3)])
def test_no_sphere_is_missed(rng, distance, size, centre, scale):
    """Rays that touch spheres, or nearly so."""
    radii = size * rng.uniform(0.5, 1, PAIRS)
    places = rng.uniform(-1, 1, (PAIRS, 3)) * (INSIDE - radii)[:, np.newaxis]
    inward = rng.choice([0.0, 1e-16, 1e-15, 1e-12, 1.0], PAIRS)
    origins, directions = touch(rng, places, radii, distance, inward)
    # A quarter of few digits, exactly through the centers: what is rounded seldom meets a tiny sphere from afar.
    places[::4] = np.round(places[::4] * GRID) / GRID
    directions[::4] = rng.integers(-GRID / 4, GRID / 4, directions[::4].shape) * 4.0 / GRID + 2.0 / GRID
    origins[::4] = places[::4] - directions[::4] * np.exp2(np.round(np.log2(distance)))
    places, origins = places * scale + centre, origins * scale + centre
    directions, radii = directions * scale, radii * scale
    frame = make_frame(np.subtract(centre, scale * FRAME), np.add(centre, scale * FRAME))
    rays = SphereRays(PAIRS)
    with np.errstate(all="ignore"):
        rays.fill(slice(0, PAIRS), frame_rays(frame, origins, directions))
    rows = pack_quadrics(frame.place(places), np.ldexp(radii, frame.exponent))
    index = meet_spheres(rows[:, np.newaxis], rays.rows[:PAIRS, np.newaxis])
    possible = np.zeros(PAIRS, bool)
    possible[index] = True
    met = 0
    for k in range(PAIRS):
        if meets_exactly(origins[k], directions[k], places[k], radii[k]):
            met += 1
            assert possible[k], f"ray {k} meets its sphere"
    assert met > PAIRS / 20 or scale != 1
    assert not len(meet_spheres(rows[np.newaxis], rays.rows[np.newaxis, PAIRS:]))  # the ray that meets nothing


def test_rounded_terms_are_within_their_share_of_the_tolerance(rng, monkeypatch):
    """Lines exactly through centers, placed and turned without a rounding: all of f is what its terms have lost."""
    monkeypatch.setattr(spheres_module, "PLACED", 0.0)
    # Of 20 bits, so that moments are exact, and products of four such numbers are not.
    places, directions = np.round(rng.uniform(-INSIDE, INSIDE, (2, PAIRS, 3)) * 2.0**20) / 2.0**20
    rays = SphereRays(PAIRS)
    rays.fill(slice(0, PAIRS), frame_rays(Frame(np.zeros(3), 0), places - directions, directions))
    rows = pack_quadrics(places, np.full(PAIRS, 2.0**-40))
    assert len(meet_spheres(rows[:, np.newaxis], rays.rows[:PAIRS, np.newaxis])) == PAIRS


@pytest.mark.parametrize("size", [1.0, 1e-3, 1e-6])
def test_lines_that_pass_spheres_are_ruled_out(rng, size):
    """By 1e-12 of the radius where spheres are as large as the scene, by a radius where they are a millionth of it."""
    share = {1.0: 1e-12, 1e-3: 1e-6, 1e-6: 1.0}[size]
    radii = 0.4 * size * np.ones(PAIRS)
    places = rng.uniform(-0.5, 0.5, (PAIRS, 3))
    origins, directions = touch(rng, places, radii, 1.0, -share)
    rays = SphereRays(PAIRS)
    rays.fill(slice(0, PAIRS), frame_rays(make_frame(-FRAME * np.ones(3), FRAME * np.ones(3)), origins, directions))
    rows = pack_quadrics(places, radii)
    assert not len(meet_spheres(rows[:, np.newaxis], rays.rows[:PAIRS, np.newaxis]))


def make_cloud(rng, count=900):
    """Spheres of many sizes, two of them large, some equal to others, inside others, or points nearly."""
    centres, radii = rng.uniform(-1, 1, (count, 3)), 10.0 ** rng.uniform(-3, -1, count)
    radii[:2] = 0.7, 0.9
    centres[10:20], radii[10:20] = centres[20:30], radii[20:30]
    centres[30:40], radii[30:40] = centres[40:50], radii[40:50] / 2
    radii[50:60] = 1e-12
    return centres, radii


def build_all(scene):
    """Return casters with dense trees, with the four-wide tree and with brute force."""
    dense, other = build_with("dense", scene), build_with("bvh", scene)
    return dense, other, replace(other, offer=offer_all)


def assert_agree(casters, origins, directions, t_min=0.0, t_max=np.inf):
    """Cast with dense trees, also with all batches in order, and with the others; return the hits."""
    dense, other, everything = casters
    rays = origins, directions, t_min, t_max
    hits = dense.closest_hit(*rays)
    for caster in (other, everything):
        assert_same_hits(hits, caster.closest_hit(*rays))
    np.testing.assert_array_equal(other.any_hit(*rays), hits.hit)
    np.testing.assert_array_equal(dense.any_hit(*rays), hits.hit)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dense_walk, "FEW_RAYS", 0)
        assert_same_hits(hits, dense.closest_hit(*rays))
        np.testing.assert_array_equal(dense.any_hit(*rays), hits.hit)
    return hits


def make_mixed_scene(rng, offset=0.0, scale=1.0):
    """Spheres among triangles, some of which touch spheres, or lie in them."""
    centres, radii = make_cloud(rng)
    soup = meshes.make_soup(rng, 300, 0.2)
    corners = np.asarray(soup[0]).copy()
    corners[:30] = centres[:30] + (0, 0, 1) * radii[:30, np.newaxis]
    floor = meshes.make_quad(3.0)
    joined = meshes.join_meshes([(corners, soup[1]), (np.subtract(floor[0], (0, 0, 1)), floor[1])])
    mesh = raytracer.Mesh(np.asarray(joined[0]) * scale + offset, joined[1])
    return raytracer.Scene(meshes=[mesh], spheres=[raytracer.Spheres(centres * scale + offset, radii * scale)])


@pytest.mark.parametrize("distance", [0.0, 0.3, 4.0, 1e4, 1e9])
@pytest.mark.parametrize(("offset", "scale"), [(0.0, 1.0), (148376.0, 1.0), (0.0, 1e-30), (0.0, 1e150), (3.0, 1e12)])
def test_spheres_and_triangles_agree(rng, distance, offset, scale):
    """Rays at centers, past sides, from inside and from surfaces, with ranges that begin and end at roots."""
    scene = make_mixed_scene(rng, offset, scale)
    centres, radii = scene.spheres[0].centres, scene.spheres[0].radii
    # Integers decide the farthest, which takes milliseconds each.
    some = rng.integers(len(radii), size=300 if distance < 1e4 and scale < 1e100 else 20)
    inward = rng.choice([1.0, 0.5, 1e-15, 0.0, -1e-15], len(some))
    origins, directions = touch(rng, centres[some], radii[some], distance * scale, inward)
    if distance == 0.0:
        origins, directions = centres[some] + radii[some, np.newaxis] * (0, 1, 0), rng.normal(size=origins.shape)
        origins[::3] = centres[some[::3]]
    casters = build_all(scene)
    hits = assert_agree(casters, origins, directions)
    assert hits.hit.any()
    t = np.where(np.isfinite(hits.distance), hits.distance, 1.0)
    assert_agree(casters, origins, directions, 0.0, t)
    assert_agree(casters, origins, directions, t, np.inf)
    assert_agree(casters, origins, directions, -1.0, np.nextafter(t, 0.0))
    assert_agree(casters, origins, directions, np.nextafter(t, np.inf), 3 * t)


def test_equal_spheres_and_triangles_at_one_place_agree(rng):
    """The pole of a sphere in the plane of triangles, and the same sphere twice: the lowest id of equals."""
    centres = np.stack([np.arange(40.0), np.zeros(40), np.zeros(40)], axis=1)
    centres[20:] = centres[:20]
    grid = np.concatenate([np.add(centres[:20], (x, y, 0.5)) for x, y in ((-0.3, -0.3), (0.6, -0.3), (-0.3, 0.6))])
    triangles = np.arange(60).reshape(3, 20).T
    scene = raytracer.Scene(
        meshes=[raytracer.Mesh(grid, triangles)], spheres=[raytracer.Spheres(centres, np.full(40, 0.5))]
    )
    origins = np.add(centres, (0, 0, 4))
    casters = build_all(scene)
    hits = assert_agree(casters, origins, (0, 0, -1))
    np.testing.assert_array_equal(hits.distance, 3.5)
    np.testing.assert_array_equal(hits.instance, 0)
    hits = assert_agree(casters, origins, (0, 0, -1), 3.6, 9.0)
    np.testing.assert_array_equal(hits.instance, 1)
    np.testing.assert_array_equal(hits.primitive, np.tile(np.arange(20), 2))
    rays = meshes.random_rays(rng, 600)
    assert_agree(casters, *rays)


def test_spheres_alone_equal_exact_arithmetic(rng):
    centres, radii = make_cloud(rng, 60)
    scene = sphere_scene(*zip(centres, radii, strict=True))
    origins, directions = touch(rng, centres, radii, 2.0, rng.choice([1.0, 1e-15, 0.0], 60))
    judge(build_with("dense", scene), origins, directions)
    judge(build_with("dense", scene), np.round(origins, 2), np.round(directions, 2))


def test_spheres_beside_instances_agree(rng, monkeypatch):
    monkeypatch.setattr(hierarchy, "FLATTEN_LIMIT", 0)
    matrices = np.tile(np.eye(4), (30, 1, 1))
    matrices[:, :3, 3] = rng.uniform(-2, 2, (30, 3))
    scene = raytracer.Scene(
        meshes=[raytracer.Mesh(*meshes.make_icosphere(2, 0.3))],
        instances=raytracer.Instances(np.zeros(30, np.int32), matrices),
        spheres=[raytracer.Spheres(*make_cloud(rng, 100))],
    )
    hits = assert_agree(build_all(scene), *meshes.random_rays(rng, 400))
    assert len(np.unique(hits.instance)) > 5
    assert (hits.instance == 30).sum() > 20


def test_all_surfaces_along_rays_agree(rng):
    """Spheres are met twice: what a ray has left behind is told apart by the query."""
    scene = make_mixed_scene(rng)
    some = rng.integers(900, size=100)
    rays = touch(rng, scene.spheres[0].centres[some], scene.spheres[0].radii[some], 2.0, rng.choice([1.0, 0.0], 100))
    all_hits = [build_with(name, scene).all_hits(*rays) for name in ("dense", "bvh")]
    assert_same_hits(all_hits[0].hits, all_hits[1].hits)
    assert all_hits[0].count.sum() > 500


def test_pencils_are_as_other_rays(rng):
    """The caster's choice for rays of a camera, a light and a sun, among many spheres and few."""
    for scene in (make_mixed_scene(rng), raytracer.Scene(spheres=[raytracer.Spheres(*make_cloud(rng))])):
        caster, other = raytracer.build(scene), build_with("dense", scene)
        targets = rng.uniform(-1, 1, (9000, 3))
        centre = np.array([0.1, -3.0, 0.4])
        assert find_pencil(make_rays(centre, targets - centre)) is not None
        for rays in ((centre, targets - centre), (targets, centre - targets, 0.0, 1.0), (targets, (0.3, 0.2, 1.0))):
            assert_same_hits(caster.closest_hit(*rays), other.closest_hit(*rays))
            np.testing.assert_array_equal(caster.any_hit(*rays), other.any_hit(*rays))


def test_large_spheres_are_in_a_tree_of_their_own(rng):
    caster = raytracer.build(raytracer.Scene(spheres=[raytracer.Spheres(*make_cloud(rng))]))
    assert isinstance(caster.offer, DenseOffer)
    trees = build_spheres(caster.geometry, make_frame(np.full(3, -3.0), np.full(3, 3.0)))
    assert [len(np.unique(tree.items)) for tree in trees] == [898, 2]
    assert sorted(np.unique(trees[1].items)) == [0, 1]


def test_spheres_that_moved_have_a_tree_of_their_own(rng):
    """What is taken from the last caster is what has not moved."""
    scene = make_mixed_scene(rng)
    rays = meshes.random_rays(rng, 500)
    first = raytracer.build(scene)
    first.closest_hit(*rays)
    centres, radii = scene.spheres[0].centres, scene.spheres[0].radii
    assert raytracer.build(scene, last=first).offer.built is first.offer.built
    for spheres in (raytracer.Spheres(centres + 0.1, radii), raytracer.Spheres(centres, 1.1 * radii)):
        moved = raytracer.Scene(meshes=scene.meshes, spheres=[spheres])
        second = raytracer.build(moved, last=first)
        assert_same_hits(second.closest_hit(*rays), build_with("bvh", moved).closest_hit(*rays))
