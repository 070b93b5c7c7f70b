"""Interreflection: closed forms, limits of bounces, what paths are told of themselves, the same picture every time."""

from dataclasses import replace

import numpy as np
import pytest

import raytracer
from raytracer.bsdfs import bsdf, bsdf_samples
from raytracer.bsdfs.bounce_kinds import (
    DIFFUSE,
    GLOSSY,
    SCATTERED,
    SINGULAR,
    STRAIGHT,
    TRANSMITTED,
    count_bounces,
    describe_kinds,
)
from raytracer.casting.rays import make_rays
from raytracer.integrator import bounces, contributions, direct_light, loop, scattering
from raytracer.integrator.loop import trace
from raytracer.integrator.prepare import prepare
from raytracer.integrator.settings import Settings
from raytracer.sampling.sobol import SobolSamples
from raytracer.scene.materials import Closure, Material
from tests.forbidding import forbid

COUNT = 20_000
# A mean of COUNT values may be off by so many standard errors: 1 in 16,000 runs of one test, were the seeds not fixed.
SIGMAS = 4.0
BOX = raytracer.Mesh(
    [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)],
    [
        triangle
        for a, b, c, d in ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
        for triangle in ((a, b, c), (a, c, d))
    ],
)


def look_around(scene, origin=(0.1, 0.2, 0.3), count=COUNT, **settings):
    """Trace rays from one point into all directions; returns their radiance (n, 3)."""
    directions = np.random.default_rng(3).normal(size=(count, 3))
    samples = SobolSamples(np.arange(count, dtype=np.uint32), 0, 0)
    settings = {"integrator": "path", **settings}
    integrator = prepare(scene, raytracer.build(scene), Settings(**settings))
    return trace(integrator, make_rays(np.broadcast_to(origin, (count, 3)), directions), samples)["Combined"][:, :3]


def assert_mean(values, expected):
    error = values.std(axis=0) / np.sqrt(len(values))
    assert (error < 0.02 * np.max(expected)).all(), "too noisy to tell anything"
    assert (np.abs(values.mean(axis=0) - expected) <= SIGMAS * error + 1e-12).all()


# Closed forms --------------------------------------------------------------------------------------------------------

GREYS = np.array([0.2, 0.5, 0.8])


@pytest.mark.parametrize("most", [0, 1, 3, 60])
def test_white_furnace_is_a_geometric_series(most):
    """In a closed box whose walls shine with 1 and reflect a, L = 1 + a L, cut off after the last bounce."""
    walls = Material((Closure("diffuse", color=GREYS), Closure("emission", color=1.0)))
    seen = look_around(raytracer.Scene(meshes=[BOX], materials=[walls]), max_bounces=most)
    assert_mean(seen, (1 - GREYS ** (most + 2)) / (1 - GREYS))


@pytest.mark.parametrize("most", [0, 2])
def test_a_curtain_shows_the_world_behind_it(most):
    """A Lambertian sheet that lets all light through, under an even world: its albedo, whichever bounce is the last."""
    sheet = raytracer.Mesh([[-9.0, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], [[0, 1, 2], [0, 2, 3]])
    curtain = Material((Closure("translucent", color=GREYS),))
    scene = raytracer.Scene(meshes=[sheet], materials=[curtain], world=raytracer.World(1.0))
    rays = make_rays(np.tile((0.0, 0.0, 1.0), (64, 1)), np.tile((0.1, 0.0, -1.0), (64, 1)))
    integrator = prepare(scene, raytracer.build(scene), Settings(integrator="path", max_bounces=most))
    seen = trace(integrator, rays, SobolSamples(np.arange(64, dtype=np.uint32), 0, 0))["Combined"][:, :3]
    np.testing.assert_allclose(seen, np.tile(GREYS, (64, 1)), rtol=1e-12)


@pytest.mark.parametrize("most", [0, 1, 4])
def test_integrating_sphere_is_evenly_lit(most):
    """A point lamp of P watts in the centre of a sphere of radius R: every bounce is even, E = P / (4 pi R^2) a^k."""
    walls = Material((Closure("diffuse", color=GREYS),))
    scene = raytracer.Scene(
        spheres=raytracer.Spheres([(0, 0, 0)], [2.0]), materials=[walls], lights=[raytracer.PointLight((0, 0, 0), 50.0)]
    )
    irradiance = 50.0 / (4 * np.pi * 2.0**2) * (1 - GREYS ** (most + 1)) / (1 - GREYS)
    assert_mean(look_around(scene, max_bounces=most), GREYS / np.pi * irradiance)


def test_furnace_of_diffuse_and_glossy_parts_loses_what_one_look_loses():
    """With a rough lobe in the sum the series still has a closed form where each bounce is looked at by itself: a
    surface in an even surrounding 1 sends back its albedo, whatever way its light was sampled in."""
    closures = (Closure("diffuse", color=0.5, weight=0.6), Closure("glossy", color=0.8, roughness=0.5, weight=0.4))
    walls = Material((*closures, Closure("emission", color=1.0)))
    scene = raytracer.Scene(meshes=[BOX], materials=[walls])
    world = raytracer.Scene(meshes=[BOX], materials=[Material(closures)], world=raytracer.World(1.0))
    outside = make_rays([[0.1, 0.2, 3.0]] * COUNT, [[0.05, 0.02, -1.0]])
    samples = SobolSamples(np.arange(COUNT, dtype=np.uint32), 0, 0)
    looks = {
        name: trace(prepare(world, raytracer.build(world), Settings(integrator=name)), outside, samples)["Combined"]
        for name in ("direct", "path")
    }
    both = [looks[name][:, 0].mean() for name in looks]
    error = np.hypot(*(looks[name][:, 0].std() for name in looks)) / np.sqrt(COUNT)
    assert abs(both[0] - both[1]) <= SIGMAS * error
    assert look_around(scene, max_bounces=0)[:, 0].mean() < 1.0 + 0.6 * 0.5 + 0.4 * 0.8 + 0.01


def make_tilted_parts():
    """Points of all kinds of parts: a bent Lambertian one, a straight one and a rough lobe."""
    closures = [
        Closure("diffuse", color=(0.5, 0.3, 0.2)),
        Closure("diffuse", color=(0.2, 0.3, 0.4), normal=(0.4, 0.1, 1.0)),
        Closure("glossy", color=0.5, weight=0.5, roughness=0.6),
    ]
    return raytracer.Scene(meshes=[BOX], materials=[Material(closures)], world=raytracer.World(1.0))


@pytest.fixture
def tilted_shading(monkeypatch):
    """The Shading of many points with a Lambertian part that a normal bends."""
    kept = []
    original = loop.make_shading

    def keep(*arguments):
        kept.append(original(*arguments))
        return kept[-1]

    monkeypatch.setattr(loop, "make_shading", keep)
    look_around(make_tilted_parts(), origin=(0.1, 0.2, 3.0), count=COUNT)
    return next(shading for shading in kept if shading.tilted and len(shading) > 100)


def test_sampled_directions_have_the_density_that_is_reported(tilted_shading):
    """The mean of g / p over samples is the integral of g over the hemisphere for any g, here 1 and a cosine."""
    shading = tilted_shading
    probabilities = bsdf.lobe_probabilities(shading, with_diffuse=True)
    assert probabilities.shape[1] == 2 + len(shading.lobes) + len(shading.tilted)
    np.testing.assert_allclose(probabilities.sum(axis=1), 1.0)
    rng = np.random.default_rng(5)
    way = bsdf_samples.sample_bsdf(shading, probabilities, rng.random(len(shading)), rng.random((len(shading), 2)))
    value, density = bsdf.evaluate_bsdf(shading, probabilities, way.direction)
    rows = way.alive
    np.testing.assert_array_equal(density[rows], way.density[rows])
    np.testing.assert_allclose(way.weight[rows], value[rows] / density[rows, np.newaxis])
    assert set(np.unique(way.kind[rows])) == {DIFFUSE, GLOSSY}
    uniform = rng.normal(size=(len(shading), 3))
    uniform /= np.linalg.norm(uniform, axis=1, keepdims=True)
    integral, _ = bsdf.evaluate_bsdf(shading, probabilities, uniform)
    above = ((shading.geometric_normal * uniform).sum(axis=1) > 0)[:, np.newaxis]
    by_quadrature = 4 * np.pi * integral * above
    error = np.hypot(by_quadrature.std(axis=0), way.weight.std(axis=0)) / np.sqrt(len(shading))
    assert (np.abs(way.weight.mean(axis=0) - by_quadrature.mean(axis=0)) <= SIGMAS * error).all()


# Both ways of sampling -----------------------------------------------------------------------------------------------

LIT = {
    "lamp": {"lights": [raytracer.PointLight((0, 0, 0.5), 30, radius=0.3, soft_falloff=False)]},
    "area": {"lights": [raytracer.AreaLight((0, 0, 0.99), (0.8, 0, 0), (0, 0.8, 0), 30)]},
    "world": {"world": raytracer.World((0.5, 0.7, 0.9))},
}


@pytest.mark.parametrize("light", LIT)
def test_either_way_of_sampling_gives_the_mean_of_their_mixture(light, monkeypatch):
    """All weight on light sampling, all on reflection, and the power heuristic in between."""
    triangles = BOX.triangles[:-2] if light == "world" else BOX.triangles
    room = raytracer.Mesh(BOX.positions, triangles)
    scene = raytracer.Scene(meshes=[room], materials=[Material((Closure("diffuse", color=0.6),))], **LIT[light])
    means, errors = [], []
    for light_share in (None, 1.0, 0.0):
        if light_share is not None:
            monkeypatch.setattr(direct_light, "power_heuristic", lambda p, q, s=light_share: np.full(np.shape(p), s))
            monkeypatch.setattr(
                contributions, "power_heuristic", lambda p, q, s=light_share: np.where(np.isinf(p), 1.0, 1.0 - s)
            )
        seen = look_around(scene, max_bounces=40)[:, 0]
        means.append(seen.mean())
        errors.append(seen.std() / np.sqrt(len(seen)))
    for other in (1, 2):
        assert abs(means[0] - means[other]) <= SIGMAS * np.hypot(errors[0], errors[other])


def check_that_roulette_changes_no_mean(scene, monkeypatch):
    """Compare what is seen around with and without roulette: other numbers, the same means."""
    cut = look_around(scene, max_bounces=6)
    monkeypatch.setattr(scattering, "CERTAIN_BOUNCES", 100)
    whole = look_around(scene, max_bounces=6)
    error = np.hypot(cut.std(axis=0), whole.std(axis=0)) / np.sqrt(COUNT)
    assert (cut != whole).any()
    assert (np.abs(cut.mean(axis=0) - whole.mean(axis=0)) <= SIGMAS * error).all()


def test_roulette_changes_no_mean(monkeypatch):
    walls = Material((Closure("diffuse", color=(0.3, 0.6, 0.9)), Closure("emission", color=1.0)))
    check_that_roulette_changes_no_mean(raytracer.Scene(meshes=[BOX], materials=[walls]), monkeypatch)


MIRROR = Closure("glossy", color=0.6, roughness=0.0)


def make_mirrors(*others, world=None):
    """A box of mirrors, and something matte outside it, for in a scene without that no roulette is played."""
    outside = raytracer.Mesh([[5, 5, 5], [6, 5, 5], [5, 6, 5]], [[0, 1, 2]], material=1)
    materials = [Material((MIRROR, *others)), Material((Closure("diffuse"),))]
    return raytracer.Scene(meshes=[BOX, outside], materials=materials, world=world)


def test_roulette_leaves_alone_what_the_next_surface_shows_in_a_mirror():
    """In a box of mirrors that shine with 1 and reflect a, every path sees 1 + a + a^2 that ends after two bounces.

    The second is left to chance, but not what it shows.
    """
    seen = look_around(make_mirrors(Closure("emission", color=1.0)), count=1000, max_bounces=1)
    np.testing.assert_allclose(seen, 1 + 0.6 + 0.6**2, rtol=1e-12)


def test_late_roulette_changes_no_mean(monkeypatch):
    """Walls that mirror and scatter, of which only some shine: most of those that chance ends see nothing."""
    dark = (MIRROR, Closure("diffuse", color=(0.1, 0.2, 0.3)))
    walls = [Material(dark), Material((*dark, Closure("emission", color=1.0)))]
    box = replace(BOX, material=(np.arange(12) < 2).astype(np.int32))
    check_that_roulette_changes_no_mean(raytracer.Scene(meshes=[box], materials=walls), monkeypatch)


def test_a_path_that_chance_ends_is_cast_but_not_shaded_where_nothing_shines(monkeypatch):
    cast, shaded = [], []
    find_shaded, advance = loop.find_shaded, scattering.advance
    monkeypatch.setattr(loop, "find_shaded", lambda *given: cast.append(len(given[1])) or find_shaded(*given))
    monkeypatch.setattr(scattering, "advance", lambda *given: shaded.append(len(given[0])) or advance(*given))
    look_around(make_mirrors(world=raytracer.World(1.0)), count=1000, max_bounces=3)
    assert cast[:3] == [1000, 1000, 1000]
    assert shaded[:2] == [1000, 1000]
    survival = np.sqrt(0.6**2)
    assert abs(shaded[2] - 1000 * survival) < SIGMAS * np.sqrt(1000 * survival * (1 - survival))


def test_paths_that_two_colors_leave_black_end_without_a_warning():
    """Red and green walls that share no channel: blue is what shines, red and green bounce on their own walls only.

    Warnings are errors here, and a survival probability of 0 was divided by.
    """
    colors = np.array([(0.5, 0.0, 0.0), (0.0, 0.5, 0.0)])
    walls = [Material((Closure("diffuse", color=color), Closure("emission", color=1.0))) for color in colors]
    box = replace(BOX, material=np.arange(12, dtype=np.int32) // 2 % 2)
    seen = look_around(raytracer.Scene(meshes=[box], materials=walls), max_bounces=5)
    assert np.isfinite(seen).all()
    assert (seen[:, 2] == 1.0).all()
    assert (seen[:, :2] >= 1.0).all()
    assert (seen[:, :2] > 1.0).any(axis=0).all()


# Limits --------------------------------------------------------------------------------------------------------------


def test_a_bounce_counts_by_its_kind():
    kinds = np.array(
        [STRAIGHT, DIFFUSE, GLOSSY, GLOSSY | SINGULAR, GLOSSY | TRANSMITTED, DIFFUSE | TRANSMITTED, SCATTERED], np.uint8
    )
    counts = count_bounces(np.ones((7, 4), np.int32), kinds)
    surfaces = [[0, 0, 0, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1, 0]]
    np.testing.assert_array_equal(counts - 1, [*surfaces, [0, 0, 0, 1]])


@pytest.mark.parametrize(
    ("limits", "ended"),
    [
        ({"max_bounces": 7}, True),
        ({"max_bounces": 8}, False),
        ({"max_bounces": 9, "diffuse_bounces": 2}, False),
        ({"max_bounces": 9, "diffuse_bounces": 1}, True),
        ({"max_bounces": 9, "glossy_bounces": 2}, True),
        ({"max_bounces": 9, "transmission_bounces": 0}, True),
        ({"max_bounces": 9, "volume_bounces": 1}, True),
        ({"max_bounces": 9, "diffuse_bounces": 2, "glossy_bounces": 3, "transmission_bounces": 1}, False),
    ],
)
def test_the_first_limit_that_is_passed_ends_a_path(limits, ended):
    assert bounces.find_ended(np.array([[2, 3, 1, 2]], np.int32), Settings(**limits))[0] == ended


@pytest.mark.parametrize("most", [0, 1, 2])
def test_diffuse_bounces_have_a_limit_of_their_own(most):
    walls = Material((Closure("diffuse", color=0.5), Closure("emission", color=1.0)))
    seen = look_around(raytracer.Scene(meshes=[BOX], materials=[walls]), max_bounces=20, diffuse_bounces=most)
    assert_mean(seen, np.full(3, 2 * (1 - 0.5 ** (most + 2))))


@pytest.mark.parametrize("most", [1, 3, 7])
def test_transparent_passages_have_a_limit_and_the_last_one_sees_what_shines(most):
    """Rays cross panes that shine and let half of the light through."""
    pane = Material((Closure("transparent", color=0.5), Closure("emission", color=1.0)))
    corners = [[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]]
    panes = [raytracer.Mesh(np.add(corners, (0, 0, -k)), [[0, 1, 2], [0, 2, 3]]) for k in range(10)]
    scene = raytracer.Scene(meshes=panes, materials=[pane])
    rays = make_rays([[0.1, 0.2, 1.0]], [[0, 0, -1.0]])
    settings = Settings(transparent_bounces=most)
    seen = trace(prepare(scene, raytracer.build(scene), settings), rays, SobolSamples(np.zeros(1, np.uint32), 0, 0))
    np.testing.assert_allclose(seen["Combined"][0, 0], 2 * (1 - 0.5 ** (most + 1)), rtol=1e-14)


@pytest.mark.parametrize(("limits", "most"), [({}, 3), ({"shadow_passages": 2}, 2), ({"shadow_passages": 0}, 0)])
def test_shadow_rays_pass_as_many_surfaces_as_they_may(limits, most):
    """A lamp above panes lights the floor through as many as are allowed, and through no more."""
    clear, white = Material((Closure("transparent", color=1.0),)), Material((Closure("diffuse", color=1.0),))
    corners = np.array([[-9.0, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]])
    rays = make_rays([[0.1, 0.2, 0.5]], [[0, 0, -1.0]])
    lit = []
    for panes in range(5):
        sheets = [np.add(corners, (0, 0, height)) for height in range(panes + 1)]
        meshes = [raytracer.Mesh(p, [[0, 1, 2], [0, 2, 3]], material=[min(i, 1)] * 2) for i, p in enumerate(sheets)]
        lamp = raytracer.PointLight((0, 0, 8), 30)
        scene = raytracer.Scene(meshes=meshes, materials=[white, clear], lights=[lamp])
        integrator = prepare(scene, raytracer.build(scene), Settings(transparent_bounces=3, **limits))
        seen = trace(integrator, rays, SobolSamples(np.zeros(1, np.uint32), 0, 0))
        lit.append(seen["Combined"][0, 0] > 0)
    assert lit == [panes <= most for panes in range(5)]


# Only what the scene needs -------------------------------------------------------------------------------------------


def test_paths_stop_where_no_ray_could_meet_a_light():
    """With a lamp without extent the last bounce is no ray: as many casts as bounces, and the shadow rays."""
    calls = []
    scene = raytracer.Scene(
        meshes=[BOX],
        materials=[Material((Closure("diffuse", color=0.9),))],
        lights=[raytracer.PointLight((0, 0, 0.5), 30)],
    )
    caster = raytracer.build(scene)

    class Watched:
        def __getattr__(self, name):
            return getattr(caster, name)

        def closest_hit(self, *arguments):
            calls.append(len(arguments[0]))
            return caster.closest_hit(*arguments)

    rays, samples = (
        make_rays([[0, 0, 0.0]] * 50, [[0.3, 0.2, -1.0]]),
        SobolSamples(np.arange(50, dtype=np.uint32), 0, 0),
    )
    trace(prepare(scene, Watched(), Settings(integrator="path", max_bounces=1)), rays, samples)
    assert calls == [50, 50]


def test_a_scene_of_mirrors_is_the_same_by_either_integrator():
    """No diffuse surface: the very same values, and no chance to be cut short."""
    mirror = Material((Closure("glossy", color=0.9, roughness=0.2), Closure("emission", color=0.1)))
    scene = raytracer.Scene(meshes=[BOX], materials=[mirror])
    seen = [look_around(scene, count=200, integrator=name) for name in ("direct", "path")]
    np.testing.assert_array_equal(*seen)


def test_direct_never_asks_for_diffuse_reflection(monkeypatch):
    forbid(monkeypatch, "survival_probability")
    monkeypatch.setattr(bsdf_samples, "_sample_diffuse", None)
    scene = make_tilted_parts()
    assert look_around(scene, count=100, integrator="direct", origin=(0.1, 0.2, 3.0)).any()


# The same picture ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("settings", [{"block_size": 7}, {"workers": 2, "block_size": 40}])
def test_pictures_are_the_same_for_any_block_size_and_number_of_workers(settings):
    closures = (Closure("diffuse", color=0.5), Closure("glossy", color=0.3, roughness=0.3))
    scene = raytracer.Scene(
        meshes=[BOX],
        materials=[Material(closures)],
        lights=[raytracer.PointLight((0, 0, 0.5), 30, radius=0.2)],
        camera=raytracer.Camera(np.eye(4)),
    )
    plain, other = (
        raytracer.render(scene, 12, 8, samples=4, integrator="path", **more)["Combined"] for more in ({}, settings)
    )
    np.testing.assert_array_equal(plain, other)


# What paths are told -------------------------------------------------------------------------------------------------


def test_light_path_tells_kinds_and_depths():
    kinds = np.array([STRAIGHT, DIFFUSE, GLOSSY, GLOSSY | SINGULAR, GLOSSY | TRANSMITTED, SCATTERED], np.uint8)
    counts = [[0, 0, 0, 0], [1, 0, 0, 0], [1, 2, 0, 0], [0, 1, 0, 0], [2, 1, 4, 0], [0, 0, 1, 2]]
    told = describe_kinds(kinds, np.array(counts, np.int32))
    expected = {
        "camera": [1, 0, 0, 0, 0, 0],
        "diffuse": [0, 1, 0, 0, 0, 0],
        "glossy": [0, 0, 1, 1, 1, 0],
        "singular": [0, 0, 0, 1, 0, 0],
        "volume": [0, 0, 0, 0, 0, 1],
        "reflection": [0, 1, 1, 1, 0, 0],
        "transmission": [0, 0, 0, 0, 1, 0],
        "depth": [0, 1, 3, 1, 7, 3],
        "diffuse_depth": [0, 1, 1, 0, 2, 0],
        "glossy_depth": [0, 0, 2, 1, 1, 0],
        "transmission_depth": [0, 0, 0, 0, 4, 1],
        "volume_depth": [0, 0, 0, 0, 0, 2],
    }
    assert {name: values.tolist() for name, values in told.items()} == expected
