"""What reflections come near to: lights beside their way, within ten radii; nothing where no lobe is narrow."""

import numpy as np
import pytest

import raytracer
from raytracer import AreaLight, Camera, Closure, Material, Mesh, PointLight, Scene, SpotLight, SunLight
from raytracer.film.unmet import LOWEST
from raytracer.lights.environment import Environment
from raytracer.lights.glints import list_glints
from raytracer.rendering.render import render
from raytracer.sampling.direction_map import make_direction_map, measure_cells
from tests.raytracer.rendering.error_scenes import SCENES

# An orthographic camera that looks down on a mirror: all rays go straight up again.
ABOVE = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1.0]])
FLOOR = Mesh([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], [[0, 1, 2], [0, 2, 3]])
MIRROR = Closure("glossy", roughness=0.0, color=0.5)
# pi * 4 pi r^2 watts of a ball have the radiance 1.
BALL = np.pi * 4.0 * np.pi * 0.1**2


def see(light, closure=MIRROR, **keywords):
    camera = Camera(ABOVE, projection="orthographic", ortho_scale=0.1)
    scene = Scene(meshes=[FLOOR], materials=[Material((closure,))], lights=[light], camera=camera)
    return render(scene, 3, 2, 4, **keywords)


def read(film):
    """Return how many samples have come near, and the largest that one would have seen, to a factor of sqrt(2)."""
    steps = np.flatnonzero(film.near_misses)
    return sum(film.near_misses), 2.0 ** ((steps[-1] - 1) / 2 - LOWEST) if len(steps) else 0.0


@pytest.mark.parametrize(
    ("light", "radiance"),
    [
        (PointLight((0.8, 0, 3), 100 * BALL, radius=0.1), 100),
        (PointLight((0.8, 0, 3), 100 * BALL, radius=0.1, soft_falloff=False), 100),
        (SpotLight((0.8, 0, 3), 100 * BALL, radius=0.1, world_from_light=np.eye(3)), 100),
        (AreaLight((0.6, 0, 3), (0.1, 0, 0), (0, -0.1, 0), 100 * np.pi * 0.01), 100),
        (SunLight((0.08, 0, np.sqrt(1 - 0.08**2)), 100 * np.pi * 0.01**2, angle=0.02), 100),
    ],
)
def test_reflections_come_near_to_lights_beside_their_way(light, radiance):
    """All 24 samples; half of the radiance, for the mirror reflects so much, is within a step of a root of two."""
    count, seen = read(see(light))
    assert count == 24
    assert radiance / 2 * (1 - 1e-3) < seen < radiance / 2 * np.sqrt(2) * (1 + 1e-3)  # a sun's disk is a spherical cap


@pytest.mark.parametrize(
    "light",
    [
        PointLight((1.2, 0, 3), BALL, radius=0.1),
        PointLight((0, 0, -3), BALL, radius=0.1),
        PointLight((0.8, 0, 3), BALL),
        PointLight((0.8, 0, 3), BALL, radius=0.1, seen_by=0),
        SunLight((0.2, 0, np.sqrt(1 - 0.2**2)), 1.0, angle=0.02),
    ],
)
def test_lights_far_off_below_hidden_or_without_extent_are_not_near(light):
    assert read(see(light)) == (0, 0.0)


def test_the_brightest_of_a_sky_is_a_disk_where_it_is():
    """One cell of 8 x 16: as large, and in its middle; an even sky has none."""
    cells = np.zeros((8, 16))
    cells[5, 2] = 1.0
    sky = Environment(np.ones(3), grid=make_direction_map(cells), brightest=7.0)
    (glint,) = list_glints([], None, sky)
    assert np.pi * glint.radius**2 == pytest.approx(measure_cells(8, 16)[5, 0])
    longitude, latitude = np.pi - 2 * np.pi * 2.5 / 16, np.pi * (5.5 / 8 - 0.5)
    np.testing.assert_allclose(glint.centre[2], np.sin(latitude), rtol=1e-14)  # a sine and an arc
    np.testing.assert_allclose(np.arctan2(glint.centre[1], glint.centre[0]), longitude, rtol=1e-14)
    assert (glint.radiance, glint.is_far) == (7.0, True)
    assert list_glints([], None, Environment(np.ones(3))) == []


def test_light_sampling_leaves_little_to_a_lobe_that_is_not_as_narrow_as_its_light():
    """Roughness 0.12 reflects with 1 / (4 pi 0.12^4) = 384 in its middle, a sun of 0.02 is aimed at with 3183."""
    sun = SunLight((0.08, 0, np.sqrt(1 - 0.08**2)), 100 * np.pi * 0.01**2, angle=0.02)
    count, seen = read(see(sun, Closure("glossy", roughness=0.12, color=0.5)))
    assert 0 < count <= 24
    assert seen < 50 * (384 / 3183) ** 2 * 2
    assert see(sun, Closure("glossy", roughness=0.3)).near_misses == ()


def test_clamped_light_is_no_brighter_than_its_limit():
    light = PointLight((0.8, 0, 3), 100 * BALL, radius=0.1)
    assert read(see(light, clamp_direct=2.0, clamp_indirect=2.0))[1] <= 2 * np.sqrt(2)


def test_near_misses_are_the_same_for_any_blocks_and_in_tiles(tmp_path):
    make, integrator = SCENES["fireflies"]
    scene, options = make(), {"integrator": integrator}
    whole = render(scene, 24, 16, 6, **options)
    assert sum(whole.near_misses) > 0
    assert render(scene, 24, 16, 6, block_size=100, **options).near_misses == whole.near_misses
    tiles = [render(scene, 24, 16, 6, tile=(number, 3), **options) for number in (1, 2, 3)]
    assert raytracer.merge(tiles).near_misses == whole.near_misses
    raytracer.save_film(whole, tmp_path / "film.npz")
    assert raytracer.load_film(tmp_path / "film.npz").measure_error() == whole.measure_error()
