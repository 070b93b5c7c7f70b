"""Certified hits equal exact arithmetic: a seeded sample on closed meshes, spheres and instances of many kinds.

Each scene is cast into by rays at vertices, at edges, along axes and at random, by brute force and by the tree, and
judged in integers. Beside this file stand `test_certified_limits.py` (each margin at its limit),
`test_certified_properties.py` (generated scenes) and `test_certified_millions.py` (the slow tier).

Mutations that were tried, and what turned red (here: this file; L: limits, P: properties; B: test_predicates.py):

    predicates   EDGE_BOUND u / 4                                       here, at vertices of an icosphere
                 NUMERATOR_BOUND, DENOMINATOR_BOUND / 64                here, along axes; B
                 no gamma(6) in the discriminant's bound                B
    refine       _DETERMINANT_BOUND 2^-20 of itself                     here; L, from far away
                 half an ulp 0.45; without its least float; no Newton   L, B; L; L
                 exact zero claimed for units 2^12 too large            L, smallest edge functions
                 exact vertex: without low parts, remainder, underflow  L, points passed by rounding
    exact        t_min or t_max exclusive; ties to the last             here
                 no error below the least float; t_max = -inf ignored   L, underflow and overflow
    query       ties to the last; all certain candidates tied          here
                 pool keeps low < best instead of <=                    L, candidates at one distance
                 best lowered to t instead of t's upper bound           here, along axes
                 candidates in doubt count as any hit                   L, edges that pairs leave in doubt
                 t_max compared with t; t_min not at all                here, ranges
                 edge bound from the nearest axis, from flat ones only  L, one bound per ray
    crossings    edges and vertices counted as closed sets              here
    culling      no pad; no float32 share of it; reciprocals capped low here
                 SLACK_OF_DISTANCE 0                                    here, ranges of the needle lens
                 no float64 error; moved into the box                   L, from far away
    bvh          boxes rounded to nearest                               L, boxes rounded outward
    hierarchy    sphere boxes too small; best distance 2^-20 too small  L, tangents; here
    placed       no error at all in the pad                             here, instances very far away
    primitives   no rounding in boxes of instances                      L, boxes of cubes

Not caught, because another margin covers them: SLACK = 1 (a row's pad of 4 u (1 + |o|) exceeds the u |o| of rounding o
and the 3 u (1 + |o|) of the three operations on t), the slack of a moved start (the subtraction is exact where it
matters), `corner_error` alone (the terms for the origin, of the same kind and size, have twice the margin needed), the
reciprocal without a cap (0 * inf then needs a padded origin on a box plane, which is a miss).
"""

from functools import partial

import numpy as np
import pytest

import raytracer
from raytracer.casting.bvh import hierarchy, traverse
from tests import meshes
from tests.oracle import exact_oracle
from tests.oracle.exact_numbers import round_to_float
from tests.oracle.judging import assert_same_hits, build_with, judge, judge_hits, mesh_scene, sphere_scene

FAR = (1e6, -2e6, 3e6)


def turn(angle, axis=2):
    """A rotation (3, 3)."""
    i, j = [k for k in range(3) if k != axis]
    matrix = np.eye(3)
    matrix[[i, i, j, j], [i, j, i, j]] = np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)
    return matrix


def place(linear, translation=(0.0, 0.0, 0.0)):
    """A world_from_object matrix (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, translation
    return matrix


def instance_scene(offset=(0.0, 0.0, 0.0)):
    """Mirrored, sheared, stretched, rotated and coinciding instances of a cube and a sphere."""
    shear = np.array([(1, 0.7, 0), (0, 1, 0), (0.2, 0, 1)])
    linears = [
        np.eye(3), np.diag([-1.0, 1.0, 1.0]), shear, turn(0.3) @ turn(1.1, 0), np.diag([1e-4, 1e4, 1.0]),
        np.diag([-2.0, -0.5, -1e-3]) @ shear, turn(0.3) @ turn(1.1, 0), np.eye(3) * 0.3,
    ]  # fmt: skip
    places = [(0, 0, 0), (3, 0, 0), (0, 3, 0), (0, 0, 3), (-3, 0, 0), (0, -3, 0), (0, 0, 3), (0, 0, -3)]
    matrices = [place(linear, np.add(at, offset)) for linear, at in zip(linears, places, strict=True)]
    shapes = [raytracer.Mesh(*meshes.make_cube(0.75)), raytracer.Mesh(*meshes.make_icosphere(1))]
    return raytracer.Scene(
        meshes=shapes, instances=raytracer.Instances(np.repeat([0, 1], len(matrices)), np.concatenate([matrices] * 2))
    )


def mixed_scene():
    """Spheres between meshes, touching and coinciding with them."""
    spheres = raytracer.Spheres([(0, 0, 0), (0, 0, 0), (2, 0, 0), (0, 0, 1.5)], [1.0, 1.0, 1.0, 1e-3])
    more = raytracer.Spheres([(0, 0, 0), (0, 4, 0)], [0.5, 2.0])
    return mesh_scene(meshes.make_cube(1.0), meshes.make_icosphere(1, 1.5), spheres=[spheres, more])


SCENES = {
    "icosphere": lambda: mesh_scene(meshes.make_icosphere(2)),
    "icosphere far away": lambda: mesh_scene(meshes.make_icosphere(2, centre=FAR)),
    "tiny icosphere": lambda: mesh_scene(meshes.make_icosphere(1, 1e-30)),
    "huge icosphere": lambda: mesh_scene(meshes.make_icosphere(1, 1e30)),
    "torus": lambda: mesh_scene(meshes.make_torus(12, 8)),
    "needle lens": lambda: mesh_scene(meshes.make_needle_lens()),
    "nested shells": lambda: mesh_scene(meshes.make_nested_shells(8)),
    "nested shells apart": lambda: mesh_scene(*(meshes.make_nested_shells(1, 1 + k * 2.0**-52) for k in (2, 0, 1))),
    "heightfield": lambda: mesh_scene(meshes.make_heightfield(10)),
    "dyadic grid": lambda: mesh_scene(meshes.make_grid(8)),
    "soup": lambda: mesh_scene(meshes.make_soup(np.random.default_rng(5), 80)),
    "doubled soup": lambda: mesh_scene(*[meshes.make_soup(np.random.default_rng(6), 30)] * 2),
    "instances": instance_scene,
    "instances far away": lambda: instance_scene(FAR),
    # World corners are rounded to 2^-16 there: far more than float32 rounds in the frame of the mesh.
    "instances very far away": lambda: instance_scene((2.0**36, 0.0, -(2.0**36))),
    "spheres": lambda: sphere_scene(*((np.array([k % 3, k // 3, k % 2]) * 1.5, 0.5 + k / 10) for k in range(9))),
    "spheres and meshes": mixed_scene,
}
AIMS = ("vertices", "edges", "random", "axes")
RAYS = 60


def scene_box(exact_scene):
    """Centre and half size of everything."""
    reach = np.repeat(exact_scene.radii, 2)[:, np.newaxis] * np.tile([[1.0], [-1.0]], (len(exact_scene.radii), 1))
    points = np.concatenate([exact_scene.corners.reshape(-1, 3), np.repeat(exact_scene.centres, 2, axis=0) + reach])
    low, high = points.min(axis=0), points.max(axis=0)
    return low / 2 + high / 2, (high / 2 - low / 2).max()


def aim_rays(exact_scene, aim, generator, count):
    """`count` rays of a kind, from origins inside and around the scene, half of them with few digits."""
    centre, half = scene_box(exact_scene)
    origins = centre + half * generator.uniform(-1.5, 1.5, (count, 3))
    # Few digits: differences of coordinates are then floats, and rays pass exactly through what they are aimed at.
    unit = 2.0 ** np.round(np.log2(np.abs(origins).max()) - 20)
    origins[::2] = np.round(origins[::2] / unit) * unit
    corners = exact_scene.corners if len(exact_scene.corners) else exact_scene.centres[:, np.newaxis].repeat(3, axis=1)
    triangle = corners[generator.integers(len(corners), size=count)]
    if aim == "random":
        return origins, generator.normal(size=(count, 3))
    if aim == "axes":  # towards a vertex, along an axis or with one zero component, of either sign
        directions = np.eye(3)[generator.integers(3, size=count)] * generator.choice([-1.0, 1.0], (count, 1))
        directions[::3] += np.roll(directions[::3], 1, axis=1) * generator.choice([-1.0, 1.0], (len(origins[::3]), 1))
        return triangle[:, 0] - directions * half * 2.0 ** generator.integers(-1, 3, (count, 1)), directions
    share = generator.choice([0.5, 0.25], (count, 1)) if aim == "edges" else 0.0
    share = np.where(np.arange(count)[:, np.newaxis] % 3 == 1, generator.random((count, 1)) * (share > 0), share)
    return meshes.aim(origins, triangle[:, 0] * (1 - share) + triangle[:, 1] * share)


def seeded(*names):
    """A generator of its own for each case."""
    return np.random.default_rng([ord(letter) for name in names for letter in str(name)])


# Shared: instances are not flattened, rays enter them.
CASES = [(name, "flattened") for name in SCENES] + [(name, "shared") for name in SCENES if "instances" in name]


@pytest.fixture(params=CASES, ids=", ".join)
def case(request, monkeypatch):
    """A name, and brute force and the tree over its scene."""
    name, storage = request.param
    scene = SCENES[name]()
    # Small steps: what a ray found culls what comes after, as in large batches.
    monkeypatch.setattr(traverse, "CHUNK", 16)
    monkeypatch.setattr(traverse, "LEAF_BATCH", 1)
    brute_force = build_with("brute_force", scene)
    if storage == "shared":
        monkeypatch.setattr(hierarchy, "FLATTEN_LIMIT", 0)
    tree = build_with("bvh", scene)
    assert tree.primitives.flattened.all() == (storage == "flattened")
    return name, (brute_force, tree)


@pytest.mark.parametrize("aim", AIMS)
def test_hits_equal_exact_arithmetic(case, aim):
    name, casters = case
    brute_force, tree = casters
    exact_scene = exact_oracle.pack_scene(tree.scene)
    rays = aim_rays(exact_scene, aim, seeded(name, aim), RAYS)
    hits = tree.closest_hit(*rays)
    judge_hits(tree, hits, *rays)
    assert_same_hits(brute_force.closest_hit(*rays), hits)
    for caster in casters:
        np.testing.assert_array_equal(caster.any_hit(*rays), hits.hit)
        if not len(exact_scene.radii):
            np.testing.assert_array_equal(caster.crossings(*rays), exact_scene.crossings(*rays))


@pytest.mark.parametrize("aim", AIMS)
def test_ranges_are_inclusive_to_the_last_bit(case, aim):
    """t_min and t_max at the exact distance, where it is a float64, and on both of its sides anyway."""
    name, (_, tree) = case
    exact_scene = exact_oracle.pack_scene(tree.scene)
    origins, directions = aim_rays(exact_scene, aim, seeded(name, aim, "range"), RAYS // 4)
    exact = exact_scene.closest_hit(origins, directions).distance
    hit = [ray for ray, t in enumerate(exact) if t is not None]
    rays, t = (origins[hit], directions[hit]), np.array([round_to_float(exact[ray]) for ray in hit])
    for side in (-np.inf, None, np.inf):
        end = t if side is None else np.nextafter(t, side)
        judge(tree, *rays, t_max=end)
        judge(tree, *rays, t_min=end)
    judge(tree, *rays, t_min=t, t_max=t)


def test_batch_equals_single_rays(case):
    name, casters = case
    exact_scene = exact_oracle.pack_scene(casters[1].scene)
    rays = [aim_rays(exact_scene, aim, seeded(name, aim, "batch"), 8) for aim in AIMS]
    origins, directions = (np.concatenate(part) for part in zip(*rays, strict=True))
    for caster in casters:
        together = caster.closest_hit(origins, directions)
        for ray, (origin, direction) in enumerate(zip(origins, directions, strict=True)):
            assert_same_hits(caster.closest_hit(origin, direction), together.select(slice(ray, ray + 1)))


def closed_mesh(name):
    """A closed mesh that points are tested against, inside and outside."""
    return {
        "icosphere": partial(meshes.make_icosphere, 2),
        "icosphere far away": partial(meshes.make_icosphere, 2, centre=FAR),
        "cube": meshes.make_cube,
        "needle lens": meshes.make_needle_lens,
        "torus": partial(meshes.make_torus, 12, 8),
    }[name]()


@pytest.mark.parametrize("name", ["icosphere", "icosphere far away", "cube", "needle lens", "torus"])
def test_no_ray_leaks_out_of_a_closed_mesh(name):
    mesh = closed_mesh(name)
    caster = build_with("bvh", mesh_scene(mesh))
    origin = {"icosphere far away": np.add(FAR, 0.125), "torus": np.array([1.0, 0.0, 0.125])}.get(
        name, np.full(3, 0.125)
    )
    edges = meshes.unique_edges(mesh[1])
    middles = mesh[0][edges].mean(axis=1)
    for targets in (mesh[0], middles):
        rays = meshes.aim(origin, targets)
        assert caster.closest_hit(*rays).hit.all()
        assert caster.any_hit(*rays).all()
        np.testing.assert_array_equal(caster.crossings(*rays) % 2, 1)
