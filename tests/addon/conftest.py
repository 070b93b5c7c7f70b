"""Fixtures for tests inside Blender (the bpy wheel, or the application's Python): an empty scene, a clean exit."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import pytest

import addon
from tests.addon.extract.shaders.shader_trees import give_nodes


@pytest.fixture(autouse=True, scope="session")
def _unregister_engines() -> Iterator[None]:
    """Unregister the engines of the add-on and of tests: one left at exit crashes Blender 4.2 and hangs 4.5."""
    yield
    for engine in bpy.types.RenderEngine.__subclasses__():
        if engine.is_registered and engine.__module__.split(".")[0] in ("addon", "tests"):
            bpy.utils.unregister_class(engine)


@pytest.fixture(scope="module")
def registered_addon() -> Iterator[None]:
    """Register the add-on for the tests of a module: pytestmark = pytest.mark.usefixtures("registered_addon")."""
    addon.register()
    yield
    addon.unregister()


@pytest.fixture
def empty_scene() -> Any:
    """Return the only scene of an empty file with factory settings; add-ons stay registered."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    return bpy.context.scene


@pytest.fixture
def without_cycles(empty_scene: Any) -> Iterator[None]:
    """Switch Cycles' add-on off, with which its own properties go."""
    bpy.ops.preferences.addon_disable(module="cycles")
    yield
    bpy.ops.preferences.addon_enable(module="cycles")


@pytest.fixture
def scene_with_camera(empty_scene: Any) -> Any:
    """Return the empty scene with a camera at the origin."""
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    empty_scene.collection.objects.link(camera)
    empty_scene.camera = camera
    return empty_scene


@pytest.fixture
def shown(scene_with_camera: Any) -> Any:
    """Return an object of one triangle, without material."""
    mesh = bpy.data.meshes.new("Mesh")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])
    triangle = bpy.data.objects.new("Object", mesh)
    scene_with_camera.collection.objects.link(triangle)
    return triangle


@pytest.fixture
def tree(shown: Any) -> Any:
    """Return the nodes of a new material on the object: an output, nothing else."""
    return give_nodes(shown, "Material")
