"""Tracing the film of one view layer: its caster, the first look, the processes, and what is told meanwhile."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import raytracer
from raytracer.processes.workers import WorkerError

from ..passes import enabled_passes
from ..properties import settings_keywords
from . import worker_pool
from .animation import Frames
from .first_look import show_first_look
from .output import Border
from .progress import Progress

# Light paths per pixel of Blender's previews of materials, worlds and lights.
PREVIEW_SAMPLES = 8


def trace(
    engine: Any,
    scene: raytracer.Scene,
    depsgraph: Any,
    border: Border,
    progress: Progress,
    kept: Frames | None,
    render: Callable[..., raytracer.Film],
) -> raytracer.Film:
    """Return the film of one view layer, which `render` makes as `raytracer.render` does.

    Where processes are lost for good, the render fails with what is traced by then, as after Esc.
    """
    frame = engine.resolution_x, engine.resolution_y
    settings = settings_keywords(depsgraph.scene_eval)
    if engine.is_preview:
        # To start workers would take longer.
        settings |= {"samples": PREVIEW_SAMPLES, "workers": 1, "error": None, "seconds": None}
    progress.show_stage("Building")
    started = time.perf_counter()
    precision = settings["precision"]
    caster = kept.build(scene, precision) if kept else raytracer.build(scene, precision)
    build_seconds = time.perf_counter() - started
    if progress.is_watched:
        progress.show_stage("First look")
        show_first_look(progress.output, scene, caster, frame, border, settings, engine.test_break)
    paths = border.width * border.height * settings["samples"]
    begun: list[raytracer.Film] = []

    def show_pass(film: raytracer.Film, done: int, total: int) -> None:
        begun[:] = [film]
        progress.show_pass(film, done, total)

    try:
        with worker_pool.lend(settings.pop("workers"), paths, progress.show_stage) as workers:
            film = render(
                scene,
                *frame,
                caster=caster,
                passes=enabled_passes(depsgraph.view_layer_eval),
                border=border,
                workers=workers,
                on_sweep=show_pass,
                on_progress=progress.show_share,
                on_stage=progress.show_stage,
                is_cancelled=engine.test_break,
                **settings,
            )
            if film.ended_by == "samples":
                worker_pool.unload(workers)
    except WorkerError as error:  # it comes between two blocks: the film is whole
        if not begun:
            raise
        engine.fail(error)
        (film,) = begun
        film.ended_by, film.cancelled = "cancelled", True
    film.statistics.build_seconds = build_seconds
    return film
