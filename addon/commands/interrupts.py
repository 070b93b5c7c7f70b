"""Ctrl-C: remembered while Blender runs, which neither passes a KeyboardInterrupt on nor survives one everywhere.

An exception that is raised inside a callback of Blender's is printed and forgotten there, and one inside `import bpy`
ends in a segmentation fault. So the signal is only noted inside `hold`, and raised when that ends.
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


class _State:
    depth = 0
    is_noted = False


def _note(number: int, frame: FrameType | None) -> None:
    """Take the signal: later inside `hold`, at once outside of it; a second one that has to wait ends the process."""
    if _State.depth and _State.is_noted:
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
        signal.signal(signal.SIGINT, before)


@contextlib.contextmanager
def hold() -> Iterator[None]:
    """Let Ctrl-C wait until the block has ended, however that may be."""
    _State.depth += 1
    try:
        yield
    finally:
        _State.depth -= 1
        if not _State.depth:
            check()


def check() -> None:
    """Raise KeyboardInterrupt where Ctrl-C has been pressed."""
    if _State.is_noted:
        raise KeyboardInterrupt
