"""Ctrl-C on the command line: at once where our own Python runs, remembered while Blender does.

Blender neither passes a KeyboardInterrupt on nor survives one everywhere: one that is raised inside a callback of its
own is printed and forgotten there, and one inside `import bpy` ends in a segmentation fault. So within `hold` the
signal is only noted, and raised when that ends; within `release`, in a callback that hands it on, at once again. Where
Blender goes on for long all the same (Cycles does) the process ends without it, after a little tidying up.

Until `listen` begins nothing here does anything: Blender's own windows keep their Ctrl-C.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any

# How the shell names the end by Ctrl-C.
EXIT_CODE = 128 + signal.SIGINT
LINE = "error: interrupted\n"
# Seconds that Blender may go on: enough for it to start and to open a file, and no long wait for who pressed the keys.
PATIENCE_SECONDS = 3.0


class _State:
    depth = 0
    is_noted = False
    is_polled = False
    errors = -1  # where LINE goes
    tidiers: tuple[Callable[[], object], ...] = ()


def _note(number: int, frame: FrameType | None) -> None:
    """Take the signal: later inside `hold`, at once outside of it; a second one that has to wait ends the process."""
    has_to_wait = _State.depth or _State.is_polled
    if has_to_wait and _State.is_noted:
        _end_abruptly()
    _State.is_noted = True
    if not has_to_wait:
        raise KeyboardInterrupt


def _watch(wakes: socket.socket) -> None:
    """End the process where Ctrl-C has waited too long; a byte comes with each signal, even while Blender runs.

    Runs in a thread, which Blender lets go on wherever it gives Python's lock away.
    """
    with wakes:
        while numbers := wakes.recv(16):
            if signal.SIGINT in numbers and _State.depth:
                threading.Event().wait(PATIENCE_SECONDS)
                if _State.depth:
                    _end_abruptly()


def _end_abruptly() -> None:
    for tidy in _State.tidiers:
        with contextlib.suppress(Exception):
            tidy()
    with contextlib.suppress(OSError):
        os.write(_State.errors, LINE.encode())
    os._exit(EXIT_CODE)


@contextlib.contextmanager
def listen() -> Iterator[None]:
    """Listen to Ctrl-C inside the block, in the main thread, the only one that may."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _State.is_noted = False
    before = signal.signal(signal.SIGINT, _note)
    wakes, rings = socket.socketpair()
    rings.setblocking(False)
    number = signal.set_wakeup_fd(rings.fileno(), warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(wakes,), name="interrupts", daemon=True).start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(number)
        rings.close()  # which ends the thread
        _State.is_noted = False
        _restore(signal.SIGINT, before)


def tell_through(descriptor: int) -> None:
    """Name the file descriptor that an abrupt end is told through."""
    _State.errors = descriptor


@contextlib.contextmanager
def tidying(tidy: Callable[[], object]) -> Iterator[None]:
    """Have `tidy` called if the process is ended abruptly inside the block: no `finally` of its own would be."""
    before = _State.tidiers
    _State.tidiers = (tidy, *before)
    try:
        yield
    finally:
        _State.tidiers = before


@contextlib.contextmanager
def hold() -> Iterator[None]:
    """Let Ctrl-C wait until the block has ended, however that may be."""
    before = _State.depth
    _State.depth = before + 1
    try:
        yield
    finally:
        _State.depth = before
        if not before:
            check()


@contextlib.contextmanager
def release() -> Iterator[None]:
    """Let Ctrl-C end the block at once, inside of `hold`: one that was noted before ends it as it begins."""
    before, _State.depth = _State.depth, 0
    try:
        check()
        yield
    finally:
        _State.depth = before


@contextlib.contextmanager
def poll() -> Iterator[None]:
    """Only note Ctrl-C inside the block, which asks `is_noted` often, and then ends in its own time."""
    before = _State.depth, _State.is_polled
    _State.depth, _State.is_polled = 0, True
    try:
        yield
    finally:
        _State.depth, _State.is_polled = before


@contextlib.contextmanager
def listen_for(number: int) -> Iterator[None]:
    """Treat another signal as Ctrl-C inside the block, in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(number, _note)
    try:
        yield
    finally:
        _restore(number, before)


def _restore(number: int, handler: Any) -> None:
    """Give a signal its former handler. None stands for one in C, as the application in the background has for Ctrl-C:
    no Python can bring that back, and the default comes next to it."""
    signal.signal(number, signal.SIG_DFL if handler is None else handler)


def is_noted() -> bool:
    """Return whether Ctrl-C has been pressed."""
    return _State.is_noted


def check() -> None:
    """Raise KeyboardInterrupt where Ctrl-C has been pressed."""
    if _State.is_noted:
        raise KeyboardInterrupt
