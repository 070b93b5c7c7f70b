"""Light bent by glass: closed forms of a pane and of a ball's axis, rays shot by hand, and what is in the way."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import raytracer
from raytracer.bsdfs.fresnel import dielectric_reflectance, refract
from raytracer.casting.rays import Rays
from raytracer.caustics import chains
from raytracer.caustics.chains import find_seeds, find_ways
from raytracer.surfaces.departing import depart
from raytracer.surfaces.surface import make_surface
from tests.raytracer.caustics.glass_scenes import (
    UP,
    join_ends,
    look_through,
    make_ball,
    make_glass,
    make_pane,
    make_waves,
    open_glass,
)

# Newton's last step leaves the misses at rounding, some 2^-50; the solution is that times the size of the system.
ROUNDING = 1e-11


@pytest.fixture(autouse=True)
def _limit_nothing(monkeypatch):
    monkeypatch.setattr(chains, "MOST_FOCUS", np.inf)


def solve_pane(offset, gap, thickness, ior):
    """Return the angle outside the glass at which light comes `offset` to the side; by halving an interval."""
    low, high = 0.0, np.arcsin(min(ior, 1.0))

    def reach(angle):
        return gap * np.tan(angle) + thickness * np.tan(np.arcsin(np.sin(angle) / ior))

    for _ in range(100):
        middle = (low + high) / 2.0
        low, high = (low, middle) if reach(middle) > offset else (middle, high)
    return low


@pytest.mark.parametrize("ior", [1.5, 1.0 / 1.5, 2.4])
def test_light_below_a_pane_is_that_of_snell_and_fresnel(ior):
    """Irradiance I sin a / (r dr/da) of a point source, r = (h - t) tan a + t tan b, sin a = ior sin b."""
    thickness, height = 0.5, 3.0
    points = np.array([(r * 0.8, r * 0.6, 0.0) for r in np.linspace(0.3, 2.0, 9)])
    way, _ = look_through(make_pane(1.0, 1.0 + thickness), make_glass(ior=ior), points, (0, 0, height))
    assert_array_equal(way.rows, np.arange(9))
    offset, gap = np.linalg.norm(points, axis=1), height - thickness
    angle = np.array([solve_pane(r, gap, thickness, ior) for r in offset])
    inside = np.arcsin(np.sin(angle) / ior)
    slope = gap / np.cos(angle) ** 2 + thickness * np.cos(angle) / (ior * np.cos(inside) ** 3)
    assert_allclose(way.spread * way.direction[:, 2], np.sin(angle) / (offset * slope), rtol=ROUNDING)
    passed = (1.0 - dielectric_reflectance(np.cos(angle), np.array(ior))) ** 2
    assert_allclose(way.share, np.repeat(passed[:, np.newaxis], 3, axis=1), rtol=ROUNDING)
    assert_allclose(way.direction[:, 2], np.cos(angle), rtol=ROUNDING)


def test_a_pane_leaves_the_light_of_a_distant_source_as_it_is():
    way, _ = look_through(make_pane(1.0, 1.5), make_glass(), [(0.1, 0.2, 0), (3, -1, 0)], np.array([0.6, 0, 0.8]), True)
    assert_allclose(way.spread, 1.0, rtol=ROUNDING)
    assert_allclose(way.direction, [[0.6, 0, 0.8]] * 2, rtol=ROUNDING, atol=ROUNDING)


def find_axial_spread(near, far, radius, ior):
    """1 / B^2 of the matrix ((A, B), (C, D)) of a ball for rays along its axis (Gaussian optics)."""

    def go(distance):
        return np.array([[1.0, distance], [0.0, 1.0]])

    def bend(before, behind, curvature):
        return np.array([[1.0, 0.0], [(before - behind) * curvature / behind, before / behind]])

    matrix = go(far) @ bend(ior, 1.0, -1.0 / radius) @ go(2 * radius) @ bend(1.0, ior, 1.0 / radius) @ go(near)
    return matrix[0, 1] ** -2


def test_light_on_the_axis_of_a_ball_comes_to_that_of_gaussian_optics():
    """Triangles flatten the ball by the square of their size."""
    radius, middle, height, error = 0.5, 1.5, 4.0, []
    for segments in (16, 64):
        ball = make_ball(radius, middle * UP, segments)
        way, _ = look_through(ball, make_glass(), [(0, 0, 0)], height * UP)
        exact = find_axial_spread(middle - radius, height - middle - radius, radius, 1.5)
        error.append(abs(way.spread[0] / exact - 1.0))
        assert_allclose(way.share, 0.96**2, rtol=0.1 / segments)
    assert error[0] < 0.1
    assert error[1] < error[0] / 8.0


SQUEEZED = np.array([[1.1, 0.2, 0, 0], [0, 0.8, 0, 0], [0, 0, 1.3, 1.5], [0, 0, 0, 1.0]])
SCENES = {
    "ball": (make_ball(0.5, 1.5 * UP, 16), np.eye(4)),
    "waves": (make_waves(), np.eye(4)),
    "squeezed ball": (make_ball(0.5, 0.0 * UP, 16), SQUEEZED),
    "mirrored waves": (make_waves(), np.diag([-1.0, 1.0, 1.0, 1.0])),
}


@pytest.mark.parametrize("distant", [False, True])
@pytest.mark.parametrize("name", SCENES)
def test_spread_is_that_of_rays_shot_beside_the_way(name, distant):
    """Rays that leave the lit point a little beside the way miss the light by the inverse of what J says."""
    mesh, matrix = SCENES[name]
    light = np.array([0.1, 0.05, 1.0]) / np.linalg.norm([0.1, 0.05, 1.0]) if distant else np.array([0.3, 0.2, 4.0])
    points = np.stack([np.linspace(-0.3, 0.4, 12), np.full(12, 0.05), np.zeros(12)], axis=1)
    way, casters = look_through(mesh, make_glass(), points, light, distant, matrix)
    assert len(way.rows) > 6
    step = 1e-6
    for row, spread, direction, towards in zip(way.rows, way.spread, way.direction, way.towards, strict=True):
        sides, across = (list_sides(axis) for axis in (direction, towards))
        rays = [direction, *(direction + sign * step * side for side in sides for sign in (1, -1))]
        ends = shoot(casters, np.tile(points[row], (5, 1)), np.array(rays), 1.5, light, towards, distant)
        assert_allclose(ends[0], light, atol=1e-12)
        shifts = np.array([(ends[1] - ends[2]), (ends[3] - ends[4])]) / (2 * step)
        matrix_of_shifts = [[shift @ axis for axis in across] for shift in shifts]
        assert_allclose(spread, 1.0 / abs(np.linalg.det(matrix_of_shifts)), rtol=1e-8)


def list_sides(direction):
    first = np.cross(direction, [0.1, 1.0, 0.3])
    first /= np.linalg.norm(first)
    return first, np.cross(direction, first)


def shoot(casters, origins, directions, ior, light, towards, distant):
    """Return where refracted rays cross the plane of the light, or the directions they leave in."""
    rays = Rays(origins, directions, np.zeros(len(origins)), np.full(len(origins), np.inf))
    for eta in (ior, 1.0 / ior):
        surface = make_surface(casters.tables, rays, casters.cast(rays))
        side = np.where(surface.front, 1.0, -1.0)[:, np.newaxis]
        bent = refract(surface.outgoing, side * surface.shading_normal, np.full(len(origins), eta))
        rays = depart(surface, bent)
    if distant:
        return rays.directions
    away = ((light - rays.origins) @ towards) / (rays.directions @ towards)
    return rays.origins + away[:, np.newaxis] * rays.directions


def test_ways_through_two_objects_are_found_as_through_one():
    """Two panes of half the thickness bend light as one."""
    points = [(0.5, 0.3, 0.0), (1.5, -0.7, 0.0)]
    whole, _ = look_through(make_pane(1.0, 1.5), make_glass(), points, (0, 0, 3.0))
    low, high = make_pane(0.6, 0.85), make_pane(2.0, 2.25)
    both = raytracer.Mesh(
        np.concatenate([low.positions, high.positions]),
        np.concatenate([low.triangles, high.triangles + len(low.positions)]),
        normals=np.concatenate([low.normals, high.normals]),
    )
    split, _ = look_through(both, make_glass(), points, (0, 0, 3.0))
    assert_allclose(split.spread, whole.spread, rtol=ROUNDING)
    assert_allclose(split.direction, whole.direction, rtol=ROUNDING)
    assert_allclose(split.share, whole.share**2, rtol=ROUNDING)


def test_a_way_that_something_is_in_is_left_out():
    """A sheet below the pane stops what comes down beside the straight way."""
    pane, points, light = make_pane(1.0, 1.5), [(1.5, 0.0, 0.0)], (0, 0, 3.0)
    way, _ = look_through(pane, make_glass(), points, light)
    at = points[0] + way.direction[0] * (0.5 / way.direction[0, 2])
    corners = at + 1e-3 * np.array([(-1, -1, 0), (1, -1, 0), (0, 1.5, 0)])
    caster = raytracer.build(raytracer.Scene(meshes=[pane, raytracer.Mesh(corners, [(0, 1, 2)])]))

    def cast(rays):
        return caster.closest_hit(rays.origins, rays.directions, rays.t_min, rays.t_max, after=rays.after)

    casters, shade = open_glass(pane, make_glass())
    casters = replace(casters, cast=cast, is_caster=np.array([True, False]))
    ends = join_ends(points, light)
    seeds = find_seeds(casters, ends)
    assert seeds.count == 2  # the straight way is free
    assert not len(find_ways(casters, ends, seeds, shade)[0].rows)


def test_an_edge_that_is_met_is_one_point():
    casters, _ = open_glass(make_pane(1.0, 1.5), make_glass())
    assert_array_equal(find_seeds(casters, join_ends([(0, 0, 0), (0.3, 0.1, 0)], (0, 0, 3.0))).count, 2)


def test_where_no_glass_is_there_is_nothing_to_find():
    casters, shade = open_glass(make_ball(0.5, 1.5 * UP, 16), make_glass())
    ends = join_ends([(3, 0, 0), (0, 4, 0)], (0, 0, 4.0))
    seeds = find_seeds(casters, ends)
    assert_array_equal(seeds.count, 0)
    assert not find_ways(casters, ends, seeds, shade)


def test_focus_has_an_upper_bound(monkeypatch):
    """At the focus of a ball the light would be infinite."""
    radius, ior = 0.5, 1.5
    focus = radius * ior / (2 * (ior - 1.0)) - radius  # of parallel light, behind the surface
    ball = make_ball(radius, (focus + radius) * UP, 64)
    assert look_through(ball, make_glass(ior=ior), [(0, 0, 0)], UP, True)[0].spread[0] > 100.0
    monkeypatch.setattr(chains, "MOST_FOCUS", 16.0)
    assert look_through(ball, make_glass(ior=ior), [(0, 0, 0)], UP, True)[0].spread[0] == 16.0
    monkeypatch.setattr(chains, "MOST_FOCUS", 0.0)
    assert look_through(ball, make_glass(ior=ior), [(0, 0, 0)], UP, True)[0].spread[0] == chains.CYCLES_SPREAD
