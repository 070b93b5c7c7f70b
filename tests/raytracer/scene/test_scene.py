"""Scene records: what they refuse, in which words; that they keep what they are given; that files give it back."""

import dataclasses
import json

import numpy as np
import pytest

import raytracer
from raytracer import (
    Camera,
    Closure,
    Image,
    Instances,
    Material,
    Mesh,
    Program,
    Register,
    Scene,
    Spheres,
    Step,
    TiledImage,
    World,
)
from raytracer.arrays.checks import as_array
from raytracer.scene.lights import AreaLight, PointLight, SpotLight, SunLight
from raytracer.scene.materials import CLOSURE_KINDS
from raytracer.scene.scene_file import FILE_FORMAT, load_settings
from tests import meshes

POSITIONS, TRIANGLES = meshes.make_quad()
NAN = float("nan")
PIXEL = Image(np.zeros((1, 1, 4), np.float32))


def make_quad(**fields):
    return Mesh(**{"positions": POSITIONS, "triangles": TRIANGLES, "name": "Quad", **fields})


def make_full_scene():
    """A scene with one of every record and an array in every place."""
    smooth = make_quad(normals=np.tile((0.0, 0, 1), (4, 1)), uvs=np.zeros((2, 3, 2)), material=[0, 1])
    matrices = np.array([np.eye(4), np.diag((-1.0, 2, 3, 1))])
    return Scene(
        meshes=[smooth, make_quad(normals=np.zeros((2, 3, 3)), uvs=np.ones((4, 2)), name="Käse")],
        spheres=[
            Spheres([(0, 0, 0)], [1.0], holdout=True, shadow_catcher=True),
            Spheres(np.zeros((0, 3)), [], pass_index=3),
        ],
        instances=Instances([0, 1], matrices, pass_index=[4, 5], holdout=[False, True], shadow_catcher=[True, False]),
        materials=[
            Material([Closure("glass", color=(1, 0.5, 0.25), ior=1.3), Closure("diffuse", 0.1, weight=0.5)], 7, "A"),
            Material(name="Black"),
        ],
        lights=[
            PointLight((1, 2, 3), 100, radius=0.1, soft_falloff=False),
            SpotLight((1, 2, 3), (1, 2, 3), spot_size=1.0, spot_blend=0.5),
            SunLight((0, 0, 2), 3.0, angle=0.01, cast_shadow=False),
            AreaLight((0, 0, 1), (1, 0, 0), (0, 1, 0), 10, shape="ellipse", spread=1.0),
        ],
        world=World((0.1, 0.2, 0.3)),
        camera=Camera(np.eye(4), "orthographic", ortho_scale=3.0, clip_end=np.inf),
        name="Everything",
    )


# Refusals -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: make_quad(positions=np.where(np.arange(4)[:, None] == 2, NAN, POSITIONS)),
            r"Mesh 'Quad': positions: expected finite numbers, got \[nan nan nan\] at row 2",
        ),
        (
            lambda: make_quad(positions=POSITIONS[:, :2]),
            r"Mesh 'Quad': positions: expected shape \(v, 3\) float64, got \(4, 2\)",
        ),
        (
            lambda: Mesh(POSITIONS, TRIANGLES + 0.0),
            r"Mesh: triangles: expected an array \(t, 3\) int32, got float64",
        ),
        (
            lambda: make_quad(triangles=[(0, 1, 2), (0, 1, 4)]),
            r"Mesh 'Quad': triangles: expected vertex indices from 0 to 3, got \[0, 1, 4\] at row 1",
        ),
        (
            lambda: make_quad(triangles=[(0, -1, 2)]),
            r"Mesh 'Quad': triangles: expected vertex indices from 0 to 3, got \[0, -1, 2\] at row 0",
        ),
        (
            lambda: make_quad(triangles=np.array([(0, 1, 2**32)])),
            r"Mesh 'Quad': triangles: expected an array \(t, 3\) int32, got 4294967296, which does not fit",
        ),
        (
            lambda: make_quad(normals=np.zeros((3, 3))),
            r"Mesh 'Quad': normals: expected shape \(4, 3\) float64, got \(3, 3\)",
        ),
        (
            lambda: make_quad(uvs=np.zeros((1, 3, 2))),
            r"Mesh 'Quad': uvs: expected shape \(2, 3, 2\) float64, got \(1, 3, 2\)",
        ),
        (
            lambda: make_quad(material=[0, 1, 2]),
            r"Mesh 'Quad': material: expected shape \(2,\) int32, got \(3,\)",
        ),
        (lambda: make_quad(material=-1), r"Mesh 'Quad': material: expected indices of 0 or more, got -1"),
        (
            lambda: Spheres([(0, 0, 0)], [0.0], name="Drops"),
            r"Spheres 'Drops': radii: expected numbers from 4.94066e-324 to inf, got 0",
        ),
        (lambda: Spheres([(0, 0, 0)], [1, 2]), r"Spheres: radii: expected shape \(1,\) float64, got \(2,\)"),
        (
            lambda: Spheres([(0, np.inf, 0)], [1]),
            r"Spheres: centres: expected finite numbers, got \[ 0. inf  0.\] at row 0",
        ),
        (
            lambda: Instances([0], [np.eye(4)], properties={"OBJECT a": [(1.0, 2.0)]}),
            r"Instances: property 'OBJECT a': expected shape \(1, 4\) float64, got \(1, 2\)",
        ),
        (
            lambda: Instances([0], [np.ones((4, 4))]),
            r"Instances: world_from_object: expected \(0, 0, 0, 1\) as the last row of each matrix, "
            r"got \[1.0, 1.0, 1.0, 1.0\] at row 0",
        ),
        (
            lambda: Instances([0, 1], [np.eye(4)]),
            r"Instances: world_from_object: expected shape \(2, 4, 4\) float64, got \(1, 4, 4\)",
        ),
        (
            lambda: Closure("marble"),
            rf"Closure: kind: expected one of {', '.join(CLOSURE_KINDS)}, got 'marble'",
        ),
        (
            lambda: Closure("glossy", roughness=1.5),
            r"Closure 'glossy': roughness: expected numbers from 0 to 1, got 1.5",
        ),
        (
            lambda: Closure("glossy", color=(1, -1, 1)),
            r"Closure 'glossy': color: expected numbers from 0 to 3.40282e\+38, got -1",
        ),
        (
            lambda: Closure("glass", ior=0),
            r"Closure 'glass': ior: expected numbers from 4.94066e-324 to 3.40282e\+38, got 0",
        ),
        (
            lambda: PointLight((0, 0, 0), 1, radius=-1, name="Lamp"),
            r"PointLight 'Lamp': radius: expected numbers from 0 to 3.40282e\+38, got -1",
        ),
        (
            lambda: PointLight((0, 0, NAN), 1, name="Lamp"),
            r"PointLight 'Lamp': position: expected finite numbers, got nan at row 2",
        ),
        (
            lambda: SunLight((0, 0, 0), 1),
            r"SunLight '': direction: expected a vector other than zero, got \[0.0, 0.0, 0.0\]",
        ),
        (
            lambda: AreaLight((0, 0, 0), (1, 0, 0), (0, 1, 0), 1, shape="disk"),
            r"AreaLight '': shape: expected one of rectangle, ellipse, got 'disk'",
        ),
        (
            lambda: AreaLight((0, 0, 0), (1, 0, 0), (0.5, 1, 0), 1, name="Lamp"),
            r"AreaLight 'Lamp': axis_v: expected a vector at right angles to axis_u, got \[0.5, 1.0, 0.0\]",
        ),
        (lambda: World((1, 2)), r"World: color: expected shape \(3,\) float64, got \(2,\)"),
        (
            lambda: Camera(np.eye(4), projection="fisheye"),
            r"Camera: projection: expected one of perspective, orthographic, panorama, got 'fisheye'",
        ),
        (
            lambda: Camera(np.eye(4), clip_start=2, clip_end=1),
            r"Camera: clip_end: expected numbers from 2 to inf, got 1",
        ),
        (
            lambda: Camera(np.eye(4), clip_end=[1.0, 2.0]),
            r"Camera: clip_end: expected shape \(\) float64, got \(2,\)",
        ),
        (
            lambda: Camera(np.ones((4, 4))),
            r"Camera: world_from_camera: expected \(0, 0, 0, 1\) as the last row, got \[1.0, 1.0, 1.0, 1.0\]",
        ),
        (lambda: Scene(camera=5), r"Scene: camera: expected Camera or None, got int"),
        (lambda: Scene(world=5), r"Scene: world: expected World or None, got int"),
        (lambda: Scene(instances=()), r"Scene: instances: expected Instances or None, got tuple"),
        (lambda: Scene(name=5), r"Scene: name: expected text, got int"),
        (lambda: Scene(lights=5), r"Scene: lights: expected light records, got int"),
        (lambda: Material(program=5), r"Material '': program: expected a Program or None, got int"),
        (lambda: World(program=5), r"World: program: expected a Program or None, got int"),
        (lambda: Material(closures=[5]), r"Material '': closures: expected Closure records, got int"),
        (lambda: Material(pass_index=-1), r"Material '': pass_index: expected numbers from 0 to 2.14748e\+09, got -1"),
        (lambda: Material(pass_index="a"), r"Material '': pass_index: expected an array \(\) int32, got str"),
        (lambda: Material(transparent_shadow=3), r"Material '': transparent_shadow: expected an array .*, got int"),
        (lambda: Step(5), r"Step: operation: expected text, got int"),
        (lambda: Program([5]), r"Program: steps: expected Step records, got int"),
        (
            lambda: Program([Step("VALUE"), Step("MATH", [Register(0.5, "Value")])]),
            r"Program: step 1 \(MATH\): expected a register of one of the 1 steps before it, got Register.*",
        ),
        (lambda: World(1e39), r"World: color: expected numbers from -3.40282e\+38 to 3.40282e\+38, got 1e\+39"),
        (lambda: Closure("principled", emission=np.inf), r"Closure 'principled': emission: expected finite numbers.*"),
        (lambda: PointLight((0, 0, 0), 1, radius=1e300), r"PointLight '': radius: expected numbers .*, got 1e\+300"),
        (lambda: Image(np.full((1, 1, 4), np.inf, np.float32)), r"Image '': pixels: expected finite numbers.*"),
        (lambda: TiledImage([1001], [5]), r"TiledImage '': tiles: expected Image records, got int"),
        (lambda: TiledImage([], []), r"TiledImage '': numbers: expected a whole number for each tile, .*"),
        (
            lambda: TiledImage([1001, 1002], [PIXEL]),
            r"TiledImage '': numbers: expected a whole number for each tile, .*",
        ),
        (lambda: TiledImage([1001.0], [PIXEL]), r"TiledImage '': numbers: expected a whole number for each tile, .*"),
        (lambda: TiledImage([1000], [PIXEL]), r"TiledImage '': numbers: expected different ones from 1001 to 2000"),
        (lambda: TiledImage([2001], [PIXEL]), r"TiledImage '': numbers: expected different ones from 1001 to 2000"),
        (lambda: TiledImage([1002] * 2, [PIXEL] * 2), r"TiledImage '': numbers: expected different ones from .*"),
        (lambda: Scene(meshes=[POSITIONS]), r"Scene: meshes: expected Mesh records, got ndarray"),
        (
            lambda: Scene(meshes=[make_quad()], instances=Instances([1], [np.eye(4)])),
            r"Scene: instances: mesh: expected indices from 0 to 0, got 1",
        ),
        (
            lambda: Scene(meshes=[make_quad(material=1)]),
            r"Mesh 'Quad': material: expected indices below the scene's 1 materials, got 1",
        ),
    ],
)
def test_record_refuses_in_a_sentence_that_names_field_expected_and_actual(make, message):
    with pytest.raises(ValueError, match=f"^{message}$"):
        make()


@pytest.mark.parametrize("value", [2**31, -(2**31) - 1])
def test_integers_that_do_not_fit_are_refused_not_wrapped(value):
    with pytest.raises(ValueError, match="does not fit"):
        as_array([value], np.int32, ("n",), "index")


def test_letters_in_a_shape_stand_for_one_size_each():
    assert as_array(np.zeros((2, 2)), np.float64, ("n", "n"), "matrix").shape == (2, 2)
    with pytest.raises(ValueError, match=r"matrix: expected shape \(n, n\) float64, got \(2, 3\)"):
        as_array(np.zeros((2, 3)), np.float64, ("n", "n"), "matrix")


# Acceptance ---------------------------------------------------------------------------------------------------------


def test_records_accept_lists_and_other_precisions():
    mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    assert mesh.positions.dtype == np.float64
    assert mesh.triangles.dtype == np.int32
    assert Mesh(np.float32(POSITIONS), np.uint64(TRIANGLES)).triangles.dtype == np.int32


def test_empty_mesh_and_scene_are_legal():
    empty = Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    assert Scene(meshes=[empty, empty]).instance_count == 2
    assert Scene().instance_count == 0
    assert len(Scene().materials) == 1


def test_records_are_frozen_and_do_not_freeze_what_they_are_given():
    positions = POSITIONS.copy()
    mesh = make_quad(positions=positions)
    with pytest.raises(dataclasses.FrozenInstanceError):
        mesh.positions = positions
    with pytest.raises(ValueError, match="read-only"):
        mesh.positions[0, 0] = 1
    assert positions.flags.writeable


def test_records_do_not_freeze_the_array_that_a_table_hands_out():
    class Table:
        def __array__(self, dtype=None, copy=None):
            return positions

    positions = POSITIONS.copy()
    assert not make_quad(positions=Table()).positions.flags.writeable
    assert positions.flags.writeable


def test_float32_positions_keep_their_values_and_their_vertices():
    positions = np.float32([(0.1, 0, 0), (0.1, 0, 0), (np.nextafter(np.float32(0.1), np.float32(1)), 0, 0)])
    np.testing.assert_array_equal(Mesh(positions, [(0, 1, 2)]).positions, positions.astype(np.float64), strict=True)


@pytest.mark.parametrize("power", [{}, {"a": 1}, object(), 1j, ..., "1", [1j] * 3])
def test_a_color_that_is_no_number_is_a_value_error_that_names_it(power):
    with pytest.raises(ValueError, match=r"PointLight 'P': power: expected an array \(3,\) float64, got "):
        PointLight((0, 0, 0), power, name="P")


def test_a_number_stands_for_grey_and_one_group_of_spheres_for_a_list():
    np.testing.assert_array_equal(World(0.5).color, (0.5, 0.5, 0.5))
    scene = Scene(spheres=Spheres([(0, 0, 0)], [1]))
    assert len(scene.spheres) == 1


@pytest.mark.parametrize("length", [1e300, 1e-200, 5e-324, np.finfo(float).max])
def test_sun_direction_of_any_length_is_made_unit_length(length):
    np.testing.assert_array_equal(SunLight((0, 0, -length), 1).direction, (0, 0, -1))
    direction = SunLight((length, length, length), 1).direction
    np.testing.assert_allclose(direction, 3**-0.5, rtol=4 * np.finfo(float).eps)


def test_sun_direction_is_made_unit_length():
    np.testing.assert_array_equal(SunLight((0, 0, 7), 1).direction, (0, 0, 1))


def test_spheres_are_numbered_after_the_instances():
    assert make_full_scene().instance_count == 2
    assert dataclasses.replace(make_full_scene(), instances=None).instance_count == 2


# Files --------------------------------------------------------------------------------------------------------------


def assert_same_record(first, second):
    assert type(first) is type(second)
    if dataclasses.is_dataclass(first):
        for field in dataclasses.fields(first):
            assert_same_record(getattr(first, field.name), getattr(second, field.name))
    elif isinstance(first, tuple):
        assert len(first) == len(second)
        for one, other in zip(first, second, strict=True):
            assert_same_record(one, other)
    else:
        np.testing.assert_array_equal(first, second, strict=isinstance(first, np.ndarray))


@pytest.mark.parametrize("scene", [make_full_scene(), Scene()], ids=["full", "empty"])
def test_a_saved_scene_loads_as_it_was(tmp_path, scene):
    path = tmp_path / "scene with spaces.npz"
    raytracer.save(scene, path)
    for restored in (raytracer.load(path), raytracer.load(str(path))):
        assert_same_record(scene, restored)


def test_numpy_scalars_are_saved_as_plain_ones(tmp_path):
    group = Spheres([(0, 0, 0)], [1], pass_index=np.int32(3), holdout=np.bool_(True))
    raytracer.save(Scene(spheres=group, materials=[Material(pass_index=np.int64(4))]), tmp_path / "scene.npz")
    scene = raytracer.load(tmp_path / "scene.npz")
    assert (scene.spheres[0].pass_index, scene.spheres[0].holdout, scene.materials[0].pass_index) == (3, True, 4)


def test_settings_of_numpy_are_saved_as_plain_ones(tmp_path):
    path = tmp_path / "scene.npz"
    raytracer.save(
        Scene(), path, {"width": np.int64(8), "border": np.array([0, 0, 4, 2]), "transparent": np.bool_(True)}
    )
    assert load_settings(path) == {"width": 8, "border": (0, 0, 4, 2), "transparent": True}
    with pytest.raises(ValueError, match="save: settings: expected numbers, texts or sequences of them, got object"):
        raytracer.save(Scene(), path, {"seed": object()})


def test_an_array_shared_by_records_is_written_once(tmp_path):
    mesh = make_quad(positions=np.random.default_rng(1).random((4, 3)))
    raytracer.save(Scene(meshes=[mesh, dataclasses.replace(mesh, name="Twin")]), tmp_path / "twice.npz")
    with np.load(tmp_path / "twice.npz") as file:
        shapes = [file[name].shape for name in file.files]
    assert shapes.count((4, 3)) == 1


def outline_file(path, content):
    np.savez(path, outline=np.array(json.dumps(content)))


@pytest.mark.parametrize(
    "write",
    [
        lambda path: path.write_bytes(b""),
        lambda path: path.write_bytes(b"a text"),
        lambda path: path.write_bytes(b"PK\x03\x04 a broken archive"),
        lambda path: np.savez(path, positions=POSITIONS),
        lambda path: np.savez(path, POSITIONS),
        lambda path: outline_file(path, {"format": "another-1", "scene": {}}),
        lambda path: outline_file(path, {"format": FILE_FORMAT, "scene": {"record": "Planet", "fields": {}}}),
        lambda path: outline_file(path, {"format": FILE_FORMAT, "scene": {"record": "World", "fields": {}}}),
        lambda path: outline_file(path, {"format": FILE_FORMAT, "scene": {"record": "Scene", "fields": {"sky": 1}}}),
    ],
    ids=["empty", "text", "archive", "other npz", "unnamed npz", "format", "record", "world", "field"],
)
def test_a_file_that_is_no_scene_is_refused_by_name(tmp_path, write):
    path = tmp_path / "file.npz"
    write(path)
    with pytest.raises(ValueError, match=r"file\.npz: expected a scene written by raytracer\.save"):
        raytracer.load(path)


def test_a_truncated_file_is_refused_by_name(tmp_path):
    path = tmp_path / "file.npz"
    raytracer.save(make_full_scene(), path)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(ValueError, match=r"file\.npz: expected a scene"):
        raytracer.load(path)


def test_a_missing_file_is_missing(tmp_path):
    with pytest.raises(FileNotFoundError):
        raytracer.load(tmp_path / "nowhere.npz")


def test_a_single_npy_array_is_refused_by_name(tmp_path):
    np.save(tmp_path / "array.npy", POSITIONS)
    with pytest.raises(ValueError, match=r"array\.npy: expected a scene"):
        raytracer.load(tmp_path / "array.npy")


def test_a_spot_that_is_flattened_is_refused_by_name():
    with pytest.raises(ValueError, match="SpotLight 'Lamp': world_from_light: expected a matrix that can be inverted"):
        SpotLight((0, 0, 0), 1.0, world_from_light=np.diag([1.0, 1.0, 0.0]), name="Lamp")
