"""How to run scripts in a Blender of their own: this application, or Python where bpy is a module."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import bpy

from raytracer.processes.python import start_process

# Where Blender and Python look for the folder of temporary files.
TEMPORARY = ("TMPDIR", "TMP", "TEMP")
CHILD = Path(__file__).with_name("child.py")


def list_command(script: Path) -> list[str]:
    """Return the command that runs a script; its arguments follow."""
    if bpy.app.binary_path:
        return [bpy.app.binary_path, "-b", "--factory-startup", "-noaudio", "-P", str(script), "--"]
    return [sys.executable, str(script)]


def list_orders_command(module: str, folder: Path) -> list[str]:
    """Return the command of a process that carries out orders by a module, 'voxels.sampling' say, in a folder."""
    return [*list_command(CHILD), module, str(folder)]


def start_blender(command: Sequence[str], folder: Path, **options: Any) -> subprocess.Popen[bytes]:
    """Start a Blender whose own temporary files lie in `folder`: it is ended by force, and leaves them to who removes
    that; `options` are Popen's."""
    return start_process(command, env=os.environ | dict.fromkeys(TEMPORARY, str(folder)), **options)


def tell(process: subprocess.Popen[bytes], line: str) -> None:
    """Send a line to a process that carries out orders; one that has ended hears nothing, as its answers say."""
    assert process.stdin is not None
    with suppress(OSError):  # of a pipe that nobody reads: EPIPE on POSIX, EINVAL on Windows
        process.stdin.write(f"{line}\n".encode())
        process.stdin.flush()


def end(process: subprocess.Popen[bytes]) -> None:
    """End a process that carries out orders, whatever it is at."""
    process.kill()
    process.wait()
    assert process.stdin is not None
    with suppress(OSError):  # what it was not told any more leaves the buffer here, and has nowhere to go
        process.stdin.close()


def describe(error: OSError) -> str:
    """Return what the system says of a file, or of a process, as a sentence."""
    return f"{error.filename}: {error.strerror}" if error.filename else error.strerror or str(error)
