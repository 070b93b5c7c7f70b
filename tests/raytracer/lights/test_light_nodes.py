"""Nodes of lights and their limits of bounces: closed forms, and nothing for the lights without."""

import dataclasses

import numpy as np
import pytest

import raytracer
from raytracer.casting.rays import make_rays
from raytracer.integrator.loop import trace
from raytracer.integrator.prepare import prepare
from raytracer.lights.light_nodes import find_factor, make_computed_light
from raytracer.lights.lights import sample_light
from raytracer.sampling.sobol import SobolSamples
from raytracer.scene.lights import LightNodes
from raytracer.scene.programs import Program, Register, Step
from raytracer.scene.shapes import Instances
from raytracer.shading.light_path import LightPath
from tests.forbidding import forbid
from tests.raytracer.integrator.test_interreflection import GREYS, assert_mean, look_around

FRAME = (8, 6)
FLOOR = raytracer.Mesh([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [(0, 1, 2), (0, 2, 3)])
WHITE = raytracer.Material((raytracer.Closure("diffuse", color=1.0),))


def place(matrix=None):
    return Instances(
        [0], [np.eye(4) if matrix is None else matrix], pass_index=[7], random=[0.25], color=[(1, 0.5, 0, 1)]
    )


def as_nodes(*steps, output, matrix=None):
    """Return the nodes whose last step's output is the light's color."""
    return LightNodes(Register(len(steps) - 1, output), Program(steps), place(matrix))


def fall_off(output, strength=1.0, smooth=0.0):
    number = Step(f"LIGHT_FALLOFF {output}", (strength, smooth))
    return as_nodes(number, Step("number to vector", (Register(0, output),)), output="Value")


def shine_down(nodes, height, **fields):
    """Return what a white floor sends back from right below a light of 4 pi^2 watts without extent: 1 at 1 m."""
    light = raytracer.PointLight((0, 0, height), 4 * np.pi**2, nodes=nodes, **fields)
    scene = raytracer.Scene(meshes=[FLOOR], materials=[WHITE], lights=[light])
    integrator = prepare(scene, raytracer.build(scene), raytracer.Settings())
    samples = SobolSamples(np.zeros(1, np.uint32), 0, 0)
    return trace(integrator, make_rays([(0, 0, 0.5)], [(0, 0, -1)]), samples)["Combined"][0, 0]


@pytest.mark.parametrize("height", [0.75, 2.0, 5.0])
@pytest.mark.parametrize(("output", "power"), [("Quadratic", 0), ("Linear", 1), ("Constant", 2)])
def test_light_falls_off_with_the_distance_as_it_says(output, power, height):
    assert np.isclose(shine_down(fall_off(output, 3.0), height), 3.0 * height ** (power - 2), rtol=1e-12)
    smooth = 3.0 * height ** (power - 2) * height**2 / (0.5 + height**2)
    assert np.isclose(shine_down(fall_off(output, 3.0, 0.5), height), smooth, rtol=1e-12)


@pytest.mark.parametrize("output", ["Quadratic", "Linear", "Constant"])
def test_from_a_sun_comes_all_of_the_strength(output):
    """Its distance is infinite; Cycles leaves the node out there."""
    sun = raytracer.SunLight((0, 0, 1), np.pi, nodes=fall_off(output, 3.0, 0.5))
    computed = make_computed_light(sun, None, FRAME)
    factor = find_factor(computed, np.zeros((1, 3)), np.array([[0.0, 0, 1]]), np.array([np.inf]), farthest())
    np.testing.assert_array_equal(factor, [[3.0, 3.0, 3.0]])


def farthest():
    return LightPath({"length": np.full(1, np.finfo(np.float32).max, dtype=np.float64)})


TURNED = np.array([[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1.0]])
LIGHTS = {
    "point": lambda nodes: raytracer.PointLight((1, 2, 3), 1.0, nodes=nodes),
    "spot": lambda nodes: raytracer.SpotLight(
        (1, 2, 3), 1.0, world_from_light=TURNED[:3, :3], spot_size=2.0, nodes=nodes
    ),
    "area": lambda nodes: raytracer.AreaLight((1, 2, 3), (0, 2, 0), (-4, 0, 0), 1.0, nodes=nodes),
    "sun": lambda nodes: raytracer.SunLight((0, 0, 1), 1.0, 0.4, nodes=nodes),
}


def see(kind, nodes, positions):
    """Return what the nodes say of one sample of a light from each position, and the samples."""
    light = LIGHTS[kind](nodes)
    found = sample_light(light, positions, np.random.default_rng(4).random((len(positions), 2)))
    computed = make_computed_light(light, None, FRAME)
    path = LightPath({"length": np.minimum(found.distance, 1e9)})
    return find_factor(computed, positions, found.direction, found.distance, path), found


POSITIONS = np.random.default_rng(3).uniform(-1.0, 1.0, (50, 3))


@pytest.mark.parametrize("kind", ["point", "spot", "area"])
def test_position_and_coordinates_are_those_of_the_point_on_the_light(kind):
    found, samples = see(kind, as_nodes(Step("NEW_GEOMETRY Position"), output="Position"), POSITIONS)
    np.testing.assert_allclose(found, POSITIONS + samples.distance[:, np.newaxis] * samples.direction, atol=1e-12)
    steps = Step("TEX_COORD Object", settings={"object_from_world": None})
    local, _ = see(kind, as_nodes(steps, output="Object", matrix=TURNED), POSITIONS)
    np.testing.assert_allclose(local @ TURNED[:3, :3].T + TURNED[:3, 3], found, atol=1e-12)


@pytest.mark.parametrize("kind", LIGHTS)
def test_rays_come_in_from_what_is_lit(kind):
    found, samples = see(kind, as_nodes(Step("NEW_GEOMETRY Incoming"), output="Incoming"), POSITIONS)
    np.testing.assert_array_equal(found, -samples.direction)


def test_uvs_span_the_face_of_an_area_light_and_the_disc_of_a_sun():
    read = Step("ATTRIBUTE Vector", settings={"name": "uv"})
    found, samples = see("area", as_nodes(read, output="Vector", matrix=TURNED), POSITIONS)
    place = POSITIONS + samples.distance[:, np.newaxis] * samples.direction - (1, 2, 3)
    np.testing.assert_allclose(found[:, 0], place[:, 1] / 2 + 0.5, atol=1e-12)
    np.testing.assert_allclose(found[:, 1], -place[:, 0] / 4 + 0.5, atol=1e-12)
    found, _ = see("sun", as_nodes(read, output="Vector"), np.zeros((5000, 3)))
    radii = np.hypot(*(found[:, :2] - 0.5).T)
    assert radii.max() <= 0.5 + 1e-12
    assert abs((radii**2).mean() - 0.125) < 0.002  # even over a disk of radius 1/2


def test_a_spot_throws_the_picture_between_its_borders():
    read = Step("ATTRIBUTE Vector", settings={"name": "uv"})
    computed = make_computed_light(LIGHTS["spot"](as_nodes(read, output="Vector", matrix=TURNED)), None, FRAME)
    x = np.tan(1.0)  # half of the opening angle of 2
    below = np.array([(x, 0, -1.0), (-x, 0, -1), (0, x, -1), (0, 0, -1)]) @ TURNED[:3, :3].T
    below /= np.linalg.norm(below, axis=1, keepdims=True)
    path = LightPath({"length": np.ones(4)})
    found = find_factor(computed, below + np.array((1, 2, 3)), -below, np.ones(4), path)
    np.testing.assert_allclose(found[:, :2], [(1, 0.5), (0, 0.5), (0.5, 1), (0.5, 0.5)], atol=1e-12)


def test_objects_numbers_are_those_of_the_light():
    for output, value in (("Random", 0.25), ("Object Index", 7.0)):
        steps = Step(f"OBJECT_INFO {output}"), Step("number to vector", (Register(0, output),))
        np.testing.assert_array_equal(
            see("point", as_nodes(*steps, output="Value"), POSITIONS)[0], np.full((50, 3), value)
        )


# Limits of bounces ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("most", [0, 1, 3])
def test_a_light_lights_what_so_many_bounces_lead_to(most):
    """In an integrating sphere every bounce is even: the series ends where the light does, whatever paths may go on."""
    walls = raytracer.Material((raytracer.Closure("diffuse", color=GREYS),))
    light = raytracer.PointLight((0, 0, 0), 50.0, max_bounces=most)
    scene = raytracer.Scene(spheres=raytracer.Spheres([(0, 0, 0)], [2.0]), materials=[walls], lights=[light])
    irradiance = 50.0 / (4 * np.pi * 2.0**2) * (1 - GREYS ** (most + 1)) / (1 - GREYS)
    assert_mean(look_around(scene, max_bounces=12), GREYS / np.pi * irradiance)


def test_a_light_is_told_how_many_bounces_led_to_what_it_lights():
    """Strength k + 1 after k bounces, the depth of the ray that comes from the light: E sum (k + 1) a^k."""
    walls = raytracer.Material((raytracer.Closure("diffuse", color=GREYS),))
    steps = Step("LIGHT_PATH Ray Depth"), Step("number to vector", (Register(0, "Ray Depth"),))
    light = raytracer.PointLight((0, 0, 0), 50.0, nodes=as_nodes(*steps, output="Value"))
    scene = raytracer.Scene(spheres=raytracer.Spheres([(0, 0, 0)], [2.0]), materials=[walls], lights=[light])
    series = sum((k + 1) * GREYS**k for k in range(4))
    assert_mean(look_around(scene, max_bounces=3), GREYS / np.pi * 50.0 / (4 * np.pi * 2.0**2) * series)


# What lights without pay ---------------------------------------------------------------------------------------------

PLAIN = [
    raytracer.PointLight((0.5, 0, 2), 40, radius=0.3),
    raytracer.SunLight((0, 0, 1), 1.0, 0.2),
    raytracer.AreaLight((-1, 0, 3), (1, 0, 0), (0, 1, 0), 30.0),
]


def picture(lights):
    gloss = raytracer.Closure("glossy", color=0.5, roughness=0.3)
    scene = raytracer.Scene(
        meshes=[FLOOR], materials=[raytracer.Material((raytracer.Closure("diffuse"), gloss))], lights=lights
    )
    return look_around(scene, origin=(0.3, 0.2, 1.0), count=2_000)


def test_lights_without_nodes_and_limits_need_none_of_it(monkeypatch):
    forbid(monkeypatch, "make_computed_light", "vary_samples", "vary_seen", "find_factor")
    picture(PLAIN)


def test_nodes_of_one_light_leave_the_others_as_they_are():
    """Beside a light that its nodes switch off the picture is the same bit for bit."""
    zero = as_nodes(
        Step("OBJECT_INFO Random"),
        Step("MATH", (Register(0, "Random"), 0.0, 0.0), {"operation": "MULTIPLY"}),
        Step("number to vector", (Register(1, "Value"),)),
        output="Value",
    )
    off = raytracer.PointLight((0, 0, 1), 1e6, nodes=zero)
    np.testing.assert_array_equal(
        picture([*PLAIN, off]), picture([*PLAIN, dataclasses.replace(off, nodes=None, power=1e-300)])
    )


def test_a_limit_that_no_path_reaches_changes_no_bit():
    limited = [dataclasses.replace(light, max_bounces=1024) for light in PLAIN]
    np.testing.assert_array_equal(picture(limited), picture(PLAIN))


def test_nodes_are_saved_and_loaded(tmp_path):
    scene = raytracer.Scene(meshes=[FLOOR], lights=[dataclasses.replace(PLAIN[0], nodes=fall_off("Linear", 2.0))])
    raytracer.save(scene, tmp_path / "scene.npz")
    (light,) = raytracer.load(tmp_path / "scene.npz").lights
    assert light.nodes.program.steps[0].operation == "LIGHT_FALLOFF Linear"
    assert light.nodes.program.steps[0].inputs == (2.0, 0.0)
    np.testing.assert_array_equal(light.nodes.placed.world_from_object, [np.eye(4)])


def test_nodes_that_are_none_are_refused():
    with pytest.raises(ValueError, match="LightNodes: color"):
        LightNodes(Register(3, "Value"), Program([Step("OBJECT_INFO Random")]), place())
    with pytest.raises(ValueError, match="placed: expected one instance, got 2"):
        LightNodes(Register(0, "Random"), Program([Step("OBJECT_INFO Random")]), Instances([0, 0], [np.eye(4)] * 2))
