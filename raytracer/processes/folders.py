"""Folders for files that other programs need: removed by their process, or by the next one if that was killed.

Whoever owns a folder holds its file OWNER: locked on POSIX, open on Windows, where an open file cannot be removed. Both
end with the process, however it ends.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import IO

OWNER = "owner"
# Seconds that a folder is left alone: it may be one that is being made.
NEW_SECONDS = 60.0


class OwnedFolder:
    """A folder among the temporary files, `path`; close it."""

    def __init__(self, prefix: str) -> None:
        sweep(prefix)
        self.path = Path(tempfile.mkdtemp(prefix=prefix))
        self._owner = open(self.path / OWNER, "wb")  # noqa: SIM115 (open as long as the folder is owned)
        _lock(self._owner)

    def close(self) -> None:
        """Remove the folder and all that is in it; may be called again."""
        self._owner.close()
        _remove(self.path)


def sweep(prefix: str) -> None:
    """Remove the folders of processes that are gone."""
    for folder in Path(tempfile.gettempdir()).glob(f"{prefix}*"):
        if _is_abandoned(folder / OWNER):
            _remove(folder)


def _remove(folder: Path) -> None:
    """Remove a folder; where something in it cannot be yet, as a file that is read on Windows, let the next one do it.

    Only what has an OWNER is known to be ours.
    """
    shutil.rmtree(folder, ignore_errors=True)
    if folder.is_dir():
        with suppress(OSError):
            (folder / OWNER).touch()


def _is_abandoned(owner: Path) -> bool:
    """Return whether a folder is not new and nobody holds its file OWNER, which on Windows is gone then."""
    try:
        if time.time() - owner.stat().st_mtime < NEW_SECONDS:
            return False
        if sys.platform == "win32":
            owner.unlink()
            return True
        with open(owner, "rb") as file:
            _lock(file)
    except OSError:  # it is held, or another user's, or none of ours
        return False
    return True


def _lock(file: IO[bytes]) -> None:
    """Lock a file until it is closed, or raise BlockingIOError; on Windows being open is enough."""
    if sys.platform != "win32":
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
