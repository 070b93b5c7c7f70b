"""A renderer that lives in a process of its own and shows what it has so far, while its scene keeps changing.

The parent says what to draw and looks at the newest picture whenever it likes; neither ever waits. Pictures lie in
memory that both share, two at a time, so that one can be read while the next is written. The process ends with its
parent, whatever the reason.
"""

from __future__ import annotations

import os
import pickle
import queue
import signal
import subprocess
import sys
import tempfile
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from raytracer.casting.caster import Caster, build
from raytracer.processes.python import make_python_command, make_python_environment
from raytracer.processes.transfer import Parcel, Receiver, Sender
from raytracer.rendering.progressive import COARSEST, Picture, Target, measure_part, refine
from raytracer.scene.camera import Camera
from raytracer.scene.lights import PointLight
from raytracer.scene.materials import Closure, Material
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Mesh

CHANNELS = 4
# Pixels by which canvases grow: a region that is being resized needs a new one now and then only.
CANVAS_STEP = 1 << 18


@dataclass(frozen=True)
class Job:
    """What the parent asks for: `target`, of the newest scene, in the precision `precision`."""

    number: int
    target: Target
    precision: str


@dataclass(frozen=True)
class Canvas:
    """A file of two pictures of up to `pixels` pixels each, shared by both processes."""

    path: Path
    pixels: int


@dataclass(frozen=True)
class Report:
    """What the process says. `picture.pixels` stays empty: they lie in slot `slot` of the canvas `canvas`.

    job : the job that it is about
    shape : of the pixels
    is_finished : True after the last picture of a job
    error : why nothing can be drawn; a sentence
    """

    job: int
    picture: Picture | None = None
    shape: tuple[int, ...] = ()
    slot: int = 0
    canvas: Path | None = None
    is_finished: bool = False
    error: str = ""


NO_PIXELS = np.zeros((0, 0, CHANNELS), np.float32)


class Live:
    """The parent's end. Close it; once closed, everything else does nothing."""

    def __init__(self) -> None:
        self._directory = tempfile.TemporaryDirectory(prefix="raytracer-")
        self._sender = Sender(Path(self._directory.name))
        self._outline = b""
        self._canvas: Canvas | None = None
        self._memory: NDArray[np.float32] | None = None
        self._canvases = self._job = self._forgotten = 0
        self._latest: Report | None = None
        self._shown: Report | None = None
        self.is_closed = False
        self._process = subprocess.Popen(
            make_python_command(f"from {__name__} import serve; serve()"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=make_python_environment(),
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )
        self._listener = threading.Thread(target=self._listen, name="raytracer-live", daemon=True)
        self._listener.start()

    @property
    def process_id(self) -> int:
        return self._process.pid

    def set_scene(self, scene: Scene) -> bool:
        """Take another scene, drawn at the next `draw`; return False if it is the same as the last."""
        parcel = self._sender.pack(scene)
        is_new = parcel.path is not None or parcel.outline != self._outline
        if is_new:
            self._outline = parcel.outline
            self._send(parcel)
        return is_new

    def draw(self, target: Target, precision: str) -> None:
        """Drop what is being drawn and begin with `target`."""
        width, height = measure_part(target)
        edge = COARSEST * target.pixel_size
        self._reserve((width + edge) * (height + edge))
        self._job += 1
        self._send(Job(self._job, target, precision))

    def forget(self) -> None:
        """Stop drawing and let go of the scene, the pictures and what was reported."""
        self.set_scene(Scene())
        self._forgotten = self._job

    @property
    def report(self) -> Report | None:
        """The newest report, of whatever job since `forget`."""
        latest = self._latest
        return latest if latest is not None and latest.job > self._forgotten else None

    @property
    def is_running(self) -> bool:
        """True while the process can be asked to draw."""
        return not self.is_closed and self._process.poll() is None

    @property
    def has_news(self) -> bool:
        """True where there is a report that `read_picture` has not seen."""
        return self.report is not self._shown

    def read_picture(self) -> Picture | None:
        """Return the newest picture, or None if there has been none since the last call.

        Its pixels are a view of the shared memory: the next picture but one will be written there.
        """
        report = self.report
        if report is self._shown:
            return None
        self._shown = report
        if report is None or report.picture is None or self._canvas is None or report.canvas != self._canvas.path:
            return None
        assert self._memory is not None
        count = int(np.prod(report.shape))
        return replace(report.picture, pixels=self._memory[report.slot, :count].reshape(report.shape))

    def close(self) -> None:
        """End the process; whatever it is doing is lost."""
        if self.is_closed:
            return
        self.is_closed = True
        self._process.kill()
        self._process.wait()
        self._listener.join()
        for pipe in (self._process.stdin, self._process.stdout):
            _close(pipe)
        self._memory = None
        self._directory.cleanup()

    def _reserve(self, pixels: int) -> None:
        """Have a canvas for so many pixels."""
        if self._canvas is not None and self._canvas.pixels >= pixels:
            return
        self._canvases += 1
        pixels = -(-pixels // CANVAS_STEP) * CANVAS_STEP
        path = Path(self._directory.name) / f"canvas-{self._canvases}"
        self._memory = np.memmap(path, np.float32, "w+", shape=(2, pixels * CHANNELS))
        self._canvas = Canvas(path, pixels)
        self._send(self._canvas)

    def _send(self, message: Any) -> None:
        if self.is_closed:
            return
        assert self._process.stdin is not None
        try:
            pickle.dump(message, self._process.stdin, protocol=pickle.HIGHEST_PROTOCOL)
            self._process.stdin.flush()
        except (BrokenPipeError, OSError):
            self._latest = self._describe_end()

    def _listen(self) -> None:
        """Take reports until the process ends; the life of a thread that only waits."""
        assert self._process.stdout is not None
        while True:
            try:
                self._latest = pickle.load(self._process.stdout)
            except (EOFError, pickle.UnpicklingError, ValueError):
                break
        if not self.is_closed:
            self._latest = self._describe_end()

    def _describe_end(self) -> Report:
        code = self._process.wait()
        return Report(self._job, is_finished=True, error=f"the render process ended unexpectedly (exit code {code})")


def _close(pipe: IO[bytes] | None) -> None:
    """Close a pipe to a dead process: what it had not read is lost."""
    assert pipe is not None
    try:
        pipe.close()
    except BrokenPipeError:
        return


class Painter:
    """The process' own state: the scene as it is, its caster, the canvas to draw on.

    send : says a Report to the parent
    """

    def __init__(self, send: Callable[[Report], None]) -> None:
        self._send = send
        self._receiver = Receiver()
        self._scene: Scene | None = None
        self._caster: Caster | None = None
        self._is_built = False
        self._canvas: Canvas | None = None
        self._memory: NDArray[np.float32] | None = None
        self._slot = 0
        self._pace = 0.0

    def take(self, message: Any) -> None:
        """Take a scene or a canvas."""
        if isinstance(message, Canvas):
            self._memory = np.memmap(message.path, np.float32, "r+", shape=(2, message.pixels * CHANNELS))
            self._canvas = message
            delete_mapped(message.path)
            return
        assert isinstance(message, Parcel)
        self._scene, self._is_built = self._receiver.unpack(message), False
        if message.path is not None:
            delete_mapped(message.path)

    def paint(self, job: Job, is_cancelled: Callable[[], bool]) -> None:
        """Draw until the job is done or there is something else to do."""
        assert self._scene is not None
        if not self._is_built or self._caster is None or self._caster.primitives.precision != job.precision:
            self._caster, self._is_built = build(self._scene, job.precision, last=self._caster), True

        def show(picture: Picture) -> None:
            is_last = picture.samples == picture.total
            self._send(self._post(job, picture, is_last))

        self._pace = refine(self._scene, self._caster, job.target, show, is_cancelled, self._pace)

    def _post(self, job: Job, picture: Picture, is_finished: bool) -> Report:
        """Write a picture's pixels into the slot that was not written last."""
        assert self._memory is not None
        assert self._canvas is not None
        self._slot = 1 - self._slot
        self._memory[self._slot, : picture.pixels.size] = picture.pixels.reshape(-1)
        bare = replace(picture, pixels=NO_PIXELS)
        return Report(job.number, bare, picture.pixels.shape, self._slot, self._canvas.path, is_finished)


def delete_mapped(path: Path) -> None:
    """Delete a file that stays mapped, where the system allows that; else it goes with the parent's directory."""
    if os.name == "posix":
        path.unlink()


def serve() -> None:
    """Draw what standard input asks for until it ends; the life of the process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what anything prints must not mix with the answers
    inbox: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_read_messages, args=(sys.stdin.buffer, inbox), daemon=True).start()

    def send(report: Report) -> None:
        pickle.dump(report, answers, protocol=pickle.HIGHEST_PROTOCOL)
        answers.flush()

    warm_up()
    painter = Painter(send)
    job: Job | None = None
    while True:
        message = inbox.get()
        if not isinstance(message, Job):
            painter.take(message)
            continue
        job = message
        if not inbox.empty():
            continue  # it is outdated already; another job follows whatever came
        try:
            painter.paint(job, lambda: not inbox.empty())
        except Exception as error:  # said where the picture would be
            traceback.print_exc()
            send(Report(job.number, is_finished=True, error=describe_error(error)))


def describe_error(error: Exception) -> str:
    """Return a sentence: that of a scene which cannot be drawn, or what went wrong."""
    if isinstance(error, MemoryError):
        return "not enough memory"
    text = " ".join(str(error).split())
    return text if isinstance(error, ValueError) else f"internal error, {type(error).__name__}: {text}"


def _read_messages(stream: IO[bytes], inbox: queue.SimpleQueue[Any]) -> None:
    """Hand on what the parent says, and end the process with it."""
    while True:
        try:
            inbox.put(pickle.load(stream))
        except (EOFError, pickle.UnpicklingError):
            os._exit(0)


def warm_up() -> None:
    """Draw something small, so that the first picture need not wait for what is made once: the albedo tables of
    microfacets above all."""
    camera = Camera(np.eye(4))
    corners = [(-1.0, -1.0, -3.0), (1.0, -1.0, -3.0), (0.0, 1.0, -3.0)]
    scene = Scene(
        meshes=[Mesh(corners, [(0, 1, 2)])],
        materials=[Material([Closure("principled", roughness=0.5)])],
        lights=[PointLight((0.0, 0.0, 0.0), (10.0, 10.0, 10.0), radius=0.1)],
    )
    target = Target(camera, 64, 64, samples=1, settings={"integrator": "path"})
    refine(scene, build(scene), target, lambda picture: None, lambda: False)
