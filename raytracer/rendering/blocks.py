"""Blocks of work: which samples of which pixels are traced together, and what traces them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain
from typing import ClassVar, NamedTuple, cast

import numpy as np

from raytracer.arrays.types import Floats, Indices, Words
from raytracer.casting.caster import Caster
from raytracer.casting.rays import Rays
from raytracer.film.camera import primary_rays
from raytracer.film.film import Film
from raytracer.film.parts import cut
from raytracer.film.passes import find_pass, is_pass, select_passes
from raytracer.film.pixel_filter import sample_pixel_filter
from raytracer.integrator.integrator import Integrator
from raytracer.integrator.loop import trace
from raytracer.integrator.prepare import prepare
from raytracer.integrator.settings import WORD_LIMIT, Settings, check_integer
from raytracer.lights.environment import Environment
from raytracer.lights.shared_points import choose_interleaving
from raytracer.media.majorants import Majorants
from raytracer.processes.dropping import is_dropped
from raytracer.processes.pool import Pool
from raytracer.rendering.probes import CameraSamples, add_probes, make_prober, split_probes
from raytracer.rendering.watched_caster import CancelledError, WatchedCaster
from raytracer.sampling.dimensions import FILTER_DIMENSION, FILTER_PAIR, LENS_DIMENSION, LENS_PAIR
from raytracer.sampling.sobol import REPLICATIONS, SobolSamples, split_numbers
from raytracer.scene.camera import Camera
from raytracer.scene.scene import Scene, require_scene
from raytracer.shading.evaluate import check_programs

# Any ray: what a caster builds when it is first asked, it builds for this one.
RAY = ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))


def _never() -> bool:
    return False


def say_nothing(what: object) -> None:
    """Take what a listener is told, where nobody listens."""


@dataclass(frozen=True)
class FrameWindow:
    """The camera and the part of its picture that is rendered, pixels counted from the lower left corner.

    full_width, full_height : size of the full picture
    x_min, y_min, width, height : the part of it
    interleaving : side of the squares of pixels that take different points of lights; 0 = every pixel takes its own
    """

    camera: Camera
    full_width: int
    full_height: int
    x_min: int
    y_min: int
    width: int
    height: int
    interleaving: int = 0


@dataclass(frozen=True, eq=False)
class Block:
    """Consecutive samples of some of the window's pixels, which are numbered along its rows.

    Small pictures are traced several samples at a time; a part of a picture has one.

    sample : number of the first
    start, stop : the pixels of a run
    samples : how many of each pixel
    chosen : (n,) intp, ascending numbers of the pixels, where they are no run
    strip : what the film has of the pixels, for whoever traces them to add to; None has them all sent back
    """

    sample: int
    start: int
    stop: int
    samples: int = 1
    chosen: Indices | None = None
    strip: Film | None = None

    def __len__(self) -> int:
        """Return the number of pixels."""
        return self.stop - self.start if self.chosen is None else len(self.chosen)

    @property
    def pixels(self) -> slice | Indices:
        """What indexes the block's pixels among the window's."""
        return slice(self.start, self.stop) if self.chosen is None else self.chosen


@dataclass(frozen=True, eq=False)
class ListedBlock:
    """Samples of a list, in which a pixel may be several times (`adaptive`).

    sample : number of the first sweep that they belong to
    chosen : (n,) intp, numbers of the window's pixels; numbers : (n,) uint32, those of the samples
    ends : in how many of them sweeps end, ascending
    """

    sample: int
    chosen: Indices
    numbers: Words
    ends: tuple[int, ...]
    samples: ClassVar[int] = 1

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.chosen)


@dataclass(frozen=True)
class BlockResult:
    """What the rays of a block saw, and what it took.

    values : (samples * pixels, channels) float64 by pass; none where they are in the block's strip
    centre_values : (pixels, channels) float64 by pass, of the ray through the centre, where that was asked for
    rays : how many were cast
    seconds : by the clock
    probes : what was seen by rays aimed at small light, rows of `film.missed`, one after the other
    """

    block: Block | ListedBlock
    values: Mapping[str, Floats]
    centre_values: Mapping[str, Floats] | None
    rays: int
    seconds: float
    probes: tuple[float, ...] = ()


def make_window(scene: Scene, width: int, height: int, settings: Settings) -> FrameWindow:
    """Return the FrameWindow of `scene`, or raise ValueError if there is no camera or the border does not fit."""
    require_scene(scene, "render: scene")
    width = check_integer(width, 1, None, "render: width")
    height = check_integer(height, 1, None, "render: height")
    if width * height > WORD_LIMIT:
        raise ValueError(f"render: expected a picture of at most 2^32 pixels, got {width} x {height}")
    if scene.camera is None:
        raise ValueError("Scene: camera: expected a Camera to render through, got None")
    check_programs(scene)
    x_min, y_min, x_max, y_max = settings.border or (0, 0, width, height)
    if x_max > width or y_max > height:
        raise ValueError(
            f"Settings: border: expected x_max <= {width} and y_max <= {height}, the picture's size, "
            f"got {settings.border}"
        )
    if settings.tile is not None:
        number, count = settings.tile
        x_min, y_min, x_max, y_max = cut(width, height, count, settings.border)[number - 1]
    interleaving = settings.interleaving
    if interleaving is None:
        interleaving = choose_interleaving(width * height, scene)
    return FrameWindow(scene.camera, width, height, x_min, y_min, x_max - x_min, y_max - y_min, interleaving)


def count_sweeps(settings: Settings) -> int:
    """Return the number of sweeps over the picture: one will do if nothing but pixel centres is asked for."""
    return settings.samples if select_passes(settings.passes, from_centre=False) else 1


def trace_blocks(
    pool: Pool | None,
    tracer_arguments: tuple[Scene, Caster, FrameWindow, Settings],
    phases: Iterable[Iterable[Block | ListedBlock]],
    is_cancelled: Callable[[], bool],
    on_stage: Callable[[str], None],
    make_tracer: type | None,
) -> Iterator[BlockResult]:
    """Yield the results of the blocks of one phase after the other, in order, until `is_cancelled()`.

    make_tracer : called with the tracer's arguments, and what tells it to give up; None: BlockTracer
    """
    make_tracer = make_tracer or BlockTracer
    if pool is not None:
        pool.load(make_tracer, *tracer_arguments, is_dropped)
        on_stage("Tracing")
        for blocks in phases:
            yield from pool.run(blocks, is_cancelled)
        return
    on_stage("Tracing")
    tracer = make_tracer(*tracer_arguments, is_cancelled)
    for block in chain.from_iterable(phases):
        try:
            result = tracer(block)
        except CancelledError:
            return
        yield result


class SharedParts(NamedTuple):
    """What is costly to make and decides on noise alone, so that one moment of a scene will do for others.

    background : None where the world is black, or no pass needs it
    majorants : None where there are no media
    """

    background: Environment | None = None
    majorants: Majorants | None = None


class BlockTracer:
    """Traces blocks; each worker makes one."""

    def __init__(
        self,
        scene: Scene,
        caster: Caster,
        window: FrameWindow,
        settings: Settings,
        is_cancelled: Callable[[], bool] = _never,
        shared: SharedParts | None = None,
    ) -> None:
        """Compose the stages; `shared` of another moment of the same scene."""
        self._window = window
        self._settings = settings
        self._shared = {} if shared is None else {k: part for k, part in shared._asdict().items() if part is not None}
        self._resolution = (window.full_width, window.full_height)
        self._caster = WatchedCaster(caster, is_cancelled)
        self._integrator = self._prepare(scene, from_centre=False)
        self._centre_integrator = self._prepare(scene, from_centre=True)
        self._prober = None
        if self._integrator is not None:
            self._prober = make_prober(scene, self._integrator, window.camera, self._resolution, settings)

    def _prepare(self, scene: Scene, from_centre: bool) -> Integrator | None:
        """Return an integrator for the passes of one kind, or None where there are none of it."""
        names = select_passes(self._settings.passes, from_centre)
        settings = replace(self._settings, passes=names, error=None) if names else None
        if settings is None:
            return None
        return prepare(scene, self._caster, settings, self._resolution, self._caster.take_part, **self._shared)

    @property
    def shared(self) -> SharedParts:
        """What the stages at other moments may take over."""
        if self._integrator is None:
            return SharedParts()
        media = self._integrator.media
        return SharedParts(self._integrator.background, None if media is None else media.majorants)

    def __call__(self, block: Block | ListedBlock) -> BlockResult:
        """Trace one block; raises CancelledError if the user did so meanwhile."""
        started, rays_before = time.perf_counter(), self._caster.rays
        samples, column, row = locate_pixels(self._window, block, self._settings.seed)
        values: Mapping[str, Floats] = {}
        centre_values, probes = None, None
        seen: tuple[float, ...] = ()
        if self._integrator:
            pair = samples.uniform_pair(FILTER_DIMENSION, FILTER_PAIR)
            offset = sample_pixel_filter(pair, self._settings.pixel_filter, cast(float, self._settings.filter_width))
            lens = None
            if self._window.camera.aperture_radius > 0:
                lens = samples.uniform_pair(LENS_DIMENSION, LENS_PAIR)
            starts = CameraSamples(column + offset[:, 0], row + offset[:, 1], samples, lens)
            if self._prober is not None and isinstance(block, Block):
                starts, probes = add_probes(self._prober, starts, block.sample, len(block))
            values, seen = split_probes(self._trace(self._integrator, *starts), probes)
        if self._centre_integrator and block.sample == 0:
            first = slice(0, len(block))
            centre_values = self._trace(self._centre_integrator, column[first], row[first], samples.select(first))
        values = add_to_strip(block, values)
        rays, seconds = self._caster.rays - rays_before, time.perf_counter() - started
        return BlockResult(block, values, centre_values, rays, seconds, seen)

    def _trace(
        self, integrator: Integrator, x: Floats, y: Floats, samples: SobolSamples, lens: Floats | None = None
    ) -> Mapping[str, Floats]:
        rays = primary_rays(self._window.camera, self._window.full_width, self._window.full_height, x, y, lens)
        if self._window.camera.panorama is None:
            return trace(integrator, rays, samples)
        return trace_seen(integrator, rays, samples)


def add_sample(film: Film, pixels: slice | Indices, block: Block, values: Mapping[str, Floats], number: int) -> None:
    """Add one of the samples that a block has of each of its pixels to those of a film."""
    rows = slice(number * len(block), (number + 1) * len(block))
    film.add(pixels, {name: part[rows] for name, part in values.items()}, (block.sample + number) % REPLICATIONS)


def add_to_strip(block: Block | ListedBlock, values: Mapping[str, Floats]) -> Mapping[str, Floats]:
    """Add the samples of a block to its strip of the film, where it has one; return those that are to be sent back."""
    if isinstance(block, ListedBlock) or block.strip is None:
        return values
    for number in range(block.samples):
        add_sample(block.strip, slice(None), block, values, number)
    return {}


def hand_out(film: Film, blocks: Iterable[Block | ListedBlock]) -> Iterator[Block | ListedBlock]:
    """Yield blocks, each of several samples with its strip of the film, unless earlier samples are not there yet.

    The sums are the same bit for bit, whoever adds the samples up; what is sent for a block is then as much for each
    pixel, and no longer for each sample.
    """
    for block in blocks:
        if isinstance(block, Block) and block.samples > 1:
            strip = film.cut_strip(block.pixels)
            if (strip.sums.counts.read(slice(None)).sum(axis=1) == block.sample).all():
                block = replace(block, strip=strip)
        yield block


def trace_seen(integrator: Integrator, rays: Rays, samples: SobolSamples) -> Mapping[str, Floats]:
    """Trace the rays that a panorama's lens lets through: those with a direction.

    Elsewhere the lens itself is seen, as in Cycles: black, opaque, and else a miss.
    """
    seen = np.flatnonzero(rays.directions.any(axis=1))
    values = trace(integrator, rays.select(seen), samples.select(seen))
    misses = {name: find_pass(name).miss if is_pass(name) else 0.0 for name in values}
    whole = {name: np.full((len(rays), *part.shape[1:]), misses[name]) for name, part in values.items()}
    if "Combined" in whole:
        whole["Combined"][:, 3] = 1.0
    for name, part in values.items():
        whole[name][seen] = part
    return whole


def number_pixels(window: FrameWindow, place: Indices) -> tuple[Words, Indices, Indices]:
    """Return the numbers (n,) of the window's pixels within the full picture, so that a border changes none of them,
    and their columns and rows."""
    row, column = np.divmod(place, window.width)
    row += window.y_min
    column += window.x_min
    return (row * window.full_width + column).astype(np.uint32), column, row


def locate_pixels(window: FrameWindow, block: Block | ListedBlock, seed: int) -> tuple[SobolSamples, Floats, Floats]:
    """Return a block's samples, one sample of all its pixels after the other, and the pixels' centres (x, y)."""
    place = np.arange(block.start, block.stop, dtype=np.int64) if block.chosen is None else block.chosen
    pixel, column, row = number_pixels(window, place)
    if isinstance(block, ListedBlock):  # pixels with different numbers of samples have no points of lights to share
        sample, replication = split_numbers(block.numbers)
        return SobolSamples(pixel, sample, seed, None, replication), column + 0.5, row + 0.5
    number = np.repeat(np.arange(block.sample, block.sample + block.samples, dtype=np.uint32), len(pixel))
    sample, replication = split_numbers(number)
    side, group = window.interleaving, None
    if side:
        group = np.tile((row % side * side + column % side).astype(np.uint8), block.samples)
    x, y = (np.tile(values + 0.5, block.samples) for values in (column, row))
    return SobolSamples(np.tile(pixel, block.samples), sample, seed, group, replication), x, y
