"""Shadow catchers: how much darker the rest of the scene makes them, in pictures that are known in closed form.

The camera hangs close over the ground and looks down, so that it sees what throws shadows from farther up only by its
shadow. Every pixel is one ray through its centre.
"""

import numpy as np
import pytest

import raytracer
from raytracer.film.shown import show_shadows
from raytracer.integrator.prepare import prepare
from raytracer.integrator.settings import Settings
from raytracer.rendering.render import render
from raytracer.scene.fields import SEEN_BY
from raytracer.scene.materials import Closure, Material
from raytracer.scene.media import Volume, VolumeClosure
from raytracer.scene.programs import Program, Register, Step
from tests.raytracer.integrator.media_scenes import make_box

DIFFUSE, MIRROR, PANE, GLOWING, THIN = range(5)
MATERIALS = [
    Material((Closure("diffuse", color=(0.8, 0.5, 0.2)),)),
    Material((Closure("glossy", color=0.9, roughness=0.0),)),
    Material((Closure("transparent", color=0.25),)),
    Material((Closure("emission", color=2.0), Closure("diffuse", color=0.5))),
    Material((Closure("transparent", color=1.0, weight=0.25), Closure("diffuse", color=0.8, weight=0.75))),
]
OVERHEAD = raytracer.SunLight((0, 0, 1), 3.0)
# As bright on the ground as the one overhead; throws the shadow of what is at height 1 a metre to the left.
SLANTED = raytracer.SunLight((1, 0, 1), 3.0 * np.sqrt(2))
# Pixels of one row: their centres lie at -1.75, -1.25 ... 1.75.
LEFT, MIDDLE, RIGHT = slice(0, 2), slice(2, 4), slice(4, 8)


def quad(x_min, x_max, height, material=DIFFUSE):
    corners = [(x_min, -9, height), (x_max, -9, height), (x_max, 9, height), (x_min, 9, height)]
    return raytracer.Mesh(corners, [(0, 1, 2), (0, 2, 3)], material=material)


GROUND, ROOF = quad(-9, 9, 0), quad(-9, 0, 1)


def make_scene(meshes, catches, lights=(OVERHEAD,), world=None, **options):
    matrix = np.eye(4)
    matrix[2, 3] = 0.9
    return raytracer.Scene(
        meshes=meshes,
        instances=raytracer.Instances(
            np.arange(len(meshes)),
            [np.eye(4)] * len(meshes),
            shadow_catcher=catches,
            holdout=options.pop("holdout", None),
        ),
        materials=options.pop("materials", MATERIALS),
        lights=lights,
        world=world,
        camera=raytracer.Camera(matrix, projection="orthographic", ortho_scale=4.0),
        **options,
    )


def see(scene, samples=1, transparent=True, **settings):
    film = render(scene, 8, 1, samples, transparent=transparent, filter_width=0.0, **settings)
    return film["Combined"][0]


def test_one_sun_blocked_is_black_of_alpha_1_and_none_is_nothing():
    picture = see(make_scene([GROUND, ROOF], [True, False]))
    assert not picture[:, :3].any()
    assert picture[:, 3].tolist() == [1] * 4 + [0] * 4


def test_one_of_two_equal_suns_blocked_is_half_transparent():
    alpha = see(make_scene([GROUND, ROOF], [True, False], [OVERHEAD, SLANTED]))[:, 3]
    assert (alpha[LEFT] == 1).all()
    assert (alpha[RIGHT] == 0).all()
    np.testing.assert_allclose(alpha[MIDDLE], 0.5, rtol=1e-6)


def test_shadows_of_colored_light_show_by_the_mean_of_channels():
    """Alpha is 1 - mean of the channels' factors: (0 + 1 + 1) / 3 where red goes, grey of the ground or not."""
    lights = [raytracer.SunLight((0, 0, 1), (1, 0, 0)), raytracer.SunLight((1, 0, 1), (0, 1, 1))]
    alpha = see(make_scene([GROUND, ROOF], [True, False], lights))[:, 3]
    np.testing.assert_allclose(alpha, np.repeat([1, 1 / 3, 0], [2, 2, 4]), rtol=1e-6)


@pytest.mark.parametrize("roof_catches", [True, False])
def test_one_catcher_throws_no_shadow_on_another(roof_catches):
    alpha = see(make_scene([GROUND, ROOF], [True, roof_catches]))[:, 3]
    assert alpha.any() != roof_catches


def test_a_lamp_that_is_no_part_of_the_footage_takes_from_the_shadow_only():
    lamp = raytracer.SunLight((1, 0, 1), 0.75 * np.sqrt(2), shadow_catcher=False)
    alpha = see(make_scene([GROUND, ROOF], [True, False], [OVERHEAD, lamp]))[:, 3]
    np.testing.assert_allclose(alpha, np.repeat([1, 0.75, 0], [2, 2, 4]), rtol=1e-6)


FOG = Volume((VolumeClosure("absorption", color=0.5, density=0.8),))  # takes 0.4 of each metre's light


@pytest.mark.parametrize("catches", [True, False], ids=["of the footage", "of the scene"])
def test_fog_of_the_scene_is_a_shadow_and_of_the_footage_is_none(catches):
    """Over ground that stands in it 2 m deep, and a camera at 0.9 m; both are in it, and see nothing of its border."""
    fog = make_box((9.5, 9.5, 3), (0, 0, -1), material=len(MATERIALS))
    materials = [*MATERIALS, Material(volume=FOG, only_volume=True)]
    scene = make_scene([GROUND, fog], [True, catches], materials=materials)
    before, above = np.exp(-0.4 * np.array([0.9, 2.0]))
    expected = 1.0 - before if catches else 1.0 - before * above
    np.testing.assert_allclose(see(scene)[:, 3], expected, rtol=1e-6)


def test_fog_of_the_world_is_no_part_of_the_footage():
    """A sun that it hides altogether is a shadow."""
    world = raytracer.World(0.0, volume=FOG)
    assert (see(make_scene([GROUND], [True], world=world))[:, 3] == 1.0).all()


def make_gradient():
    """A world of radiance 1 + z."""
    steps = (
        Step("NEW_GEOMETRY Position"),
        Step("VECT_MATH Value", (Register(0, "Position"), np.array([0.0, 0, 1])), {"operation": "DOT_PRODUCT"}),
        Step("MATH", (Register(1, "Value"), 1.0, 0.0), {"operation": "ADD"}),
        Step("VECT_MATH Vector", (np.ones(3), np.zeros(3), np.zeros(3), Register(2, "Value")), {"operation": "SCALE"}),
    )
    return raytracer.World(Register(3, "Vector"), Program(steps))


def test_light_that_only_adds_shows_nothing_however_noisy_the_rest():
    """Both halves of a path look at the same places of an uneven sky, whichever lamps else there are."""
    lamp = raytracer.PointLight((3, 2, 4), 1e-3, radius=0.5, shadow_catcher=False)
    glow = raytracer.Spheres([(30, 20, 4)], [1.0], material=GLOWING, seen_by=SEEN_BY["camera"])  # blocks nothing
    for spheres in ((), [glow]):
        scene = make_scene([GROUND], [True], [lamp, OVERHEAD], make_gradient(), spheres=spheres)
        assert not see(scene, 4).any()


def test_what_shines_is_part_of_the_footage_if_it_catches():
    """With a glowing ceiling as a catcher its shadow is seen, without it lights up what else is dark."""
    meshes = [GROUND, ROOF, quad(-9, 9, 3, GLOWING)]
    alpha = [see(make_scene(meshes, [True, False, both], lights=()), 64)[:, 3] for both in (True, False)]
    assert (alpha[0][LEFT] > 0.5).all()
    assert not alpha[1].any()


def test_over_an_opaque_film_the_background_is_darkened():
    world = raytracer.World((0.3, 0.2, 0.1))
    scene = make_scene([GROUND, ROOF], [True, False], [OVERHEAD], world)
    over, alone = see(scene, 16, transparent=False), see(scene, 16)
    assert ((alone[:, 3] > 0) & (alone[:, 3] < 1)).any()
    # Alpha near 1 is known to half a rounding of float32, from 1.
    np.testing.assert_allclose(over[:, :3], (1 - alone[:, 3:]) * world.color, atol=np.finfo(np.float32).eps)
    assert (over[:, 3] == 1).all()


def test_the_environment_behind_a_catcher_is_that_of_an_opaque_film():
    """As in Cycles: what Combined shows through the shadows; where the film is transparent nothing is behind them."""
    world = raytracer.World((0.3, 0.2, 0.1))
    scene = make_scene([GROUND, quad(-9, 0, 0.5)], [True, False], [OVERHEAD], world)
    for transparent, behind in ((False, world.color), (True, 0.0)):
        names = ("Combined", "Environment")
        film = render(scene, 8, 1, 1, transparent=transparent, filter_width=0.0, passes=names)
        assert not film["Environment"][0, :4].any()
        np.testing.assert_allclose(film["Environment"][0, 4:], np.broadcast_to(behind, (4, 3)), rtol=1e-6)


def test_what_lies_in_front_hides_the_catcher_by_its_own_alpha():
    """A pane that lets a quarter through shows the shadow in that quarter; the sun comes through it as well."""
    alpha = see(make_scene([GROUND, ROOF, quad(-9, 9, 0.5, PANE)], [True, False, False]))[:, 3]
    np.testing.assert_allclose(alpha[RIGHT], 0.75 + 0.25 * 0.75, rtol=1e-6)
    np.testing.assert_allclose(alpha[:4], 1.0, rtol=1e-6)


def test_a_catcher_that_is_seen_through_counts_what_passes_twice_as_in_cycles():
    """A quarter goes through, in either half of the path: 1 - 2 / 4 of the shadow is left."""
    alpha = see(make_scene([quad(-9, 9, 0, THIN), ROOF], [True, False]))[:, 3]
    np.testing.assert_allclose(alpha, np.repeat([0.5, 0], 4), rtol=1e-6)


def test_the_first_of_two_catchers_splits_the_path():
    """What is seen through a thin catcher, another one, is light that it catches as well: none of it is in front."""
    picture = see(make_scene([quad(-9, 9, 0.2, THIN), GROUND, ROOF], [True, True, False]))
    assert not picture[:, :3].any()
    np.testing.assert_allclose(picture[:, 3], np.repeat([1, 0], 4), rtol=1e-6)


def test_objects_in_front_are_seen_as_they_are():
    meshes = [GROUND, ROOF, quad(-9, -1, 0.5)]
    lights = [OVERHEAD, SLANTED]
    picture, plain = (see(make_scene(meshes, [catches, False, False], lights)) for catches in (True, False))
    np.testing.assert_array_equal(picture[LEFT], plain[LEFT])


def test_a_mirror_shows_the_catcher_as_an_ordinary_object():
    """The camera sees a mirror that reflects a lit ceiling; whether that is a catcher makes no difference."""
    lamp = raytracer.PointLight((0.4, 0.3, 0.5), 20)
    meshes = [quad(-9, 9, 0, MIRROR), quad(-9, 9, 2)]
    pictures = [see(make_scene(meshes, [False, catches], [lamp])) for catches in (True, False)]
    assert (pictures[0][:, 3] == 1).all()
    assert pictures[0][:, :3].min() > 0
    np.testing.assert_array_equal(*pictures)


def test_a_catcher_that_punches_a_hole_catches_nothing():
    picture = see(make_scene([GROUND, ROOF], [True, False], holdout=[True, False]))
    assert not picture.any()


def test_the_unlit_side_of_a_round_catcher_is_no_shadow():
    ball = raytracer.Spheres([(0, 0, -3)], [2.5], shadow_catcher=True)
    alpha = see(make_scene([ROOF], [False], [OVERHEAD], spheres=[ball]))[:, 3]
    assert alpha.tolist() == [1] * 4 + [0] * 4
    below = raytracer.SunLight((0, 0, -1), 3.0)
    assert not see(make_scene([ROOF], [False], [below], spheres=[ball])).any()


@pytest.mark.parametrize("settings", [{"workers": 2}, {"block_size": 3}, {"border": (0, 0, 8, 1)}])
def test_how_the_work_is_divided_changes_nothing(settings):
    scene = make_scene([GROUND, ROOF], [True, False], [OVERHEAD], raytracer.World(0.3))
    np.testing.assert_array_equal(see(scene, 4, **settings), see(scene, 4))


def test_interreflection_brightens_a_shadow():
    """Below a roof that stops all direct light, the roof shows what the ground beside reflects."""
    scene = make_scene([GROUND, ROOF], [True, False], [SLANTED])
    direct, path = (see(scene, 256, integrator=name)[:, 3] for name in ("direct", "path"))
    assert (direct[LEFT] == 1).all()
    assert ((path[LEFT] > 0) & (path[LEFT] < 1)).all()


def test_without_catchers_nothing_is_prepared():
    scene = make_scene([GROUND, ROOF], [False, False])
    integrator = prepare(scene, raytracer.build(scene), Settings())
    assert integrator.catchers_only is None
    assert integrator.is_catcher is None
    assert not render(scene, 2, 1, 1).catches
    caught = make_scene([GROUND, ROOF], [True, False])
    assert prepare(caught, raytracer.build(caught), Settings(passes=("Depth",))).catchers_only is None


def test_where_catchers_are_dark_anyway_nothing_is_shown():
    """0 / 0 and what is brighter than before leave the footage as it is."""
    combined = np.zeros((2, 4))
    caught = np.zeros((2, 11))
    caught[:, 6] = 1
    caught[1, :6] = (4, 4, 4, 1, 1, 1)
    assert not show_shadows(combined, caught).any()


def test_shadow_catcher_pass_is_the_factor_of_the_footage_and_combined_leaves_it_to_that():
    lights = [raytracer.SunLight((0, 0, 1), (1, 0, 0)), raytracer.SunLight((1, 0, 1), (0, 1, 1))]
    scene = make_scene([GROUND, ROOF], [True, False], lights)
    for transparent in (True, False):
        film = render(scene, 8, 1, 1, transparent=transparent, filter_width=0.0, passes=("Combined", "Shadow Catcher"))
        factor = film["Shadow Catcher"][0]
        np.testing.assert_allclose(factor[LEFT], 0.0, atol=1e-6)
        np.testing.assert_allclose(factor[MIDDLE], [(0, 1, 1)] * 2, rtol=1e-6)
        np.testing.assert_allclose(factor[RIGHT], 1.0, rtol=1e-6)
        assert not film["Combined"].any()
    plain = render(make_scene([GROUND], [False]), 4, 2, 1, passes=("Shadow Catcher",))
    assert (plain["Shadow Catcher"] == 1).all()


def test_shadow_catcher_pass_alone_is_the_same_and_goes_on_with_films(tmp_path):
    scene = make_scene([GROUND, ROOF], [True, False], [OVERHEAD, SLANTED], raytracer.World(0.5))
    names = ("Combined", "Shadow Catcher")
    whole = render(scene, 8, 6, 8, passes=names)
    alone = render(scene, 8, 6, 8, passes=names[1:])
    raytracer.save_film(render(scene, 8, 6, 4, passes=names), tmp_path / "film.npz")
    continued = render(scene, 8, 6, 8, passes=names, film=raytracer.load_film(tmp_path / "film.npz"))
    for film in (alone, continued):
        np.testing.assert_array_equal(film["Shadow Catcher"], whole["Shadow Catcher"])


def test_light_that_comes_by_catchers_is_in_no_other_pass_of_light():
    """It belongs to the footage: nothing of the ground's, all of the roof's light."""
    groups = raytracer.LightGroups(("lamps",), [0], [0, 0])
    names = ("Combined", "Combined_lamps", "Diffuse Direct")
    for catches in (True, False):
        scene = make_scene([GROUND], [catches], light_groups=raytracer.LightGroups(("lamps",), [0], [0]))
        film = render(scene, 8, 1, 1, transparent=True, filter_width=0.0, passes=names)
        assert all(film[name].any() != catches for name in names[1:])
    seen = make_scene([GROUND, quad(-9, 9, 0.5)], [True, False], light_groups=groups)
    film = render(seen, 8, 1, 1, transparent=True, filter_width=0.0, passes=names)
    np.testing.assert_array_equal(film["Combined_lamps"], film["Combined"][..., :3])
    assert film["Diffuse Direct"].all()
