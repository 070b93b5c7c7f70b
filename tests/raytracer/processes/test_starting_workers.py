"""Worker processes start wherever their parent runs, or say why they cannot, and end with it."""

import errno
import importlib
import itertools
import os
import socket
import subprocess
import sys
import textwrap
import time

import numpy as np
import pytest

from raytracer.processes import child
from raytracer.processes.python import ONE_THREAD
from raytracer.processes.workers import WorkerError, Workers
from tests.folders import ROOT
from tests.portable import count_handles, is_running
from tests.raytracer.processes.worker_fixtures import PATIENCE, functions

__all__ = ["functions"]  # a fixture


def test_workers_that_cannot_be_started_are_an_error_in_words_and_leave_none_behind(functions, monkeypatch):
    started, start = [], child.start_process

    def refuse(*arguments, **options):
        if len(started) == 2:
            raise OSError(errno.EAGAIN, "Resource temporarily unavailable")
        started.append(start(*arguments, **options))
        return started[-1]

    monkeypatch.setattr(child, "start_process", refuse)
    with pytest.raises(WorkerError, match=r"^a worker process cannot be started: Resource temporarily unavailable$"):
        Workers(3)
    assert [process.poll() is None for process in started] == [False, False]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows shares memory by name")
def test_a_worker_without_room_for_its_socket_is_an_error_in_words(functions, monkeypatch):
    """It was an OSError, which renders do not keep their film at, and the other processes went on."""
    made, make, started, start = itertools.count(), socket.socketpair, [], child.start_process

    def refuse():
        if next(made) == 2:
            raise OSError(errno.EMFILE, "Too many open files")
        return make()

    def note(*arguments, **options):
        started.append(start(*arguments, **options))
        return started[-1]

    monkeypatch.setattr(child, "start_process", note)
    monkeypatch.setattr(socket, "socketpair", refuse)
    handles = count_handles()
    with pytest.raises(WorkerError, match=r"^a worker process cannot be started: Too many open files$"):
        Workers(3)
    assert [process.poll() is None for process in started] == [False, False]
    assert count_handles() == handles


def test_workers_use_one_thread_and_neither_bpy_nor_the_working_directory(functions, tmp_path, monkeypatch):
    trap = tmp_path / "trap"
    trap.mkdir()
    (trap / "random.py").write_text("raise SystemExit('imported from the working directory')", encoding="utf-8")
    monkeypatch.chdir(trap)
    with Workers(1) as workers:
        workers.load(functions.make, "tell_environment")
        environment, modules, path = next(workers.run([0]))
    assert ONE_THREAD.items() <= environment.items()
    assert "bpy" not in modules
    assert str(trap) not in path


def test_workers_start_whatever_a_script_put_among_the_import_paths(functions, monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "path", [tmp_path, b"bytes", *sys.path])  # Python passes over what is no text
    with Workers(1) as workers:
        workers.load(functions.Scale, np.arange(5))
        assert list(workers.run([3])) == [3]


def test_workers_ignore_what_their_parent_ignores_as_blender_does(tmp_path):
    """What a pipeline sets for another Python, and Blender does not heed, reached them."""
    code = "from raytracer.processes.workers import Workers; workers = Workers(1); workers.load(dict); workers.close()"
    command = [sys.executable, "-E", "-c", f"import sys; sys.path.insert(0, {str(ROOT)!r}); {code}"]
    environment = os.environ | {"PYTHONHOME": str(tmp_path), "PYTHONPROFILEIMPORTTIME": "1"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_folder_with_the_separator_of_paths_in_its_name_holds_modules(functions, tmp_path, monkeypatch):
    """Its two halves were looked into, and workers that needed it ended."""
    folder = tmp_path / f"a{os.pathsep}b"
    folder.mkdir()
    (folder / "separated.py").write_text("def make():\n    return abs\n", encoding="utf-8")
    monkeypatch.syspath_prepend(str(folder))
    with Workers(1) as workers:
        workers.load(importlib.import_module("separated").make)
        assert list(workers.run([-3])) == [3]


def test_a_blender_that_knows_no_python_program_has_no_workers_in_words(monkeypatch):
    """It was a TypeError of Popen's."""
    monkeypatch.setattr(sys, "executable", None)
    with pytest.raises(WorkerError, match=r"^a worker process cannot be started: no Python program was found"):
        Workers(1)


def test_script_without_main_guard_is_not_run_again(functions, tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        textwrap.dedent("""
            print("script runs", flush=True)
            import worker_functions
            from raytracer.processes.workers import Workers
            with Workers(2) as workers:
                workers.load(worker_functions.make, "sleep_less_later")
                print(sum(workers.run(range(10))))
        """),
        encoding="utf-8",
    )
    paths = os.pathsep.join([str(ROOT), str(tmp_path)])
    done = subprocess.run(
        [sys.executable, str(script)],
        env=os.environ | {"PYTHONPATH": paths},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "script runs\n45\n"
    assert done.stderr == ""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows shares memory by name")
def test_workers_serve_a_process_whose_standard_files_are_closed(functions, tmp_path):
    """A daemon's: what memory comes through got the number of the child's standard output."""
    script = tmp_path / "script.py"
    script.write_text(
        textwrap.dedent("""
            import os, sys
            import numpy as np
            import worker_functions
            from raytracer.processes.workers import Workers
            for number in range(3):
                os.close(number)
            with Workers(1) as workers:
                workers.load(worker_functions.Scale, np.arange(1000.0))
                result = list(workers.run([3]))
            with open(sys.argv[1], "w") as file:
                file.write(str(result))
        """),
        encoding="utf-8",
    )
    paths = os.pathsep.join([str(ROOT), str(tmp_path)])
    subprocess.run([sys.executable, script, tmp_path / "result"], env=os.environ | {"PYTHONPATH": paths}, check=False)
    assert (tmp_path / "result").read_text(encoding="utf-8") == "[3.0]"


def test_workers_end_at_once_when_their_parent_is_killed(functions, tmp_path):
    script = tmp_path / "parent.py"
    script.write_text(
        textwrap.dedent("""
            import worker_functions
            from raytracer.processes.workers import Workers
            workers = Workers(2)
            workers.load(worker_functions.make, "sleep_long")
            print(*workers.process_ids, flush=True)
            list(workers.run(range(9)))
        """),
        encoding="utf-8",
    )
    folder = tmp_path / "temporary"
    folder.mkdir()
    paths = os.pathsep.join([str(ROOT), str(tmp_path)])
    environment = os.environ | {"PYTHONPATH": paths} | dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(folder))
    with subprocess.Popen([sys.executable, str(script)], env=environment, stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        ids = [int(word) for word in parent.stdout.readline().split()]
        assert len(ids) == 2
        assert all(is_running(process_id) for process_id in ids)
        time.sleep(0.5)  # both are at work by now
        parent.kill()
    # Jobs of a minute are under way: only an end that does not wait for them is in time.
    end = time.perf_counter() + PATIENCE / 10
    while any(is_running(process_id) for process_id in ids):
        assert time.perf_counter() < end, "a worker lives on"
        time.sleep(0.01)
    assert list(folder.iterdir()) == []
