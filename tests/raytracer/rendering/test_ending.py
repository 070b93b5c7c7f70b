"""When a render ends: at its samples, an error or a time, and with which bits."""

import itertools
import time

import numpy as np
import pytest

from raytracer.casting.caster import Caster
from raytracer.film.film import Film
from raytracer.integrator.settings import Settings
from raytracer.processes.workers import Workers
from raytracer.rendering import block_plan, ending
from raytracer.rendering.adaptive import add_listed
from raytracer.rendering.block_plan import FIRST_SWEEPS, BlockPlan
from raytracer.rendering.blocks import RAY, Block, BlockResult, ListedBlock
from raytracer.rendering.ending import Ending
from raytracer.rendering.render import add_result, render
from tests.raytracer.rendering.error_scenes import SCENES

SCENE = SCENES["penumbra"][0]()


def test_a_picture_ends_at_the_error_that_was_asked_for():
    """The same picture as with that number of samples, and the first where the error was told and small enough."""
    film = render(SCENE, 24, 16, 4096, error=0.04)
    assert (film.ended_by, film.cancelled) == ("error", False)
    assert film.error <= 0.04
    assert 16 < film.samples < 100
    assert film.samples % 2 == 0
    assert np.array_equal(film["Combined"], render(SCENE, 24, 16, film.samples)["Combined"])
    assert render(SCENE, 24, 16, film.samples - 2).error > 0.04


def test_a_picture_that_ends_at_an_error_is_the_same_for_any_workers_and_blocks():
    expected = render(SCENE, 24, 16, 4096, error=0.06)
    with Workers(2) as workers:
        for keywords in ({"block_size": 300}, {"block_size": 1200}, {"workers": workers}):
            film = render(SCENE, 24, 16, 4096, error=0.06, **keywords)
            assert film.samples == expected.samples
            assert np.array_equal(film["Combined"], expected["Combined"]), keywords


def test_a_film_that_goes_on_ends_where_one_in_one_go_does():
    options = {"error": 0.03}
    film = render(SCENE, 24, 16, 4096, until=19, **options)
    assert film.ended_by == "samples"
    film, whole = render(SCENE, 24, 16, 4096, film=film, **options), render(SCENE, 24, 16, 4096, **options)
    assert (film.samples, film.ended_by) == (whole.samples, "error")
    assert np.array_equal(film["Combined"], whole["Combined"])


@pytest.mark.parametrize("error", [0.04, 0.05])
def test_a_film_that_its_error_has_ended_stays_as_it_is(error):
    """Where no more than that is asked for again, as where a job is started twice: nothing is cast."""
    film = render(SCENE, 24, 16, 4096, error=0.04)
    samples, rays = film.samples, film.statistics.rays
    film = render(SCENE, 24, 16, 4096, error=error, film=film)
    assert (film.samples, film.statistics.rays, film.ended_by) == (samples, rays, "error")


def test_a_film_of_as_many_samples_as_the_error_takes_is_that_of_one_go():
    whole = render(SCENE, 24, 16, 4096, error=0.04)
    film = render(SCENE, 24, 16, 4096, film=render(SCENE, 24, 16, 4096, until=whole.samples), error=0.04)
    assert (film.samples, film.ended_by) == (whole.samples, "error")


def test_what_has_ended_a_film_is_forgotten_where_it_goes_on():
    """Or one that is killed then would be taken for a finished one."""
    film, seen = render(SCENE, 12, 8, 64, error=0.5), []
    assert (film.samples, film.ended_by) == (16, "error")
    render(SCENE, 12, 8, 64, film=film, on_progress=lambda share: seen.append((film.ended_by, film.cancelled)))
    assert set(seen) == {("", False)}


def test_a_picture_that_ends_at_an_error_may_have_passes_of_pixels_centres():
    film = render(SCENE, 12, 8, 64, error=0.5, passes=("Combined", "Depth", "Position"))
    assert film.ended_by == "error"
    assert np.array_equal(film["Depth"], render(SCENE, 12, 8, 1, passes=("Depth",))["Depth"])


def test_all_samples_are_taken_where_the_error_stays_above():
    film = render(SCENE, 24, 16, 20, error=1e-6)
    assert (film.samples, film.ended_by) == (20, "samples")


def test_least_samples_are_taken_whatever_the_error():
    film = render(SCENE, 16, 12, 4096, error=0.9, min_samples=41)
    assert (film.samples, film.ended_by) == (42, "error")


def test_a_time_limit_leaves_one_whole_sweep():
    film = render(SCENE, 24, 16, 10**6, seconds=1e-9)
    assert (film.samples, film.ended_by, film.cancelled) == (1, "time", False)


def test_a_time_limit_ends_before_the_sweep_that_would_not_fit_in(monkeypatch):
    """A clock of one second a sweep."""
    clock = itertools.count(1)
    monkeypatch.setattr(ending.time, "perf_counter", lambda: float(next(clock)))
    limited = Ending(Settings(seconds=3.1), 100, started=0.0)
    film, found = Film(1, 1, ("Combined",)), None
    while found is None:
        film.samples += 1
        found = limited.find(film)
    assert (film.samples, found) == (3, "time")


def test_time_is_told_by_the_sweeps_of_this_render(monkeypatch):
    """A clock of one second a sweep; what the film had before took none of it."""
    clock = itertools.count(1)
    monkeypatch.setattr(ending.time, "perf_counter", lambda: float(next(clock)))
    film, found = Film(1, 1, ("Combined",), samples=100), None
    limited = Ending(Settings(seconds=3.1), 1000, started=0.0, done=film.samples)
    while found is None:
        film.samples += 1
        found = limited.find(film)
    assert (film.samples, found) == (103, "time")


def test_what_was_prepared_takes_no_time_of_the_sweeps(monkeypatch):
    """Trees and tables of 31 s were taken for the cost of a sweep, on a clock of one second a sweep: only one came."""
    now = [31.0]
    monkeypatch.setattr(ending.time, "perf_counter", lambda: now[0])
    limited = Ending(Settings(seconds=29.5), 100, started=0.0)
    film, found = Film(1, 1, ("Combined",)), None
    while found is None:
        now[0] += 1.0
        limited.begin(1.0)
        film.samples += 1
        found = limited.find(film)
    assert (film.samples, found) == (29, "time")


@pytest.mark.parametrize("workers", [1, 2])
def test_a_time_limit_is_one_of_tracing(monkeypatch, workers):
    """A tree that took as long as there was time left one sample."""
    cast, seconds = Caster.closest_hit, 2.0

    def build_slowly(caster: Caster, *arguments, **keywords):
        if arguments[0] is RAY[0]:
            time.sleep(seconds)
        return cast(caster, *arguments, **keywords)

    monkeypatch.setattr(Caster, "closest_hit", build_slowly)
    film = render(SCENE, 12, 8, 10**6, seconds=seconds, workers=workers)
    assert film.ended_by == "time"
    assert film.samples > 4
    assert film.statistics.build_seconds >= seconds


def test_sweeps_that_were_traced_together_are_kept_when_the_time_is_over():
    for listed in (False, True):
        film = Film(2, 1, ("Combined",))
        block = Block(0, 0, 2, samples=4)
        if listed:
            numbers = np.repeat(np.arange(4, dtype=np.uint32), 2)
            block = ListedBlock(0, np.tile(np.arange(2), 4), numbers, ends=(2, 4, 6, 8))
        result = BlockResult(block, {"Combined": np.ones((8, 4))}, None, 0, 1.0)
        limited = Ending(Settings(seconds=1e-9), 100, started=0.0)
        add = add_listed(film, result, limited) if listed else add_result(film, result, limited, ends_sweep=True)
        assert (film.samples, add) == (4, "time")


def test_an_error_may_be_as_small_as_a_float():
    assert render(SCENE, 6, 4, 18, error=1e-300).ended_by == "samples"


def test_an_even_number_of_samples_is_looked_at_every_five_per_cent(monkeypatch):
    looks, looked = Ending(Settings(error=0.5, samples=1000), 1000, started=0.0), []
    monkeypatch.setattr(Film, "error", property(lambda film: looked.append(film.samples) or 1.0))
    film = Film(1, 1, ("Combined",))
    for film.samples in range(1, 201):
        assert looks.find(film) is None
    assert looked[:4] == [16, 18, 20, 22]
    assert all(samples % 2 == 0 for samples in looked)
    assert all(b - a <= max(2.0, 0.05 * a + 2) for a, b in itertools.pairwise(looked))
    assert looked[-1] > 185
    assert len(looked) < 50


def test_share_of_the_work_never_falls_and_counts_what_the_error_needs():
    looks, film = Ending(Settings(error=0.01, samples=10**6), 10**6, started=0.0), Film(1, 1, ("Combined",))
    for number, value in enumerate((0.9, 1.1) * 8):
        film.add(slice(0, 1), {"Combined": np.full((1, 4), value)}, number % 2)
    film.samples = 16
    assert looks.find(film) is None
    # The error is 0.1, and (0.1 / 0.01)^(1 / 0.6) = 46.4.
    assert looks.estimate_share(16) == pytest.approx(1 / 46.4, rel=0.01)
    assert looks.estimate_share(1) == looks.estimate_share(16)


def test_share_of_the_work_is_that_of_the_time_where_it_is_short(monkeypatch):
    monkeypatch.setattr(ending.time, "perf_counter", lambda: 6.0)
    assert Ending(Settings(seconds=8.0), 1000, started=0.0).estimate_share(3) == 0.75


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("error", value) for value in (0.0, -1.0, np.nan, np.inf, "1%")),
        *(("seconds", value) for value in (0, -1, np.nan, np.inf, "soon")),
    ],
)
def test_limits_are_numbers_above_0(name, value):
    with pytest.raises(ValueError, match=f"Settings: {name}: expected a finite number above 0.*got {value!r}"):
        render(SCENE, 4, 4, **{name: value})


def test_an_error_needs_the_picture_that_has_it():
    with pytest.raises(ValueError, match="Settings: error: expected Combined"):
        render(SCENE, 4, 4, error=0.1, passes=("Normal",))


def test_blocks_grow_slowly_where_any_sweep_may_be_the_last():
    sizes = [block.samples for block in BlockPlan(pixels=1000, sweeps=300, largest=10**6, growth=0.25)]
    assert sizes[:3] == [FIRST_SWEEPS, 4, 5]
    assert sum(sizes) == 300
    before = np.cumsum(sizes)[:-1]
    assert (sizes[1:] <= before / 4).all()


@pytest.mark.parametrize("done", [0, 500])
@pytest.mark.parametrize(("seconds", "expected"), [(1000.0, [1, 1, 2, 4, 8, 4, 5]), (7.5, [1, 1, 2, 3, 1, 1, 1])])
def test_blocks_are_no_longer_than_there_is_time(monkeypatch, done, seconds, expected):
    """On a clock of a second a sweep: first one, which tells the pace, then no more than before, or than fit in."""
    now, sizes = [3.0], []
    monkeypatch.setattr(block_plan.time, "perf_counter", lambda: now[0])
    for block in BlockPlan(pixels=1000, sweeps=800, largest=10**6, growth=0.25, done=done, seconds=seconds):
        sizes.append(block.samples)
        now[0] += block.samples
    assert sizes[:7] == expected
    assert sum(sizes) == 800 - done
