"""Cryptomatte: what objects, assets and materials are called, for the ray tracer and for those who read the picture.

A picture names its things in its metadata (a manifest), which Blender's Cryptomatte node and other programs read.

References
----------
Cryptomatte specification 1.2; Blender, intern/cycles/blender/session.cpp (add_cryptomatte_layer), object.cpp (names of
objects, and of assets: an object's topmost parent).
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import bpy
import numpy as np

import raytracer
from raytracer.film.mattes import hash_name, hash_to_float
from raytracer.film.passes import matte_table, select_mattes

from ..extract.scene import Extraction

Names = dict[str, list[str]]


def name_things(extraction: Extraction, passes: Sequence[str]) -> Names:
    """Return by kind of Cryptomatte that is asked for the names of instances and groups of spheres, or of materials."""
    kinds = select_mattes(passes)
    names: Names = {}
    objects = {}
    if {"Object", "Asset"} & set(kinds):
        known = {thing.session_uid: thing for thing in bpy.data.objects}
        objects = {key: known.get(key.session_uid) for key in set(extraction.objects)}
    for kind in kinds:
        if kind == "Material":
            names[kind] = [material.name for material in extraction.scene.materials]
        else:
            names[kind] = [name_thing(objects[key], kind) for key in extraction.objects]
    return names


def name_thing(thing: Any, kind: str) -> str:
    """Return the name of an object, or of the asset that it belongs to."""
    while kind == "Asset" and thing is not None and thing.parent is not None:
        thing = thing.parent
    return thing.name if thing is not None else ""


def give_identities(scene: raytracer.Scene, names: Names) -> raytracer.Scene:
    """Return the scene with the hashes of its objects and assets, for the integrator to find."""
    found = {matte_table(kind): own for kind, own in names.items() if kind != "Material"}
    if not found:
        return scene
    count = scene.instance_count
    rows = {
        name: np.pad([[hash_to_float(hash_name(one))] for one in own], ((0, 0), (0, 3))) for name, own in found.items()
    }
    spheres = tuple(
        replace(group, properties={**group.properties, **{name: table[number] for name, table in rows.items()}})
        for number, group in enumerate(scene.spheres, count)
    )
    instances = scene.instances
    if instances is not None:
        own = {name: table[:count] for name, table in rows.items()}
        instances = replace(instances, properties={**instances.properties, **own})
    return replace(scene, instances=instances, spheres=spheres)


def describe_mattes(view_layer: str, names: Names) -> Iterator[tuple[str, str]]:
    """Yield the fields of a picture's metadata, names and values, for each kind of Cryptomatte."""
    for kind, own in names.items():
        layer = f"{view_layer}.Crypto{kind}"
        prefix = f"cryptomatte/{hash_name(layer):08x}"[: len("cryptomatte/") + 7]
        yield f"{prefix}/name", layer
        yield f"{prefix}/hash", "MurmurHash3_32"
        yield f"{prefix}/conversion", "uint32_to_float32"
        yield f"{prefix}/manifest", write_manifest(own)


def write_manifest(names: Iterable[str]) -> str:
    """Return names with their hashes as JSON."""
    return json.dumps({name: f"{hash_name(name):08x}" for name in dict.fromkeys(names)}, ensure_ascii=False)
