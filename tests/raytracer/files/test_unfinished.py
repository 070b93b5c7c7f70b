"""Files that a killed process was writing are removed by the next who writes beside them; those of others stay."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import raytracer.files.unfinished as unfinished
from raytracer.files.replacing import replace_file, write_bytes
from raytracer.files.unfinished import NEW_SECONDS, PREFIX, NewFile, sweep_unfinished
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


def test_a_folder_that_cannot_be_looked_at_is_left_alone(tmp_path: Path) -> None:
    sweep_unfinished(tmp_path / "missing")
