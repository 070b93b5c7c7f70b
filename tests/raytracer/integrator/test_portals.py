"""Ray portals: pictures that are those of a camera elsewhere, shares in closed form, and where loops end."""

import numpy as np
import pytest

import raytracer
from raytracer import AreaLight, Camera, Closure, Material, Mesh, PointLight, Scene, World
from raytracer.integrator.inspect_ray import make_inspector
from raytracer.integrator.settings import Settings
from raytracer.scene.programs import Program, Register, Step

SIZE = (12, 8)
FAR = np.array([40.0, 3.0, -2.0])
SHINE, BACKGROUND = 0.75, 0.25
PASSES = ("Combined", "Normal", "Position", "Object Index")


def quad(z, size=9.0, material=0, offset=(0, 0, 0)):
    corners = np.array([(-size, -size, z), (size, -size, z), (size, size, z), (-size, size, z)]) + offset
    return Mesh(corners, [(0, 1, 2), (0, 2, 3)], material=material)


def move(offset):
    matrix = np.eye(4)
    matrix[:3, 3] = offset
    return matrix


def room(offset):
    """A floor, a mirror above it, a lamp over both, seen from above."""
    meshes = [quad(-4, 9, 1, offset), quad(-3, 0.8, 2, np.add(offset, (0.4, 0.2, 0)))]
    lights = [PointLight(np.add(offset, (1.0, 1.5, -1.5)), (600.0, 500.0, 400.0))]
    return meshes, lights


MATERIALS = [
    Material([Closure("diffuse", color=(0.8, 0.6, 0.4))]),
    Material([Closure("glossy", color=(0.7, 0.8, 0.9), roughness=0.0)]),
    Material([Closure("emission", color=(0.2, 0.4, 0.6))]),
]


def shift_program():
    """The hit's own position, moved."""
    steps = [
        Step("NEW_GEOMETRY Position"),
        Step("VECT_MATH Vector", (Register(0, "Position"), FAR, np.zeros(3), 1.0), {"operation": "ADD"}),
    ]
    return Program(steps)


def mirror_program():
    """The ray's direction with z turned."""
    steps = [
        Step("NEW_GEOMETRY Incoming"),
        Step(
            "VECT_MATH Vector",
            (Register(0, "Incoming"), np.array([-1.0, -1.0, 1.0]), np.zeros(3), 1.0),
            {"operation": "MULTIPLY"},
        ),
    ]
    return Program(steps)


def make_scene(portal, meshes, lights=(), camera=(0, 0, 0), world=BACKGROUND):
    return Scene(
        meshes=[quad(-1, 9), *meshes] if portal is not None else meshes,
        materials=[portal or Material(), *MATERIALS],
        lights=lights,
        camera=Camera(move(camera)),
        world=World((world,) * 3),
    )


def render(scene, samples=4, passes=("Combined",), **settings):
    return raytracer.render(scene, *SIZE, samples, passes=passes, **settings)


@pytest.mark.parametrize("integrator", ["direct", "path"])
def test_a_portal_shows_the_picture_of_a_camera_elsewhere(integrator):
    """The world is dark, the lamp has no size: nothing depends on which numbers a surface draws."""
    meshes, lights = room(FAR)
    portal = Material([Closure("portal", color=1.0, position=Register(1, "Vector"))], program=shift_program())
    settings = {"integrator": integrator, "filter_width": 0.0, "max_bounces": 1, "diffuse_bounces": 0}
    through = render(make_scene(portal, meshes, lights, world=0.0), passes=PASSES, **settings)
    there = render(make_scene(None, meshes, lights, camera=FAR, world=0.0), passes=PASSES, **settings)
    assert there["Combined"][..., :3].std() > 0.02
    np.testing.assert_allclose(through["Combined"], there["Combined"], rtol=1e-6, atol=1e-7)
    np.testing.assert_array_equal(through["Object Index"], there["Object Index"])
    for name in ("Normal", "Position"):
        np.testing.assert_allclose(through[name], there[name], atol=1e-5)


def test_a_portal_that_turns_rays_is_a_mirror():
    meshes = [quad(-1.0, 9), quad(1.5, 0.4, 3), quad(1.5, 0.4, 3, (0.8, 0.3, 1.0))]
    turned = Material(
        [Closure("portal", color=(0.5, 0.6, 0.7), direction=Register(1, "Vector"))], program=mirror_program()
    )
    mirror = Material([Closure("glossy", color=(0.5, 0.6, 0.7), roughness=0.0)])
    pictures = [
        render(Scene(meshes=meshes, materials=[first, *MATERIALS], camera=Camera(np.eye(4)), world=World((0.1,) * 3)))
        for first in (turned, mirror)
    ]
    assert pictures[0]["Combined"][..., 0].std() > 0.01
    np.testing.assert_allclose(pictures[0]["Combined"], pictures[1]["Combined"], rtol=1e-6)


@pytest.mark.parametrize("share", [0.25, 0.5, 1.0])
def test_mixed_portals_add_up_to_the_shares_of_what_they_show(share):
    """An emissive surface, what is behind it and what is elsewhere, each in its share."""
    closures = [
        Closure("portal", color=1.0, weight=share, position=FAR),
        Closure("transparent", color=1.0, weight=0.5 * (1 - share)),
        Closure("emission", color=SHINE, weight=0.5 * (1 - share)),
    ]
    scene = make_scene(Material(closures), [quad(-4, 30, 3, FAR)])
    picture = render(scene, samples=4096, passes=("Combined", "Mist"))["Combined"][..., :3]
    shown = np.array([0.2, 0.4, 0.6])
    expected = share * shown + 0.5 * (1 - share) * (BACKGROUND + SHINE)
    # Each pixel's mean has the standard error of a choice between two ways, over the root of its samples.
    error = np.abs(shown - BACKGROUND) * np.sqrt(share * (1 - share)) / np.sqrt(4096 * SIZE[0] * SIZE[1])
    np.testing.assert_allclose(picture.mean(axis=(0, 1)), expected, rtol=1e-6, atol=5 * error.max() + 1e-7)


@pytest.mark.parametrize("most", [1, 2, 5])
def test_loops_end_at_the_limit_of_passages(most):
    """A portal that leads before itself, shining: each passage adds what it shines with, as dim as those before."""
    closures = [Closure("portal", color=0.5, position=np.zeros(3)), Closure("emission", color=1.0)]
    scene = make_scene(Material(closures), [])
    picture = render(scene, samples=1, transparent_bounces=most)["Combined"]
    np.testing.assert_allclose(picture[..., :3], (1 - 0.5 ** (most + 1)) / 0.5, rtol=1e-6)


def test_portals_are_seen_through_in_depth_and_alpha():
    """Depth is measured from the camera to where what is seen is; a background that is left out is alpha 0."""
    portal = Material([Closure("portal", color=1.0, position=Register(1, "Vector"))], program=shift_program())
    scene = make_scene(portal, [quad(-4, 30, 3, FAR)])
    for passes in (("Combined", "Depth"), ("Depth",)):
        np.testing.assert_allclose(render(scene, passes=passes)["Depth"], 4.0 - FAR[2], rtol=1e-6)
    scene = make_scene(portal, [])
    assert (render(scene, transparent=True)["Combined"] == 0).all()


def test_portals_stop_the_light_of_lamps_and_what_shines_behind_is_met_once():
    """A lamp over a portal over a floor lights nothing; a shining ceiling that the portal shows lights as if there."""
    floor = Mesh(quad(-4, 30).positions, [(0, 1, 2), (0, 2, 3)], material=1)
    portal = Material([Closure("portal", color=1.0)])
    lamp = PointLight((0, 0, 5.0), (100.0,) * 3)
    camera = np.eye(4)
    camera[:3, 3] = (0, 0, -2.0)
    scene = Scene(meshes=[quad(-1, 90), floor], materials=[portal, *MATERIALS], lights=[lamp], camera=Camera(camera))
    assert (render(scene)["Combined"][..., :3] == 0).all()
    ceiling, panel = quad(3, 3, 3), AreaLight((0, 0, 3.0), (3.0, 0, 0), (0, 3.0, 0), 100.0)
    for meshes, lights in (([ceiling], []), ([], [panel])):
        pictures = [
            raytracer.render(
                Scene(
                    meshes=[quad(-1, 90), floor, *meshes],
                    materials=[first, *MATERIALS],
                    lights=lights,
                    camera=Camera(camera),
                ),
                4,
                4,
                4096,
                integrator="path",
                max_bounces=2,
            )["Combined"][..., :3].mean(axis=(0, 1))
            for first in (portal, Material([Closure("transparent", color=1.0)]))
        ]
        assert (pictures[1] > 0).all()
        np.testing.assert_allclose(pictures[0], pictures[1], rtol=0.03)


def test_an_inspected_ray_goes_on_behind_a_portal():
    portal = Material([Closure("portal", color=0.5, position=FAR)])
    scene = make_scene(portal, [quad(-4, 30, 3, FAR)])
    first, second = make_inspector(scene, raytracer.build(scene), Settings()).inspect_ray((0, 0, 0), (0, 0, -1.0))
    np.testing.assert_array_equal(second.origin, FAR)
    np.testing.assert_allclose(first.color, 0.5 * np.array([0.2, 0.4, 0.6]))
