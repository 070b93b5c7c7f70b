"""What shaders write to passes that a scene names itself (arbitrary output variables, AOVs).

A material's program for them is its own, evaluated only where such a pass is asked for, at the surfaces that describe a
pixel: what shades is the same with it and without.

References
----------
Blender, intern/cycles/kernel/svm/aov.h and film/aov_passes.h.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from raytracer.arrays.types import Floats, Indices
from raytracer.film.passes import find_pass
from raytracer.scene.programs import Aovs, Program, Register
from raytracer.scene.scene import Scene
from raytracer.shading.computed import Recipe, Recipes, join_recipes, make_site, sort_points
from raytracer.shading.evaluate import casts_rays, evaluate, find_needed
from raytracer.shading.light_path import LightPath
from raytracer.shading.site_tables import SiteTables
from raytracer.surfaces.surface import Surface

# The slot of a recipe's values: they belong to no closure.
OWN = -1


@dataclass(frozen=True, eq=False)
class MaterialAovs:
    """What the materials of a scene write to the passes asked for.

    tables : what programs read; None where all values are constant
    casts_rays : True where a program casts rays
    """

    recipes: Recipes
    tables: SiteTables | None
    casts_rays: bool


def select_aovs(aovs: Aovs | None, names: Sequence[str]) -> dict[str, Any]:
    """Return what is written to the passes `names`.

    Raises
    ------
    ValueError
        If a color is written to a pass of numbers.
    """
    if aovs is None:
        return {}
    values = {name: value for name, value in aovs.values.items() if name in names}
    for name, value in values.items():
        if find_pass(name).channels == 1 and np.ndim(0.0 if isinstance(value, Register) else value):
            raise ValueError(f"Aovs: {name!r}: expected a number, got a color")
    return values


def computes_aovs(scene: Scene, names: Sequence[str]) -> bool:
    """True where a program of a material writes to one of the passes `names`."""
    return any(
        isinstance(value, Register)
        for material in scene.materials
        for value in select_aovs(material.aovs, names).values()
    )


def make_material_aovs(scene: Scene, names: Sequence[str], tables: SiteTables | None) -> MaterialAovs | None:
    """Return what materials write to the passes `names`; None where nothing is."""
    recipes = {}
    for number, material in enumerate(scene.materials):
        values = select_aovs(material.aovs, names)
        if material.aovs is not None and values:
            program = material.aovs.program or Program()
            needed = find_needed(program, values.values())
            slots = {(OWN, name): value for name, value in values.items()}
            recipes[number] = Recipe(program, slots, needed, frozenset())
    if not recipes:
        return None
    casts = any(casts_rays(recipe.program) for recipe in recipes.values())
    return MaterialAovs(join_recipes(recipes, len(scene.materials)), tables, casts)


def list_written(aovs: MaterialAovs, surface: Surface, path: LightPath | None) -> Iterator[tuple[str, Indices, Floats]]:
    """Yield the passes that n points of a surface write to, which of the points, and the values (k, 1) or (k, 3)."""
    for recipe, points in sort_points(aovs.recipes, surface.material):
        outputs = {}
        if recipe.needed:
            assert aovs.tables is not None
            outputs = evaluate(recipe.program, make_site(aovs.tables, surface, path, points), recipe.needed)
        for (_, name), value in recipe.values.items():
            found = outputs[value] if isinstance(value, Register) else value
            yield name, points, spread_written(name, found, len(points))


def spread_written(name: str, found: Any, count: int) -> Floats:
    """Return what is written to a pass, a value for all or one for each of k points, as (k, 1) or (k, 3); what is not
    finite becomes 0."""
    values = np.nan_to_num(np.asarray(found, dtype=np.float64), nan=0.0, posinf=0.0, neginf=0.0)
    if find_pass(name).channels == 1:
        return np.broadcast_to(values, count)[:, np.newaxis]
    return np.broadcast_to(values if values.shape in ((3,), (count, 3)) else values[..., np.newaxis], (count, 3))
