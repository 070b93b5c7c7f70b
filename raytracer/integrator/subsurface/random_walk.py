"""Random walks of light below surfaces, from where it enters an object to where it leaves.

All walks go on together, a step at a time: a direction w by the phase function p, a distance t, the cast of a ray that
ends there; a hit before it is the way out. Of the next step's light, with extinction s and scattering a s in a channel,

    p(w) a s exp(-s t) is scattered at t,    p(w) exp(-s t) leaves at a hit at t.

It is divided by the density of all ways in which the step could have been sampled (balance heuristic): channels are
chosen by the light that they carry, and directions and distances either by p and s, or so that the walk finds the
surface. For the latter, Dwivedi's: with c the cosine against a direction n of the way out, and l the length in which
light decays, in mean free paths,

    directions of density 1 / (2 pi (l - c) log((l + 1) / (l - 1))),    distances of extinction s (1 - c / l),

n being the normal where the light has entered, or its opposite where the object is thin, and the nearer way out.

As in Cycles a walk takes LONGEST_WALK steps at most; what has not left by then is lost. That is nothing for what
absorbs, some percent of the light of a thick white slab. Light that has been scattered so often that its direction is
forgotten goes on in the isotropic medium that is similar: it takes fewer steps.

References
----------
J. Krivanek, E. d'Eon, "A Zero-variance-based Sampling Scheme for Monte Carlo Subsurface Scattering", SIGGRAPH 2014
    Talks: Dwivedi sampling.
J. Meng, J. Hanika, C. Dachsbacher, "Improving the Dwivedi Sampling Scheme", EGSR 2016: equations 9 and 10.
E. d'Eon, J. Krivanek, "Zero-Variance Theory for Efficient Subsurface Scattering", SIGGRAPH 2020 Courses: equation 67
    for l, and guiding to the other side of thin objects.
M. Wrenninge, R. Villemin, C. Hery, "Path Traced Subsurface Scattering using Anisotropic Phase Functions and
    Non-Exponential Free Flights", 2017: similarity after some steps.
Cycles, kernel/integrator/subsurface_random_walk.h: how often what is done, and its limits.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from raytracer.arrays.rows import largest_column, sum_columns, take_rows
from raytracer.arrays.types import Booleans, Colors, Floats, Indices, Integers, Numbers, Vectors
from raytracer.arrays.vectors import normalize, to_world
from raytracer.bsdfs.subsurface import Medium
from raytracer.casting.ray_visibility import CastInside
from raytracer.casting.rays import Hits, Rays, make_misses, select_rows
from raytracer.lecture import dot
from raytracer.media.phases import evaluate_henyey_greenstein, lift_cosine, sample_henyey_greenstein
from raytracer.sampling.sampler import Sampler

# As in Cycles: the most steps, and the last that is taken in the anisotropic medium.
LONGEST_WALK, LAST_ANISOTROPIC = 256, 9
# The first step looks so many mean free paths ahead for the other side.
THICKNESS_SEEN = 10.0
# Guided steps as a share of all, in isotropic media from the start, and once the medium is the similar one; the sharper
# a phase function, the fewer, for Dwivedi's knows nothing of it: 1 - |g|^SHARPNESS.
GUIDED, GUIDED_LATER, SHARPNESS = 0.5, 0.75, 0.125
# Walks that carry less than this share of what they have begun with may end.
LIGHT_WALK = 0.25
# The exponent of exp(-x) that is as good as 0.
LARGEST_DEPTH = 700.0
# Numbers of a step: distance and channel; direction; how it is guided; whether the walk goes on.
NUMBERS_OF_STEP = 4


def count_numbers() -> int:
    """Return how many numbered dimensions a walk takes, and its entry before it."""
    return 1 + NUMBERS_OF_STEP * LONGEST_WALK


@dataclass(frozen=True, eq=False, slots=True)
class Walks:
    """k walks on their way.

    row : (k,) int64, the walk's place among those that have entered
    origin, direction : (k, 3) float64, metres and unit, of the next step, or of one that goes on as before
    instance : (k,) int32, that they are inside
    medium : of k
    throughput : (k, 3) float64, what light from here counts
    least : (k,) float64, of a channel's throughput; walks that carry less may end
    entry, way_out : (k, 3) float64, where they have entered, and the normal there
    thickness : (k,) float64, metres against the normal to the other side; inf where none has been seen
    decay : (k,) float64, the length l
    sampler : of the walks
    """

    row: Indices
    origin: Vectors
    direction: Vectors
    instance: Integers
    medium: Medium
    throughput: Colors
    least: Numbers
    entry: Vectors
    way_out: Vectors
    thickness: Numbers
    decay: Numbers
    sampler: Sampler

    def __len__(self) -> int:
        return len(self.row)

    def select(self, rows: Any) -> Walks:
        """Return some of the walks: index or boolean array."""
        return select_rows(self, rows)


@dataclass(eq=False, slots=True)
class Exits:
    """How walks from m points end.

    rays : m last steps, of unit directions
    hits : of those; misses where light has not left
    throughput : (m, 3) float64, what light that comes in there counts
    """

    rays: Rays
    hits: Hits
    throughput: Colors

    def put(self, walks: Walks, hits: Hits, ended: Indices) -> None:
        """Write down walks that have ended."""
        row = walks.row[ended]
        self.rays.origins[row], self.rays.directions[row] = walks.origin[ended], walks.direction[ended]
        self.throughput[row] = walks.throughput[ended]
        if hits.tied is not None and self.hits.tied is None:
            self.hits = replace(self.hits, tied=np.zeros(len(self.hits), dtype=np.bool_))
        self.hits.put(row, hits.select(ended))


def walk(
    cast: CastInside,
    medium: Medium,
    origin: Vectors,
    direction: Vectors,
    way_out: Vectors,
    instance: Integers,
    throughput: Colors,
    sampler: Sampler,
) -> Exits:
    """Walk from m points until light leaves.

    Parameters
    ----------
    origin, direction : (m, 3) float64, metres, just below the surface, and unit
    way_out : (m, 3) float64, unit, the normal on the outside
    instance : (m,) int32, that they are inside
    throughput : (m, 3) float64, what light that enters counts
    sampler : of the m points; NUMBERS_OF_STEP * LONGEST_WALK numbers are theirs to use
    """
    count = len(origin)
    walks = Walks(
        np.arange(count),
        origin,
        direction,
        instance,
        medium,
        throughput,
        LIGHT_WALK * largest_column(throughput),
        origin,
        way_out,
        np.full(count, np.inf),
        find_decay(largest_column(medium.albedo)),
        sampler,
    )
    walks = walks.select(np.flatnonzero(walks.least > 0))
    rays = Rays(origin.copy(), direction.copy(), np.zeros(count), np.full(count, np.inf))
    exits = Exits(rays, make_misses(np.ones(count, dtype=np.bool_)), np.zeros_like(throughput))
    for number in range(LONGEST_WALK):
        if not len(walks):
            break
        walks = take_step(cast, walks, number, exits)
    return exits


def take_step(cast: CastInside, walks: Walks, number: int, exits: Exits) -> Walks:
    """Take a step of each walk, write down those that have left, and return those that go on."""
    if number == LAST_ANISOTROPIC + 1:
        walks = replace(walks, medium=forget_direction(walks.medium))
    sampler = walks.sampler.skip(NUMBERS_OF_STEP * number)
    pair = sampler.uniform_pair(0)
    channels = weigh_channels(walks)
    extinction = choose_channel(walks.medium.extinction, channels, pair[:, 1])
    ways = [STRAIGHT_ON]
    if number > 0:
        walks, ways, stretch = turn(walks, number, sampler.uniform_pair(1), sampler.uniform(2))
        extinction = extinction * stretch
    distance = -np.log1p(-pair[:, 0]) / extinction
    # At first what lies further on is looked at as well.
    reach = distance if number > 0 else np.maximum(distance, THICKNESS_SEEN / smallest_column(walks.medium.extinction))
    hits = cast(Rays(walks.origin, walks.direction, np.zeros(len(walks)), reach), walks.instance)
    if number == 0:
        walks = replace(walks, thickness=measure_thickness(walks, hits))
    left = hits.hit & (hits.distance <= distance)
    distance = np.where(left, hits.distance, distance)
    walks = replace(walks, throughput=walks.throughput * weigh_step(walks.medium, channels, ways, distance, left))
    exits.put(walks, hits, np.flatnonzero(left))
    return go_on(walks, distance, ~left, sampler)


def forget_direction(medium: Medium) -> Medium:
    """Return the isotropic medium that is similar: scattering a s (1 - g), and the same absorption."""
    scattering: Floats = medium.albedo * medium.extinction
    similar: Floats = scattering * (1.0 - medium.anisotropy[:, np.newaxis])
    extinction = medium.extinction - scattering + similar
    return Medium(extinction, similar / extinction, 0.0 * medium.anisotropy)


def weigh_channels(walks: Walks) -> Floats:
    """Return the probability (k, 3) of each channel: its share of the light that a step scatters."""
    light = walks.throughput * walks.medium.albedo
    return light / sum_columns(light)[:, np.newaxis]


def choose_channel(values: Floats, probabilities: Floats, number: Floats) -> Floats:
    """Return the values (k,) of one channel of (k, 3) each."""
    red, green, blue = values.T
    first = probabilities[:, 0]
    chosen: Floats = np.where(number < first, red, np.where(number < first + probabilities[:, 1], green, blue))
    return chosen


class Way(NamedTuple):
    """A way to sample a step: its share of all steps (k,); the density of the direction taken over that of the phase
    function (k,); what extinction is multiplied by (k,)."""

    share: Floats | float
    ratio: Floats | float
    stretch: Floats | float


STRAIGHT_ON = Way(1.0, 1.0, 1.0)


def turn(walks: Walks, number: int, pair: Floats, strategy: Floats) -> tuple[Walks, list[Way], Floats]:
    """Return walks in new directions, the ways in which these could have been sampled, and how far the one that was
    taken stretches extinction (k,).

    pair, strategy : (k, 2), (k,) uniform numbers
    """
    medium, decay = walks.medium, walks.decay
    guided = find_guided_share(medium.anisotropy, number)
    backward = guided * find_backward_share(walks)
    is_guided = strategy < guided
    sign = np.where(strategy < backward, -1.0, 1.0)
    log_ratio = np.log((decay + 1.0) / (decay - 1.0))
    cosine = np.where(
        is_guided,
        decay - (decay + 1.0) * np.exp(-pair[:, 0] * log_ratio),
        sample_henyey_greenstein(medium.anisotropy, pair[:, 0]),
    )
    axis = np.where(is_guided[:, np.newaxis], sign[:, np.newaxis] * walks.way_out, walks.direction)
    direction = normalize(to_world(lift_cosine(cosine, pair[:, 1]), axis))
    outward = dot(direction, walks.way_out)
    phase = evaluate_henyey_greenstein(medium.anisotropy, dot(direction, walks.direction))
    ways = [Way(1.0 - guided, 1.0, 1.0)]
    for share, along in ((guided - backward, outward), (backward, -outward)):
        if np.any(share > 0):
            density = 1.0 / (2.0 * np.pi * (decay - along) * log_ratio)
            ways.append(Way(share, density / phase, 1.0 - along / decay))
    stretch = np.where(is_guided, 1.0 - sign * outward / decay, 1.0)
    return replace(walks, direction=direction), ways, stretch


def find_decay(albedo: Floats) -> Floats:
    """Return the length l (k,), in mean free paths, of d'Eon and Krivanek's fit: (1 - a^(2.443 - 0.0216 a + 0.579 / a))
    ^ -1/2."""
    return 1.0 / np.sqrt(1.0 - albedo ** (2.44294 - 0.0215813 * albedo + 0.578637 / albedo))


def find_guided_share(anisotropy: Floats, number: int) -> Floats:
    """Return the share (k,) of guided steps."""
    if number > LAST_ANISOTROPIC:
        return np.full(len(anisotropy), GUIDED_LATER)
    return np.minimum(GUIDED, 1.0 - np.abs(anisotropy) ** SHARPNESS)


def find_backward_share(walks: Walks) -> Floats:
    """Return which share (k,) of guided steps looks for the other side: 1 / (1 + exp((d - 2 x) s / l)), at the depth x
    of d in all."""
    seen = np.flatnonzero(np.isfinite(walks.thickness))
    share = np.zeros(len(walks))
    thickness = walks.thickness[seen]
    depth = dot(walks.entry[seen] - walks.origin[seen], walks.way_out[seen])
    extinction = smallest_column(walks.medium.extinction[seen])
    exponent = (thickness - 2.0 * np.clip(depth, 0.0, thickness)) * extinction / walks.decay[seen]
    share[seen] = 1.0 / (1.0 + np.exp(np.minimum(exponent, LARGEST_DEPTH)))
    return share


def measure_thickness(walks: Walks, hits: Hits) -> Floats:
    """Return how far against the normal (k,) the other side lies; inf where none has been hit."""
    rows = np.flatnonzero(hits.hit)
    thickness = np.full(len(walks), np.inf)
    depth = -hits.distance[rows] * dot(walks.direction[rows], walks.way_out[rows])
    thickness[rows] = np.where(depth > 0, depth, np.inf)
    return thickness


def weigh_step(medium: Medium, channels: Floats, ways: list[Way], distance: Floats, left: Booleans) -> Floats:
    """Return the factor (k, 3) of the light of steps: what it is over the density with which they have been sampled."""
    extinction, leaves = medium.extinction, left[:, np.newaxis]
    depth = np.minimum(extinction * distance[:, np.newaxis], LARGEST_DEPTH)
    light = np.exp(-depth) * np.where(leaves, 1.0, medium.albedo * extinction)
    density = np.zeros(len(distance))
    for way in ways:
        stretched = extinction * np.reshape(way.stretch, (-1, 1))
        passing = np.exp(-np.minimum(depth * np.reshape(way.stretch, (-1, 1)), LARGEST_DEPTH))
        density += way.share * way.ratio * sum_columns(channels * passing * np.where(leaves, 1.0, stretched))
    return light / density[:, np.newaxis]


def go_on(walks: Walks, distance: Floats, inside: Booleans, sampler: Sampler) -> Walks:
    """Return the walks that go on where they are scattered next; of those that carry little some end (Russian
    roulette)."""
    survival = np.minimum(largest_column(walks.throughput) / walks.least, 1.0)
    light = inside & (survival < 1.0)
    goes_on = inside & ~light
    rows = np.flatnonzero(light)
    if len(rows):
        goes_on[rows] = sampler.select(rows).uniform(3) < survival[rows]
    rows = np.flatnonzero(goes_on)
    step = distance[rows, np.newaxis] * take_rows(walks.direction, rows)
    walks, survival = walks.select(rows), survival[rows, np.newaxis]
    return replace(walks, origin=walks.origin + step, throughput=walks.throughput / survival)


def smallest_column(values: Floats) -> Floats:
    """Return the smallest (k,) of three columns (k, 3)."""
    return -largest_column(-values)
