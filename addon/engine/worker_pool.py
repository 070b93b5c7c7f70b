"""The render processes of a session: started by the first picture that is worth it, lent to one render after the other,
and ended after a while without any, with the add-on, or with Blender itself, however that ends.

To start them takes a second or more, at each frame of an animation and each F12; to hand them a scene, milliseconds.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from typing import Any

from raytracer.processes.workers import WorkerError, Workers

# Seconds without a render until the processes end: they keep some 60 MB each.
IDLE_SECONDS = 300.0
# Light paths of a picture that is traced here: to hand it over, and the parts of it back, would take as long.
SMALLEST_PICTURE = 1 << 15


class _Session:
    workers: Workers | None = None
    is_lent = False
    timer: threading.Timer | None = None
    lock = threading.Lock()


@contextlib.contextmanager
def lend(count: int, paths: int, on_stage: Callable[[str], None]) -> Iterator[Workers | int]:
    """Yield what `raytracer.render` takes for `workers`: the session's, or 1 for a small picture.

    count, paths : processes asked for, and light paths of the picture
    on_stage : called with what takes its time
    """
    if count == 1 or paths < SMALLEST_PICTURE:
        yield 1
        return
    with _Session.lock:
        if _Session.is_lent:  # Blender renders something else at the same time
            workers = None
        else:
            _stop_timer()
            if _Session.workers is None or len(_Session.workers) != count:
                on_stage(f"Starting {count} workers")
                _close()
                _Session.workers = Workers(count)
            workers, _Session.is_lent = _Session.workers, True
    if workers is None:
        yield count
        return
    is_whole = False
    try:
        yield workers
        is_whole = True
    finally:
        _give_back(is_whole)


def unload(workers: Workers | int) -> None:
    """Let the processes let go of their scene once all is done; those that still trace would have to be waited for.

    Where that fails they end: the picture is there already.
    """
    if isinstance(workers, Workers):
        try:
            workers.load(_hold_nothing)
        except WorkerError:
            close()


def close() -> None:
    """End the processes."""
    with _Session.lock:
        _stop_timer()
        _close()


def _give_back(is_whole: bool) -> None:
    with _Session.lock:
        _Session.is_lent = False
        if not is_whole:
            _close()  # after an error nobody knows what they are at
        elif _Session.workers is not None:
            _Session.timer = threading.Timer(IDLE_SECONDS, _end_idle)
            _Session.timer.daemon = True
            _Session.timer.start()


def _end_idle() -> None:
    with _Session.lock:
        if not _Session.is_lent:  # by a render that began as the time was over
            _close()


def _close() -> None:
    if _Session.workers is not None:
        _Session.workers.close()
        _Session.workers = None


def _stop_timer() -> None:
    if _Session.timer is not None:
        _Session.timer.cancel()
        _Session.timer = None


def _hold_nothing() -> Callable[[Any], Any]:
    return _do_nothing


def _do_nothing(job: Any) -> None:
    pass
