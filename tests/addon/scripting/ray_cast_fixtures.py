"""What the tests of addon.ray_cast share: small scenes, rays that meet no edge, and Blender's answers."""

from __future__ import annotations

from functools import partial
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from addon import ray_cast
from addon.scripting import held

DOWN = (0.0, 0.0, -1.0)
# Numbers below 32 through a few dozen operations of float32.
TOLERANCE = 64 * 32 * 2.0**-24


@pytest.fixture
def forget_casters():
    held.forget()
    yield
    held.unregister()


def find_depsgraph() -> Any:
    return bpy.context.evaluated_depsgraph_get()


def make_quad(size=1.0, z=0.0, copies=1):
    """Return a mesh of squares in the plane z and, for copies, in planes 0.1 below each other."""
    corners = [(x, y, z - k / 10) for k in range(copies) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    mesh = bpy.data.meshes.new("Quad")
    mesh.from_pydata(corners, [], [tuple(range(4 * k, 4 * k + 4)) for k in range(copies)])
    mesh.transform(Matrix.Diagonal((size, size, 1, 1)))
    return mesh


def link(name, data, location=(0, 0, 0), collection=None):
    """Return a new object of the scene, or of a collection."""
    thing = bpy.data.objects.new(name, data)
    thing.location = location
    (collection or bpy.context.scene.collection).objects.link(thing)
    return thing


def aim_down(x=3.5, count=12):
    """Return rays from z = 9 on a grid that meets no edge or diagonal of the scenes below."""
    xs, ys = np.meshgrid(np.linspace(-x, x, count) + 0.013, np.linspace(-x, x, count) + 0.037)
    origins = np.stack([xs.ravel(), ys.ravel(), np.full(xs.size, 9.0)], axis=1)
    return origins.astype(np.float32).astype(float), np.tile(DOWN, (xs.size, 1))


def assert_same_as_blender(origins=None, directions=None, depsgraph=None, **options):
    """Assert that each ray gets what Scene.ray_cast returns; return the cast.

    Blender is asked first: reading a mesh in edit mode converts it, and since 5.0 its own rays then see hidden faces.
    """
    if origins is None:
        origins, directions = aim_down()
    depsgraph = depsgraph or find_depsgraph()
    one_by_one = partial(bpy.context.scene.ray_cast, depsgraph, **options)
    expected = [one_by_one(*ray) for ray in zip(origins, directions, strict=True)]
    cast = ray_cast(depsgraph, origins, directions, **options)
    for ray, (result, location, normal, index, shown, matrix) in enumerate(expected):
        assert cast.result[ray] == result
        assert (cast.objects[cast.object[ray]] if result else None) == shown
        assert cast.index[ray] == (index if result else -1)
        np.testing.assert_array_equal(cast.matrix[ray], np.array(matrix, dtype=float))
        np.testing.assert_allclose(cast.location[ray], location, rtol=0, atol=TOLERANCE)
        assert_same_normal(cast.normal[ray], np.array(normal), cast.matrix[ray, :3, :3])
    return cast


def assert_same_normal(ours, blender, linear):
    """Ours is M^-T n of the object's normal n; Blender's is M n before 5.2, which is none under non-uniform scale."""
    turned = linear @ linear.T @ ours
    if np.abs(ours - blender).max() > TOLERANCE and bpy.app.version < (5, 2):
        ours = turned / np.linalg.norm(turned)
    np.testing.assert_allclose(ours, blender, rtol=0, atol=TOLERANCE)


def set_values(**values):
    def change(thing):
        for name, value in values.items():
            setattr(thing, name, value)

    return change


def make_collection_instance(**values):
    collection = bpy.data.collections.new("Instanced")
    source = link("Source", make_quad(), collection=collection)
    for location in ((2, 0, 0), (-2, 1, 0.5)):
        empty = link("Empty", None, location)
        empty.instance_type, empty.instance_collection = "COLLECTION", collection
    set_values(**values)(source)
