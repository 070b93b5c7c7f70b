"""Scenes as files: one .npz that holds a JSON outline and the arrays it refers to; nothing is pickled."""

from __future__ import annotations

import dataclasses
import json
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.files.replacing import replace_file
from raytracer.scene.camera import Camera
from raytracer.scene.lights import AreaLight, PointLight, SpotLight, SunLight, World
from raytracer.scene.materials import Closure, Material
from raytracer.scene.programs import Image, Program, Register, Step
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Instances, Mesh, Spheres

FILE_FORMAT = "reference-raytracer-scene-1"

RECORDS = {
    record.__name__: record
    for record in (
        *(Mesh, Spheres, Instances, Closure, Material, PointLight, SpotLight, SunLight, AreaLight),
        *(World, Camera, Scene, Program, Step, Register, Image),
    )
}


def save(scene: Scene, path: str | Path) -> None:
    """Write `scene` as one .npz: a JSON outline plus the arrays it refers to; nothing is pickled.

    Arrays that records share in memory are written once.

    Examples
    --------
    >>> import tempfile, pathlib, raytracer
    >>> scene = raytracer.Scene(spheres=raytracer.Spheres([(0, 0, 0)], [1.0]))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "scene.npz"
    ...     raytracer.save(scene, path)
    ...     again = raytracer.load(path)
    >>> again.spheres[0].radii.tolist()
    [1.0]
    """
    arrays: dict[str, NDArray[Any]] = {}
    keys: dict[tuple[int, tuple[int, ...], str], str] = {}

    def outline(value: Any) -> Any:
        if dataclasses.is_dataclass(value):
            fields = {item.name: outline(getattr(value, item.name)) for item in dataclasses.fields(value)}
            return {"record": type(value).__name__, "fields": fields}
        if isinstance(value, np.ndarray):
            memory = (value.__array_interface__["data"][0], value.shape, value.dtype.str)
            arrays[keys.setdefault(memory, f"array_{len(keys)}")] = value
            return {"array": keys[memory]}
        if isinstance(value, tuple):
            return [outline(item) for item in value]
        if isinstance(value, dict):
            return {"table": {name: outline(item) for name, item in value.items()}}
        return value.item() if isinstance(value, np.generic) else value

    if not isinstance(scene, Scene):
        raise ValueError(f"save: expected a Scene, got {type(scene).__name__}")
    text = json.dumps({"format": FILE_FORMAT, "scene": outline(scene)})
    with replace_file(path) as new, zipfile.ZipFile(new, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in {"outline": np.array(text), **arrays}.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                np.lib.format.write_array(entry, array, allow_pickle=False)


def load(path: str | Path) -> Scene:
    """Read a scene written by `save`; every record is validated again.

    Raises
    ------
    ValueError
        If the file is not such a scene, naming the file.

    Examples
    --------
    >>> import tempfile, pathlib, raytracer
    >>> scene = raytracer.Scene(spheres=raytracer.Spheres([(0, 0, 0)], [1.0]))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "scene.npz"
    ...     raytracer.save(scene, path)
    ...     again = raytracer.load(path)
    >>> again.spheres[0].radii.tolist()
    [1.0]
    """
    try:
        with open(path, "rb") as stream, np.load(stream, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        content = json.loads(str(arrays.pop("outline")))
        if content["format"] != FILE_FORMAT:
            raise ValueError(f"format {content['format']}")
        scene = _restore(content["scene"], arrays)
        if not isinstance(scene, Scene):
            raise ValueError(f"a {type(scene).__name__}")
    except (KeyError, TypeError, ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise ValueError(f"{path}: expected a scene written by raytracer.save ({FILE_FORMAT}), got {error}") from None
    return scene


def _restore(value: Any, arrays: dict[str, NDArray[Any]]) -> Any:
    """Rebuild a record, sequence, array or plain value from its outline."""
    if isinstance(value, list):
        return tuple(_restore(item, arrays) for item in value)
    if isinstance(value, dict) and "array" in value:
        return arrays[value["array"]]
    if isinstance(value, dict) and "table" in value:
        return {name: _restore(item, arrays) for name, item in value["table"].items()}
    if isinstance(value, dict):
        return RECORDS[value["record"]](**{name: _restore(item, arrays) for name, item in value["fields"].items()})
    return value
