"""Node trees of lights: a factor of a light's radiance that varies with the place on it, the direction, and the way.

To programs a light is a surface seen from the point that it lights: the position lies on the light, the normal points
to what is lit (along its axis for an area light), coordinates of the object are those of the light. A sun is infinitely
far away: its position is the direction in which it shines. Coordinates u and v run round a point light as longitude and
latitude, over the picture that a spot throws, and over the face of an area light and the disc of a sun.

References
----------
Blender, intern/cycles/kernel/light/sample.h (light_sample_shader_evaluation), light/point.h, area.h, distant.h.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from raytracer.arrays.rows import split_columns
from raytracer.arrays.types import Floats
from raytracer.arrays.vectors import normalize, transform
from raytracer.casting.geometry import pack_geometry
from raytracer.lecture import dot, length
from raytracer.lights.area_lights import unit_axes
from raytracer.lights.light_shapes import LightSamples
from raytracer.scene.camera import Camera
from raytracer.scene.lights import AreaLight, Light, LightNodes, PointLight, SpotLight, SunLight
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Mesh
from raytracer.shading.evaluate import evaluate, find_needed, list_attributes
from raytracer.shading.light_path import FARTHEST, Depths, LightPath, describe_sampling
from raytracer.shading.site import Site
from raytracer.shading.site_tables import SiteTables, make_site_tables
from raytracer.surfaces.surface import imagine_surface
from raytracer.surfaces.surface_tables import make_surface_tables
from raytracer.textures.image import map_sphere


@dataclass(frozen=True, eq=False)
class ComputedLight:
    """A light with nodes, as the integrator takes it.

    needed : the steps of its program, of `find_needed`
    tables : what they read
    """

    light: Light
    nodes: LightNodes
    needed: tuple[int, ...]
    tables: SiteTables


def make_computed_lights(
    lights: Sequence[Light], camera: Camera | None, frame: tuple[int, int]
) -> dict[Light, ComputedLight]:
    """Return what evaluates the nodes of the lights that have any; frame : size of the full picture, pixels."""
    found = {light: make_computed_light(light, camera, frame) for light in lights}
    return {light: computed for light, computed in found.items() if computed is not None}


def make_computed_light(light: Light, camera: Camera | None, frame: tuple[int, int]) -> ComputedLight | None:
    """Return what evaluates a light's nodes, or None for a light without; frame : size of the full picture, pixels."""
    if light.nodes is None:
        return None
    program = light.nodes.program
    # Weights 1 - b - c and b of the first two corners are u and v.
    stand_in = Mesh(np.eye(3), [(0, 1, 2)], uvs=[(1, 0), (0, 1), (0, 0)])
    scene = Scene([stand_in], instances=light.nodes.placed, camera=camera)
    surface = make_surface_tables(scene, pack_geometry(scene), smooth_normals=False, uvs=False)
    tables = make_site_tables(scene, surface, list_attributes(program), frame)
    return ComputedLight(light, light.nodes, find_needed(program, [light.nodes.color]), tables)


def vary_samples(computed: ComputedLight, positions: Floats, depths: Depths, samples: LightSamples) -> LightSamples:
    """Return samples (n,) of a light from `positions` (n, 3), each weighed by what the nodes make of it.

    depths : how far paths have come to the positions
    """
    rows = np.flatnonzero(samples.density > 0)
    distance = samples.distance[rows]
    reach = np.minimum(distance, FARTHEST)
    path = LightPath({**describe_sampling(reach, depths.select(rows)).values, "travelled": reach})
    weight = np.zeros(samples.weight.shape)
    factor = find_factor(computed, positions[rows], samples.direction[rows], distance, path)
    weight[rows] = samples.weight[rows] * factor
    return replace(samples, weight=weight)


def find_factor(
    computed: ComputedLight, positions: Floats, directions: Floats, distance: Floats, path: LightPath
) -> Floats:
    """Return what the nodes make of the light (n, 3) that arrives at `positions` along unit `directions` to the light.

    distance : (n,) metres, to the light; path : how the rays go
    """
    site = _make_site(computed, positions, directions, distance, path)
    found = evaluate(computed.nodes.program, site, computed.needed)[computed.nodes.color]
    return np.broadcast_to(np.nan_to_num(found, nan=0.0, posinf=0.0, neginf=0.0), directions.shape)


def _make_site(
    computed: ComputedLight, positions: Floats, directions: Floats, distance: Floats, path: LightPath
) -> Site:
    count = len(directions)
    place = _find_place(computed.light, positions, directions, distance)
    normal = _find_normal(computed.light, place, directions)
    u, v = _find_uv(computed, place, normal, directions)
    weights = np.stack([v, 1.0 - u - v], axis=1)
    surface = imagine_surface(place, normal, -directions, is_front=True, weights=weights)
    return Site(surface, computed.tables, path, np.zeros(count))


def _find_place(light: Light, positions: Floats, directions: Floats, distance: Floats) -> Floats:
    if isinstance(light, SunLight):
        return -directions
    return positions + distance[:, np.newaxis] * directions


def _find_normal(light: Light, place: Floats, directions: Floats) -> Floats:
    if isinstance(light, AreaLight):
        return np.broadcast_to(unit_axes(light)[2], directions.shape)
    if isinstance(light, PointLight) and light.radius > 0 and not light.soft_falloff:
        return normalize(place - light.position)
    return -directions


def _find_uv(computed: ComputedLight, place: Floats, normal: Floats, directions: Floats) -> tuple[Floats, Floats]:
    """Return u and v (n,) of points on a light.

    A sun's disc of half angle h is mapped with equal areas: (x, y) / (4 sin(h / 2) cos(t / 2)) at the angle t.
    """
    light, local = computed.light, computed.tables.object_from_world[0, :3, :3]
    if isinstance(light, AreaLight):
        offset = place - light.position
        sides = (light.axis_u, -light.axis_v if _is_mirrored(computed) else light.axis_v)
        u, v = (dot(offset, side) / dot(side, side) for side in sides)
        return u + 0.5, v + 0.5
    if isinstance(light, SunLight):
        x, y, _ = transform(local, directions).T
        half = length(directions + light.direction) * np.sin(light.angle / 4.0)
        scale = np.divide(0.5, half, out=np.zeros_like(half), where=half > 0)
        return 0.5 + x * scale, 0.5 + y * scale
    if isinstance(light, SpotLight):
        x, y, z = transform(local, -directions).T
        scale = 0.5 / np.tan(light.spot_size / 2.0) / np.maximum(-z, np.finfo(np.float64).tiny)
        return 0.5 + x * scale, 0.5 + y * scale
    return map_sphere(*split_columns(transform(local, normal)))


def _is_mirrored(computed: ComputedLight) -> bool:
    """True where the object turns a left hand into a right one; its axis v is turned round then, to keep the front."""
    return bool(np.linalg.det(computed.nodes.placed.world_from_object[0, :3, :3]) < 0)
