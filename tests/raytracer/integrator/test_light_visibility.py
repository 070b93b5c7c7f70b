"""Who sees what shines, and what programs are told where it is sampled as a light: a table of sources and rays.

Closed forms and equalities; that Cycles agrees is tested with the add-on.
"""

import numpy as np
import pytest

import raytracer
from raytracer.casting.rays import make_rays
from raytracer.integrator.loop import trace
from raytracer.integrator.prepare import prepare
from raytracer.integrator.settings import Settings
from raytracer.sampling.sobol import SobolSamples
from raytracer.scene.fields import SEEN_BY, SEEN_BY_ALL
from raytracer.scene.materials import Closure, Material
from raytracer.scene.programs import Program, Register, Step

COUNT = 256
DIFFUSE = Material((Closure("diffuse", color=0.8),))
GLOSSY = Material((Closure("glossy", color=0.8, roughness=0.4),))
MIXED = Material((Closure("diffuse", color=0.5), Closure("glossy", color=0.5, roughness=0.6)))
MIXED_DIFFUSE, MIXED_GLOSSY = (Material((closure,)) for closure in MIXED.closures)
GLOW = Material((Closure("emission", color=3.0),))
CLEAR = Material((Closure("transparent", color=1.0),))
# What diffuse reflection, of density cos / pi, counts beside samples of density 1 / 4 pi, those of a world that hardly
# varies: the mean over cos / pi of its share by the power heuristic, the integral over c of 2 c 16 c^2 / (1 + 16 c^2).
REFLECTED = 1.0 - np.log(17.0) / 16.0


def square(height, size=1.0, material=0, middle=(0.0, 0.0), down=False):
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]]) * size + (*middle, height)
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    return raytracer.Mesh(corners, triangles[:, ::-1] if down else triangles, material=material)


def make_instances(count, **seen_by):
    """Placements of `count` meshes; seen_by : masks of some, by the number of the mesh after an m."""
    masks = [seen_by.get(f"m{k}", SEEN_BY_ALL) for k in range(count)]
    return raytracer.Instances(np.arange(count), [np.eye(4)] * count, seen_by=masks)


def look_down(scene, height=0.5, down=True, count=COUNT, **settings):
    rays = make_rays([[0.1, 0.05, height]] * count, [[0, 0, -1.0 if down else 1.0]])
    samples = SobolSamples(np.zeros(count, dtype=np.uint32), np.arange(count, dtype=np.uint32), 0)
    settings = Settings(passes=("Combined",), **{"integrator": "path", "max_bounces": 1, **settings})
    return trace(prepare(scene, raytracer.build(scene), settings), rays, samples)["Combined"][:, :3].mean(axis=0)


def vary(color):
    """A world of a color whose program differs between directions, but hardly."""
    steps = (
        Step("NEW_GEOMETRY Incoming", ()),
        Step("VECT_MATH Vector", (Register(0, "Incoming"), np.zeros(3), np.zeros(3), 1.0), {"operation": "MULTIPLY"}),
        Step("VECT_MATH Vector", (Register(1, "Vector"), np.full(3, color), np.zeros(3), 1.0), {"operation": "ADD"}),
    )
    return {"color": Register(2, "Vector"), "program": Program(steps)}


def light_up(source, seen_by, material):
    """A floor under one source, seen by some classes of rays."""
    floor = square(0.0, 9.0)
    if source == "emissive mesh":
        return raytracer.Scene(
            meshes=[floor, square(1.0, 0.4, 1, (0.6, 0.0))],
            materials=[material, GLOW],
            instances=make_instances(2, m1=seen_by),
        )
    if source == "light":
        lights = [raytracer.PointLight((0.6, 0.0, 1.0), 30.0, radius=0.3, seen_by=seen_by)]
        return raytracer.Scene(meshes=[floor], materials=[material], lights=lights)
    given = {"color": 0.7} if source == "world" else vary(0.7)
    return raytracer.Scene(meshes=[floor], materials=[material], world=raytracer.World(**given, seen_by=seen_by))


SOURCES = ["emissive mesh", "light", "world", "world that varies"]


@pytest.mark.parametrize("integrator", ["path", "direct"])
@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize(("material", "name"), [(DIFFUSE, "diffuse"), (GLOSSY, "glossy")])
def test_light_comes_by_the_rays_that_see_its_source_and_no_others(source, integrator, material, name):
    expected = look_down(light_up(source, SEEN_BY_ALL, material), integrator=integrator)
    assert expected.min() > 0
    for hidden, bit in SEEN_BY.items():
        seen = look_down(light_up(source, SEEN_BY_ALL - bit, material), integrator=integrator)
        if hidden == name:
            assert not seen.any()
        else:
            # Which rays share a random number with which may change with what is hidden.
            np.testing.assert_allclose(seen, expected, rtol=0.02)


@pytest.mark.parametrize("integrator", ["path", "direct"])
@pytest.mark.parametrize("source", ["emissive mesh", "light"])
@pytest.mark.parametrize(("hidden", "left"), [("diffuse", MIXED_GLOSSY), ("glossy", MIXED_DIFFUSE)])
def test_of_two_parts_that_which_sees_the_source_is_lit(source, integrator, hidden, left):
    seen = look_down(light_up(source, SEEN_BY_ALL - SEEN_BY[hidden], MIXED), integrator=integrator)
    expected = look_down(light_up(source, SEEN_BY_ALL, left), integrator=integrator)
    np.testing.assert_allclose(seen, expected, rtol=0.05)


@pytest.mark.parametrize("integrator", ["path", "direct"])
@pytest.mark.parametrize("max_bounces", [0, 1, 3])
def test_the_light_of_an_even_world_is_the_same_however_rays_are_told_apart(integrator, max_bounces):
    """Diffuse and glossy rays that look for it apart bring together what they do at once."""
    pictures = []
    for mask in (SEEN_BY_ALL, SEEN_BY_ALL - SEEN_BY["shadow"]):
        scene = raytracer.Scene(
            meshes=[square(0.0, 9.0), square(-5.0, 0.1)],
            materials=[MIXED],
            instances=make_instances(2, m1=mask),
            world=raytracer.World(0.7),
        )
        pictures.append(look_down(scene, integrator=integrator, max_bounces=max_bounces, count=4096))
    np.testing.assert_allclose(pictures[1], pictures[0], rtol=0.01)


@pytest.mark.parametrize("source", SOURCES)
def test_cameras_see_what_is_not_hidden_from_them(source):
    """Straight up from the floor; the light is seen only where it is said to be."""
    for mask, seen in ((SEEN_BY_ALL, True), (SEEN_BY_ALL - SEEN_BY["camera"], False)):
        rays = make_rays([[0.6, 0.0, 0.5]], [[0, 0, 1.0]])
        scene = light_up(source, mask, DIFFUSE)
        settings = Settings(passes=("Combined",))
        picture = trace(
            prepare(scene, raytracer.build(scene), settings), rays, SobolSamples(np.zeros(1, np.uint32), 0, 0)
        )
        assert (picture["Combined"][0, :3] > 0).all() == seen


@pytest.mark.parametrize("transparent", [False, True])
@pytest.mark.parametrize("integrator", ["path", "direct"])
@pytest.mark.parametrize(
    ("hidden", "varies", "share"),
    [("diffuse", False, 1.0), ("shadow", False, 0.0), ("glossy", False, 0.0),
     ("diffuse", True, REFLECTED), ("shadow", True, 1.0 - REFLECTED), ("glossy", True, 0.0)],
)  # fmt: skip
def test_the_rays_that_look_for_a_world_see_what_they_would_meet(hidden, varies, share, integrator, transparent):
    """A ceiling over a floor that is hidden from some rays: an even world is looked for as reflection does, one that
    varies by shadow rays and reflected ones, as in Cycles. Without bounces nothing else lights the ceiling."""
    world = raytracer.World(**(vary(0.5) if varies else {"color": 0.5}))
    scene = raytracer.Scene(
        meshes=[square(1.0, 1.0, down=True), square(-1.0, 99.0, 1)],
        materials=[
            DIFFUSE,
            Material((Closure("diffuse", color=0.0), Closure("transparent", weight=0.0))),
            *[CLEAR] * transparent,
        ],
        instances=make_instances(2, m1=SEEN_BY_ALL - SEEN_BY[hidden]),
        world=world,
    )
    seen = look_down(scene, height=0.0, down=False, integrator=integrator, max_bounces=0)
    # The world beside the far edge of the floor: less than a hundredth.
    np.testing.assert_allclose(seen, 0.4 * share, atol=0.004)


# What programs are told -----------------------------------------------------------------------------------------------


def ask(output, scale=1.0):
    """A register of a program that tells `scale` times an output of the Light Path node."""
    steps = (
        Step(f"LIGHT_PATH {output}", ()),
        Step("MATH", (Register(0, output), scale, 0.0), {"operation": "MULTIPLY", "use_clamp": False}),
    )
    return Register(1, "Value"), Program(steps)


def tinted(output, scale):
    register, program = ask(output, scale)
    return Material((Closure("transparent", color=1.0, weight=register),), program=program)


@pytest.mark.parametrize(
    ("output", "scale", "shares"),
    [("Ray Length", 0.2, (0.2, 0.4)), ("Ray Depth", 0.5, (0.5, 0.5)), ("Diffuse Depth", 1.0, (0.0, 0.0)),
     ("Transparent Depth", 1.0, (0.0, 1.0)), ("Is Shadow Ray", 0.7, (0.7, 0.7)), ("Is Camera Ray", 1.0, (0.0, 0.0))],
)  # fmt: skip
def test_shadow_rays_tell_how_far_they_have_come(output, scale, shares):
    """Sheets one and two metres over a floor, one bounce after the camera, under the sun: each alone, then both."""
    sun = raytracer.SunLight((0, 0, 1), 1.0)
    full = look_down(raytracer.Scene(meshes=[square(0.0, 9)], materials=[DIFFUSE], lights=[sun]), max_bounces=0)
    for heights in ((1.0,), (2.0,), (1.0, 2.0)):
        expected = np.prod([shares[0 if output == "Transparent Depth" else int(height) - 1] for height in heights])
        if output == "Transparent Depth" and len(heights) == 2:
            expected = shares[0] * shares[1]
        meshes = [square(0.0, 9), *(square(height, 2, 1) for height in heights)]
        scene = raytracer.Scene(meshes=meshes, materials=[DIFFUSE, tinted(output, scale)], lights=[sun])
        np.testing.assert_allclose(look_down(scene, max_bounces=0), full * expected, rtol=1e-9)


@pytest.mark.parametrize("integrator", ["path", "direct"])
@pytest.mark.parametrize(
    ("output", "value"),
    [("Is Diffuse Ray", 1.0), ("Is Reflection Ray", 1.0), ("Is Glossy Ray", 0.0), ("Is Camera Ray", 0.0),
     ("Is Shadow Ray", 0.0), ("Ray Depth", 2.0), ("Diffuse Depth", 1.0)],
)  # fmt: skip
def test_an_even_world_is_asked_as_by_reflected_rays(output, value, integrator):
    """Whether it is sampled or met; Cycles counts the world one bounce further than the ray."""
    register, program = ask(output, 0.5)
    program = Program((*program.steps, Step("number to vector", (register,))))
    world = raytracer.World(Register(2, "Value"), program)
    scene = raytracer.Scene(meshes=[square(0.0, 9)], materials=[DIFFUSE], world=world)
    np.testing.assert_allclose(look_down(scene, integrator=integrator), 0.8 * 0.5 * value, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("integrator", ["path", "direct"])
def test_emissive_geometry_is_told_the_length_and_depth_of_the_rays_that_sample_it(integrator):
    """A square so small that its distance is about the same from all its points."""
    register, program = ask("Ray Length", 2.0)
    lamp = square(1.0, 0.01, 1, (0.1, 0.05))
    for output, value in (("Ray Length", 1.0), ("Ray Depth", 1.0), ("Is Camera Ray", 0.0)):
        register, program = ask(output, 2.0)
        glow = Material((Closure("emission", color=1.0, weight=register),), program=program)
        plain = Material((Closure("emission", color=2.0),))
        seen, expected = (
            look_down(
                raytracer.Scene(meshes=[square(0.0, 9), lamp], materials=[DIFFUSE, material]), integrator=integrator
            )
            for material in (glow, plain)
        )
        np.testing.assert_allclose(seen, value * expected, rtol=2e-4, atol=1e-6)


def test_lengths_go_on_behind_what_is_passed_straight():
    """The camera's ray to a glowing floor, through a clear sheet: counted from the camera, as in Cycles."""
    register, program = ask("Ray Length")
    glow = Material((Closure("emission", color=1.0, weight=register),), program=program)
    scene = raytracer.Scene(meshes=[square(0.0, 9), square(1.0, 9, 1)], materials=[glow, CLEAR])
    np.testing.assert_allclose(look_down(scene, height=3.0), 3.0, rtol=1e-12)


@pytest.mark.parametrize("mask", [SEEN_BY_ALL - SEEN_BY["camera"], SEEN_BY_ALL - SEEN_BY["transmission"], 0])
def test_an_even_world_is_one_source_where_nothing_tells_its_rays_apart(mask):
    scenes = [
        raytracer.Scene(
            meshes=[square(0.0), square(5.0, 0.1)], instances=make_instances(2, m1=seen_by), world=raytracer.World(0.5)
        )
        for seen_by in (SEEN_BY_ALL, mask, SEEN_BY_ALL - SEEN_BY["diffuse"])
    ]
    counts = [len(prepare(scene, raytracer.build(scene), Settings()).sources) for scene in scenes]
    assert counts == [1, 1, 2]


@pytest.mark.parametrize(("place", "shows"), [(0.5, False), (2.0, True), (7.0, False)])
@pytest.mark.parametrize("pane", [False, True])
def test_cameras_clip_lamps_as_all_else(place, shows, pane):
    """As Cycles does (compared in Blender): they were seen before Clip Start and behind Clip End."""
    middle = (0.0, 0.0, -place)
    lamps = [
        raytracer.PointLight(middle, 30.0, radius=0.3, seen_by=SEEN_BY_ALL),
        raytracer.AreaLight(middle, (1.0, 0.0, 0.0), (0.0, -1.0, 0.0), 30.0, seen_by=SEEN_BY_ALL),
    ]
    scenes = [
        raytracer.Scene(
            meshes=[square(-1.5)] if pane else [],
            materials=[CLEAR],
            lights=[lamp],
            camera=raytracer.Camera(np.eye(4), clip_start=1.0, clip_end=5.0),
        )
        for lamp in lamps
    ]
    pictures = [raytracer.render(scene, 8, 8, samples=4)["Combined"][..., :3] for scene in scenes]
    assert [bool(picture.any()) for picture in pictures] == [shows, shows]
