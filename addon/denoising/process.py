"""The denoising process of a session: started by the first picture that asks for it, kept for the next ones, and ended
after a while without any, with the add-on, or with Blender itself.

To start it takes a second or two; a picture then takes a fraction of one.
"""

from __future__ import annotations

import queue
import subprocess
import threading
from collections.abc import Callable
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from raytracer.processes.folders import OwnedFolder

from ..own_blender.command import describe, end, list_orders_command, start_blender, tell
from ..versions import has_denoiser
from .compositor import INPUTS

FOLDER_PREFIX = "raytracer_denoise_"
# Seconds without a picture until the process ends: it keeps some 300 MB.
IDLE_SECONDS = 120.0
# Seconds between two questions whether the user wants no more; and after which a process that says nothing is given up.
POLL_SECONDS, SILENCE_SECONDS = 0.05, 300.0
# Why a build cannot denoise.
NO_DENOISER = "this build of Blender comes without OpenImageDenoise"

Pixels = NDArray[np.float32]


class DenoiseError(Exception):
    """The picture could not be denoised; the message is one sentence."""


class DenoiseCancelledError(Exception):
    """The user wants no more."""


class Process:
    """A Blender process that denoises; `close` ends it and removes its files."""

    def __init__(self) -> None:
        self._files = OwnedFolder(FOLDER_PREFIX)
        self._orders = 0
        try:
            self._process = start_blender(
                list_orders_command("denoising.compositor", self._files.path),
                self._files.path,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
            )
        except OSError:
            self._files.close()
            raise
        self._said: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._listener = threading.Thread(target=self._listen, name="raytracer-denoiser", daemon=True)
        self._listener.start()

    @property
    def is_running(self) -> bool:
        """True until it ended."""
        return self._process.poll() is None

    def denoise(self, pictures: dict[str, Pixels], is_cancelled: Callable[[], bool]) -> Pixels:
        """Return a picture (h, w, 3) without its noise; see `compositor.denoise_pictures`."""
        self._orders += 1
        number, folder = self._orders, self._files.path
        try:
            for name, pixels in pictures.items():
                np.save(folder / f"{number}_{name}.npy", pixels)
            tell(self._process, str(number))
            self._await_answer(number, is_cancelled)
            return np.load(folder / f"{number}_Done.npy")
        finally:
            for path in folder.glob(f"{number}_*.npy"):
                with suppress(OSError):  # on Windows it may be read still; it goes with the folder
                    path.unlink()

    def _listen(self) -> None:
        """Hand on what the process says; an empty line is its end."""
        assert self._process.stdout is not None
        with self._process.stdout as said:
            for line in said:
                if line.startswith((b"DONE ", b"FAILED ")):
                    self._said.put(line.decode(errors="replace").strip())
        self._said.put("")

    def _await_answer(self, number: int, is_cancelled: Callable[[], bool]) -> None:
        waited = 0.0
        while True:
            try:
                word, _, rest = self._said.get(timeout=POLL_SECONDS).partition(" ")
            except queue.Empty:
                waited += POLL_SECONDS
                if is_cancelled():
                    raise DenoiseCancelledError from None
                if waited > SILENCE_SECONDS:
                    raise DenoiseError(f"the process did not answer for {SILENCE_SECONDS:.0f} seconds") from None
                continue
            if not word:
                raise DenoiseError(f"the process ended unexpectedly (exit code {self._process.wait()})")
            if rest.partition(" ")[0] == str(number):
                if word == "FAILED":
                    raise DenoiseError(rest.partition(" ")[2])
                return

    def close(self) -> None:
        """End it; may be called again."""
        end(self._process)
        self._listener.join()
        self._files.close()


class _Session:
    process: Process | None = None
    timer: threading.Timer | None = None
    lock = threading.Lock()  # one picture at a time


def denoise(pixels: Pixels, guides: dict[str, Pixels], is_cancelled: Callable[[], bool]) -> Pixels:
    """Return a picture without its noise; its alpha stays.

    Parameters
    ----------
    pixels : (h, w, 4), linear, premultiplied
    guides : "Albedo" and "Normal" (h, w, 3), or neither
    is_cancelled : asked now and then

    Raises
    ------
    DenoiseError
        If it cannot be done, with the reason.
    DenoiseCancelledError
        If `is_cancelled`.
    """
    if not has_denoiser():
        raise DenoiseError(NO_DENOISER)
    pictures = {"Image": np.ascontiguousarray(pixels[..., :3]), **guides}
    assert pictures.keys() <= set(INPUTS)
    with _Session.lock:
        _stop_timer()
        try:
            if _Session.process is None or not _Session.process.is_running:
                _close()
                _Session.process = Process()
            color = _Session.process.denoise(pictures, is_cancelled)
        except OSError as error:  # no room for the picture among the temporary files, say
            _close()
            raise DenoiseError(describe(error)) from error
        except BaseException:
            _close()  # nobody knows what it is at
            raise
        _Session.timer = threading.Timer(IDLE_SECONDS, close)
        _Session.timer.daemon = True
        _Session.timer.start()
    return np.concatenate((color, pixels[..., 3:]), axis=2)


def close() -> None:
    """End the process."""
    with _Session.lock:
        _stop_timer()
        _close()


def _stop_timer() -> None:
    if _Session.timer is not None:
        _Session.timer.cancel()
        _Session.timer = None


def _close() -> None:
    if _Session.process is not None:
        _Session.process.close()
        _Session.process = None
