"""Probes: what rays aimed at small light expect of samples, against what samples meet; and when pictures tell."""

import numpy as np
import pytest

import raytracer
from raytracer import (
    AreaLight,
    Camera,
    Closure,
    Instances,
    Material,
    Mesh,
    Motion,
    PointLight,
    Scene,
    Spheres,
    SpotLight,
    SunLight,
    World,
)
from raytracer.film.missed import SWEEPS, measure_missed, sort_probes
from raytracer.rendering import blocks, probes
from raytracer.rendering.render import render
from raytracer.scene.fields import SEEN_BY_ALL
from raytracer.scene.motion import SpheresMotion
from tests.forbidding import forbid
from tests.raytracer.rendering.error_scenes import EYE, FLOOR, HEIGHT, SCENES, WIDTH, make_balls

SHINING = Material((Closure("emission", color=20.0),))
MATERIALS = [Material((Closure("diffuse"),)), SHINING]
OUT_OF_FOCUS = Camera(EYE, aperture_radius=0.3, focus_distance=8.0)
TRIANGLE = Mesh([[0.1, 4, 1.3], [0.5, 4.2, 1.4], [0.2, 3.9, 1.7]], [[0, 1, 2]], material=1)
SMALLER = Mesh([[0.1, 3, 1.4], [0.3, 3, 1.4], [0.2, 3, 1.6]], [[0, 1, 2]], material=1)
OCTAHEDRON = Mesh(
    np.concatenate([np.eye(3), -np.eye(3)]) * 0.2 + (0.3, 4, 1.5),
    [(0, 1, 2), (0, 4, 2), (3, 1, 2), (3, 4, 2), (0, 1, 5), (0, 4, 5), (3, 1, 5), (3, 4, 5)],
    material=1,
)
TURNED = np.array([[0, -1, 0, 3], [1, 0, 0, 3], [0, 0, 0.5, 1], [0, 0, 0, 1.0]])
FORWARD = np.array([[1, 0, 0], [0, 0, 1], [0, 1, 0.0]])
CENTRE = (0.3, 4, 1.5)
SEEN = {"radius": 0.1, "seen_by": SEEN_BY_ALL}


def make_bulb(radius=0.1, centre=CENTRE):
    return Spheres([centre], [radius], material=1)


SIGHTS = {
    "ball": {"spheres": [make_bulb()]},
    "balls, one at the edge": {"spheres": [Spheres([[0.3, 4, 1.5], [-4.2, 4, 1.5]], [0.1, 0.2], material=1)]},
    "triangle": {"meshes": [TRIANGLE]},
    "closed mesh": {"meshes": [OCTAHEDRON]},
    "mesh before another": {"meshes": [TRIANGLE, SMALLER], "spheres": [make_bulb(0.2, (0.2, 6, 1.4))]},
    "instances": {"meshes": [TRIANGLE], "instances": Instances([0, 0], [np.eye(4), TURNED])},
    "rectangle": {"lights": [AreaLight(CENTRE, [0.2, 0, 0], [0, -0.1, -0.2], 50.0, seen_by=SEEN_BY_ALL)]},
    "ellipse": {"lights": [AreaLight(CENTRE, [0.2, 0, 0], [0, -0.1, -0.2], 50.0, "ellipse", seen_by=SEEN_BY_ALL)]},
    "point": {"lights": [PointLight(CENTRE, 50.0, **SEEN)]},
    "true sphere": {"lights": [PointLight(CENTRE, 50.0, soft_falloff=False, **SEEN)]},
    "spot": {"lights": [SpotLight(CENTRE, 50.0, world_from_light=FORWARD, **SEEN)]},
    "sun": {"lights": [SunLight([0.03, 1, 0.02], 5.0, angle=0.02, seen_by=SEEN_BY_ALL)]},
    "hidden in part": {"spheres": [make_bulb(), Spheres([[0.02, 0, 1.5]], [0.2])]},
}


def look(sights, samples, camera=OUT_OF_FOCUS, **settings):
    scene = Scene(**sights, materials=MATERIALS, camera=camera)
    return render(scene, WIDTH, HEIGHT, samples, integrator="direct", **settings)


def expect_light(film):
    """Return by its probes what a film of a black scene shows, (h, w), and the sum of its squares."""
    known = sort_probes(film.probes)
    column, row = known[:, 2].astype(int), known[:, 3].astype(int)
    light = np.zeros((HEIGHT, WIDTH))
    np.add.at(light, (HEIGHT - 1 - row, column), known[:, 4] * known[:, 5] / SWEEPS)
    return light, measure_missed(known, row * WIDTH + column, np.zeros((len(known), 3)), 0.0, SWEEPS)[0]


@pytest.mark.parametrize("name", SIGHTS)
def test_probes_expect_what_samples_meet(monkeypatch, name):
    """All of it within 4 deviations of the hits that 512 samples of each pixel have, and of 1024 probes; its squares
    within 20%."""
    monkeypatch.setattr(probes, "COUNT", 256)
    film = look(SIGHTS[name], 512)
    seen = film["Combined"][..., 0].astype(float)
    light, squares = expect_light(film)
    hits = 512 * seen.sum() / max(film.probes[5::8])
    assert hits > 30
    assert light.sum() == pytest.approx(seen.sum(), rel=4 / np.sqrt(hits) + 4 / np.sqrt(1024))
    noise = (seen * (max(film.probes[5::8]) - seen)).sum() / 512  # of what samples add to squares
    assert squares == pytest.approx((seen**2).sum() - noise, rel=8 / np.sqrt(hits) + 0.2)


@pytest.mark.parametrize(
    ("camera", "settings"),
    [
        (Camera(EYE), {}),
        (Camera(EYE), {"pixel_filter": "box", "filter_width": 1.0}),
        (Camera(EYE), {"pixel_filter": "box", "filter_width": 3.0}),
        (OUT_OF_FOCUS, {}),
        (Camera(EYE, "orthographic", aperture_radius=0.3, focus_distance=8.0), {}),
        (Camera(EYE, aperture_radius=0.3, focus_distance=8.0, aperture_blades=3, pixel_aspect=1.5), {}),
    ],
)
def test_probes_lie_where_samples_meet_the_light(monkeypatch, camera, settings):
    """Each pixel within 5 deviations of both: 512 samples, and 2048 probes, which are not fewer."""
    monkeypatch.setattr(probes, "COUNT", 512)
    film = look(SIGHTS["ball"], 512, camera, **settings)
    seen = film["Combined"][..., 0].astype(float)
    light, _ = expect_light(film)
    one = max(film.probes[5::8]) / 512
    assert (np.abs(light - seen) < 5 * np.sqrt(one * (seen + light + one))).all()


@pytest.mark.parametrize(
    ("sights", "size"),
    [
        ({"spheres": [make_bulb(centre=(1.5, -6, 2.5))]}, np.pi * 0.1**2),
        ({"lights": [PointLight((1.5, -6, 2.5), 50.0, **SEEN)]}, np.pi * 0.1**2),
        ({"meshes": [TRIANGLE]}, 0.5 * (0.4 * 0.4 - 0.1 * 0.1)),  # as seen along y, its sides are (.4, .1) and (.1, .4)
        (
            {"lights": [AreaLight(CENTRE, [0.2, 0, 0], [0, -0.1, -0.2], 50.0, "ellipse", seen_by=SEEN_BY_ALL)]},
            np.pi * 0.01,
        ),
    ],
)
def test_parallel_rays_see_all_of_a_light_in_its_size(sights, size):
    """4 pixels for each metre: the weights of each sweep are the pixels that the light takes, to rounding."""
    camera = Camera(EYE, "orthographic", aperture_radius=1e-3)
    film = look(sights, 2, camera, pixel_filter="box", filter_width=1.0)
    weights = sort_probes(film.probes)[:, 4].reshape(2, -1)
    np.testing.assert_allclose(weights.sum(axis=1), 16 * size, rtol=1e-3)  # rays lean by a thousandth at most


def test_many_and_large_lights_leave_the_probes_to_small_ones():
    """A panel over half of the picture, and 400 balls of another radiance, of a third of a pixel each."""
    panel = Mesh([[-9, 9, -9], [9, 9, -9], [9, 9, 1], [-9, 9, 1]], [[0, 1, 2], [0, 2, 3]])
    places = np.random.default_rng(1).uniform((-3, 4, 2), (3, 6, 4), (400, 3))
    crowd = Spheres(places, np.full(400, 0.1), material=1)
    bulb = Spheres([CENTRE], [0.05], material=2)
    materials = [Material((Closure("emission", color=color),)) for color in (50.0, 20.0, 80.0)]
    scene = Scene(meshes=[panel], spheres=[crowd, bulb], materials=materials, camera=OUT_OF_FOCUS)
    film = render(scene, WIDTH, HEIGHT, SWEEPS)
    seen = sort_probes(film.probes)[:, 5]
    assert len(seen) == SWEEPS * probes.COUNT
    assert (seen == 80.0).all()
    alone = Scene(meshes=[panel], spheres=[crowd], materials=materials, camera=OUT_OF_FOCUS)
    assert render(alone, WIDTH, HEIGHT, SWEEPS).probes == ()


def test_probes_see_what_moves_where_it_moves(monkeypatch):
    """A ball that crosses half of the picture, against balls that stand along its way: its squares, spread over as many
    pixels, within 4 deviations of what 16 pictures tell, of 16 moments each."""
    monkeypatch.setattr(probes, "COUNT", 256)
    along = np.linspace(-2.0, 2.0, 32)
    stills = [expect_light(look({"spheres": [make_bulb(centre=(x, 4, 1.5))]}, SWEEPS, Camera(EYE))) for x in along]
    expected = np.mean([light for light, _ in stills], axis=0)
    matrices = np.tile(np.eye(4), (2, 1, 1))
    matrices[:, 0, 3] = (-2.0, 2.0)
    motion = Motion(spheres=[SpheresMotion(0, [(0, 4, 1.5)], [0.1], matrices)])
    sights = {"spheres": [make_bulb(centre=(0, 4, 1.5))], "motion": motion}
    found = [expect_light(look(sights, SWEEPS, Camera(EYE), seed=seed)) for seed in range(16)]
    assert np.mean([light.sum() for light, _ in found]) == pytest.approx(expected.sum(), rel=0.1)
    squares = np.array([square for _, square in found])
    truth = (expected**2).sum()
    assert stills[0][1] > 4 * truth
    assert abs(squares.mean() - truth) < 4 * squares.std() / np.sqrt(16)
    assert squares.std() / np.sqrt(16) < 0.2 * truth


def make_room(bulb, camera=OUT_OF_FOCUS, color=60.0):
    """A bulb over balls on a floor."""
    shining = Material((Closure("emission", color=color),))
    materials = [MATERIALS[0], shining]
    return Scene(meshes=[FLOOR], spheres=[make_balls(), bulb], materials=materials, world=World(0.3), camera=camera)


def tell(scene, seeds, samples=8):
    """Return what pictures say, and the brightest that each shows."""
    caster = raytracer.build(scene)
    films = [render(scene, WIDTH, HEIGHT, samples, caster=caster, seed=seed) for seed in range(seeds)]
    return [film.measure_error() for film in films], [float(film["Combined"][..., 0].max()) for film in films]


def test_pictures_that_missed_a_tiny_bright_light_out_of_focus_say_so():
    """A ball of 0.1 pixels, of which 8 samples meet nothing with e^-0.8: all pictures that show none of it say so, and
    their interval holds what they lack, 60 times 0.1 in some 10 pixels; those that show it speak of few pixels."""
    told, brightest = tell(make_room(make_bulb(0.075, (0.5, 6, 3))), 24)
    dark = [error for error, most in zip(told, brightest, strict=True) if most < 2.0]
    assert 5 < len(dark) < 20
    assert all(error.is_missed and "a small light that is in sight" in error.note for error in dark)
    assert min(error.interval[1] for error in dark) > 3 * max(error.error for error in dark)
    assert all(error.few for error, most in zip(told, brightest, strict=True) if most >= 2.0)


@pytest.mark.parametrize(
    "scene",
    [
        make_room(make_bulb(0.4, (0.2, 0, 3)), Camera(EYE, aperture_radius=0.3, focus_distance=8.0)),  # in focus
        make_room(make_bulb(0.4, (0.5, 6, 3))),  # large
        make_room(make_bulb(0.075, (0.5, 6, 3)), color=0.5),  # dim
        make_room(make_bulb(0.075, (-1, 3, 1))),  # behind a ball
        make_room(make_bulb(0.075, (0.5, -12, 3))),  # behind the camera
        SCENES["penumbra"][0](),
    ],
)
def test_nothing_is_said_where_nothing_is_missing(scene):
    told, _ = tell(scene, 12)
    assert not any(error.is_missed for error in told)


def test_probes_are_the_same_for_any_blocks_and_in_tiles(tmp_path):
    make, integrator = SCENES["blur"]
    scene, options = make(), {"integrator": integrator, "seed": 4}
    whole = render(scene, 24, 16, 6, **options)
    assert whole.measure_error().is_missed
    for film in (
        render(scene, 24, 16, 6, block_size=100, **options),
        render(scene, 24, 16, 6, workers=2, **options),
        render(scene, 24, 16, 6, film=render(scene, 24, 16, 6, until=3, **options), **options),
        raytracer.merge([render(scene, 24, 16, 6, tile=(number, 3), **options) for number in (3, 1, 2)]),
    ):
        np.testing.assert_array_equal(sort_probes(film.probes), sort_probes(whole.probes))
        assert film.measure_error() == whole.measure_error()
    raytracer.save_film(whole, tmp_path / "film.npz")
    assert raytracer.load_film(tmp_path / "film.npz").measure_error() == whole.measure_error()


def test_a_render_that_an_error_ends_has_the_probes_of_its_sweeps():
    """Blocks of several sweeps have seen more."""
    scene = SCENES["blur"][0]()
    film = render(scene, 24, 16, 64, error=1e3, min_samples=2)
    assert film.samples == 2
    assert set(sort_probes(film.probes)[:, 0]) == {0.0, 1.0}


@pytest.mark.parametrize("passes", [("Combined", "Depth", "Error"), ("Combined", "Emission", "Normal")])
def test_pictures_with_probes_have_the_bits_of_those_without(monkeypatch, passes):
    make, integrator = SCENES["blur"]
    with_probes = render(make(), 24, 16, 6, integrator=integrator, passes=passes)
    assert with_probes.probes
    monkeypatch.setattr(blocks, "make_prober", lambda *arguments: None)
    without = render(make(), 24, 16, 6, integrator=integrator, passes=passes)
    assert not without.probes
    for name in passes:
        np.testing.assert_array_equal(with_probes[name], without[name])


def test_scenes_without_small_light_in_sight_aim_at_nothing(monkeypatch):
    make, integrator = SCENES["penumbra"]
    forbid(monkeypatch, "find_sights", "add_probes", "measure_missed", "find_through_lens")
    film = render(make(), 24, 16, 4, integrator=integrator)
    assert film.measure_error().error > 0
    assert film.probes == ()
