"""Cryptomatte: hashes of the specification's vectors, slots by brute force, and coverage of known pictures."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import raytracer
from raytracer.film.mattes import add_coverage, hash_name, hash_to_float, sort_slots
from raytracer.film.passes import MATTES, matte_pass, matte_table, select_mattes
from tests.forbidding import forbid

# MurmurHash3_x86_32 with the seed 0, as published test vectors and Cryptomatte's own manifests have it.
HASHES = {"": 0x00000000, "a": 0x3C2569B2, "hello": 0x248BFA47, "hello, world": 0x149BBB7F}
HASHES |= {"The quick brown fox jumps over the lazy dog": 0x2E4FF723}


@pytest.mark.parametrize(("name", "value"), HASHES.items())
def test_names_are_hashed_as_murmur_does(name: str, value: int) -> None:
    assert hash_name(name) == value


@pytest.mark.parametrize("value", [0, 1, 0x7F800000, 0xFF800000, 0x7FC00000, 0xFFFFFFFF, 0x3F800000, 0x80000000])
def test_hashes_become_floats_that_are_normal_numbers(value: int) -> None:
    """All bits are kept but those of an exponent of 0 or 255, which stands for 0, denormals, infinities and NaN."""
    number = np.float32(hash_to_float(value))
    assert np.isfinite(number)
    assert abs(number) >= np.finfo(np.float32).tiny
    assert (int(number.view(np.uint32)) ^ value) & 0x807FFFFF == 0
    if 0 < value >> 23 & 255 < 255:
        assert int(number.view(np.uint32)) == value


def test_slots_hold_what_adding_up_by_hand_gives() -> None:
    """Random things in random rows; the last slot takes what finds none, as its first thing."""
    random = np.random.default_rng(11)
    table, slots = np.zeros((50, 8)), 4
    by_hand: list[dict[float, float]] = [{} for _ in range(50)]
    for _ in range(200):
        rows = random.permutation(50)[:20]
        identity, share = random.integers(1, 7, 20).astype(float), random.random(20) * (random.random(20) < 0.9)
        add_coverage(table, rows, identity, share)
        for row, one, part in zip(rows.tolist(), identity.tolist(), share.tolist(), strict=True):
            held = by_hand[row]
            if part > 0:
                key = one if one in held or len(held) < slots else list(held)[-1]
                held[key] = held.get(key, 0.0) + part
    for row, held in zip(sort_slots(table), by_hand, strict=True):
        expected = sorted(held.items(), key=lambda item: -item[1])
        assert [pair for pair in row.reshape(-1, 2).tolist() if pair[1] > 0] == [list(item) for item in expected]


def make_scene(**fields: Any) -> raytracer.Scene:
    """A ball before a wall that fills the left half of the picture."""
    wall = raytracer.Mesh([(-99, -99, -4), (0, -99, -4), (0, 99, -4), (-99, 99, -4)], [(0, 1, 2), (0, 2, 3)])
    properties = {matte_table(kind): [(hash_to_float(hash_name("Wall")), 0, 0, 0)] for kind in ("Object", "Asset")}
    ball = {matte_table(kind): (hash_to_float(hash_name("Ball")), 0, 0, 0) for kind in ("Object", "Asset")}
    materials = [
        raytracer.Material((raytracer.Closure("diffuse"),), name="Paint"),
        raytracer.Material(
            (raytracer.Closure("transparent", weight=0.75, color=(1, 1, 1)), raytracer.Closure("diffuse", weight=0.25)),
            name="Veil",
        ),
    ]
    return raytracer.Scene(
        meshes=[wall],
        instances=raytracer.Instances([0], [np.eye(4)], properties=properties),
        spheres=[raytracer.Spheres([(0, 0, -2.5)], [0.5], material=[1], properties=ball)],
        materials=materials,
        camera=raytracer.Camera(np.eye(4), **fields),
    )


NAMES = tuple(matte_pass(kind, number) for kind in MATTES for number in range(2))


@pytest.mark.parametrize("settings", [{}, {"block_size": 37}, {"workers": 2}])
def test_coverage_is_the_share_of_a_pixel_that_each_thing_takes(settings: dict[str, Any]) -> None:
    film = raytracer.render(make_scene(), 16, 9, 32, passes=("Combined", *NAMES), **settings)
    wall, ball, paint, veil = (hash_to_float(hash_name(name)) for name in ("Wall", "Ball", "Paint", "Veil"))
    for kind, back, front in (("Object", wall, ball), ("Asset", wall, ball), ("Material", paint, veil)):
        table = np.concatenate([film[matte_pass(kind, number)] for number in range(2)], axis=2)
        np.testing.assert_array_equal(table[4, 1], np.float32([back, 1, 0, 0, 0, 0, 0, 0]))
        np.testing.assert_array_equal(table[4, 14], np.zeros(8))
        # The middle of the ball, a quarter opaque in front and behind: over nothing at the right, the wall at the left.
        np.testing.assert_allclose(table[4, 9, :4], (front, 1 - 0.75**2, 0, 0), rtol=1e-6)
        np.testing.assert_allclose(table[4, 6, :4], (back, 0.75**2, front, 1 - 0.75**2), rtol=1e-6)
        assert (table[..., 1::2].sum(axis=2) <= 1 + 1e-6).all()
        assert (np.diff(table[..., 1::2], axis=2) <= 0).all()


def test_things_without_a_name_cover_nothing_that_is_told() -> None:
    scene = raytracer.Scene(meshes=make_scene().meshes, camera=raytracer.Camera(np.eye(4)))
    film = raytracer.render(scene, 8, 6, 2, passes=("CryptoObject00",))
    assert not film["CryptoObject00"][..., 0].any()


def test_mattes_that_nobody_asks_for_cost_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    forbid(monkeypatch, "add_coverage", "find_identities", "add_tables")
    film = raytracer.render(make_scene(), 8, 6, 2, passes=("Combined", "Object Index"))
    assert not [name for name in film.arrays if "Crypto" in name]


def test_slots_are_as_many_as_the_passes_show() -> None:
    assert select_mattes(["CryptoAsset03", "CryptoAsset00", "Depth", "CryptoMaterial00"]) == {"Asset": 8, "Material": 2}
