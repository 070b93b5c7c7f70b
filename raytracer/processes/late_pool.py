"""A pool that works from the start: its jobs are done here until its workers are there, then by them.

To start processes and to load them takes a second or more. Meanwhile nobody should wait, neither for the first results
nor for the end of what was cancelled: a thread starts and loads them. Nothing here knows of rendering.
"""

from __future__ import annotations

import os
import pickle
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from typing import Any

from raytracer.processes.dropping import DroppedError, dropped_when
from raytracer.processes.workers import WorkerError, Workers

# Steps by which workers are nicer than their parent, on POSIX: each takes about a fifth less beside others.
NICENESS = 5


class LatePool:
    """A number of workers, a Pool, that are started by the first `load`. Close it."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._workers: Workers | None = None
        self._loading: Future[Workers] | None = None
        self._function: Callable[[Any], Any] | None = None
        self._is_closed = False
        # One thread: what is loaded later replaces what was loaded before.
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="raytracer-late-pool")

    def __len__(self) -> int:
        return self._count

    @property
    def process_ids(self) -> list[int]:
        """The workers' process ids; none before they are started."""
        workers = self._workers
        return workers.process_ids if workers else []

    def load(self, factory: Callable[..., Callable[[Any], Any]], *arguments: Any) -> None:
        """Call `factory(*arguments)` here, and have the workers do so as soon as they can.

        The arguments are pickled here, but for their large arrays: these must not change while the workers load.
        """
        if self._loading is not None:
            self._loading.cancel()
        self._function = factory(*arguments)
        buffers: list[pickle.PickleBuffer] = []
        outline = pickle.dumps((factory, arguments), protocol=pickle.HIGHEST_PROTOCOL, buffer_callback=buffers.append)
        self._loading = self._thread.submit(self._load, outline, buffers)

    def run(self, jobs: Iterable[Any], is_cancelled: Callable[[], bool]) -> Iterator[Any]:
        """Yield the result of every job, in order; stop early when `is_cancelled()`.

        The function ends early as well if it asks `is_dropped` and raises a DroppedError.

        Raises
        ------
        WorkerError
            If workers that were at work are lost; those that cannot be loaded are done without.
        """
        assert self._function is not None
        assert self._loading is not None
        left = iter(jobs)
        while not (self._loading.done() and self._loading.exception() is None):
            for job in left:
                try:
                    with dropped_when(is_cancelled):
                        result = self._function(job)
                except DroppedError:
                    return
                yield result
                break
            else:
                return
        try:
            yield from self._loading.result().run(left, is_cancelled)
        except WorkerError:
            self._thread.submit(self._end_workers)
            raise

    def close(self) -> None:
        """Have the workers ended, also those that are being started; does not wait for it. May be called again."""
        if self._is_closed:
            return
        self._is_closed = True
        if self._loading is not None:
            self._loading.cancel()
        self._thread.submit(self._end_workers)
        self._thread.shutdown(wait=False)

    def _load(self, outline: bytes, buffers: list[pickle.PickleBuffer]) -> Workers:
        """Start workers where there are none, and load them; called in the thread."""
        try:
            if self._workers is None:
                self._workers = Workers(self._count)
            self._workers.load(call_pickled, outline, buffers)
        except (WorkerError, OSError):
            self._end_workers()
            raise
        return self._workers

    def _end_workers(self) -> None:
        if self._workers is not None:
            self._workers.close()
            self._workers = None


def call_pickled(outline: bytes, buffers: list[Any]) -> Callable[[Any], Any]:
    """Call a pickled factory with its arguments; called in the workers."""
    yield_to_parent()
    factory, arguments = pickle.loads(outline, buffers=buffers)
    function: Callable[[Any], Any] = factory(*arguments)
    return function


def yield_to_parent() -> None:
    """Let the parent go first where processors are few: what it does next is waited for, while workers still finish
    what is not needed any more."""
    if sys.platform != "win32":
        with suppress(OSError):  # where not even this is allowed
            parent = os.getpriority(os.PRIO_PROCESS, os.getppid())
            os.setpriority(os.PRIO_PROCESS, 0, min(parent + NICENESS, 19))
