"""How a Python process of our own is started, from Blender or outside of it."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

# The libraries NumPy may take its linear algebra from; workers are parallel already.
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"
)


def make_python_command(code: str) -> list[str]:
    """Return the command that runs `code` in a fresh Python, which finds the same modules; -P: no file in the working
    directory stands in for one.

    The paths go with the code: PYTHONPATH has no way to name a folder with its separator.

    Raises
    ------
    FileNotFoundError
        If there is no Python that could be started, as in a Blender that finds none.
    """
    if not sys.executable:
        raise FileNotFoundError(errno.ENOENT, "no Python program was found beside this one")
    return [sys.executable, "-P", "-c", f"import sys; sys.path[:0] = {_list_import_paths()!r}; {code}"]


def make_python_environment() -> dict[str, str]:
    """Return the environment of a fresh Python that computes in one thread; what this Python ignores, as Blender's does
    PYTHONHOME, it shall not heed either."""
    heeded = dict(os.environ)
    if sys.flags.ignore_environment:
        heeded = {name: value for name, value in heeded.items() if not name.startswith("PYTHON")}
    return heeded | ONE_THREAD


def _list_import_paths() -> list[str]:
    """Return where modules come from: this package first, then as in this process, without the working directory and
    what Python itself passes over, such as a script's Path."""
    package = str(Path(__file__).resolve().parents[__name__.count(".")])
    return [package, *(path for path in sys.path if isinstance(path, str) and os.path.isabs(path) and path != package)]


def start_process(command: Sequence[str], **options: Any) -> subprocess.Popen[bytes]:
    """Start a process that opens no window; `options` are Popen's.

    What it says on standard error goes where ours goes, or nowhere: Blender on Windows may have none to pass on.
    """
    errors = {"stderr": None if has_standard_error() else subprocess.DEVNULL}
    settings: Any = {"creationflags": getattr(subprocess, "CREATE_NO_WINDOW", 0), **errors, **options}
    return subprocess.Popen(command, **settings)


def print_traceback(error: BaseException) -> None:
    """Print where an error happened, where there is a place for it."""
    with suppress(OSError, ValueError):  # a window without a console: standard error leads nowhere
        traceback.print_exception(error)


def has_standard_error() -> bool:
    """Return whether the system knows of a standard error of this process."""
    try:
        os.fstat(2)
    except OSError:
        return False
    return True
