"""What materials read of instances: properties of objects and their data, and what instancers give their instances.

Attributes of the instances that geometry nodes make are read once for each instancer, from `Object.evaluated_geometry`
(Blender 4.5 on; before, only instancers' own properties are found).

References
----------
Blender, source/blender/blenkernel/intern/object_dupli.cc (BKE_object_dupli_find_rgba_attribute,
find_geonode_attribute_rgba, make_duplis_geometry_set_impl), intern/cycles/blender/object.cpp (sync_object).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.textures.noise import LARGEST_WORD, hash_words

from .attributes import ATTRIBUTE_TYPES
from .custom_properties import Color, find_first, find_property
from .meshes import read_array, read_attribute
from .shaders.node_settings import GIVEN_GENERATED, GIVEN_UV, INSTANCER, OBJECT, PARTICLE, SPACE
from .texture_space import read_texture_space

# What fills `persistent_id` beyond the levels that an instance lies in.
NO_LEVEL = 2**31 - 1
COMPONENTS = {"mesh": "MESH", "curves": "CURVES", "pointcloud": "POINTCLOUD", "volume": "VOLUME"}


class Level(NamedTuple):
    """What a geometry shows as instances.

    geometry : bpy.types.GeometrySet, without which `cloud`, which holds the attributes of its instances, is gone; None
        without any
    has_parts : True where it shows parts besides, so that its instances lie one level deeper
    rows : of each instance, by its number; reference : (k,) what each shows, an index of `references`
    """

    geometry: Any
    cloud: Any
    has_parts: bool
    rows: dict[int, int]
    references: list[Any]
    reference: NDArray[Any]


class InstanceReader:
    """Reads properties of the instances of one walk; levels and their attributes are read once."""

    def __init__(self, frame: float) -> None:
        self._frame = frame
        self._levels: dict[Any, Level] = {}
        self._attributes: dict[Any, NDArray[np.float64] | None] = {}

    def read(self, instance: Any, names: Iterable[str]) -> dict[str, Color]:
        """Return what materials read of an instance of the depsgraph: (4,) by name.

        names : a kind of `node_settings`, then a blank and the name of the property
        """
        return {name: self._read(instance, *name.partition(" ")[::2]) for name in names}

    def _read(self, instance: Any, kind: str, name: str) -> Color:
        given = instance.is_instance
        if kind == GIVEN_UV:
            return np.array([*instance.uv, 0.0, 1.0]) if given else np.zeros(4)
        if kind == GIVEN_GENERATED:  # as Cycles scales it
            return np.array([*(0.5 * np.array(instance.orco) - 0.5), 1.0]) if given else np.zeros(4)
        if kind == SPACE:
            return np.array([*getattr(read_texture_space(instance.object), name.lower()), 1.0])
        if kind == PARTICLE:
            return read_particle(instance, name, self._frame)
        own = (instance.object, instance.object.data)
        if kind == OBJECT or not given:
            return find_first(own, name)
        assert kind == INSTANCER
        return self._read_given(instance, name, own)

    def _read_given(self, instance: Any, name: str, own: tuple[Any, ...]) -> Color:
        """Return a property of the particles, the attribute of the innermost instance that has it, a property of the
        instancer, or one of the object."""
        system = instance.particle_system
        found = find_property(system.settings, name) if system is not None else None
        if found is not None:
            return found
        for key, level, number in reversed(list(self._list_levels(instance))):
            values = self._find_attribute(key, level, name)
            if values is not None and number in level.rows:
                return values[level.rows[number]]
        return find_first((instance.parent, *own), name)

    def _list_levels(self, instance: Any) -> Iterator[tuple[Any, Level, int]]:
        """Yield the instances of geometry nodes that an instance lies in, outermost first: key, level and number."""
        parent = instance.parent
        if not hasattr(parent, "evaluated_geometry"):
            return
        numbers = [number for number in instance.persistent_id if number != NO_LEVEL][::-1]
        key: tuple[Any, ...] = (parent.original.session_uid,)
        owner, of_object = parent, True
        while numbers:
            if key not in self._levels:
                geometry = owner.evaluated_geometry() if of_object else owner
                self._levels[key] = make_level(geometry, owner.type if of_object else "")
            level = self._levels[key]
            number, *numbers = numbers[level.has_parts :] or [NO_LEVEL]
            if level.cloud is None or number == NO_LEVEL:
                return
            yield key, level, number
            if number not in level.rows:
                return
            reference = int(level.reference[level.rows[number]])
            owner, key = level.references[reference], (*key, reference)
            of_object = hasattr(owner, "evaluated_geometry")
            if not of_object and not hasattr(owner, "instances_pointcloud"):
                return

    def _find_attribute(self, key: Any, level: Level, name: str) -> NDArray[np.float64] | None:
        if (key, name) not in self._attributes:
            self._attributes[key, name] = read_colors(level.cloud, name)
        return self._attributes[key, name]


# What Particle Info reads of a particle.
PARTICLE_FIELDS = {
    "Lifetime": "lifetime",
    "Size": "size",
    "Location": "location",
    "Velocity": "velocity",
    "Angular Velocity": "angular_velocity",
}


def read_particle(instance: Any, output: str, frame: float) -> Color:
    """Return what Particle Info says of the particle that an instance stands for: 0 without one, and for children.

    References
    ----------
    Blender, intern/cycles/blender/particles.cpp, sync_dupli_particle; kernel/svm/geometry.h, svm_node_particle_info.
    """
    system, number = instance.particle_system, instance.persistent_id[0] if instance.is_instance else 0
    known = system is not None and number < len(system.particles)
    if output == "Random":
        value: Any = float(hash_words(number if known else 0, 0)) / LARGEST_WORD
    elif not known:
        value = 0.0
    elif output == "Index":
        value = number
    elif output == "Age":
        value = frame - system.particles[number].birth_time
    else:
        value = getattr(system.particles[number], PARTICLE_FIELDS[output])
    return np.append(np.broadcast_to(np.array(value, dtype=np.float64), 3), 1.0)


def make_level(geometry: Any, kind: str) -> Level:
    """Return the instances of a geometry; kind : the type of the object whose own part it shows itself, or "".

    Blender numbers instances by their attribute `id`, the first of those that share one, else in order.
    """
    cloud = geometry.instances_pointcloud()
    reference = read_attribute(cloud, ".reference_index", "value", np.intc) if cloud is not None else None
    has_parts = any(own != kind and getattr(geometry, name) is not None for name, own in COMPONENTS.items())
    if reference is None:
        return Level(geometry, None, has_parts, {}, [], np.empty(0, np.intc))
    numbers = read_attribute(cloud, "id", "value", np.intc)
    rows: dict[int, int] = {}
    for row, number in enumerate(range(len(reference)) if numbers is None else numbers.tolist()):
        rows.setdefault(number, row)
    return Level(geometry, cloud, has_parts, rows, list(geometry.instance_references()), reference)


def read_colors(cloud: Any, name: str) -> NDArray[np.float64] | None:
    """Return (k, 4) an attribute of instances as color: numbers are grey, alpha is 1 where there is none."""
    attribute = cloud.attributes.get(name) if name else None
    if attribute is None or attribute.data_type not in ATTRIBUTE_TYPES:
        return None
    field, dtype, width = ATTRIBUTE_TYPES[attribute.data_type]
    values = np.nan_to_num(read_array(attribute.data, field, dtype, width).reshape(-1, width).astype(np.float64))
    colors = np.zeros((len(values), 4))
    colors[:, 3] = 1.0
    colors[:, : width if width > 1 else 3] = values
    return colors
