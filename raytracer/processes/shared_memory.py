"""Memory that one process fills and others read, without a file that could be left behind.

On POSIX it is a file without a name, whose descriptor goes to the readers through a socket, their `Door`; on Windows a
part of the page file under a name that lasts as long as someone has it open. A killed process leaves neither.
"""

from __future__ import annotations

import io
import itertools
import mmap
import os
import socket
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

# NumPy arrays are fastest on whole cache lines.
ALIGNMENT = 64

_numbers = itertools.count()


@dataclass(frozen=True)
class Ticket:
    """What a reader has to know.

    places : where each buffer begins, and its size, bytes
    size : of all, bytes
    name : of the memory, on Windows
    """

    places: tuple[tuple[int, int], ...]
    size: int
    name: str


class SharedMemory:
    """The writer's end: buffers, one after the other. Close it as soon as all readers have it open.

    Raises
    ------
    OSError
        If there is not enough room.
    """

    def __init__(self, buffers: Sequence[memoryview]) -> None:
        places, end = [], 0
        for buffer in buffers:
            places.append((end, buffer.nbytes))
            end += buffer.nbytes + -buffer.nbytes % ALIGNMENT
        self.ticket = Ticket(tuple(places), end, f"raytracer-{os.getpid()}-{next(_numbers)}")
        self.content = _make_memory(self.ticket) if end else io.BytesIO()
        try:
            for (start, _), buffer in zip(places, buffers, strict=True):
                self.content.seek(start)
                self.content.write(buffer)
            self.content.flush()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Let go of it; readers keep what they have open."""
        with suppress(OSError):  # what a full disk did not take is tried once more
            self.content.close()


def _make_memory(ticket: Ticket) -> Any:
    """Return something to write into, of the size of a ticket."""
    if sys.platform == "win32":
        return mmap.mmap(-1, ticket.size, tagname=ticket.name)
    file = tempfile.TemporaryFile()  # noqa: SIM115 (SharedMemory closes it)
    file.truncate(ticket.size)
    return file


class Door:
    """A child's way in for memory: `options` for its start, `number` for what it runs, then `shut`."""

    def __init__(self) -> None:
        self.number = -1
        self.options: dict[str, Any] = {}
        if sys.platform != "win32":
            self._ours, self._theirs = map(_lift, socket.socketpair())
            self.number = self._theirs.fileno()
            self.options = {"pass_fds": (self.number,)}

    def shut(self) -> None:
        """Close the child's side, which it has by now."""
        if sys.platform != "win32":
            self._theirs.close()

    def send(self, memory: SharedMemory) -> None:
        """Let the child open `memory`, once. A child that is gone takes nothing; who asks it next finds out."""
        if sys.platform != "win32" and memory.ticket.size:
            with suppress(OSError):
                socket.send_fds(self._ours, [b"m"], [memory.content.fileno()])

    def close(self) -> None:
        """Close our side."""
        if sys.platform != "win32":
            self._ours.close()


def _lift(way: socket.socket) -> socket.socket:
    """Return a socket that has none of the numbers of the standard files, which are free where those are closed: in the
    child they are taken."""
    if sys.platform == "win32" or way.fileno() > 2:
        return way
    import fcntl

    with way:
        return socket.socket(fileno=fcntl.fcntl(way.fileno(), fcntl.F_DUPFD_CLOEXEC, 3))


def open_shared(ticket: Ticket, door: int) -> list[memoryview]:
    """Return the buffers of what came through the door `door`, a `Door.number`; they cannot be written."""
    if not ticket.size:
        return [memoryview(b"") for _ in ticket.places]
    data = memoryview(_map_memory(ticket, door)).toreadonly()
    return [data[start : start + size] for start, size in ticket.places]


def _map_memory(ticket: Ticket, door: int) -> mmap.mmap:
    if sys.platform == "win32":
        return mmap.mmap(-1, ticket.size, tagname=ticket.name)
    with socket.socket(fileno=os.dup(door)) as way:
        _, (descriptor,), _, _ = socket.recv_fds(way, 1, 1)
    try:
        return mmap.mmap(descriptor, ticket.size, access=mmap.ACCESS_READ)
    finally:
        os.close(descriptor)
