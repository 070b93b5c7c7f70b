"""Many emissive objects picked from by a tree, against all of them picked from by power: the same picture."""

import numpy as np
import pytest

import raytracer
from raytracer.integrator import picked_geometry
from raytracer.integrator.prepare import prepare
from raytracer.integrator.settings import Settings
from raytracer.scene.fields import SEEN_BY, SEEN_BY_ALL
from raytracer.scene.materials import Closure, Material
from tests.forbidding import forbid
from tests.raytracer.integrator.test_many_lights import MATERIALS, assert_same_light, make_scene, see

SHINING = [Material((Closure("emission", color=color),)) for color in ((3.0, 2.0, 1.0), (1.0, 4.0, 6.0))]


# Standard errors of tiles and of the whole, and samples: of what is picked by power, which has most of the noise.
NOISE, SAMPLES = (0.15, 0.026), 128
BESIDE_CAMERA = SEEN_BY_ALL - SEEN_BY["camera"]


def make_objects(count=40, linked=False, seen_by=BESIDE_CAMERA, floors=MATERIALS, catchers=False):
    """Return a hall (`make_scene`) with so many emissive tetrahedra, of two materials, and a group of balls: the camera
    does not see them, whose borders would be all the noise."""
    scene, rng = make_scene([], materials=floors + SHINING), np.random.default_rng(5)
    corners = 0.8 * np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1.0)])
    places = rng.uniform((-6, -6, 4.5), (5, 5, 7), (count, 3))
    places[::4, 2] = -5.0  # one floor lets light through from below
    meshes = list(scene.meshes)
    meshes += [
        raytracer.Mesh(corners + place, [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)], material=3 + number % 2)
        for number, place in enumerate(places)
    ]
    total = len(meshes)
    fields = {"seen_by": np.where(np.arange(total) < len(scene.meshes), SEEN_BY_ALL, seen_by)}
    if linked:
        fields |= {"light_set": np.arange(total) % 2, "receivers": 1 + np.arange(total) % 3}
    if catchers:
        fields["shadow_catcher"] = np.arange(total) == 0
    placed = raytracer.Instances(np.arange(total), np.tile(np.eye(4), (total, 1, 1)), **fields)
    balls = raytracer.Spheres([(-1, 0.5, 6), (3, 3, 5.0)], [0.3, 0.5], material=3, seen_by=seen_by)
    known = {"materials": scene.materials, "camera": scene.camera}
    return raytracer.Scene(meshes=meshes, instances=placed, spheres=[balls], **known)


@pytest.mark.parametrize("integrator", ["direct", "path"])
def test_objects_picked_send_as_much_as_by_power(monkeypatch, integrator):
    assert_same_light(make_objects(), monkeypatch, picked_geometry, NOISE, SAMPLES, integrator=integrator)


def test_objects_picked_keep_to_links(monkeypatch):
    assert_same_light(make_objects(linked=True), monkeypatch, picked_geometry, NOISE, SAMPLES)


def test_objects_picked_keep_out_of_what_they_are_hidden_from(monkeypatch):
    assert_same_light(
        make_objects(seen_by=BESIDE_CAMERA - SEEN_BY["glossy"]), monkeypatch, picked_geometry, NOISE, SAMPLES
    )


def test_rays_that_meet_objects_leave_to_them_what_picking_does_not_bring(monkeypatch):
    """Polished floors, by few picks: much of their light is met by reflected rays."""
    monkeypatch.setattr(picked_geometry, "PICKS", 2)
    floors = [Material((Closure("glossy", color=0.9, roughness=0.3),))] * 3
    assert_same_light(make_objects(60, floors=floors), monkeypatch, picked_geometry, NOISE, SAMPLES)


def test_few_emissive_objects_are_picked_by_power_as_ever(monkeypatch):
    forbid(monkeypatch, "make_light_tree", "pick_lights")
    assert see(make_objects(picked_geometry.MOST_AIMED_AT - 1), 1, samples=1).any()


def test_what_catches_shadows_is_lit_by_power(monkeypatch):
    """The scene and its catchers alone have the same sources."""
    forbid(monkeypatch, "make_light_tree", "pick_lights")
    scene = make_objects(catchers=True)
    integrator = prepare(scene, raytracer.build(scene), Settings())
    assert integrator.emitter_group is None
    assert integrator.catchers_only is not None


def test_sources_stay_few_however_many_objects_shine():
    scene = make_objects(200)
    integrator = prepare(scene, raytracer.build(scene), Settings())
    assert len(integrator.sources) == picked_geometry.PICKS
    assert integrator.emitter_group is not None
