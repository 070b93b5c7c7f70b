"""Scenes as files: one .npz that holds a JSON outline and the arrays it refers to; nothing is pickled."""

from __future__ import annotations

import dataclasses
import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.files.archive import Archive, open_archive, take_table, write_archive
from raytracer.scene.camera import Camera, Panorama
from raytracer.scene.curves import Curves
from raytracer.scene.light_groups import LightGroups
from raytracer.scene.lights import AreaLight, LightNodes, PointLight, SpotLight, SunLight, World
from raytracer.scene.materials import Closure, Material
from raytracer.scene.media import Grid, Volume, VolumeClosure
from raytracer.scene.motion import CameraMotion, CurvesMotion, InstanceMotion, MeshMotion, Motion, SpheresMotion
from raytracer.scene.programs import Aovs, Image, Program, Register, Step, TiledImage
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Instances, Mesh, Spheres

FILE_FORMAT = "reference-raytracer-scene-1"

RECORDS = {
    record.__name__: record
    for record in (
        *(Mesh, Spheres, Curves, Instances, Closure, Material, PointLight, SpotLight, SunLight, AreaLight),
        *(LightNodes, World, Camera, Panorama, Scene, LightGroups, Aovs, Program, Step, Register, Image, TiledImage),
        *(Motion, CameraMotion, CurvesMotion, InstanceMotion, MeshMotion, SpheresMotion),
        *(Volume, VolumeClosure, Grid),
    )
}


def save(scene: Scene, path: str | Path, settings: Mapping[str, Any] | None = None) -> None:
    """Write `scene` as one .npz: a JSON outline plus the arrays it refers to; nothing is pickled.

    Arrays that records share in memory are written once.

    settings : keywords of `raytracer.render` that the scene is meant to be rendered with, for `load_settings`

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
    content = {"format": FILE_FORMAT, "settings": dict(settings or {}), "scene": outline(scene)}
    text = json.dumps(content, default=_make_plain)
    write_archive(path, {"outline": np.array(text), **arrays}, zipfile.ZIP_DEFLATED)


def _make_plain(value: Any) -> Any:
    """Return a setting that is NumPy's as JSON knows it."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise ValueError(f"save: settings: expected numbers, texts or sequences of them, got {type(value).__name__}")


def load(path: str | Path) -> Scene:
    """Read a scene written by `save`; every record is validated again.

    Only arrays that the outline names are read, each after its declared size is checked.

    Raises
    ------
    ValueError
        If the file is not such a scene or does not fit into memory, naming the file.
    OSError
        If it cannot be read, naming the file.

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
    with open_archive(path, f"a scene written by raytracer.save ({FILE_FORMAT})") as archive:
        return read_scene(archive)


def load_settings(path: str | Path) -> dict[str, Any]:
    """Return the keywords of `raytracer.render` that a file was saved with, most often none; errors as in `load`.

    Examples
    --------
    >>> import tempfile, pathlib, raytracer
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "scene.npz"
    ...     raytracer.save(raytracer.Scene(), path, {"width": 640, "height": 360, "max_bounces": 4})
    ...     load_settings(path)["max_bounces"]
    4
    """
    with open_archive(path, f"a scene written by raytracer.save ({FILE_FORMAT})") as archive:
        return read_settings(archive)


def load_with_settings(path: str | Path) -> tuple[Scene, dict[str, Any]]:
    """Return what `load` and `load_settings` do, of one and the same file where it is replaced meanwhile."""
    with open_archive(path, f"a scene written by raytracer.save ({FILE_FORMAT})") as archive:
        return read_scene(archive), read_settings(archive)


def is_scene_file(path: str | Path) -> bool:
    """Return whether a file says that it is a scene; it may be broken all the same."""
    try:
        with open_archive(path, "a scene") as archive:
            archive.read_outline(FILE_FORMAT)
    except ValueError:
        return False
    return True


def read_scene(archive: Archive) -> Scene:
    """Return the scene in an archive; ValueError where it holds something else."""
    content = archive.read_outline(FILE_FORMAT)
    scene = _restore(content.get("scene"), archive)
    if not isinstance(scene, Scene):
        raise ValueError(f"a {type(scene).__name__}")
    return scene


def read_settings(archive: Archive) -> dict[str, Any]:
    """Return the settings in an archive."""
    settings = take_table(archive.read_outline(FILE_FORMAT).get("settings", {}))
    return {name: tuple(value) if isinstance(value, list) else value for name, value in settings.items()}


def _restore(value: Any, archive: Archive) -> Any:
    """Rebuild a record, sequence, array or plain value from its outline."""
    if isinstance(value, list):
        return tuple(_restore(item, archive) for item in value)
    if isinstance(value, dict) and "array" in value:
        if not isinstance(value["array"], str):
            raise ValueError(f"an array named {value['array']!r}")
        return archive.read(value["array"])
    if isinstance(value, dict) and "table" in value:
        return {name: _restore(item, archive) for name, item in take_table(value["table"]).items()}
    if isinstance(value, dict):
        record = RECORDS.get(value.get("record", ""))
        if record is None:
            raise ValueError(f"a record of the kind {value.get('record')!r}")
        return record(**{name: _restore(item, archive) for name, item in take_table(value.get("fields")).items()})
    return value
