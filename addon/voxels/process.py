"""The process that reads voxels: started by the first volume of an extraction, and ended with it."""

from __future__ import annotations

import subprocess
import threading
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from raytracer.processes.folders import OwnedFolder

from ..own_blender.command import describe, end, list_orders_command, start_blender, tell

FOLDER_PREFIX = "raytracer_voxels_"
# Seconds after which a process that says nothing is given up.
SILENCE_SECONDS = 300.0
# Why a build cannot read volumes.
NO_OPENVDB = "this build of Blender comes without OpenVDB"

Grids = dict[str, tuple[NDArray[np.float32], NDArray[np.float64]]]


class VoxelError(Exception):
    """A volume could not be read; the message is one sentence."""


class VoxelReader:
    """Reads grids of volumes; close it."""

    def __init__(self) -> None:
        self._orders = 0
        self._files: OwnedFolder | None = None
        self._process: subprocess.Popen[bytes] | None = None

    def read(self, volume: Any, names: Sequence[str]) -> Grids:
        """Return by name what grids of an evaluated volume hold, of those types that nodes know: values (x, y, z) or
        (x, y, z, 3), and the matrix (4, 4) from index to object space.

        Raises
        ------
        VoxelError
            If they cannot be read, with the reason.
        """
        if not bpy.app.build_options.openvdb:
            raise VoxelError(NO_OPENVDB)
        try:
            return self._read(volume, names)
        except OSError as error:  # no room for temporary files, or for another process
            raise VoxelError(describe(error)) from error

    def _read(self, volume: Any, names: Sequence[str]) -> Grids:
        self._orders += 1
        files = self._start()
        path = files.path / f"{self._orders}.vdb"
        if not volume.grids.save(filepath=str(path)):
            raise VoxelError(f"its grids cannot be written: {volume.grids.error_message or 'Blender says no more'}")
        self._order("\t".join((str(self._orders), *names)))
        with np.load(path.with_suffix(".npz")) as arrays:
            found = {
                name: (arrays[f"values_{number}"], arrays[f"object_from_index_{number}"])
                for number, name in enumerate(names)
                if f"values_{number}" in arrays
            }
        for suffix in (".vdb", ".npz"):
            with suppress(OSError):  # on Windows somebody may look at it; it goes with the folder
                path.with_suffix(suffix).unlink()
        return found

    def _start(self) -> OwnedFolder:
        if self._files is None:
            self._files = OwnedFolder(FOLDER_PREFIX)
        if self._process is None:
            pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
            folder = self._files.path
            self._process = start_blender(list_orders_command("voxels.sampling", folder), folder, **pipes)
        return self._files

    def _order(self, line: str) -> None:
        """Have an order done; other lines are what Blender says."""
        process = self._process
        assert process is not None
        assert process.stdout is not None
        silence = threading.Timer(SILENCE_SECONDS, process.kill)
        silence.start()
        try:
            tell(process, line)
            for said in process.stdout:
                word, _, rest = said.decode(errors="replace").strip().partition(" ")
                if word == "DONE":
                    return
                if word == "FAILED":
                    raise VoxelError(rest.partition(" ")[2])
        finally:
            silence.cancel()
        self._end()
        raise VoxelError("the process that reads its voxels ended unexpectedly")

    def _end(self) -> None:
        if self._process is None:
            return
        end(self._process)
        assert self._process.stdout is not None
        self._process.stdout.close()
        self._process = None

    def close(self) -> None:
        """End the process and remove its files; may be called again."""
        self._end()
        if self._files is not None:
            self._files.close()
            self._files = None
