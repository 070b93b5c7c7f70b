"""What is asked about processes, on whichever system this is."""

from __future__ import annotations

import subprocess
import sys
import time

import numpy as np
import pytest

from tests.portable import is_running, kill, measure_work, parse_time, read_memory

# A process that works for so many processor seconds, says so, and waits.
WORK = (
    "import sys, time; end = time.process_time() + 1.5\nwhile time.process_time() < end: pass\n"
    "print(time.process_time(), flush=True); sys.stdin.read()"
)


def test_the_work_of_a_process_and_its_end_are_seen() -> None:
    begun = time.monotonic()
    with subprocess.Popen([sys.executable, "-c", WORK], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        said = float(process.stdout.readline())
        # `ps` may count whole seconds; on Windows the start of a process is work that it knows nothing of.
        assert said - 1.1 < measure_work(process.pid) < time.monotonic() - begun + 1.1
        assert is_running(process.pid)
        kill(process.pid)
        process.wait()
        assert not is_running(process.pid)


@pytest.mark.parametrize(
    ("text", "seconds"), [("0:01.25\n", 1.25), (" 00:00:03", 3.0), ("01:02:03", 3723.0), ("2-00:00:01", 172801.0)]
)
def test_times_as_ps_writes_them_are_understood(text: str, seconds: float) -> None:
    assert parse_time(text) == seconds


def test_memory_is_counted_when_it_is_touched() -> None:
    held, most = read_memory()
    assert 1 < held <= most
    block = np.ones(int(200e6) // 8)
    time.sleep(0.01)
    assert 190 < read_memory()[0] - held < 250
    del block
    assert read_memory()[1] >= held + 190
