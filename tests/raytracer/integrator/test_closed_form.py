"""Whole pictures and single rays whose value is known in closed form.

Deterministic ones hold to rounding. Where directions are drawn at random the mean must lie within 4.5 standard errors
(about 1 in 150 000 by chance, and the draws are fixed).
"""

import numpy as np
import pytest

import raytracer
from raytracer.bsdfs.fresnel import dielectric_reflectance
from raytracer.casting.rays import make_rays
from raytracer.integrator.loop import trace
from raytracer.integrator.prepare import prepare
from raytracer.integrator.settings import Settings
from raytracer.rendering.render import render
from raytracer.sampling.sobol import SobolSamples
from raytracer.scene.materials import Closure, Material

SIGMAS = 4.5
CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
CUBE_TRIANGLES = [
    *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
    *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
]


def plane(size=50.0, material=0, height=0.0):
    corners = size * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) + [0, 0, height]
    return raytracer.Mesh(corners, [[0, 1, 2], [0, 2, 3]], material=material)


def see(scene, origins, directions, count=1, **settings):
    rays = make_rays(np.atleast_2d(origins), np.atleast_2d(directions))
    rays = make_rays(np.repeat(rays.origins, count, axis=0), np.repeat(rays.directions, count, axis=0))
    samples = SobolSamples(np.arange(len(rays), dtype=np.uint32), 0, 1)
    return trace(prepare(scene, raytracer.build(scene), Settings(**settings)), rays, samples)["Combined"][:, :3]


def assert_mean(values, expected):
    error = values.std(axis=0) / np.sqrt(len(values))
    assert (np.abs(values.mean(axis=0) - expected) <= SIGMAS * error + 1e-12 * np.abs(expected)).all()


def looking_down(height, **camera):
    matrix = np.eye(4)
    matrix[2, 3] = height
    return raytracer.Camera(matrix, **camera)


def test_point_light_over_a_plane_picture_is_intensity_cosine_over_distance_squared():
    light = raytracer.PointLight((0.5, -0.3, 2.0), (100, 50, 25))
    scene = raytracer.Scene(
        meshes=[plane()], materials=[Material((Closure("diffuse", color=0.8),))], lights=[light], camera=looking_down(5)
    )
    film = render(scene, 32, 24, samples=1, filter_width=0.0, passes=("Combined", "Position"))
    offset = np.array([0.5, -0.3, 2.0]) - film["Position"].astype(float)
    distance = np.linalg.norm(offset, axis=2)
    irradiance = 1 / (4 * np.pi) * offset[..., 2] / distance**3
    expected = 0.8 / np.pi * irradiance[..., None] * np.array([100, 50, 25])
    # The film stores float32: so do the position and the value.
    np.testing.assert_allclose(film["Combined"][..., :3], expected, rtol=1e-6)


def test_sun_on_a_tilted_plane_is_strength_times_cosine():
    rng = np.random.default_rng(1)
    for _ in range(10):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        matrix = np.eye(4)
        matrix[:3, :3] = turn * np.sign(np.linalg.det(turn))
        normal = matrix[:3, 2]
        direction = normal + 0.5 * rng.normal(size=3)
        sun = raytracer.SunLight(direction, (3, 2, 1))
        scene = raytracer.Scene(
            meshes=[plane()],
            instances=raytracer.Instances([0], [matrix]),
            materials=[Material((Closure("diffuse", color=(0.5, 0.6, 0.7)),))],
            lights=[sun],
        )
        expected = np.array([1.5, 1.2, 0.7]) / np.pi * max(sun.direction @ normal, 0.0)
        np.testing.assert_allclose(see(scene, 3 * normal, -normal)[0], expected, rtol=1e-12, atol=1e-15)


def test_inside_an_emissive_cube_every_ray_sees_its_radiance():
    mesh = raytracer.Mesh(CUBE, CUBE_TRIANGLES)
    scene = raytracer.Scene(meshes=[mesh], materials=[Material((Closure("emission", color=(3, 2, 1)),))])
    directions = np.random.default_rng(2).normal(size=(500, 3))
    np.testing.assert_array_equal(see(scene, np.zeros((500, 3)), directions), np.tile([3.0, 2, 1], (500, 1)))


@pytest.mark.parametrize("closure", ["diffuse", "mirror", "glossy", "plastic", "glass", "refraction", "transparent"])
def test_white_ball_in_a_white_world_sends_on_no_more_than_it_gets(closure):
    """A furnace: what loses nothing disappears, but for noise and 1 % of the tables of energy; refraction may lose."""
    closures = {
        "diffuse": Closure("diffuse", color=1.0),
        "mirror": Closure("glossy", color=1.0, roughness=0.0),
        "glossy": Closure("glossy", color=1.0, roughness=0.6),
        "plastic": Closure("principled", color=1.0, roughness=0.4),
        "glass": Closure("glass", color=1.0, roughness=0.0),
        "refraction": Closure("refraction", color=1.0, roughness=0.5),
        "transparent": Closure("transparent", color=1.0),
    }
    ball = raytracer.Spheres([[0, 0, 0]], [1.0])
    scene = raytracer.Scene(spheres=[ball], materials=[Material((closures[closure],))], world=raytracer.World(1.0))
    rng = np.random.default_rng(3)
    origins = np.c_[rng.uniform(-0.65, 0.65, (4000, 2)), np.full(4000, 5.0)]
    values = see(scene, origins, [0, 0, -1.0], max_bounces=64)
    noise = SIGMAS * values.std(axis=0) / np.sqrt(len(values))
    exact = closure in ("diffuse", "mirror", "glass", "transparent")
    slack = 1e-9 if exact else 0.01
    assert (values.mean(axis=0) <= 1 + noise + slack).all()
    if closure != "refraction":
        assert (values.mean(axis=0) >= 1 - noise - slack).all()
    if exact:
        np.testing.assert_allclose(values, 1.0, atol=1e-9)


def test_mirror_shows_an_emissive_ball_at_its_radiance():
    scene = raytracer.Scene(
        meshes=[plane()],
        spheres=[raytracer.Spheres([[3, 0, 3]], [1.0], material=1)],
        materials=[
            Material((Closure("glossy", color=(0.9, 0.8, 0.7), roughness=0.0),)),
            Material((Closure("emission", color=4.0),)),
        ],
    )
    np.testing.assert_allclose(see(scene, [-3, 0, 3.0], [1, 0, -1.0])[0], 4 * np.array([0.9, 0.8, 0.7]), rtol=1e-14)


@pytest.mark.parametrize("angle", [0.0, 40.0, 75.0])
@pytest.mark.parametrize("bounces", [2, 3, 4, 9])
def test_glass_slab_transmits_the_series_of_its_internal_reflections(angle, bounces):
    """T_n = (1 - R)^2 sum_k R^2k over the passages that n + 1 reflections and refractions allow.

    The last stretch of a path, after one more than `max_bounces`, still sees what shines.
    """
    glass = Material((Closure("glass", color=1.0, roughness=0.0, ior=1.5),))
    slab = raytracer.Mesh(CUBE * [500, 500, 0.5], CUBE_TRIANGLES)
    below = plane(400, 1, -20.0)
    light = Material((Closure("emission", color=1.0),))
    scene = raytracer.Scene(meshes=[slab, below], materials=[glass, light])
    cosine = np.cos(np.radians(angle))
    reflectance = dielectric_reflectance(np.array([cosine]), np.array([1.5]))[0]
    direction = [np.sin(np.radians(angle)), 0, -cosine]
    values = see(scene, [0, 0, 1.0], direction, count=8_000, max_bounces=bounces)
    passages = range((bounces + 1 - 2) // 2 + 1)  # entering and leaving take two, each turn inside two more
    expected = (1 - reflectance) ** 2 * sum(reflectance ** (2 * k) for k in passages)
    assert_mean(values, expected)


def polygon_irradiance(position, normal, corners):
    """Lambert: E / L = 1/2 sum theta_i gamma_i . n for a polygon above the horizon."""
    vectors = corners - position
    vectors = vectors / np.linalg.norm(vectors, axis=1)[:, None]
    total = 0.0
    for a, b in zip(vectors, np.roll(vectors, -1, axis=0), strict=True):
        edge = np.cross(a, b)
        total += np.arctan2(np.linalg.norm(edge), a @ b) * (edge @ normal) / np.linalg.norm(edge)
    return abs(total) / 2


@pytest.mark.parametrize("source", ["mesh", "lamp"])
def test_rectangle_lights_a_point_by_its_form_factor(source):
    corners = np.array([[-0.5, -1, 2], [0.5, -1, 2], [0.5, 1, 2], [-0.5, 1, 2.0]])
    materials = [Material((Closure("diffuse", color=np.ones(3)),)), Material((Closure("emission", color=5.0),))]
    meshes, lights = [plane()], []
    if source == "mesh":
        meshes.append(raytracer.Mesh(corners, [[0, 1, 2], [0, 2, 3]], material=1))
    else:
        lights.append(raytracer.AreaLight((0, 0, 2), (1, 0, 0), (0, 2, 0), 5.0 * np.pi * 2))
    scene = raytracer.Scene(meshes=meshes, materials=materials, lights=lights)
    position = np.array([0.7, 0.4, 0.0])
    values = see(scene, position + np.array([1, 0, 1]), [-1, 0, -1.0], count=20_000)
    assert_mean(values, 5.0 / np.pi * polygon_irradiance(position, np.array([0, 0, 1.0]), corners))


def test_rough_mirror_and_diffuse_in_one_closed_room_keep_the_furnace():
    """All walls shine alike: reflection of any kind adds albedo times radiance, whatever is sampled how."""
    wall = Material((Closure("emission", color=1.0),))
    ball = Material((Closure("diffuse", color=0.5), Closure("glossy", color=1.0, weight=0.5, roughness=0.7)))
    scene = raytracer.Scene(
        meshes=[raytracer.Mesh(CUBE * 3, CUBE_TRIANGLES, material=0)],
        spheres=[raytracer.Spheres([[0, 0, 0]], [1.0], material=1)],
        materials=[wall, ball],
    )
    rng = np.random.default_rng(4)
    origins = np.c_[rng.uniform(-0.6, 0.6, (20_000, 2)), np.full(20_000, 2.5)]
    values = see(scene, origins, [0, 0, -1.0])
    error = SIGMAS * values.std(axis=0) / np.sqrt(len(values))
    assert (np.abs(values.mean(axis=0) - 1.0) < error + 0.5 * 0.01).all()
