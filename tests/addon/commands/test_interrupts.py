"""Ctrl-C, and kills: the command line ends at once, in one line, with the shell's code, and leaves nothing behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from addon import interrupts
from raytracer.processes.folders import NEW_SECONDS, OWNER
from tests.addon.engine.engine_fixtures import save_plane
from tests.folders import ROOT

pytestmark = [
    pytest.mark.blender,
    pytest.mark.skipif(os.name == "nt", reason="Windows sends Ctrl-C to whole consoles only"),
]
OPTIONS = ("--size", "640x640", "--samples", 4096, "--workers", 1)
COMPARE = ("--with", "cycles", "--size", "16x16", "--samples", 8)


@pytest.fixture(scope="module")
def blend(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_plane(tmp_path_factory.mktemp("blend") / "plane.blend")


def run_python(*arguments: object, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run Python with Ctrl-C as a terminal gives it: what a shell starts in the background ignores it, and passes that
    on."""
    command, variables = [sys.executable, *map(str, arguments)], os.environ | environment
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        return subprocess.run(
            command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=300, env=variables
        )  # fmt: skip
    finally:
        signal.signal(signal.SIGINT, before)


def assert_interrupted(done: subprocess.CompletedProcess[str]) -> None:
    assert (done.returncode, done.stdout, done.stderr) == (interrupts.EXIT_CODE, "", interrupts.LINE)


# The command line, to which Ctrl-C comes so many seconds after it has begun.
LATER = """
import contextlib, os, signal, sys, threading
from addon import interrupts
from addon.commands import command_line
timer = threading.Timer(float(sys.argv.pop(1)), os.kill, (os.getpid(), signal.SIGINT))
timer.daemon = True
listen = interrupts.listen
@contextlib.contextmanager
def listen_and_start():
    with listen():
        timer.start()
        yield
interrupts.listen = listen_and_start
code = command_line.main(sys.argv[1:])
exec("")
sys.exit(code)
"""
QUICK_DELAYS = (0.0, 0.3, 0.8, 1.5)
MORE_DELAYS = [pytest.param(0.1 * k, marks=pytest.mark.slow) for k in range(1, 30)]


@pytest.mark.parametrize("delay", [*QUICK_DELAYS, *MORE_DELAYS])
def test_an_interrupt_at_any_time_ends_in_one_line(blend: Path, tmp_path: Path, delay: float) -> None:
    out = tmp_path / "a.png"
    out.write_bytes(b"old")
    assert_interrupted(run_python("-c", LATER, delay, "render", blend, "-o", out, *OPTIONS))
    assert out.read_bytes() == b"old"
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]


# The command line, to which Ctrl-C comes where a function is called: "module:name"; "wait" for half a minute after it,
# in Python, as a large scene would take, or "go on" at once.
THERE = """
import importlib, os, signal, sys, time
from addon import interrupts
from addon.commands import command_line
place, way = sys.argv.pop(1), sys.argv.pop(1)
with interrupts.hold():
    import bpy
module, name = place.split(":")
module = importlib.import_module(module)
function = getattr(module, name)
def interrupted(*arguments, **named):
    os.kill(os.getpid(), signal.SIGINT)
    end = time.monotonic() + 30 * (way == "wait")
    while time.monotonic() < end:
        time.sleep(0.01)
    return function(*arguments, **named)
setattr(module, name, interrupted)
begun = time.monotonic()
code = command_line.main(sys.argv[1:])
sys.exit(code if time.monotonic() - begun < 15 else "it waited")
"""
READING = "addon.engine.engine:extract_scene"


def test_an_interrupt_while_the_scene_is_read_ends_at_once(blend: Path, tmp_path: Path) -> None:
    out = tmp_path / "a.png"
    assert_interrupted(run_python("-c", THERE, READING, "wait", "render", blend, "-o", out, *OPTIONS))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("place", "way"), [(READING, "wait"), ("addon.compare.cycles.rendering:exr_output", "go on")])
def test_an_interrupt_in_a_comparison_ends_it_in_the_same_way(
    blend: Path, tmp_path: Path, place: str, way: str
) -> None:
    out = tmp_path / "map.png"
    done = run_python("-c", THERE, place, way, "compare", blend, *COMPARE, "-o", out, TMPDIR=str(tmp_path))
    assert_interrupted(done)
    assert not list(tmp_path.iterdir())


# Ctrl-C comes in a callback of Blender's, before Cycles renders, and nothing may be rendered after that.
IN_BLENDER = """
import os, signal, sys
from addon.commands import command_line
open_blend, renders = command_line.open_blend, []
def open_and_wait(*arguments):
    bpy = open_blend(*arguments)
    def interrupt(scene, *rest):
        renders.append(scene.render.engine)
        if scene.render.engine == "CYCLES":
            os.kill(os.getpid(), signal.SIGINT)
    bpy.app.handlers.render_pre.append(interrupt)
    return bpy
from addon.commands import compare
compare.open_blend = open_and_wait
code = command_line.main(sys.argv[1:])
sys.exit(code if renders.count("CYCLES") == 1 else f"{renders}")
"""


def test_an_interrupt_while_cycles_renders_ends_the_comparison_after_that_picture(blend: Path) -> None:
    assert_interrupted(run_python("-c", IN_BLENDER, "compare", blend, *COMPARE))


def test_an_interrupt_while_the_benchmark_runs_ends_in_one_line() -> None:
    options = ("bench", "--sections", "accuracy", "--rays", 8)
    assert_interrupted(run_python("-c", THERE, "tests.benchmarks.run:measure_accuracy", "wait", *options))


@pytest.mark.parametrize("module", ["argparse", "gettext"])
def test_an_interrupt_before_the_command_line_listens_ends_in_one_line(tmp_path: Path, module: str) -> None:
    """A module of Python's that is imported at the very first stands for any moment of the start."""
    (tmp_path / f"{module}.py").write_text("import os, signal; os.kill(os.getpid(), signal.SIGINT)", encoding="utf-8")
    assert_interrupted(run_python("-m", "addon", "--help", PYTHONPATH=str(tmp_path)))


def test_an_interrupt_inside_an_exec_ends_with_the_same_code(tmp_path: Path) -> None:
    text = 'exec("import os, signal; os.kill(os.getpid(), signal.SIGINT); [None for _ in range(99)]")'
    (tmp_path / "argparse.py").write_text(text, encoding="utf-8")
    assert_interrupted(run_python("-m", "addon", "--help", PYTHONPATH=str(tmp_path)))


def test_a_second_interrupt_ends_what_cannot_be_interrupted_with_the_same_line() -> None:
    code = (
        "import os, signal; from addon import interrupts; interrupts.tell_through(2)\n"
        "with interrupts.listen(), interrupts.hold():\n"
        "    for _ in range(2): os.kill(os.getpid(), signal.SIGINT)\n"
    )
    assert_interrupted(run_python("-c", code))


# Ctrl-C comes while compiled code runs that never looks at it, as Cycles is: a hash that would take a minute.
DEAF = """
import hashlib, os, signal, threading
from addon import interrupts
interrupts.tell_through(2)
with interrupts.listen(), interrupts.tidying(lambda: print("tidy", flush=True)), interrupts.hold():
    with interrupts.tidying(lambda: 1 / 0):
        threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
        hashlib.pbkdf2_hmac("sha256", b"", b"", 10**8)
"""


def test_an_interrupt_that_nothing_looks_at_ends_the_process_which_tidies_up() -> None:
    done = run_python("-c", DEAF)
    assert (done.returncode, done.stdout, done.stderr) == (interrupts.EXIT_CODE, "tidy\n", interrupts.LINE)


def test_a_handler_in_c_gives_way_to_the_default(monkeypatch: pytest.MonkeyPatch) -> None:
    """The application in the background has one, None to Python, which cannot bring it back: every command failed."""
    before, set_handler = signal.getsignal(signal.SIGINT), signal.signal
    try:
        with monkeypatch.context() as patch:
            patch.setattr(signal, "signal", lambda number, handler: (set_handler(number, handler), None)[1])
            with interrupts.listen(), interrupts.listen_for(signal.SIGTERM):
                assert signal.getsignal(signal.SIGINT) == signal.getsignal(signal.SIGTERM) == interrupts._note
        assert signal.getsignal(signal.SIGINT) == signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
    finally:
        signal.signal(signal.SIGINT, before)


def test_an_interrupt_waits_in_hold_and_not_in_release() -> None:
    code = (
        "import os, signal; from addon import interrupts\n"
        "def press(): os.kill(os.getpid(), signal.SIGINT)\n"
        "def run(inner, *calls):\n"
        "    try:\n"
        "        with interrupts.listen(), interrupts.hold():\n"
        "            with inner():\n"
        "                for call in calls: call()\n"
        "                print('on', end=' ')\n"
        "            print('after', end=' ')\n"
        "    except KeyboardInterrupt: print('end', interrupts._State.depth, interrupts._State.is_noted)\n"
        "run(interrupts.hold, press)\n"
        "run(interrupts.release, press)\n"
        "try:\n"
        "    with interrupts.listen(), interrupts.hold():\n"
        "        press()\n"
        "        with interrupts.release(): print('never')\n"
        "except KeyboardInterrupt: print('end')\n"
    )
    done = run_python("-c", code)
    assert done.stdout.splitlines() == ["on after end 0 False", "end 0 False", "end"], done.stderr


# A comparison that is killed while it reads the picture that Cycles or this engine made.
KILLED = """
import os, signal, sys
from addon.commands import command_line
with __import__("addon.interrupts").interrupts.hold():
    import bpy
from addon.compare.cycles import rendering
rendering.read_exr = lambda path: os.kill(os.getpid(), signal.SIGKILL)
command_line.main(sys.argv[1:])
"""


def test_the_pictures_of_a_killed_comparison_are_removed_by_the_next(blend: Path, tmp_path: Path) -> None:
    assert run_python("-c", KILLED, "compare", blend, *COMPARE, TMPDIR=str(tmp_path)).returncode == -9
    (left,) = tmp_path.glob("raytracer_*")
    assert {path.name for path in left.iterdir()} == {OWNER, "passes.exr"}
    past = time.time() - 2 * NEW_SECONDS
    os.utime(left / OWNER, (past, past))
    assert run_python("-m", "addon", "compare", blend, *COMPARE, TMPDIR=str(tmp_path)).returncode == 0
    assert not list(tmp_path.glob("raytracer_*"))
