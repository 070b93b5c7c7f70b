"""The render loop: sweeps over the picture, each one sample of every pixel, in blocks of pixels.

Primary rays through the pixels' samples, what the integrator sees along them, and the film that adds it up. A value
depends on pixel, sample number and seed alone, so the picture is the same bit for bit for any block size, border and
number of workers.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import fields, replace
from functools import partial
from typing import Any

from raytracer.casting.caster import Caster, build
from raytracer.film.film import Film
from raytracer.film.picture_key import PictureKey, describe_difference
from raytracer.integrator.features import derive_features
from raytracer.integrator.integrator import catches_shadows
from raytracer.integrator.settings import FREE_SETTINGS, Settings, check_integer
from raytracer.processes.pool import Pool
from raytracer.processes.workers import Workers
from raytracer.rendering.blocks import (
    BlockPlan,
    BlockResult,
    FrameWindow,
    _never,
    _say_nothing,
    count_sweeps,
    make_window,
    trace_blocks,
)
from raytracer.scene.scene import Scene
from raytracer.scene.scene_digest import digest_scene

SweepCallback = Callable[[Film, int, int], None]


def render(
    scene: Scene,
    width: int,
    height: int,
    samples: int = 64,
    *,
    caster: Caster | None = None,
    film: Film | None = None,
    until: int | None = None,
    workers: int | Pool = 1,
    on_sweep: SweepCallback | None = None,
    on_progress: Callable[[float], None] | None = None,
    on_stage: Callable[[str], None] | None = None,
    is_cancelled: Callable[[], bool] | None = None,
    **settings: Any,
) -> Film:
    """Render `scene` through its camera.

    Parameters
    ----------
    width, height : size of the full picture, pixels
    samples : rays per pixel
    film : what an earlier render of the same picture returned, which this one goes on from and adds to; None begins
        anew. The result is bit for bit what one render of all samples gives
    until : the sample to stop at, of `samples`; None takes all
    caster : what `raytracer.build(scene)` returned, to save building it again
    workers : number of processes, or a Pool, such as Workers that are running already (they keep running)
    on_sweep : called with (film, done, total) after each sweep over the picture; the film can be read meanwhile
    on_progress : called with the finished share, 0 to 1, after each block of pixels
    on_stage : called with what begins: "Building", "Starting 2 workers", "Tracing"
    is_cancelled : asked several times a second; True ends the render with the film as it is
    settings : the other fields of `Settings` by name

    Returns
    -------
    Film, of the border's size where one is set; `film.cancelled` tells whether it was stopped

    Raises
    ------
    ValueError
        If the scene has no camera, a setting does not fit, or `film` is of another picture.
    WorkerError
        If a worker process died.

    Examples
    --------
    >>> import numpy as np
    >>> import raytracer
    >>> floor = raytracer.Mesh(positions=[(-9, -9, 0), (9, -9, 0), (0, 9, 0)], triangles=[(0, 1, 2)])
    >>> above = np.array([(1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 4), (0, 0, 0, 1)])
    >>> scene = raytracer.Scene(
    ...     meshes=[floor], lights=[raytracer.PointLight((0, 0, 3), power=100)], camera=raytracer.Camera(above)
    ... )
    >>> film = raytracer.render(scene, 4, 3, samples=2, passes=("Combined", "Depth"))
    >>> film["Combined"].shape, film["Depth"][0, 0].tolist()
    ((3, 4, 4), [4.0])
    """
    count = len(workers) if isinstance(workers, Pool) else workers
    chosen = Settings(samples=samples, workers=count, **settings)
    film, window = prepare_film(scene, width, height, chosen, film)
    plan = BlockPlan(
        *(window.width * window.height, limit_sweeps(chosen, until), chosen.block_size),
        workers=count,
        done=film.samples,
        ahead=film.ahead,
    )
    tell = on_stage or _say_nothing
    started = time.perf_counter()
    if caster is None:
        tell("Building")
        caster = build(scene, chosen.precision)
    film.statistics.build_seconds += time.perf_counter() - started
    with ExitStack() as stack:
        pool = workers if isinstance(workers, Pool) else None
        if chosen.workers > 1 and pool is None:
            tell(f"Starting {chosen.workers} workers")
            pool = stack.enter_context(Workers(chosen.workers))
        results = trace_blocks(pool, (scene, caster, window, chosen), plan, is_cancelled or _never, tell)
        accumulate(film, plan, results, on_sweep, on_progress)
    film.cancelled = film.samples < plan.sweeps
    return film


def prepare_film(
    scene: Scene, width: int, height: int, settings: Settings, film: Film | None = None
) -> tuple[Film, FrameWindow]:
    """Return the film to render into, an empty one or `film`, and what it shows of the picture."""
    if film is not None and settings.interleaving is None:
        settings = replace(settings, interleaving=film.interleaving)
    window = make_window(scene, width, height, settings)
    new = begin_film(scene, window, settings)
    return continue_film(film, new) if film else new, window


def begin_film(scene: Scene, window: FrameWindow, settings: Settings) -> Film:
    """Return an empty film that knows its picture, to render into.

    The scene is only looked at, and kept until then, if somebody asks for the film's key.
    """
    choices = {item.name: getattr(settings, item.name) for item in fields(settings)}
    choices = {name: value for name, value in choices.items() if name not in FREE_SETTINGS}
    full = (0, 0, window.full_width, window.full_height)
    size = {"width": window.full_width, "height": window.full_height, "interleaving": window.interleaving}
    return Film(
        window.width,
        window.height,
        settings.passes,
        catches=catches_shadows(derive_features(scene), settings),
        interleaving=window.interleaving,
        total=count_sweeps(settings),
        left=window.x_min,
        bottom=window.y_min,
        border=settings.border if settings.tile and settings.border != full else None,
        key=PictureKey({**size, **choices}, partial(digest_scene, scene)),
    )


def continue_film(film: Film, new: Film) -> Film:
    """Return `film`, or raise ValueError unless it is of the picture that `new` has been begun for."""
    name = film.label or "film"
    if film.key is None or new.key is None:
        raise ValueError(f"{name}: expected a film of raytracer.render")
    difference = describe_difference(film.key, new.key)
    for field in ("left", "bottom", "width", "height", "border"):
        found, expected = getattr(film, field), getattr(new, field)
        if not difference and found != expected:
            difference = f"{field} is {found}, not {expected}"
    if not difference and film.samples > new.total:
        difference = f"it has {film.samples} samples already, and the picture shall have {new.total}"
    if difference:
        raise ValueError(f"{name} is of another picture: {difference}")
    film.total, film.key = new.total, new.key
    return film


def limit_sweeps(settings: Settings, until: int | None) -> int:
    """Return the sweep to stop at."""
    sweeps = count_sweeps(settings)
    return sweeps if until is None else min(check_integer(until, 1, settings.samples, "render: until"), sweeps)


def accumulate(
    film: Film,
    plan: BlockPlan,
    results: Iterable[BlockResult],
    on_sweep: SweepCallback | None,
    on_progress: Callable[[float], None] | None,
) -> None:
    """Add results to the film as they come, and tell the callbacks."""
    started = time.perf_counter() - film.statistics.trace_seconds
    for result in results:
        plan.observe(result)
        add_result(film, result)
        film.ahead = result.block.stop % plan.pixels
        if not film.ahead:
            film.samples = result.block.sample + result.block.samples
        film.statistics.trace_seconds = time.perf_counter() - started
        if on_progress:
            on_progress(plan.share_done(result.block))
        if not film.ahead and on_sweep:
            on_sweep(film, film.samples, plan.sweeps)


def add_result(film: Film, result: BlockResult) -> None:
    """Add what a block saw to the film."""
    pixels, count = result.block.pixels, len(result.block)
    for first in range(0, result.block.samples * count, count):
        film.add(pixels, {name: values[first : first + count] for name, values in result.values.items()})
    if result.centre_values:
        film.set_centre(pixels, result.centre_values)
    film.statistics.rays += result.rays
