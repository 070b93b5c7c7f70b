"""Ray visibility: which rays go on behind which objects, and which lamps they meet."""

import numpy as np
import pytest

import raytracer
from raytracer.bsdfs.bounce_kinds import DIFFUSE, GLOSSY, SINGULAR, STRAIGHT, TRANSMITTED
from raytracer.casting.ray_visibility import make_cast
from raytracer.casting.rays import make_rays
from raytracer.integrator.bounces import classify_rays
from raytracer.integrator.loop import trace
from raytracer.integrator.prepare import prepare
from raytracer.integrator.settings import Settings
from raytracer.sampling.sobol import SobolSamples
from raytracer.scene.fields import SEEN_BY, SEEN_BY_ALL
from raytracer.scene.materials import Closure, Material

COUNT = 20_000
SIGMAS = 4.0
WHITE = Material((Closure("diffuse", color=1.0),))
MIRROR = Material((Closure("glossy", color=1.0, roughness=0.0),))
GLOW = Material((Closure("emission", color=2.0),))


def square(height, material=0, size=9.0):
    corners = [[-size, -size, height], [size, -size, height], [size, size, height], [-size, size, height]]
    return raytracer.Mesh(corners, [[0, 1, 2], [0, 2, 3]], material=material)


def hide(meshes, *hidden, **scene):
    """A scene of meshes, each with the classes of rays that shall not see it."""
    masks = [SEEN_BY_ALL - sum(SEEN_BY[name] for name in names) for names in hidden]
    instances = raytracer.Instances(np.arange(len(meshes)), [np.eye(4)] * len(meshes), seen_by=masks)
    return raytracer.Scene(meshes=meshes, instances=instances, **scene)


def look_down(scene, height=1.0, count=1, passes=("Combined",), precision="certified", **settings):
    rays = make_rays([[0.1, 0.2, height]] * count, [[0, 0, -1.0]])
    samples = SobolSamples(np.arange(count, dtype=np.uint32), 0, 0)
    integrator = prepare(scene, raytracer.build(scene, precision), Settings(passes=passes, **settings))
    return trace(integrator, rays, samples)


def test_rays_are_classified_by_their_last_bounce():
    kinds = np.array(
        [STRAIGHT, DIFFUSE, GLOSSY, GLOSSY | SINGULAR, DIFFUSE | TRANSMITTED, GLOSSY | TRANSMITTED], np.uint8
    )
    names = ("camera", "diffuse", "glossy", "glossy", "transmission", "transmission")
    assert classify_rays(kinds).tolist() == [SEEN_BY[name] for name in names]


@pytest.mark.parametrize("precision", ["certified", "float64", "float32"])
def test_rays_go_on_behind_what_they_do_not_see(precision):
    """Many hidden layers, the nearest ones 1e-3 apart, and one that is seen."""
    heights = [0.9 - 1e-3 * k for k in range(20)] + [0.0]
    scene = hide([square(height) for height in heights], *[("camera",)] * 20, ("shadow",))
    values = look_down(scene, passes=("Depth", "Object Index"), precision=precision)
    np.testing.assert_allclose(values["Depth"], 1.0, rtol=1e-6)


@pytest.mark.parametrize("precision", ["certified", "float64", "float32"])
@pytest.mark.parametrize("order", [(0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)])
def test_what_lies_exactly_on_hidden_objects_is_met_whichever_was_made_first(rng, precision, order):
    """Of three squares at one place each is hidden from other rays; all classes, edges and corners as well."""
    hidden = [("camera", "diffuse"), ("camera", "glossy", "shadow"), ("transmission", "diffuse", "glossy", "shadow")]
    seen_by = np.array([SEEN_BY_ALL - sum(SEEN_BY[name] for name in hidden[k]) for k in order], np.uint8)
    cast = make_cast(raytracer.build(hide([square(0.0)] * 3, *(hidden[k] for k in order)), precision), seen_by)
    spots = np.concatenate([rng.uniform(-8, 8, size=(50, 2)), [[0, 0], [5, 5], [-3, -3]]])
    rays = make_rays(np.column_stack([spots, np.ones(53)]), [[0, 0, -1.0]])
    for name, bit in SEEN_BY.items():
        hits = cast(rays, np.full(53, bit, np.uint8))
        shown = [place for place, k in enumerate(order) if name not in hidden[k]]
        np.testing.assert_array_equal(hits.instance, min(shown) if shown else -1)


def test_casts_find_what_brute_force_finds_among_visible_objects():
    rng = np.random.default_rng(4)
    meshes = [raytracer.Mesh(rng.uniform(-1, 1, (30, 3)), np.arange(30).reshape(10, 3)) for _ in range(6)]
    masks = np.array([1, 2, 4, 8, 16, 63], np.uint8)
    scene = raytracer.Scene(meshes=meshes, instances=raytracer.Instances(np.arange(6), [np.eye(4)] * 6, seen_by=masks))
    rays = make_rays(rng.uniform(-2, 2, (500, 3)), rng.normal(size=(500, 3)))
    cast = make_cast(raytracer.build(scene), masks)
    for bit in SEEN_BY.values():
        hits = cast(rays, np.full(500, bit, np.uint8))
        shown = np.flatnonzero(masks & bit)
        alone = raytracer.build(raytracer.Scene(meshes=[meshes[k] for k in shown]))
        expected = alone.closest_hit(rays.origins, rays.directions)
        np.testing.assert_array_equal(hits.distance, expected.distance)
        hit = expected.hit
        np.testing.assert_array_equal(hits.instance[hit], shown[expected.instance[hit]])


def test_objects_may_throw_no_shadow():
    lamp = raytracer.PointLight((0.1, 0.2, 4), 100)
    for hidden, lit in (((), False), (("shadow",), True)):
        for materials in ([WHITE], [WHITE, Material((Closure("transparent"),))]):
            scene = hide([square(0.0), square(2.0)], (), hidden, materials=materials, lights=[lamp])
            assert bool(look_down(scene)["Combined"][0, 0] > 0) == lit


def test_mirrors_show_only_what_glossy_rays_see():
    for hidden, seen in ((("glossy",), 0.0), (("camera", "diffuse", "transmission", "shadow"), 2.0)):
        scene = hide([square(0.0, 0), square(2.0, 1)], (), hidden, materials=[MIRROR, GLOW])
        np.testing.assert_allclose(look_down(scene)["Combined"][0, 0], seen)


@pytest.mark.parametrize("hidden", ["camera", "diffuse", "glossy", "transmission"])
def test_lamps_are_met_by_the_rays_that_see_them(hidden):
    """A ball lamp, seen by the camera, in a mirror, and through a clear pane of index 1."""
    mask = SEEN_BY_ALL - SEEN_BY[hidden]
    radiance = 40 / (4 * np.pi**2 * 0.25)
    pane = Material((Closure("refraction", color=1.0, roughness=0.0, ior=1.0 + 1e-6),))
    for material, name, height in ((None, "camera", -2.0), (MIRROR, "glossy", 2.0), (pane, "transmission", -2.0)):
        lamp = raytracer.PointLight((0.1, 0.2, height), 40, radius=0.5, soft_falloff=False, seen_by=mask)
        scene = raytracer.Scene(meshes=[square(0.0)] if material else (), materials=[material or WHITE], lights=[lamp])
        seen = look_down(scene, height=5.0 if name == "glossy" else 1.0)["Combined"][0, 0]
        straight = radiance if name == "glossy" and hidden != "camera" else 0.0  # on the way to the mirror
        np.testing.assert_allclose(seen - straight, 0.0 if name == hidden else radiance, rtol=1e-12)


@pytest.mark.parametrize("integrator", ["direct", "path"])
@pytest.mark.parametrize(("hidden", "parts"), [("diffuse", (False, True)), ("glossy", (True, False))])
def test_light_is_reflected_in_the_ways_in_which_its_lamp_is_seen(integrator, hidden, parts):
    """A diffuse and a rough part under one lamp: what is left is the light of the other part alone."""
    closures = (Closure("diffuse", color=0.5), Closure("glossy", color=0.5, roughness=0.8))
    lamp = raytracer.PointLight((0.5, 0, 2), 100, seen_by=SEEN_BY_ALL - SEEN_BY[hidden])
    kept = tuple(closure for closure, keep in zip(closures, parts, strict=True) if keep)
    mixed, alone = (
        look_down(
            raytracer.Scene(meshes=[square(0.0)], materials=[Material(some)], lights=[light]), integrator=integrator
        )["Combined"][0]
        for some, light in ((closures, lamp), (kept, raytracer.PointLight((0.5, 0, 2), 100)))
    )
    np.testing.assert_allclose(mixed, alone, rtol=1e-12)


def test_scenes_without_hidden_objects_pay_nothing():
    caster = raytracer.build(raytracer.Scene(meshes=[square(0.0)]))
    assert make_cast(caster, None).__name__ == "cast_all"
    everything = hide([square(0.0)], ())
    assert prepare(everything, raytracer.build(everything), Settings()).cast.__name__ == "cast_all"


@pytest.mark.parametrize("mask", [-1, 64])
def test_masks_have_no_other_bits(mask):
    with pytest.raises(ValueError, match="seen_by: expected"):
        raytracer.PointLight((0, 0, 0), 1, seen_by=mask)
