"""What nodes read at a point: coordinates, attributes, geometry, the object, the ray, and how the surface is seen.

References
----------
Blender, intern/cycles/kernel/svm/tex_coord.h, geometry.h, attribute.h, light_path.h, fresnel.h, camera.h, ao.h.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from raytracer.arrays.vectors import normalize, reflect
from raytracer.bsdfs.fresnel import dielectric_reflectance
from raytracer.lecture import dot, length
from raytracer.shading.light_path import FARTHEST
from raytracer.shading.nodes.operation import Array, Operation, divide, spread
from raytracer.shading.occlusion import find_open
from raytracer.shading.site import Site

SMALLEST_IOR = 1e-5  # as in Cycles


def read_vector(site: Site, *, name: str) -> Array:
    """A mesh attribute as vector: numbers repeat, uvs are (u, v, 0), colors lose their alpha; 0 where it is missing.

    "generated" on geometry without it is the position in object space.
    """
    values = site.read_attribute(name)[:, :3]
    missing = ~site.has_attribute(name)
    if name == "generated" and missing.any():
        values[missing] = site.to_object(site.position)[missing]
    return values


def read_factor(site: Site, *, name: str) -> Array:
    """A mesh attribute as number: the mean of color or vector, u of uvs."""
    values = site.read_attribute(name)
    return np.where(site.attribute_width(name) == 2, values[:, 0], values[:, :3].sum(axis=1) / 3.0)


def read_alpha(site: Site, *, name: str) -> Array:
    """The alpha of a color attribute; 1 for others, and where there is none."""
    return np.where(site.attribute_width(name) == 4, site.read_attribute(name)[:, 3], 1.0)


def split_color(color: Array) -> dict[str, Array]:
    """What the sockets of an Attribute node make of a color with alpha, (4,) or (n, 4): color, mean, alpha."""
    return {"Vector": color[..., :3], "Fac": color[..., :3].mean(axis=-1), "Alpha": color[..., 3]}


def read_color_alpha(site: Site, *, name: str) -> Array:
    """`read_alpha`, but 0 where there is no attribute, as Color Attribute has it."""
    return np.where(site.has_attribute(name), read_alpha(site, name=name), 0.0)


def name_of(settings: Mapping[str, Any]) -> tuple[str, ...]:
    return (settings["name"],)


def read_object_coordinates(site: Site, *, object_from_world: Array | None) -> Array:
    """The position in the space of the object that is hit, or of a chosen one."""
    if object_from_world is None:
        return site.to_object(site.position)
    return dot(object_from_world[:3, :3], site.position[:, np.newaxis]) + object_from_world[:3, 3]


def read_reflection(site: Site) -> Array:
    """The direction that the view reflects to."""
    return reflect(site.outgoing, site.normal)


def read_fresnel(site: Site, ior: Any, normal: Any) -> Array:
    """Reflectance of a dielectric seen from where the ray came."""
    eta = np.maximum(ior, SMALLEST_IOR)
    eta = np.where(site.front, eta, 1.0 / eta)
    cosine = np.abs(dot(site.outgoing, normal))
    return dielectric_reflectance(np.minimum(cosine, 1.0), np.broadcast_to(eta, cosine.shape))


def read_layer_fresnel(site: Site, blend: Any, normal: Any) -> Array:
    """`read_fresnel` for the index 1 / (1 - blend)."""
    return read_fresnel(site, 1.0 / np.maximum(1.0 - np.asarray(blend), SMALLEST_IOR), normal)


def read_facing(site: Site, blend: Any, normal: Any) -> Array:
    """1 - |cos|^k, with k = 2 blend up to 1/2 and 1 / (2 (1 - blend)) above."""
    blend = np.clip(blend, 0.0, 1.0 - SMALLEST_IOR)
    exponent = np.where(blend < 0.5, 2.0 * blend, 0.5 / (1.0 - blend))
    return 1.0 - np.minimum(np.abs(dot(site.outgoing, normal)), 1.0) ** exponent


def read_view_vector(site: Site) -> Array:
    """The direction from the camera to the point, in camera space with z forward."""
    seen = site.to_camera(site.position)
    return seen / length(seen)[:, np.newaxis]


def occlude(
    site: Site, color: Any, distance: Any, normal: Any, *, samples: int, inside: bool, only_local: bool
) -> tuple[Array, Array]:
    """A color dimmed by, and the share of, what is open around a normal as far as a distance.

    inside : True looks into the object; only_local : True where other objects block nothing. Where no rays are cast, at
        lights, for shadow rays and in the world, all is open.
    """
    if site.probe is None:
        return np.asarray(color), np.ones(())
    around = normalize(np.broadcast_to(np.asarray(normal, float), (len(site), 3)))
    reach = np.broadcast_to(np.asarray(distance, float), len(site))
    open_ = find_open(site.probe, -around if inside else around, reach, samples, only_local)
    return color * spread(open_), open_


def fall_off(power: int) -> Callable[..., Array]:
    """Return the function for a strength times t^power, t the way to the light, which falls with t^2 by itself.

    t^2 / (s + t^2) of that is left where it is smoothed by s, so that what is near does not burn out. From a sun, which
    is infinitely far, all of the strength arrives.
    """

    def weaken(site: Site, strength: Any, smooth: Any) -> Array:
        distance = site.read_path("length")
        square = distance * distance
        kept = np.where(np.asarray(smooth) > 0, divide(square, smooth + square), 1.0)
        return strength * np.where(distance < FARTHEST, distance**power * kept, 1.0)

    return weaken


def _attribute(compute: Callable[..., Any], output: str) -> Operation:
    return Operation(compute, (), (output,), ("name",), reads_site=True, attributes=name_of)


def _read(compute: Callable[[Site], Any], output: str) -> Operation:
    return Operation(compute, (), (output,), (), reads_site=True)


def _property(output: str) -> Operation:
    """A property of the object that is hit."""
    return Operation(
        lambda site, *, name: split_color(site.read_property(name))[output], (), (output,), ("name",), reads_site=True
    )


def _layer_property(output: str) -> Operation:
    """A property of the whole picture: (4,) color and alpha."""
    return Operation(lambda *, color: split_color(np.asarray(color))[output], (), (output,), ("color",))


def _path(name: str) -> Callable[[Site], Any]:
    return lambda site: site.read_path(name)


LIGHT_PATH = {
    "Is Camera Ray": "camera",
    "Is Shadow Ray": "shadow",
    "Is Diffuse Ray": "diffuse",
    "Is Glossy Ray": "glossy",
    "Is Singular Ray": "singular",
    "Is Reflection Ray": "reflection",
    "Is Transmission Ray": "transmission",
    "Is Volume Scatter Ray": "volume",
    "Ray Length": "length",
    "Ray Depth": "depth",
    "Diffuse Depth": "diffuse_depth",
    "Glossy Depth": "glossy_depth",
    "Transparent Depth": "transparent_depth",
    "Transmission Depth": "transmission_depth",
    "Portal Depth": "portal_depth",
}

_NORMAL = {"Normal": "NEW_GEOMETRY Normal"}

OPERATIONS = {
    # Attribute, Color Attribute, UV Map and Texture Coordinate all read attributes by name.
    "ATTRIBUTE Vector": _attribute(read_vector, "Vector"),
    "ATTRIBUTE Fac": _attribute(read_factor, "Fac"),
    "ATTRIBUTE Alpha": _attribute(read_alpha, "Alpha"),
    **{f"OBJECT_PROPERTY {output}": _property(output) for output in ("Vector", "Fac", "Alpha")},
    **{f"VIEW_LAYER_PROPERTY {output}": _layer_property(output) for output in ("Vector", "Fac", "Alpha")},
    "VERTEX_COLOR Alpha": _attribute(read_color_alpha, "Alpha"),
    "TEX_COORD Normal": _read(lambda site: site.normal_to_object(site.normal), "Normal"),
    "TEX_COORD Object": Operation(read_object_coordinates, (), ("Object",), ("object_from_world",), reads_site=True),
    "TEX_COORD Camera": _read(lambda site: site.to_camera(site.position), "Camera"),
    "TEX_COORD Window": _read(lambda site: site.to_window(site.position), "Window"),
    "TEX_COORD Reflection": _read(read_reflection, "Reflection"),
    "NEW_GEOMETRY Position": _read(lambda site: site.position, "Position"),
    "NEW_GEOMETRY Normal": _read(lambda site: site.normal, "Normal"),
    "NEW_GEOMETRY True Normal": _read(lambda site: site.geometric_normal, "True Normal"),
    "NEW_GEOMETRY Incoming": _read(lambda site: site.outgoing, "Incoming"),
    "NEW_GEOMETRY Parametric": _read(lambda site: site.parametric, "Parametric"),
    "NEW_GEOMETRY Backfacing": _read(lambda site: (~site.front).astype(np.float64), "Backfacing"),
    "NEW_GEOMETRY Pointiness": _attribute(read_factor, "Pointiness"),
    "NEW_GEOMETRY Random Per Island": _attribute(read_factor, "Random Per Island"),
    "OBJECT_INFO Location": _read(lambda site: site.object_location, "Location"),
    "OBJECT_INFO Color": _read(lambda site: site.object_color[:, :3], "Color"),
    "OBJECT_INFO Alpha": _read(lambda site: site.object_color[:, 3], "Alpha"),
    "OBJECT_INFO Object Index": _read(lambda site: site.object_index, "Object Index"),
    "OBJECT_INFO Material Index": Operation(
        lambda *, pass_index: np.float64(pass_index), (), ("Material Index",), ("pass_index",)
    ),
    "OBJECT_INFO Random": _read(lambda site: site.object_random, "Random"),
    **{f"LIGHT_PATH {output}": _read(_path(name), output) for output, name in LIGHT_PATH.items()},
    "CAMERA View Vector": _read(read_view_vector, "View Vector"),
    "CAMERA View Z Depth": _read(lambda site: site.to_camera(site.position)[:, 2], "View Z Depth"),
    "CAMERA View Distance": _read(lambda site: length(site.to_camera(site.position)), "View Distance"),
    "FRESNEL": Operation(read_fresnel, ("IOR", "Normal"), ("Fac",), reads_site=True, links=_NORMAL),
    "LAYER_WEIGHT Fresnel": Operation(
        read_layer_fresnel, ("Blend", "Normal"), ("Fresnel",), reads_site=True, links=_NORMAL
    ),
    "AMBIENT_OCCLUSION": Operation(
        occlude,
        ("Color", "Distance", "Normal"),
        ("Color", "AO"),
        ("samples", "inside", "only_local"),
        reads_site=True,
        links=_NORMAL,
    ),
    **{
        f"LIGHT_FALLOFF {output}": Operation(fall_off(power), ("Strength", "Smooth"), (output,), reads_site=True)
        for output, power in (("Quadratic", 0), ("Linear", 1), ("Constant", 2))
    },
    "LAYER_WEIGHT Facing": Operation(read_facing, ("Blend", "Normal"), ("Facing",), reads_site=True, links=_NORMAL),
}
