"""Rays that start and end on surfaces, or units in the last place beside them, are decided as by brute force.

Next to the ends of a range `planes` decides by its own bound what is no hit, and leaves to the query what that would be
in doubt of. Tried: its bound a hundredth of what it is, and hits settled by it alone, which were measured otherwise.
"""

from dataclasses import replace

import numpy as np
import pytest

import raytracer
from raytracer.casting.brute_force import offer_all
from raytracer.casting.dense.offer import DenseOffer
from raytracer.casting.matrix_form import MatrixForm
from raytracer.surfaces.departing import step_towards
from tests import meshes
from tests.oracle.judging import assert_same_hits, mesh_scene

COUNT = 1500
MESHES = {
    "soup": lambda rng: meshes.make_soup(rng, 60),
    "torus": lambda rng: meshes.make_torus(10, 6),
    "grid": lambda rng: meshes.make_grid(7),
    "needles": lambda rng: meshes.make_needle_lens(),
}


def place_on_faces(rng, corners, count):
    """Points (count, 3) on faces, edges and corners, a fifth each as computed, and up to three steps beside."""
    weights = rng.dirichlet(np.ones(3), size=count)
    weights[::3, 2] = 0.0
    weights[::9] = np.eye(3)[rng.integers(3, size=len(weights[::9]))]
    weights /= weights.sum(axis=1, keepdims=True)
    points = np.einsum("nk,nki->ni", weights, corners[rng.integers(len(corners), size=count)])
    for step in range(3):
        moved = rng.random(count) < 0.8 - 0.2 * step
        points[moved] = step_towards(points[moved], rng.normal(size=(int(moved.sum()), 3)))
    return points


@pytest.mark.parametrize(("scale", "offset"), [(1.0, 0.0), (1e-3, 1.0), (1.0, 1e5), (1e12, -1e12), (1e-150, 0.0)])
@pytest.mark.parametrize("name", MESHES)
def test_rays_from_surface_to_surface_are_decided_as_by_brute_force(rng, name, scale, offset):
    positions, triangles = MESHES[name](rng)
    scene = mesh_scene((positions * scale + offset, triangles))
    caster = raytracer.build(scene)
    corners = scene.meshes[0].positions[triangles]
    origins, ends = place_on_faces(rng, corners, COUNT), place_on_faces(rng, corners, COUNT)
    directions = ends - origins
    some = (directions != 0).any(axis=1)
    t_max = rng.choice([1.0, 1 - 2.0**-53, 1 - 2.0**-50, np.inf], size=COUNT)[some]
    arguments = origins[some], directions[some], 0.0, t_max
    true = replace(caster, offer=offer_all, smallest_pencil=None).closest_hit(*arguments)
    assert true.hit.mean() > 0.2
    for offer in (MatrixForm(caster.primitives), DenseOffer(caster.primitives, offer_all)):
        cast = replace(caster, offer=offer, smallest_pencil=None)
        assert_same_hits(cast.closest_hit(*arguments), true)
        np.testing.assert_array_equal(cast.any_hit(*arguments), true.hit)
