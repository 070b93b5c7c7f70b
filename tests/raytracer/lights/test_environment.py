"""The world as a source of light, against closed forms: even, uneven, and all in one pixel."""

import dataclasses

import numpy as np
import pytest

import raytracer
from raytracer.lights.environment import (
    LARGEST_WIDTH,
    Environment,
    environment_density,
    evaluate_environment,
    list_world_samplers,
    make_environment,
)
from raytracer.sampling.direction_map import (
    find_equirectangular,
    make_direction_map,
    map_density,
    measure_cells,
    place_equirectangular,
    sample_map,
)
from raytracer.scene.lights import World
from raytracer.scene.programs import Image, Program, Register, Step
from raytracer.shading.light_path import LightPath

FRAME = (4, 3)
UP = np.array([0.0, 0.0, 1.0])
DIRECTION = Step("NEW_GEOMETRY Position")
# Standard errors of a mean: by chance beyond it once in two million tests.
SIGMAS = 5.0


def make_gradient():
    """L = 1 + z, in all channels."""
    steps = (
        DIRECTION,
        Step("VECT_MATH Value", (Register(0, "Position"), UP), {"operation": "DOT_PRODUCT"}),
        Step("MATH", (Register(1, "Value"), 1.0, 0.0), {"operation": "ADD"}),
        Step("VECT_MATH Vector", (np.ones(3), np.zeros(3), np.zeros(3), Register(2, "Value")), {"operation": "SCALE"}),
    )
    return World(Register(3, "Vector"), Program(steps))


def make_pixel_sun(width=64, height=32, row=26, column=9, power=5000.0):
    """One bright pixel in the dark, and the irradiance that it brings to a plane that faces up.

    Between latitudes a and b, over a range w of longitudes: integral cos = w (sin^2 b - sin^2 a) / 2.
    """
    pixels = np.zeros((height, width, 4), np.float32)
    pixels[row, column] = power
    low, high = ((row + step) / height * np.pi - np.pi / 2 for step in (0, 1))
    irradiance = power * 2 * np.pi / width * (np.sin(high) ** 2 - np.sin(low) ** 2) / 2
    return make_picture_world(pixels), irradiance


def make_picture_world(pixels, interpolation="Closest"):
    settings = {"image": Image(pixels), "interpolation": interpolation, "projection": "EQUIRECTANGULAR"}
    steps = (DIRECTION, Step("TEX_ENVIRONMENT", (Register(0, "Position"),), settings))
    return World(Register(1, "Color"), Program(steps))


def estimate_irradiance(environment, normal, count, seed=1):
    """Return independent estimates (n,) of the irradiance on a plane with `normal`, of the first channel: the sum of a
    sample of each way."""
    generator = np.random.default_rng(seed)
    normal = np.broadcast_to(normal, (count, 3))
    irradiance = np.zeros(count)
    for way in list_world_samplers(environment):
        directions = way(normal, generator.random((count, 2)))
        density = environment_density(environment, normal, directions)
        radiance = np.broadcast_to(evaluate_environment(environment, directions), (count, 3))[:, 0]
        irradiance += radiance * np.maximum((directions * normal).sum(axis=1), 0.0) / density
    return irradiance


def assert_mean(values, expected):
    assert abs(values.mean() - expected) <= SIGMAS * values.std(ddof=1) / np.sqrt(len(values))


def test_directions_and_pictures_are_inverse():
    u, v = np.random.default_rng(0).random((2, 1000))
    v = 0.1 + 0.8 * v  # towards the poles longitudes lose digits
    found = find_equirectangular(place_equirectangular(u, v))
    np.testing.assert_allclose(found, (u, v), atol=32 * np.finfo(float).eps)
    np.testing.assert_array_equal(find_equirectangular(np.array([[0.0, 0.0, -1.0]]))[1], [0.0])


def test_cells_fill_the_sphere():
    assert np.isclose(7 * measure_cells(5, 7).sum(), 4 * np.pi, rtol=1e-14)


def make_uneven_map():
    values = np.random.default_rng(3).random((6, 8)) ** 4
    values[2] = 0.0
    values[4, 3:6] = 0.0
    return make_direction_map(values)


def test_density_of_a_map_integrates_to_one():
    grid = make_uneven_map()
    assert np.isclose((grid.density * measure_cells(6, 8)).sum(), 1.0, rtol=1e-14)


def test_cells_of_a_map_are_met_in_proportion():
    """Of n x n even points a row gets n (its share n, up to one point), and a cell as much of those, up to one."""
    grid, count = make_uneven_map(), 1000
    even = (np.arange(count) + 0.5) / count
    directions = sample_map(grid, np.stack(np.meshgrid(even, even, indexing="ij"), axis=-1).reshape(-1, 2))
    u, v = find_equirectangular(directions)
    met = np.histogram2d(v * 6, u * 8, bins=(6, 8), range=((0, 6), (0, 8)))[0]
    share = grid.density * measure_cells(6, 8)
    of_rows = share.sum(axis=1, keepdims=True)
    within = np.divide(share, of_rows, out=np.zeros_like(share), where=of_rows > 0)
    assert (np.abs(met - share * count**2) <= (of_rows * count + 1) + within * count + 1).all()
    assert (met[share == 0] == 0).all()


def test_sampled_directions_have_the_density_of_their_cell():
    grid = make_uneven_map()
    directions = sample_map(grid, np.random.default_rng(5).random((10_000, 2)))
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, rtol=1e-15)
    assert (map_density(grid, directions) > 0).all()


def test_map_of_nothing_is_none():
    assert make_direction_map(np.zeros((2, 4))) is None


def test_irradiance_of_a_constant_world_is_pi_times_its_radiance():
    environment = make_environment(World((0.5, 1.0, 2.0)), None, FRAME)
    np.testing.assert_allclose(estimate_irradiance(environment, UP, 100), 0.5 * np.pi, rtol=1e-14)


def test_constant_world_has_no_map():
    assert make_environment(World(1.0), None, FRAME).grid is None


@pytest.mark.parametrize("normal", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0.6, 0, 0.8)])
def test_irradiance_of_a_gradient(normal):
    """L = 1 + z brings pi + 2 pi n_z / 3 to a plane with normal n."""
    environment = make_environment(make_gradient(), None, FRAME)
    values = estimate_irradiance(environment, np.array(normal, dtype=float), 200_000)
    assert_mean(values, np.pi + 2 * np.pi / 3 * normal[2])


def test_sun_of_one_pixel_is_found_by_each_sample_of_the_map():
    world, irradiance = make_pixel_sun()
    environment = make_environment(world, None, FRAME)
    values = estimate_irradiance(environment, UP, 4000)
    assert_mean(values, irradiance)
    # The map's cells reach past the pixel's border by up to half of theirs on each side: 8 of 64 by 32 have their size.
    assert (values > 0).mean() > (8 / 9) ** 2 - SIGMAS * 0.5 / np.sqrt(4000)


def test_sun_in_an_image_wider_than_the_map_is_found():
    world, irradiance = make_pixel_sun(2 * LARGEST_WIDTH, LARGEST_WIDTH, row=1500, column=301, power=1e6)
    values = estimate_irradiance(make_environment(world, None, FRAME), UP, 20_000)
    assert_mean(values, irradiance)
    # A pixel of a quarter of a cell is met by a quarter of the samples of four cells, within their border.
    assert (values > 0).mean() > 1 / 16 - SIGMAS * 0.5 / np.sqrt(20_000)


def test_estimate_is_unbiased_whatever_the_map():
    environment = make_environment(make_gradient(), None, FRAME)
    wrong = Environment(
        environment.color, environment.program, environment.needed, environment.tables, make_uneven_map()
    )
    assert_mean(estimate_irradiance(wrong, UP, 200_000), np.pi + 2 * np.pi / 3)


def test_rays_of_the_camera_may_see_another_world():
    steps = (Step("LIGHT_PATH Is Camera Ray"), Step("number to vector", (Register(0, "Is Camera Ray"),)))
    environment = make_environment(World(Register(1, "Value"), Program(steps)), None, FRAME)
    directions = np.array([[1.0, 0, 0], [0, 1.0, 0]])
    path = LightPath({"camera": np.array([1.0, 0.0])})
    np.testing.assert_array_equal(evaluate_environment(environment, directions, path), [[1, 1, 1], [0, 0, 0]])
    np.testing.assert_array_equal(evaluate_environment(environment, directions), np.zeros((2, 3)))


def test_negative_radiance_takes_light_away_and_undefined_is_black():
    environment = make_environment(World(Register(0, "Position"), Program((DIRECTION,))), None, FRAME)
    np.testing.assert_array_equal(evaluate_environment(environment, -UP[np.newaxis]), -UP[np.newaxis])
    overflow = Step("VECT_MATH Vector", (Register(0, "Position"), np.full(3, 1e308), np.zeros(3), 1e308))
    twice = [dataclasses.replace(overflow, settings={"operation": "SCALE"}) for _ in range(2)]
    twice[1] = dataclasses.replace(twice[1], inputs=(Register(1, "Vector"), *twice[1].inputs[1:]))
    environment = make_environment(World(Register(2, "Vector"), Program((DIRECTION, *twice))), None, FRAME)
    np.testing.assert_array_equal(evaluate_environment(environment, UP[np.newaxis]), [[0, 0, 0]])


def test_plane_under_a_gradient():
    """A plane of albedo a that faces up sends back a (1 + 2 / 3)."""
    floor = raytracer.Mesh([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [(0, 1, 2), (0, 2, 3)])
    matrix = np.eye(4)
    matrix[2, 3] = 1.0
    scene = raytracer.Scene(
        meshes=[floor],
        materials=[raytracer.Material((raytracer.Closure("diffuse", color=0.5),))],
        world=make_gradient(),
        camera=raytracer.Camera(matrix, projection="orthographic", ortho_scale=1.0),
    )
    picture = raytracer.render(scene, 16, 16, 64)["Combined"][..., 0].astype(np.float64)
    assert_mean(picture.ravel(), 0.5 * 5 / 3)


def test_camera_sees_the_world_itself():
    scene = raytracer.Scene(world=make_gradient(), camera=raytracer.Camera(np.eye(4), focal_length=1e6))
    picture = raytracer.render(scene, 2, 2, 1)["Combined"]
    np.testing.assert_allclose(picture[..., :3], 0.0, atol=1e-8)  # it looks down, where 1 + z is 0
