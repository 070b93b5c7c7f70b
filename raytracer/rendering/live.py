"""A renderer that lives in a process of its own and shows what it has so far, while its scene keeps changing.

The parent says what to draw and looks at the newest picture whenever it likes; neither ever waits: threads of the
parent write and read. Scenes and pictures go through the process' pipes, so that nothing lies in a folder.
"""

from __future__ import annotations

import pickle
import queue
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from raytracer.casting.caster import Caster, build
from raytracer.processes.channel import ChannelClosedError, unpack
from raytracer.processes.child import Child, Pulse, describe_error, open_channel, read_inbox
from raytracer.processes.late_pool import LatePool
from raytracer.processes.python import print_traceback
from raytracer.processes.transfer import Parcel, Receiver, Sender
from raytracer.rendering.progressive import Picture, Target, refine
from raytracer.scene.camera import Camera
from raytracer.scene.lights import PointLight
from raytracer.scene.materials import Closure, Material
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Mesh

# Seconds between two looks for signs of life, and those that threads get to end after the process.
WATCH_SECONDS = 1.0
JOIN_SECONDS = 1.0


@dataclass(frozen=True)
class Job:
    """What the parent asks for: `target`, of the newest scene, in the precision `precision`."""

    number: int
    target: Target
    precision: str


@dataclass(frozen=True)
class Rest:
    """Nothing will be asked for soon: workers may end."""


@dataclass(frozen=True)
class Report:
    """What the process says.

    job : the job that it is about
    workers : process ids of those that help
    is_finished : True after the last picture of a job
    error : why nothing can be drawn; a sentence
    """

    job: int
    picture: Picture | None = None
    is_finished: bool = False
    error: str = ""
    workers: tuple[int, ...] = ()


class Live:
    """The parent's end. Close it; once closed, everything else does nothing. Where no process can be started it is
    closed from the beginning, and its report says why."""

    def __init__(self) -> None:
        self._sender = Sender()
        self._outline = b""
        self._job = self._forgotten = 0
        self._latest: Report | None = None
        self._end: Report | None = None  # once the process is gone: of whatever is asked for from then on
        self._shown: Report | None = None
        self._closing = threading.Event()
        self._outbox: queue.SimpleQueue[Parcel | Job | Rest | None] = queue.SimpleQueue()
        try:
            self._child = Child(__name__)
        except OSError as error:  # too many processes, or files, for the system
            reason = f"the render process cannot be started: {error.strerror}"
            self._end = Report(self._job, is_finished=True, error=reason)
            self._closing.set()
            return
        lives = (self._write, self._listen, self._watch)
        self._threads = [threading.Thread(target=live, name="raytracer-live", daemon=True) for live in lives]
        for thread in self._threads:
            thread.start()

    @property
    def process_id(self) -> int:
        return self._child.process.pid

    @property
    def is_closed(self) -> bool:
        return self._closing.is_set()

    def set_scene(self, scene: Scene) -> bool:
        """Take another scene, drawn at the next `draw`; return False if it is the same as the last."""
        parcel = self._sender.pack(scene)
        is_new = bool(parcel.arrays) or parcel.outline != self._outline
        if is_new:
            self._outline = parcel.outline
            self._outbox.put(parcel)
        return is_new

    def draw(self, target: Target, precision: str) -> None:
        """Drop what is being drawn and begin with `target`."""
        self._job += 1
        self._outbox.put(Job(self._job, target, precision))

    def forget(self) -> None:
        """Stop drawing and let go of the scene, the workers, the pictures and what was reported."""
        self.set_scene(Scene())
        self._outbox.put(Rest())
        self._forgotten = self._job

    @property
    def report(self) -> Report | None:
        """The newest report, of whatever job since `forget`; that of the process' end stays."""
        latest = self._latest
        if self._end is not None:
            return self._end
        return latest if latest is not None and latest.job > self._forgotten else None

    @property
    def is_drawing(self) -> bool:
        """True until the last job asked for since `forget` is finished."""
        latest = self._latest
        is_finished = latest is not None and latest.job == self._job and latest.is_finished
        return self._job > self._forgotten and not is_finished and self._end is None

    @property
    def is_running(self) -> bool:
        """True while the process can be asked to draw."""
        return not self.is_closed and self._child.process.poll() is None

    @property
    def has_news(self) -> bool:
        """True where there is a report that `read_picture` has not seen."""
        return self.report is not self._shown

    def read_picture(self) -> Picture | None:
        """Return the newest picture, or None if there has been none since the last call."""
        report = self.report
        if report is self._shown:
            return None
        self._shown = report
        return report.picture if report else None

    def close(self) -> None:
        """End the process; whatever it is doing is lost."""
        if self.is_closed:
            return
        self._closing.set()
        self._outbox.put(None)
        self._child.kill()
        for thread in self._threads:
            thread.join(JOIN_SECONDS)
        if not any(thread.is_alive() for thread in self._threads):
            self._child.close()  # else another process holds a pipe open, and closing it would wait for that

    def _write(self) -> None:
        """Send what is to be sent, until the process ends or is closed; the life of a thread."""
        while True:
            for message in drop_outdated(take_all(self._outbox)):
                if message is None or self.is_closed:
                    return
                try:
                    self._child.channel.send(message)
                except ChannelClosedError:
                    return

    def _listen(self) -> None:
        """Take reports until the process ends, and say so; the life of a thread."""
        try:
            while True:
                self._latest = self._child.channel.receive()
        except (ChannelClosedError, pickle.UnpicklingError, MemoryError):
            self._say_end()

    def _say_end(self) -> None:
        if not self.is_closed:
            end = f"the render process {self._child.describe_end()}"
            self._end = Report(self._job, is_finished=True, error=end)

    def _watch(self) -> None:
        """End the process if it gives no sign of life; the life of a thread."""
        while not self._closing.wait(WATCH_SECONDS) and self._child.process.poll() is None:
            self._child.wait_in_vain(WATCH_SECONDS)
        listener = self._threads[1]
        listener.join(JOIN_SECONDS)
        if listener.is_alive():  # another process holds the pipe open, and hides its end
            self._say_end()


def take_all(outbox: queue.SimpleQueue[Any]) -> list[Any]:
    """Wait for a message; return it with all that have come meanwhile."""
    messages = [outbox.get()]
    while not outbox.empty():
        messages.append(outbox.get())
    return messages


def drop_outdated(messages: Iterable[Any]) -> list[Any]:
    """Return messages without the jobs that another one follows."""
    kept: list[Any] = []
    for message in messages:
        if isinstance(message, Job):
            kept = [one for one in kept if not isinstance(one, Job)]
        kept.append(message)
    return kept


class Painter:
    """The process' own state: the scene as it is, and its caster.

    send : says a Report to the parent
    """

    def __init__(self, send: Callable[[Report], None]) -> None:
        self._send = send
        self._receiver = Receiver()
        self._scene: Scene | None = None
        self._caster: Caster | None = None
        self._is_built = False
        self._pace = 0.0
        self._helpers: LatePool | None = None

    def take(self, parcel: Parcel) -> None:
        """Take a scene."""
        self._scene, self._is_built = self._receiver.unpack(parcel), False

    def paint(self, job: Job, is_cancelled: Callable[[], bool]) -> None:
        """Draw until the job is done or there is something else to do."""
        assert self._scene is not None
        if not self._is_built or self._caster is None or self._caster.primitives.precision != job.precision:
            self._caster, self._is_built = build(self._scene, job.precision, last=self._caster), True

        def show(picture: Picture) -> None:
            workers = tuple(self._helpers.process_ids) if self._helpers else ()
            self._send(Report(job.number, picture, is_finished=picture.samples == picture.total, workers=workers))

        arguments = self._scene, self._caster, job.target, show, is_cancelled
        self._pace = refine(*arguments, self._pace, self.find_helpers)

    def find_helpers(self, count: int) -> LatePool:
        """Return a pool of `count` workers, the last one if it has as many."""
        if self._helpers is None or len(self._helpers) != count:
            self.rest()
            self._helpers = LatePool(count)
        return self._helpers

    def rest(self) -> None:
        """End the workers."""
        if self._helpers is not None:
            self._helpers.close()
            self._helpers = None


def serve() -> None:
    """Draw what the parent asks for until it is gone; the life of the process."""
    channel = open_channel()
    inbox, pulse = read_inbox(channel), Pulse(channel)
    with pulse:
        warm_up()
        painter = Painter(channel.send)
        number = 0
        while True:
            message = unpack(inbox.get())
            if isinstance(message, Job):
                number = message.number
                if not inbox.empty():
                    continue  # it is outdated already; another job follows whatever came
            try:
                if isinstance(message, Job):
                    painter.paint(message, lambda: not inbox.empty())
                elif isinstance(message, Rest):
                    painter.rest()
                else:
                    painter.take(message)
            except ChannelClosedError:
                return  # the parent is gone
            except Exception as error:  # said where the picture would be
                print_traceback(error)
                channel.send(Report(number, is_finished=True, error=describe_error(error)))


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
