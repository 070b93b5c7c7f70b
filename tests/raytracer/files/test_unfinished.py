"""Files that a killed process was writing are removed by the next who writes beside them; those of others stay."""

from __future__ import annotations

import errno
import itertools
import math
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

import raytracer.files.unfinished as unfinished
from raytracer.files.replacing import replace_file, write_bytes
from raytracer.files.unfinished import FOREIGN_SECONDS, NAME, NEW_SECONDS, PREFIX, NewFile, sweep_unfinished
from tests.folders import ROOT
from tests.portable import kill

WRITE = """
import sys
from raytracer.files.replacing import replace_file
with replace_file(sys.argv[1]) as new:
    new.write_bytes(b"half")
    print(new.name, flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def writer(tmp_path: Path) -> Iterator[tuple[subprocess.Popen[bytes], Path]]:
    """Yield a process that is writing `killed.bin`, and its unfinished file."""
    command = [sys.executable, "-c", WRITE, str(tmp_path / "killed.bin")]
    with subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        path = tmp_path / process.stdout.readline().decode().strip()
        yield process, path
        process.kill()


def make_old(path: Path) -> None:
    past = time.time() - 2 * NEW_SECONDS
    os.utime(path, (past, past))


def list_names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("name", ["killed.bin", "another.bin"])
def test_the_next_write_removes_what_a_killed_process_left(
    writer: tuple[subprocess.Popen[bytes], Path], name: str
) -> None:
    process, path = writer
    make_old(path)
    write_bytes(path.with_name(name), b"whole")
    assert path.read_bytes() == b"half"  # its process lives
    kill(process.pid)
    process.wait()
    write_bytes(path.with_name(name), b"whole")
    assert list_names(path.parent) == [name]


def test_what_this_process_writes_and_what_only_looks_like_it_stays(tmp_path: Path) -> None:
    others = [f"{PREFIX}notes.txt", f"{PREFIX}0123456789abcdef", f"x{PREFIX}0123456789ab", "0123456789ab"]
    for name in others:
        (tmp_path / name).touch()
        make_old(tmp_path / name)
    with replace_file(tmp_path / "outer.bin") as outer:
        make_old(outer)
        write_bytes(tmp_path / "inner.bin", b"inner")
        outer.write_bytes(b"outer")
    assert list_names(tmp_path) == sorted([*others, "outer.bin", "inner.bin"])


def test_a_file_that_was_swept_before_it_was_locked_is_made_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if sys.platform == "win32":
        pytest.skip("an open file cannot be removed on Windows")
    lock, swept = unfinished._lock, []

    def sweep_first(file: object) -> None:
        if not swept:
            swept.extend(tmp_path.iterdir())
            swept[0].unlink()
        lock(file)  # type: ignore[arg-type]

    monkeypatch.setattr(unfinished, "_lock", sweep_first)
    new = NewFile(tmp_path / "target.bin")
    assert new.path.exists()
    assert new.path not in swept
    new.remove()


def test_where_files_have_no_locks_files_are_written_and_none_is_swept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if sys.platform == "win32":
        pytest.skip("Windows needs no locks")

    def refuse(_: object) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(unfinished, "_lock", refuse)
    left = tmp_path / f"{PREFIX}0123456789ab.bin"
    left.touch()
    write_bytes(tmp_path / "target.bin", b"whole")
    sweep_unfinished(tmp_path)
    assert list_names(tmp_path) == [left.name, "target.bin"]


def test_what_another_machine_writes_stays_where_locks_are_known_to_their_own_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Machines that shared a folder removed each other's files while they were written."""
    if sys.platform == "win32":
        pytest.skip("Windows needs no locks")
    monkeypatch.setattr(unfinished, "_lock", lambda file: None)  # one that always succeeds
    with replace_file(tmp_path / "here.bin") as here:
        monkeypatch.setattr(unfinished, "MACHINE", "beef")
        write_bytes(tmp_path / "there.bin", b"there")
        assert here.exists()
        here.write_bytes(b"here")
    left = tmp_path / f"{PREFIX}0123456789ab.bin"
    left.touch()
    past = time.time() - 2 * FOREIGN_SECONDS
    os.utime(left, (past, past))
    sweep_unfinished(tmp_path)  # that machine was killed long ago
    assert list_names(tmp_path) == ["here.bin", "there.bin"]


def make_busy(monkeypatch: pytest.MonkeyPatch, times: float) -> None:
    """Let the system be Windows, and the next `times` moves find their target open."""
    replace, moves = os.replace, itertools.count()

    def refuse(path: Path, target: Path) -> None:
        if next(moves) < times:
            raise PermissionError(errno.EACCES, "Access is denied", str(path))
        replace(path, target)

    monkeypatch.setattr(unfinished, "sys", SimpleNamespace(platform="win32"))
    monkeypatch.setattr(os, "replace", refuse)


def test_on_windows_a_file_that_somebody_has_open_is_replaced_once_it_is_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who looked at a film while it was written ended the render."""
    make_busy(monkeypatch, times=3)
    write_bytes(tmp_path / "target.bin", b"whole")
    assert (tmp_path / "target.bin").read_bytes() == b"whole"
    make_busy(monkeypatch, times=math.inf)
    monkeypatch.setattr(unfinished, "IN_USE_SECONDS", 0.2)
    with pytest.raises(PermissionError):
        write_bytes(tmp_path / "target.bin", b"new")
    assert (tmp_path / "target.bin").read_bytes() == b"whole"
    assert list_names(tmp_path) == ["target.bin"]


@pytest.mark.parametrize("name", ["picture.png", f"{'long' * 62}.png"])
def test_what_took_long_stays_under_another_name_where_it_cannot_be_moved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """A picture of hours was removed where its old one was open in a viewer."""

    def refuse(path: Path, target: Path) -> None:
        raise PermissionError(errno.EACCES, "Permission denied", str(path))

    monkeypatch.setattr(os, "replace", refuse)
    target = tmp_path / name
    denied = pytest.raises(OSError, match="Permission denied; what was written is in")
    with denied as caught, replace_file(target, keep_unmoved=True) as new:
        new.write_bytes(b"whole")
    assert caught.value.filename == str(target)
    kept = Path(str(caught.value.strerror).split(" is in ")[1])
    assert kept.read_bytes() == b"whole"
    assert list_names(tmp_path) == [kept.name]
    assert NAME.fullmatch(kept.name) is None or len(name) > 200  # nobody sweeps it, where there is room for a name


def test_a_folder_that_cannot_be_looked_at_is_left_alone(tmp_path: Path) -> None:
    sweep_unfinished(tmp_path / "missing")
