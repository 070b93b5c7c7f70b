"""Workers of a Dask cluster as a Pool: what a worker that is lost was at work on is asked of another one, by Dask.

Dask is an extra (`pip install raytracer[dask]`), imported where it is used. Its workers must have this package.

References
----------
M. Rocklin, "Dask: Parallel Computation with Blocked algorithms and Task Scheduling", SciPy 2015.
Dask.distributed documentation: "Client", "Managing Memory" (scatter), "Resilience".
"""

from __future__ import annotations

import pickle
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from typing import Any

from raytracer.processes.workers import JOBS_AHEAD, WorkerError

# Seconds between two looks for a result.
POLL_SECONDS = 0.005

# What a thread of a cluster's process has loaded, and its name: one function, for there may be no room for two.
_loaded = threading.local()


class DaskPool:
    """The workers of a `distributed.Client`, a Pool; the client stays the user's to close."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._content: Any = None
        self._name = ""

    def __len__(self) -> int:
        """Return the number of threads of the cluster's workers, at least 1: they may still be on their way."""
        return max(1, sum(self._client.nthreads().values()))

    def load(self, factory: Callable[..., Callable[[Any], Any]], *arguments: Any) -> None:
        """Send `factory(*arguments)` to the cluster; each process calls it when it is first asked for a job."""
        self._name = uuid.uuid4().hex
        content = pickle.dumps((factory, arguments), protocol=pickle.HIGHEST_PROTOCOL)
        # The scheduler may lose workers, and with them what was scattered to them: it goes to all, and this keeps it.
        self._content = self._client.scatter(content, broadcast=True, hash=False)

    def run(self, jobs: Iterable[Any], is_cancelled: Callable[[], bool] = lambda: False) -> Iterator[Any]:
        """Yield the result of every job, in order; stop early, dropping what is under way, when `is_cancelled()`.

        Raises
        ------
        WorkerError
            If the function fails, or a job has cost more workers than the cluster allows (`allowed-failures`).
        """
        pending: deque[Any] = deque()
        try:
            for job in jobs:
                pending.append(self._client.submit(call, self._name, self._content, job, pure=False))
                if len(pending) > JOBS_AHEAD * len(self):
                    if is_cancelled_before(pending[0], is_cancelled):
                        return
                    yield take_result(pending.popleft())
            while pending:
                if is_cancelled_before(pending[0], is_cancelled):
                    return
                yield take_result(pending.popleft())
        finally:
            self._client.cancel(list(pending))


def is_cancelled_before(future: Any, is_cancelled: Callable[[], bool]) -> bool:
    """Wait until a result, or what went wrong, is there (False) or the user cancels (True).

    A future knows its own client; Dask's `wait` asks the default one, which may be another, or none.
    """
    while not is_cancelled():
        if future.done():
            return False
        time.sleep(POLL_SECONDS)
    return True


def take_result(future: Any) -> Any:
    """Return a job's result, or raise WorkerError with what went wrong, in a sentence."""
    try:
        return future.result()
    except (Exception, CancelledError) as error:
        reason = " ".join(str(error).split())
        raise WorkerError(f"a worker of the cluster failed: {type(error).__name__}: {reason}") from error


def call(name: str, content: bytes, job: Any) -> Any:
    """Do one job in a process of the cluster, with what was loaded as `name`."""
    if getattr(_loaded, "name", "") != name:
        _loaded.function = None  # what was loaded before makes room
        factory, arguments = pickle.loads(content)
        _loaded.function, _loaded.name = factory(*arguments), name
    return _loaded.function(job)
