"""Surfaces exactly upon each other: the picture is that of surfaces a hair apart, whichever was made first."""

from itertools import permutations

import numpy as np
import pytest

import raytracer
from raytracer.casting.rays import make_rays
from raytracer.integrator.loop import trace
from raytracer.integrator.prepare import prepare
from raytracer.integrator.settings import Settings
from raytracer.sampling.sobol import SobolSamples
from raytracer.scene.fields import SEEN_BY_ALL
from raytracer.scene.materials import Closure, Material
from raytracer.surfaces.places import make_order
from raytracer.surfaces.surface import make_surface

MATERIALS = {
    "red": Material((Closure("diffuse", color=(0.8, 0.2, 0.1)),)),
    "glow": Material((Closure("emission", color=(0.0, 2.0, 0.0)),)),
    "glass": Material((Closure("glass", color=0.9, roughness=0.0, ior=1.45),)),
    "rough": Material((Closure("glass", color=0.9, roughness=0.4, ior=1.45),)),
    "water": Material((Closure("refraction", color=1.0, roughness=0.0, ior=1.33),)),
    "clear": Material((Closure("transparent", color=1.0),)),
    "tinted": Material((Closure("transparent", color=0.5),)),
    "alpha": Material((Closure("principled", color=(0.1, 0.2, 0.9), alpha=0.0, specular=0.0),)),
    "decal": Material(
        (Closure("transparent", color=1.0, weight=0.5), Closure("diffuse", color=(0.1, 0.2, 0.9), weight=0.5))
    ),
    "cloth": Material((Closure("translucent", color=(0.5, 0.6, 0.7)),)),
}
NAMES = list(MATERIALS)
HAIR = 1e-7
COUNT = 300
# So many rays are aimed at edges and corners.
EDGES = 20
SKY = raytracer.World(color=(0.0, 0.0, 0.5))


def square(height, size, front=True):
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]]) * size + (0, 0, height)
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    return corners, triangles if front else triangles[:, ::-1]


def cube(low, high, size):
    parts = [square(high, size), square(low, size, front=False)]
    corners = np.concatenate([parts[0][0], parts[1][0]])
    sides = [[a, b + 4, b] for a, b in ((0, 1), (1, 2), (2, 3), (3, 0))]
    sides += [[a, a + 4, b + 4] for a, b in ((0, 1), (1, 2), (2, 3), (3, 0))]
    return corners, np.concatenate([parts[0][1], parts[1][1] + 4, np.array(sides)])


def make_scene(parts, names, order, matrix, lights=None, world=SKY, **flags):
    """Objects (corners, triangles), each of a named material, made in some order at one placement."""
    sun = raytracer.SunLight(direction=matrix[:3, :3] @ (0.3, 0.2, 1.0), strength=2.0, angle=0.7)
    meshes = [raytracer.Mesh(*parts[k], material=NAMES.index(names[k])) for k in order]
    given = {name: [values[k] for k in order] for name, values in flags.items()}
    return raytracer.Scene(
        meshes=meshes,
        instances=raytracer.Instances(np.arange(len(meshes)), [matrix] * len(meshes), **given),
        materials=list(MATERIALS.values()),
        lights=(sun,) if lights is None else lights,
        world=world,
    )


def look(
    scene, matrix, precision="certified", passes=("Combined",), integrator="path", slant=1.0, height=3.0, **settings
):
    rng = np.random.default_rng(5)
    origins = np.full((COUNT, 3), (1.5 * slant, -1.2 * slant, height))
    targets = np.column_stack([rng.uniform(-0.6, 0.6, size=(COUNT, 2)), np.zeros(COUNT)])
    targets[:EDGES] = np.round(targets[:EDGES] * 2) / 2  # along edges and through corners as well
    to_world = matrix[:3, :3]
    rays = make_rays(origins @ to_world.T + matrix[:3, 3], (targets - origins) @ to_world.T)
    samples = SobolSamples(np.arange(COUNT, dtype=np.uint32), 0, 0)
    settings = Settings(passes=passes, integrator=integrator, max_bounces=8, **settings)
    return trace(prepare(scene, raytracer.build(scene, precision), settings), rays, samples)["Combined"]


def rotate(axis, angle):
    matrix = np.eye(4)
    i, j = [k for k in range(3) if k != axis]
    matrix[i, i] = matrix[j, j] = np.cos(angle)
    matrix[i, j], matrix[j, i] = -np.sin(angle), np.sin(angle)
    return matrix


STRAIGHT, TURNED = np.eye(4), rotate(2, 0.7)
# Here rounding parts the surfaces, by less than the bound on its error.
TILTED = rotate(0, 0.6) @ rotate(2, 0.7)
TILTED[:3, 3] = 0.3, -0.2, 0.1


# Objects at and above z = 0, whose hair's breadth is given from the ground up, and their materials.
STACKS = {
    "glass cube on a table": lambda hair: ([square(-hair, 9), cube(0.0, 0.8, 0.5)], ["red", "glass"]),
    "rough glass on a table": lambda hair: ([square(-hair, 9), cube(0.0, 0.8, 0.5)], ["red", "rough"]),
    "glass on what shines": lambda hair: ([square(-hair, 9), cube(0.0, 0.8, 0.5)], ["glow", "glass"]),
    "glass on glass": lambda hair: (
        [square(-1, 9), cube(-0.5, 0.0, 0.5), cube(hair, 0.6, 0.5)], ["red", "glass", "water"],
    ),
    "pane on a wall": lambda hair: ([square(-hair, 9), square(0.0, 0.5)], ["red", "glass"]),
    "nothing on a wall": lambda hair: ([square(-hair, 9), square(0.0, 0.5)], ["red", "clear"]),
    "alpha 0 on a wall": lambda hair: ([square(-hair, 9), square(0.0, 0.5)], ["red", "alpha"]),
    "decal on a wall": lambda hair: ([square(-hair, 9), square(0.0, 0.5)], ["red", "decal"]),
    "decal on glass on a table": lambda hair: (
        [square(-hair, 9), cube(0.0, 0.8, 0.5), square(0.8 + hair, 0.3)], ["red", "glass", "decal"],
    ),
    "decal between glass and table": lambda hair: (
        [square(-2 * hair, 9), square(-hair, 0.3), cube(0.0, 0.8, 0.5)], ["red", "decal", "glass"],
    ),
    "cloth on a table": lambda hair: ([square(-hair, 9), square(0.0, 0.5)], ["red", "cloth"]),
    "cloth on what shines": lambda hair: ([square(-hair, 9), square(0.0, 0.5)], ["glow", "cloth"]),
}  # fmt: skip


def look_at_orders(parts, names, matrix, **settings):
    orders = permutations(range(len(parts)))
    return [look(make_scene(parts, names, order, matrix), matrix, **settings) for order in orders]


@pytest.mark.parametrize("integrator", ["path", "direct"])
@pytest.mark.parametrize("matrix", [STRAIGHT, TURNED], ids=["straight", "turned"])
@pytest.mark.parametrize("name", STACKS)
def test_any_order_of_objects_gives_the_picture_of_a_gap(name, matrix, integrator):
    apart, names = STACKS[name](HAIR)
    expected = look(make_scene(apart, names, range(len(apart)), matrix), matrix, integrator=integrator)
    pictures = look_at_orders(STACKS[name](0.0)[0], names, matrix, integrator=integrator)
    for picture in pictures:
        np.testing.assert_array_equal(picture[EDGES:], pictures[0][EDGES:])
        different = np.abs(picture - expected).max(axis=1) > 1e-4 * (1 + np.abs(expected).max(axis=1))
        # Light that the gap itself lets through, past an edge of what lies upon it.
        assert different[EDGES:].mean() < 0.01


@pytest.mark.parametrize("precision", ["certified", "float64"])
@pytest.mark.parametrize("matrix", [STRAIGHT, TURNED, TILTED], ids=["straight", "turned", "tilted"])
@pytest.mark.parametrize("name", STACKS)
def test_nothing_shines_through_what_nothing_passes(name, matrix, precision):
    """What shines below a table is never seen, not even through edges and corners, in any order of what coincides.

    What shines is at nobody's place: it is the first object once, and the last one in the other orders."""
    parts, names = STACKS[name](0.0)
    names = ["red" if material == "glow" else material for material in names]
    below, stack = len(parts), range(len(parts))
    parts, names = [*parts, square(-2, 5)], [*names, "glow"]
    for order in [(below, *stack), *((*order, below) for order in permutations(stack))]:
        scene = make_scene(parts, names, order, matrix, lights=(), world=None)
        assert not look(scene, matrix, precision)[:, :3].any()


def test_what_a_path_meets_at_the_place_that_it_has_just_left_counts_as_alone():
    """From a table beside rough glass into that: which side of the table the path came from, that way does not tell.
    The rays down from there met nothing of the table, and saw what shines below."""
    parts, names = STACKS["rough glass on a table"](0.0)
    scene = make_scene(parts, names, range(2), TURNED)
    caster = raytracer.build(scene)
    tables = prepare(scene, caster, Settings()).tables
    rays = make_rays(
        [(3.8242109364224458e-01, 3.2210884361884595e-01, 2.8426109166682360e-13)],
        [(-0.7396126785584951, 0.5017284810535018, 0.44859961771637086)],
    )
    hits = caster.closest_hit(rays.origins, rays.directions, order=make_order(tables))
    assert hits.tied[0]
    assert not make_surface(tables, rays, hits).layer.any()


@pytest.mark.parametrize("name", STACKS)
def test_tilted_surfaces_do_not_depend_on_the_order_of_objects(name):
    parts, names = STACKS[name](0.0)
    pictures = look_at_orders(parts, names, TILTED)
    for picture in pictures[1:]:
        np.testing.assert_array_equal(picture[EDGES:], pictures[0][EDGES:])


@pytest.mark.parametrize("flag", ["seen_by", "holdout", "shadow_catcher"])
@pytest.mark.parametrize("name", ["pane on a wall", "nothing on a wall", "decal on a wall", "cloth on a table"])
def test_opaque_surfaces_are_met_before_holdouts_and_catchers_at_their_place(name, flag):
    """A third object at the same place, hidden from all rays, a holdout or a catcher: as if it were not there."""
    (wall, upper), names = STACKS[name](0.0)
    marks = [SEEN_BY_ALL, SEEN_BY_ALL, 0] if flag == "seen_by" else [False, False, True]
    expected = look(make_scene([wall, upper], names, (0, 1), STRAIGHT), STRAIGHT)
    for order in permutations(range(3)):
        scene = make_scene([wall, upper, square(0.0, 3)], [*names, "red"], order, STRAIGHT, **{flag: marks})
        np.testing.assert_array_equal(look(scene, STRAIGHT)[EDGES:], expected[EDGES:])


@pytest.mark.parametrize("integrator", ["path", "direct"])
def test_catchers_and_holdouts_at_the_place_of_transparent_surfaces_are_met(integrator):
    """What lies on a catcher and lets all through leaves its picture as it is; the same for a holdout."""
    for flag in ("holdout", "shadow_catcher"):
        pictures = []
        for order in ((0, 1), (1, 0)):
            for upper in ("clear", "alpha"):
                parts, marks = [square(0, 9), square(0.0, 3)], {flag: [True, False]}
                scene = make_scene(parts, ["red", upper], order, STRAIGHT, **marks)
                pictures.append(look(scene, STRAIGHT, integrator=integrator, transparent=True))
        alone = make_scene([square(0, 9)], ["red"], (0,), STRAIGHT, **{flag: [True]})
        expected = look(alone, STRAIGHT, integrator=integrator, transparent=True)
        for picture in pictures:
            np.testing.assert_allclose(picture[EDGES:], expected[EDGES:], atol=1e-12)


def test_shadow_rays_meet_what_lies_on_what_lets_light_through():
    """A clear sheet at the place of an opaque roof, made first or last: no light comes in."""
    for upper in ("clear", "decal"):
        for order in permutations(range(3)):
            scene = make_scene(
                [square(0, 9), square(1.0, 5), square(1.0, 5)], ["red", "red", upper], order, STRAIGHT, world=None
            )
            below = look(scene, STRAIGHT, slant=0.1, integrator="direct", height=0.9)
            assert not below[:, :3].any()


def test_light_of_one_object_passes_its_sheets_at_one_place_once():
    """Through the edge between two triangles of a tinted square goes half of the light."""
    scene = make_scene([square(-1, 9), square(0.0, 0.7)], ["glow", "tinted"], (0, 1), STRAIGHT, lights=(), world=None)
    picture = look(scene, STRAIGHT, slant=0.0)
    np.testing.assert_allclose(picture[:, 1], 1.0, rtol=1e-12)


def test_of_glass_in_glass_the_lower_instance_is_inside():
    """Two cubes whose bottoms lie on a table: as if that of the first were a hair higher."""
    names = ["water", "glass", "red"]
    apart = [cube(HAIR, 0.4, 0.3), cube(0.0, 0.8, 0.5), square(-HAIR, 9)]
    together = [cube(0.0, 0.4, 0.3), cube(0.0, 0.8, 0.5), square(0.0, 9)]
    expected = look(make_scene(apart, names, (0, 1, 2), STRAIGHT), STRAIGHT)
    for order in ((0, 1, 2), (0, 2, 1), (2, 0, 1)):
        picture = look(make_scene(together, names, order, STRAIGHT), STRAIGHT)
        different = np.abs(picture - expected).max(axis=1) > 1e-4 * (1 + np.abs(expected).max(axis=1))
        assert different[EDGES:].mean() < 0.01
    reverse = look(make_scene(together, names, (1, 0, 2), STRAIGHT), STRAIGHT)
    assert (np.abs(reverse - expected).max(axis=1) > 1e-4)[EDGES:].mean() > 0.1
