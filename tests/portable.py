"""Questions about processes that each system answers in its own way."""

from __future__ import annotations

import ctypes
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

PROCESS_QUERY, STILL_ACTIVE = 0x1000, 259
# Windows counts processor time in units of 100 ns.
TICKS_PER_SECOND = 1e7


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


def measure_work(process_id: int) -> float:
    """Return the processor seconds that a process has used so far."""
    if sys.platform == "win32":
        return _measure_work_on_windows(process_id)
    stat = Path(f"/proc/{process_id}/stat")
    if stat.exists():
        fields = stat.read_text(encoding="utf-8").rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return parse_time(_ask_ps("time", process_id))


def _measure_work_on_windows(process_id: int) -> float:
    kernel = ctypes.windll.kernel32  # type: ignore[attr-defined]
    handle = ctypes.c_void_p(kernel.OpenProcess(PROCESS_QUERY, False, process_id))
    times = (ctypes.c_ulonglong * 4)()  # creation, exit, kernel, user
    places = [ctypes.byref(times, 8 * number) for number in range(4)]
    kernel.GetProcessTimes(handle, *places)
    kernel.CloseHandle(handle)
    return (times[2] + times[3]) / TICKS_PER_SECOND


def parse_time(text: str) -> float:
    """Return the seconds of what `ps` says: [[days-]hours:]minutes:seconds."""
    seconds = 0.0
    for part, unit in zip(reversed(re.split("[-:]", text.strip())), (1, 60, 3600, 86400), strict=False):
        seconds += float(part) * unit
    return seconds


def read_memory() -> tuple[float, float]:
    """Return the memory that this process holds, and the most that it ever held, in 10^6 bytes."""
    if sys.platform == "win32":
        return _read_memory_on_windows()
    status = Path("/proc/self/status")
    if status.exists():  # what getrusage says is the most, a process inherits from the one that started it
        text = status.read_text(encoding="utf-8")
        held, most = (int(text.split(f"{name}:")[1].split()[0]) for name in ("VmRSS", "VmHWM"))
        return held * 1024 / 1e6, most * 1024 / 1e6
    import resource

    unit = 1 if sys.platform == "darwin" else 1024  # getrusage counts bytes on macOS
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
    return int(_ask_ps("rss", os.getpid())) * 1024 / 1e6, most / 1e6


def _read_memory_on_windows() -> tuple[float, float]:
    kernel = ctypes.windll.kernel32  # type: ignore[attr-defined]
    # PROCESS_MEMORY_COUNTERS: two 32-bit numbers, then sizes: the most that was held, what is held, and more.
    counters = (ctypes.c_size_t * 9)()
    size = ctypes.sizeof(counters)
    kernel.K32GetProcessMemoryInfo(ctypes.c_void_p(kernel.GetCurrentProcess()), counters, size)
    return counters[2] / 1e6, counters[1] / 1e6


def _ask_ps(field: str, process_id: int) -> str:
    command = ["ps", "-o", f"{field}=", "-p", str(process_id)]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout
