"""Light linking: emitters that light some objects only, in both ways of sampling light."""

from dataclasses import replace

import numpy as np
import pytest

import raytracer
from raytracer.integrator.prepare import prepare
from raytracer.integrator.settings import Settings
from raytracer.scene.fields import ALL_SETS, SEEN_BY_ALL
from raytracer.scene.materials import Closure, Material
from tests.raytracer.lights.linked_scenes import look_down, see

DIFFUSE, GLOSSY, GLOWING, PANE = range(4)
MATERIALS = [
    Material((Closure("diffuse", color=(0.8, 0.5, 0.2)),)),
    Material((Closure("glossy", color=0.9, roughness=0.3),)),
    Material((Closure("emission", color=2.0),)),
    Material((Closure("transparent", color=0.5),)),
]
LIGHT = raytracer.PointLight((0.0, 0.5, 2.0), 50.0, radius=0.4, soft_falloff=False)


def quad(x_min, x_max, height=0.0, material=DIFFUSE):
    corners = [(x_min, -3, height), (x_max, -3, height), (x_max, 3, height), (x_min, 3, height)]
    return raytracer.Mesh(corners, [(0, 1, 2), (0, 2, 3)], material=material)


def make_scene(meshes, lights=(), light_set=None, receivers=None, spheres=()):
    return look_down(meshes, MATERIALS, 6.0, spheres, lights, light_set=light_set, receivers=receivers)


def assert_right_half_is_lit(linked, plain):
    assert plain[:, :4].any()
    assert not linked[:, :4].any()
    np.testing.assert_array_equal(linked[:, 4:], plain[:, 4:])


@pytest.mark.parametrize("material", [DIFFUSE, GLOSSY])
@pytest.mark.parametrize("integrator", ["direct", "path"])
def test_a_lamp_lights_the_sets_it_is_linked_to_and_no_others(material, integrator):
    """What is lit looks as without links, also where reflected rays meet the lamp."""
    halves = [quad(-2, 0, material=material), quad(0, 2, material=material)]
    plain = see(make_scene(halves, [LIGHT]), integrator=integrator)
    linked = see(make_scene(halves, [replace(LIGHT, receivers=1 << 5)], light_set=[3, 5]), integrator=integrator)
    assert_right_half_is_lit(linked, plain)


@pytest.mark.parametrize("material", [DIFFUSE, GLOSSY])
def test_a_mesh_that_shines_lights_the_sets_it_is_linked_to_and_no_others(material):
    meshes = [quad(-2, 0, material=material), quad(0, 2, material=material), quad(-2, 2, 9, GLOWING)]
    linked = make_scene(meshes, light_set=[1, 62, 0], receivers=[ALL_SETS, ALL_SETS, 1 << 62])
    assert_right_half_is_lit(see(linked), see(make_scene(meshes)))


@pytest.mark.parametrize("material", [DIFFUSE, GLOSSY])
def test_a_sphere_that_shines_lights_the_sets_it_is_linked_to_and_no_others(material):
    meshes = [quad(-2, 0, material=material), quad(0, 2, material=material)]
    ball = raytracer.Spheres([(0, 0, 9)], [2.0], material=GLOWING)
    linked = make_scene(meshes, light_set=[1, 2], spheres=replace(ball, receivers=1 << 2))
    assert_right_half_is_lit(see(linked), see(make_scene(meshes, spheres=ball)))


def test_what_reflects_is_what_is_lit_behind_panes_as_well():
    """Between a glossy ground and its lamp hangs a pane, of a set that the lamp does not light."""
    meshes = [quad(-2, 2, 0, GLOSSY), quad(-9, 9, 1, PANE)]
    plain = see(make_scene(meshes, [LIGHT]))
    linked = see(make_scene(meshes, [replace(LIGHT, receivers=1 << 1)], light_set=[1, 2]))
    assert plain.any()
    np.testing.assert_array_equal(linked, plain)


def test_meshes_without_instances_are_of_the_first_set_and_light_all():
    scene = make_scene([quad(-2, 2), quad(-2, 2, 9, GLOWING)], [replace(LIGHT, receivers=1 << 1)])
    assert see(scene).any()
    np.testing.assert_array_equal(see(replace(scene, instances=None)), see(scene))


def test_the_camera_sees_every_emitter():
    glowing = make_scene([quad(-2, 2, 1, GLOWING)], receivers=[0])
    np.testing.assert_array_equal(see(glowing), np.full((6, 8, 3), 2.0, np.float32))
    lamp = raytracer.AreaLight((0, 0, 1), (5, 0, 0), (0, -5, 0), 10.0, seen_by=SEEN_BY_ALL)
    ground = quad(-2, 2)
    seen = [see(make_scene([ground], [replace(lamp, receivers=1)], light_set=[number])) for number in (0, 1)]
    assert seen[0].any()
    np.testing.assert_array_equal(*seen)


@pytest.mark.parametrize(("mask", "is_lit"), [(1 << 7, True), (ALL_SETS - (1 << 7), False)])
def test_spheres_belong_to_a_set(mask, is_lit):
    ball = raytracer.Spheres([(0, 0, 0)], [1.5], light_set=7)
    assert see(make_scene([], [replace(LIGHT, receivers=mask)], spheres=ball)).any() == is_lit


def test_without_links_nothing_is_prepared():
    scene = make_scene([quad(-2, 2)], [LIGHT], light_set=[4])
    integrator = prepare(scene, raytracer.build(scene), Settings())
    assert integrator.links is None
    assert integrator.sources[0].links is None


def test_masks_and_sets_out_of_range_are_refused():
    with pytest.raises(ValueError, match="PointLight '': receivers: expected"):
        replace(LIGHT, receivers=-1)
    with pytest.raises(ValueError, match="Instances: receivers: expected"):
        raytracer.Instances([0], [np.eye(4)], receivers=[-1])
    with pytest.raises(ValueError, match="light_set: expected"):
        raytracer.Instances([0], [np.eye(4)], light_set=[63])
