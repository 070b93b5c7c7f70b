"""Where reflected rays find other light than samples of lights: shares in closed form, and what is not told apart.

That Cycles has the same shares is tested with the add-on.
"""

import numpy as np
import pytest

import raytracer
from raytracer.integrator.light_sources import GEOMETRY, LIGHT, WORLD
from raytracer.integrator.prepare import prepare
from raytracer.integrator.settings import Settings
from raytracer.sampling.warps import power_heuristic
from raytracer.scene.fields import SEEN_BY, SEEN_BY_ALL
from raytracer.scene.materials import Closure, Material
from raytracer.scene.programs import Program, Register, Step
from raytracer.shading.evaluate import OPERATIONS
from tests.raytracer.integrator.test_light_visibility import (
    CLEAR,
    DIFFUSE,
    GLOW,
    MIXED,
    REFLECTED,
    ask,
    light_up,
    look_down,
    make_instances,
    square,
    tinted,
    vary,
)

# The same for a world that is one of two lights, and so of samples of density 1 / 8 pi.
REFLECTED_BESIDE = 1.0 - np.log(65.0) / 64.0
INTEGRATORS = pytest.mark.parametrize("integrator", ["path", "direct"])


def mix(first, second, operation):
    return Step("VECT_MATH Vector", (first, second, np.zeros(3), 1.0), {"operation": operation})


def make_world(output, strength=0.5):
    """A world that shines with `strength` times an output of the Light Path node, and hardly anything that varies."""
    steps = (
        Step("NEW_GEOMETRY Incoming", ()),
        Step(f"LIGHT_PATH {output}", ()),
        mix(Register(0, "Incoming"), np.zeros(3), "MULTIPLY"),
        Step("number to vector", (Register(1, output),)),
        mix(Register(3, "Value"), np.full(3, strength), "MULTIPLY"),
        mix(Register(4, "Vector"), Register(2, "Vector"), "ADD"),
    )
    return raytracer.World(Register(5, "Vector"), Program(steps))


@INTEGRATORS
@pytest.mark.parametrize(
    ("output", "value"),
    [("Is Diffuse Ray", 1.0), ("Is Reflection Ray", 1.0), ("Diffuse Depth", 1.0), ("Is Glossy Ray", 0.0),
     ("Is Camera Ray", 0.0), ("Ray Depth", 1.0 + REFLECTED)],
)  # fmt: skip
def test_a_world_that_varies_is_asked_by_samples_and_by_reflected_rays(output, value, integrator):
    """Samples are of no kind: after a black map nothing is sampled. Depth is 1 for samples, 2 for reflection."""
    scene = raytracer.Scene(meshes=[square(0.0, 9)], materials=[DIFFUSE], world=make_world(output))
    seen = look_down(scene, integrator=integrator, max_bounces=0, count=4096)
    np.testing.assert_allclose(seen, 0.8 * 0.5 * value, rtol=0.01, atol=1e-12)


@INTEGRATORS
def test_a_world_beside_a_light_counts_as_one_of_two_that_are_picked(integrator):
    """The light is behind the floor, and lights nothing."""
    lights = [raytracer.PointLight((0, 0, -2.0), 1.0)]
    scene = raytracer.Scene(meshes=[square(0.0, 9)], materials=[DIFFUSE], world=make_world("Ray Depth"), lights=lights)
    seen = look_down(scene, integrator=integrator, max_bounces=0, count=4096)
    np.testing.assert_allclose(seen, 0.8 * 0.5 * (1.0 + REFLECTED_BESIDE), rtol=0.01)


@INTEGRATORS
@pytest.mark.parametrize(("output", "told"), [("Is Diffuse Ray", True), ("Is Glossy Ray", False)])
def test_emissive_geometry_is_asked_by_samples_and_by_reflected_rays(output, told, integrator):
    """A square of two metres half a metre above the middle of a floor; its light by quadrature over the square."""
    register, program = ask(output)
    glow = Material((Closure("emission", color=1.0, weight=register),), program=program)
    scene = raytracer.Scene(meshes=[square(0.0, 9), square(0.5, 1.0, 1, (0.1, 0.05))], materials=[DIFFUSE, glow])
    seen = look_down(scene, height=0.25, integrator=integrator, max_bounces=0, count=1 << 14)
    x, y = np.meshgrid(*[(np.arange(400) + 0.5) / 200 - 1.0] * 2)
    squared = x**2 + y**2 + 0.25
    cosine = 0.5 / np.sqrt(squared)
    sampled, reflected = squared / (4.0 * cosine), cosine / np.pi
    share = power_heuristic(reflected, sampled)
    expected = 0.8 * (share * reflected / sampled).mean()
    np.testing.assert_allclose(seen, expected if told else 0.0, rtol=0.02)


def hide_far_away(scene):
    """A square far below, hidden from shadow rays alone: it tells blockers apart, and blocks nothing."""
    meshes = [*scene.meshes, square(-50.0, 0.01)]
    return raytracer.Scene(
        meshes=meshes,
        materials=scene.materials,
        lights=scene.lights,
        world=scene.world,
        instances=make_instances(len(meshes), **{f"m{len(meshes) - 1}": SEEN_BY_ALL - SEEN_BY["shadow"]}),
    )


@INTEGRATORS
@pytest.mark.parametrize("material", [DIFFUSE, MIXED])
@pytest.mark.parametrize("source", ["emissive mesh", "light", "many lights", "world that varies"])
def test_what_shines_alike_for_all_rays_is_the_same_told_apart(source, material, integrator):
    scene = light_up("light" if source == "many lights" else source, SEEN_BY_ALL, material)
    if source == "many lights":
        places = [(0.2 * x, 0.2 * y, 1.0) for x in range(6) for y in range(7)]
        lights = [raytracer.PointLight(place, 1.0, radius=0.2, seen_by=SEEN_BY_ALL) for place in places]
        scene = raytracer.Scene(meshes=scene.meshes, materials=scene.materials, lights=lights)
    apart = hide_far_away(scene)
    assert prepare(apart, raytracer.build(apart), Settings()).told_apart
    pictures = [look_down(each, integrator=integrator, count=1 << 13) for each in (scene, apart)]
    np.testing.assert_allclose(pictures[1], pictures[0], rtol=0.02)


def list_kinds(**content):
    scene = raytracer.Scene(meshes=content.pop("meshes", [square(0.0)]), **content)
    return prepare(scene, raytracer.build(scene), Settings()).told_apart


def test_what_makes_no_difference_is_not_told_apart():
    lamps = [raytracer.PointLight((0, 0, 2), 1.0, radius=0.1)]
    register, program = ask("Is Diffuse Ray")
    colored = Material((Closure("diffuse", color=0.5, roughness=register),), program=program)
    instances = make_instances(1, m0=SEEN_BY_ALL - SEEN_BY["camera"])
    assert not list_kinds(world=make_world("Is Camera Ray"), lights=lamps)
    assert not list_kinds(world=make_world("Transparent Depth"), lights=lamps)
    assert not list_kinds(materials=[colored], world=raytracer.World(**vary(0.5)), lights=lamps)
    assert not list_kinds(instances=instances, world=raytracer.World(**vary(0.5)), lights=lamps)
    assert not list_kinds(materials=[tinted("Ray Length", 1.0)], lights=lamps)
    # Nothing can meet a point, and an even world is told all.
    hidden = make_instances(1, m0=SEEN_BY_ALL - SEEN_BY["shadow"])
    assert not list_kinds(instances=hidden, lights=[raytracer.PointLight((0, 0, 2), 1.0)], world=raytracer.World(0.5))


def test_what_makes_a_difference_is_told_apart_where_it_does():
    world = raytracer.World(**vary(0.5))
    lamps = [raytracer.PointLight((0, 0, 2), 1.0, radius=0.1)]
    glows = {"meshes": [square(0.0), square(1.0, material=1)]}
    register, program = ask("Is Diffuse Ray")
    glow = Material((Closure("emission", color=1.0, weight=register),), program=program)
    stopping = Material((Closure("transparent", color=0.5),), transparent_shadow=False)
    hidden = make_instances(1, m0=SEEN_BY_ALL - SEEN_BY["diffuse"])
    assert list_kinds(world=make_world("Ray Depth"), lights=lamps) == {WORLD}
    assert list_kinds(**glows, materials=[DIFFUSE, glow], world=world, lights=lamps) == {GEOMETRY}
    assert list_kinds(world=world, lights=lamps, instances=hidden) == {WORLD, LIGHT}
    for veil in (tinted("Is Shadow Ray", 1.0), stopping):
        assert list_kinds(**glows, materials=[veil, GLOW], world=world, lights=lamps) == {WORLD, LIGHT, GEOMETRY}
    assert not list_kinds(materials=[CLEAR], world=world, lights=lamps)


@pytest.mark.parametrize("asks", [True, False])
def test_steps_that_light_does_not_need_ask_nothing(asks):
    """Of a program whose steps lie between those that are not needed: what it asks for the surface's color is of no
    matter, what it asks for its strength is."""
    glow = Step("LIGHT_PATH Is Diffuse Ray", ()) if asks else Step("NEW_GEOMETRY Backfacing", ())
    steps = (
        Step("LIGHT_PATH Is Glossy Ray", ()),
        Step("MATH", (Register(0, "Is Glossy Ray"), 2.0, 0.0), {"operation": "MULTIPLY"}),
        glow,
        Step("MATH", (Register(2, next(iter(OPERATIONS[glow.operation].outputs))), 3.0, 0.0), {"operation": "ADD"}),
        Step("number to vector", (Register(3, "Value"),)),
    )
    closures = (Closure("emission", color=Register(4, "Value")), Closure("diffuse", weight=Register(1, "Value")))
    material = Material(closures, program=Program(steps))
    scene = raytracer.Scene(meshes=[square(0.0)], materials=[material], camera=raytracer.Camera(np.eye(4)))
    integrator = prepare(scene, raytracer.build(scene), Settings(integrator="path"), (4, 4))
    assert (GEOMETRY in integrator.told_apart) == asks
