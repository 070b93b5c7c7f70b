"""Materials whose programs differ in their images alone are evaluated together, bit for bit as one by one."""

import numpy as np
import pytest

import raytracer
from raytracer.scene.materials import Closure, Material
from raytracer.scene.programs import Image, Program, Register, Step, TiledImage
from raytracer.shading import computed, like_programs
from raytracer.textures.image import EXTENSIONS, INTERPOLATIONS, sample_image
from raytracer.textures.image_set import ImageSet, sample_image_set

SIDE = 6
READ_UV = Step("ATTRIBUTE Vector", (), {"name": "uv"})


def make_image(rng, dtype=np.uint8, encoding="srgb"):
    """Return an image of a size of its own."""
    pixels = rng.integers(0, 256, (*rng.integers(1, 9, 2), 4)).astype(dtype)
    return Image(pixels if dtype == np.uint8 else pixels / np.float32(255), encoding)


def read_image(image, **settings):
    flat = {"interpolation": "Linear", "extension": "REPEAT", "projection": "FLAT", "projection_blend": 0.0}
    return Step("TEX_IMAGE", (Register(0, "Vector"),), {"image": image, "unassociate": False, **flat, **settings})


def make_material(image, **settings):
    program = Program([READ_UV, read_image(image, **settings)])
    return Material((Closure("diffuse", color=Register(1, "Color")),), program=program)


def make_bumpy_material(rng):
    """Return a material that reads an image around its edges, inside of a program that a step runs, and another."""
    height = Program([READ_UV, read_image(make_image(rng, encoding="linear"))], Register(1, "Alpha"))
    steps = [
        READ_UV,
        read_image(make_image(rng, np.float32), projection="BOX", projection_blend=0.4),
        Step("NEW_GEOMETRY Normal"),
        Step("BUMP", (1.0, 0.05, 0.1, Register(2, "Normal")), {"height": height, "invert": False}),
    ]
    color, normal = Register(1, "Color"), Register(3, "Normal")
    return Material((Closure("diffuse", color=color, normal=normal),), program=Program(steps))


def make_scene(materials):
    """Return quads, flat and steep, whose materials follow each other, seen from above."""
    corners = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], dtype=float)
    slopes = corners[:, 0] * np.array([[-1.4], [0.0], [1.4]])
    quads = [
        raytracer.Mesh(
            np.column_stack([corners[:, :2] + (number % SIDE, number // SIDE), slopes[number % 3]]),
            [(0, 1, 2), (0, 2, 3)],
            uvs=2.5 * corners[:, :2] - 0.4,
            material=number % len(materials),
        )
        for number in range(SIDE * SIDE)
    ]
    above = np.eye(4)
    above[:3, 3] = (SIDE / 2, SIDE / 2, 7)
    light = raytracer.PointLight((1, 2, 4), power=500)
    return raytracer.Scene(meshes=quads, materials=materials, lights=[light], camera=raytracer.Camera(above))


def count_recipes(materials):
    scene = make_scene(materials)
    kept = [list(material.closures) for material in materials]
    return len(computed.make_computed_materials(kept, scene, None).everything.recipes)


@pytest.mark.parametrize("kind", ["flat", "bumpy"])
def test_picture_of_like_materials_is_that_of_each_alone(kind, monkeypatch):
    rng = np.random.default_rng(2)
    materials = [make_material(make_image(rng)) if kind == "flat" else make_bumpy_material(rng) for _ in range(7)]
    assert count_recipes(materials) == 1
    scene = make_scene(materials)
    together = raytracer.render(scene, 24, 18, 2)["Combined"]
    monkeypatch.setattr(computed, "describe_program", lambda program, needed: id(program))
    assert count_recipes(materials) == 7
    np.testing.assert_array_equal(together, raytracer.render(scene, 24, 18, 2)["Combined"])
    assert len(np.unique(together[..., :3])) > 100


def test_like_programs_run_once_for_all_points(monkeypatch):
    rng, counts = np.random.default_rng(2), []
    scene = make_scene([make_material(make_image(rng)) for _ in range(SIDE * SIDE)])
    evaluate = computed.evaluate

    def count(program, site, needed):
        counts.append(len(site))
        return evaluate(program, site, needed)

    monkeypatch.setattr(computed, "evaluate", count)
    raytracer.render(scene, 24, 18, 1)
    assert len(counts) == 1
    assert counts[0] > 100


def test_programs_with_other_steps_constants_or_settings_are_not_alike():
    rng = np.random.default_rng(5)
    image, tiles = make_image(rng), TiledImage([1001], [make_image(rng)])
    same = [make_material(image), make_material(make_image(rng)), make_material(image)]
    others = [
        make_material(make_image(rng, encoding="linear")),
        make_material(make_image(rng, np.float32)),
        make_material(None),
        make_material(tiles),
        make_material(image, interpolation="Closest"),
        make_material(image, projection_blend=-0.0),
    ]
    assert count_recipes(same) == 1
    for number in range(1, len(others) + 1):
        assert count_recipes([*same, *others[:number]]) == 1 + number
    powers = [
        Material(
            (Closure("diffuse", color=Register(2, "Value")),),
            program=Program([READ_UV, read_image(image), Step("MATH POWER", (Register(1, "Alpha"), power))]),
        )
        for power in (2.0, 3.0, 2.0)
    ]
    described = [like_programs.describe_program(material.program, (0, 1, 2)) for material in powers]
    assert described[0] == described[2] != described[1]


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
@pytest.mark.parametrize("extension", EXTENSIONS)
@pytest.mark.parametrize(("dtype", "encoding"), [(np.uint8, "srgb"), (np.float32, "linear")])
def test_image_set_reads_as_each_image_alone(interpolation, extension, dtype, encoding):
    rng = np.random.default_rng(9)
    images = [make_image(rng, dtype, encoding) for _ in range(5)]
    row = np.array([3, 0, 4, 4, 1])  # no material reads image 2
    material, uv = rng.integers(0, 5, 300), rng.uniform(-2.0, 2.0, (300, 2))
    found = sample_image_set(ImageSet(tuple(images), row), material, uv, interpolation, extension, unassociate=True)
    for number in range(5):
        rows = material == number
        wanted = sample_image(images[row[number]], uv[rows], interpolation, extension, unassociate=True)
        np.testing.assert_array_equal(found[rows], wanted)
