"""Many lights picked from, against all of them aimed at: the same picture, in bounded time and memory."""

from dataclasses import replace

import numpy as np
import pytest

import raytracer
from raytracer.integrator import loop, picked_lights
from raytracer.rendering.render import render
from raytracer.scene.fields import SEEN_BY, SEEN_BY_ALL
from raytracer.scene.lights import LightNodes
from raytracer.scene.materials import Closure, Material
from raytracer.scene.programs import Program, Register, Step
from tests.forbidding import forbid

MATERIALS = [
    Material((Closure("diffuse", color=(0.8, 0.5, 0.2)),)),
    Material((Closure("glossy", color=0.9, roughness=0.4),)),
    Material((Closure("translucent", color=0.6),)),
]
SIZE = (12, 9)


def quad(x, y, size, height, material):
    corners = [(x, y, height), (x + size, y, height), (x + size, y + size, height), (x, y + size, height)]
    return raytracer.Mesh(corners, [(0, 1, 2), (0, 2, 3)], material=material)


def make_scene(lights, materials=MATERIALS, **instances):
    """A hall of 12 m, of four materials' floors and a screen that throws shadows, seen from above."""
    meshes = [
        quad(-6, -6, 6, 0, 0),
        quad(0, -6, 6, 0, 1),
        quad(-6, 0, 6, 0, 2),
        quad(0, 0, 6, 0, 0),
        quad(-2, -2, 3, 1, 0),
    ]
    matrix = np.eye(4)
    matrix[2, 3] = 9.0
    placed = raytracer.Instances(np.arange(len(meshes)), np.tile(np.eye(4), (len(meshes), 1, 1)), **instances)
    camera = raytracer.Camera(matrix, projection="orthographic", ortho_scale=11.0)
    return raytracer.Scene(meshes=meshes, instances=placed, materials=materials, lights=lights, camera=camera)


def make_light(kind, x, y, z, power):
    return (
        lambda: raytracer.PointLight((x, y, z), power, radius=0.3, soft_falloff=False),
        lambda: raytracer.SpotLight((x, y, z), power, radius=0.2, spot_size=1.6),
        lambda: raytracer.AreaLight((x, y, z), (0.8, 0, 0), (0, 0.8, 0), power),
        lambda: raytracer.AreaLight((x, y, -1.0), (0.8, 0, 0), (0, -0.8, 0), power),  # shines up
    )[kind]()


def make_lights(count=40):
    rng = np.random.default_rng(5)
    places = rng.uniform((-6, -6, 1.5), (6, 6, 3), (count, 3))
    powers = rng.uniform(5, 20, (count, 3))
    return [make_light(k % 4, *place, power) for k, (place, power) in enumerate(zip(places, powers, strict=True))]


def see(scene, seed, samples=32, **settings):
    return render(scene, *SIZE, samples, seed=seed, **settings)["Combined"][..., :3].astype(np.float64)


def assert_same_light(
    scene, monkeypatch, picking=picked_lights, noise=(0.05, 0.006), samples=32, seeds=10, tiles=4, **settings
):
    """Means over seeds, of tiles and of the whole picture, agree within 4 standard errors. Those are below the shares
    `noise` of the picture's mean, 5% and 0.6%: a bias of 20% of a tile's light would be seen, or one of 2.4% of all.

    samples : without picking
    """
    picked = np.array([see(scene, seed, **settings) for seed in range(seeds)])
    monkeypatch.setattr(picking, "MOST_AIMED_AT", 1000)
    aimed = np.array([see(scene, 100 + seed, samples, **settings) for seed in range(seeds)])
    width = SIZE[0] // tiles
    shape = (seeds, SIZE[1] // width, width, tiles, width, 3)
    picked, aimed = (values.reshape(shape).mean(axis=(2, 4)) for values in (picked, aimed))
    whole = (x.mean(axis=(1, 2)) for x in (picked, aimed))
    for first, second, largest in ((picked, aimed, noise[0]), (*whole, noise[1])):
        error = np.sqrt((first.var(axis=0, ddof=1) + second.var(axis=0, ddof=1)) / seeds)
        assert error.max() < largest * aimed.mean()
        assert (np.abs(first.mean(axis=0) - second.mean(axis=0)) <= 4 * error).all()


@pytest.mark.parametrize("integrator", ["direct", "path"])
def test_lights_picked_send_as_much_as_all_of_them(monkeypatch, integrator):
    """Matt and glossy floors, which meet the lights as well, and one that light comes through from below."""
    assert_same_light(make_scene(make_lights()), monkeypatch, integrator=integrator)


def test_rays_that_meet_lights_leave_to_them_what_picking_does_not_bring(monkeypatch):
    """Large balls over polished floors, few of which are picked: half of their light is met by reflected rays."""
    monkeypatch.setattr(picked_lights, "PICKS", 2)
    lights = [replace(light, radius=0.8) for light in make_lights(160) if type(light) is raytracer.PointLight]
    scene = make_scene(lights, materials=[Material((Closure("glossy", color=0.9, roughness=0.35),))] * 3)
    assert_same_light(scene, monkeypatch)


def test_lights_picked_keep_to_links_visibility_and_shadows(monkeypatch):
    lights = [replace(light, receivers=(1, 2, 3)[number % 3]) for number, light in enumerate(make_lights(80))]
    hidden = SEEN_BY_ALL - SEEN_BY["glossy"] - SEEN_BY["camera"]
    lights[40:] = [replace(light, seen_by=hidden, cast_shadow=False) for light in lights[40:]]
    scene = make_scene(lights, light_set=[0, 1, 0, 1, 0])
    assert_same_light(scene, monkeypatch)


def test_lights_picked_keep_their_nodes(monkeypatch):
    """A third of them falls off with the distance itself, not with its square."""
    number = Step("LIGHT_FALLOFF Linear", (0.5, 0.0))
    program = Program([number, Step("number to vector", (Register(0, "Linear"),))])
    nodes = LightNodes(Register(1, "Value"), program, raytracer.Instances([0], [np.eye(4)]))
    lights = [replace(light, nodes=None if number % 3 else nodes) for number, light in enumerate(make_lights())]
    assert_same_light(make_scene(lights), monkeypatch)


def test_few_lights_are_all_aimed_at(monkeypatch):
    forbid(monkeypatch, "make_light_tree", "pick_lights")
    assert see(make_scene(make_lights(picked_lights.MOST_AIMED_AT)), 1, samples=1).any()


@pytest.mark.parametrize("count", [16, 200])
def test_no_more_shadow_rays_wait_than_a_batch_holds(monkeypatch, count):
    """The same picture bit for bit, with a batch smaller than one ray from each point to each source."""
    scene = make_scene(make_lights(count))
    whole = see(scene, 1, samples=4)
    held = []
    add_direct_light = loop.add_direct_light

    def note(integrator, passes, shadow_rays, first):
        held.append(sum(len(rays.row) for rays in shadow_rays))
        add_direct_light(integrator, passes, shadow_rays, first)

    monkeypatch.setattr(loop, "SHADOW_BATCH", 500)
    monkeypatch.setattr(loop, "add_direct_light", note)
    np.testing.assert_array_equal(see(scene, 1, samples=4), whole)
    assert len(held) > 4
    assert max(held) <= 500
