"""Questions about processes that each system answers in its own way."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from pathlib import Path

PROCESS_QUERY, STILL_ACTIVE = 0x1000, 259


def is_running(process_id: int) -> bool:
    """Return whether a process has not ended; one that nobody has asked about yet (a zombie) has."""
    if sys.platform == "win32":
        return _is_running_on_windows(process_id)
    try:
        os.kill(process_id, 0)
        return Path(f"/proc/{process_id}/stat").read_text(encoding="utf-8").rsplit(")", 1)[1].split()[0] != "Z"
    except ProcessLookupError:
        return False
    except FileNotFoundError:  # macOS has no /proc
        return not Path("/proc/self").exists()


def _is_running_on_windows(process_id: int) -> bool:
    kernel = ctypes.windll.kernel32  # type: ignore[attr-defined]
    handle = kernel.OpenProcess(PROCESS_QUERY, False, process_id)
    if not handle:
        return False
    code = ctypes.c_ulong()
    kernel.GetExitCodeProcess(handle, ctypes.byref(code))
    kernel.CloseHandle(handle)
    return code.value == STILL_ACTIVE


def kill(process_id: int) -> None:
    """End a process at once; Windows knows no SIGKILL, and every other signal does this there."""
    os.kill(process_id, getattr(signal, "SIGKILL", signal.SIGTERM))


def count_handles() -> int:
    """Return the number of files, sockets and mappings that this process has open."""
    if sys.platform == "win32":
        count = ctypes.c_ulong()
        kernel = ctypes.windll.kernel32
        kernel.GetProcessHandleCount(ctypes.c_void_p(kernel.GetCurrentProcess()), ctypes.byref(count))
        return count.value
    return len(os.listdir("/dev/fd"))
