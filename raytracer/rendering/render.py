"""The render loop: sweeps over the picture, each one sample of every pixel, in blocks of pixels.

Primary rays through the pixels' samples, what the integrator sees along them, and the film that adds it up. A value
depends on pixel, sample number and seed alone, so the picture is the same bit for bit for any block size, border and
number of workers.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import fields, replace
from functools import partial
from typing import Any

from raytracer.arrays.memory import release_freed_memory
from raytracer.casting.caster import Caster, build
from raytracer.film.film import Film
from raytracer.film.missed import select_sweep
from raytracer.film.passes import select_passes
from raytracer.film.picture_key import PictureKey, describe_difference
from raytracer.integrator.features import derive_features
from raytracer.integrator.prepare import catches_shadows
from raytracer.integrator.settings import FREE_SETTINGS, Border, Settings, check_integer
from raytracer.processes.pool import Pool
from raytracer.processes.workers import Workers
from raytracer.rendering.adaptive import AdaptivePlan, add_listed, check_counts
from raytracer.rendering.allocation import choose_pilot
from raytracer.rendering.block_plan import GATHERED, LARGE_PICTURE, MANY_WORKERS, SWEEP_GROWTH, BlockPlan
from raytracer.rendering.blocks import (
    RAY,
    Block,
    BlockResult,
    FrameWindow,
    ListedBlock,
    _never,
    add_sample,
    count_sweeps,
    hand_out,
    make_window,
    say_nothing,
    trace_blocks,
)
from raytracer.rendering.ending import EndedBy, Ending
from raytracer.rendering.moving_tracer import MovingTracer, find_time_side
from raytracer.scene.moments import moves_geometry
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
    samples : rays per pixel, at most: `error` and `seconds`, other fields of `Settings`, may end it before
    film : what an earlier render of the same picture returned, which this one goes on from and adds to; None begins
        anew. The result is bit for bit what one render of all samples gives
    until : the sample to stop at, of `samples`, or that some pixels of `film` have already; None takes all
    caster : what `raytracer.build(scene)` returned, to save building it again
    workers : number of processes, or a Pool, such as Workers that are running already (they keep running)
    on_sweep : called with (film, done, total) after each sweep over the picture; the film can be read meanwhile
    on_progress : called with the finished share, 0 to 1, after each block of pixels
    on_stage : called with what begins: "Building", "Starting 2 workers", "Tracing"
    is_cancelled : asked several times a second; True ends the render with the film as it is
    settings : the other fields of `Settings` by name

    Returns
    -------
    Film, of the border's size where one is set; `film.ended_by` tells why it has no more samples

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
    plan = plan_blocks(scene, film, window, chosen, until)
    tell = on_stage or say_nothing
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
        make_tracer = None if scene.motion is None else MovingTracer
        arguments = (scene, caster, window, chosen if film.pilot else replace(chosen, adaptive=False))
        phases = plan.phases()
        if pool is not None and chosen.error is None:  # which looks at every sweep
            phases = (hand_out(film, blocks) for blocks in phases)
        results = trace_blocks(pool, arguments, phases, is_cancelled or _never, tell, make_tracer)
        ending = Ending(chosen, limit_sweeps(chosen, until), time.perf_counter(), film.samples)
        is_done = film.samples >= ending.sweeps
        film.ended_by, film.cancelled = "", False
        ended_by = ending.find_first(film)
        if ended_by is None:
            stands_still = scene.motion is None or not moves_geometry(scene.motion)
            if pool is not None or (chosen.seconds is not None and stands_still):
                build_tree(caster, film)
            ended_by = accumulate(film, plan, results, ending, on_sweep, on_progress)
        film.ended_by = ended_by or ("samples" if is_done else "cancelled")
    film.cancelled = film.ended_by == "cancelled"
    if film.width * film.height >= LARGE_PICTURE:
        release_freed_memory()  # there is to be room for the picture beside its film
    return film


def build_tree(caster: Caster, film: Film) -> None:
    """Build the tree of a caster before anything is traced: it is no part of the time of that, and each worker would
    build one of its own."""
    started = time.perf_counter()
    caster.closest_hit(*RAY)
    film.statistics.build_seconds += time.perf_counter() - started


def prepare_film(
    scene: Scene, width: int, height: int, settings: Settings, film: Film | None = None
) -> tuple[Film, FrameWindow]:
    """Return the film to render into, an empty one or `film`, and what it shows of the picture."""
    if not isinstance(film, Film | None):
        raise ValueError(f"render: film: expected a Film, such as raytracer.load_film returns, got {film!r:.80}")
    if film is not None and settings.interleaving is None:
        settings = replace(settings, interleaving=film.interleaving)
    window = make_window(scene, width, height, settings)
    new = begin_film(scene, window, settings)
    if film is None:
        return new, window
    film = continue_film(film, new)
    if film.pilot and film.samples >= film.pilot:
        check_counts(film, window, settings.seed)
    else:
        check_even_counts(film)
    return film, window


def begin_film(scene: Scene, window: FrameWindow, settings: Settings) -> Film:
    """Return an empty film that knows its picture, to render into.

    The scene is only looked at, and kept until then, if somebody asks for the film's key.
    """
    choices = {item.name: getattr(settings, item.name) for item in fields(settings)}
    choices = {name: value for name, value in choices.items() if name not in FREE_SETTINGS}
    full = (0, 0, window.full_width, window.full_height)
    size = {"width": window.full_width, "height": window.full_height, "interleaving": window.interleaving}
    sweeps = count_sweeps(settings)
    x_min, y_min, x_max, y_max = whole = settings.border or full
    is_adaptive = settings.adaptive and "Combined" in select_passes(settings.passes, from_centre=False)
    is_adaptive &= scene.motion is None  # pixels with different numbers of samples have no times to share
    return Film(
        window.width,
        window.height,
        settings.passes,
        catches=catches_shadows(derive_features(scene), settings),
        interleaving=window.interleaving,
        time_side=find_time_side(scene, window),
        exposure=settings.exposure,
        pilot=choose_pilot(sweeps, (x_max - x_min) * (y_max - y_min)) if is_adaptive else 0,
        total=sweeps,
        left=window.x_min,
        bottom=window.y_min,
        border=whole if settings.tile and whole != full else None,
        key=PictureKey({**size, **choices}, partial(digest_scene, scene)),
    )


def continue_film(film: Film, new: Film) -> Film:
    """Return `film`, or raise ValueError unless it is of the picture that `new` has been begun for."""
    name = film.label or "film"
    if film.key is None or new.key is None:
        raise ValueError(f"{name}: expected a film of raytracer.render")
    difference = describe_difference(film.key, new.key)
    for field in ("left", "bottom", "width", "height"):
        found, expected = getattr(film, field), getattr(new, field)
        if not difference and found != expected:
            difference = f"{field} is {found}, not {expected}"
    if not difference and find_outside(film) != find_outside(new):
        difference = f"border is {film.border}, not {new.border}"
    if not difference and film.pilot != new.pilot:
        difference = (
            f"its adaptive samples follow the first {film.pilot}, as those of {film.total} do, and not the first "
            f"{new.pilot}, as those of {new.total}"
        )
    begun = film.samples + film.ahead_samples * (film.ahead > 0)
    if not difference and begun > new.total:
        difference = f"it has {begun} samples already, and the picture shall have {new.total}"
    if difference:
        raise ValueError(f"{name} is of another picture: {difference}")
    film.total, film.key, film.border = new.total, new.key, film.border or new.border
    return film


def find_outside(film: Film) -> Border | None:
    """Return the border that a film is a tile of; None where it is all that is inside, or has none."""
    whole = (film.left, film.bottom, film.left + film.width, film.bottom + film.height)
    return None if film.border == whole else film.border


def check_even_counts(film: Film) -> None:
    """Raise ValueError unless all pixels of a film have as many samples as it has finished sweeps, and the first ones
    those of the next: not so where tiles were ended by an error, and merged."""
    counts = film.sums.counts
    ahead, others = counts.read(slice(0, film.ahead)), counts.read(slice(film.ahead, None))
    if (ahead.sum(axis=1) != film.samples + film.ahead_samples).any() or (others.sum(axis=1) != film.samples).any():
        raise ValueError(
            f"{film.label or 'film'} cannot go on: its tiles were ended at different numbers of samples; let them go "
            "on before they are merged"
        )


def limit_sweeps(settings: Settings, until: int | None) -> int:
    """Return the sweep to stop at."""
    sweeps = count_sweeps(settings)
    return sweeps if until is None else min(check_integer(until, 1, settings.samples, "render: until"), sweeps)


def plan_blocks(scene: Scene, film: Film, window: FrameWindow, settings: Settings, until: int | None) -> BlockPlan:
    """Return how the sweeps that a film lacks are cut into blocks."""
    growth = SWEEP_GROWTH if settings.error is not None or settings.seconds is not None else None
    sweeps = limit_sweeps(settings, until)
    if film.pilot:
        return AdaptivePlan(film, window, settings, sweeps, growth)
    size = film.width * film.height
    # What moves is traced a time after the other; and where any sweep may be the last, each is looked at by itself.
    gathers = settings.workers >= MANY_WORKERS and growth is None and scene.motion is None
    return BlockPlan(
        size,
        sweeps,
        settings.block_size,
        growth,
        workers=settings.workers,
        done=film.samples,
        ahead=film.ahead,
        ahead_samples=film.ahead_samples,
        gathered=GATHERED if gathers else 1,
        seconds=settings.seconds,
    )


def accumulate(
    film: Film,
    plan: BlockPlan,
    results: Iterator[BlockResult],
    ending: Ending,
    on_sweep: SweepCallback | None,
    on_progress: Callable[[float], None] | None,
) -> EndedBy | None:
    """Add results to the film as they come, and tell the callbacks; return what ended it, None if it was cancelled."""
    started = time.perf_counter() - film.statistics.trace_seconds
    for result in results:
        ending.begin(result.seconds)
        plan.observe(result)
        ends_sweep = plan.ends_sweep(result.block)
        ended_by = add_result(film, result, ending, ends_sweep)
        if isinstance(result.block, Block):
            film.ahead = result.block.stop % plan.pixels
        film.statistics.trace_seconds = time.perf_counter() - started
        if on_progress:
            on_progress(1.0 if ended_by else ending.estimate_share(plan.count_done(result.block)))
        if ends_sweep and on_sweep:
            on_sweep(film, film.samples, ending.sweeps)
        if ended_by:
            return ended_by
    return None


def add_result(film: Film, result: BlockResult, ending: Ending, ends_sweep: bool) -> EndedBy | None:
    """Add what a block saw to the film, sample by sample, until that ends it; return what did, or None.

    ends_sweep : True where the block's samples complete sweeps
    """
    block = result.block
    film.statistics.rays += result.rays
    if isinstance(block, ListedBlock):
        return add_listed(film, result, ending)
    pixels, ended_by = block.pixels, None
    if result.centre_values:
        film.set_centre(pixels, result.centre_values)
    if block.strip is not None:
        film.put_strip(pixels, block.strip)
        film.probes += result.probes
        film.samples += block.samples * ends_sweep
        return ending.find(film) if ends_sweep else None
    whole = len(block) == film.width * film.height
    for number in range(block.samples):
        add_sample(film, pixels, block, result.values, number)
        film.probes += select_sweep(result.probes, block.sample + number)
        film.samples += ends_sweep
        if ends_sweep and (whole or number == block.samples - 1):
            ended_by = ending.find(film, is_amid=number < block.samples - 1)
        if ended_by:
            break
    return ended_by
