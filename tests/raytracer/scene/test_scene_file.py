"""Scene files in trouble: whatever is broken, one sentence says so; nothing is read that the scene does not name."""

from __future__ import annotations

import collections
import io
import os
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest

import raytracer
from raytracer import Closure, Image, Material, Program, Register, Step, TiledImage
from tests.raytracer.scene.scene_mutations import list_mutations, pack, store, unpack


def make_scene() -> raytracer.Scene:
    """Return a scene with a record of every kind, a program with an inner one, and a tiled image."""
    rng = np.random.default_rng(0)
    positions, triangles = rng.normal(size=(12, 3)), rng.integers(0, 12, size=(20, 3))
    image = Image(rng.integers(0, 256, (4, 4, 4), dtype=np.uint8), "srgb", "Image")
    tiled = TiledImage((1001, 1012), (image, Image(np.ones((1, 2, 4), np.float32), name="Other")), "Tiled")
    texture = {"image": tiled, "interpolation": "Linear", "extension": "REPEAT", "projection": "FLAT"}
    inner = Program([Step("ATTRIBUTE Fac", (), {"name": "generated"})], Register(0, "Fac"))
    program = Program(
        [
            Step("ATTRIBUTE Vector", (), {"name": "uv"}),
            Step("TEX_IMAGE", (Register(0, "Vector"),), {**texture, "projection_blend": 0.0, "unassociate": False}),
            Step("MATH", (Register(1, "Alpha"), 0.5, 0.0), {"operation": "MULTIPLY", "use_clamp": False}),
            Step("NEW_GEOMETRY Normal"),
            Step("BUMP", (1.0, 0.5, 1.0, Register(3, "Normal")), {"height": inner, "invert": False}),
        ]
    )
    principled = Closure(
        "principled", color=Register(1, "Color"), alpha=Register(2, "Value"), normal=Register(4, "Normal")
    )
    glow = [Closure("glossy", roughness=0.2), Closure("emission", color=2.0, normal=(0, 0, 1))]
    camera = np.eye(4)
    camera[2, 3] = 8.0
    return raytracer.Scene(
        meshes=[
            raytracer.Mesh(
                positions, triangles, rng.normal(size=(12, 3)), rng.random((20, 3, 2)), rng.integers(0, 2, 20), "First",
                {"generated": rng.random((12, 3)), "uv": rng.random((12, 2))},
            ),
            raytracer.Mesh(positions * 0.3, triangles, name="Second"),
        ],
        spheres=raytracer.Spheres(
            rng.normal(size=(4, 3)) * 2, np.full(4, 0.3), name="Spheres", attributes={"uv": rng.random((4, 3))}
        ),
        instances=raytracer.Instances(
            [0, 1],
            np.tile(np.eye(4), (2, 1, 1)),
            random=[0.1, 0.2],
            color=np.ones((2, 4)),
            properties={"OBJECT a": np.eye(2, 4)},
        ),
        materials=[Material([principled], name="Textured", program=program), Material(glow, name="Glow")],
        lights=[
            raytracer.PointLight((0, 0, 5), (100, 100, 100), radius=0.2, name="Point"),
            raytracer.SunLight((0, 0, 1), (1, 1, 1), name="Sun"),
            raytracer.SpotLight((3, 3, 3), 50.0, name="Spot"),
            raytracer.AreaLight((0, 3, 3), (1, 0, 0), (0, 1, 0), 30.0, name="Area"),
        ],
        world=raytracer.World((0.1, 0.2, 0.3)),
        camera=raytracer.Camera(camera),
        name="Scene",
    )  # fmt: skip


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("whole") / "scene.npz"
    raytracer.save(make_scene(), path)
    return path.read_bytes()


def judge(path: Path, content: bytes) -> str:
    """Load a file and render what it holds; return what came of it, which is 'refused', 'rendered' or a fault."""
    path.write_bytes(content)
    try:
        scene = raytracer.load(path)
    except (ValueError, OSError) as error:
        is_clear = str(path) in str(error) and "\n" not in str(error)
        return "refused" if is_clear else f"unclear: {error}"
    try:
        film = raytracer.render(scene, 4, 4, samples=1)
    except ValueError as error:
        return "refused by render" if "\n" not in str(error) else f"unclear: {error}"
    return "rendered" if np.isfinite(film["Combined"]).all() else "not finite"


@pytest.mark.parametrize("count", [350, pytest.param(2800, marks=pytest.mark.slow)])
@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # numbers that overflow are what is tried
def test_a_broken_scene_file_is_refused_in_one_sentence_or_renders(tmp_path: Path, whole: bytes, count: int) -> None:
    assert judge(tmp_path / "scene.npz", whole) == "rendered"
    counts: collections.Counter[str] = collections.Counter()
    for name, content in list_mutations(whole, count, seed=count):
        try:
            outcome = judge(tmp_path / "scene.npz", content)
        except Exception as error:
            outcome = f"{name}: {type(error).__name__}: {error}"
        counts[outcome] += 1
    faults = {outcome: number for outcome, number in counts.items() if not outcome.startswith(("refused", "rendered"))}
    assert not faults, counts
    assert counts["refused"] > count / 2


def test_an_array_that_nothing_names_is_not_read(tmp_path: Path, whole: bytes) -> None:
    outline, arrays = unpack(whole)
    path = tmp_path / "scene.npz"
    path.write_bytes(pack(outline, {**arrays, "array_99.npy": store(np.zeros(1 << 23))}))
    tracemalloc.start()
    raytracer.load(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1 << 23  # an eighth of that array


@pytest.mark.parametrize("count", [10**6, 10**12])
def test_a_size_that_the_file_does_not_hold_is_refused_before_memory_is_taken(
    tmp_path: Path, whole: bytes, count: int
) -> None:
    outline, arrays = unpack(whole)
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({count}, 3), }}\n".encode()
    content = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header
    path = tmp_path / "scene.npz"
    path.write_bytes(pack(outline, {**arrays, "array_0.npy": content}))
    tracemalloc.start()
    with pytest.raises(ValueError, match=r"scene\.npz: .* array_0 of .* not the size of what is stored"):
        raytracer.load(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1 << 23


def test_a_directory_that_claims_more_than_deflate_can_hold_is_refused(tmp_path: Path, whole: bytes) -> None:
    outline, arrays = unpack(whole)
    file = io.BytesIO(pack(outline, arrays))
    with zipfile.ZipFile(file, "a") as archive:
        archive.getinfo("array_0.npy").file_size = 10**12
        archive.writestr("more", b"")  # writes the directory again
    path = tmp_path / "scene.npz"
    path.write_bytes(file.getvalue())
    with pytest.raises(ValueError, match="array_0 of a size that the file does not hold"):
        raytracer.load(path)


def test_files_of_numpy_with_arrays_in_either_order_are_read(tmp_path: Path, whole: bytes) -> None:
    outline, arrays = unpack(whole)
    turned = {name: store(np.asfortranarray(np.load(io.BytesIO(content)))) for name, content in arrays.items()}
    path, other = tmp_path / "scene.npz", tmp_path / "other.npz"
    path.write_bytes(pack(outline, turned))
    other.write_bytes(whole)
    for mesh, same in zip(raytracer.load(path).meshes, raytracer.load(other).meshes, strict=True):
        np.testing.assert_array_equal(mesh.positions, same.positions)
        np.testing.assert_array_equal(mesh.triangles, same.triangles)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_a_pipe_or_a_device_is_no_scene_and_is_not_waited_for(tmp_path):
    pipe = tmp_path / "pipe.npz"
    os.mkfifo(pipe)
    for path in (pipe, "/dev/zero"):
        with pytest.raises(OSError, match="not a file") as caught:
            raytracer.load(path)
        assert caught.value.filename == str(path)
