"""The examples in docstrings of what users call: each runs, and each of those names has one."""

from __future__ import annotations

import doctest
import inspect
from importlib import import_module
from types import ModuleType
from typing import Any

import pytest

import raytracer
from raytracer import lecture

# Modules whose examples run; those of the public names are among them.
MODULES = (
    *(
        "raytracer.lecture",
        "raytracer.casting.caster",
        "raytracer.casting.questions",
        "raytracer.scene.shapes",
        "raytracer.scene.scene",
    ),
    *("raytracer.scene.scene_file", "raytracer.rendering.render", "raytracer.film.film"),
    *("raytracer.film.film_file", "raytracer.film.parts", "raytracer.film.picture_key", "raytracer.scene.scene_digest"),
    "raytracer.sampling.dimensions",
)
PUBLIC = (
    *(raytracer.build, raytracer.Caster.closest_hit, raytracer.Caster.any_hit, raytracer.Caster.crossings),
    *(raytracer.Caster.layers, raytracer.Caster.all_hits, raytracer.Caster.inside, raytracer.Caster.closest_point),
    *(raytracer.Mesh, raytracer.Scene, raytracer.render, raytracer.Film, raytracer.save, raytracer.load),
    *(raytracer.save_film, raytracer.cut, raytracer.merge),
)
# How an example is broken into lines is not what it is about.
OPTIONS = doctest.NORMALIZE_WHITESPACE


def run_examples(module: ModuleType) -> doctest.TestResults:
    """Run the examples of a module; what fails is printed."""
    return doctest.testmod(module, optionflags=OPTIONS)


@pytest.mark.parametrize("name", MODULES)
def test_examples_say_what_happens(name: str) -> None:
    results = run_examples(import_module(name))
    assert results.attempted
    assert not results.failed


def test_what_users_call_has_examples() -> None:
    functions: list[Any] = [found for name, found in inspect.getmembers(lecture, inspect.isfunction)
                            if not name.startswith("_") and found.__module__ == lecture.__name__]  # fmt: skip
    without = [found.__qualname__ for found in (*PUBLIC, *functions) if ">>>" not in (inspect.getdoc(found) or "")]
    assert not without


@pytest.mark.blender
@pytest.mark.parametrize("name", ["ray_cast", "queries", "scan"])
def test_the_examples_for_scripts_hold_in_blender(name: str) -> None:
    bpy = pytest.importorskip("bpy", reason="scripts need Blender")
    bpy.ops.wm.read_factory_settings()
    results = run_examples(import_module(f"addon.scripting.{name}"))
    assert results.attempted
    assert not results.failed


@pytest.mark.blender
def test_what_scripts_call_has_examples() -> None:
    pytest.importorskip("bpy", reason="scripts need Blender")
    addon = import_module("addon")
    assert not [name for name in addon.FUNCTIONS if ">>>" not in (inspect.getdoc(getattr(addon, name)) or "")]
