"""Write a file whole or not at all: into a new one beside it, checked and on the disk, which then takes its place.

A full disk, an error or a killed process leaves what was there before as it was. `os.replace` is one step for whoever
looks at the path, on POSIX and on Windows, within one file system; so the new file stands in the same folder. One that
a killed process left there is removed by the next who writes into the folder (`unfinished`).
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from raytracer.files.unfinished import PREFIX, NewFile, move_in_use, sweep_unfinished


@contextlib.contextmanager
def replace_file(
    path: str | Path, check: Callable[[Path], None] | None = None, keep_unmoved: bool = False
) -> Iterator[Path]:
    """Hand out an empty file beside `path`, with its suffix, that replaces it at the end of the block.

    check : looks at what was written and raises ValueError, a sentence without the path, where it is not whole
    keep_unmoved : True where what was written took long, and stays under a name that the error tells, if it is whole
        and only cannot take the place of `path`

    Raises
    ------
    OSError
        If it cannot be written; it names `path`, never the new file.
    ValueError
        If `check` does, naming `path`.
    """
    target = find_target(path)
    sweep_unfinished(target.parent)
    with name_in_errors(path):
        new = NewFile(target)
    try:
        with name_in_errors(path):
            yield new.path
            if check is not None:
                check_whole(new.path, path, check)
            move_over(new, target, keep_unmoved)
    finally:
        new.remove()


def write_bytes(path: str | Path, content: bytes) -> None:
    """Write `content` as the whole file."""
    with replace_file(path) as new:
        new.write_bytes(content)


def write_text(path: str | Path, text: str) -> None:
    """Write `text` as the whole file, in UTF-8."""
    write_bytes(path, text.encode("utf-8"))


def check_replaceable(path: str | Path) -> None:
    """Raise OSError naming `path` where nothing could be written to it, and leave no trace."""
    target = find_target(path)
    with name_in_errors(path):
        NewFile(target).remove()
        if sys.platform == "win32" and target.exists():  # one that is open cannot be replaced, nor renamed
            move_in_use(os.rename, target, target)


def find_target(path: str | Path) -> Path:
    """Return the file that `path` leads to: a link stays a link, to what is written.

    Raises
    ------
    OSError
        If it is something other than a file (a folder, a device), or protected from writing.
    """
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if target.exists() and not target.is_file():
        raise OSError(errno.EINVAL, "not a file that can be replaced", str(path))
    if target.exists() and not os.access(target, os.W_OK):
        raise OSError(errno.EACCES, os.strerror(errno.EACCES), str(path))
    return target


def check_whole(new: Path, path: str | Path, check: Callable[[Path], None]) -> None:
    """Check what was written; the sentence names `path`."""
    try:
        check(new)
    except ValueError as error:
        raise ValueError(f"{path}: not written: {error}") from None


def move_over(new: NewFile, target: Path, keep_unmoved: bool = False) -> None:
    """Let a new file, once it is on the disk, take the place of `target` and the permissions of what stood there."""
    with new.path.open("r+b") as written:
        os.fsync(written.fileno())
    if target.exists():
        new.path.chmod(stat.S_IMODE(target.stat().st_mode))
    try:
        new.move(target)
    except OSError as error:
        if not keep_unmoved:
            raise
        kept = new.keep(target)
        raise OSError(error.errno, f"{error.strerror}; what was written is in {kept}", error.filename) from error


@contextlib.contextmanager
def name_in_errors(path: str | Path) -> Iterator[None]:
    """Let OSErrors of new files, and those that name no file (a full disk), name `path`."""
    try:
        yield
    except OSError as error:
        named = "" if error.filename is None else Path(os.fsdecode(error.filename)).name
        if error.errno is None or not named.startswith(PREFIX if named else ""):
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error
