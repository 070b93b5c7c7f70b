"""Smooth glass of closed forms: panes, waves and balls, and the light that is bent through them to a floor."""

from __future__ import annotations

from functools import partial

import numpy as np

import raytracer
from raytracer.casting.ray_visibility import make_cast
from raytracer.caustics.casters import Casters, find_bending_eta
from raytracer.caustics.chains import find_seeds, find_ways
from raytracer.caustics.constraints import Ends
from raytracer.scene.fields import SEEN_BY
from raytracer.shading.materials import make_material_table, make_shading
from raytracer.surfaces.surface_tables import make_surface_tables

UP = np.array([0.0, 0.0, 1.0])


def make_pane(low, high, half=10.0, steps=1, height=lambda x, y: 0.0 * x, slopes=lambda x, y: (0.0 * x, 0.0 * y)):
    """Return a square of glass between two heights; its upper side is raised by `height` of slopes `slopes`."""
    ticks = np.linspace(-half, half, steps + 1)
    x, y = np.meshgrid(ticks, ticks, indexing="ij")
    upper = np.stack([x, y, high + height(x, y)], axis=-1).reshape(-1, 3)
    lower = np.stack([x, y, np.full_like(x, low)], axis=-1).reshape(-1, 3)
    up = np.stack([*(-slope for slope in slopes(x, y)), np.ones_like(x)], axis=-1).reshape(-1, 3)
    corners = np.arange(len(upper)).reshape(steps + 1, steps + 1)
    a, b, c, d = (part.ravel() for part in (corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    triangles = np.concatenate([faces, faces[:, ::-1] + len(upper)])
    normals = np.concatenate([up / np.linalg.norm(up, axis=1, keepdims=True), np.tile(-UP, (len(lower), 1))])
    return raytracer.Mesh(np.concatenate([upper, lower]), triangles, normals=normals)


def make_waves(low=1.0, high=1.3, size=0.03, number=3.0):
    """Return a pane whose upper side has waves, so gentle that one way leads from each point to each light."""

    def height(x, y):
        return size * np.sin(number * x + 0.4) * np.sin(number * y + 0.9)

    def slopes(x, y):
        across, along = number * x + 0.4, number * y + 0.9
        steep = size * number
        return steep * np.cos(across) * np.sin(along), steep * np.sin(across) * np.cos(along)

    return make_pane(low, high, 4.0, 40, height, slopes)


def make_ball(radius, centre, segments):
    """Return a ball of smooth triangles, turned so that no axis meets a pole or an edge."""
    polar, around = np.meshgrid(
        np.linspace(0, np.pi, segments + 1), 2 * np.pi * np.arange(2 * segments) / (2 * segments), indexing="ij"
    )
    unit = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=-1)
    number = np.arange(unit[..., 0].size).reshape(polar.shape)
    a, b = number[:-1].ravel(), np.roll(number, -1, axis=1)[:-1].ravel()
    c, d = number[1:].ravel(), np.roll(number, -1, axis=1)[1:].ravel()
    upper, lower = np.stack([a, d, b], axis=1), np.stack([a, c, d], axis=1)
    triangles = np.concatenate([upper[2 * segments :], lower[: -2 * segments]])
    turn = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0], [0.48, 0.64, 0.6]])
    normals = unit.reshape(-1, 3) @ turn.T
    return raytracer.Mesh(radius * normals + centre, triangles, normals=normals)


def make_glass(kind="glass", color=1.0, ior=1.5, **fields):
    return raytracer.Material([raytracer.Closure(kind, color=color, roughness=0.0, ior=ior, **fields)])


def open_glass(mesh, material, world_from_object=None):
    """Return the Casters of one object alone, and what its material does."""
    instances = raytracer.Instances([0], [np.eye(4) if world_from_object is None else world_from_object])
    scene = raytracer.Scene(meshes=[mesh], instances=instances, materials=[material])
    caster = raytracer.build(scene)
    cast, tables = make_cast(caster, None), make_surface_tables(scene, caster.geometry, smooth_normals=True, uvs=False)
    table = make_material_table(scene, None)

    def cast_transmitted(rays):
        return cast(rays, np.full(len(rays), SEEN_BY["transmission"], np.uint8))

    eta = np.array([find_bending_eta(material)])
    return Casters(cast_transmitted, tables, np.array([True]), eta), partial(_shade, table)


def _shade(table, surface, rows):
    return make_shading(table, surface)


def join_ends(points, light, distant=False):
    """Return the Ends of ways from points of a floor, which look up, to one light."""
    count = len(points)
    spread = [np.broadcast_to(np.asarray(part, float), (count, 3)) for part in (UP, light)]
    return Ends(np.asarray(points, float), np.zeros(count), *spread, np.full(count, float(distant)))


def look_through(mesh, material, points, light, distant=False, world_from_object=None):
    """Return the ways that light takes through an object to points of a floor, in one record, and the Casters."""
    casters, shade = open_glass(mesh, material, world_from_object)
    ends = join_ends(points, light, distant)
    ways = [way for way in find_ways(casters, ends, find_seeds(casters, ends), shade) if len(way.rows)]
    assert len(ways) == 1
    return ways[0], casters
