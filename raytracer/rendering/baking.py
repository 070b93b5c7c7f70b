"""Light and surfaces seen at given points of the scene, which fill the pixels of a texture ("baking").

A texture's pixel names a point of a triangle. Its path begins there, as if a ray had come to it along the shading
normal, or from a camera; all that follows is the integrator's (`loop.trace`). Samples are spread over the pixel: where
it is on the triangle changes linearly from pixel to pixel, and what would leave the triangle is folded back into it.

References
----------
Blender, intern/cycles/kernel/integrator/init_from_bake.h: folding, and how far a camera may look along a surface.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.types import Floats, Integers, Vectors, Words
from raytracer.arrays.vectors import normalize
from raytracer.casting.caster import Caster
from raytracer.casting.rays import Hits, Rays
from raytracer.integrator.integrator import Integrator
from raytracer.integrator.loop import trace
from raytracer.integrator.prepare import prepare
from raytracer.integrator.settings import Settings
from raytracer.lecture import dot
from raytracer.processes.dropping import is_dropped
from raytracer.processes.pool import Pool
from raytracer.processes.workers import Workers
from raytracer.rendering.blocks import RAY, _never
from raytracer.rendering.watched_caster import CancelledError, WatchedCaster
from raytracer.sampling.dimensions import FILTER_DIMENSION, FILTER_PAIR
from raytracer.sampling.sobol import SobolSamples, split_numbers
from raytracer.scene.scene import Scene
from raytracer.shading.evaluate import check_programs
from raytracer.surfaces.surface import Surface, make_surface

# Points traced at a time, several samples of each where there are few.
BLOCK_SIZE = 1 << 15
# The least cosine between what looks at a surface and its shading normal, which is Cycles' own: a camera that sees it
# from the side or from behind is taken to be so far above it, or glossy surfaces would be black there.
LEAST_COSINE = 0.2


@dataclass(frozen=True, eq=False)
class BakePoints:
    """n points of triangles.

    pixel : (n,) uint32, the texture's pixel, which chooses random numbers
    instance, primitive : (n,) int32, as in Hits
    weights : (n, 2) float64, barycentric weights of corners 0 and 1 at the pixel's centre
    steps : (n, 2, 2) float64, by how much each weight (first axis) changes from a pixel to the next in x and in y
    """

    pixel: Words
    instance: Integers
    primitive: Integers
    weights: Floats
    steps: Floats

    def __len__(self) -> int:
        return len(self.pixel)

    def select(self, rows: Any) -> BakePoints:
        """Return some of the points: index or slice."""
        return BakePoints(
            self.pixel[rows], self.instance[rows], self.primitive[rows], self.weights[rows], self.steps[rows]
        )


@dataclass(frozen=True, eq=False)
class Eye:
    """What surfaces are looked at from: a place (3,), or, endlessly far away, the direction (3,) towards it."""

    place: Vectors | None
    direction: Vectors | None = None

    def find_directions(self, position: Floats) -> Floats:
        """Return the unit directions (n, 3) towards it from points (n, 3)."""
        towards = self.direction if self.place is None else self.place - position
        return normalize(np.broadcast_to(np.asarray(towards, dtype=np.float64), position.shape))


def bake(
    scene: Scene,
    caster: Caster,
    settings: Settings,
    points: BakePoints,
    *,
    eye: Eye | None = None,
    workers: int | Pool = 1,
    on_progress: Callable[[float], None] | None = None,
    is_cancelled: Callable[[], bool] | None = None,
) -> dict[str, Floats] | None:
    """Return what is seen at points: means over all samples, (n, channels) by pass, or None if it was cancelled.

    Light passes hold light, not divided by their colors.

    Parameters
    ----------
    settings : its passes, samples, seed, bounces and limits count
    eye : from where surfaces are seen; None: each along its own shading normal
    workers : number of processes, or a Pool
    """
    check_programs(scene)
    watch = is_cancelled or _never
    blocks = cut_into_blocks(len(points), settings.samples)
    sums: dict[str, Floats] = {}
    with ExitStack() as stack:
        pool = workers if isinstance(workers, Pool) else None
        if isinstance(workers, int) and workers > 1:
            pool = stack.enter_context(Workers(workers))
        for number, (start, values) in enumerate(_run(pool, (scene, caster, settings, points, eye), blocks, watch)):
            for name, part in values.items():
                whole = sums.setdefault(name, np.zeros((len(points), part.shape[1])))
                whole[start : start + len(part)] += part
            if on_progress:
                on_progress((number + 1) / len(blocks))
    if watch():
        return None
    return {name: values / settings.samples for name, values in sums.items()}


# The first sample, how many samples, the first point, and the one after the last.
Block = tuple[int, int, int, int]
# The first point, and the sums over samples.
BlockValues = tuple[int, dict[str, Floats]]


def cut_into_blocks(points: int, samples: int) -> list[Block]:
    """Return the blocks of work, which depend on nothing else: so do the sums.

    Examples
    --------
    >>> cut_into_blocks(BLOCK_SIZE // 4, 6)
    [(0, 4, 0, 8192), (4, 2, 0, 8192)]
    >>> cut_into_blocks(BLOCK_SIZE + 1, 2)
    [(0, 1, 0, 32768), (0, 1, 32768, 32769), (1, 1, 0, 32768), (1, 1, 32768, 32769)]
    """
    together = max(1, BLOCK_SIZE // max(1, points))
    return [
        (sample, min(together, samples - sample), start, min(start + BLOCK_SIZE, points))
        for sample in range(0, samples, together)
        for start in range(0, points, BLOCK_SIZE)
    ]


def _run(
    pool: Pool | None, arguments: Any, blocks: Iterable[Block], is_cancelled: Callable[[], bool]
) -> Iterator[BlockValues]:
    """Yield what blocks see, in order, until it is cancelled."""
    if pool is not None:
        _, caster, *_ = arguments
        caster.closest_hit(*RAY)  # its tree is built here, and shared: each worker would build one of its own
        pool.load(PointTracer, *arguments, is_dropped)
        yield from pool.run(blocks, is_cancelled)
        return
    tracer: Callable[[Block], BlockValues] = PointTracer(*(*arguments, is_cancelled))
    for block in blocks:
        try:
            values = tracer(block)
        except CancelledError:
            return
        yield values


class PointTracer:
    """Traces one sample of some of the points; each worker makes one."""

    def __init__(
        self,
        scene: Scene,
        caster: Caster,
        settings: Settings,
        points: BakePoints,
        eye: Eye | None,
        is_cancelled: Callable[[], bool],
    ) -> None:
        self._points, self._settings, self._eye = points, settings, eye
        watched = WatchedCaster(caster, is_cancelled)
        self._integrator = prepare(scene, watched, settings, take_part=watched.take_part)

    def __call__(self, block: Block) -> BlockValues:
        """Trace some samples of some points."""
        first, count, start, stop = block
        own = self._points.select(slice(start, stop))
        points = own.select(np.tile(np.arange(len(own)), count))
        number = np.repeat(np.arange(first, first + count, dtype=np.uint32), len(own))
        sample, replication = split_numbers(number)
        samples = SobolSamples(points.pixel, sample, self._settings.seed, None, replication)
        hits = self._hit(points, samples)
        surface = find_surface(self._integrator, hits)
        values = trace(self._integrator, look_at(surface, self._eye), samples, hits)
        return start, {name: part.reshape(count, len(own), -1).sum(axis=0) for name, part in values.items()}

    def _hit(self, points: BakePoints, samples: SobolSamples) -> Hits:
        """Return where rays from a distance of 1 hit the points, spread over their pixels; one sample is the centre."""
        weights = points.weights
        if self._settings.samples > 1:
            offset = samples.uniform_pair(FILTER_DIMENSION, FILTER_PAIR) - 0.5
            moved = (points.steps * offset[:, np.newaxis, :]).sum(axis=2)
            weights = fold_into_triangle(weights + moved)
        count = len(points)
        rest = 1.0 - weights[:, 0] - weights[:, 1]
        barycentric = np.stack([weights[:, 1], rest], axis=1)
        valid = np.ones(count, dtype=np.bool_)
        return Hits(np.ones(count), np.zeros(count), points.instance, points.primitive, barycentric, valid)


def fold_into_triangle(weights: Floats) -> Floats:
    """Return weights (n, 2) that are at least 0 and sum to 1 at most; those beyond an edge are reflected there.

    Examples
    --------
    >>> fold_into_triangle(np.array([[0.5, 0.25], [-0.25, 0.5], [0.75, 0.5]])).tolist()
    [[0.5, 0.25], [0.25, 0.5], [0.75, 0.0]]
    """
    first = _fold(weights[:, 0], np.ones(len(weights)))
    return np.stack([first, _fold(weights[:, 1], 1.0 - first)], axis=1)


def _fold(values: NDArray[np.float64], most: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return values (n,) reflected at 0 and at `most` until they lie between."""
    turns = np.divide(values, most, out=np.zeros_like(values), where=most > 0) % 2.0
    folded: NDArray[np.float64] = np.where(turns > 1.0, 2.0 - turns, turns) * most
    return folded


def find_surface(integrator: Integrator, hits: Hits) -> Surface:
    """Return the surfaces at points, seen from the side that their geometric normals point to."""
    count = len(hits)
    anywhere = Rays(np.zeros((count, 3)), np.ones((count, 3)), np.zeros(count), np.full(count, np.inf))
    surface = make_surface(integrator.tables, anywhere, hits)
    return replace(surface, outgoing=surface.geometric_normal, front=np.ones(count, dtype=np.bool_))


def look_at(surface: Surface, eye: Eye | None) -> Rays:
    """Return the rays that come to n points from a distance of 1: along the shading normal, or from an eye.

    Of a direction d towards the eye and the normal n with d . n below LEAST_COSINE, d - n (d . n - LEAST_COSINE).
    """
    towards = normal = surface.shading_normal
    if eye is not None:
        towards = eye.find_directions(surface.position)
        short = np.minimum(dot(towards, normal) - LEAST_COSINE, 0.0)
        towards = normalize(towards - short[:, np.newaxis] * normal)
    count = len(towards)
    return Rays(surface.position + towards, -towards, np.zeros(count), np.full(count, np.inf))
