"""What reaches Blender's result: strips of the film, each pixel in its place, and always a result."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from addon.engine import output
from addon.engine.output import Border, RenderOutput
from raytracer.film.film import Film
from tests.addon.engine.engine_fixtures import WIDTH, add_plane, make_stage, render_pass

SIZE = 5, 7
SIZES = {"Combined": 4, "Normal": 3, "Error": 1}


class Blender:
    """Stands for the engine that Blender gives: its results, put together in the order of their ends."""

    def __init__(self) -> None:
        self.picture = {name: np.full((SIZE[1], SIZE[0], size), np.nan) for name, size in SIZES.items()}
        self.rows: list[tuple[int, int]] = []

    def begin_result(self, x: int, y: int, width: int, height: int, layer: str) -> Any:
        assert (x, width, layer) == (0, SIZE[0], "Layer")
        passes = [SimpleNamespace(name=name, rect=Rect()) for name in self.picture]
        return SimpleNamespace(rows=(y, y + height), layers=[SimpleNamespace(passes=passes)])

    def end_result(self, result: Any) -> None:
        """Put all passes, also those that nobody has filled, where Blender does."""
        self.rows.append(result.rows)
        for one in result.layers[0].passes:
            target = self.picture[one.name][slice(*result.rows)]
            target[...] = 0.0 if one.rect.values is None else one.rect.values.reshape(target.shape)

    def update_result(self, result: Any) -> None:
        assert result is not None


class Rect:
    """Stands for the pixels of a pass."""

    values: Any = None

    def foreach_set(self, values: Any) -> None:
        assert values.ndim == 1
        self.values = values.copy()


@pytest.fixture
def film(rng: np.random.Generator) -> Film:
    made = Film(*SIZE, tuple(SIZES))
    for number in range(3):
        made.add(slice(None), {"Combined": rng.random((35, 4)), "Normal": rng.random((35, 3))}, number % 2)
    return made


@pytest.fixture
def small_strips(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(output, "STRIP", 2 * SIZE[0] + 1)


def open_output(engine: Blender) -> RenderOutput:
    return RenderOutput(engine, "Layer", Border(3, 2, 3 + SIZE[0], 2 + SIZE[1]))


@pytest.mark.parametrize("uses_up", [False, True])
@pytest.mark.usefixtures("small_strips")
def test_a_film_comes_in_strips_and_is_cut_off_where_nobody_needs_it(film: Film, uses_up: bool) -> None:
    """Blender's rows begin at the bottom."""
    engine, expected = Blender(), {name: film[name][::-1] for name in SIZES}
    with open_output(engine) as result:
        result.write({"Combined": np.ones((SIZE[1], SIZE[0], 4), np.float32)})  # what has been shown
        result.show()
        result.write_film(film, uses_up=uses_up)
    assert engine.rows == [(0, 7), (6, 7), (4, 6), (2, 4), (0, 2)]
    for name, pixels in expected.items():
        np.testing.assert_array_equal(engine.picture[name], pixels)
    assert film.height == (0 if uses_up else SIZE[1])


@pytest.mark.usefixtures("small_strips")
def test_a_pass_that_has_been_changed_takes_the_place_of_the_films_own(film: Film, rng: np.random.Generator) -> None:
    engine, changed = Blender(), rng.random((SIZE[1], SIZE[0], 4)).astype(np.float32)
    with open_output(engine) as result:
        result.write_film(film)
        result.write_film(film, Combined=changed)
    np.testing.assert_array_equal(engine.picture["Combined"], changed[::-1])
    np.testing.assert_array_equal(engine.picture["Normal"], film["Normal"][::-1])


def test_what_was_shown_stays_where_no_film_came() -> None:
    engine, shown = Blender(), np.full((SIZE[1], SIZE[0], 4), 0.5, np.float32)

    def fail() -> None:
        with open_output(engine) as result:
            result.write({"Combined": shown})
            raise MemoryError

    with pytest.raises(MemoryError):
        fail()
    assert engine.rows == [(0, SIZE[1])]
    np.testing.assert_array_equal(engine.picture["Combined"], shown)


def test_there_is_a_result_where_nothing_was_written() -> None:
    engine = Blender()
    with open_output(engine):
        pass
    assert engine.rows == [(0, SIZE[1])]
    assert not engine.picture["Combined"].any()


@pytest.mark.usefixtures("registered_addon")
@pytest.mark.parametrize("border", [None, (0.2, 0.8, 0.1, 0.95)])
def test_pictures_do_not_depend_on_strips(
    empty_scene: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, border: Any
) -> None:
    stage = empty_scene
    make_stage(stage)
    add_plane(stage.collection, "Plane", (0.75, 0.125, 0.0), (-9.3, 4.2), (-5.1, 7.4))
    if border:
        stage.render.use_border = True
        names = ("border_min_x", "border_max_x", "border_min_y", "border_max_y")
        for name, value in zip(names, border, strict=True):
            setattr(stage.render, name, value)
    whole = render_pass(stage, tmp_path / "whole.exr")
    monkeypatch.setattr(output, "STRIP", 3 * WIDTH)
    np.testing.assert_array_equal(render_pass(stage, tmp_path / "strips.exr"), whole)
    assert whole.any()
