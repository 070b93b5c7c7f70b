"""A comparison in a process of its own, on a copy of the file as it is now."""

from __future__ import annotations

import json
import subprocess
import sys
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from raytracer.processes.folders import OwnedFolder, sweep

from ...own_blender.command import list_command, start_blender
from ..results import Outcome, Worst

CHILD = Path(__file__).parents[1] / "child.py"
FOLDER_PREFIX = "raytracer_compare_"


class ComparisonError(Exception):
    """The comparison failed; the message is one sentence."""


@dataclass(frozen=True)
class Job:
    """What `compare.child` shall do.

    kind : 'cycles' or 'ray_cast'
    width, height : pixels of both pictures, or rays of the camera
    samples : per pixel, or rays of each other family
    frame : a whole number, and what is behind its point
    scripts : whether those of the file run, as its drivers
    package, root : this add-on's name, and the folder that it is in; paths : where its modules come from
    """

    kind: str
    width: int
    height: int
    samples: int
    scene: str
    view_layer: str
    frame: tuple[int, float]
    folder: str
    blend: str
    scripts: bool
    package: str
    root: str
    paths: tuple[str, ...]


class Running:
    """A comparison that runs; `close` ends it and removes its files.

    Raises
    ------
    ComparisonError
        If it cannot begin, with the reason.
    """

    _progress = 0.0
    blocked = ""  # a script that did not run in the process, though it may have run here; known with the outcome

    def __init__(self, scene: Any, view_layer: Any, kind: str, size: tuple[int, int], samples: int) -> None:
        try:
            self._files = OwnedFolder(FOLDER_PREFIX)
            try:
                self._begin(scene, view_layer, kind, size, samples)
            except BaseException:
                self._files.close()
                raise
        except (RuntimeError, OSError) as error:  # no room for the file, say; Blender's operators raise the first
            raise ComparisonError(" ".join(str(error).removeprefix("Error: ").split())) from error

    def _begin(self, scene: Any, view_layer: Any, kind: str, size: tuple[int, int], samples: int) -> None:
        self.folder = self._files.path
        package = CHILD.parents[1]
        self.job = Job(
            kind=kind,
            width=size[0],
            height=size[1],
            samples=samples,
            scene=scene.name,
            view_layer=view_layer.name,
            frame=(scene.frame_current, scene.frame_subframe),
            folder=str(self.folder),
            blend=str(self.folder / "scene.blend"),
            scripts=runs_scripts(),
            package=package.name,
            root=str(package.parent),
            paths=tuple(path for path in sys.path if path and isinstance(path, str)),
        )
        bpy.ops.wm.save_as_mainfile(filepath=self.job.blend, copy=True, check_existing=False, compress=False)
        description = self.folder / "job.json"
        description.write_text(json.dumps(asdict(self.job)), encoding="utf-8")
        with (self.folder / "log.txt").open("wb") as log:
            # Nothing is ever said to its standard input: its end is how it knows of ours.
            self._process = start_blender(
                [*list_command(CHILD), str(description)],
                self.folder,
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=log,
            )

    def is_done(self) -> bool:
        """Return whether the process has ended."""
        return self._process.poll() is not None

    def wait(self) -> None:
        """Wait for the process to end."""
        self._process.wait()

    def read_progress(self) -> float:
        """Return the share that is done, 0 to 1."""
        with suppress(OSError):  # there is none yet, or Windows puts a new one in its place
            self._progress = float((self.folder / "progress.txt").read_text(encoding="utf-8"))
        return self._progress

    def read_outcome(self) -> Outcome:
        """Return what came out.

        Raises
        ------
        ComparisonError
            If it failed, with the reason.
        """
        try:
            if self._process.returncode == 0:
                plain = json.loads((self.folder / "outcome.json").read_text(encoding="utf-8"))
                self.blocked = "" if bpy.app.autoexec_fail else plain["blocked"]
                worst = [Worst(**entry) for entry in plain["worst"]]
                return Outcome(plain["kind"], plain["numbers"], np.load(self.folder / "heat.npy"), worst)
            told = self.folder / "error.txt"
            reason = " ".join(told.read_text(encoding="utf-8").split()) if told.exists() else ""
        except (OSError, ValueError, EOFError) as error:  # a disk that was full, or somebody tidied up
            raise ComparisonError(f"the outcome cannot be read: {error}") from error
        raise ComparisonError(reason or f"Blender ended with code {self._process.returncode}: {self._read_log_end()}")

    def _read_log_end(self) -> str:
        lines = (self.folder / "log.txt").read_text(encoding="utf-8", errors="replace").split("\n")
        return next((line.strip() for line in reversed(lines) if line.strip()), "it said nothing")

    def close(self) -> None:
        """End the process if it runs, and remove the files."""
        if not self.is_done():
            self._process.kill()
            self._process.wait()
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._files.close()


def runs_scripts() -> bool:
    """Return whether scripts of the open file run here: the copy in another process shall stand as it stands here.

    Blender does not say whether it was told to run those of this file; the preferences have to allow it.
    """
    return bpy.context.preferences.filepaths.use_scripts_auto_execute and not bpy.app.autoexec_fail


def remove_abandoned() -> None:
    """Remove the files of comparisons whose Blender was killed."""
    sweep(FOLDER_PREFIX)
