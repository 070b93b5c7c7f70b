"""What the last render of each scene took, for the panel and the command line; never stored in the .blend."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from typing import Any

from raytracer.film.parts import ENDINGS

from ..extract.warnings import Warning


@dataclass(frozen=True)
class Statistics:
    """One frame: all its view layers together.

    passes : names of the passes rendered, as in `passes.PASSES`
    width, height : pixels rendered (of the border, or of a tile, where one is set)
    samples : samples per pixel that were finished
    triangles : triangles in the scene, each instance counted, of the largest view layer
    rays : rays cast, of every kind
    build_seconds, trace_seconds : preparing the acceleration structure, tracing
    total_seconds : all of it, with reading the scene
    peak_memory_mb : the most memory that the process ever held, or None where the system does not tell
    warnings : one for each thing that was not rendered as the scene says
    cancelled : True where the user stopped it
    ended_by : why it has no more samples, 'samples', 'error', 'time' or 'cancelled'; of several view layers the first
        of `film.parts.ENDINGS` that is true of one: an error, if they all have it
    error, error_interval, error_p99, error_note : how wrong Combined is, of the view layer where that is most
        (`raytracer.film.error.PictureError`)
    denoised : True where Combined was denoised; the error is that of the samples
    """

    passes: tuple[str, ...]
    width: int
    height: int
    samples: int
    triangles: int
    rays: int
    build_seconds: float
    trace_seconds: float
    total_seconds: float
    peak_memory_mb: float | None
    warnings: tuple[Warning, ...]
    cancelled: bool = False
    ended_by: str = "samples"
    error: float = math.inf
    error_interval: tuple[float, float] = (0.0, math.inf)
    error_p99: float = math.inf
    error_note: str = ""
    denoised: bool = False

    @property
    def rays_per_second(self) -> float:
        """Rays over tracing time, 0 before anything was traced."""
        return self.rays / self.trace_seconds if self.trace_seconds > 0 else 0.0


_last: dict[int, Statistics] = {}


def last_render(scene: Any) -> Statistics | None:
    """Return the Statistics of the last render of a Blender scene in this session, or None."""
    return _last.get(scene.session_uid)


def record_view_layer(scene: Any, statistics: Statistics, first: bool) -> None:
    """Store what a view layer took; the first one of a frame starts anew, the others add to it."""
    previous = None if first else last_render(scene)
    _last[scene.session_uid] = _add(previous, statistics) if previous else statistics


def forget_all() -> None:
    """Forget every scene."""
    _last.clear()


def _add(one: Statistics, other: Statistics) -> Statistics:
    worse = max(one, other, key=lambda layer: layer.error)
    return Statistics(
        passes=tuple(dict.fromkeys(one.passes + other.passes)),
        width=other.width,
        height=other.height,
        samples=min(one.samples, other.samples),
        triangles=max(one.triangles, other.triangles),
        rays=one.rays + other.rays,
        build_seconds=one.build_seconds + other.build_seconds,
        trace_seconds=one.trace_seconds + other.trace_seconds,
        total_seconds=one.total_seconds + other.total_seconds,
        peak_memory_mb=other.peak_memory_mb,
        warnings=tuple(dict.fromkeys(one.warnings + other.warnings)),
        cancelled=one.cancelled or other.cancelled,
        ended_by=next(ending for ending in (*ENDINGS, "") if ending in (one.ended_by, other.ended_by)),
        error=worse.error,
        error_interval=worse.error_interval,
        error_p99=worse.error_p99,
        error_note=worse.error_note,
        denoised=one.denoised or other.denoised,
    )


def count_triangles(scene: Any) -> int:
    """Return how many triangles a raytracer.Scene shows, each instance counted."""
    counts = [len(mesh.triangles) for mesh in scene.meshes]
    placed = range(len(counts)) if scene.instances is None else scene.instances.mesh
    return sum(counts[mesh] for mesh in placed)


def read_peak_memory() -> float | None:
    """Return the most memory the process ever held, in 10^6 bytes, or None where the system does not tell."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    unit = 1 if sys.platform == "darwin" else 1024  # getrusage counts bytes on macOS, KiB elsewhere
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6
