"""Worker processes: a function loaded once, called for many jobs, its results in the order of the jobs.

Big arrays of what is loaded lie in memory that all workers share. Nothing here knows of rendering.
"""

from __future__ import annotations

import pickle
import queue
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from types import TracebackType
from typing import Any

from raytracer.processes.channel import ChannelClosedError, unpack
from raytracer.processes.child import Child, Pulse, WorkerError, open_channel, read_inbox
from raytracer.processes.dropping import dropped_when
from raytracer.processes.shared_memory import Door, SharedMemory, Ticket, open_shared

# Jobs handed out per worker beyond the one whose result is due: enough that no worker waits for the parent.
JOBS_AHEAD = 2
# Seconds between two looks at `is_cancelled` while a result is awaited.
POLL_SECONDS = 0.02
# How many workers may be lost over one job: a computer or a process fails once, a job that fails twice is to blame.
ATTEMPTS = 2
# A request without an answer: the one before it is not needed any more. Nothing else is said to a worker at work.
DROP = ("drop", None)


class LostWorkerError(WorkerError):
    """A worker process ended while it was asked."""


class Workers:
    """A number of worker processes, a Pool; use it in a `with` statement, or call `close`.

    What a process was at work on when it ended is asked of another one, once. `load` puts a new process in the place
    of one that has ended.

    Raises
    ------
    WorkerError
        If a process cannot be started.
    """

    def __init__(self, count: int) -> None:
        self._workers: list[_Worker] = []
        try:
            for _ in range(count):
                self._workers.append(_Worker())
        except WorkerError:
            for worker in self._workers:
                worker.child.kill()
                worker.close()
            raise
        self._idle: queue.SimpleQueue[_Worker] = queue.SimpleQueue()
        for worker in self._workers:
            self._idle.put(worker)
        # A thread for each worker does nothing but wait for its answer.
        self._threads = ThreadPoolExecutor(count, thread_name_prefix="raytracer-worker")

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def __len__(self) -> int:
        return len(self._workers)

    @property
    def process_ids(self) -> list[int]:
        """The workers' process ids."""
        return [worker.child.process.pid for worker in self._workers]

    def load(self, factory: Callable[..., Callable[[Any], Any]], *arguments: Any) -> None:
        """Let every worker call `factory(*arguments)`; what it returns will be called with each job.

        Raises
        ------
        WorkerError
            If a worker dies twice, the factory fails in it, or there is no room for what is loaded.
        """
        self._replace_lost()
        buffers: list[pickle.PickleBuffer] = []
        outline = pickle.dumps((factory, arguments), protocol=pickle.HIGHEST_PROTOCOL, buffer_callback=buffers.append)
        try:
            memory = SharedMemory([buffer.raw() for buffer in buffers])
        except OSError as error:
            raise WorkerError(f"no room for what the workers share: {error.strerror}") from error
        try:
            try:
                self._load((outline, memory.ticket), memory)
            except LostWorkerError:
                self._replace_lost()
                self._load((outline, memory.ticket), memory)
        finally:
            memory.close()

    def _load(self, content: tuple[bytes, Ticket], memory: SharedMemory) -> None:
        """Load all workers, each as soon as it has finished what it may still be doing for a cancelled run."""
        taken: list[_Worker] = []
        loads: list[Future[Any]] = []
        try:
            while len(taken) < len(self):
                worker = self._take_idle()
                if worker in self._workers:
                    taken.append(worker)
                    if worker.loss:
                        raise LostWorkerError(worker.loss)
            loads += [self._threads.submit(worker.load, content, memory) for worker in taken]
            for load in loads:
                self._wait(load, lambda: False)
            for load in loads:
                load.result()
        finally:
            loads.clear()  # one that failed holds its error, and that this frame: the callers would be kept for long
            for worker in taken:
                self._idle.put(worker)

    def run(self, jobs: Iterable[Any], is_cancelled: Callable[[], bool] = lambda: False) -> Iterator[Any]:
        """Yield the result of every job, in order; stop early, dropping what is under way, when `is_cancelled()`.

        `jobs` is read only a few jobs ahead of the results. Functions that ask `is_dropped` end at once then.

        Raises
        ------
        WorkerError
            If no worker is left, a job has cost two of them, or the function fails in one.
        """
        pending: deque[Future[Any]] = deque()
        try:
            for job in jobs:
                pending.append(self._threads.submit(self._call, job))
                if len(pending) > JOBS_AHEAD * len(self):
                    if self._wait(pending[0], is_cancelled):
                        self._drop(pending)
                        return
                    yield pending.popleft().result()
            while pending:
                if self._wait(pending[0], is_cancelled):
                    self._drop(pending)
                    return
                yield pending.popleft().result()
        finally:
            for future in pending:
                future.cancel()

    def _drop(self, pending: Iterable[Future[Any]]) -> None:
        """Ask for no more, and let those at work know that nobody waits for what they do."""
        for future in pending:
            future.cancel()
        for worker in self._workers:
            if worker.is_asked:
                with suppress(ChannelClosedError):
                    worker.child.channel.send(DROP)

    def close(self) -> None:
        """End the processes; whatever they are doing is lost."""
        for worker in self._workers:
            worker.child.kill()
        self._threads.shutdown(wait=True, cancel_futures=True)
        for worker in self._workers:
            worker.close()

    def _call(self, job: Any) -> Any:
        """Return a worker's answer; where it is lost over the job, that of another one."""
        lost = 0
        while True:
            worker = self._take_living()
            try:
                return worker.ask("call", job)
            except LostWorkerError:
                lost += 1
                if lost == ATTEMPTS:
                    raise
            finally:
                self._idle.put(worker)

    def _take_living(self) -> _Worker:
        """Wait for a worker that lives; those that are lost are let go of, but for the last one, which tells all that
        wait."""
        while True:
            worker = self._idle.get()
            if not worker.loss:
                return worker
            if all(other.loss for other in self._workers):
                self._idle.put(worker)
                raise LostWorkerError(worker.loss)

    def _replace_lost(self) -> None:
        """Start a new process for each one that has ended."""
        idle = []
        with suppress(queue.Empty):
            while True:
                idle.append(self._idle.get_nowait())
        try:
            for number, worker in enumerate(self._workers):
                if worker.loss or worker.child.process.poll() is not None:
                    worker.child.kill()
                    worker.close()
                    self._workers[number] = _Worker()
                    idle = [other for other in idle if other is not worker] + [self._workers[number]]
        finally:
            for worker in idle:
                self._idle.put(worker)

    def _take_idle(self) -> _Worker:
        while True:
            try:
                return self._idle.get(timeout=POLL_SECONDS)
            except queue.Empty:
                self._look_for_signs()

    def _wait(self, future: Future[Any], is_cancelled: Callable[[], bool]) -> bool:
        """Wait until a result is there (False) or the user cancels (True)."""
        while not is_cancelled():
            try:
                future.exception(timeout=POLL_SECONDS)
            except TimeoutError:
                self._look_for_signs()
                continue
            return False
        return True

    def _look_for_signs(self) -> None:
        """Take note that one more wait for those that are at work has been in vain."""
        for worker in self._workers:
            if worker.is_asked:
                worker.child.wait_in_vain(POLL_SECONDS)


class _Worker:
    """The parent's end of one worker process.

    is_asked : True while an answer is due
    loss : how its process ended, a sentence, once that is known
    """

    def __init__(self) -> None:
        try:
            self._door = Door()
            try:
                self.child = Child(__name__, str(self._door.number), **self._door.options)
            except OSError:
                self._door.close()
                raise
            finally:
                self._door.shut()
        except OSError as error:  # too many processes, or files, for the system
            raise WorkerError(f"a worker process cannot be started: {error.strerror}") from error
        self.is_asked = False
        self.loss = ""

    def load(self, content: tuple[bytes, Ticket], memory: SharedMemory) -> None:
        """Have it load what `memory` holds."""
        self._door.send(memory)
        self.ask("load", content)

    def ask(self, kind: str, content: Any) -> Any:
        """Send one request and return its answer."""
        self.is_asked = True
        try:
            self.child.channel.send((kind, content))
            succeeded, answer, trace = self.child.channel.receive()
        except (ChannelClosedError, pickle.UnpicklingError):
            self.loss = f"a worker process {self.child.describe_end()}"
            raise LostWorkerError(self.loss) from None
        finally:
            self.is_asked = False
        if succeeded:
            return answer
        error = WorkerError(f"a worker process failed: {answer}")
        error.add_note(trace)
        raise error

    def close(self) -> None:
        self._door.close()
        self.child.close()


def serve(door: int) -> None:
    """Answer requests until the parent is gone; the life of a worker process."""
    channel = open_channel()
    inbox, pulse = read_inbox(channel), Pulse(channel)
    function: Callable[[Any], Any] | None = None
    while True:
        parts = inbox.get()
        with pulse, dropped_when(lambda: not inbox.empty()):
            try:
                kind, content = unpack(parts)
                if kind == "drop":
                    continue  # what it is about has been answered
                if kind == "load":
                    function = None  # what was loaded before makes room
                    function = _load(door, *content)
                    answer = None
                else:
                    assert function is not None
                    answer = function(content)
                reply = (True, answer, "")
            except Exception as error:  # every request is answered: the parent raises what went wrong
                reply = (False, _describe_error(error), traceback.format_exc())
        try:
            channel.send(reply)
        except ChannelClosedError:
            return  # the parent is gone


def _load(door: int, outline: bytes, ticket: Ticket) -> Callable[[Any], Any]:
    factory, arguments = pickle.loads(outline, buffers=open_shared(ticket, door))
    function: Callable[[Any], Any] = factory(*arguments)
    return function


def _describe_error(error: Exception) -> str:
    """Return a sentence: NumPy's own class for a want of memory says less than words do."""
    if isinstance(error, MemoryError):
        return "not enough memory; fewer workers need less"
    return " ".join(traceback.format_exception_only(error)[-1].split())
