"""Worker processes: a function loaded once, called for many jobs, its results in the order of the jobs.

Each worker is a fresh Python of our own making, joined by its standard input and output: nothing of the parent runs
again in it (multiprocessing would re-import the user's script), no port is opened, and it ends when its parent does,
whatever the reason. Big arrays of what is loaded lie in one mapped file that all workers share. Nothing here knows of
rendering.
"""

from __future__ import annotations

import mmap
import os
import pickle
import queue
import signal
import subprocess
import sys
import tempfile
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import IO, Any

from raytracer.processes.python import make_python_command, make_python_environment

# Jobs handed out per worker beyond the one whose result is due: enough that no worker waits for the parent.
JOBS_AHEAD = 2


# Seconds between two looks at `is_cancelled` while a result is awaited.
POLL_SECONDS = 0.02


# NumPy arrays are fastest on whole cache lines.
BUFFER_ALIGNMENT = 64


class WorkerError(RuntimeError):
    """A worker process ended, or its function failed."""


class Workers:
    """A number of worker processes; use it in a `with` statement, or call `close`."""

    def __init__(self, count: int) -> None:
        self._directories: list[tempfile.TemporaryDirectory[str]] = []
        self._workers = [_Worker() for _ in range(count)]
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
        return [worker.process.pid for worker in self._workers]

    def load(self, factory: Callable[..., Callable[[Any], Any]], *arguments: Any) -> None:
        """Let every worker call `factory(*arguments)`; what it returns will be called with each job.

        Raises
        ------
        WorkerError
            If a worker has died or the factory fails in it.
        """
        directory = tempfile.TemporaryDirectory(prefix="raytracer-")
        self._directories.append(directory)
        path = Path(directory.name) / "arrays"
        outline, sizes = _write_arrays((factory, arguments), path)
        # All workers, as soon as each has finished what it may still be doing for a cancelled run.
        workers = [self._idle.get() for _ in self._workers]
        try:
            loads = [self._threads.submit(worker.ask, "load", (outline, path, sizes)) for worker in workers]
            for load in loads:
                load.result()
        finally:
            for worker in workers:
                self._idle.put(worker)
        if os.name == "posix":  # elsewhere a mapped file cannot be deleted before `close`
            directory.cleanup()

    def run(self, jobs: Iterable[Any], is_cancelled: Callable[[], bool] = lambda: False) -> Iterator[Any]:
        """Yield the result of every job, in order; stop early, dropping what is under way, when `is_cancelled()`.

        `jobs` is read only a few jobs ahead of the results.

        Raises
        ------
        WorkerError
            If a worker has died or the function fails in it.
        """
        pending: deque[Future[Any]] = deque()
        try:
            for job in jobs:
                pending.append(self._threads.submit(self._call, job))
                if len(pending) > JOBS_AHEAD * len(self):
                    if _wait(pending[0], is_cancelled):
                        return
                    yield pending.popleft().result()
            while pending:
                if _wait(pending[0], is_cancelled):
                    return
                yield pending.popleft().result()
        finally:
            for future in pending:
                future.cancel()

    def close(self) -> None:
        """End the processes; whatever they are doing is lost."""
        for worker in self._workers:
            worker.process.kill()
        self._threads.shutdown(wait=True, cancel_futures=True)
        for worker in self._workers:
            worker.close()
        for directory in self._directories:
            directory.cleanup()

    def _call(self, job: Any) -> Any:
        worker = self._idle.get()
        try:
            return worker.ask("call", job)
        finally:
            self._idle.put(worker)  # dead or alive: the next call finds out at once, instead of waiting for ever


class _Worker:
    """The parent's end of one worker process."""

    def __init__(self) -> None:
        self.process = subprocess.Popen(
            make_python_command(f"from {__name__} import serve; serve()"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=make_python_environment(),
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )

    def ask(self, kind: str, content: Any) -> Any:
        """Send one request and return its answer."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        try:
            _send(self.process.stdin, (kind, content))
            succeeded, answer = pickle.load(self.process.stdout)
        except (EOFError, BrokenPipeError, ConnectionResetError, pickle.UnpicklingError):
            self.process.kill()
            code = self.process.wait()
            raise WorkerError(f"a worker process ended unexpectedly (exit code {code})") from None
        if succeeded:
            return answer
        error = WorkerError(f"a worker process failed: {answer.splitlines()[-1]}")
        error.add_note(answer)
        raise error

    def close(self) -> None:
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout):
            assert pipe is not None
            try:
                pipe.close()
            except BrokenPipeError:
                # What a dead worker had not read is lost, as `close` promises.
                continue


def _wait(future: Future[Any], is_cancelled: Callable[[], bool]) -> bool:
    """Wait until a result is there (False) or the user cancels (True)."""
    while not is_cancelled():
        try:
            future.exception(timeout=POLL_SECONDS)
        except TimeoutError:
            continue
        return False
    return True


def _send(stream: IO[bytes], message: Any) -> None:
    pickle.dump(message, stream, protocol=pickle.HIGHEST_PROTOCOL)
    stream.flush()


def _write_arrays(content: Any, path: Path) -> tuple[bytes, list[int]]:
    """Pickle `content`, its arrays apart in the file `path`; return the pickle and the sizes of the arrays, bytes."""
    buffers: list[pickle.PickleBuffer] = []
    outline = pickle.dumps(content, protocol=pickle.HIGHEST_PROTOCOL, buffer_callback=buffers.append)
    sizes = []
    with open(path, "wb") as file:
        for buffer in buffers:
            data = buffer.raw()
            sizes.append(data.nbytes)
            file.write(data)
            file.write(bytes(-data.nbytes % BUFFER_ALIGNMENT))
    return outline, sizes


def _read_arrays(outline: bytes, path: Path, sizes: list[int]) -> Any:
    """Return what `_write_arrays` was given; its arrays are read-only views of the file."""
    if not any(sizes):
        return pickle.loads(outline, buffers=[bytes(size) for size in sizes])  # an empty file cannot be mapped
    with open(path, "rb") as file:
        data = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
    buffers, start = [], 0
    for size in sizes:
        buffers.append(data[start : start + size])
        start += size + -size % BUFFER_ALIGNMENT
    return pickle.loads(outline, buffers=buffers)


def serve() -> None:
    """Answer requests from standard input until it ends; the life of a worker process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    requests, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what anything prints must not mix with the answers
    function: Callable[[Any], Any] | None = None
    while True:
        try:
            kind, content = pickle.load(requests)
        except EOFError:
            return
        try:
            if kind == "load":
                factory, arguments = _read_arrays(*content)
                function = factory(*arguments)
                answer = None
            else:
                assert function is not None
                answer = function(content)
            reply = (True, answer)
        except Exception:  # every request is answered: the parent raises what went wrong
            reply = (False, traceback.format_exc())
        try:
            _send(answers, reply)
        except BrokenPipeError:
            return  # the parent is gone
