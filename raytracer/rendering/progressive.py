"""A picture that refines: coarse at first, then fine, then sample by sample; what a viewport shows while one works.

A coarse picture is the fine one in larger pixels: each covers `factor` x `factor` of them, so both lie over each other
exactly. The fine picture is `render`'s own, bit for bit.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.casting.caster import Caster
from raytracer.film.film import Film
from raytracer.film.sensor import choose_sensor_side, measure_fitted_side
from raytracer.integrator.settings import Border
from raytracer.processes.pool import Pool
from raytracer.rendering.render import render
from raytracer.scene.camera import Camera
from raytracer.scene.scene import Scene

# Seconds until something is to be seen, if the last picture's pace can be held; the coarsest pixels for that.
FIRST_SECONDS = 0.06
COARSEST = 16
# Pixels of a coarse picture below which nothing can be told from it.
FEWEST_PIXELS = 1 << 10
# Before any pace is known.
FIRST_FACTOR = 8
# Seconds that the finest picture must take by the last one's pace, for others to help with it: to start or load them
# takes about one, of as many cores.
LONG_SECONDS = 2.0


@dataclass(frozen=True)
class Target:
    """What to draw.

    camera : through which the whole frame of width x height pixels is seen
    border : the part of the frame to draw, (x_min, y_min, x_max, y_max), y up; None draws all
    pixel_size : side, in pixels of the frame, of the finest pixels that are drawn
    samples : of each of the finest pixels
    workers : processes that may draw the finest picture
    settings : other keywords of `render`
    """

    camera: Camera
    width: int
    height: int
    border: Border | None = None
    pixel_size: int = 1
    samples: int = 32
    workers: int = 1
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Picture:
    """What is seen so far.

    pixels : (h, w, 4) float32, linear, premultiplied; row 0 is the LOWEST, as textures have it
    left, bottom, right, top : where in the frame they lie, pixels of the frame; may reach over its edge or the border's
    samples, total : finished samples, of so many; 0 while the pixels are coarse
    error : `Film.error`; inf where it is unknown
    """

    pixels: NDArray[np.float32]
    left: int
    bottom: int
    right: int
    top: int
    samples: int
    total: int
    error: float = math.inf


def refine(
    scene: Scene,
    caster: Caster,
    target: Target,
    show: Callable[[Picture], None],
    is_cancelled: Callable[[], bool],
    pace: float = 0.0,
    find_helpers: Callable[[int], Pool] | None = None,
) -> float:
    """Show ever better pictures of `scene` until `target` is met or the user cancels.

    pace : pixels per second, as this function last returned it for a similar scene; 0 = unknown
    find_helpers : returns a Pool of so many workers; called where the finest picture takes long and may have several

    Returns
    -------
    The pace of the last picture that was finished, or `pace`
    """
    for factor in list_factors(target, pace):
        is_final = factor == target.pixel_size
        started = time.perf_counter()

        def show_film(film: Film, done: int, total: int, factor: int = factor, is_final: bool = is_final) -> None:
            show(develop(film, target, factor, (done, total) if is_final else (0, target.samples)))

        helpers = find_helpers(target.workers) if is_final and find_helpers and wants_helpers(target, pace) else 1
        samples = target.samples if is_final else 1
        film = render_coarse(scene, caster, target, factor, samples, show_film, is_cancelled, helpers)
        if film.cancelled:
            break
        if not is_final:
            pace = film.width * film.height / max(time.perf_counter() - started, 1e-9)
    return pace


def list_factors(target: Target, pace: float) -> Iterator[int]:
    """Yield the sides of the pixels of one picture after the other, halved each time, in pixels of the frame.

    The first picture has so many pixels as the pace promises within FIRST_SECONDS.
    """
    width, height = measure_part(target)
    factor = FIRST_FACTOR
    if pace > 0:
        side = math.sqrt(width * height / (pace * FIRST_SECONDS))
        factor = 1 << max(0, math.ceil(math.log2(side)))
    largest = math.sqrt(width * height / FEWEST_PIXELS) / target.pixel_size
    factor = min(factor, COARSEST, 1 << max(0, math.floor(math.log2(max(largest, 1.0)))))
    while factor > 1:
        yield factor * target.pixel_size
        factor //= 2
    yield target.pixel_size


def wants_helpers(target: Target, pace: float) -> bool:
    """Return whether the finest picture may have several workers and takes LONG_SECONDS by the pace, if it is known."""
    width, height = measure_part(target)
    rays = width * height * target.samples / target.pixel_size**2
    return target.workers > 1 and pace > 0 and rays > pace * LONG_SECONDS


def measure_part(target: Target) -> tuple[int, int]:
    """Return width and height of the part of the frame that is drawn, pixels."""
    x_min, y_min, x_max, y_max = target.border or (0, 0, target.width, target.height)
    return x_max - x_min, y_max - y_min


def render_coarse(
    scene: Scene,
    caster: Caster,
    target: Target,
    factor: int,
    samples: int,
    on_sweep: Callable[[Film, int, int], None],
    is_cancelled: Callable[[], bool],
    workers: int | Pool = 1,
) -> Film:
    """Render the target in pixels of factor x factor; those at the right and upper edge may reach over it."""
    width, height = -(-target.width // factor), -(-target.height // factor)
    return render(
        replace(scene, camera=coarsen(target.camera, target.width, target.height, factor)),
        width,
        height,
        samples,
        caster=caster,
        workers=workers,
        border=coarsen_border(target.border, factor),
        on_sweep=on_sweep,
        is_cancelled=is_cancelled,
        **target.settings,
    )


def coarsen(camera: Camera, width: int, height: int, factor: int) -> Camera:
    """Return the camera whose pixel (i, j), of ceil(width / factor) columns, covers `factor` x `factor` of `camera`'s.

    With extent e and shift s, the point x of the frame is seen at e ((x - w / 2) / fitted + s); at x = factor X that
    is e' ((X - w' / 2) / fitted' + s'), where w' = ceil(w / factor), e' = e factor fitted' / fitted and
    s' = e / e' ((factor w' - w) / (2 fitted) + s). A panorama spans as much more as the coarse pixels reach over.
    """
    if factor == 1:
        return camera
    columns, rows = -(-width // factor), -(-height // factor)
    if camera.panorama is not None:
        span = camera.panorama.span[0] * factor * columns / width, camera.panorama.span[1] * factor * rows / height
        return replace(camera, panorama=replace(camera.panorama, span=span))
    fit = "horizontal" if measure_fitted_side(camera, width, height) == width else "vertical"
    side = choose_sensor_side(camera)
    fixed = replace(camera, sensor_fit=fit, sensor_height=side, sensor_width=side)
    fitted = measure_fitted_side(fixed, width, height)
    gain = factor * measure_fitted_side(fixed, columns, rows) / fitted
    return replace(
        fixed,
        focal_length=fixed.focal_length / gain,
        ortho_scale=fixed.ortho_scale * gain,
        shift_x=((factor * columns - width) / (2 * fitted) + fixed.shift_x) / gain,
        shift_y=((factor * rows - height) / (2 * fitted * fixed.pixel_aspect) + fixed.shift_y) / gain,
    )


def coarsen_border(border: Border | None, factor: int) -> Border | None:
    """Return the coarse pixels that a border touches."""
    if border is None:
        return None
    x_min, y_min, x_max, y_max = border
    return x_min // factor, y_min // factor, -(-x_max // factor), -(-y_max // factor)


def develop(film: Film, target: Target, factor: int, samples: tuple[int, int]) -> Picture:
    """Return a film of the target's Combined pass as a Picture."""
    x_min, y_min, _, _ = coarsen_border(target.border, factor) or (0, 0, 0, 0)
    left, bottom = x_min * factor, y_min * factor
    right, top = left + film.width * factor, bottom + film.height * factor
    pixels = np.ascontiguousarray(film["Combined"][::-1])
    return Picture(pixels, left, bottom, right, top, *samples, film.error if samples[0] > 1 else math.inf)
