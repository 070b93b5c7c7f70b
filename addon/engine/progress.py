"""Tells the user how far a frame is, and shows the picture so far."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import bpy

from raytracer.film.error import format_error

from .output import RenderOutput

# Seconds between two updates of text and progress bar, and of the picture on the screen: often enough to watch; and
# the share of the time that updates of a large picture may take from tracing.
TEXT_INTERVAL = 0.1
PICTURE_INTERVAL = 0.5
PICTURE_SHARE = 0.1
# The share of the time that telling the error may take.
ERROR_SHARE = 0.02

# Called with the finished share of the frame, 0 to 1; the command line's progress bar listens here.
progress_listeners: list[Callable[[float], None]] = []


class Progress:
    """Tells the user how far the frame is, and shows the picture so far."""

    def __init__(self, engine: Any, output: RenderOutput, layer_count: int) -> None:
        self.output = output
        self.is_watched = not (bpy.app.background or engine.is_preview)
        self._engine = engine
        self._layer_count = max(layer_count, engine.layers_done + 1)
        self._samples = self._error = ""
        self._first: tuple[float, float] | None = None  # time and share when tracing had begun
        self._next_text = self._next_picture = self._next_error = time.perf_counter()

    def show_stage(self, stage: str) -> None:
        """Say what begins; the bar stands at what the view layers before have done."""
        self._engine.update_stats("", stage)
        self._engine.update_progress(self._engine.layers_done / self._layer_count)

    def show_share(self, share: float) -> None:
        """Update progress bar, remaining time and listeners; `share` of this view layer is done."""
        now = time.perf_counter()
        if now < self._next_text and share < 1:
            return
        self._next_text = now + TEXT_INTERVAL
        self._engine.update_stats("", f"{self._samples}{self._error}{self._estimate_remaining(now, share)}")
        of_frame = (self._engine.layers_done + share) / self._layer_count
        self._engine.update_progress(of_frame)
        for listener in progress_listeners:
            listener(of_frame)

    def _estimate_remaining(self, now: float, share: float) -> str:
        """Return the time left, judged by the pace since the first block: starting takes a time of its own."""
        if self._first is None:
            self._first = (now, share)
        first_time, first_share = self._first
        if share <= first_share:
            return "Tracing"
        pace = (now - first_time) / (share - first_share)
        return f"remaining {format_duration(pace * (1 - share))}"

    def show_pass(self, film: Any, done: int, total: int) -> None:
        """Count the samples; tell the error now and then, and update the picture where there is a screen to see it."""
        self._samples = f"Sample {done}/{total} | "
        self._tell_error(film)
        started = time.perf_counter()
        if not self.is_watched or done == total or started < self._next_picture:
            return
        self.output.write(film.passes)
        self.output.show()
        finished = time.perf_counter()
        self._next_picture = finished + max(PICTURE_INTERVAL, (finished - started) / PICTURE_SHARE)

    def _tell_error(self, film: Any) -> None:
        started = time.perf_counter()
        if started < self._next_error or film.samples < 2:
            return
        self._error = f"error {format_error(film.error)} | "
        finished = time.perf_counter()
        self._next_error = finished + (finished - started) / ERROR_SHARE


def format_duration(seconds: float) -> str:
    """Return a time as hours, minutes and seconds: '1:02:03' or '02:03'."""
    minutes, rest = divmod(int(seconds + 0.5), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes:02}:{rest:02}"
