"""The sample on from a point: one of its lobes is chosen, and a direction within it, weighed by all (`bsdf`)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import (
    any_column,
    divide_where,
    join_columns,
    make_zeros,
    mean_column,
    pick_columns,
    put_rows,
    shorten_rows,
    sum_columns,
    take_rows,
)
from raytracer.arrays.types import Booleans, Colors, Floats, Kinds, Numbers, Vectors
from raytracer.arrays.vectors import to_world
from raytracer.bsdfs.bounce_kinds import DIFFUSE, GLOSSY, SINGULAR, STRAIGHT, TRANSMITTED
from raytracer.bsdfs.bsdf import evaluate_bsdf, includes_diffuse
from raytracer.bsdfs.closures import Lobes, Shading
from raytracer.bsdfs.hair import HairLobes
from raytracer.bsdfs.microfacet import sample_microfacets
from raytracer.bsdfs.portals import Portals, join_portals
from raytracer.lecture import dot
from raytracer.sampling.warps import sample_cosine_hemisphere

# No points.
NONE = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True, eq=False, slots=True)
class BsdfSample:
    """The sample on from n points.

    direction : (n, 3) float64, unit
    weight : (n, 3) float64, f |cos| / density: what the light from there counts; 0 where the path ends
    density : (n,) float64, per solid angle; inf where nothing but this lobe leads to this direction
    kind : (n,) uint8, of the bounce (`bounce_kinds`); STRAIGHT where the ray goes straight through the surface, or
        through a portal
    portals : those that rays go through, one for each ray that does; None where there are none
    """

    direction: Vectors
    weight: Colors
    density: Numbers
    kind: Kinds
    portals: Portals | None = None

    @property
    def goes_straight(self) -> Booleans:
        """(n,) True where the ray goes straight through the surface, or through a portal."""
        return self.kind == STRAIGHT

    @property
    def alive(self) -> Booleans:
        """(n,) True where the path goes on."""
        return any_column(self.weight > 0)


def sample_bsdf(shading: Shading, probabilities: Floats, choice: Floats, pair: Floats) -> BsdfSample:
    """Take one of each point's lobes.

    choice, pair : (n,), (n, 2) uniform numbers; what is left of `choice` within its lobe decides between reflection
        and refraction
    """
    count = len(shading)
    lobe, upper = _choose_lobe(probabilities, choice)
    sample = BsdfSample(-shading.outgoing, make_zeros(count), np.full(count, np.inf), np.zeros(count, dtype=np.uint8))
    # Where there are Lambertian parts alone nobody asks where in its interval the choice is.
    rest = _find_rest(probabilities, choice, lobe, upper) if shading.lobes or shading.portals else choice
    straight = np.flatnonzero(lobe == 0)
    if len(straight):
        passing = probabilities[:, 0][straight]
        put_rows(sample.weight, straight, take_rows(shading.transparency, straight) / passing[:, np.newaxis])
        if shading.portals:
            sample = enter_portals(sample, shading, straight, passing, rest[straight])
    spread = np.zeros(count, dtype=np.bool_)
    walking = tuple(column for column, lobes in enumerate(shading.lobes, start=1) if walks(lobes))
    for column, lobes in enumerate(shading.lobes, start=1):
        lobes = lobes.select(lobe[lobes.hit] == column)
        if len(lobes):
            _sample_lobes(sample, spread, shading, lobes, probabilities[:, column][lobes.hit], rest, pair)
    if includes_diffuse(shading, probabilities):
        _sample_diffuse(sample, spread, shading, lobe, pair)
    if walking:
        _weigh_walks(sample, spread, shading, probabilities, walking)
    elif spread.any():
        value, density = evaluate_bsdf(shading, probabilities, sample.direction)
        found = shorten_rows(np.flatnonzero(spread & (density > 0)), count)
        density = density[found]
        sample.density[found] = density
        put_rows(sample.weight, found, take_rows(value, found) / density[:, np.newaxis])
    return sample


def walks(lobes: Lobes) -> bool:
    """Return whether samples of lobes carry weights of their own."""
    return isinstance(lobes, HairLobes) and lobes.walks


def _weigh_walks(
    sample: BsdfSample, spread: Booleans, shading: Shading, probabilities: Floats, walking: tuple[int, ...]
) -> None:
    """Fill in densities, and weights but of walks, where some lobes are sampled by walks alone.

    A direction that another lobe has taken counts as what the others send there, over their own density; what a walk
    has found counts by itself. Against light that is looked for, both have the density of all lobes together.
    """
    others = replace(shading, lobes=tuple(lobes.select(NONE) if walks(lobes) else lobes for lobes in shading.lobes))
    value, own = evaluate_bsdf(others, probabilities, sample.direction)
    density = own.copy()
    for column in walking:
        lobes = shading.lobes[column - 1]
        assert isinstance(lobes, HairLobes)
        density[lobes.hit] += probabilities[lobes.hit, column] * lobes.claim_density()
    found = np.flatnonzero(spread & (own > 0))
    sample.weight[found] = take_rows(value, found) / own[found, np.newaxis]
    walked = ~spread & (sample.density == 0.0)
    sample.density[found], sample.density[walked] = density[found], density[walked]


def enter_portals(
    sample: BsdfSample, shading: Shading, rows: NDArray[np.intp], probability: Floats, choice: Floats
) -> BsdfSample:
    """Return the sample with some of the rays that pass a surface, at `rows` (k,), sent through its portals.

    probability : (k,) with which rays pass at all; choice : (k,) uniform numbers
    """
    shares = make_zeros(len(shading), 1 + len(shading.portals))
    shares[:, 0] = mean_column(shading.transparency)
    for column, part in enumerate(shading.portals, start=1):
        shares[part.hit, column] = mean_column(part.weight)
    shares = take_rows(shares, rows)
    chances = shares / sum_columns(shares)[:, np.newaxis]
    taken, _ = _choose_lobe(chances, choice)
    sample.weight[rows] /= np.where(taken == 0, chances[:, 0], 1.0)[:, np.newaxis]
    way, chance = np.full(len(shading), -1), np.ones(len(shading))
    way[rows], chance[rows] = taken, probability * chances[np.arange(len(rows)), taken]
    chosen = [
        part.select(np.flatnonzero(way[part.hit] == column)) for column, part in enumerate(shading.portals, start=1)
    ]
    for part in chosen:
        sample.direction[part.hit] = part.direction
        sample.weight[part.hit] = part.weight / chance[part.hit, np.newaxis]
    return replace(sample, portals=join_portals(chosen))


def _sample_lobes(
    sample: BsdfSample,
    spread: Booleans,
    shading: Shading,
    lobes: Lobes,
    probability: Floats,
    rest: Floats,
    pair: Floats,
) -> None:
    """Fill in the directions of the points that take a lobe, and mark those (`spread`) that wait for their weights."""
    rows = lobes.hit
    if isinstance(lobes, HairLobes):
        strands = lobes.sample(take_rows(shading.outgoing, rows), rest[rows], take_rows(pair, rows))
        put_rows(sample.direction, rows, strands.direction)
        spread[rows], sample.kind[rows] = strands.valid, strands.kind
        if strands.weight is not None:
            put_rows(sample.weight, rows, strands.weight / probability[:, np.newaxis])
            spread[rows] = False
            sample.density[rows] = 0.0  # until that of all lobes is known
        return
    outgoing, normal = take_rows(shading.outgoing, rows), take_rows(shading.geometric_normal, rows)
    taken = sample_microfacets(lobes, outgoing, normal, rest[rows], take_rows(pair, rows))
    put_rows(sample.direction, rows, taken.direction)
    perfect = taken.valid & taken.perfect
    if perfect.any():
        alone = np.where(perfect[:, np.newaxis], taken.weight / probability[:, np.newaxis], 0.0)
        put_rows(sample.weight, rows, alone)
    spread[rows] = taken.valid & ~taken.perfect
    transmitted = np.where(dot(lobes.normal, taken.direction) < 0, TRANSMITTED, 0)
    sample.kind[rows] = GLOSSY | np.where(taken.perfect, SINGULAR, 0) | transmitted


def _sample_diffuse(
    sample: BsdfSample, spread: Booleans, shading: Shading, lobe: NDArray[np.intp], pair: Floats
) -> None:
    """Likewise of the points that take a Lambertian part: directions around its normal with density cos / pi."""
    first = 1 + len(shading.lobes)
    normal = shading.normal
    if shading.tilted:
        normal = normal.copy("K")
        for column, part in enumerate(shading.tilted, start=first + 1):
            taken = lobe[part.hit] == column
            put_rows(normal, part.hit[taken], take_rows(part.normal, taken))
            sample.kind[part.hit[taken]] = DIFFUSE | TRANSMITTED if part.transmits else DIFFUSE
    rows = shorten_rows(np.flatnonzero(lobe >= first), len(lobe))
    around = to_world(sample_cosine_hemisphere(take_rows(pair, rows)), take_rows(normal, rows))
    put_rows(sample.direction, rows, around)
    sample.kind[rows] |= DIFFUSE
    spread[rows] = True


def _choose_lobe(probabilities: Floats, choice: Floats) -> tuple[NDArray[np.intp], list[Floats]]:
    """Return the lobe (n,) whose interval of the unit interval holds `choice`, and the upper ends (n,) of each lobe's.

    The lobe of a point that has none is -1.
    """
    upper = list(accumulate(probabilities.T))
    at = choice * upper[-1]
    lobe = np.zeros(len(choice), np.intp)
    for column in upper:
        lobe += at >= column
    none = upper[-1] == 0
    if none.any():
        lobe[none] = -1
    return lobe, upper


def _find_rest(probabilities: Floats, choice: Floats, lobe: NDArray[np.intp], upper: list[Floats]) -> Floats:
    """Return where (n,) in the interval of its lobe each choice is, in [0, 1); arguments as of `_choose_lobe`."""
    width = pick_columns(probabilities, lobe)
    lower = pick_columns(join_columns(*upper), lobe) - width
    rest = divide_where(choice * upper[-1] - lower, width, width > 0)
    return np.clip(rest, 0.0, np.nextafter(1.0, 0.0))
