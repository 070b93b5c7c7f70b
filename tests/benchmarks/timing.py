"""Fair timing on a noisy machine: one core, casts taking turns, medians; and what the numbers were measured on.

What is timed is the processor's time that the process took, all of its threads together: other programs on the machine
do not count, and a library that runs threads of its own gains nothing by them.
"""

from __future__ import annotations

import os
import platform
import statistics
import sys
import time
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path


@contextmanager
def one_core():
    """Keep this process, and threads that start meanwhile, on one core where the system allows to ask for that."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)


def take_turns(casts, rounds):
    """Return name -> median seconds of the processor for callables that take turns: A B C, A B C, ...

    Drift of the machine's speed then meets all of them alike. Each is called once before, unmeasured.
    """
    for cast in casts.values():
        cast()
    seconds = {name: [] for name in casts}
    for _ in range(rounds):
        for name, cast in casts.items():
            seconds[name].append(measure(cast)[1])
    return {name: statistics.median(values) for name, values in seconds.items()}


def measure(function):
    """Return (result, seconds of the processor) of one call."""
    started = time.process_time()
    result = function()
    return result, time.process_time() - started


def describe_machine():
    """Return what the numbers depend on, and when they were taken."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "processor": read_processor(),
        "cores": os.cpu_count(),
        "load": load,
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
    }


def read_processor():
    """Return the processor's name as the system gives it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or sys.platform
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "unknown")
