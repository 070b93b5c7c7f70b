"""Pools whose workers come late, and jobs that are dropped: same results, nothing waits, nothing is left behind."""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from raytracer.processes import late_pool
from raytracer.processes.dropping import DroppedError, dropped_when, is_dropped
from raytracer.processes.late_pool import LatePool
from raytracer.processes.workers import WorkerError, Workers
from tests.portable import is_running, kill

# Seconds; a test that waits longer has failed.
PATIENCE = 60.0


class Tell:
    """Tells which process does a job, and what of an array it is about."""

    def __init__(self, array: np.ndarray) -> None:
        self.array = array

    def __call__(self, job: int) -> tuple[int, float]:
        return os.getpid(), float(self.array[job % len(self.array)])


class TellWithDrops(Tell):
    """Job 0 lasts until nobody waits for it; fails then."""

    def __call__(self, job: int) -> tuple[int, float]:
        while job == 0:
            time.sleep(0.01)
            if is_dropped():
                raise DroppedError
        return super().__call__(job)


class ExitElsewhere(Tell):
    """Ends every process but the one that made it first."""

    def __init__(self, home: int) -> None:
        self.home = home

    def __call__(self, job: int) -> tuple[int, float]:
        if os.getpid() != self.home:
            os._exit(7)
        return self.home, 0.0


def fail_elsewhere(home: int) -> Callable[[int], tuple[int, float]]:
    """Fails to load in every process but one."""
    if os.getpid() != home:
        raise ValueError("no such scene")
    return Tell(np.zeros(1))


@pytest.fixture
def pool() -> Iterator[LatePool]:
    one = LatePool(2)
    yield one
    one.close()


def never() -> bool:
    return False


def wait_for(condition: Callable[[], Any]) -> None:
    end = time.perf_counter() + PATIENCE
    while not condition():
        assert time.perf_counter() < end, "waited in vain"
        time.sleep(0.002)


def load(pool: LatePool, *what: Any) -> None:
    """Load and wait until the workers are there, or cannot be."""
    pool.load(*what)
    wait_for(lambda: pool._loading is not None and pool._loading.done())


def test_jobs_are_done_here_until_workers_are_there_and_results_keep_their_order(pool: LatePool) -> None:
    values = np.random.default_rng(5).normal(size=20_000)  # travels beside the pickle
    pool.load(Tell, values)
    results = pool.run(itertools.count(), never)
    first = next(results)
    assert first == (os.getpid(), values[0])
    found = [first]
    end = time.perf_counter() + PATIENCE
    while len({process for process, _ in found}) < 3:
        assert time.perf_counter() < end
        found.append(next(results))
    assert {process for process, _ in found} == {os.getpid(), *pool.process_ids}
    assert [value for _, value in found] == [values[number % len(values)] for number in range(len(found))]


def test_all_jobs_are_done_once(pool: LatePool) -> None:
    pool.load(Tell, np.arange(50.0))
    assert [value for _, value in pool.run(range(50), never)] == list(range(50))
    load(pool, Tell, np.arange(50.0) + 1)
    results = list(pool.run(range(50), never))
    assert [value for _, value in results] == list(range(1, 51))
    assert {process for process, _ in results} <= set(pool.process_ids)


@pytest.mark.parametrize("is_late", [True, False], ids=["here", "in a worker"])
def test_a_job_that_nobody_waits_for_ends_early(pool: LatePool, is_late: bool) -> None:
    if is_late:
        pool.load(TellWithDrops, np.zeros(1))
    else:
        load(pool, TellWithDrops, np.zeros(1))
    begun = time.perf_counter()
    assert list(pool.run([0], lambda: time.perf_counter() > begun + 0.5)) == []
    load(pool, TellWithDrops, np.ones(1))  # would wait for a worker at work
    results = list(pool.run(range(1, 9), never))
    assert [value for _, value in results] == [1.0] * 8
    assert {process for process, _ in results} <= set(pool.process_ids)


def test_workers_drop_what_is_under_way_and_nothing_later() -> None:
    with Workers(2) as workers:
        workers.load(TellWithDrops, np.zeros(1))
        for _ in range(5):
            begun = time.perf_counter()
            assert list(workers.run([0, 0, 1, 0], lambda begun=begun: time.perf_counter() > begun + 0.05)) == []
            assert len(list(workers.run(range(1, 9)))) == 8


def test_nothing_is_dropped_where_nobody_asks() -> None:
    assert not is_dropped()
    with dropped_when(lambda: True):
        assert is_dropped()
    assert not is_dropped()


def test_an_error_of_the_function_is_raised(pool: LatePool) -> None:
    pool.load(Tell, None)
    with pytest.raises(TypeError):
        next(pool.run([1], never))


def test_without_workers_the_jobs_are_done_here(pool: LatePool, monkeypatch: pytest.MonkeyPatch) -> None:
    load(pool, fail_elsewhere, os.getpid())
    assert {process for process, _ in pool.run(range(9), never)} == {os.getpid()}
    assert pool.process_ids == []

    def fail(count: int) -> None:
        raise OSError("no more processes")

    monkeypatch.setattr(late_pool, "Workers", fail)
    load(pool, Tell, np.zeros(1))
    assert {process for process, _ in pool.run(range(9), never)} == {os.getpid()}


def test_workers_that_are_lost_are_said_and_replaced(pool: LatePool) -> None:
    load(pool, ExitElsewhere, os.getpid())
    lost = pool.process_ids
    with pytest.raises(WorkerError, match="ended unexpectedly"):
        list(pool.run(range(9), never))
    load(pool, Tell, np.zeros(1))
    assert len(list(pool.run(range(9), never))) == 9
    assert not set(lost) & set(pool.process_ids)


def test_workers_that_were_killed_in_between_are_replaced(pool: LatePool) -> None:
    load(pool, Tell, np.zeros(1))
    for process in pool.process_ids:
        kill(process)
    load(pool, Tell, np.ones(1))
    assert {value for _, value in pool.run(range(9), never)} == {1.0}


@pytest.mark.skipif(not hasattr(os, "getpriority"), reason="no niceness here")
def test_workers_let_their_parent_go_first_however_often_they_are_loaded(pool: LatePool) -> None:
    own = os.getpriority(os.PRIO_PROCESS, 0)
    for _ in range(2):
        load(pool, Tell, np.zeros(1))
    assert len(pool.process_ids) == 2
    for process in pool.process_ids:
        assert os.getpriority(os.PRIO_PROCESS, process) == min(own + late_pool.NICENESS, 19)


def test_close_ends_the_workers_without_waiting(pool: LatePool) -> None:
    load(pool, Tell, np.zeros(1))
    started = pool.process_ids
    assert len(started) == 2
    pool.close()
    pool.close()
    wait_for(lambda: not any(is_running(process) for process in started))
    other = LatePool(2)
    other.load(Tell, np.zeros(1))
    wait_for(lambda: other.process_ids)
    started = other.process_ids
    other.close()  # while they load
    wait_for(lambda: not any(is_running(process) for process in started))
