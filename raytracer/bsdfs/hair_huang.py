"""Hair after Huang and others: a rough elliptic cylinder, its facets tilted by scales.

What a strand sends on is the mean over the width that is seen of it: all of it, or of strands wider than a pixel a
pixel's width around where it is met. With h = r sin s across it and the light B that leaves where it comes in at s
(`hair_ways`),

    f |cos| = int B(s) cos s ds / (sin s1 - sin s0).

The integral is estimated at even steps that begin anywhere, which is right on average; one way of light stands for each
of them. Samples follow a single way.

References
----------
W. Huang, M. B. Hullin, J. Hanika, "A Microfacet-based Hair Scattering Model", Computer Graphics Forum 41(4), 2022.
Blender, intern/cycles/kernel/closure/bsdf_principled_hair_huang.h: the model; Cycles takes Simpson's rule.

Notes
-----
Beside what is seen of an elliptic strand, within the width that curves have, it is clear, for shadows as well; those
of Cycles are as wide as the curve.

Samples have no known density. To weigh them against light that is looked for it is taken for 1 everywhere, as in
Cycles: any number will do that both sides agree on.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import join_columns, mean_column, scale_vectors, take_rows
from raytracer.arrays.types import Floats, Kinds
from raytracer.arrays.vectors import make_frame, normalize
from raytracer.bsdfs.bounce_kinds import GLOSSY
from raytracer.bsdfs.fresnel import dielectric_reflectance, transmitted_cosine
from raytracer.bsdfs.hair import HairLobes, HairSamples, make_strand_frame
from raytracer.bsdfs.hair_ellipse import measure_azimuth, measure_radius
from raytracer.bsdfs.hair_ways import Strand, follow_light, sum_ways, take_ways
from raytracer.lecture import cross, dot
from raytracer.sampling.streams import Noise, draw, hash_columns

# Cycles' range of roughnesses.
SMOOTHEST = 0.001
# Steps of the integral, in roughnesses: twice Cycles'. One estimate of R is right to a tenth then, of TT to a half.
STEP = 1.4
# Steps of one integral, whatever the roughness; more of them leave no noise that others do not.
FEWEST_STEPS, MOST_STEPS = 8, 256
# Ways of light that are followed at a time: their arrays stay in a cache.
BLOCK_WAYS = 1 << 13
# The numbers of a way come from those of the first by steps of a Kronecker sequence: powers of the inverse of what the
# golden ratio is in six dimensions, the root of x^7 = x + 1 (M. Roberts, 2018).
KRONECKER = np.array([1.1127756842787055 ** -(power + 1) for power in range(6)])


@dataclass(frozen=True, eq=False)
class HuangHair(HairLobes):
    """m strands; further fields, (m,) float64 but the first three, which are (m, 3).

    absorption : per half axis
    gains : of R, TT and TRT
    axis : any length, the longer one of the cross section; 0 turns it to the viewer
    across : h, from -1 to 1 of the circle around the cross section
    coverage : half the width of a pixel there, in radii; 1 and more is far away
    roughness : alpha of facets
    aspect : of the cross section, at most 1
    tilt : of the scales, radians; ior : index of refraction inside
    chance : a uniform number, for others to begin with
    """

    absorption: Floats
    gains: Floats
    axis: Floats
    across: Floats
    coverage: Floats
    roughness: Floats
    aspect: Floats
    tilt: Floats
    ior: Floats
    chance: Floats

    walks: ClassVar[bool] = True

    def show_normal(self, outgoing: Floats) -> Floats:
        """Return the axis across the strand that its frame has."""
        return make_fiber_frame(self, outgoing)[0]

    @property
    def albedo(self) -> Floats:
        return mean_column(self.estimate_color())

    def estimate_color(self) -> Floats:
        """Return what a smooth circular strand sends on (m, 3), seen at a right angle: Cycles' estimate.

        (A - 2 F A + F) / (1 - F A), with Fresnel's F where it is met, and A that passes.
        """
        cosine = np.sqrt(np.maximum(1.0 - self.across**2, 0.0))
        f = dielectric_reflectance(cosine, self.ior)[:, np.newaxis]
        passed = np.exp(-2.0 * scale_vectors(self.absorption, transmitted_cosine(cosine, self.ior)))
        return np.divide(passed - 2.0 * f * passed + f, 1.0 - f * passed, out=np.ones_like(passed), where=f < 1)

    def blur(self, least: Floats) -> Self:
        return dataclasses.replace(self, roughness=np.maximum(self.roughness, least))

    def evaluate(self, outgoing: Floats, incoming: Floats) -> tuple[Floats, Floats]:
        frame = make_fiber_frame(self, outgoing)
        strand, light = find_strand(self, frame, outgoing), to_frame(frame, incoming)
        low, high = find_window(self, strand)
        count = np.ceil((high - low) / (STEP * strand.alpha)).clip(FEWEST_STEPS, MOST_STEPS).astype(np.int64)
        noise = hash_columns(self.chance, *incoming.T)
        value = np.zeros((len(self), 3))
        for rows in split_rows(count):
            ends = low[rows], high[rows], count[rows]
            value[rows] = integrate(strand.select(rows), self.gains[rows], light[rows], ends, noise[rows])
        return self.weight * value, self.claim_density()

    def sample(self, outgoing: Floats, choice: Floats, pair: Floats) -> HairSamples:
        frame = make_fiber_frame(self, outgoing)
        strand, noise = find_strand(self, frame, outgoing), hash_columns(self.chance, choice, *pair.T)
        numbers = np.stack([draw(noise, number) for number in range(8)], axis=1)
        radius = measure_radius(measure_azimuth(strand.incoming), strand.aspect)
        across = np.where(radius > self.coverage, self.across / radius, 2.0 * numbers[:, 0] - 1.0)
        turn = np.arcsin(np.clip(across, -1.0, 1.0))
        ways = follow_light(strand, turn, np.concatenate([pair, numbers[:, 1:5]], axis=1), leans=False)
        found = take_ways(strand, ways, self.gains, numbers[:, 5:8])
        energy = np.stack([mean_column(light) for _, light in found])
        total = energy.sum(axis=0)
        taken = np.minimum((choice * total >= np.cumsum(energy, axis=0)).sum(axis=0), len(found) - 1)
        local, weight = np.empty((len(self), 3)), np.zeros((len(self), 3))
        for number, (direction, light) in enumerate(found):
            rows = np.flatnonzero(taken == number)
            local[rows] = direction[rows]
            share = np.divide(total, energy[number], out=np.zeros_like(total), where=energy[number] > 0)
            weight[rows] = light[rows] * share[rows, np.newaxis]
        direction = np.zeros_like(local)
        for column, axis in enumerate(frame):
            direction += scale_vectors(axis, local[:, column])
        kind: Kinds = np.full(len(self), GLOSSY, dtype=np.uint8)
        return HairSamples(normalize(direction), total > 0, kind, self.weight * weight)


# Frames --------------------------------------------------------------------------------------------------------------


def make_fiber_frame(hair: HuangHair, outgoing: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the axes x, y and z, (m, 3) each, of strands along y seen from `outgoing`: x across the view, or along the
    longer axis of the cross section."""
    x, _ = make_strand_frame(hair.tangent, outgoing)
    own = np.flatnonzero(hair.axis.any(axis=1))
    if len(own):
        x = x.copy("K")
        tangent, axis = take_rows(hair.tangent, own), take_rows(hair.axis, own)
        axis = normalize(axis - scale_vectors(tangent, dot(axis, tangent)))
        along = np.flatnonzero(~axis.any(axis=1))
        axis[along] = make_frame(tangent[along])[0]
        x[own] = axis
    return x, hair.tangent, cross(x, hair.tangent)


def to_frame(frame: tuple[Floats, Floats, Floats], direction: Floats) -> Floats:
    """Return world directions (m, 3) in frames."""
    return join_columns(*(dot(direction, axis) for axis in frame))


def find_strand(hair: HuangHair, frame: tuple[Floats, Floats, Floats], outgoing: Floats) -> Strand:
    """Return strands as light from `outgoing` (m, 3) comes to them; the tilt of the node leans against the frame."""
    alpha = np.maximum(hair.roughness, SMOOTHEST)
    return Strand(to_frame(frame, outgoing), hair.absorption, alpha, hair.aspect, -hair.tilt, hair.ior)


def find_window(hair: HuangHair, strand: Strand) -> tuple[Floats, Floats]:
    """Return the ends s0 and s1 (m,) of what is seen of a strand's width."""
    radius = measure_radius(measure_azimuth(strand.incoming), strand.aspect)
    low = np.where(radius > hair.coverage, (hair.across - hair.coverage) / radius, -1.0)
    high = np.where(radius > hair.coverage, (hair.across + hair.coverage) / radius, 1.0)
    return np.arcsin(np.clip(low, -1.0, 1.0)), np.arcsin(np.clip(high, -1.0, 1.0))


# The integral --------------------------------------------------------------------------------------------------------


def split_rows(count: NDArray[np.int64]) -> Iterator[slice]:
    """Yield runs of strands that need some BLOCK_WAYS steps together; count : (m,) of each."""
    ends = np.cumsum(count)
    start = 0
    while start < len(count):
        before = ends[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(ends, before + BLOCK_WAYS, side="right")))
        yield slice(start, stop)
        start = stop


def integrate(
    strand: Strand,
    gains: Floats,
    outgoing: Floats,
    window: tuple[Floats, Floats, NDArray[np.int64]],
    noise: Noise,
) -> Floats:
    """Return the light (m, 3) that strands send to directions (m, 3), an estimate that is right on average.

    window : ends of s, and how many steps to take between them, (m,) each
    """
    low, high, count = window
    owner = np.repeat(np.arange(len(low)), count)
    first = np.cumsum(count) - count
    step = (np.arange(len(owner)) - first[owner]).astype(np.float64)
    width = (high - low) / count
    turn = low[owner] + (step + draw(noise, 0)[owner]) * width[owner]
    start = np.stack([draw(noise, number) for number in range(1, 7)], axis=1)
    pairs = (start[owner] + step[:, np.newaxis] * KRONECKER) % 1.0
    many = strand.select(owner)
    sent = sum_ways(many, follow_light(many, turn, pairs, leans=True), gains[owner], outgoing[owner])
    total = np.add.reduceat(scale_vectors(sent, np.cos(turn)), first, axis=0)
    share = np.divide(width, np.sin(high) - np.sin(low), out=np.zeros_like(width), where=high > low)
    return scale_vectors(total, share)
