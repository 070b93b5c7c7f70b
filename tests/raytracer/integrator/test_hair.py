"""Hair in pictures: a white furnace, what programs read of strands, and what a scene without hair is spared."""

import numpy as np
import pytest

import raytracer
from raytracer.integrator.features import lets_through
from raytracer.scene.programs import Program, Register, Step
from raytracer.shading.nodes.strands import AXIS, INTERCEPT, LENGTH, RANDOM

CAMERA = raytracer.Camera(np.array([[1, 0, 0, 0], [0, 0, -1, -3], [0, 1, 0, 0.5], [0, 0, 0, 1]], float))


def make_material(**fields):
    """Hair that runs along what it is on."""
    program = Program((Step("STRAND Along"), Step("STRAND Across")))
    tangent, across = Register(0, "Along"), Register(1, "Across")
    return raytracer.Material((raytracer.Closure("hair", tangent=tangent, across=across, **fields),), program=program)


def make_strands(shape, count=60, **fields):
    rng = np.random.default_rng(2)
    up = np.linspace(0.0, 1.0, 4)[:, None]
    root, bend = rng.uniform(-0.5, 0.5, (count, 1, 2)), rng.uniform(-0.4, 0.4, (count, 1, 2))
    points = np.concatenate([root + bend * up**2, np.broadcast_to(up, (count, 4, 1))], axis=2).reshape(-1, 3)
    return raytracer.Curves(points, np.full(4 * count, 0.03), np.arange(0, 4 * count + 1, 4), shape=shape, **fields)


@pytest.mark.parametrize("shape", ["ribbon", "thick"])
def test_white_hair_in_a_white_world_is_not_seen(shape):
    """Whatever bounces between strands: all light goes on until it finds the world."""
    material = make_material(roughness=0.5, radial_roughness=0.5, tilt=0.1)
    scene = raytracer.Scene(curves=make_strands(shape), materials=[material], world=raytracer.World(1.0), camera=CAMERA)
    bounces = {"max_bounces": 64, "glossy_bounces": 64, "transmission_bounces": 64}
    film = raytracer.render(scene, 12, 8, 48, integrator="path", **bounces)
    values = np.asarray(film["Combined"])[..., :3].mean(axis=-1)
    assert np.abs(values - 1.0).max() > 1e-3, "hair was there"
    assert abs(values.mean() - 1.0) < 4.5 * values.std() / np.sqrt(values.size)


STRAIGHT = raytracer.Curves(
    points=[(x, 0.0, z) for x in (-0.4, 0.4) for z in (0.0, 0.25, 0.5, 0.75, 1.0)],
    radii=[0.2 - 0.1 * z for _ in range(2) for z in (0.0, 0.25, 0.5, 0.75, 1.0)],
    strands=[0, 5, 10],
    attributes={INTERCEPT: [[z] for _ in range(2) for z in (0.0, 0.25, 0.5, 0.75, 1.0)]},
    strand_attributes={LENGTH: [[1.0], [2.0]], RANDOM: [[0.25], [0.75]]},
    world_from_object=[[2, 0, 0, 0.5], [0, 2, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1]],
)


@pytest.mark.parametrize(
    ("step", "output", "expected"),
    [
        (Step("HAIR_INFO Is Strand"), "Is Strand", lambda x, z: 1.0 + 0.0 * z),
        (Step("HAIR_INFO Intercept"), "Intercept", lambda x, z: z),
        (Step("HAIR_INFO Length"), "Length", lambda x, z: np.where(x < 0, 1.0, 2.0)),
        (Step("HAIR_INFO Random"), "Random", lambda x, z: np.where(x < 0, 0.25, 0.75)),
        (Step("HAIR_INFO Thickness"), "Thickness", lambda x, z: 0.4 - 0.2 * z),
        (Step("STRAND Random", (0.5,)), "Random", lambda x, z: np.where(x < 0, 0.25, 0.75)),
        (Step("TEX_COORD Object", (), {"object_from_world": None}), "Object", lambda x, z: (x - 0.5) / 2.0),
    ],
)
def test_nodes_read_strands(step, output, expected):
    """At the centres of pixels, against where they are: upright strands, even but in their end segments."""
    color, steps = Register(0, output), (step,)
    if output != "Object":
        color, steps = Register(1, "Value"), (step, Step("number to vector", (color,)))
    material = raytracer.Material((raytracer.Closure("emission", color=color),), program=Program(steps))
    scene = raytracer.Scene(curves=STRAIGHT, materials=[material], camera=CAMERA)
    film = raytracer.render(scene, 24, 24, 1, filter_width=0.0, passes=("Combined", "Position"))
    place, light = np.asarray(film["Position"]), np.asarray(film["Combined"])
    seen = (place[..., 2] > 0.25) & (place[..., 2] < 0.75)
    assert seen.sum() > 30
    x, z = place[seen, 0], place[seen, 2]
    np.testing.assert_allclose(light[seen, 0], expected(x, z), atol=2e-6)


def test_hair_needs_a_direction():
    with pytest.raises(ValueError, match="tangent: expected a direction along the strand, got None"):
        raytracer.Closure("hair")


def make_huang(**fields):
    """Hair by the other model, as the add-on writes it."""
    steps = ("STRAND Along", "STRAND Across", "STRAND Coverage", "STRAND Chance")
    names = {"tangent": "Along", "across": "Across", "coverage": "Coverage", "chance": "Chance"}
    registers = {name: Register(number, output) for number, (name, output) in enumerate(names.items())}
    program = Program(tuple(Step(step) for step in steps))
    return raytracer.Material((raytracer.Closure("hair_huang", **registers, **fields),), program=program)


@pytest.mark.parametrize("shape", ["ribbon", "thick"])
def test_huangs_white_hair_is_hardly_seen_in_a_white_world(shape):
    """Facets' tables give up to 2% too much back at each bounce."""
    scene = raytracer.Scene(
        curves=make_strands(shape), materials=[make_huang()], world=raytracer.World(1.0), camera=CAMERA
    )
    bounces = {"max_bounces": 64, "glossy_bounces": 64, "transmission_bounces": 64}
    film = raytracer.render(scene, 12, 8, 32, integrator="path", **bounces)
    values = np.asarray(film["Combined"])[..., :3].mean(axis=-1)
    assert 0.98 < values.mean() < 1.08
    assert np.abs(values - 1.0).max() > 1e-3, "hair was there"


def read_number(step, output, scene=STRAIGHT, **options):
    """Render what an operation tells of strands, as light."""
    steps = (step, Step("number to vector", (Register(0, output),)))
    material = raytracer.Material((raytracer.Closure("emission", color=Register(1, "Value")),), program=Program(steps))
    film = raytracer.render(
        raytracer.Scene(curves=scene, materials=[material], camera=CAMERA),
        24,
        24,
        1,
        filter_width=0.0,
        passes=("Combined", "Position"),
        **options,
    )
    return np.asarray(film["Position"]), np.asarray(film["Combined"])[..., 0]


def test_coverage_is_half_a_pixel_in_radii():
    """A pixel is as wide as the film over its distance; strands here are 0.4 - 0.2 z wide."""
    place, coverage = read_number(Step("STRAND Coverage"), "Coverage")
    seen = (place[..., 2] > 0.25) & (place[..., 2] < 0.75)
    _, y, z = place[seen].T
    extent = CAMERA.sensor_width / CAMERA.focal_length / 24
    depth = y + 3.0
    expected = extent * depth / 2 / (0.2 - 0.1 * z)
    # Away from the middle of the picture pixels are narrower than in it.
    np.testing.assert_allclose(coverage[seen], expected, rtol=0.06)


def test_chances_differ_from_place_to_place():
    place, chance = read_number(Step("STRAND Chance"), "Chance")
    found = chance[np.isfinite(place).all(axis=-1) & (chance > 0)]
    assert len(np.unique(found)) == len(found) > 30
    assert 0 < found.min() < 0.2 < 0.8 < found.max() < 1


@pytest.mark.parametrize(("axis", "width"), [((1.0, 0.0, 0.0), 1.0), ((0.0, 1.0, 0.0), 0.5)])
def test_elliptic_strands_are_met_as_wide_as_they_are_seen(axis, width):
    """Upright strands seen along y: with the longer axis along x they fill their width, along y half of it."""
    strands = raytracer.Curves(
        points=STRAIGHT.points,
        radii=STRAIGHT.radii,
        strands=STRAIGHT.strands,
        attributes={AXIS: np.tile(axis, (len(STRAIGHT.points), 1))},
    )
    steps = (
        Step("STRAND Across"),
        Step("STRAND Axis"),
        Step("STRAND Inside", (Register(1, "Axis"), 0.5, Register(0, "Across"))),
        Step("number to vector", (Register(2, "Inside"),)),
    )
    material = raytracer.Material((raytracer.Closure("emission", color=Register(3, "Value")),), program=Program(steps))
    scene = raytracer.Scene(curves=strands, materials=[material], camera=CAMERA)
    film = raytracer.render(scene, 96, 24, 1, filter_width=0.0, passes=("Combined", "Position"))
    place, inside = np.asarray(film["Position"]), np.asarray(film["Combined"])[..., 0]
    met = (place[..., 2] > 0.4) & (place[..., 2] < 0.6)
    assert inside[met].mean() == pytest.approx(width, abs=0.12)


def test_strands_without_an_axis_have_one_of_their_own():
    """Cycles' orthonormal frame of a direction: for one along z, x cross its other axis."""
    steps = (Step("STRAND Axis"),)
    material = raytracer.Material((raytracer.Closure("emission", color=Register(0, "Axis")),), program=Program(steps))
    scene = raytracer.Scene(curves=STRAIGHT, materials=[material], camera=CAMERA)
    film = raytracer.render(scene, 24, 24, 1, filter_width=0.0, passes=("Combined", "Position"))
    place, axis = np.asarray(film["Position"]), np.asarray(film["Combined"])[..., :3]
    met = (place[..., 2] > 0.4) & (place[..., 2] < 0.6)
    expected = np.cross([0, 0, 1], np.array([1, -1, 0]) / np.sqrt(2))
    np.testing.assert_allclose(axis[met], np.broadcast_to(np.maximum(expected, axis.min()), axis[met].shape), atol=1e-6)


@pytest.mark.parametrize(("alpha", "expected"), [(1.0, False), (0.5, True)])
def test_huangs_hair_lets_light_pass_only_where_it_is_elliptic(alpha, expected):
    assert lets_through(make_huang(alpha=alpha).closures[0]) == expected
