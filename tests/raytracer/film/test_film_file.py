"""Films as files: what comes back is what went, and whatever is broken is refused in one sentence."""

from __future__ import annotations

import collections
import json
import os
import time
from pathlib import Path

import numpy as np
import pytest

import raytracer
from raytracer.files.unfinished import MACHINE, NEW_SECONDS, PREFIX
from raytracer.film.film import Film
from tests.raytracer.rendering.rendering_fixtures import make_lit_scene, same
from tests.raytracer.scene.scene_mutations import pack, unpack

SIZE = (12, 8)
PASSES = ("Combined", "Normal", "Depth")


def render(samples: int = 3, **keywords: object) -> Film:
    return raytracer.render(make_lit_scene(), *SIZE, samples, **{"passes": PASSES, **keywords})


def test_a_film_comes_back_as_it_was(tmp_path: Path) -> None:
    film = render(border=(2, 1, 9, 7))
    raytracer.save_film(film, tmp_path / "film.npz")
    again = raytracer.load_film(tmp_path / "film.npz")
    assert same(film, again)
    assert (again.left, again.bottom, again.width, again.height) == (2, 1, 7, 6)
    assert again.statistics == film.statistics
    for name in PASSES:
        np.testing.assert_array_equal(again[name], film[name])


def test_what_a_killed_process_left_of_a_film_is_removed_by_the_next_one(tmp_path: Path) -> None:
    left = tmp_path / f"{PREFIX}{MACHINE}{'0' * 8}.npz"
    left.write_bytes(b"half")
    past = time.time() - 2 * NEW_SECONDS
    os.utime(left, (past, past))
    raytracer.save_film(render(), tmp_path / "film.npz")
    assert [path.name for path in tmp_path.iterdir()] == ["film.npz"]


def test_a_scene_that_was_saved_has_the_key_that_it_had(tmp_path: Path) -> None:
    scene = make_lit_scene()
    raytracer.save(scene, tmp_path / "scene.npz")
    again = raytracer.load(tmp_path / "scene.npz")
    one, other = (raytracer.render(item, *SIZE, 1).key for item in (scene, again))
    assert one.digest == other.digest


def test_a_film_that_was_not_rendered_is_not_saved(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="film of raytracer"):
        raytracer.save_film(Film(2, 2, ("Combined",)), tmp_path / "film.npz")
    assert not list(tmp_path.iterdir())


def test_every_flipped_bit_and_every_cut_is_refused_or_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "film.npz"
    film = render()
    raytracer.save_film(film, path)
    whole, rng = path.read_bytes(), np.random.default_rng(0)
    broken = [whole[:length] for length in rng.integers(0, len(whole), 60)]
    for position, bit in zip(rng.integers(0, len(whole), 300), rng.integers(0, 8, 300), strict=True):
        content = bytearray(whole)
        content[position] ^= 1 << bit
        broken.append(bytes(content))
    outcomes: collections.Counter[str] = collections.Counter()
    for content in broken:
        path.write_bytes(content)
        try:
            outcomes["same" if same(raytracer.load_film(path), film) else "changed"] += 1
        except (ValueError, OSError) as error:
            outcomes["refused" if str(path) in str(error) and "\n" not in str(error) else str(error)] += 1
    # What is left are dates and the like among zip's headers.
    assert set(outcomes) <= {"refused", "same"}, outcomes
    assert outcomes["refused"] > 0.9 * len(broken), outcomes


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda outline: outline.update(format="reference-raytracer-scene-1"), "format"),
        (lambda outline: outline["choices"].update(seed=1), "key"),
        (lambda outline: outline["film"].update(width=10**6, height=10**6), "does not hold"),
        (lambda outline: outline["film"].update(width=-1, height=-1), "size"),
        (lambda outline: outline["film"].update(width=8, height=12, samples="3"), "size"),
        (lambda outline: outline["film"].update(names=["Beauty"]), "passes"),
        (lambda outline: outline["film"].update(names=["Combined"]), "arrays"),
        (lambda outline: outline["film"].pop("ahead"), "fields"),
        (lambda outline: outline["arrays"].pop(), "arrays"),
    ],
)
def test_an_outline_that_does_not_fit_is_refused(tmp_path: Path, change: object, reason: str) -> None:
    path = tmp_path / "film.npz"
    raytracer.save_film(render(), path)
    outline, arrays = unpack(path.read_bytes())
    change(outline)
    path.write_bytes(pack(json.dumps(outline), arrays))
    with pytest.raises(ValueError, match=rf"film.npz: expected a film .*{reason}"):
        raytracer.load_film(path)


def test_a_scene_is_no_film_and_a_film_no_scene(tmp_path: Path) -> None:
    raytracer.save(make_lit_scene(), tmp_path / "scene.npz")
    raytracer.save_film(render(), tmp_path / "film.npz")
    with pytest.raises(ValueError, match="expected a film"):
        raytracer.load_film(tmp_path / "scene.npz")
    with pytest.raises(ValueError, match="expected a scene"):
        raytracer.load(tmp_path / "film.npz")
