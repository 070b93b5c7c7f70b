"""Judge a caster by the exact oracle: every index, every distance bound, every miss, any_hit included.

`ACCELERATORS` are the ways to find candidates; a test that takes the fixture-like parameter runs on each of them.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache, partial

import numpy as np

import raytracer
from raytracer.casting.brute_force import offer_all
from raytracer.casting.bvh.hierarchy import build_hierarchy
from raytracer.casting.bvh.traverse import offer_traversed
from raytracer.casting.dense.offer import build_scene, offer_dense, suits_dense
from raytracer.casting.matrix_form import MatrixForm
from tests.oracle.exact_numbers import is_within
from tests.oracle.exact_oracle import closest_hit, pack_scene


def make_dense(primitives):
    """Dense trees where they can be used, else the four-wide one, which also counts crossings."""
    traversed = partial(offer_traversed, build_hierarchy(primitives))
    if not suits_dense(primitives):
        return traversed
    scene = build_scene(primitives)
    return lambda query: offer_dense(scene, query) if query.narrows else traversed(query)


ACCELERATORS = {
    "brute_force": lambda primitives: offer_all,
    "matrix_form": MatrixForm,
    "dense": make_dense,
    "bvh": lambda primitives: partial(offer_traversed, build_hierarchy(primitives)),
}


def build_with(accelerator, scene, precision="certified"):
    """Return raytracer.build(scene) with the named accelerator, also where the scene is too small to deserve it."""
    caster = raytracer.build(scene, precision=precision)
    return replace(caster, offer=ACCELERATORS[accelerator](caster.primitives), smallest_pencil=None)


def mesh_scene(*meshes, **content):
    """A Scene of (positions, triangles) pairs."""
    return raytracer.Scene(meshes=[raytracer.Mesh(*mesh) for mesh in meshes], **content)


def sphere_scene(*spheres):
    """A Scene of (centre, radius) pairs."""
    centres, radii = zip(*spheres, strict=True)
    return raytracer.Scene(spheres=raytracer.Spheres(centres, radii))


def judge(caster, origins, directions, t_min=0.0, t_max=np.inf):
    """Cast and compare with exact arithmetic; return the hits and the exact distances (None for a miss)."""
    hits = caster.closest_hit(origins, directions, t_min, t_max)
    judge_hits(caster, hits, origins, directions, t_min, t_max)
    np.testing.assert_array_equal(caster.any_hit(origins, directions, t_min, t_max), hits.hit)
    return hits


@lru_cache(maxsize=64)
def solve(*given):
    """Return exact hits, of what is given as the bytes of arrays: accelerators share them, which have them judged."""
    origins, directions, corners, centres, radii, t_min, t_max = (np.frombuffer(value) for value in given)
    rays = origins.reshape(-1, 3), directions.reshape(-1, 3)
    return closest_hit(*rays, corners.reshape(-1, 3, 3), centres.reshape(-1, 3), radii, t_min, t_max)


def judge_hits(caster, hits, origins, directions, t_min=0.0, t_max=np.inf):
    """Check hits of `caster.scene` against exact arithmetic."""
    exact_scene = pack_scene(caster.scene)
    content = exact_scene.corners, exact_scene.centres, exact_scene.radii
    limits = np.broadcast_arrays(t_min, t_max, np.zeros(len(hits)))[:2]
    given = [np.asarray(value, np.float64).tobytes() for value in (origins, directions, *content, *limits)]
    exact = solve(*given)
    hit = exact.index >= 0
    np.testing.assert_array_equal(hits.instance, np.append(exact_scene.instance, -1)[exact.index])
    np.testing.assert_array_equal(hits.primitive, np.append(exact_scene.primitive, -1)[exact.index])
    assert_miss_is_data(hits, ~hit)
    for ray in np.flatnonzero(hit):
        assert is_within(hits.distance[ray], hits.distance_error[ray], exact.distance[ray]), (
            f"ray {ray}: distance {hits.distance[ray]!r} +- {hits.distance_error[ray]!r} is not {exact.distance[ray]}"
        )


def assert_miss_is_data(hits, miss):
    """Check that these hits are misses as documented: distance infinity, indices -1, nothing left over."""
    np.testing.assert_array_equal(hits.distance[miss], np.inf)
    np.testing.assert_array_equal(hits.distance_error[miss], 0)
    np.testing.assert_array_equal(hits.instance[miss], -1)
    np.testing.assert_array_equal(hits.primitive[miss], -1)
    np.testing.assert_array_equal(hits.barycentric[miss], 0)


def assert_same_hits(first, second):
    """Check that two Hits are equal bit for bit."""
    for name in raytracer.Hits.__slots__:
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name), err_msg=name, strict=True)
