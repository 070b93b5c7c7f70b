"""The surface where curves are hit: on the strand, with the normals that Cycles gives it."""

from __future__ import annotations

import numpy as np
import pytest

import raytracer
from raytracer.surfaces.departing import depart
from raytracer.surfaces.surface import make_surface
from raytracer.surfaces.surface_tables import make_surface_tables
from tests.forbidding import forbid
from tests.raytracer.casting.curves.strands_fixtures import SHAPES


def hit_strand(shape: str, count: int = 500, seed: int = 1):
    """Return the caster, surface, rays and hits of rays around a bent strand."""
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.normal(size=(6, 3)) * 0.3, axis=0)
    curves = raytracer.Curves(points, np.linspace(0.1, 0.02, 6), [0, 6], shape=shape)
    scene = raytracer.Scene(curves=curves)
    caster = raytracer.build(scene)
    origins = rng.normal(size=(count, 3)) * 2.0
    directions = points[rng.integers(6, size=count)] + rng.normal(size=(count, 3)) * 0.05 - origins
    hits = caster.closest_hit(origins, directions)
    rows = np.flatnonzero(hits.hit)
    rays = raytracer.Rays(origins, directions, np.zeros(count), np.full(count, np.inf)).select(rows)
    tables = make_surface_tables(scene, caster.geometry, smooth_normals=False, uvs=False)
    return caster, make_surface(tables, rays, hits.select(rows)), rays, hits.select(rows)


@pytest.mark.parametrize("shape", SHAPES)
def test_positions_on_curves_are_where_the_ray_is(shape: str) -> None:
    _, surface, rays, hits = hit_strand(shape)
    assert len(surface) > 100
    along = rays.origins + hits.distance[:, np.newaxis] * rays.directions
    assert np.abs(surface.position - along).max() < 1e-9
    assert (surface.position_error < 1e-12).all()


def test_normals_of_ribbons_are_those_of_round_strands() -> None:
    """v across, the rest towards the viewer, at right angles to the strand; the flat normal faces the ray."""
    _, surface, _, hits = hit_strand("ribbon")
    normal, tangent = surface.shading_normal, surface.tangent
    assert tangent is not None
    assert surface.across is not None
    unit = tangent / np.linalg.norm(tangent, axis=1)[:, np.newaxis]
    assert np.allclose(np.linalg.norm(normal, axis=1), 1.0)
    assert np.abs((normal * unit).sum(axis=1)).max() < 1e-12
    side = np.cross(unit, surface.outgoing)
    side /= np.linalg.norm(side, axis=1)[:, np.newaxis]
    assert np.allclose((normal * side).sum(axis=1), surface.across)
    assert ((normal * surface.outgoing).sum(axis=1) >= -1e-12).all()
    assert np.allclose(surface.geometric_normal, surface.outgoing)
    assert surface.front.all()
    assert np.array_equal(surface.across, hits.barycentric[:, 1])
    assert surface.across.min() < -0.8 < 0.8 < surface.across.max()


def test_ribbons_are_as_wide_as_their_strand() -> None:
    """The hit lies |v| r beside the centre line, on the side of tangent x outgoing."""
    curves = raytracer.Curves([(0, 0, 0), (0, 0, 1), (0, 0, 2)], [0.1, 0.1, 0.1], [0, 3])
    scene = raytracer.Scene(curves=curves)
    caster = raytracer.build(scene)
    x = np.array([-0.0999, -0.05, 0.0, 0.05, 0.0999])
    origins = np.stack([x, np.full(5, -2.0), np.full(5, 0.7)], axis=1)
    rays = raytracer.Rays(origins, np.tile((0.0, 1.0, 0.0), (5, 1)), np.zeros(5), np.full(5, np.inf))
    hits = caster.closest_hit(rays.origins, rays.directions)
    surface = make_surface(make_surface_tables(scene, caster.geometry, False, False), rays, hits)
    assert surface.across is not None
    assert np.allclose(surface.across, x / 0.1)
    assert np.allclose(surface.shading_normal, np.stack([x / 0.1, -np.sqrt(1 - (x / 0.1) ** 2), 0 * x], axis=1))
    assert surface.tangent is not None
    assert np.allclose(surface.tangent[:, :2], 0.0)
    assert (surface.tangent[:, 2] > 0).all()


@pytest.mark.parametrize("shape", SHAPES)
def test_rays_that_leave_a_curve_do_not_meet_it_where_they_start(shape: str) -> None:
    caster, surface, _, _ = hit_strand(shape, count=1500)
    rng = np.random.default_rng(4)
    directions = rng.normal(size=(len(surface), 3))
    rays = depart(surface, directions)
    hits = caster.closest_hit(rays.origins, rays.directions, rays.t_min, rays.t_max)
    away = hits.distance * np.linalg.norm(directions, axis=1)
    # Inside a bend, what grazes is soon met again.
    near = hits.hit & (away < (1e-9 if shape == "thick" else 0.0399))
    assert not near.any(), away[near]


def test_a_scene_without_curves_asks_for_none(monkeypatch: pytest.MonkeyPatch) -> None:
    forbid(
        monkeypatch,
        "pack_strands",
        "CurveCaster",
        "CurveQuery",
        "build_curve_tree",
        "find_meetings",
        "describe_strands",
    )
    camera = raytracer.Camera([(1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 5), (0, 0, 0, 1)])
    ball, light = raytracer.Spheres([(0, 0, 0)], [1.0]), raytracer.SunLight((0, 0, 1), 1.0)
    scene = raytracer.Scene(spheres=ball, lights=[light], camera=camera)
    assert raytracer.render(scene, 8, 8, samples=1)["Combined"].any()


def test_other_hits_have_no_strand() -> None:
    curves = raytracer.Curves([(0, 0, 0), (0, 0, 1)], [0.1, 0.1], [0, 2])
    scene = raytracer.Scene(curves=curves, spheres=raytracer.Spheres([(3, 0, 0)], [1.0]))
    caster = raytracer.build(scene)
    rays = raytracer.Rays(
        np.array([(3.0, -5, 0), (0, -5, 0.5)]), np.tile((0.0, 1, 0), (2, 1)), np.zeros(2), np.full(2, np.inf)
    )
    hits = caster.closest_hit(rays.origins, rays.directions)
    surface = make_surface(make_surface_tables(scene, caster.geometry, False, False), rays, hits)
    assert surface.along is not None
    assert surface.across is not None
    assert surface.tangent is not None
    assert (surface.along[0], np.isnan(surface.across[0]), surface.tangent[0].tolist()) == (0.0, True, [0, 0, 0])
    assert 0.4 < surface.along[1] < 0.6
    assert surface.material.tolist() == [0, 0]
    only = raytracer.Scene(spheres=scene.spheres)
    caster = raytracer.build(only)
    hits = caster.closest_hit(rays.origins[:1], rays.directions[:1])
    surface = make_surface(make_surface_tables(only, caster.geometry, False, False), rays.select([0]), hits)
    assert surface.tangent is surface.along is surface.across is None
