"""Lamps against closed forms of irradiance, and their two views (sampled, met by a ray) against each other.

Sampled irradiance is integrated by a midpoint grid over the unit square: for smooth integrands its error falls with the
square of the step, 1 / N^2, and is checked to do so by doubling N.
"""

import numpy as np
import pytest

import raytracer
from raytracer.casting.geometry import pack_geometry
from raytracer.lights.area_lights import area_spread_factor
from raytracer.lights.emitter_table import make_emitters
from raytracer.lights.emitters import emitter_density, pick_emitters, sample_picked
from raytracer.lights.light_shapes import SMALL_SOLID_ANGLE, rectangle_solid_angle
from raytracer.lights.lights import evaluate_light, has_extent, sample_light, spot_attenuation
from raytracer.surfaces.surface import Surface
from raytracer.surfaces.surface_tables import make_surface_tables

GRID = 512
GRID_ERROR = 1.0 / GRID**2
UP = np.array([0.0, 0.0, 1.0])


def grid_pairs(count=GRID):
    middle = (np.arange(count) + 0.5) / count
    return np.stack(np.meshgrid(middle, middle, indexing="ij"), axis=-1).reshape(-1, 2)


def irradiance(light, position, normal=UP, count=GRID):
    """E = integral of L cos over the light, by the light's own sampling."""
    pairs = grid_pairs(count)
    samples = sample_light(light, np.broadcast_to(np.asarray(position, float), (len(pairs), 3)), pairs)
    cosine = np.maximum(samples.direction @ np.asarray(normal, float), 0.0)
    return (samples.weight * cosine[:, None]).mean(axis=0)


def polygon_irradiance(position, corners, radiance):
    """Lambert's formula for a polygon wholly above the plane z = position z: E = L / 2 sum theta_i gamma_i . n."""
    vectors = np.asarray(corners) - position
    vectors /= np.linalg.norm(vectors, axis=1)[:, None]
    total = 0.0
    for a, b in zip(vectors, np.roll(vectors, -1, axis=0), strict=True):
        normal = np.cross(a, b)
        total += np.arctan2(np.linalg.norm(normal), a @ b) * normal[2] / np.linalg.norm(normal)
    return abs(total) / 2.0 * radiance


LIGHTS = {
    "disk": raytracer.PointLight((0, 0, 2), (10, 20, 5), radius=0.5),
    "ball": raytracer.PointLight((0, 0, 2), (10, 20, 5), radius=0.5, soft_falloff=False),
    "spot disk": raytracer.SpotLight((0, 0, 2), 10, radius=0.3, spot_size=1.2, spot_blend=0.3),
    "spot ball": raytracer.SpotLight((0, 0, 2), 10, radius=0.3, soft_falloff=False, spot_size=1.2, spot_blend=0.3),
    "sun": raytracer.SunLight((0.3, 0, 1), 3, angle=0.5),
    "wide sun": raytracer.SunLight((0.3, 0, 1), 3, angle=np.pi),
    "rectangle": raytracer.AreaLight((0, 0, 2), (1, 0, 0), (0, 2, 0), 10),
    "ellipse": raytracer.AreaLight((0, 0, 2), (1, 0, 0), (0, 2, 0), 10, shape="ellipse"),
    "spread": raytracer.AreaLight((0, 0, 2), (1, 0, 0), (0, 2, 0), 10, spread=1.0),
    "spread ellipse": raytracer.AreaLight((0, 0, 2), (1, 0, 0), (0, 2, 0), 10, shape="ellipse", spread=1.0),
    "small rectangle": raytracer.AreaLight((0, 0, 2), (1e-3, 0, 0), (0, 2e-3, 0), 10),
}
POSITIONS = ([0.3, -0.2, 0.0], [1.2, 0.7, 0.5], [0.0, 0.0, 0.0], [0.1, 0.1, 1.7])


@pytest.mark.parametrize("position", POSITIONS)
@pytest.mark.parametrize("name", LIGHTS)
def test_evaluate_light_sees_what_sample_light_sampled(name, position):
    light = LIGHTS[name]
    pairs = np.random.default_rng(1).random((2000, 2))
    positions = np.broadcast_to(np.array(position), (2000, 3))
    samples = sample_light(light, positions, pairs)
    taken = samples.density > 0
    hits = evaluate_light(light, positions[taken], samples.direction[taken])
    # A sample on the very border of the shape may be missed by rounding; none of these 2000 is.
    np.testing.assert_allclose(hits.density, samples.density[taken], rtol=1e-7)
    np.testing.assert_allclose(hits.distance, samples.distance[taken], rtol=1e-7)
    np.testing.assert_allclose(hits.radiance, samples.weight[taken] * samples.density[taken, None], rtol=1e-7)
    assert not samples.weight[~taken].any()


@pytest.mark.parametrize("name", [name for name in LIGHTS if name != "small rectangle"])
def test_evaluate_light_density_integrates_to_the_share_of_samples_taken(name):
    light, count = LIGHTS[name], 400_000
    rng = np.random.default_rng(2)
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    position = np.broadcast_to([0.3, -0.2, 0.9], (count, 3))
    values = 4 * np.pi * evaluate_light(light, position, directions).density
    taken = (sample_light(light, position, rng.random((count, 2))).density > 0).mean()
    error = np.sqrt((values.var() + taken * (1 - taken)) / count)
    assert abs(values.mean() - taken) < 5 * error


def test_point_light_irradiance_is_intensity_times_cosine_over_distance_squared():
    light = raytracer.PointLight((1, 2, 3), (100, 50, 25))
    position = np.array([0.5, -1.0, 0.25])
    offset = np.array([1, 2, 3]) - position
    distance = np.linalg.norm(offset)
    expected = np.array([100, 50, 25]) / (4 * np.pi) * offset[2] / distance**3
    np.testing.assert_allclose(irradiance(light, position), expected, rtol=1e-13)


def test_ball_light_irradiance_is_that_of_its_centre():
    """A ball wholly above the horizon lights as a point of its power: L pi sin^2 cos = P / (4 pi d^2) cos."""
    light = raytracer.PointLight((1, 0, 2), 100, radius=0.8, soft_falloff=False)
    expected = 100 / (4 * np.pi) * 2 / 5**1.5
    np.testing.assert_allclose(irradiance(light, [0, 0, 0]), expected, rtol=GRID_ERROR)


def test_disk_light_irradiance_on_its_axis_is_that_of_a_facing_disk():
    """E = pi L r^2 / (r^2 + d^2) with L = P / (4 pi^2 r^2)."""
    light = raytracer.PointLight((0, 0, 2), 100, radius=0.8)
    expected = 100 / (4 * np.pi) / (0.8**2 + 4)
    np.testing.assert_allclose(irradiance(light, [0, 0, 0]), expected, rtol=GRID_ERROR)


@pytest.mark.parametrize("inside", [[0.0, 0.0, 1.9], [0.0, 0.0, 2.0], [0.3, 0.1, 2.2]])
def test_ball_light_seen_from_inside_lights_a_plane_by_pi_times_its_radiance(inside):
    light = raytracer.PointLight((0, 0, 2), 100, radius=0.5, soft_falloff=False)
    expected = np.pi * 100 / (4 * np.pi**2 * 0.25)
    np.testing.assert_allclose(irradiance(light, inside), expected, rtol=GRID_ERROR)


@pytest.mark.parametrize("angle", [0.0, 1e-6, 0.01, 0.5, 2.0])
def test_sun_irradiance_is_its_strength_times_the_cosine(angle):
    light = raytracer.SunLight((0.3, 0.1, 1), (1, 2, 3), angle=angle)
    cosine = 1 / np.sqrt(1.1)
    np.testing.assert_allclose(irradiance(light, [0, 0, 0]), cosine * np.array([1, 2, 3]), rtol=4 * GRID_ERROR)


@pytest.mark.parametrize("height", [0.05, 0.5, 2.0, 30.0])
def test_rectangle_light_irradiance_is_lamberts_formula(height):
    light = raytracer.AreaLight((0.2, 0.1, height), (1, 0.2, 0), (-0.4, 2, 0), 10)
    u, v, centre = np.array([1, 0.2, 0]) / 2, np.array([-0.4, 2, 0]) / 2, np.array([0.2, 0.1, height])
    corners = [centre - u - v, centre + u - v, centre + u + v, centre - u + v]
    area = np.linalg.norm(2 * u) * np.linalg.norm(2 * v)
    expected = polygon_irradiance(np.zeros(3), corners, 10 / (np.pi * area))
    # The lens of a rectangle close by bends the grid: its error is 1 / N^2 of the largest cosine's slope.
    np.testing.assert_allclose(irradiance(light, [0, 0, 0])[0], expected, rtol=40 * GRID_ERROR)


def test_disk_area_light_irradiance_on_its_axis():
    light = raytracer.AreaLight((0, 0, 2), (1, 0, 0), (0, 1, 0), 10, shape="ellipse")
    radiance = 10 / (np.pi * np.pi / 4)
    np.testing.assert_allclose(irradiance(light, [0, 0, 0])[0], np.pi * radiance * 0.25 / 4.25, rtol=GRID_ERROR)


def test_area_light_shines_to_one_side_only():
    light = LIGHTS["rectangle"]
    assert irradiance(light, [0, 0, 2.5], -UP)[0] == 0
    above = evaluate_light(light, np.array([[0, 0, 3.0]]), np.array([[0, 0, -1.0]]))
    assert above.density[0] == 0
    assert np.isinf(above.distance[0])


@pytest.mark.parametrize("spread", [1e-5, 0.02, 0.03, 0.04, 1.0, 2.5, 3.1])
def test_area_spread_keeps_the_power(spread):
    """integral over the hemisphere of factor cos = pi; exact in s = tan x, in which the factor is linear."""
    light = raytracer.AreaLight((0, 0, 0), (1, 0, 0), (0, 1, 0), 1, spread=spread)
    nodes, weights = np.polynomial.legendre.leggauss(400)
    angle = (nodes + 1) / 2 * spread / 2
    factor = area_spread_factor(light, np.cos(angle))
    total = 2 * np.pi * (weights * factor * np.cos(angle) * np.sin(angle)).sum() * spread / 4
    # cos x holds tan x to u / x^2 only: what a direction tells of an angle.
    np.testing.assert_allclose(total, np.pi, rtol=1e-9 + 2e-16 / spread**2 * 100)


def test_area_light_without_spread_is_parallel():
    light = raytracer.AreaLight((0, 0, 2), (1, 0, 0), (0, 2, 0), 10, spread=0.0)
    np.testing.assert_allclose(irradiance(light, [0.4, 0.9, 0.0])[0], 10 / 2, rtol=1e-14)
    assert irradiance(light, [0.6, 0.0, 0.0])[0] == 0
    assert not has_extent(light)


def test_spot_attenuation_is_smoothstep_between_rim_and_cone():
    light = raytracer.SpotLight((0, 0, 0), 1, spot_size=1.0, spot_blend=0.4)
    angles = np.array([0.0, 0.2, 0.4, 0.45, 0.4999, 0.5001, 1.0, 3.0])
    towards_light = np.stack([np.sin(angles), np.zeros(8), np.cos(angles)], axis=1)
    edge = np.cos(0.5)
    x = np.clip((np.cos(angles) - edge) / (0.4 * (1 - edge)), 0, 1)
    np.testing.assert_allclose(spot_attenuation(light, towards_light), x * x * (3 - 2 * x), atol=1e-15)
    hard = raytracer.SpotLight((0, 0, 0), 1, spot_size=1.0, spot_blend=0.0)
    np.testing.assert_array_equal(spot_attenuation(hard, towards_light), angles < 0.5)


def test_spot_attenuation_follows_a_scaled_lamp():
    """Twice as wide along x: the cone's border lies where tan = 2 tan(size / 2)."""
    light = raytracer.SpotLight((0, 0, 0), 1, spot_size=1.0, spot_blend=0.0, world_from_light=np.diag([2.0, 1, 1]))
    border = np.arctan(2 * np.tan(0.5))
    for angle, lit in ((border - 1e-9, 1.0), (border + 1e-9, 0.0)):
        assert spot_attenuation(light, np.array([[np.sin(angle), 0, np.cos(angle)]]))[0] == lit


def test_rectangle_solid_angle_is_exact_for_a_cubes_side():
    low, high = np.array([[-1.0, -1]]), np.array([[1.0, 1]])
    solid_angle = rectangle_solid_angle(np.array([[0, 0, 1.0]]), low, high)
    np.testing.assert_allclose(solid_angle, 4 * np.pi / 6, rtol=1e-15)
    assert solid_angle[0] > SMALL_SOLID_ANGLE
    far = rectangle_solid_angle(np.array([[0, 0, 1e3]]), low, high)
    # 4 asin(1 / (1 + z^2)); four angles of order pi were subtracted to get here.
    np.testing.assert_allclose(far, 4 * np.arcsin(1 / (1 + 1e6)), atol=16 * np.finfo(float).eps)
    assert far[0] < SMALL_SOLID_ANGLE


def surface_points(positions):
    count = len(positions)
    up, index = np.broadcast_to(UP, (count, 3)), np.zeros(count, np.int32)
    return Surface(positions, np.zeros(count), up, up, up, np.ones(count, bool), index, index, index)


def make_scene_emitters(scene, radiance):
    return make_emitters(make_surface_tables(scene, pack_geometry(scene), False, False), np.asarray(radiance, float))


def test_emissive_triangles_light_as_lamberts_formula():
    corners = np.array([[0.3, -0.5, 1.0], [1.5, 0.2, 1.4], [0.1, 1.0, 2.0]])
    mesh = raytracer.Mesh([*corners, [9, 9, 9]], [[0, 1, 2], [0, 0, 3]], material=1)
    scene = raytracer.Scene(meshes=[mesh], materials=[raytracer.Material()] * 2)
    emitters = make_scene_emitters(scene, [[0, 0, 0], [2, 4, 0]])
    assert len(emitters.instance) == 1  # the triangle without area is never picked
    pairs = grid_pairs()
    surface = surface_points(np.zeros((len(pairs), 3)))
    samples = sample_picked(emitters, surface, pick_emitters(emitters, np.full(len(pairs), 0.5)), pairs)
    cosine = np.maximum(samples.direction[:, 2], 0)
    expected = polygon_irradiance(np.zeros(3), corners, 1.0) * np.array([2, 4, 0])
    # sqrt(u) bends the grid at u = 0: the midpoint rule then converges as N^-3/2.
    np.testing.assert_allclose((samples.weight * cosine[:, None]).mean(axis=0), expected, rtol=GRID**-1.5)


def test_emissive_sphere_lights_as_a_point_of_its_power():
    scene = raytracer.Scene(spheres=[raytracer.Spheres([[1, 0, 2]], [0.8])])
    emitters = make_scene_emitters(scene, [[3, 3, 3]])
    pairs = grid_pairs()
    samples = sample_picked(
        emitters, surface_points(np.zeros((len(pairs), 3))), pick_emitters(emitters, np.full(len(pairs), 0.5)), pairs
    )
    value = (samples.weight[:, 0] * samples.direction[:, 2]).mean()
    np.testing.assert_allclose(value, 3 * np.pi * 0.64 / 5 * 2 / np.sqrt(5), rtol=GRID_ERROR)


def test_sample_emitters_picks_by_power_and_reports_the_density_it_used():
    rng = np.random.default_rng(3)
    mesh = raytracer.Mesh(rng.normal(size=(60, 3)) + 3 * UP, np.arange(60).reshape(20, 3), material=np.arange(20) % 2)
    ball = raytracer.Spheres(rng.normal(size=(3, 3)) + np.array([4, 0, 4]), [0.2, 0.3, 0.4], material=1)
    scene = raytracer.Scene(meshes=[mesh], spheres=[ball], materials=[raytracer.Material()] * 2)
    emitters = make_scene_emitters(scene, [[1, 1, 1], [5, 0, 1]])
    count = 4000
    surface = surface_points(rng.normal(size=(count, 3)))
    choice = rng.random(count)
    samples = sample_picked(emitters, surface, pick_emitters(emitters, choice), rng.random((count, 2)))
    picked = np.searchsorted(emitters.cumulative, choice, side="right")
    density = emitter_density(
        emitters, surface.position, samples.direction, emitters.instance[picked], emitters.primitive[picked]
    )
    # One takes t from the sampled point, the other from the plane, where the cosine divides twice; none is below 1e-2.
    np.testing.assert_allclose(density, samples.density, rtol=16 * np.finfo(np.float64).eps * 1e4)
    np.testing.assert_allclose(np.diff(emitters.cumulative).sum() + emitters.cumulative[0], 1.0)
    single = raytracer.build(raytracer.Scene(meshes=[raytracer.Mesh(mesh.positions[:3], [[0, 1, 2]])]))
    first = (emitters.instance[picked] == 0) & (emitters.primitive[picked] == 0)
    assert first.any()
    blocked = single.any_hit(surface.position[first], samples.direction[first], 0.0, samples.distance[first])
    assert not blocked.any()  # a shadow ray ends before the emitter it aims at


@pytest.mark.parametrize("name", ["disk", "ball", "sun", "rectangle", "ellipse"])
def test_midpoint_grid_converges_with_the_square_of_its_step(name):
    """What GRID_ERROR rests on: doubling N takes the change at least to a third (a quarter in the limit)."""
    coarse, middle, fine = (irradiance(LIGHTS[name], (0.3, 0.2, 0), count=count)[0] for count in (32, 64, 128))
    rounding = 128**2 * np.finfo(np.float64).eps * fine
    assert abs(fine - middle) <= max(abs(middle - coarse) / 3, rounding)
    assert abs(fine - middle) <= fine / 64**2
