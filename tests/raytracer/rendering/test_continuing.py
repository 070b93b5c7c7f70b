"""Renders that go on from a film: in any number of steps, and stopped anywhere, the result is that of one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import raytracer
from raytracer.film.film import Film
from tests.raytracer.rendering.rendering_fixtures import make_lit_scene, same

SETTINGS = {"passes": ("Combined", "Normal", "Depth"), "seed": 3}


def render(samples: int, size: tuple[int, int] = (8, 6), **keywords: object) -> Film:
    return raytracer.render(make_lit_scene(), *size, samples, **{**SETTINGS, **keywords})


def test_8_then_32_then_256_samples_are_256() -> None:
    film = None
    for samples in (8, 32, 256):
        film = render(samples, film=film)
        assert film.samples == film.total == samples
    assert same(film, render(256))


def test_the_first_samples_of_many_are_those_of_few() -> None:
    """Of so many pixels neighbors once shared points of lights if there were 256 samples, and not otherwise."""
    few, many = render(2, (160, 110)), render(256, (160, 110), until=2)
    np.testing.assert_array_equal(few["Combined"], many["Combined"])


def test_until_stops_there_and_knows_the_total() -> None:
    film = render(20, until=7)
    assert (film.samples, film.total, film.cancelled) == (7, 20, False)
    np.testing.assert_array_equal(film["Combined"], render(7)["Combined"])
    assert render(20, film=film, until=7) is film
    assert same(render(20, film=film), render(20))


def test_a_render_that_is_done_casts_nothing() -> None:
    film = render(2)
    rays = film.statistics.rays
    assert render(2, film=film).statistics.rays == rays


def test_stopped_twenty_times_in_the_middle_of_sweeps_it_is_the_whole(tmp_path: Path) -> None:
    expected, path, rng = render(12), tmp_path / "film.npz", np.random.default_rng(1)
    film, stops = None, 0
    while film is None or film.samples < 12:
        done: list[float] = []
        after = int(rng.integers(1, 4)) if stops < 20 else 10**6
        film = render(
            12,
            film=film,
            block_size=11,
            on_progress=done.append,
            is_cancelled=lambda done=done, after=after: len(done) >= after,
        )
        stops += film.cancelled
        raytracer.save_film(film, path)
        film = raytracer.load_film(path)
    assert stops == 20
    assert same(film, expected)
    assert film.statistics.rays == expected.statistics.rays


def test_films_go_on_with_any_workers_and_block_size() -> None:
    film = render(3, block_size=17)
    assert same(render(9, film=film, block_size=1000, workers=2), render(9))


def test_interleaving_is_kept_in_the_film() -> None:
    film = render(2, interleaving=3)
    assert film.interleaving == 3
    assert same(render(4, film=film), render(4, interleaving=3))
    assert (render(4)["Combined"] != film["Combined"]).any()


def test_centre_passes_alone_need_one_sweep() -> None:
    film = render(4, passes=("Depth",))
    assert render(9, passes=("Depth",), film=film).samples == 1


@pytest.mark.parametrize(
    ("other", "reason"),
    [
        ({"seed": 4}, "seed is 3, not 4"),
        ({"transparent": True, "seed": 4}, "seed is 3, not 4, transparent is False, not True"),
        ({"passes": ("Combined",)}, "passes is"),
        ({"size": (8, 7)}, "height is 6, not 7"),
        ({"border": (0, 0, 8, 3)}, "height is 6, not 3"),
        ({"samples": 3}, "it has 4 samples already, and the picture shall have 3"),
        ({"interleaving": 2}, "interleaving is 0, not 2"),
    ],
)
def test_a_film_of_another_picture_is_refused_by_name(other: dict[str, object], reason: str) -> None:
    film = render(4)
    before = film["Combined"]
    with pytest.raises(ValueError, match=reason):
        render(**{"samples": 6, **other}, film=film)
    np.testing.assert_array_equal(film["Combined"], before)


def test_a_film_of_another_scene_is_refused_by_name() -> None:
    scene = make_lit_scene()
    film = raytracer.render(scene, 8, 6, 2)
    moved = replace(scene, lights=[replace(scene.lights[0], power=(1.0, 2.0, 3.0))])
    with pytest.raises(ValueError, match="the scene differs in its lights"):
        raytracer.render(moved, 8, 6, 4, film=film)
    with pytest.raises(ValueError, match=r"film of raytracer\.render"):
        raytracer.render(scene, 8, 6, 4, film=Film(8, 6, ("Combined",)))


def test_a_scene_that_nobody_asks_the_key_of_is_not_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("raytracer.rendering.render.digest_scene", lambda scene: pytest.fail("it was"))
    assert render(1).samples == 1


@pytest.mark.parametrize("tile", [(0, 2), (3, 2), (1,), 4, (1, 2, 3), ("a", 2)])
def test_a_tile_is_one_of_so_many(tile: object) -> None:
    with pytest.raises(ValueError, match="Settings: tile"):
        raytracer.Settings(tile=tile)
