"""Where light goes on from a surface: the mixture of all ways to continue, sampled and weighed.

The direct-light integrator follows mirrors, glass and straight passages, but no diffuse reflection. So a point's
options are its passage (transparency) and its microfacet lobes; one is taken at random, in proportion to the light it
sends on.
Imports `lecture`, `closures`, `light_shapes`, `microfacet`, `rays`.

References
----------
E. Veach, "Robust Monte Carlo Methods for Light Transport Simulation", 1997, chapter 9: multiple importance sampling.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.closures import Shading, TiltedDiffuse
from raytracer.lecture import dot
from raytracer.light_shapes import LightSamples
from raytracer.microfacet import Microfacets, evaluate_microfacets, sample_microfacets
from raytracer.rays import Booleans, Floats

# The reciprocals of squared cosines stay finite, and so do their products.
SMALLEST_SQUARE = 2.0**-500


@dataclass(frozen=True, eq=False, slots=True)
class Continuation:
    """The way on from n points.

    direction : (n, 3) float64, unit
    weight : (n, 3) float64, f |cos| / density: what the light from there counts; 0 where the path ends
    density : (n,) float64, per solid angle; inf where no other way leads to this direction
    passes : (n,) bool, True where the ray goes straight through the surface
    """

    direction: Floats
    weight: Floats
    density: Floats
    passes: Booleans

    @property
    def alive(self) -> Booleans:
        """(n,) True where the path goes on."""
        return (self.weight > 0).any(axis=1)


def option_probabilities(shading: Shading) -> Floats:
    """Return (n, 1 + lobes) the probability of each option: the passage first, then the lobes; rows of 0 have none."""
    shares = np.zeros((len(shading), 1 + len(shading.lobes)))
    shares[:, 0] = shading.transparency.mean(axis=1)
    for column, lobes in enumerate(shading.lobes, start=1):
        shares[lobes.hit, column] = lobes.weight.mean(axis=1) * lobes.albedo
    total = shares.sum(axis=1, keepdims=True)
    return np.divide(shares, total, out=np.zeros_like(shares), where=total > 0)


def evaluate_lobes(shading: Shading, probabilities: Floats, incoming: Floats) -> tuple[Floats, Floats]:
    """Return f |cos| (n, 3) of all lobes at each point for light from `incoming` (n, 3), unit, and the density (n,) per
    solid angle with which `sample_continuation` takes that direction."""
    specular, density = np.zeros((len(shading), 3)), np.zeros(len(shading))
    for column, lobes in enumerate(shading.lobes, start=1):
        lobes = _select_facing(shading, lobes, incoming)
        rows = lobes.hit
        value, lobe_density = evaluate_microfacets(
            lobes, shading.outgoing[rows], incoming[rows], shading.geometric_normal[rows]
        )
        specular[rows] += value
        density[rows] += probabilities[rows, column] * lobe_density
    return specular, density


def reflect_light(shading: Shading, probabilities: Floats, light: LightSamples) -> Floats:
    """Return (n, 3) what each point of `shading` sends back of its sample of a light, in the share that reflected rays
    leave to light sampling."""
    cosine = np.maximum(dot(shading.normal, light.direction), 0.0) / np.pi
    value = shading.diffuse * cosine[:, np.newaxis]
    for part in shading.tilted:
        value[part.hit] += evaluate_tilted(part, shading.normal[part.hit], light.direction[part.hit])
    if shading.lobes:
        specular, density = evaluate_lobes(shading, probabilities, light.direction)
        value += specular * power_heuristic(light.density, density)[:, np.newaxis]
    value *= light.weight
    return value


def evaluate_tilted(part: TiltedDiffuse, normal: Floats, incoming: Floats) -> Floats:
    """Return f |cos| (m, 3) of Lambertian parts with normals b of their own, for light from `incoming` i (m, 3).

    Light from behind the surface's own `normal` n (m, 3) is cut; before that it fades out as if the bumps were facets
    that shadow each other: by 2 / (1 + sqrt(1 + a^2 tan^2(n, i))) with a^2 = tan^2(n, b) / 8, at most 1.

    References
    ----------
    A. Conty Estevez, P. Lecocq, C. Stein, "A Microfacet-Based Shadowing Function to Solve the Bump Terminator
    Problem", Ray Tracing Gems, 2019; Cycles' bump_shadowing_term since Blender 5.0 (before, another fading).
    """
    cosine = np.maximum(dot(part.normal, incoming), 0.0)
    across, bend = dot(normal, incoming), dot(normal, part.normal)
    roughness = np.minimum(_squared_tangent(bend) / 8.0, 1.0)
    fading = 2.0 / (1.0 + np.sqrt(1.0 + roughness * _squared_tangent(across)))
    return part.albedo * (np.where(across * bend > 0, fading, 0.0) * cosine / np.pi)[:, np.newaxis]


def _squared_tangent(cosine: Floats) -> Floats:
    """tan^2 of angles, from their cosines (m,); a huge number at a right angle."""
    square = np.clip(cosine * cosine, SMALLEST_SQUARE, 1.0)
    return (1.0 - square) / square


def _select_facing(shading: Shading, lobes: Microfacets, incoming: Floats) -> Microfacets:
    """Return the lobes that may send light from `incoming` (n, 3) back: perfect ones never, others to the side of the
    surface that they reflect or transmit to."""
    above = dot(lobes.normal, incoming.take(lobes.hit, axis=0)) > 0
    facing = ~lobes.is_perfect & np.where(
        above, (lobes.reflection > 0).any(axis=1), (lobes.transmission > 0).any(axis=1)
    )
    return lobes if facing.all() else lobes.select(np.flatnonzero(facing))


def sample_continuation(shading: Shading, probabilities: Floats, choice: Floats, pair: Floats) -> Continuation:
    """Take one of each point's options.

    choice, pair : (n,), (n, 2) uniform numbers; what is left of `choice` within its option decides between reflection
        and refraction
    """
    count = len(shading)
    option, rest = _choose_option(probabilities, choice)
    direction, weight = -shading.outgoing, np.zeros((count, 3))
    density, passes = np.full(count, np.inf), option == 0
    straight = np.flatnonzero(passes)
    weight[straight] = shading.transparency[straight] / probabilities[straight, 0:1]
    spread = np.zeros(count, dtype=np.bool_)
    for column, lobes in enumerate(shading.lobes, start=1):
        lobes = lobes.select(option[lobes.hit] == column)
        if not len(lobes):
            continue
        rows = lobes.hit
        sample = sample_microfacets(
            lobes, shading.outgoing[rows], shading.geometric_normal[rows], rest[rows], pair[rows]
        )
        direction[rows] = sample.direction
        perfect = (sample.valid & sample.perfect)[:, np.newaxis]
        weight[rows] = np.where(perfect, sample.weight / probabilities[rows, column, np.newaxis], 0.0)
        spread[rows] = sample.valid & ~sample.perfect
    if spread.any():
        specular, lobe_density = evaluate_lobes(shading, probabilities, direction)
        found = np.flatnonzero(spread & (lobe_density > 0))
        density[found] = lobe_density[found]
        weight[found] = specular[found] / lobe_density[found, np.newaxis]
    return Continuation(direction, weight, density, passes)


def _choose_option(probabilities: Floats, choice: Floats) -> tuple[NDArray[np.intp], Floats]:
    """Return the option (n,) whose interval of the unit interval holds `choice`, and where in it, in [0, 1).

    The option of a point that has none is -1.
    """
    upper = np.cumsum(probabilities, axis=1)
    at = choice * upper[:, -1]
    option = (at[:, np.newaxis] >= upper).sum(axis=1)
    option[upper[:, -1] == 0] = -1
    rows = np.arange(len(choice))
    width = probabilities[rows, option]
    lower = upper[rows, option] - width
    rest = np.divide(at - lower, width, out=np.zeros_like(choice), where=width > 0)
    return option, np.clip(rest, 0.0, np.nextafter(1.0, 0.0))


def power_heuristic(density: Floats, other: Floats) -> Floats:
    """Return p^2 / (p^2 + q^2) of two densities (n,): the weight of a sample that both could have taken.

    1 where p is infinite (no other way leads there) or q is 0; 0 where p is 0.
    """
    ratio = np.divide(other, density, out=np.full(np.shape(density), np.inf), where=density > 0)
    return np.where(np.isinf(density), 1.0, 1.0 / (1.0 + ratio * ratio))
