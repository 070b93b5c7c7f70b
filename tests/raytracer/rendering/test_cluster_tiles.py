"""Tiles of a cluster without one: what goes to its workers and comes back, on a client that pickles all of it."""

from __future__ import annotations

import operator
import pickle
from collections.abc import Callable
from concurrent.futures import CancelledError
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import raytracer
from raytracer.rendering.clusters import render_tile
from tests.raytracer.rendering.rendering_fixtures import make_lit_scene, same


class Client:
    """Does at once, in this process, what it is asked for; `before` is called first."""

    def __init__(self, before: Callable[[], object] = lambda: None) -> None:
        self._before = before

    def nthreads(self) -> dict[str, int]:
        return {"here": 1}

    def scatter(self, content: Any, **options: Any) -> Any:
        return pickle.loads(pickle.dumps(content))

    def submit(self, function: Callable[..., Any], *arguments: Any, pure: bool) -> Future:
        self._before()
        return Future(pickle.dumps(function(*arguments)))

    def cancel(self, futures: list[Future]) -> None:
        pass


class Future:
    """A result that is there when it is asked for the third time."""

    def __init__(self, content: bytes) -> None:
        self._content, self._looks = content, 0

    def done(self) -> bool:
        self._looks += 1
        return self._looks > 2

    def result(self) -> Any:
        return pickle.loads(self._content)

    def release(self) -> None:
        pass


def make_negation() -> Callable[[int], int]:
    return operator.neg


def test_results_are_waited_for_through_the_client_that_was_given() -> None:
    """They were through the default one, of another cluster or none."""
    pool = raytracer.DaskPool(Client())
    pool.load(make_negation)
    assert list(pool.run(range(9))) == [-number for number in range(9)]
    assert list(pool.run(range(9), is_cancelled=lambda: True)) == []


def test_a_scheduler_that_is_lost_is_told_in_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    """It was no WorkerError: films kept nothing of what had been traced since they were written last."""

    def lose(future: Future) -> Any:
        raise CancelledError("the scheduler is lost")

    monkeypatch.setattr(Future, "result", lose)
    pool = raytracer.DaskPool(Client())
    pool.load(make_negation)
    with pytest.raises(raytracer.WorkerError, match="CancelledError: the scheduler is lost"):
        list(pool.run(range(9)))


def test_a_tile_comes_back_without_the_scene() -> None:
    """The film's key brought all of it along, with every tile."""
    points = np.random.default_rng(0).normal(size=(50_000, 3))
    mesh = raytracer.Mesh(points, np.arange(49_998).reshape(-1, 3))
    scene = raytracer.Scene(meshes=[mesh], camera=raytracer.Camera(np.eye(4)))
    film = render_tile(scene, 8, 6, 1, (1, 1), {})
    expected = raytracer.render(scene, 8, 6, 1)
    for sent in (film, expected):
        content = pickle.dumps(sent)
        assert len(content) < 20_000
        assert pickle.loads(content).key.digest == expected.key.digest


@pytest.mark.parametrize("as_file", [True, False])
def test_the_tiles_are_the_film(tmp_path: Path, as_file: bool) -> None:
    scene: Any = make_lit_scene()
    if as_file:
        raytracer.save(scene, tmp_path / "scene.npz")
        scene = tmp_path / "scene.npz"
    film = raytracer.render_on(Client(), scene, 8, 6, 2, tiles=3, seed=2)
    expected = raytracer.render(make_lit_scene(), 8, 6, 2, seed=2)
    assert same(film, expected)
    assert film.key.digest == expected.key.digest


def test_a_tile_of_another_scene_is_refused(tmp_path: Path) -> None:
    """A worker whose copy of the file is an older one, or is replaced meanwhile, gave a picture of both."""
    path = tmp_path / "scene.npz"
    raytracer.save(make_lit_scene(), path)
    other = raytracer.Scene(camera=make_lit_scene().camera, world=raytracer.World(1.0))
    client = Client(before=lambda: raytracer.save(other, path))
    with pytest.raises(raytracer.WorkerError, match=r"another picture: the scene differs in its .*world"):
        raytracer.render_on(client, path, 8, 6, 1, tiles=2)


def test_a_tile_alone_is_refused() -> None:
    """All of the picture was rendered without a word."""
    with pytest.raises(ValueError, match=r"render_on: tile: all of them are rendered, got \(1, 2\)"):
        raytracer.render_on(Client(), make_lit_scene(), 8, 6, 1, tile=(1, 2))


def test_a_setting_of_another_version_is_named(tmp_path: Path) -> None:
    path = tmp_path / "scene.npz"
    raytracer.save(make_lit_scene(), path, {"width": 8, "height": 6, "sparkle": 2})
    with pytest.raises(ValueError, match=r"scene\.npz: a setting 'sparkle', which this version does not know"):
        raytracer.render_on(Client(), path, 8, 6, 1)
