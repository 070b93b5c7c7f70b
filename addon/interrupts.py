"""Ctrl-C on the command line: at once where our own Python runs, remembered while Blender does.

Blender neither passes a KeyboardInterrupt on nor survives one everywhere: one that is raised inside a callback of its
own is printed and forgotten there, and one inside `import bpy` ends in a segmentation fault. So within `hold` the
signal is only noted, and raised when that ends; within `release`, in a callback that hands it on, at once again.

Until `listen` begins nothing here does anything: Blender's own windows keep their Ctrl-C.
"""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Iterator
from types import FrameType

# How the shell names the end by Ctrl-C.
EXIT_CODE = 128 + signal.SIGINT
LINE = "error: interrupted\n"


class _State:
    depth = 0
    is_noted = False
    errors = -1  # where LINE goes


def _note(number: int, frame: FrameType | None) -> None:
    """Take the signal: later inside `hold`, at once outside of it; a second one that has to wait ends the process."""
    if _State.depth and _State.is_noted:
        with contextlib.suppress(OSError):
            os.write(_State.errors, LINE.encode())
        os._exit(EXIT_CODE)
    _State.is_noted = True
    if not _State.depth:
        raise KeyboardInterrupt


@contextlib.contextmanager
def listen() -> Iterator[None]:
    """Listen to Ctrl-C inside the block, in the main thread, the only one that may."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _State.is_noted = False
    before = signal.signal(signal.SIGINT, _note)
    try:
        yield
    finally:
        _State.is_noted = False
        signal.signal(signal.SIGINT, before)


def tell_through(descriptor: int) -> None:
    """Name the file descriptor that an end in the middle of something is told through."""
    _State.errors = descriptor


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


def check() -> None:
    """Raise KeyboardInterrupt where Ctrl-C has been pressed."""
    if _State.is_noted:
        raise KeyboardInterrupt
