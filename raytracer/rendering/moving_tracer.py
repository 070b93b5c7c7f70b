"""Traces blocks of a scene in motion: pixels that are seen at one time together, in the scene as it is then.

Everything is as exact as where nothing moves, and passes from one point, or to one lamp, stay such. What a time costs
is a scene of its own: its geometry is packed again, trees over meshes that deform are built anew, those of others are
taken from the scene's caster, and stages are composed. Moments of the latest sweep are kept for its next block.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from raytracer.arrays.types import Floats, Indices
from raytracer.casting.caster import Caster, build
from raytracer.film.passes import find_pass
from raytracer.film.shutter import choose_side, find_middle, sample_times
from raytracer.integrator.features import has_media
from raytracer.integrator.settings import Settings
from raytracer.rendering.blocks import (
    Block,
    BlockResult,
    BlockTracer,
    FrameWindow,
    ListedBlock,
    SharedParts,
    _never,
    add_to_strip,
    number_pixels,
)
from raytracer.scene.moments import find_moment, moves_geometry
from raytracer.scene.scene import Scene

# The triangles, spheres and points of curves of all moments that are kept at once, at most; each takes some hundred
# bytes.
KEPT_PRIMITIVES = 1 << 21


def count_moving(scene: Scene) -> int:
    """Return the primitives of a scene in which more moves than the camera, else 0."""
    if scene.motion is None or not moves_geometry(scene.motion):
        return 0
    triangles = np.array([len(mesh.triangles) for mesh in scene.meshes], dtype=np.int64)
    placed = triangles.sum() if scene.instances is None else triangles[scene.instances.mesh].sum()
    return int(placed) + sum(len(group.radii) for group in scene.groups)


def find_time_side(scene: Scene, window: FrameWindow) -> int:
    """Return the side of the squares whose pixels take different times, 0 of a scene where nothing moves."""
    if scene.motion is None:
        return 0
    return choose_side(window.full_width * window.full_height, count_moving(scene))


class MovingTracer:
    """Traces blocks as BlockTracer does, of a scene with motion."""

    def __init__(
        self,
        scene: Scene,
        caster: Caster,
        window: FrameWindow,
        settings: Settings,
        is_cancelled: Callable[[], bool] = _never,
    ) -> None:
        assert scene.motion is not None
        self._scene, self._caster, self._window = scene, caster, window
        self._motion, self._settings, self._is_cancelled = scene.motion, settings, is_cancelled
        primitives = count_moving(scene)
        self._side = find_time_side(scene, window)
        self._sampled = _select(settings, from_centre=False)
        self._centred = _select(settings, from_centre=True)
        self._moments: dict[float, BlockTracer] = {}
        # Trees of later moments take the blocks of the first, which its rays have had built.
        self._like: Caster | None = None
        self._most = max(1, KEPT_PRIMITIVES // max(1, primitives))
        # Of the middle of the time, whichever comes first: workers begin with different ones.
        self._shared = SharedParts()
        if (scene.world is not None and scene.world.program is not None) or has_media(scene):
            self._shared = BlockTracer(scene, caster, window, settings, is_cancelled).shared

    def __call__(self, block: Block | ListedBlock) -> BlockResult:
        """Trace one block; raises CancelledError if the user did so meanwhile."""
        assert isinstance(block, Block)
        started, rays = time.perf_counter(), 0
        values: dict[str, Floats] = {}
        probes: tuple[float, ...] = ()
        for number in range(block.samples) if self._sampled else ():
            first = number * len(block)
            for rows, part, moment in self._split(block, block.sample + number):
                result = self._trace(self._sampled, part, moment)
                rays, probes = rays + result.rays, probes + result.probes
                _put(values, first + rows, result.values, block.samples * len(block))
        centre_values: dict[str, Floats] | None = None
        if self._centred and block.sample == 0:
            centre_values = {}
            for rows, part, moment in self._split(block, None):
                result = self._trace(self._centred, part, moment)
                rays += result.rays
                _put(centre_values, rows, result.centre_values or {}, len(block))
        seconds = time.perf_counter() - started
        return BlockResult(block, add_to_strip(block, values), centre_values, rays, seconds, probes)

    def _split(self, block: Block, number: int | None) -> Iterator[tuple[Indices, Block, float]]:
        """Yield the rows of a block's pixels that are seen at one time, as a block of their own, and the time.

        number : of the sample; None is the middle of what each pixel sees
        """
        place = np.arange(block.start, block.stop) if block.chosen is None else block.chosen
        _, column, row = number_pixels(self._window, place)
        height = self._window.full_height
        if number is None:
            times = find_middle(self._motion, row, height)
        else:
            times = sample_times(self._motion, number, self._settings.seed, self._side, column, row, height)
        moments, key = np.unique(times, return_inverse=True)
        for index, moment in enumerate(moments.tolist()):
            rows = np.flatnonzero(key == index)
            yield rows, Block(number or 0, block.start, block.stop, chosen=place[rows]), moment

    def _trace(self, settings: Settings | None, part: Block, moment: float) -> BlockResult:
        """Trace pixels at a time."""
        assert settings is not None
        if settings is self._centred:
            return self._make_tracer(settings, moment)(part)
        if moment not in self._moments:
            while len(self._moments) >= self._most:
                del self._moments[next(iter(self._moments))]
            self._moments[moment] = self._make_tracer(settings, moment)
        return self._moments[moment](part)

    def _make_tracer(self, settings: Settings, moment: float) -> BlockTracer:
        scene, caster = find_moment(self._scene, moment), self._caster
        if moves_geometry(self._motion):
            caster = build(scene, caster.primitives.precision, last=self._like or caster)
            self._like = self._like or caster
        assert scene.camera is not None
        window = replace(self._window, camera=scene.camera)
        return BlockTracer(scene, caster, window, settings, self._is_cancelled, self._shared)


def _select(settings: Settings, from_centre: bool) -> Settings | None:
    """Return the settings of the passes of one kind, or None where there are none of it."""
    names = tuple(name for name in settings.passes if find_pass(name).from_centre == from_centre)
    return replace(settings, passes=names, error=None) if names else None


def _put(target: dict[str, Floats], rows: Indices, values: object, count: int) -> None:
    """Put values (k, channels), by pass, into some rows of `count`."""
    assert isinstance(values, dict)
    for name, part in values.items():
        if name not in target:
            target[name] = np.empty((count, part.shape[1]))
        target[name][rows] = part
