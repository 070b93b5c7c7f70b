"""Strands of hair as Blender gives them to render engines: Curves objects, and particles that are shown as paths.

Everything stays in object space. A Curves object is read as arrays; particles have no such way, but one call for each
point: 1.7 s for 100,000 strands of 17 points, all in all.

References
----------
Blender, intern/cycles/blender/curves.cpp: which particles are strands, their radii, and what materials read of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytracer.shading.nodes.strands import AXIS, INTERCEPT, LENGTH, RANDOM
from raytracer.textures.noise import LARGEST_WORD, hash_words

from .attributes import UNNAMED, read_values
from .meshes import read_array, read_attribute
from .shaders.node_settings import DEFAULT_UV, GENERATED
from .warnings import WarningList

DEFAULT_RADIUS = 0.005  # Blender's radius of curves that have no radius attribute

Values = NDArray[np.float64]


@dataclass(frozen=True)
class Strands:
    """Strands in object space.

    points : (p, 3) float64; radii : (p,) float64
    first : (s + 1,) int32, the first point of each strand, then p
    thick : True for round strands, False for ribbons
    number : of the first strand, among all of the object's
    system : the name of the particle system that they are, "" of a Curves object
    attributes, strand_attributes : by name, (p, k) and (s, k) float64, what materials read of points and of strands
    uvs : (s, 2) float64, or None
    """

    points: Values
    radii: Values
    first: NDArray[np.int32]
    thick: bool = False
    number: int = 0
    system: str = ""
    attributes: dict[str, Values] | None = None
    strand_attributes: dict[str, Values] | None = None
    uvs: Values | None = None

    def __len__(self) -> int:
        return len(self.first) - 1


def shows_thick(scene: Any) -> bool:
    """True where a scene's hair is round: as Cycles is told, or Blender's own setting where Cycles is not there."""
    cycles = getattr(scene, "cycles_curves", None)
    return scene.render.hair_type == "CYLINDER" if cycles is None else cycles.shape != "RIBBONS"


# Curves objects ------------------------------------------------------------------------------------------------------


def extract_curves(data: Any, name: str, thick: bool, names: Iterable[str], warnings: WarningList) -> Strands | None:
    """Return the strands of a Curves data-block, or None without any; those that are not finite are dropped.

    names : of the attributes that materials read
    """
    strands = read_curves(data)
    if strands is None:
        return None
    kinds = read_attribute(data, "curve_type", "value", np.intc)
    if kinds is not None and len(kinds) and kinds[0] == POLY:
        warnings.add("curves of type Poly are shown smooth, as round strands", name)
        thick = True
    values: dict[str, tuple[str, Values]] = {}
    for attribute in (data.attributes.get(each) for each in sorted(set(names) - UNNAMED)):
        found = None if attribute is None else read_values(attribute)
        if attribute is not None and found is not None:
            values[attribute.name] = attribute.domain, found.astype(np.float64)
    if AXIS in names:
        values[AXIS] = "POINT", np.nan_to_num(read_array(data.normals, "vector", np.float32, 3)).astype(np.float64)
    strands = replace(
        strands,
        thick=thick,
        attributes={each: found for each, (domain, found) in values.items() if domain == "POINT"},
        strand_attributes={each: found for each, (domain, found) in values.items() if domain == "CURVE"},
        uvs=read_curve_uvs(data) if DEFAULT_UV in names else None,
    )
    return drop_broken(measure_strands(strands, names), name, warnings)


def read_curves(data: Any) -> Strands | None:
    """Return points and radii of a Curves data-block, or None without any."""
    points = read_attribute(data, "position", "vector", np.float32, 3)
    if points is None or not len(points):
        return None
    radii = read_attribute(data, "radius", "value", np.float32)
    if radii is None:
        radii = np.full(len(points), DEFAULT_RADIUS, dtype=np.float32)
    first = read_array(data.curve_offset_data, "value", np.intc)
    return Strands(points.astype(np.float64), np.maximum(radii.astype(np.float64), 0.0), first)


# Blender's number of curves whose points are joined by straight lines.
POLY = 1


def read_curve_uvs(data: Any) -> Values | None:
    """Return (s, 2) the coordinates of strands: as in Cycles their first attribute of two numbers."""
    found = (each for each in data.attributes if each.domain == "CURVE" and each.data_type == "FLOAT2")
    attribute = next(found, None)
    return None if attribute is None else np.nan_to_num(read_array(attribute.data, "vector", np.float32, 2))


# Particles -----------------------------------------------------------------------------------------------------------


def list_hair(source: Any, is_render: bool) -> Iterator[tuple[Any, Any]]:
    """Yield modifier and particle system of the strands that an evaluated object shows."""
    if source.mode in ("PARTICLE_EDIT", "EDIT"):
        return
    for modifier in source.modifiers:
        if modifier.type != "PARTICLE_SYSTEM" or not (modifier.show_render if is_render else modifier.show_viewport):
            continue
        settings = modifier.particle_system.settings
        if settings.type == "HAIR" and settings.render_type == "PATH":
            yield modifier, modifier.particle_system


def list_particles(system: Any, is_render: bool) -> range:
    """Return the numbers of the particles that are shown: children, and parents where there are none."""
    settings, parents, children = system.settings, len(system.particles), len(system.child_particles)
    if not is_render:
        children = int(children * settings.display_percentage / 100.0)
    has_children = settings.child_type != "NONE" and children > 0
    return range(parents if has_children else 0, parents + children)


def extract_hair(
    source: Any, modifier: Any, is_render: bool, thick: bool, number: int, warnings: WarningList, names: Iterable[str]
) -> Strands | None:
    """Return the strands of a particle system, or None without any; those that are not finite are dropped.

    number : of the object's strands before
    names : of the attributes that materials read
    """
    system = modifier.particle_system
    strands = read_hair(source, system, is_render)
    if strands is None:
        return None
    particles, roots = list_particles(system, is_render), strands.points[strands.first[:-1]]
    strands = measure_strands(replace(strands, thick=thick, number=number), names)
    strands = replace(strands, **read_roots(source, modifier, particles, roots, names, strands))
    return drop_broken(strands, source.name, warnings)


def read_hair(source: Any, system: Any, is_render: bool) -> Strands | None:
    """Return points and radii of a particle system, or None without any."""
    particles, settings = list_particles(system, is_render), system.settings
    if not particles:
        return None
    points = read_paths(source, system, particles, is_render)  # (s, steps, 3)
    count, steps = points.shape[:2]
    strands = Strands(
        points=points.reshape(-1, 3),
        radii=np.zeros(count * steps),
        first=np.arange(0, count * steps + 1, steps, dtype=np.int32),
        system=system.name,
    )
    intercept, _ = measure(strands)
    radii = find_radii(settings, intercept).reshape(count, steps)
    if settings.use_close_tip:
        radii[:, -1] = 0.0
    return replace(strands, radii=radii.reshape(-1))


def read_paths(source: Any, system: Any, particles: range, is_render: bool) -> Values:
    """Return the points (s, steps, 3) of particles, in object space.

    A path that ends before its last step has zeros from there on: it stays where it ended.
    """
    settings = system.settings
    steps = 2 ** (settings.render_step if is_render else settings.display_step) + 1
    if settings.kink == "SPIRAL":
        steps += settings.kink_extra_steps
    read = system.co_hair
    flat = [read(object=source, particle_no=number, step=step)[:] for number in particles for step in range(steps)]
    points = np.array(flat, dtype=np.float64).reshape(len(particles), steps, 3)
    missing = np.logical_and.accumulate((points == 0).all(axis=2)[:, ::-1], axis=1)[:, ::-1]
    missing[:, 0] = False
    if missing.any():
        last = np.where(missing, 0, np.arange(steps))
        points = np.take_along_axis(points, np.maximum.accumulate(last, axis=1)[:, :, np.newaxis], axis=1)
    object_from_world = invert(np.array(source.matrix_world, dtype=np.float64))
    return points @ object_from_world[:3, :3].T + object_from_world[:3, 3]


def invert(matrix: Values) -> Values:
    """Return the inverse of an affine matrix (4, 4); of one that flattens, what brings back all that it can."""
    try:
        return np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        inverse = np.eye(4)
        inverse[:3, :3] = np.linalg.pinv(matrix[:3, :3])
        inverse[:3, 3] = -inverse[:3, :3] @ matrix[:3, 3]
        return inverse


def find_radii(settings: Any, intercept: Values) -> Values:
    """Return the radii (p,) of points that are so far up their strands, from 0 to 1."""
    shape, left = settings.shape, 1.0 - intercept
    if shape < 0.0:
        left = left ** (1.0 + shape)
    elif shape > 0.0:
        # A shape of 1 is all root, but for its end.
        left = left ** (1.0 / (1.0 - shape)) if shape < 1.0 else (left == 1.0).astype(np.float64)
    root, tip = (0.5 * settings.radius_scale * value for value in (settings.root_radius, settings.tip_radius))
    return left * (root - tip) + tip


def read_roots(
    source: Any, modifier: Any, particles: range, roots: Values, names: Iterable[str], strands: Strands
) -> dict[str, Any]:
    """Return fields of Strands that tell what the surface is where each strand begins: coordinates and colors."""
    mesh, system = source.data, modifier.particle_system
    found, uvs = dict(strands.strand_attributes or {}), None
    parents = system.particles
    which = [parents[number] if number < len(parents) else parents[0] for number in particles]
    for number, layer in enumerate(mesh.uv_layers):
        if layer.name in names or (layer.active_render and DEFAULT_UV in names):
            values = read_at_roots(system.uv_on_emitter, modifier, which, particles, "uv_no", number)[:, :2]
            if layer.name in names:
                found[layer.name] = values
            if layer.active_render:
                uvs = values
    colors = [each for each in mesh.color_attributes if (each.data_type, each.domain) == ("BYTE_COLOR", "CORNER")]
    for number, color in enumerate(colors):
        if color.name in names:
            encoded = read_at_roots(system.mcol_on_emitter, modifier, which, particles, "vcol_no", number)
            found[color.name] = np.concatenate([decode(encoded), np.ones((len(encoded), 1))], axis=1)
    if GENERATED in names:
        size, location = (np.array(values) for values in (mesh.texspace_size, mesh.texspace_location))
        scale = np.divide(0.5, size, out=np.zeros_like(size), where=size != 0)
        found[GENERATED] = roots * scale - (location * scale - 0.5)
    return {"strand_attributes": found, "uvs": uvs}


def read_at_roots(read: Any, modifier: Any, which: list[Any], particles: range, key: str, number: int) -> Values:
    """Return (s, k) what a function of particle systems tells of the surface where particles begin."""
    values = [
        read(modifier, particle=particle, particle_no=index, **{key: number})[:]
        for particle, index in zip(which, particles, strict=True)
    ]
    return np.array(values, dtype=np.float64)


def decode(encoded: Values) -> Values:
    """Return linear values of those that are encoded by the sRGB curve."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


# Both ----------------------------------------------------------------------------------------------------------------


def measure(strands: Strands) -> tuple[Values, Values]:
    """Return how far up its strand each point lies, (p,) from 0 to 1, and the length (s,) of each."""
    steps = np.linalg.norm(np.diff(strands.points, axis=0, prepend=strands.points[:1]), axis=1)
    begin, end = strands.first[:-1], strands.first[1:]
    steps[begin] = 0.0
    total = np.cumsum(steps)
    counts = np.diff(strands.first)
    way = total - np.repeat(total[begin], counts)
    length = way[end - 1]
    whole = np.repeat(length, counts)
    return np.divide(way, whole, out=np.zeros_like(way), where=whole > 0), length


def measure_strands(strands: Strands, names: Iterable[str]) -> Strands:
    """Return strands with what Curves Info tells of them, where materials ask: intercept, length, random number."""
    attributes, of_strands = dict(strands.attributes or {}), dict(strands.strand_attributes or {})
    if INTERCEPT in names or LENGTH in names:
        intercept, length = measure(strands)
        if INTERCEPT in names:
            attributes[INTERCEPT] = intercept[:, np.newaxis]
        if LENGTH in names:
            of_strands[LENGTH] = length[:, np.newaxis]
    if RANDOM in names:
        words = np.arange(strands.number, strands.number + len(strands), dtype=np.uint32)
        of_strands[RANDOM] = (hash_words(words, 0).astype(np.float64) / LARGEST_WORD)[:, np.newaxis]
    return replace(strands, attributes=attributes, strand_attributes=of_strands)


def drop_broken(strands: Strands, name: str, warnings: WarningList) -> Strands | None:
    """Return strands all of whose points are finite, or None without any."""
    finite = np.isfinite(strands.points).all(axis=1) & np.isfinite(strands.radii)
    if finite.all():
        return strands
    kept = np.logical_and.reduceat(finite, strands.first[:-1])
    warnings.add(f"{int((~kept).sum())} strands are NaN or infinite and left out", name)
    if not kept.any():
        return None
    counts = np.diff(strands.first)
    points = np.repeat(kept, counts)
    return replace(
        strands,
        points=strands.points[points],
        radii=strands.radii[points],
        first=np.concatenate([[0], np.cumsum(counts[kept])]).astype(np.int32),
        attributes={each: values[points] for each, values in (strands.attributes or {}).items()},
        strand_attributes={each: values[kept] for each, values in (strands.strand_attributes or {}).items()},
        uvs=None if strands.uvs is None else strands.uvs[kept],
    )
