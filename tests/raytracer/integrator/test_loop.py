"""The bounce loop: what runs for which scene, and what the passes hold."""

import numpy as np
import pytest

import raytracer
from raytracer.casting.rays import make_rays
from raytracer.integrator import contributions, direct_light
from raytracer.integrator.loop import trace
from raytracer.integrator.prepare import prepare
from raytracer.integrator.settings import Settings
from raytracer.sampling.sobol import SobolSamples
from raytracer.scene.materials import Closure, Material
from tests.forbidding import forbid

FLOOR = raytracer.Mesh([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], [[0, 1, 2], [0, 2, 3]], name="floor")
GREY = Material((Closure("diffuse", color=0.5),))
LIGHT = raytracer.PointLight((0, 0, 4), 100)
DATA = ("Depth", "Position", "Normal", "UV", "Object Index", "Material Index")


def square(height, material=0, size=9.0):
    corners = [[-size, -size, height], [size, -size, height], [size, size, height], [-size, size, height]]
    return raytracer.Mesh(corners, [[0, 1, 2], [0, 2, 3]], material=material)


def see(scene, origins=(0.5, 0.2, 3.0), directions=(0.0, 0.0, -1.0), count=None, sample=0, **settings):
    """Trace rays through a scene; returns the passes."""
    rays = make_rays(np.atleast_2d(origins), np.atleast_2d(directions))
    if count is not None:
        rays = make_rays(np.repeat(rays.origins, count, axis=0), np.repeat(rays.directions, count, axis=0))
    samples = SobolSamples(np.arange(len(rays), dtype=np.uint32), sample, 0)
    return trace(prepare(scene, raytracer.build(scene), Settings(**settings)), rays, samples)


def mean_color(values):
    return values["Combined"][:, :3].mean(axis=0)


# Only what the scene needs -------------------------------------------------------------------------------------------

STAGES = {
    "make_emitters": Material((Closure("emission", color=1.0),)),
    "transparent_visibility": Material((Closure("transparent"),)),
    "sample_bsdf": Material((Closure("glossy"),)),
}


def test_prepare_composes_no_stage_that_the_scene_lacks(monkeypatch):
    forbid(
        monkeypatch,
        *("make_emitters", "EmissiveGeometry", "make_world_sources", "transparent_visibility", "sample_bsdf"),
        *("emitter_density", "environment_density", "make_environment", "evaluate_light"),
    )
    values = see(raytracer.Scene(meshes=[FLOOR], materials=[GREY], lights=[LIGHT]))
    assert values["Combined"][0, 0] > 0


@pytest.mark.parametrize("stage", STAGES)
def test_prepare_composes_each_stage_for_the_material_that_needs_it(monkeypatch, stage):
    forbid(monkeypatch, stage)
    scene = raytracer.Scene(meshes=[FLOOR], materials=[STAGES[stage]], lights=[LIGHT])
    with pytest.raises(AssertionError, match="does not need"):
        see(scene)


def test_prepare_for_data_passes_casts_no_light(monkeypatch):
    forbid(monkeypatch, "make_emitters", "add_direct_light", "make_world_sources", "make_light_source", "sample_bsdf")
    scene = raytracer.Scene(
        meshes=[FLOOR], materials=[STAGES["make_emitters"]], lights=[LIGHT], world=raytracer.World(1.0)
    )
    assert see(scene, passes=DATA)["Depth"][0, 0] == 3


def test_prepare_leaves_out_lamps_without_power():
    scene = raytracer.Scene(meshes=[FLOOR], lights=[raytracer.PointLight((0, 0, 1), 0), LIGHT])
    assert len(prepare(scene, raytracer.build(scene), Settings()).sources) == 1


def test_an_absent_feature_leaves_the_other_values_untouched_bit_for_bit():
    """A material that no surface uses adds stages, but no light."""
    plain = raytracer.Scene(meshes=[FLOOR], materials=[GREY], lights=[LIGHT])
    more = raytracer.Scene(meshes=[FLOOR], materials=[GREY, *STAGES.values()], lights=[LIGHT])
    rng = np.random.default_rng(1)
    origins = np.c_[rng.uniform(-5, 5, (50, 2)), np.full(50, 3.0)]
    np.testing.assert_array_equal(see(plain, origins)["Combined"], see(more, origins)["Combined"])


# The loop ------------------------------------------------------------------------------------------------------------


def test_trace_gives_a_ray_the_same_value_in_any_batch():
    scene = raytracer.Scene(
        meshes=[FLOOR, square(1.0, 1, 1.0)],
        materials=[GREY, Material((Closure("principled", roughness=0.3, alpha=0.6),))],
        lights=[raytracer.PointLight((0, 0, 4), 100, radius=0.5)],
        world=raytracer.World(0.2),
    )
    rng = np.random.default_rng(2)
    rays = make_rays(np.c_[rng.uniform(-2, 2, (64, 2)), np.full(64, 3.0)], [0.1, 0, -1.0])
    samples = SobolSamples(np.arange(64, dtype=np.uint32), 3, 5)
    integrator = prepare(scene, raytracer.build(scene), Settings())
    together = trace(integrator, rays, samples)["Combined"]
    rows = rng.permutation(64)[:20]
    apart = trace(integrator, rays.select(rows), samples.select(rows))["Combined"]
    np.testing.assert_array_equal(together[rows], apart)


@pytest.mark.parametrize("bounces", [0, 1, 2, 5])
def test_max_bounces_limits_reflections_and_ends_on_what_shines(bounces):
    """Two mirrors face each other; the rays that may go on no further still see whether the surface shines."""
    glow = Material((Closure("glossy", color=0.5, roughness=0.0), Closure("emission", color=1.0)))
    scene = raytracer.Scene(meshes=[FLOOR, square(4.0)], materials=[glow])
    values = see(scene, max_bounces=bounces)
    expected = sum(0.5**k for k in range(bounces + 2))
    np.testing.assert_allclose(values["Combined"][0, :3], expected, rtol=1e-14)


@pytest.mark.slow
def test_a_thousand_bounces_need_no_recursion():
    scene = raytracer.Scene(
        meshes=[FLOOR, square(4.0)],
        materials=[Material((Closure("glossy", color=1.0, roughness=0.0), Closure("emission", color=1.0)))],
    )
    assert see(scene, max_bounces=1000)["Combined"][0, 0] == 1002


def test_invalid_rays_see_the_background():
    scene = raytracer.Scene(meshes=[FLOOR], world=raytracer.World((0.1, 0.2, 0.3)))
    values = see(scene, [[0, 0, 1], [np.nan, 0, 0]], [[0, 0, 0], [0, 0, -1]])
    np.testing.assert_allclose(values["Combined"], [[0.1, 0.2, 0.3, 1.0]] * 2)


def test_empty_scene_and_empty_batch():
    values = see(raytracer.Scene())
    np.testing.assert_array_equal(values["Combined"], [[0, 0, 0, 1]])
    assert see(raytracer.Scene(), np.zeros((0, 3)), np.zeros((0, 3)))["Combined"].shape == (0, 4)


# Lamps ---------------------------------------------------------------------------------------------------------------

MIRROR = Material((Closure("glossy", color=(1.0, 0.5, 0.25), roughness=0.0),))


@pytest.mark.parametrize("soft", [True, False])
def test_lamps_are_seen_in_mirrors_but_not_by_the_camera(soft):
    lamp = raytracer.PointLight((0, 0, 2), 40, radius=0.5, soft_falloff=soft)
    scene = raytracer.Scene(meshes=[FLOOR], materials=[MIRROR], lights=[lamp])
    radiance = 40 / (4 * np.pi**2 * 0.25)
    seen = see(scene, [0, 0, 5.0])["Combined"][0, :3]
    np.testing.assert_allclose(seen, radiance * np.array([1.0, 0.5, 0.25]), rtol=1e-13)


def test_a_lamp_behind_a_surface_is_not_seen():
    lamp = raytracer.PointLight((0, 0, 4), 40, radius=0.5)
    scene = raytracer.Scene(meshes=[FLOOR, square(3.0, 1)], materials=[MIRROR, GREY], lights=[lamp])
    assert not mean_color(see(scene, [0, 0, 2.0])).any()


def test_lamps_are_seen_through_glass_once_and_never_straight():
    lamp = raytracer.PointLight((0, 0, -2), 40, radius=0.5)
    for kind, expected in (("refraction", 40 / (4 * np.pi**2 * 0.25)), ("transparent", 0.0)):
        pane = Material((Closure(kind, color=1.0, roughness=0.0, ior=1.0 + 1e-6),))
        scene = raytracer.Scene(meshes=[square(0.0), square(-1.0)], materials=[pane], lights=[lamp])
        np.testing.assert_allclose(mean_color(see(scene, [0, 0, 2.0])), expected, rtol=1e-12)


def test_two_panes_count_a_lamp_between_them_and_behind_them_once():
    """A path that goes straight on after a mirror keeps its lamps: each is met once, wherever the stretch ends."""
    pane = Material((Closure("transparent", color=1.0),))
    for height in (0.5, 1.5, 2.5):
        lamp = raytracer.PointLight((0, 0, height), 40, radius=0.2, soft_falloff=False)
        scene = raytracer.Scene(meshes=[FLOOR, square(1.0, 1), square(2.0, 1)], materials=[MIRROR, pane], lights=[lamp])
        np.testing.assert_allclose(mean_color(see(scene, [0, 0, 5.0]))[0], 40 / (4 * np.pi**2 * 0.04), rtol=1e-12)


def test_rough_reflection_of_a_lamp_is_the_same_by_either_way_of_sampling(monkeypatch):
    """With all weight on light sampling, and with all on reflection, the mean is that of their mixture."""
    lamp = raytracer.PointLight((0.5, 0, 2), 40, radius=0.6, soft_falloff=False)
    rough = Material((Closure("glossy", color=1.0, roughness=0.5),))
    scene = raytracer.Scene(meshes=[FLOOR], materials=[rough], lights=[lamp])
    means, errors = [], []
    original = contributions.power_heuristic
    for light_share in (None, 1.0, 0.0):
        if light_share is not None:
            monkeypatch.setattr(direct_light, "power_heuristic", lambda p, q, s=light_share: np.full(np.shape(p), s))
            monkeypatch.setattr(
                contributions, "power_heuristic", lambda p, q, s=light_share: np.where(np.isinf(p), 1.0, 1.0 - s)
            )
        values = see(scene, [-2, 0, 2.0], [1, 0, -1.0], count=20_000)["Combined"][:, 0]
        means.append(values.mean())
        errors.append(values.std() / np.sqrt(len(values)))
    assert original(np.ones(1), np.ones(1))[0] == 0.5
    assert abs(means[0] - means[1]) < 4 * np.hypot(errors[0], errors[1])
    assert abs(means[0] - means[2]) < 4 * np.hypot(errors[0], errors[2])
    assert errors[0] < 1.5 * min(errors)


# Shadows and transparency --------------------------------------------------------------------------------------------


def test_shadow_rays_stop_at_surfaces_and_lamps_may_throw_none():
    for cast_shadow, lit in ((True, False), (False, True)):
        lamp = raytracer.PointLight((0, 0, 4), 100, cast_shadow=cast_shadow)
        scene = raytracer.Scene(meshes=[FLOOR, square(2.0, 0, 1.0)], materials=[GREY], lights=[lamp])
        assert bool(see(scene, [0.1, 0, 1.0])["Combined"][0, 0] > 0) == lit


def test_transparent_surfaces_attenuate_shadow_rays():
    glass = Material((Closure("transparent", color=(0.5, 0.25, 1.0)),))
    open_scene = raytracer.Scene(meshes=[FLOOR], materials=[GREY], lights=[LIGHT])
    panes = [square(1.0 + 0.1 * k, 1) for k in range(3)]
    scene = raytracer.Scene(meshes=[FLOOR, *panes], materials=[GREY, glass], lights=[LIGHT])
    plain, tinted = (see(item, [0.5, 0, 0.9])["Combined"][0, :3] for item in (open_scene, scene))
    np.testing.assert_allclose(tinted, plain * np.array([0.5, 0.25, 1.0]) ** 3, rtol=1e-13)


def test_passages_do_not_use_up_bounces():
    pane = Material((Closure("transparent", color=1.0),))
    scene = raytracer.Scene(
        meshes=[FLOOR, *(square(1.0 + 0.01 * k, 1) for k in range(20))], materials=[GREY, pane], lights=[LIGHT]
    )
    plain = raytracer.Scene(meshes=[FLOOR], materials=[GREY], lights=[LIGHT])
    np.testing.assert_allclose(see(scene, max_bounces=0)["Combined"], see(plain, max_bounces=0)["Combined"], rtol=1e-12)


def test_alpha_of_a_transparent_film_is_what_does_not_reach_the_background():
    pane = Material((Closure("transparent", color=(0.2, 0.4, 0.6)),))
    scene = raytracer.Scene(meshes=[square(0.0)], materials=[pane], world=raytracer.World(1.0))
    np.testing.assert_allclose(see(scene, transparent=True)["Combined"][0], [0, 0, 0, 0.6], atol=1e-15)
    np.testing.assert_allclose(see(scene)["Combined"][0], [0.2, 0.4, 0.6, 1.0], atol=1e-15)


def test_a_mirror_shows_the_world_on_a_transparent_film():
    scene = raytracer.Scene(meshes=[FLOOR], materials=[MIRROR], world=raytracer.World(1.0))
    np.testing.assert_allclose(see(scene, transparent=True)["Combined"][0], [1.0, 0.5, 0.25, 1.0], rtol=1e-14)


def test_holdout_objects_are_black_holes_for_the_camera_only():
    meshes = [square(0.0, 0, 1.0)]
    cut = raytracer.Instances([0], [np.eye(4)], holdout=[True])
    scene = raytracer.Scene(meshes=meshes, instances=cut, materials=[GREY], lights=[LIGHT])
    np.testing.assert_array_equal(see(scene, transparent=True)["Combined"][0], [0, 0, 0, 0])
    np.testing.assert_array_equal(see(scene)["Combined"][0], [0, 0, 0, 0])  # in a picture with a background, too
    above = raytracer.Scene(
        meshes=[FLOOR, square(4.0, 1)],
        instances=raytracer.Instances([0, 1], [np.eye(4)] * 2, holdout=[False, True]),
        materials=[MIRROR, Material((Closure("emission", color=2.0),))],
    )
    np.testing.assert_allclose(see(above, transparent=True)["Combined"][0], [2.0, 1.0, 0.5, 1.0])


# Passes --------------------------------------------------------------------------------------------------------------


def test_data_passes_describe_the_first_surface():
    uvs = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    mesh = raytracer.Mesh(FLOOR.positions, FLOOR.triangles, uvs=uvs, material=1)
    scene = raytracer.Scene(
        meshes=[mesh],
        instances=raytracer.Instances([0], [np.eye(4)], pass_index=[7]),
        materials=[GREY, Material((Closure("diffuse"),), pass_index=5)],
    )
    values = see(scene, [[0.9, 1.8, 3.0], [0.9, 1.8, -3.0]], [[0, 0, -2.0], [0, 0, 1.0]], passes=DATA)
    np.testing.assert_allclose(values["Depth"], [[1.5], [3.0]])
    np.testing.assert_allclose(values["Position"], [[0.9, 1.8, 0]] * 2, atol=1e-15)
    np.testing.assert_allclose(values["Normal"], [[0, 0, 1], [0, 0, -1]])
    np.testing.assert_allclose(values["UV"], [[0.55, 0.6, 1]] * 2)
    np.testing.assert_array_equal(values["Object Index"], [[7], [7]])
    np.testing.assert_array_equal(values["Material Index"], [[5], [5]])


def test_data_passes_of_a_miss_are_those_of_the_film():
    values = see(raytracer.Scene(meshes=[FLOOR]), directions=[0, 0, 1.0], passes=DATA)
    assert values["Depth"][0, 0] == 1e10
    assert not any(values[name].any() for name in DATA if name != "Depth")


@pytest.mark.parametrize(("alpha", "depth"), [(0.6, 1.0), (0.4, 3.0)])
def test_data_passes_look_through_surfaces_that_are_mostly_transparent(alpha, depth):
    pane = Material((Closure("principled", alpha=alpha),))
    scene = raytracer.Scene(meshes=[FLOOR, square(2.0, 1)], materials=[GREY, pane])
    values = see(scene, directions=[0, 0, -1.0], passes=DATA)
    assert values["Depth"][0, 0] == pytest.approx(depth, rel=1e-14)


@pytest.mark.parametrize("closure", [Closure("principled", alpha=0.4), Closure("portal", position=(0.0, 0.0, -9.0))])
def test_data_passes_before_the_background_are_those_of_a_miss(closure):
    """As in Cycles, where nothing is left of a pane that rays go straight through; with light, of those rays alone."""
    scene = raytracer.Scene(meshes=[square(2.0, 1)], materials=[GREY, Material((closure,), pass_index=5)])
    values = see(scene, directions=[0, 0, -1.0], passes=DATA)
    assert values["Depth"][0, 0] == 1e10
    assert not any(values[name].any() for name in DATA if name != "Depth")
    clear = raytracer.Scene(meshes=[square(2.0)], materials=[Material((Closure("transparent"),), pass_index=5)])
    assert see(clear, directions=[0, 0, -1.0], passes=("Combined", *DATA))["Depth"][0, 0] == 1e10


def test_color_and_emission_passes_hold_what_is_seen_straight():
    glow = Material((Closure("diffuse", color=(0.2, 0.4, 0.6)), Closure("emission", color=3.0)))
    pane = Material((Closure("transparent", color=0.5),))
    scene = raytracer.Scene(meshes=[FLOOR, square(2.0, 1)], materials=[glow, pane])
    values = see(scene, passes=("Diffuse Color", "Emission"))
    np.testing.assert_allclose(values["Diffuse Color"], [[0.1, 0.2, 0.3]])
    np.testing.assert_allclose(values["Emission"], [[1.5, 1.5, 1.5]])
    mirror = raytracer.Scene(meshes=[FLOOR, square(9.0, 1)], materials=[MIRROR, glow])
    values = see(mirror, passes=("Diffuse Color", "Emission"))
    assert not values["Diffuse Color"].any()
    assert not values["Emission"].any()


def test_shadow_pass_is_the_share_of_light_that_arrives():
    lights = [raytracer.SunLight((0, 0, 1), 3), raytracer.SunLight((1, 0, 1), np.sqrt(2))]
    scene = raytracer.Scene(meshes=[FLOOR, square(2.0, 0, 1.0)], materials=[GREY], lights=lights)
    values = see(scene, [[0.1, 0, 1.0], [5, 0, 1.0]], passes=("Shadow",))
    np.testing.assert_allclose(values["Shadow"], [[0.25] * 3, [1.0] * 3], rtol=1e-13)
