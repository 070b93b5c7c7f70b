"""Files that are being written, and who still writes them.

The writer holds its file open and locked until it stands in its place: both end with the process, however it ends. So
an unfinished file that nobody holds is one that a killed process left. On POSIX a lock tells; on Windows an open file
cannot be removed, and none is while it is new, as it must not be open while it is moved. In a folder that machines
share, locks may be known to their own one alone (sshfs, NFS without locks): a file's name says whose it is.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import secrets
import socket
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO

# An unfinished file is named apart from its target, whose name may have no room for more letters.
PREFIX = ".writing-"
NAME = re.compile(re.escape(PREFIX) + r"[0-9a-f]{12}(\..*)?", re.DOTALL)
# What tells the files of this machine from those of others.
MACHINE = hashlib.sha256(socket.gethostname().encode()).hexdigest()[:4]
# Seconds after its last write in which another machine's file is left alone.
FOREIGN_SECONDS = 3600.0
# Seconds after its last write in which a file is left alone on Windows: many times what moving it takes.
NEW_SECONDS = 10.0
# Seconds in which who looks at a file on Windows (a virus scanner, a backup, a command that reads it) has closed it.
IN_USE_SECONDS = 5.0


class NewFile:
    """An empty file beside `target`, at `path`, with its suffix and the permissions that a file made by `open` has."""

    def __init__(self, target: Path) -> None:
        self._is_kept = False
        while True:
            self.path = target.with_name(f"{PREFIX}{MACHINE}{secrets.token_hex(4)}{target.suffix}")
            self._owner = open(self.path, "xb")  # noqa: SIM115 (open as long as the file is being written)
            with contextlib.suppress(OSError):  # where there are no locks, nothing is swept
                _lock(self._owner)
            if self.path.exists():
                return
            self._owner.close()  # somebody swept it before it was locked

    def move(self, target: Path) -> None:
        """Let the file take the place of `target`."""
        if sys.platform == "win32":
            self._owner.close()
        move_in_use(os.replace, self.path, target)
        self._owner.close()

    def keep(self, target: Path) -> Path:
        """Give the file a name beside that of `target`, which it could not take the place of; return where it is."""
        self._owner.close()
        self._is_kept = True
        kept = target.with_name(f"{target.stem}-{secrets.token_hex(3)}{target.suffix}")
        with contextlib.suppress(OSError):  # in a folder that has become read-only it stays as it is
            os.rename(self.path, kept)
            self.path = kept
        return self.path

    def remove(self) -> None:
        """Remove the file, unless it has been moved or kept."""
        self._owner.close()
        if not self._is_kept:
            self.path.unlink(missing_ok=True)


def move_in_use(move: Callable[[Path, Path], object], path: Path, target: Path) -> None:
    """Move a file, by os.replace or os.rename; on Windows, where neither file may be open, as soon as it can be."""
    until = time.monotonic() + IN_USE_SECONDS
    while True:
        try:
            move(path, target)
        except PermissionError:
            if sys.platform != "win32" or time.monotonic() > until:
                raise
            time.sleep(0.05)
        else:
            return


def sweep_unfinished(folder: Path) -> None:
    """Remove the unfinished files in a folder whose processes are gone; what cannot be looked at stays."""
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for name in [entry.name for entry in entries if NAME.fullmatch(entry.name)]:
            with contextlib.suppress(OSError):
                _remove_abandoned(folder / name)


def _remove_abandoned(path: Path) -> None:
    age = time.time() - path.stat().st_mtime
    if sys.platform == "win32":
        if age > NEW_SECONDS:
            path.unlink()
        return
    if age < FOREIGN_SECONDS and not path.name.startswith(PREFIX + MACHINE):
        return
    with path.open("rb") as file:
        _lock(file)
        path.unlink()


def _lock(file: IO[bytes]) -> None:
    """Lock a file until it is closed; BlockingIOError where somebody holds it, OSError where files have no locks."""
    if sys.platform != "win32":
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
