"""Files are written whole or not at all: full disks, kills at every write, links, permissions, sentences."""

from __future__ import annotations

import errno
import os
import stat
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import raytracer
from raytracer.files import replacing, unfinished
from raytracer.files.replacing import check_replaceable, replace_file, write_bytes, write_text
from tests.folders import ROOT

OLD, NEW = b"what was there", b"what is new" * 100


@pytest.fixture
def target(tmp_path: Path) -> Path:
    path = tmp_path / "target.bin"
    path.write_bytes(OLD)
    return path


def list_names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_file_is_replaced_and_a_new_one_made(target: Path) -> None:
    write_bytes(target, NEW)
    write_text(target.with_name("new.txt"), "ä")
    assert target.read_bytes() == NEW
    assert target.with_name("new.txt").read_bytes() == "ä".encode()
    assert list_names(target.parent) == ["new.txt", "target.bin"]


@pytest.mark.parametrize("error", [ValueError("no"), KeyboardInterrupt(), OSError("no number"), MemoryError()])
def test_an_error_leaves_the_old_file_and_nothing_else(target: Path, error: BaseException) -> None:
    def write() -> None:
        with replace_file(target) as new:
            new.write_bytes(NEW)
            raise error

    with pytest.raises(type(error)) as caught:
        write()
    assert caught.value is error
    assert target.read_bytes() == OLD
    assert list_names(target.parent) == ["target.bin"]


def test_what_is_not_whole_does_not_replace_and_the_sentence_names_the_target(target: Path) -> None:
    def check(new: Path) -> None:
        raise ValueError(f"{len(new.read_bytes())} bytes")

    with pytest.raises(ValueError, match=r"target\.bin: not written: 1100 bytes"), replace_file(target, check) as new:
        new.write_bytes(NEW)
    assert target.read_bytes() == OLD
    assert list_names(target.parent) == ["target.bin"]


def test_errors_of_the_disk_name_the_target_others_keep_their_file(target: Path) -> None:
    with pytest.raises(OSError, match="No space") as caught, replace_file(target):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert caught.value.filename == str(target)
    with pytest.raises(FileNotFoundError) as caught, replace_file(target) as new:
        new.with_name("other").read_bytes()
    assert caught.value.filename.endswith("other")
    with pytest.raises(OSError, match=r"target\.bin") as caught, replace_file(target) as new:
        new.unlink()  # which Windows refuses
    assert caught.value.filename == str(target)


def test_a_file_that_somebody_has_open_on_windows_is_told_before_anything_is_written(
    target: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was after hours, when the picture was to take its place."""

    def refuse(path: Path, other: Path) -> None:
        raise PermissionError(errno.EACCES, "Access is denied", str(path))

    monkeypatch.setattr(os, "rename", refuse)
    check_replaceable(target)  # elsewhere it can be replaced
    for module in (replacing, unfinished):
        monkeypatch.setattr(module, "sys", SimpleNamespace(platform="win32"))
    monkeypatch.setattr(unfinished, "IN_USE_SECONDS", 0.1)
    with pytest.raises(PermissionError) as caught:
        check_replaceable(target)
    assert caught.value.filename == str(target)
    check_replaceable(target.with_name("new.bin"))
    assert list_names(target.parent) == ["target.bin"]


def test_a_missing_folder_a_folder_and_a_device_are_named(tmp_path: Path) -> None:
    for path, kind in ((tmp_path / "no" / "a.bin", FileNotFoundError), (tmp_path, OSError), (os.devnull, OSError)):
        for write in (check_replaceable, lambda path: write_bytes(path, NEW)):
            with pytest.raises(kind) as caught:
                write(path)
            assert caught.value.filename == str(path)
    assert not list_names(tmp_path)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such permissions, and links only with privileges")
def test_links_and_permissions_stay(target: Path) -> None:
    target.chmod(0o640)
    link = target.with_name("link.bin")
    link.symlink_to(target.name)
    write_bytes(link, NEW)
    assert link.is_symlink()
    assert target.read_bytes() == NEW
    assert stat.S_IMODE(target.stat().st_mode) == 0o640
    plain, ours = target.with_name("plain"), target.with_name("ours")
    plain.touch()
    write_bytes(ours, NEW)
    assert ours.stat().st_mode == plain.stat().st_mode


# Full disks and kills ------------------------------------------------------------------------------------------------

# A scene is saved over another, in a process that may write LIMIT bytes to a file, or that dies at step LIMIT: before
# it writes, half-way through a write, before it flushes, before and after it replaces.
SAVE = """
import io, os, resource, sys
import numpy as np
import raytracer
import raytracer.files.replacing as replacing
path, way = sys.argv[1:3]
spheres = raytracer.Spheres(np.random.default_rng(1).normal(size=(200, 3)), np.full(200, 0.5), name="new")
scene = raytracer.Scene(spheres=spheres, name="new")

def die_at(limit):
    steps = 0
    def step(half=None):
        nonlocal steps
        steps += 1
        if steps == limit:
            if half is not None:
                half()
            os.kill(os.getpid(), 9)
    class Dying(io.FileIO):
        def write(self, data):
            data = bytes(data)
            step(lambda: super(Dying, self).write(data[: len(data) // 2]))
            return super().write(data)
    def open_dying(file, mode="r", *rest, **named):
        return Dying(file, mode.replace("b", "")) if "w" in mode else plain_open(file, mode, *rest, **named)
    plain_open, plain_sync, plain_replace = io.open, os.fsync, os.replace
    io.open = open_dying
    def sync(number):
        step(); plain_sync(number)
    def replace(first, second):
        step(); plain_replace(first, second); step()
    os.fsync, os.replace = sync, replace

for limit in map(int, sys.argv[3:]):
    pid = os.fork()
    if pid == 0:
        if way == "full":
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
        else:
            die_at(limit)
        try:
            raytracer.save(scene, path)
        except OSError as error:
            os._exit(3 if str(error.filename) == path else 4)
        os._exit(0)
    _, status = os.waitpid(pid, 0)
    print(limit, os.waitstatus_to_exitcode(status), raytracer.load(path).name, flush=True)
    raytracer.save(raytracer.Scene(name="old"), path)
"""
HAS_FORK = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork and limits of resources, which Windows lacks")


def save_again_and_again(path: Path, way: str, limits: Any) -> list[tuple[int, int, str]]:
    """Return, for each limit, the exit code and the name of the scene that is found afterwards."""
    raytracer.save(raytracer.Scene(name="old"), path)
    command = [sys.executable, "-c", SAVE, str(path), way, *map(str, limits)]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300, env=environment)
    rows = [line.split() for line in done.stdout.splitlines()]
    return [(int(limit), int(code), name) for limit, code, name in rows]


@HAS_FORK
def test_a_disk_that_is_full_at_any_byte_keeps_the_old_scene(tmp_path: Path) -> None:
    path = tmp_path / "scene.npz"
    spheres = raytracer.Spheres(np.random.default_rng(1).normal(size=(200, 3)), np.full(200, 0.5), name="new")
    raytracer.save(raytracer.Scene(spheres=spheres, name="new"), path)
    size = path.stat().st_size
    limits = [0, 1, *range(64, size, size // 40), size - 1]
    assert save_again_and_again(path, "full", limits) == [(limit, 3, "old") for limit in limits]
    assert save_again_and_again(path, "full", [size]) == [(size, 0, "new")]
    assert list_names(tmp_path) == ["scene.npz"]


@HAS_FORK
def test_a_process_killed_at_any_write_leaves_the_old_scene_or_the_new_one(tmp_path: Path) -> None:
    path, found = tmp_path / "scene.npz", []
    while not found or found[-1][1] != 0:
        found += save_again_and_again(path, "kill", range(len(found) + 1, len(found) + 41))
    codes, names = zip(*((code, name) for _, code, name in found), strict=True)
    steps = codes.index(0)
    assert steps > 20  # headers, arrays, the directory, the flush and the replacing
    assert codes[:steps] == (-9,) * steps
    assert names[:steps] == ("old",) * (steps - 1) + ("new",)
    assert list_names(tmp_path) == ["scene.npz"]


def test_what_is_no_scene_is_not_saved_and_the_old_one_stays(tmp_path: Path) -> None:
    path = tmp_path / "scene.npz"
    raytracer.save(raytracer.Scene(name="old"), path)
    for wrong in (5, None, raytracer.World()):
        with pytest.raises(ValueError, match="save: expected a Scene, got"):
            raytracer.save(wrong, path)
    assert raytracer.load(path).name == "old"
    assert list_names(tmp_path) == ["scene.npz"]
