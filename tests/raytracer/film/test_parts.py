"""Tiles of a picture: together they are the whole, bit for bit, and nothing is missing, double or foreign."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import raytracer
from raytracer.film.film import Film
from raytracer.film.parts import describe_endings
from tests.raytracer.rendering.rendering_fixtures import make_lit_scene, same

SIZE = (10, 64)
SETTINGS = {"passes": ("Combined", "Normal", "Depth")}


def render(samples: int = 2, scene: raytracer.Scene | None = None, **keywords: object) -> Film:
    return raytracer.render(scene or make_lit_scene(), *SIZE, samples, **{**SETTINGS, **keywords})


@pytest.fixture(scope="module")
def whole() -> Film:
    return render()


@pytest.fixture(scope="module")
def tiles() -> list[Film]:
    return [render(tile=(number, 4)) for number in (1, 2, 3, 4)]


@pytest.mark.parametrize(("height", "count"), [(64, 64), (64, 5), (7, 3), (1, 1)])
def test_tiles_cover_every_row_once(height: int, count: int) -> None:
    borders = raytracer.cut(9, height, count, border=(2, 0, 8, height))
    rows = [row for _, low, _, high in borders for row in range(low, high)]
    assert rows == list(range(height))
    assert {(left, right) for left, _, right, _ in borders} == {(2, 8)}
    sizes = [high - low for _, low, _, high in borders]
    assert max(sizes) - min(sizes) <= 1


@pytest.mark.parametrize("count", [0, 9])
def test_there_are_no_more_tiles_than_rows(count: int) -> None:
    with pytest.raises(ValueError, match="from 1 to 8 tiles"):
        raytracer.cut(100, 8, count)


def test_sixty_four_tiles_in_any_order_are_the_whole_bit_for_bit(whole: Film) -> None:
    parts = [render(tile=(number, 64)) for number in range(1, 65)]
    for seed in range(3):
        order = np.random.default_rng(seed).permutation(64)
        merged = raytracer.merge([parts[number] for number in order])
        assert same(merged, whole)
    assert merged.statistics.rays == whole.statistics.rays


def test_borders_that_a_user_cuts_are_parts_as_well(whole: Film) -> None:
    halves = [render(border=border) for border in ((0, 0, 4, 64), (4, 0, 10, 64))]
    assert same(raytracer.merge(halves), whole)


def test_tiles_of_a_border_are_the_border() -> None:
    border = (3, 10, 9, 40)
    tiles = [render(border=border, tile=(number, 3)) for number in (3, 1, 2)]
    merged, expected = raytracer.merge(tiles), render(border=border)
    assert (merged.left, merged.bottom, merged.width, merged.height) == (3, 10, 6, 30)
    assert set(merged.arrays) == set(expected.arrays)
    for name, array in expected.arrays.items():
        np.testing.assert_array_equal(merged.arrays[name], array)
    np.testing.assert_array_equal(merged.sums.counts.read(slice(None)), expected.sums.counts.read(slice(None)))


def test_a_border_of_which_tiles_were_merged_goes_on_and_is_a_whole() -> None:
    border = (3, 10, 9, 40)
    merged = raytracer.merge([render(border=border, tile=(number, 2)) for number in (1, 2)])
    film, expected = render(5, border=border, film=merged), render(5, border=border)
    assert same(film, expected)
    assert same(raytracer.merge([film]), expected)
    # So does what was begun without tiles, with one.
    assert same(raytracer.merge([render(5, border=border, tile=(1, 1), film=render(2, border=border))]), expected)


def test_a_whole_that_was_merged_goes_on(whole: Film, tiles: list[Film]) -> None:
    film = render(5, film=raytracer.merge(tiles))
    assert same(film, render(5))


def test_what_is_missing_is_named(tiles: list[Film]) -> None:
    with pytest.raises(ValueError, match="missing: 160 pixels, of columns 0 to 9 and rows 16 to 31"):
        raytracer.merge([tiles[0], tiles[2], tiles[3]])
    with pytest.raises(ValueError, match="one or more films"):
        raytracer.merge([])


def test_what_is_there_twice_is_named(tiles: list[Film]) -> None:
    named = [replace_label(tile, f"P{number}.npz") for number, tile in enumerate((*tiles, tiles[2]))]
    with pytest.raises(ValueError, match=r"P4.npz and P2.npz are of the same pixels"):
        raytracer.merge(named)


def replace_label(film: Film, label: str) -> Film:
    copy = replace(film, label=label)
    copy.sums.take(slice(None), film.sums, slice(None))
    return copy


@pytest.mark.parametrize(
    ("foreign", "reason"),
    [
        ({"seed": 7}, "seed is 7, not 0"),
        ({"samples": 3}, "film 1 is not finished: 2 samples of 3"),
        ({"samples": 3, "until": 1}, "film 2 is not finished: 1 samples of 3"),
        ({"max_bounces": 2, "diffuse_bounces": 8, "glossy_bounces": 8, "transmission_bounces": 8}, "max_bounces is 2"),
        ({"scene": replace(make_lit_scene(), world=raytracer.World(0.5))}, "scene differs in its world"),
        ({"border": (0, 0, 10, 32)}, "border is"),
    ],
)
def test_a_part_of_another_picture_is_named(tiles: list[Film], foreign: dict[str, object], reason: str) -> None:
    other = render(**{"tile": (2, 4), **foreign})
    with pytest.raises(ValueError, match=reason):
        raytracer.merge([tiles[0], other, *tiles[2:]])


def test_what_is_no_film_is_named(tiles: list[Film]) -> None:
    with pytest.raises(ValueError, match=r"merge: film 2: expected a Film, .* got 'tile_2.npz'"):
        raytracer.merge([tiles[0], "tile_2.npz"])
    with pytest.raises(ValueError, match=r"render: film: expected a Film, .* got 'film.npz'"):
        render(film="film.npz")


def test_a_film_that_comes_from_no_render_is_no_part(tiles: list[Film]) -> None:
    with pytest.raises(ValueError, match="film 2: expected a film of raytracer"):
        raytracer.merge([tiles[0], Film(2, 2, ("Combined",))])


def test_what_is_no_film_is_refused_and_one_film_may_be_alone(whole: Film, tiles: list[Film]) -> None:
    with pytest.raises(ValueError, match=r"merge: film 2: expected a Film, .*got 'tile_2\.npz'"):
        raytracer.merge([tiles[0], "tile_2.npz"])
    assert same(raytracer.merge(whole), whole)


@pytest.fixture(scope="module")
def ended() -> list[Film]:
    """Tiles that ended at the error that was asked for, the dark ones early, and one that its samples ended."""
    return [render(64, tile=(number, 4), error=0.02, min_samples=2) for number in (1, 2, 3, 4)]


def test_tiles_that_their_error_has_ended_are_finished(ended: list[Film]) -> None:
    """The whole has each tile's pixels, its error is that of all pixels over its own level, and it says what ended."""
    numbers = {film.samples for film in ended}
    assert len(numbers) > 1
    assert {film.ended_by for film in ended} <= {"error", "samples"}
    merged = raytracer.merge(ended[::-1])
    np.testing.assert_array_equal(merged["Combined"], np.concatenate([film["Combined"] for film in ended[::-1]]))
    squares = np.concatenate([film.square_errors() for film in ended])
    assert merged.error == pytest.approx(np.sqrt(squares.mean()) / merged["Combined"][..., :3].mean(), rel=1e-5)
    assert merged.error_interval[0] < merged.error < merged.error_interval[1]
    assert merged.samples == min(numbers)
    assert merged.ended_by == ("samples" if any(film.ended_by == "samples" for film in ended) else "error")
    assert describe_endings(ended) == [
        f"film {number}: {film.samples} samples, ended by {film.ended_by}" for number, film in enumerate(ended, 1)
    ]


@pytest.mark.parametrize("ending", ["", "cancelled"])
def test_the_tile_with_the_most_samples_may_be_unfinished_as_well(ending: str) -> None:
    """Where another one has fewer, which its error has ended; not where its samples have ended it."""
    first, last = render(64, tile=(1, 2), error=0.9, min_samples=2), render(64, tile=(2, 2), until=30)
    assert (first.ended_by, first.samples < 30) == ("error", True)
    assert raytracer.merge([first, last]).ended_by == "samples"
    last.ended_by = ending
    with pytest.raises(ValueError, match="film 2 is not finished: 30 samples of 64"):
        raytracer.merge([first, last])


def test_a_whole_of_different_numbers_of_samples_cannot_go_on(ended: list[Film], tmp_path) -> None:
    merged = raytracer.merge(ended)
    raytracer.save_film(merged, tmp_path / "whole.npz")
    for film in (merged, raytracer.load_film(tmp_path / "whole.npz")):
        with pytest.raises(ValueError, match="cannot go on: its tiles were ended at different numbers of samples"):
            render(200, film=film)


def test_the_error_of_a_whole_of_uneven_tiles_is_at_most_its_tiles_times_the_root_of_their_number(
    ended: list[Film],
) -> None:
    merged = raytracer.merge(ended)
    assert merged.error <= max(film.error for film in ended) * np.sqrt(len(ended))


def test_tiles_with_the_same_samples_have_nothing_to_tell(tiles: list[Film]) -> None:
    assert describe_endings(tiles) == []
    assert raytracer.merge(tiles).ended_by == "samples"
