"""Messages between two processes, through a pipe in each direction.

A message is a frame: the number of its parts, their sizes in bytes, then the parts: its pickle, and the data of its
larger arrays, which are neither copied nor searched on their way. A frame without parts is no message: it says that
the sender lives.
"""

from __future__ import annotations

import pickle
import struct
import threading
from collections.abc import Sequence
from io import RawIOBase
from typing import Any

# Arrays of fewer bytes travel inside of the pickle: a part of its own costs two calls of the system.
SMALLEST_PART = 1 << 16
NUMBER = struct.Struct("<Q")


class ChannelClosedError(Exception):
    """The other end is gone."""


class Channel:
    """One end: `send` may be called by several threads, `receive` by one.

    heard : the number of frames that came, signs of life included
    """

    def __init__(self, incoming: RawIOBase, outgoing: RawIOBase) -> None:
        self._incoming, self._outgoing = incoming, outgoing
        self._lock = threading.Lock()
        self.heard = 0

    def send(self, message: Any) -> None:
        """Send a message; returns when all of it has left.

        Raises
        ------
        ChannelClosedError
            If the other end is gone.
        """
        self._write(pack(message))

    def send_sign_of_life(self) -> None:
        """Say that this process lives."""
        self._write([])

    def receive(self) -> Any:
        """Wait for the next message and return it.

        Raises
        ------
        ChannelClosedError
            If the other end is gone.
        """
        return unpack(self.receive_parts())

    def receive_parts(self) -> list[bytearray]:
        """Wait for the next message and return it as it came, for `unpack`."""
        while True:
            (count,) = NUMBER.unpack(self._read(NUMBER.size))
            sizes = [NUMBER.unpack(self._read(NUMBER.size))[0] for _ in range(count)]
            parts = [self._read(size) for size in sizes]
            self.heard += 1
            if parts:
                return parts

    def close(self) -> None:
        """Close this end; nothing waits in a buffer that could fail to leave."""
        self._incoming.close()
        self._outgoing.close()

    def _write(self, parts: Sequence[Any]) -> None:
        sizes = b"".join(NUMBER.pack(memoryview(part).nbytes) for part in parts)
        with self._lock:
            for piece in (NUMBER.pack(len(parts)) + sizes, *parts):
                self._write_piece(memoryview(piece))

    def _write_piece(self, piece: memoryview) -> None:
        written = 0
        while written < len(piece):
            try:
                count = self._outgoing.write(piece[written:])
            # A dead reader is EPIPE on POSIX, EINVAL on Windows; a closed pipe is a ValueError.
            except (OSError, ValueError) as error:
                raise ChannelClosedError(str(error)) from None
            written += count or 0

    def _read(self, size: int) -> bytearray:
        data = bytearray(size)
        view, got = memoryview(data), 0
        while got < size:
            try:
                count = self._incoming.readinto(view[got:])
            except (OSError, ValueError) as error:
                raise ChannelClosedError(str(error)) from None
            if not count:
                raise ChannelClosedError("the other end is closed")
            got += count
        return data


def pack(message: Any) -> list[Any]:
    """Return the parts of a message: its pickle, then the bytes of each of its larger arrays."""
    parts: list[memoryview] = []

    def goes_inside(buffer: pickle.PickleBuffer) -> bool:
        data = buffer.raw()
        if data.nbytes < SMALLEST_PART:
            return True
        parts.append(data)
        return False

    outline = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL, buffer_callback=goes_inside)
    return [outline, *parts]


def unpack(parts: Sequence[Any]) -> Any:
    """Return the message of `pack`."""
    return pickle.loads(parts[0], buffers=parts[1:])
