"""A process of our own and its two ends: `Child` is the parent's, `open_channel` what the process itself begins with.

It is a fresh Python, joined by its standard input and output: nothing of the parent runs again in it (multiprocessing
would re-import the user's script), no port is opened, and it ends at once when its parent does, whatever the reason.
While it works it says so every second, so that a process that was stopped can be told from one that is busy.
"""

from __future__ import annotations

import os
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np

from raytracer.processes.channel import Channel, ChannelClosedError
from raytracer.processes.python import make_python_command, make_python_environment, start_process

# Seconds between two signs of life, and without any until a process is given up: long enough for one that waits for
# memory or a disk; the first takes longer, as NumPy and the ray tracer are read before it.
SIGN_SECONDS = 1.0
SILENCE_SECONDS = 60.0
START_SECONDS = 180.0
# The exit code of a process that had no room for a message.
OUT_OF_MEMORY = 3


class WorkerError(RuntimeError):
    """A worker process ended, or its function failed."""


class Child:
    """The parent's end of a process that runs the function `serve` of `module`."""

    def __init__(self, module: str, arguments: str = "", **options: Any) -> None:
        with withheld_interrupts():
            self.process = start_process(
                make_python_command(f"from {module} import serve; serve({arguments})"),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                bufsize=0,
                env=make_python_environment(),
                **options,
            )
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.channel = Channel(self.process.stdout, self.process.stdin)  # type: ignore[arg-type]
        self._heard = 0
        self._silence = 0.0
        self.is_silent = False

    def wait_in_vain(self, seconds: float) -> None:
        """Take note that `seconds` of waiting for the process are over; it is killed after SILENCE_SECONDS of them
        without a sign of life.

        The waiting is counted, not taken from a clock: it must not count while this process or the computer sleeps.
        """
        if self.channel.heard != self._heard:
            self._heard, self._silence = self.channel.heard, 0.0
        self._silence += seconds
        if self._silence > (SILENCE_SECONDS if self._heard else START_SECONDS):
            self.is_silent = True
            self.process.kill()

    def describe_end(self) -> str:
        """Wait for the end of a process that is gone; return why it ended, for a sentence that begins with its name."""
        self.process.kill()
        code = self.process.wait()
        if self.is_silent:
            return f"gave no sign of life for {self._silence:.0f} seconds and was ended"
        if code == OUT_OF_MEMORY:
            return "ended: not enough memory"
        return f"ended unexpectedly (exit code {code})"

    def kill(self) -> None:
        """End the process; whatever it is doing is lost."""
        self.process.kill()
        self.process.wait()

    def close(self) -> None:
        """Close the pipes of a process that was killed."""
        self.channel.close()


@contextmanager
def withheld_interrupts() -> Iterator[None]:
    """Let processes that are started inside the block never hear of Ctrl-C, which a terminal sends to all at once: one
    that is still reading Python's modules cannot ignore it yet, and would print where it was. Ours comes afterwards."""
    if sys.platform == "win32":  # without a console of ours they are not told
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def open_channel() -> Channel:
    """Return the process' own end of the pipes, for its use alone: what it prints or reads must not mix with them."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    channel = Channel(os.fdopen(take_standard_input(), "rb", 0), os.fdopen(os.dup(1), "wb", 0))
    os.dup2(2, 1)
    return channel


def take_standard_input() -> int:
    """Return a descriptor of what was the standard input, which is empty from now on."""
    taken = os.dup(0)
    with open(os.devnull, "rb") as nothing:
        os.dup2(nothing.fileno(), 0)
    return taken


def read_inbox(channel: Channel) -> queue.SimpleQueue[list[bytearray]]:
    """Return a queue in which messages arrive, each for `unpack`; once the parent is gone the process ends, whatever
    it is doing.

    NumPy is imported by now: Windows lets libraries that bring a C runtime of their own wait for a read of what was
    the standard input.
    """
    assert np.__name__ in sys.modules
    inbox: queue.SimpleQueue[list[bytearray]] = queue.SimpleQueue()

    def read() -> None:
        while True:
            try:
                inbox.put(channel.receive_parts())
            except ChannelClosedError:
                os._exit(0)
            except MemoryError:
                os._exit(OUT_OF_MEMORY)

    threading.Thread(target=read, name="raytracer-inbox", daemon=True).start()
    return inbox


def end_with_parent() -> None:
    """Let this process end when its standard input does, which its parent holds open and says nothing to."""
    parent = take_standard_input()

    def wait() -> None:
        with suppress(OSError):
            os.read(parent, 1)
        os._exit(1)

    threading.Thread(target=wait, name="raytracer-parent", daemon=True).start()


class Pulse:
    """Says every second that the process lives, within `with pulse:`, while the parent listens."""

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._is_working = threading.Event()
        threading.Thread(target=self._beat, name="raytracer-pulse", daemon=True).start()

    def __enter__(self) -> None:
        self._is_working.set()

    def __exit__(self, *_: Any) -> None:
        self._is_working.clear()

    def _beat(self) -> None:
        pause = threading.Event()
        while self._is_working.wait():
            try:
                self._channel.send_sign_of_life()
            except ChannelClosedError:
                return
            pause.wait(SIGN_SECONDS)


def describe_error(error: BaseException) -> str:
    """Return a sentence: that of a scene which cannot be drawn, or what went wrong."""
    if isinstance(error, MemoryError):
        return "not enough memory"
    text = " ".join(str(error).split())
    return text if isinstance(error, ValueError | WorkerError) else f"internal error, {type(error).__name__}: {text}"
