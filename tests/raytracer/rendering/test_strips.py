"""Sums that are added up where samples are traced: the same bits, whoever adds, and however far others are."""

import pickle
from collections import deque

import numpy as np
import pytest

import raytracer
from raytracer.film.film import Film
from raytracer.processes.workers import JOBS_AHEAD
from raytracer.rendering.block_plan import MANY_WORKERS, BlockPlan
from raytracer.rendering.blocks import Block
from tests.raytracer.rendering.rendering_fixtures import make_lit_scene, same

PASSES = ("Combined", "Normal", "Depth", "Diffuse Direct", "CryptoObject00")
WORKERS = MANY_WORKERS


class ManyWorkers:
    """A pool of so many workers in one process: reads jobs as far ahead as processes do, and everything that goes to
    one and back is pickled.

    last : the number of jobs after which it dies, None never
    """

    def __init__(self, last: int | None = None) -> None:
        self.last = last
        self.jobs: list[Block] = []
        self.sent = 0

    def __len__(self) -> int:
        return WORKERS

    def load(self, factory, *arguments) -> None:
        self.function = factory(*arguments)

    def run(self, jobs, is_cancelled):
        pending: deque[bytes] = deque()
        for job in jobs:
            pending.append(pickle.dumps(job))
            self.jobs.append(job)
            if len(pending) > JOBS_AHEAD * WORKERS:
                yield self._answer(pending.popleft())
        while pending:
            yield self._answer(pending.popleft())

    def _answer(self, job: bytes):
        if self.last is not None:
            self.last -= 1
            if self.last < 0:
                raise raytracer.WorkerError("a worker process ended unexpectedly")
        answer = pickle.dumps(self.function(pickle.loads(job)))
        self.sent += len(answer)
        return pickle.loads(answer)


def render(samples=48, film=None, **settings):
    return raytracer.render(make_lit_scene(), 16, 12, samples, film=film, passes=PASSES, **settings)


def test_sums_of_strips_are_those_of_samples():
    pool = ManyWorkers()
    film = render(workers=pool, block_size=24)
    assert same(film, render())
    assert sum(job.strip is not None for job in pool.jobs) > len(pool.jobs) // 2


def test_strips_send_less_than_samples():
    """Of 48 samples 8 are sent, and 4 strips (of 8, 16 and 16), each as long as 2.25."""
    strips, singly = ManyWorkers(), ManyWorkers()
    # With a limit of time each sweep is looked at by itself.
    for pool, seconds in ((strips, None), (singly, 1e9)):
        raytracer.render(make_lit_scene(), 96, 64, 48, workers=pool, block_size=1024, seconds=seconds)
    assert strips.sent < 0.5 * singly.sent


@pytest.mark.parametrize("last", [3, 95, 200, 233, 301])
def test_a_film_that_ended_among_strips_goes_on(last):
    film = render(until=1)
    with pytest.raises(raytracer.WorkerError):
        render(film=film, workers=ManyWorkers(last), block_size=24)
    assert same(render(film=film, workers=2), render())


def test_a_film_ahead_by_several_samples_is_finished_as_it_was_begun():
    """What has been killed in the middle of a round of 8 samples: the other pixels get theirs first."""
    film, whole = render(until=8), render()
    film.put_strip(slice(0, 100), render(until=16).cut_strip(slice(0, 100)))
    film.ahead = 100
    assert film.ahead_samples == 8
    with pytest.raises(ValueError, match="16 samples already"):
        render(12, film=film)
    assert same(render(film=film), whole)


def test_plan_gathers_no_more_than_is_done_and_covers_all():
    plan = BlockPlan(10_000, 61, 2000, workers=WORKERS, gathered=16)
    count = np.zeros(10_000, dtype=int)
    rounds = []
    for block in plan:
        assert (count[block.start : block.stop] == block.sample).all()
        count[block.start : block.stop] += block.samples
        rounds += [block.samples] * (block.start == 0)
    assert (count == 61).all()
    assert rounds == [1] * 10 + [10, 16, 16, 9]


def test_workers_that_would_wait_send_samples():
    """16 sweeps of 7,000 pixels are 28 blocks of 4000 samples, and 16 workers have 3 each before the next round."""
    plan = BlockPlan(7_000, 61, 4000, workers=WORKERS, gathered=16)
    assert {block.samples for block in plan} == {1}


def test_a_strip_holds_its_pixels_and_no_others():
    film = Film(4, 2, ("Combined", "Depth"))
    film.add(slice(0, 8), {"Combined": np.arange(32.0).reshape(8, 4)}, 1)
    strip = film.cut_strip(slice(2, 5))
    assert (strip.width, strip.height, strip.names) == (3, 1, ("Combined",))
    strip.add(slice(None), {"Combined": np.ones((3, 4))}, 0)
    film.put_strip(slice(2, 5), strip)
    assert film.arrays["Combined"][:, 0].tolist() == [0, 4, 9, 13, 17, 20, 24, 28]
    assert film.sums.counts.read(slice(None)).sum(axis=1).tolist() == [1, 1, 2, 2, 2, 1, 1, 1]


def test_no_strip_hides_a_sweep_at_which_the_error_may_end_the_picture():
    """Of a film that begins, and of one that goes on: both have strips otherwise."""
    for until, error in ((None, 0.9), (20, 0.12)):
        pictures = []
        for workers in (1, ManyWorkers()):
            film = render(400, render(400, until=until) if until else None, error=error, min_samples=2, workers=workers)
            assert film.ended_by == "error"
            pictures.append(film)
        assert same(*pictures)
