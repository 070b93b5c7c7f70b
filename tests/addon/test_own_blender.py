"""Blenders of our own leave nothing behind: what they put among the temporary files goes with their folder."""

from __future__ import annotations

import errno
import subprocess
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from addon.denoising import process as denoising
from addon.own_blender.command import list_orders_command, start_blender
from addon.voxels import process as voxels

pytestmark = pytest.mark.blender


def test_its_own_temporary_files_lie_in_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Blender makes a folder when it starts; ended by force, it cannot remove it."""
    elsewhere, folder = tmp_path / "elsewhere", tmp_path / "folder"
    elsewhere.mkdir()
    folder.mkdir()
    for name in ("TMPDIR", "TMP", "TEMP"):
        monkeypatch.setenv(name, str(elsewhere))
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    with start_blender(list_orders_command("voxels.sampling", folder), folder, **pipes) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(b"1\n")  # there is no such file, which it says once it runs
        process.stdin.flush()
        assert any(line.startswith(b"FAILED 1 ") for line in process.stdout)
        process.kill()
    assert list(folder.iterdir()), "Blender has temporary files, or this tests nothing"
    assert list(elsewhere.iterdir()) == []


def test_orders_are_understood_whatever_the_system_encodes_text_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on Windows, where pipes are not UTF-8; a grid may have any name."""
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    with start_blender(list_orders_command("voxels.sampling", tmp_path), tmp_path, **pipes) as process:
        said, _ = process.communicate("1\tdichte_\u00f6\n".encode())
    assert b"\nFAILED 1 " in said


def start_voxels() -> Any:
    reader = voxels.VoxelReader()
    reader._start()
    return reader


@pytest.mark.parametrize("start", [start_voxels, denoising.Process])
def test_nothing_is_left_of_those_who_are_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, start: Callable[[], Any]
) -> None:
    folders: list[Path] = []

    def note(command: list[str], folder: Path, **options: Any) -> Any:
        folders.append(folder)
        return start_blender(command, folder, **options)

    for module in (voxels, denoising):
        monkeypatch.setattr(module, "start_blender", note)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    process = start()
    assert list(tmp_path.iterdir()) == folders, "its files lie in the folder that is removed"
    process.close()
    assert list(tmp_path.iterdir()) == []


class DeadPipe:
    """A pipe that nobody reads, as Windows answers for it."""

    def __init__(self, pipe: Any) -> None:
        self._pipe = pipe

    def write(self, text: bytes) -> None:
        pass  # into the buffer

    def flush(self) -> None:
        raise OSError(errno.EINVAL, "Invalid argument")

    def close(self) -> None:
        self._pipe.close()
        self.flush()


@pytest.mark.parametrize("module", [denoising, voxels])
def test_one_that_ended_before_it_was_told_anything_is_a_fault_in_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: Any
) -> None:
    """On Windows an OSError ended the whole render, which goes on without its denoising, or a volume."""

    def start(*given: Any, **options: Any) -> Any:
        process = start_blender(*given, **options)
        process.stdin = DeadPipe(process.stdin)  # type: ignore[assignment]
        process.kill()
        return process

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(module, "start_blender", start)
    if module is denoising:
        monkeypatch.setattr(denoising, "has_denoiser", lambda: True)
        with pytest.raises(denoising.DenoiseError, match="ended unexpectedly"):
            denoising.denoise(np.zeros((2, 2, 4), np.float32), {}, lambda: False)
        assert denoising._Session.process is None
    else:
        grids = SimpleNamespace(save=lambda filepath: True)
        monkeypatch.setattr(
            voxels, "bpy", SimpleNamespace(app=SimpleNamespace(build_options=SimpleNamespace(openvdb=True)))
        )
        with closing(voxels.VoxelReader()) as reader, pytest.raises(voxels.VoxelError, match="ended unexpectedly"):
            reader.read(SimpleNamespace(grids=grids), ["density"])
    assert list(tmp_path.iterdir()) == []


def test_pictures_that_cannot_be_removed_yet_are_no_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On Windows the process reads them still after Esc: a warning named a temporary file."""

    def refuse(path: Path) -> None:
        raise PermissionError(errno.EACCES, "Permission denied", str(path))

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(denoising, "has_denoiser", lambda: True)
    monkeypatch.setattr(Path, "unlink", refuse)
    denoising.close()
    with pytest.raises(denoising.DenoiseCancelledError):
        denoising.denoise(np.zeros((2, 2, 4), np.float32), {}, lambda: True)
    assert list(tmp_path.iterdir()) == []
