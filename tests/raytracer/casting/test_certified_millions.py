"""Certified hits equal exact arithmetic, for millions of rays: the slow tier, and the oracle that makes it feasible.

`pytest -m slow -s tests/raytracer/casting/test_certified_millions.py` shows the progress; MILLIONS=0.1 in the
environment runs a tenth of the rays. About 100 thousand random rays, 15 thousand rays at edges and 10 thousand at
vertices a second (one core, shared; a tenth of that through shells one ulp apart): ten minutes in all.
"""

import os
from fractions import Fraction

import numpy as np
import pytest
from tqdm import tqdm

from raytracer.casting import matrix_form
from tests import meshes
from tests.oracle import certifying_oracle, exact_oracle
from tests.oracle.judging import build_with, mesh_scene

SHARE = float(os.environ.get("MILLIONS", "1"))
CHUNK = 20_000
FAR = (148376.0, 1234.0, -223423.0)
MESHES = {
    "icosphere": (meshes.make_icosphere(1), (0.0, 0.0, 0.0)),
    "icosphere far away": (meshes.make_icosphere(1, centre=FAR), FAR),
    "torus": (meshes.make_torus(10, 6), (0.0, 0.0, 0.0)),
    "needle lens": (meshes.make_needle_lens(), (0.0, 0.0, 0.0)),
    "nested shells": (meshes.make_nested_shells(6), (0.0, 0.0, 0.0)),
}
# Rays in millions, each: the sum over the meshes is 10 random, 1 at edges and 1 at vertices.
RAYS = {"random": 2.0, "edges": 0.2, "vertices": 0.2}


def make_rays(aim, mesh, centre, generator, count):
    """Rays from around the mesh's centre, half of them with origins of few digits."""
    positions, triangles = mesh
    origins = generator.uniform(-1.2, 1.2, (count, 3)) + centre
    origins[::2] = np.round(origins[::2] * 1024) / 1024
    if aim == "random":
        return origins, generator.normal(size=(count, 3))
    corners = positions[triangles[generator.integers(len(triangles), size=count)]]
    share = generator.random((count, 1)) if aim == "edges" else 0.0
    return meshes.aim(origins, corners[:, 0] * (1 - share) + corners[:, 1] * share)


def make_casters(mesh):
    """With each way that rays without order may take; they take turns."""
    return [build_with(accelerator, mesh_scene(mesh)) for accelerator in ("bvh", "dense", "matrix_form")]


@pytest.mark.slow
@pytest.mark.parametrize("aim", RAYS)
@pytest.mark.parametrize("name", MESHES)
def test_hits_of_millions_of_rays_equal_exact_arithmetic(name, aim, monkeypatch):
    monkeypatch.setattr(matrix_form, "MET_SHARE", 0.0)  # what float32 settles there is looked at first, always
    mesh, centre = MESHES[name]
    casters, generator = make_casters(mesh), np.random.default_rng(len(name) + len(aim))
    count, by_integers = round(RAYS[aim] * 1e6 * SHARE), 0
    with tqdm(total=count, desc=f"{name}, {aim}", unit="ray", unit_scale=True) as progress:
        for first in range(0, count, CHUNK):
            rays = make_rays(aim, mesh, centre, generator, min(CHUNK, count - first))
            by_integers += certifying_oracle.judge_many(casters[first // CHUNK % len(casters)], *rays)
            progress.update(len(rays[0]))
            progress.set_postfix({"judged in integers": f"{by_integers / progress.n:.2%}"})


# The oracle itself --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("aim", RAYS)
@pytest.mark.parametrize("name", MESHES)
def test_certificates_agree_with_integers(name, aim):
    mesh, centre = MESHES[name]
    rays = make_rays(aim, mesh, centre, np.random.default_rng(7), 200)
    corners = mesh[0][mesh[1]]
    certificate, exact = certifying_oracle.certify(*rays, corners), exact_oracle.closest_hit(*rays, corners)
    known = certificate.index != certifying_oracle.UNKNOWN
    np.testing.assert_array_equal(certificate.index[known], exact.index[known])
    # Random rays are what certificates are for; shells one ulp apart take integers.
    assert aim != "random" or name == "nested shells" or known.mean() > 0.95


def as_fractions(vector):
    return [Fraction(float(x)) for x in vector]


def exact_determinant(u, v, w):
    """u . (v x w) of vectors of Fractions."""
    return sum(u[i] * (v[j] * w[k] - v[k] * w[j]) for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)))


def minus(p, q):
    return [x - y for x, y in zip(p, q, strict=True)]


@pytest.mark.parametrize("offset", [0.0, 1e3, 1e6])
def test_side_products_and_plane_distances_are_within_their_bounds(rng, offset):
    corners = rng.normal(size=(40, 3, 3)) + offset
    origins, directions = rng.normal(size=(40, 3)) + offset, rng.normal(size=(40, 3))
    edges, bound = certifying_oracle.side_products(origins, directions, corners)
    t, t_error = certifying_oracle.plane_distances(origins, directions, corners)
    largest = 0.0
    for ray in range(40):
        o, d = as_fractions(origins[ray]), as_fractions(directions[ray])
        p = [minus(as_fractions(corner), o) for corner in corners[ray]]
        for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
            off = abs(Fraction(float(edges[k, ray, ray])) - exact_determinant(d, p[i], p[j]))
            largest = max(largest, float(off / Fraction(float(bound[ray, 0]))))
        sides = minus(p[1], p[0]), minus(p[2], p[0])
        exact = exact_determinant(p[0], *sides) / exact_determinant(d, *sides)
        assert abs(as_fraction(t[ray]) - exact) <= as_fraction(t_error[ray])
    assert largest <= 1
    # One bound serves all triangles of a ray, but it is no idle one.
    assert largest > 1 / 256


def as_fraction(long_double):
    """The exact value of a long double: the sum of two floats."""
    high = float(long_double)
    return Fraction(high) + Fraction(float(long_double - high))


def test_judge_of_millions_refuses_wrong_hits(rng):
    """The judge on hits that are wrong in one way each: another triangle, one ulp off without a wider bound, a miss."""

    class Lying:
        def __init__(self, caster, name, lie):
            self.caster, self.scene, self.name, self.lie = caster, caster.scene, name, lie

        def closest_hit(self, *rays):
            hits = self.caster.closest_hit(*rays)
            values = getattr(hits, self.name)
            row = np.flatnonzero(hits.hit)[0]
            values[row] = self.lie(values[row])
            return hits

        def any_hit(self, *rays):
            return self.caster.any_hit(*rays)

    mesh, centre = MESHES["icosphere"]
    caster, rays = build_with("bvh", mesh_scene(mesh)), make_rays("random", mesh, centre, rng, 100)
    certifying_oracle.judge_many(caster, *rays)
    lies = {
        "primitive": lambda index: index + 1,
        "instance": lambda index: -1,
        "distance": lambda t: np.nextafter(t, np.inf) + np.spacing(t),
        "distance_error": lambda error: 0.0,
    }
    for name, lie in lies.items():
        with pytest.raises(AssertionError):
            certifying_oracle.judge_many(Lying(caster, name, lie), *rays)
