"""Baking: what the surface of an object looks like, or is, in the pixels of a texture (Blender's Render > Bake).

Blender hands over, for each pixel, the triangle of the object's mesh and where on it; what comes back is one result
of the texture's size. Margin, tangent space and the saving of pictures are Blender's.

References
----------
Blender, source/blender/render/intern/engine.cc: render_result_from_bake, render_result_to_bake;
intern/cycles/scene/bake.cpp and blender/session.cpp: which light the types and their contributions stand for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import raytracer
from raytracer.film.passes import LIGHT_PARTS, light_pass
from raytracer.integrator.settings import Settings
from raytracer.rendering.baking import BakePoints, Eye, bake

from ..extract.scene import Extraction, extract_scene
from ..properties import BAKE_TYPES, settings_keywords
from ..versions import split_bake_primitives
from . import worker_pool

Values = dict[str, NDArray[np.float64]]

# Bits of the contributions of a bake.
EMIT, DIFFUSE, GLOSSY, TRANSMISSION, DIRECT, INDIRECT, COLOR = 2, 4, 8, 16, 64, 128, 256
PART_BITS = dict(zip(LIGHT_PARTS, (DIFFUSE, GLOSSY, TRANSMISSION), strict=True))
WAY_BITS = {"Direct": DIRECT, "Indirect": INDIRECT}
ALL_LIGHT = EMIT | DIFFUSE | GLOSSY | TRANSMISSION | DIRECT | INDIRECT

# The types whose pixels hold one pass as it is.
PLAIN_TYPES = {
    "NORMAL": "Normal", "POSITION": "Position", "UV": "UV", "EMIT": "Emission", "AO": "Ambient Occlusion",
}  # fmt: skip
# The types of one part of light, by contributions.
PART_TYPES = {part.upper(): part for part in LIGHT_PARTS}
# Known at the middle of a pixel; the mean of several points would say no more.
POINT_TYPES = ("POSITION", "UV")


def bake_object(engine: Any, depsgraph: Any, thing: Any, kind: str, contributions: int, size: tuple[int, int]) -> None:
    """Bake an object into the texture that Blender is at.

    Raises
    ------
    ValueError
        If the object, or the type of bake, cannot be baked; with the reason.
    """
    names = {identifier: name for identifier, name, _ in BAKE_TYPES}
    if kind not in names:
        raise ValueError(f"baking {kind.capitalize()} is not supported: expected {', '.join(names.values())}")
    engine.baked_images += 1
    # Blender finds the picture again by the layer's name.
    result = engine.begin_result(0, 0, *size, layer=f"Bake {engine.baked_images}")
    try:
        passes = {stored.name: stored for stored in result.layers[0].passes}
        triangle, weights = split_bake_primitives(read_pass(passes["BakePrimitive"], size))
        rows = np.flatnonzero(triangle >= 0)
        target = passes["Combined"]
        pixels = np.zeros((len(triangle), target.channels), np.float32)
        if len(rows):
            made_of = list_passes(kind, contributions)
            extraction = extract_scene(depsgraph, made_of, needs_camera=False)
            report_new(engine, map(str, extraction.warnings))
            instance = find_instance(extraction, thing)
            check_triangles(extraction, instance, thing)
            steps = read_pass(passes["BakeDifferential"], size)[rows].reshape(-1, 2, 2)
            points = BakePoints(
                rows.astype(np.uint32),
                np.full(len(rows), instance, np.int32),
                triangle[rows],
                weights[rows].astype(np.float64),
                steps.astype(np.float64),
            )
            values = trace_points(engine, depsgraph, extraction.scene, points, kind, made_of)
            if values is not None:
                color = choose_values(values, kind, contributions, depsgraph.scene_eval.reference_raytracer.exposure)
                pixels[rows, :3] = color
                pixels[rows, 3:] = 1.0
        target.rect.foreach_set(pixels.ravel())
    finally:
        engine.end_result(result)


def report_new(engine: Any, warnings: Iterable[str]) -> None:
    """Tell the user what a bake does not honour: once, however many textures and objects it has."""
    for warning in dict.fromkeys(warnings):
        if warning not in engine.baked_warnings:
            engine.baked_warnings |= {warning}
            engine.report({"WARNING"}, warning)


def read_pass(stored: Any, size: tuple[int, int]) -> NDArray[np.float32]:
    """Return a pass (pixels, channels), bit for bit: some hold whole numbers."""
    values = np.empty(size[0] * size[1] * stored.channels, np.float32)
    stored.rect.foreach_get(values)
    return values.reshape(-1, stored.channels)


def list_passes(kind: str, contributions: int) -> tuple[str, ...]:
    """Return the passes that a type of bake is made of."""
    if kind in PLAIN_TYPES:
        return (PLAIN_TYPES[kind],)
    if kind == "COMBINED" and contributions & ALL_LIGHT == ALL_LIGHT:
        return ("Combined",)
    parts = [PART_TYPES[kind]] if kind in PART_TYPES else [p for p in LIGHT_PARTS if contributions & PART_BITS[p]]
    ways = [way for way, bit in WAY_BITS.items() if contributions & bit]
    names = [light_pass(part, way) for part in parts for way in (*ways, "Color")]
    return (*names, "Emission") if kind == "COMBINED" else tuple(names)


def choose_values(values: Values, kind: str, contributions: int, exposure: float) -> NDArray[np.float64]:
    """Return the pixels (n, 3) of a bake from its passes.

    Light of a part is divided by its color where Color is not among its contributions, and is white where Color is
    the only one that is missing.
    """
    if kind in PLAIN_TYPES:
        name = PLAIN_TYPES[kind]
        return values[name] * (exposure if name == "Emission" else 1.0)
    if "Combined" in values:
        return values["Combined"][:, :3] * exposure
    light = sum(
        (part for name, part in values.items() if not name.endswith("Color") and name != "Emission"),
        start=np.zeros((len(next(iter(values.values()))), 3)),
    )
    if kind == "COMBINED":
        return (light + (values["Emission"] if contributions & EMIT else 0.0)) * exposure
    color = values[light_pass(PART_TYPES[kind], "Color")]
    if not contributions & (DIRECT | INDIRECT):
        return color
    if contributions & COLOR:
        return light * exposure
    return np.divide(light * exposure, color, out=np.zeros_like(light), where=color > 0)


def find_instance(extraction: Extraction, thing: Any) -> int:
    """Return the number of the instance that an evaluated object is, and not one of its copies."""
    key = thing.original.session_uid
    found = [number for number, shown in enumerate(extraction.objects) if shown.session_uid == key]
    instances = extraction.scene.instances
    if instances is None or not found:
        raise ValueError(f"object '{thing.name}' has nothing to bake: it is not rendered, or has no faces")
    matrix = np.array(thing.matrix_world, dtype=np.float64)
    return min(found, key=lambda number: float(np.abs(instances.world_from_object[number] - matrix).sum()))


def check_triangles(extraction: Extraction, instance: int, thing: Any) -> None:
    """Raise ValueError where triangles were left out, so that Blender's numbers would name others."""
    instances = extraction.scene.instances
    assert instances is not None
    count = len(extraction.scene.meshes[instances.mesh[instance]].triangles)
    mesh = thing.to_mesh()
    mesh.calc_loop_triangles()
    expected = len(mesh.loop_triangles)
    thing.to_mesh_clear()
    if count != expected:
        raise ValueError(f"object '{thing.name}' has vertices that are not finite, and cannot be baked")


def trace_points(
    engine: Any,
    depsgraph: Any,
    scene: raytracer.Scene,
    points: BakePoints,
    kind: str,
    names: tuple[str, ...],
) -> Values | None:
    """Return what is seen at points, by pass, or None if the user stopped it."""
    keywords = settings_keywords(depsgraph.scene_eval) | {"error": None, "seconds": None, "adaptive": False}
    if kind in POINT_TYPES:
        keywords["samples"] = 1
    count = keywords.pop("workers")
    settings = Settings(**keywords, passes=names)
    caster = raytracer.build(scene, settings.precision)
    with worker_pool.lend(count, len(points) * settings.samples, make_teller(engine)) as workers:
        values = bake(
            scene,
            caster,
            settings,
            points,
            eye=read_eye(depsgraph.scene_eval),
            workers=workers,
            on_progress=engine.update_progress,
            is_cancelled=engine.test_break,
        )
        if values is not None:
            worker_pool.unload(workers)
    return values


def make_teller(engine: Any) -> Callable[[str], None]:
    """Return what tells the user what begins."""
    return lambda stage: engine.update_stats("", stage)


def read_eye(scene: Any) -> Eye | None:
    """Return from where a bake looks at surfaces: None where along their normals."""
    if scene.render.bake.view_from != "ACTIVE_CAMERA" or scene.camera is None:
        return None
    matrix = np.array(scene.camera.matrix_world, dtype=np.float64)
    if scene.camera.type == "CAMERA" and scene.camera.data.type == "ORTHO":
        return Eye(None, matrix[:3, 2])
    return Eye(matrix[:3, 3])
