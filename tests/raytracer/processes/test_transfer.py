"""Scenes on their way to another process: what arrives is the same, and only what is new travels."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from raytracer.processes.channel import pack, unpack
from raytracer.processes.transfer import SMALLEST_KEPT, Receiver, Sender
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Instances, Mesh

LARGE = SMALLEST_KEPT // 8


@pytest.fixture
def ends() -> tuple[Sender, Receiver]:
    return Sender(), Receiver()


def make_mesh(seed: int, vertices: int = SMALLEST_KEPT) -> Mesh:
    positions = np.random.default_rng(seed).normal(size=(vertices, 3))
    return Mesh(positions, np.arange(vertices // 3 * 3).reshape(-1, 3))


def place(mesh: Mesh, x: float) -> Scene:
    matrix = np.eye(4)
    matrix[0, 3] = x
    return Scene(meshes=[mesh], instances=Instances([0], [matrix]))


@pytest.mark.parametrize(
    "value",
    [
        np.arange(LARGE, dtype=np.float64),
        np.arange(4 * LARGE).reshape(2, 2, LARGE)[:, ::-1],
        np.asfortranarray(np.arange(6.0 * LARGE).reshape(6, LARGE)),
        np.zeros((0, 3)),
        np.float32(2.5),
        {"a": [1, "two", None], "b": np.ones(3, bool)},
    ],
    ids=["one axis", "strides", "columns first", "empty", "number", "others"],
)
def test_what_arrives_is_what_was_sent(ends: Any, value: Any) -> None:
    sender, receiver = ends
    found = receiver.unpack(sender.pack([value, value]))
    for one in found:
        np.testing.assert_equal(one, value)


def test_arrays_travel_once(ends: Any) -> None:
    sender, receiver = ends
    mesh = make_mesh(0)
    first = sender.pack(place(mesh, 0.0))
    second = sender.pack(place(mesh, 1.0))
    assert len(first.arrays) == 2  # positions and triangles
    assert not second.arrays
    before, after = receiver.unpack(first), receiver.unpack(second)
    assert after.meshes[0].positions is before.meshes[0].positions
    np.testing.assert_array_equal(after.instances.world_from_object[0, :, 3], (1.0, 0.0, 0.0, 1.0))


def test_the_same_scene_again_has_the_same_outline(ends: Any) -> None:
    sender, _ = ends
    scene = place(make_mesh(0), 0.0)
    first, again = sender.pack(scene), sender.pack(scene)
    assert again.outline == first.outline
    assert not again.arrays
    assert sender.pack(place(make_mesh(0), 0.5)).outline != first.outline


def test_arrays_that_no_scene_holds_are_let_go(ends: Any) -> None:
    sender, receiver = ends
    for seed in range(5):
        receiver.unpack(sender.pack(place(make_mesh(seed), 0.0)))
        assert len(receiver._kept) == len(sender._kept) == 2


def test_an_array_at_an_address_that_was_used_before_is_not_taken_for_it(ends: Any) -> None:
    sender, receiver = ends
    for seed in range(20):  # addresses of what was let go are given anew
        mesh = make_mesh(seed)
        expected = mesh.positions.copy()
        np.testing.assert_array_equal(receiver.unpack(sender.pack(Scene(meshes=[mesh]))).meshes[0].positions, expected)


def test_arrays_that_arrived_can_only_be_read(ends: Any) -> None:
    sender, receiver = ends
    scene = place(make_mesh(3), 0.0)
    assert not receiver.unpack(unpack(pack(sender.pack(scene)))).meshes[0].positions.flags.writeable
