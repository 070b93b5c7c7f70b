"""Probes: camera rays aimed at small light, traced beside the samples of the first sweeps (`film.missed`).

A sample of pixel i goes through the point x of the film with the density f(x - c_i), where c_i is the pixel's centre
and f the filter, and through an even point of the lens. So the samples of a sweep that see a light, which lies at x for
a point of the lens and has there the density 1 / s of points y for each pixel of the film, are in number

    sum_i f(x - c_i) s

in the mean over y and the lens, however much either blurs it. A probe's sight is picked with a chance q, its y has the
density 1 / A there, and k (`find_through_lens`) is the film's pixels for each square metre: s = A k / q. Of N probes
each has the weight s sum_i f / N; its pixel is picked in proportion to f. A ray goes through several triangles of
a mesh and sees the first: what is aimed at another of them is left out. (Of emissive spheres, which seldom lie behind
each other, that is not asked.)

A probe is its pixel's own sample, but for where it goes through film and lens: so nothing is known of it that is not of
samples, and with all that changes what they see, it changes too. In a moving scene it is seen as its pixel sees the
scene at that sample's time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import NamedTuple

import numpy as np

from raytracer.arrays.types import Floats, Indices
from raytracer.casting.ray_visibility import CastRays
from raytracer.film.aiming import find_through_lens
from raytracer.film.camera import primary_rays
from raytracer.film.missed import SWEEPS
from raytracer.film.pixel_filter import find_filter_density, find_reach
from raytracer.integrator.features import has_emission
from raytracer.integrator.integrator import Integrator
from raytracer.integrator.prepare import light_is_on
from raytracer.integrator.scene_records import gather_records
from raytracer.integrator.settings import Settings
from raytracer.lights.emitter_table import Emitters
from raytracer.lights.lights import has_extent
from raytracer.lights.sights import Sights, find_other_emitters, find_sights, place_sights
from raytracer.sampling.dimensions import SIGHT_DIMENSION
from raytracer.sampling.sobol import SobolSamples
from raytracer.scene.camera import Camera
from raytracer.scene.fields import SEEN_BY
from raytracer.scene.lights import Light
from raytracer.scene.scene import Scene

# Probes of a sweep.
COUNT = 32


@dataclass(frozen=True, eq=False)
class Probes:
    """k probes.

    sweep, number : (k,) which sweep's they are, and which of it
    column, row : (k,) their pixels in the full picture
    x, y : (k,) float64, points of the film, pixels
    lens : (k, 2) uniform numbers
    weight : (k,) float64, of how many samples of the sweep each is an example
    """

    sweep: Indices
    number: Indices
    column: Indices
    row: Indices
    x: Floats
    y: Floats
    lens: Floats
    weight: Floats

    def __len__(self) -> int:
        return len(self.weight)

    def select(self, rows: Indices) -> Probes:
        """Return some of the probes."""
        return Probes(*(getattr(self, item.name)[rows] for item in fields(self)))


class CameraSamples(NamedTuple):
    """What n camera rays start with: points (x, y) of the film (n,), the samples' numbers, and points of the lens
    (n, 2) as uniform numbers, or None."""

    x: Floats
    y: Floats
    samples: SobolSamples
    lens: Floats | None


@dataclass(frozen=True, eq=False)
class Prober:
    """Aims probes.

    emitters, hidden, lights : as of `find_sights`
    cast : finds what rays hit
    width, height : of the full picture
    """

    emitters: Emitters | None
    hidden: Indices | None
    lights: Sequence[Light]
    cast: CastRays
    camera: Camera
    width: int
    height: int
    settings: Settings

    @cached_property
    def sights(self) -> Sights | None:
        """What probes are aimed at; None where there is nothing. Later sweeps, of other moments, never ask for it."""
        return find_sights(self.emitters, self.hidden, self.lights, self.camera, self.width, self.height)

    def aim(self, sights: Sights, sweeps: range) -> Probes:
        """Return the probes of some sweeps that fall into the full picture."""
        camera = self.camera
        sweep, number = np.repeat(sweeps, COUNT), np.tile(np.arange(COUNT), len(sweeps))
        # Four sequences for each sweep: which light, where on it, through where of the lens, of which pixel.
        keys = (4 * sweep + np.arange(4)[:, np.newaxis]).ravel().astype(np.uint32)
        samples = SobolSamples(keys, np.tile(number.astype(np.uint32), 4), self.settings.seed)
        numbers = samples.uniform_pair(SIGHT_DIMENSION)
        choice, pair, lens, place = (numbers[k * len(sweep) : (k + 1) * len(sweep)] for k in range(4))
        picked, chance, rest = sights.pick(choice[:, 0])
        points = place_sights(sights, picked, rest, pair, camera)
        seen = find_through_lens(camera, self.width, self.height, points.position, points.normal, lens)
        (column, across), (row, along) = (self._pick_pixels(*axis) for axis in zip(seen[:2], place.T, strict=True))
        weight = points.area * seen.scale / chance * across * along / COUNT
        probes = Probes(sweep, number, column, row, seen.x, seen.y, lens, weight)
        kept = (column >= 0) & (column < self.width) & (row >= 0) & (row < self.height) & (weight > 0)
        if sights.has_sides:
            rays = primary_rays(camera, self.width, self.height, seen.x, seen.y, lens)
            hits = self.cast(rays, np.full(len(sweep), SEEN_BY["camera"], dtype=np.uint8))
            kept &= ~find_other_emitters(sights, points, hits)
        return probes.select(np.flatnonzero(kept))

    def _pick_pixels(self, place: Floats, choice: Floats) -> tuple[Indices, Floats]:
        """Return columns (n,) whose filter reaches places (n,) along one axis, in proportion to it, by uniform numbers
        (n,), and its sum over all of them."""
        pixel_filter, width = self.settings.pixel_filter, self.settings.filter_width
        assert width is not None  # as Settings fills it in
        reach = int(np.ceil(find_reach(pixel_filter, width)))
        # What is far outside the picture is so whatever its number.
        middle = np.floor(np.clip(place, -2.0 * reach, max(self.width, self.height) + 2.0 * reach)).astype(np.int64)
        columns = middle[:, np.newaxis] + np.arange(-reach, reach + 1)
        running = np.cumsum(find_filter_density(place[:, np.newaxis] - (columns + 0.5), pixel_filter, width), axis=1)
        chosen = (running <= choice[:, np.newaxis] * running[:, -1:]).sum(axis=1).clip(max=2 * reach)
        return columns[np.arange(len(place)), chosen], running[:, -1]


def make_prober(
    scene: Scene, integrator: Integrator, camera: Camera, size: tuple[int, int], settings: Settings
) -> Prober | None:
    """Return what aims probes; None where no light is to be seen, or no error to be told.

    size : of the full picture

    Notes
    -----
    Panoramas have no film plane to aim through, and samples at pixels' centres alone no filter that spreads them.
    """
    seen = SEEN_BY["camera"]
    lights = [light for light in scene.lights if light.seen_by & seen and has_extent(light) and light_is_on(light)]
    if not (lights or has_emission(scene)) or camera.projection == "panorama" or settings.filter_width == 0.0:
        return None
    if "Combined" not in settings.passes or integrator.is_catcher is not None:
        return None
    emitters, hidden = integrator.emitters, None
    if emitters is not None and not emitters.is_empty:
        hidden = np.flatnonzero(gather_records(scene, "seen_by", np.int32) & seen == 0)
    return Prober(emitters, hidden, lights, integrator.cast, camera, *size, settings)


def add_probes(prober: Prober, starts: CameraSamples, sample: int, pixels: int) -> tuple[CameraSamples, Probes | None]:
    """Return what the camera rays of a block start with, and after them its probes; and these, None without any.

    sample : the block's first; pixels : how many, in rising order, it has of each sweep, one sweep after the other
    """
    sweeps = range(sample, min(sample + len(starts.x) // pixels, SWEEPS))
    if not sweeps or prober.sights is None:
        return starts, None
    probes, pixel = prober.aim(prober.sights, sweeps), starts.samples.pixel[:pixels]
    wanted = probes.row * prober.width + probes.column
    place = np.searchsorted(pixel, wanted).clip(max=pixels - 1)
    here = np.flatnonzero(pixel[place] == wanted)
    if not len(here):
        return starts, None
    probes = probes.select(here)
    rows = np.concatenate([np.arange(len(starts.x)), (probes.sweep - sample) * pixels + place[here]])
    x, y = np.concatenate([starts.x, probes.x]), np.concatenate([starts.y, probes.y])
    lens = starts.lens
    if lens is not None:  # column by column in memory, as it was: what is strided is rounded in another way
        lens = np.concatenate([lens.T, probes.lens.T], axis=1).T
    return CameraSamples(x, y, starts.samples.select(rows), lens), probes


def split_probes(values: Mapping[str, Floats], probes: Probes | None) -> tuple[Mapping[str, Floats], tuple[float, ...]]:
    """Return what the samples of a block have seen, by pass, and its probes as `film.missed` knows them."""
    if probes is None:
        return values, ()
    count = len(probes)
    known = np.column_stack([probes.sweep, probes.number, probes.column, probes.row, probes.weight])
    table = np.concatenate([known, values["Combined"][-count:, :3]], axis=1)
    return {name: part[:-count] for name, part in values.items()}, tuple(table.ravel().tolist())
