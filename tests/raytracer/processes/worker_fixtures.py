"""What the tests of worker processes share: a module that workers load from, and how long they wait."""

import sys
import textwrap

import pytest

# Seconds; a test that waits longer has failed.
PATIENCE = 60.0
# Workers import this by name: it stands in for what the renderer loads.
FUNCTIONS = """
    import os
    import sys
    import time

    class Scale:
        def __init__(self, array, factor=1):
            self.array, self.factor = array, factor

        def __call__(self, job):
            return self.array[job] * self.factor

    class Look:
        def __init__(self, *contents):
            self.contents = contents

        def __call__(self, job):
            if job == "read-only":
                flags = [content.flags for content in self.contents]
                return [index for index, flag in enumerate(flags[:-1]) if not flag.writeable]
            return self.contents[job]

    def fail_to_load():
        raise ValueError("no such scene")

    def make(name):
        return globals()[name]

    def sleep_less_later(job):
        time.sleep(0.05 / (1 + job))
        return job

    def sleep_long(job):
        time.sleep(60)

    def fail(job):
        raise ValueError(f"job {job} is wrong")

    def exit_suddenly(job):
        if job == 3:
            os._exit(7)
        return job

    def print_much(job):
        print("noise" * 1000)
        return job

    def tell_environment(job):
        return dict(os.environ), sorted(sys.modules), sys.path

    def use_up_memory(job):
        import numpy
        return numpy.empty(1 << 60, numpy.uint8)

    def read_standard_input(job):
        return sys.stdin.read()
"""


@pytest.fixture
def functions(tmp_path, monkeypatch):
    """Return a module that workers can import, from a folder that only this process's sys.path tells of."""
    (tmp_path / "worker_functions.py").write_text(textwrap.dedent(FUNCTIONS), encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    sys.modules.pop("worker_functions", None)
    import worker_functions  # type: ignore[import-not-found]

    yield worker_functions
    sys.modules.pop("worker_functions", None)
