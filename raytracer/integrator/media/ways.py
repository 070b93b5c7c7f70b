"""Ways of paths to what they hit, and the media that these lead through."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from raytracer.arrays.types import Booleans, Colors, Indices, Integers, Numbers, Vectors
from raytracer.casting.rays import Hits, select_rows
from raytracer.integrator.bounces import find_closed, find_finished
from raytracer.integrator.integrator import Integrator
from raytracer.integrator.media.scene_media import SceneMedia
from raytracer.integrator.media.shadow_media import find_passing
from raytracer.integrator.paths import Paths
from raytracer.lecture import length
from raytracer.sampling.dimensions import NOISE
from raytracer.sampling.sampler import Sampler
from raytracer.sampling.streams import Noise, draw, start_noise

# Streams of random numbers: of ways to lights that are seen; of what a point that is chosen for a light sees.
SEEN, CHOSEN = 2**10, 2**11


@dataclass(frozen=True, eq=False, slots=True)
class Ways:
    """k paths on their way to what they hit.

    paths : their throughput is that at the start
    inside : (k, d) int32, numbers of the media that they go through
    direction : (k, 3) float64, unit; start, end : (k,) metres from the origins of their rays
    scatters : (k,) bool, False for paths that only see what shines
    noise : (k,) streams of random numbers
    sampler : of the paths, from the wave's dimensions on
    """

    paths: Paths
    inside: Integers
    direction: Vectors
    start: Numbers
    end: Numbers
    scatters: Booleans
    noise: Noise
    sampler: Sampler

    def __len__(self) -> int:
        return len(self.start)

    @property
    def length(self) -> Numbers:
        """(k,) metres."""
        return self.end - self.start

    @property
    def origin(self) -> Vectors:
        """(k, 3) of the rays."""
        return self.paths.rays.origins

    def select(self, rows: Indices) -> Ways:
        """Return some of the ways."""
        return select_rows(self, rows)

    def find_points(self, distance: Numbers) -> Vectors:
        """Return the points (k, 3) at distances (k,) from their starts."""
        return self.origin + (self.start + distance)[:, np.newaxis] * self.direction


def find_media(integrator: Integrator) -> SceneMedia:
    """Return the media of a scene that has any."""
    assert integrator.media is not None
    return integrator.media


def find_dimension(integrator: Integrator) -> int:
    """Return the first numbered dimension of ways through media."""
    assert integrator.dimensions.medium is not None
    return integrator.dimensions.medium


def find_ways(integrator: Integrator, media: SceneMedia, paths: Paths, hits: Hits, sampler: Sampler) -> Ways:
    """Return the ways of paths to what they hit."""
    assert paths.media is not None
    unit = length(paths.rays.directions)
    start = np.maximum(paths.travelled, np.maximum(paths.rays.t_min, 0.0) * unit)
    end = np.maximum(np.where(hits.hit, hits.distance, paths.rays.t_max) * unit, start)
    inside = media.list_inside(paths.media)
    # A ray that gets away has missed the border of what it seems to be inside of: it went along an edge of it.
    away = np.isinf(end)[:, np.newaxis] & media.closed[inside]
    inside = np.where(away, np.int32(media.table.world + 1), inside)
    own = replace(sampler.select(paths.row), shared=None)
    return Ways(
        paths,
        inside,
        paths.rays.directions / unit[:, np.newaxis],
        start,
        end,
        ~(find_finished(integrator, paths) | find_closed(integrator, paths)),
        start_noise(own.uniform_pair(find_dimension(integrator) + NOISE)),
        own,
    )


def dim_light(media: SceneMedia, ways: Ways, rows: Indices, distance: Numbers) -> Colors:
    """Return the share (n, 3) of light that gets from so many metres away to the starts of some of the ways."""
    some = ways.select(rows)
    noise = draw_stream(some.noise, SEEN)
    return find_passing(media, some.inside, some.origin, some.direction, some.start, distance, noise)


def draw_stream(noise: Noise, number: int) -> Noise:
    """Return streams (n,) of random numbers apart from others of the same ways."""
    return start_noise(np.stack([draw(noise, 2**22 + number), draw(noise, 2**23 + number)], axis=1))


def find_first(media: SceneMedia, inside: Integers) -> Integers:
    """Return the first (k,) of the media (k, d) that ways lead through."""
    place = (inside <= media.table.world).argmax(axis=1)
    return inside[np.arange(len(inside)), place]
