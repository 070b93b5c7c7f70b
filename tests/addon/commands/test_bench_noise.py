"""Equal error: noise is measured right, also without the noisiest pixels, and times are read off, not extrapolated."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.benchmarks import equal_error, kept_rows, noise, pictures, tables

# A sample variance of n values is known to sqrt(2 / n), its root to half of that; so many of these are allowed.
SIGMAS = 5.0


def bound_error(values: int) -> float:
    return float(SIGMAS / np.sqrt(2 * values))


def draw_pictures(deviation: Any, count: int = 8, seed: int = 0) -> Any:
    """Pictures (k, 100, 100, 3) of level 2 whose noise has a deviation (100, 100, 1) or the same everywhere."""
    return 2.0 + deviation * np.random.default_rng(seed).normal(size=(count, 100, 100, 3))


def test_noise_is_told_from_independent_pictures() -> None:
    assert noise.measure_noise(draw_pictures(0.1, 2)) == pytest.approx(0.05, rel=bound_error(30_000))


@pytest.mark.parametrize("name", noise.SHARES)
def test_even_noise_is_the_same_without_any_pixels(name: str) -> None:
    """Chosen and measured by the same renders, the noise without 5% of the pixels came out 6% too small."""
    error = noise.measure_errors(draw_pictures(0.1))[name]
    assert error == pytest.approx(0.05, rel=bound_error(7 * 30_000 / 2))


def test_fireflies_are_left_out_where_they_sit() -> None:
    """1% of the pixels with 100 times the deviation: all noise is theirs, and the rest is as if they were not there."""
    deviation = np.full((100, 100, 1), 0.01)
    deviation[7, :] = 1.0
    errors = noise.measure_errors(draw_pictures(deviation))
    assert errors["all"] == pytest.approx(np.sqrt(0.01 + 0.99e-4) / 2, rel=bound_error(7 * 300))
    for name in ("without 1%", "without 5%"):
        assert errors[name] == pytest.approx(0.005, rel=bound_error(7 * 28_500 / 2))


def test_seconds_are_read_off_between_renders_and_nowhere_else() -> None:
    """Of error = seconds^-0.7 every error in the range is met at its second, for it is a straight line."""
    seconds = [1.0, 4.0, 16.0, 64.0]
    errors = [each**-0.7 for each in seconds]
    for time in (1.0, 2.3, 16.0, 50.0, 64.0):
        assert noise.read_seconds(errors, seconds, time**-0.7) == pytest.approx(time, rel=1e-12)
    assert noise.read_seconds(errors, seconds, 1.001) is None
    assert noise.read_seconds(errors, seconds, 65.0**-0.7) is None
    # Noise of the noise: the first time that an error is reached counts.
    assert noise.read_seconds([0.4, 0.1, 0.2, 0.05], seconds, 0.1) == 4.0


def test_times_are_compared_at_the_smallest_error_of_both() -> None:
    ours = ([0.4, 0.2, 0.1], [1.0, 4.0, 16.0])
    twice_as_fast = ([0.2, 0.1, 0.05], [2.0, 8.0, 32.0])
    assert noise.compare_seconds(ours, twice_as_fast) == pytest.approx((0.1, 0.5))
    assert noise.compare_seconds(twice_as_fast, ours) == pytest.approx((0.1, 2.0))
    apart = ([0.09, 0.03], [1.0, 9.0])
    assert noise.compare_seconds(ours, apart) is None
    assert noise.compare_seconds(apart, ours) is None
    silent = ([0.0, 0.0], [1.0, 2.0])
    assert noise.compare_seconds(silent, silent) is None
    assert noise.compare_seconds(([0.4, 0.0], [1.0, 2.0]), ours) == pytest.approx((0.1, 8.0))


def test_jackknife_of_a_mean_is_its_standard_error() -> None:
    values = np.random.default_rng(1).normal(size=9)
    without = [np.delete(values, k).mean() for k in range(9)]
    assert noise.jackknife(without) == pytest.approx(values.std(ddof=1) / 3, rel=1e-12)


def make_renders(scale: float, seconds: float) -> list[equal_error.Renders]:
    """Renders of an error of scale N^-0.5 that take `seconds` N and a start of half a second."""
    return [
        equal_error.Renders(
            samples, 0.5 + seconds * samples, draw_pictures(2 * scale * samples**-0.5, seed=round(samples / scale))
        )
        for samples in (4, 16, 64)
    ]


def test_a_scene_is_described_by_curves_and_ratios() -> None:
    """Half of the noise for the same samples, at the same cost of each: a quarter of the samples. Nothing adaptive."""
    renders = {
        "raytracer": make_renders(0.2, 0.1),
        "raytracer adaptive": make_renders(0.1, 0.1),
        "Cycles": make_renders(0.1, 0.1),
        "Cycles adaptive": make_renders(0.001, 0.1),
    }
    row = equal_error.describe_renders(renders)
    curve = row["curves"]["raytracer"]
    assert curve["samples"] == [4, 16, 64]
    for name in noise.SHARES:
        np.testing.assert_allclose(curve["errors"][name], [0.1, 0.05, 0.025], rtol=bound_error(7 * 28_500 / 2))
        assert curve["slopes"][name] == pytest.approx(0.5, abs=0.01)
        compared = row["ratios"]["Cycles"][name]
        assert compared["error"] == pytest.approx(0.025, rel=0.02)
        assert compared["ratio"] == pytest.approx((0.5 + 1.6) / (0.5 + 6.4), rel=0.04)
        assert 0 < compared["spread"] < 0.05
        assert row["ratios"]["Cycles adaptive"][name] is None, "no error that both have reached"
        assert row["ratios"]["both adaptive"][name] is None
        # The same renders as Cycles': our uniform time over our adaptive one is the inverse of Cycles' over ours.
        own = row["ratios"]["ours uniform over adaptive"][name]
        assert own["ratio"] == pytest.approx(1 / compared["ratio"])
    assert (curve["start"], curve["microseconds"]) == pytest.approx((0.5, 1e6 * 0.1 / 10_000))
    assert curve["noise_in_1%"] == pytest.approx(0.01, abs=0.02)
    assert json.loads(json.dumps(row)) == row


def test_scenes_and_samples_are_those_asked_for() -> None:
    assert equal_error.list_samples(256) == [4, 16, 64, 256]
    assert equal_error.list_samples(100) == [4, 16, 64]
    assert equal_error.list_scenes(equal_error.Effort(scenes=("glass",)), large=True) == ["glass"]
    everything = equal_error.list_scenes(equal_error.Effort(), large=True)
    assert sorted(everything) == sorted(path.stem for path in pictures.SCENES.glob("*.blend"))


@pytest.mark.parametrize(
    ("settings", "message"),
    [({"most": 4}, "samples"), ({"renders": 4}, "renders"), ({"scenes": ("nowhere",)}, "nowhere")],
)
def test_too_little_to_compare_is_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        equal_error.Effort(**settings)


@pytest.mark.blender
def test_a_small_scene_is_measured_kept_and_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    effort = equal_error.Effort((24, 16), 16, 5, ("penumbra",), tmp_path / "rows")
    rows = equal_error.measure_equal_error(effort, False, lambda iterable, label: iterable)
    assert [(row["scene"], row["light"]) for row in rows] == [("penumbra", "direct"), ("penumbra", "path")]
    for row in rows:
        assert tuple(row["curves"]) == equal_error.CONTENDERS
        assert all(curve["errors"]["all"][0] > curve["errors"]["all"][1] > 0 for curve in row["curves"].values())
        assert all(min(curve["seconds"]) > 0 for curve in row["curves"].values())
    # Diffuse reflection is followed in the second row: another picture, of another noise.
    first, second = (row["curves"]["Cycles"]["errors"]["all"][-1] for row in rows)
    assert abs(second / first - 1) > 0.1
    text = "\n".join(tables.write_equal_error({"equal_error": rows}))
    assert text.count("penumbra") == 2 * 3 + 2 * 4
    # What is in the file is not measured again; what is missing is, whoever measured the rest.
    effort.keep.write_text(effort.keep.read_text(encoding="utf-8").splitlines(True)[1], encoding="utf-8")
    asked = []
    monkeypatch.setattr(equal_error, "measure_row", lambda name, light, effort: asked.append(light) or rows[0])
    assert equal_error.measure_equal_error(effort, False, lambda iterable, label: iterable) == rows
    assert asked == ["direct"]
    assert len(effort.keep.read_text(encoding="utf-8").splitlines()) == 2


def test_only_rows_of_the_same_settings_are_taken_from_a_file(tmp_path: Path) -> None:
    file = tmp_path / "rows"
    assert kept_rows.read_rows(file, [1]) == kept_rows.read_rows(None, [1]) == []
    kept_rows.keep_row(None, [1], {"a": 1})
    for settings, row in (((8, (72, 48)), {"a": 1}), ((5, (72, 48)), {"a": 2}), ((8, (72, 48)), {"a": 3})):
        kept_rows.keep_row(file, settings, row)
    assert kept_rows.read_rows(file, (8, (72, 48))) == [{"a": 1}, {"a": 3}]
    for text in ("{", "[]", '{"row": 1}'):
        file.write_text(text, encoding="utf-8")
        with pytest.raises(ValueError, match="expected a row"):
            kept_rows.read_rows(file, [1])
