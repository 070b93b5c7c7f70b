"""Shadow linking: what shadows the light of an emitter, in both ways of sampling it."""

from dataclasses import replace

import numpy as np
import pytest

import raytracer
from raytracer.integrator.prepare import prepare
from raytracer.integrator.settings import Settings
from raytracer.scene.fields import ALL_SETS
from raytracer.scene.materials import Closure, Material
from tests.forbidding import forbid
from tests.raytracer.lights.linked_scenes import look_down, see

DIFFUSE, GLOSSY, MIRROR, GLOWING, PANE, BLACK = range(6)
MATERIALS = [
    Material((Closure("diffuse", color=(0.8, 0.5, 0.2)),)),
    Material((Closure("glossy", color=0.9, roughness=0.3),)),
    Material((Closure("glossy", color=0.9, roughness=0.0),)),
    Material((Closure("emission", color=2.0),)),
    Material((Closure("transparent", color=0.5),)),
    Material((Closure("diffuse", color=0.0),)),
]
LIGHT = raytracer.PointLight((0.0, 0.5, 4.0), 50.0, radius=0.4, soft_falloff=False)
SURFACES = (DIFFUSE, GLOSSY, MIRROR)
ROOF = 1 << 1


def quad(height=0.0, material=DIFFUSE, size=3.0):
    corners = [(-size, -size, height), (size, -size, height), (size, size, height), (-size, size, height)]
    return raytracer.Mesh(corners, [(0, 1, 2), (0, 2, 3)], material=material)


def make_scene(meshes, lights=(), shadow_set=None, blockers=None, spheres=()):
    return look_down(meshes, MATERIALS, 1.0, spheres, lights, shadow_set=shadow_set, blockers=blockers)


@pytest.mark.parametrize("material", SURFACES)
@pytest.mark.parametrize("integrator", ["direct", "path"])
def test_a_roof_that_is_no_blocker_leaves_the_light_as_it_is(material, integrator):
    """A black roof hangs between a ground and its lamp; mirrors see the lamp, behind the roof, as well."""
    ground, roof = quad(0, material), quad(2, BLACK)
    free = see(make_scene([ground], [LIGHT]), integrator=integrator)
    under = make_scene([ground, roof], [replace(LIGHT, blockers=ALL_SETS - ROOF)], shadow_set=[0, 1])
    assert free.any()
    np.testing.assert_allclose(see(under, integrator=integrator), free, rtol=1e-5)
    assert not see(make_scene([ground, roof], [LIGHT]), integrator=integrator).any()


@pytest.mark.parametrize("material", SURFACES)
@pytest.mark.parametrize("shape", ["mesh", "sphere"])
def test_a_roof_that_is_no_blocker_leaves_the_light_of_what_shines_as_it_is(material, shape):
    ground, roof, glow = quad(0, material), quad(2, BLACK), quad(4, GLOWING, 2.0)
    spheres, meshes, linked = (), [glow], ALL_SETS - ROOF
    if shape == "sphere":
        spheres, meshes = raytracer.Spheres([(0, 0, 5)], [2.0], material=GLOWING), []
    free = see(make_scene([ground, *meshes], spheres=spheres))
    blockers = [ALL_SETS, ALL_SETS, linked][: 2 + len(meshes)]
    spheres = replace(spheres, blockers=linked) if spheres else ()
    under = make_scene([ground, roof, *meshes], (), [0, 1, 0][: 2 + len(meshes)], blockers, spheres)
    assert free.any()
    np.testing.assert_allclose(see(under), free, rtol=1e-5)
    assert not see(replace(under, instances=None, spheres=replace(spheres, blockers=ALL_SETS) if spheres else ())).any()


@pytest.mark.parametrize("material", SURFACES)
def test_one_roof_shadows_one_of_two_lamps(material):
    ground, roof, other = quad(0, material), quad(2, BLACK), replace(LIGHT, position=(0.4, -0.5, 4.0))
    lights = [replace(LIGHT, blockers=ALL_SETS - ROOF), other]
    np.testing.assert_allclose(
        see(make_scene([ground, roof], lights, shadow_set=[0, 1])), see(make_scene([ground], [LIGHT])), rtol=1e-5
    )


@pytest.mark.parametrize("material", SURFACES)
def test_a_blocker_among_others_shadows_as_it_does_alone(material):
    """Half a roof that blocks, above and below whole ones that do not, and a pane."""
    corners = [(0, -3, 2.5), (3, -3, 2.5), (3, 3, 2.5), (0, 3, 2.5)]
    half = raytracer.Mesh(corners, [(0, 1, 2), (0, 2, 3)], material=BLACK)
    ground, pane = quad(0, material), quad(1.5, PANE)
    alone = see(make_scene([ground, half, pane], [LIGHT]))
    meshes = [ground, quad(2, BLACK), half, pane, quad(3, BLACK)]
    linked = make_scene(meshes, [replace(LIGHT, blockers=1 << 5)], shadow_set=[2, 0, 5, 5, 1])
    assert 0 < np.count_nonzero(alone.any(axis=2)) < 48 or material != MIRROR
    np.testing.assert_allclose(see(linked), alone, rtol=1e-5, atol=1e-7)


def test_the_camera_meets_what_is_in_front_whatever_it_shadows():
    glow = make_scene([quad(-1, GLOWING), quad(0, BLACK)], blockers=[0, ALL_SETS])
    assert not see(glow).any()
    bare = make_scene([quad(0, GLOWING)], blockers=[1])
    np.testing.assert_array_equal(see(bare), np.full((6, 8, 3), 2.0, np.float32))


def test_a_scene_without_shadow_links_never_looks_for_them(monkeypatch):
    forbid(monkeypatch, "add_linked_light", "make_linked_cast")
    scene = make_scene([quad(0, GLOSSY), quad(4, GLOWING, 2.0)], [LIGHT], shadow_set=[3, 5])
    assert see(scene).any()
    assert prepare(scene, raytracer.build(scene), Settings()).shadow_links is None


def test_masks_and_sets_out_of_range_are_refused():
    with pytest.raises(ValueError, match="PointLight '': blockers: expected"):
        replace(LIGHT, blockers=-1)
    with pytest.raises(ValueError, match="Instances: blockers: expected"):
        raytracer.Instances([0], [np.eye(4)], blockers=[-1])
    with pytest.raises(ValueError, match="shadow_set: expected"):
        raytracer.Instances([0], [np.eye(4)], shadow_set=[63])
