"""Folders that are removed by whoever comes next, if not by their own process."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from raytracer.processes.folders import NEW_SECONDS, OWNER, OwnedFolder, sweep
from tests.folders import ROOT
from tests.portable import kill

PREFIX = "raytracer_test_"


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of temporary files, empty."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return tmp_path


def make_old(folder: Path) -> None:
    past = time.time() - 2 * NEW_SECONDS
    os.utime(folder / OWNER, (past, past))


def test_closing_removes_the_folder_and_what_is_in_it(place: Path) -> None:
    folder = OwnedFolder(PREFIX)
    (folder.path / "inner").mkdir()
    (folder.path / "inner" / "file").write_bytes(b"x")
    folder.close()
    folder.close()
    assert list(place.iterdir()) == []


def test_a_folder_that_is_owned_or_new_or_not_ours_stays(place: Path) -> None:
    (place / f"{PREFIX}somebody").mkdir()
    owned = OwnedFolder(PREFIX)
    make_old(owned.path)
    abandoned = OwnedFolder(PREFIX)
    abandoned._owner.close()
    sweep(PREFIX)
    assert len(list(place.iterdir())) == 3
    make_old(abandoned.path)
    sweep(PREFIX)
    assert set(place.iterdir()) == {place / f"{PREFIX}somebody", owned.path}
    owned.close()


def test_the_next_sweeps_what_a_killed_process_leaves(place: Path) -> None:
    code = (
        "import sys, time, tempfile; tempfile.tempdir = sys.argv[1];"
        "from raytracer.processes.folders import OwnedFolder;"
        f"folder = OwnedFolder({PREFIX!r}); (folder.path / 'scene.blend').write_bytes(b'x' * 1000);"
        "print(folder.path, flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", code, str(place)], cwd=ROOT, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        left = Path(process.stdout.readline().decode().strip())
        make_old(left)
        sweep(PREFIX)
        assert left.is_dir()
        kill(process.pid)
    assert left.is_dir()
    OwnedFolder(PREFIX).close()
    assert list(place.iterdir()) == []


def test_what_cannot_be_removed_yet_is_removed_by_the_next(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on Windows, where another program may just read a file that is in it."""
    folder = OwnedFolder(PREFIX)
    (folder.path / "scene.blend").write_bytes(b"x")

    def remove_some(path: Path, ignore_errors: bool) -> None:
        (path / OWNER).unlink(missing_ok=True)  # on Windows it is gone already when a folder is swept

    with monkeypatch.context() as patch:
        patch.setattr("shutil.rmtree", remove_some)
        folder.close()
        make_old(folder.path)
        sweep(PREFIX)
    assert (folder.path / "scene.blend").exists()
    make_old(folder.path)
    sweep(PREFIX)
    assert list(place.iterdir()) == []
