"""One point of a light, or one direction to the sun, for many points of surfaces.

Shadow rays that end at one point, or run in one direction, cost a fraction of others: cast from the light they are a
perspective, or a parallel, view of the scene. So a pass over the picture takes one point of each light, as an
accumulation buffer does, and neighbouring pixels take different ones ("interleaved"), which turns the steps that single
points would leave in a penumbra into a fine grain. Each pixel for itself is sampled as with points of its own.

A point is taken even over an area light, and from within the ball of a point light with the density
1 / (pi^2 r^2 sqrt(r^2 - rho^2)) at the distance rho from its centre, the shadow that an even sphere in four dimensions
throws on three. Its own shadow on any plane is an even disk, so the ball is covered evenly as seen from everywhere: the
direction to the point, along a chord of half length h whose middle is at the distance t, has the density
integral (t + u)^2 / (pi^2 r^2 sqrt(h^2 - u^2)) du = (t^2 + h^2 / 2) / (pi r^2).

References
----------
P. Haeberli, K. Akeley, "The Accumulation Buffer: Hardware Support for High-Quality Rendering", 1990.
A. Keller, W. Heidrich, "Interleaved Sampling", Rendering Techniques 2001.
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.rows import join_columns, scale_vectors
from raytracer.arrays.types import Booleans, Floats
from raytracer.lecture import dot, length
from raytracer.lights.area_lights import unit_axes
from raytracer.lights.light_shapes import LightSamples, divide_rows
from raytracer.lights.lights import evaluate_light, has_extent, sample_light
from raytracer.sampling.sampler import SharedSamples
from raytracer.sampling.warps import sample_disk
from raytracer.scene.lights import AreaLight, Light, SunLight
from raytracer.scene.scene import Scene

# A view from the light costs about as much for a triangle as the tree does for this many rays.
RAYS_PER_TRIANGLE = 0.1
# With fewer rays in a call NumPy's calls cost more than their arithmetic, and joining the lights' rays costs less.
SMALLEST_CALL = 1 << 14
# Squares of so many pixels a side take different points; a single point leaves steps in a wide penumbra, even after 64
# samples.
INTERLEAVING = 2


def choose_interleaving(pixels: int, scene: Scene) -> int:
    """Return the side of the squares of pixels that take different points, or 0 where pixels share none.

    The number of samples plays no part: the samples of a picture are the first ones of the same picture with more.
    """
    least = max(SMALLEST_CALL, RAYS_PER_TRIANGLE * count_primitives(scene))
    return INTERLEAVING if pixels / INTERLEAVING**2 >= least else 0


def count_primitives(scene: Scene) -> int:
    """Return the number of triangles of all instances, of spheres and of points of curves."""
    triangles = np.array([len(mesh.triangles) for mesh in scene.meshes], dtype=np.int64)
    shown = triangles if scene.instances is None else triangles[scene.instances.mesh]
    return int(shown.sum()) + sum(len(group.radii) for group in scene.groups)


def is_shareable(light: Light) -> bool:
    """True for lights with extent; slats (spread) would hide most points of an area light from most surfaces."""
    return has_extent(light) and not (isinstance(light, AreaLight) and light.spread < np.pi)


def share_points(light: Light, samples: SharedSamples, dimension: int) -> Floats:
    """Return the points (k, 3) of a light, or the directions to a sun, for k sets of pixels; uses two dimensions."""
    pair = samples.uniform_pair(dimension)
    if isinstance(light, SunLight):
        return sample_light(light, np.zeros((len(pair), 3)), pair).direction
    if isinstance(light, AreaLight):
        u, v, _ = unit_axes(light)
        half = np.array([length(light.axis_u), length(light.axis_v)]) / 2.0
        local = half * (sample_disk(pair) if light.shape == "ellipse" else 2.0 * pair - 1.0)
        return light.position + scale_vectors(u, local[:, 0]) + scale_vectors(v, local[:, 1])
    disk = sample_disk(pair)
    half_chord = np.sqrt(np.maximum(1.0 - dot(disk, disk), 0.0))
    height = half_chord * np.sin(2.0 * np.pi * samples.uniform(dimension + 1))
    return light.position + light.radius * join_columns(*disk.T, height)


def is_near(light: Light, positions: Floats) -> Booleans:
    """True where a light fills so much of the view that points of (n, 3) surfaces had better choose their own.

    Within its diameter from the centre the solid angle of a light's parts varies by more than its distance does.
    """
    if isinstance(light, SunLight):
        return np.zeros(len(positions), dtype=np.bool_)
    offset = positions - light.position
    if isinstance(light, AreaLight):
        return dot(offset, offset) < dot(light.axis_u, light.axis_u) + dot(light.axis_v, light.axis_v)
    return dot(offset, offset) < (2.0 * light.radius) ** 2


def sample_shared(light: Light, positions: Floats, points: Floats, weigh: bool) -> LightSamples:
    """Return the samples towards `points` (n, 3) of `share_points` from `positions` (n, 3) that are not near.

    weigh : False where no reflected ray needs the density of `sample_light`; it is inf then
    """
    if isinstance(light, SunLight):
        seen = evaluate_light(light, positions, points)
        return LightSamples(points, seen.distance, divide_rows(seen.radiance, seen.density), seen.density)
    offset = points - positions
    distance = length(offset)
    direction = offset / distance[:, np.newaxis]
    if isinstance(light, AreaLight):
        return _sample_shared_area(light, positions, points, direction, distance, weigh)
    seen = evaluate_light(light, positions, direction)
    towards = light.position - positions
    middle = dot(towards, direction)
    # h^2 = r^2 - (|c|^2 - t^2): what rounding takes below 0 is the rim.
    half_square = np.maximum(light.radius**2 - (dot(towards, towards) - middle * middle), 0.0)
    density = (middle * middle + half_square / 2.0) / (np.pi * light.radius**2)
    reach = np.where(np.isinf(seen.distance), 1.0, seen.distance / distance)
    return LightSamples(direction, seen.distance, divide_rows(seen.radiance, density), seen.density, points, reach)


def _sample_shared_area(
    light: AreaLight, positions: Floats, points: Floats, direction: Floats, distance: Floats, weigh: bool
) -> LightSamples:
    """Radiance P / (pi A) over the density t^2 / (A cos)."""
    cosine = np.maximum(-dot(direction, unit_axes(light)[2]), 0.0)
    weight = divide_rows(scale_vectors(light.power, cosine) / np.pi, distance * distance)
    density = evaluate_light(light, positions, direction).density if weigh else np.where(cosine > 0, np.inf, 0.0)
    return LightSamples(direction, distance, weight, density, points, np.ones(len(points)))
