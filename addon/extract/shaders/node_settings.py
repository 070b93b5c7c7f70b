"""What a step is told besides its inputs: properties of Blender's nodes as plain data, by operation.

Most are the node's own properties under the same names; a reader stands here for those that are not plain.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import bpy
import numpy as np

from raytracer.scene.programs import Program, TiledImage
from raytracer.shading.evaluate import OPERATIONS
from raytracer.shading.nodes.ramps import TABLE_SIZE
from raytracer.textures.ies import Luminaire, read_ies

from ... import versions
from ..custom_properties import find_layer
from .images import ImageTable, find_first_tile, is_associated
from .nodes import Groups, WarningContext, find_socket, find_source, is_fed, reaches_output, read_number
from .skies import read_daylight_settings, read_sky_settings

# The attributes that Blender's nodes read without naming them.
DEFAULT_UV, DEFAULT_COLOR, GENERATED = "uv", "vertex_color", "generated"
ISLAND, POINTINESS = "random per island", "pointiness"

# What materials read of instances: kinds of properties, whose names follow, and what an instancer gives its instances.
OBJECT, INSTANCER, PARTICLE = "OBJECT", "INSTANCER", "PARTICLE"
GIVEN_GENERATED, GIVEN_UV = "GIVEN_GENERATED", "GIVEN_UV"
# And what turns places in object space into Generated coordinates, where there is no surface to interpolate them on.
SPACE = "SPACE"
SPACE_SCALE, SPACE_OFFSET = f"{SPACE} Scale", f"{SPACE} Offset"

Settings = dict[str, Any]


class Builder(Protocol):
    """What readers of settings ask of the builder of a program, `programs.ProgramBuilder`."""

    place: WarningContext
    images: ImageTable
    pass_index: int

    def build_inner(self, socket: Any, groups: Groups) -> Program:
        """Return a program of its own for the number that feeds a socket."""
        ...


Reader = Callable[[Builder, Any, Groups, str], Settings]


def read_settings(builder: Builder, node: Any, name: str, groups: Groups, output: str) -> Settings:
    """Return the settings of the operation `name` for a node's output."""
    if name in READERS:
        return READERS[name](builder, node, groups, output)
    return {setting: getattr(node, setting) for setting in OPERATIONS[name].settings}


def find_passed(node: Any, output: str, groups: Groups) -> str | None:
    """Return the input that a node hands on as it is, or None for one that computes.

    A Bump without height hands on its normal, a quadratic Light Falloff that is not smoothed its strength.
    """
    if node.type == "BUMP" and not is_fed(find_socket(node.inputs, "Height"), groups):
        return "Normal"
    if node.type == "LIGHT_FALLOFF" and output == "Quadratic":
        smooth = find_source(find_socket(node.inputs, "Smooth"), groups).socket
        return "Strength" if not smooth.is_output and read_number(smooth.default_value) <= 0 else None
    return None


def read_attribute_name(builder: Builder, node: Any, groups: Groups, output: str) -> Settings:
    """Attribute, Color Attribute, UV Map, Texture Coordinate and Volume Info: which attribute they read."""
    names = {
        "ATTRIBUTE": lambda: node.attribute_name,
        "VERTEX_COLOR": lambda: node.layer_name or DEFAULT_COLOR,
        "UVMAP": lambda: node.uv_map or DEFAULT_UV,
        "TEX_COORD": lambda: GENERATED if output == "Generated" else DEFAULT_UV,
        "VOLUME_INFO": output.lower,
    }
    return {"name": names[node.type]()}


def read_property_name(builder: Builder, node: Any, groups: Groups, output: str) -> Settings:
    """Attribute of type Object or Instancer, From Instancer, Particle Info: which of the properties of instances."""
    if node.type == "ATTRIBUTE":
        return {"name": f"{node.attribute_type} {node.attribute_name}"}
    if node.type == "PARTICLE_INFO":
        return {"name": f"{PARTICLE} {output}"}
    return {"name": GIVEN_GENERATED if output == "Generated" else GIVEN_UV}


def read_layer_property(builder: Builder, node: Any, groups: Groups, output: str) -> Settings:
    """Attribute of type View Layer: its value, the same for the whole picture."""
    return {"color": find_layer().find(node.attribute_name)}


def read_object(builder: Builder, node: Any, groups: Groups, output: str) -> Settings:
    """Texture Coordinate: the object whose space is meant; None is the one that is hit."""
    if node.object is None:
        return {"object_from_world": None}
    matrix = np.array(node.object.matrix_world, dtype=np.float64)
    matrix[3] = (0.0, 0.0, 0.0, 1.0)  # as Cycles: a parent's inverse matrix may hold anything there
    if not (np.isfinite(matrix).all() and abs(np.linalg.det(matrix)) > 0):
        return {"object_from_world": np.zeros((4, 4))}
    return {"object_from_world": np.linalg.inv(matrix)}


def read_image_settings(builder: Builder, node: Any, groups: Groups, output: str) -> Settings:
    """Image Texture: the image, and how it is read."""
    image = builder.images.find_image(node.image, node.image_user, node.name, builder.place)
    return {
        "image": find_first_tile(image) if node.projection == "BOX" else image,
        "interpolation": node.interpolation,
        "extension": node.extension,
        "projection": node.projection,
        "projection_blend": node.projection_blend,
        # As in Cycles: colors stay multiplied by alpha where nothing reads the alpha.
        "unassociate": is_associated(node.image) and reaches_output(node.outputs["Alpha"], groups),
    }


def read_environment_settings(builder: Builder, node: Any, groups: Groups, output: str) -> Settings:
    """Environment Texture: the image, and how it is wrapped round the world."""
    image = builder.images.find_image(node.image, node.image_user, node.name, builder.place)
    if isinstance(image, TiledImage):
        builder.place.warn(
            f"node '{node.name}': environments have no tiles, tile 1001 is shown (Cycles: magenta for tiles in files)"
        )
    return {
        "image": find_first_tile(image),
        "interpolation": node.interpolation,
        "projection": node.projection,
    }


def read_ramp(builder: Builder, node: Any, groups: Groups, output: str) -> Settings:
    """Color Ramp: what Blender itself evaluates, at even steps."""
    ramp = node.color_ramp
    table = np.array([ramp.evaluate(k / (TABLE_SIZE - 1)) for k in range(TABLE_SIZE)])  # (257, 4)
    return {"table": table, "interpolate": ramp.interpolation != "CONSTANT"}


def read_curves(builder: Builder, node: Any, groups: Groups, output: str) -> Settings:
    """RGB, Vector and Float Curves: what Blender itself evaluates, at even steps of the curves' whole range."""
    mapping = node.mapping
    mapping.initialize()
    curves = list(mapping.curves)
    ends = [point.location[0] for curve in curves for point in curve.points]
    low, high = (min(ends), max(ends)) if max(ends) > min(ends) else (0.0, 1.0)
    places = low + np.arange(TABLE_SIZE) / (TABLE_SIZE - 1) * (high - low)
    combined = curves[3] if node.type == "CURVE_RGB" else None

    def evaluate(curve: Any, place: float) -> float:
        return mapping.evaluate(curve, mapping.evaluate(combined, place) if combined else place)

    columns = [[evaluate(curve, float(place)) for place in places] for curve in curves[:3]]
    return {
        "table": np.array(columns).T,  # (257, 1 or 3)
        "low": float(low),
        "high": float(high),
        "extrapolate": mapping.extend == "EXTRAPOLATED",
    }


def read_normal_map(builder: Builder, node: Any, groups: Groups, output: str) -> Settings:
    """Normal Map: Blender 5.2 also reads maps whose green points down (DirectX)."""
    return {
        "space": node.space,
        "name": node.uv_map or DEFAULT_UV,
        "invert_green": getattr(node, "convention", "OPENGL") == "DIRECTX",
    }


def read_bump(builder: Builder, node: Any, groups: Groups, output: str) -> Settings:
    """Bump: the height is a program of its own, for it is run beside the point as well."""
    height = builder.build_inner(find_socket(node.inputs, "Height"), groups)
    return {"height": height, "invert": node.invert}


def read_direction(builder: Builder, node: Any, groups: Groups, output: str) -> Settings:
    """Normal: the direction lies in the output socket."""
    return {"direction": np.array(node.outputs["Normal"].default_value[:3], dtype=np.float64)}


def read_material_index(builder: Builder, node: Any, groups: Groups, output: str) -> Settings:
    return {"pass_index": builder.pass_index}


def read_occlusion(builder: Builder, node: Any, groups: Groups, output: str) -> Settings:
    """Ambient Occlusion: a constant distance of 0 stands for the world's own, which is not looked up."""
    distance = find_source(find_socket(node.inputs, "Distance"), groups).socket
    if not distance.is_output and read_number(distance.default_value) == 0:
        builder.place.warn(f"node '{node.name}' (Ambient Occlusion) has no distance set: treated as unoccluded")
    return {name: getattr(node, name) for name in ("samples", "inside", "only_local")}


def is_of_hit(node: Any, output: str) -> bool:
    """True for an output of a Raycast node that is an attribute of what is hit: "Attribute_0", "Attribute_0_Alpha"."""
    return node.type == "MATERIAL_RAYCAST" and output.startswith("Attribute_")


def find_item(node: Any, output: str) -> Any:
    """Return what a Raycast node says of the attribute of an output."""
    shown = output.removesuffix("_Alpha")
    names = [socket.identifier for socket in node.outputs if is_of_hit(node, socket.identifier)]
    return node.sample_attribute_items[[name for name in names if not name.endswith("_Alpha")].index(shown)]


def read_raycast_attribute(builder: Builder, node: Any, groups: Groups, output: str) -> Settings:
    return {"only_local": node.only_local, "name": find_item(node, output).name}


def read_voronoi(builder: Builder, node: Any, groups: Groups, output: str) -> Settings:
    names = ("feature", "distance", "normalize", "voronoi_dimensions")
    return {**{name: getattr(node, name) for name in names}, "whole": versions.has_whole_cells()}


def read_luminaire(builder: Builder, node: Any, groups: Groups, output: str) -> Settings:
    """IES Texture: the tables of its text or file; empty ones where there is nothing to be read."""
    table = Luminaire(*[np.empty(0)] * 3)
    try:
        table = read_ies(read_text(node))
    except (OSError, ValueError) as error:
        builder.place.warn(f"node '{node.name}' (IES Texture): {error}; it shines evenly, as in Cycles")
    return table._asdict()


def read_text(node: Any) -> str:
    """Return the text of a node that names a text or a file."""
    if node.mode == "INTERNAL":
        return "" if node.ies is None else str(node.ies.as_string())
    path = bpy.path.abspath(node.filepath, library=node.id_data.library)
    return Path(path).read_text(encoding="latin-1")


READERS: dict[str, Reader] = {
    **{f"ATTRIBUTE {output}": read_attribute_name for output in ("Vector", "Fac", "Alpha")},
    **{f"OBJECT_PROPERTY {output}": read_property_name for output in ("Vector", "Fac", "Alpha")},
    **{f"VIEW_LAYER_PROPERTY {output}": read_layer_property for output in ("Vector", "Fac", "Alpha")},
    "VERTEX_COLOR Alpha": read_attribute_name,
    "TEX_COORD Object": read_object,
    "TEX_IMAGE": read_image_settings,
    "TEX_ENVIRONMENT": read_environment_settings,
    "TEX_SKY": lambda builder, node, groups, output: read_sky_settings(node),
    "TEX_SKY PREETHAM": lambda builder, node, groups, output: read_daylight_settings(node),
    "TEX_SKY HOSEK_WILKIE": lambda builder, node, groups, output: {
        **read_daylight_settings(node),
        "ground_albedo": node.ground_albedo,
    },
    "VALTORGB": read_ramp,
    **{f"CURVE_{kind}": read_curves for kind in ("RGB", "VEC", "FLOAT")},
    "NORMAL_MAP": read_normal_map,
    "BUMP": read_bump,
    "NORMAL Normal": read_direction,
    "NORMAL Dot": read_direction,
    "TANGENT UV_MAP": lambda builder, node, groups, output: {"name": node.uv_map or DEFAULT_UV},
    # Geometry's tangent runs around z.
    "TANGENT RADIAL": lambda builder, node, groups, output: {"axis": getattr(node, "axis", "Z"), "name": GENERATED},
    "OBJECT_INFO Material Index": read_material_index,
    "NEW_GEOMETRY Pointiness": lambda builder, node, groups, output: {"name": POINTINESS},
    "NEW_GEOMETRY Random Per Island": lambda builder, node, groups, output: {"name": ISLAND},
    "AMBIENT_OCCLUSION": read_occlusion,
    **{f"MATERIAL_RAYCAST {output}": read_raycast_attribute for output in ("Vector", "Fac", "Alpha")},
    "VECTOR_DISPLACEMENT": lambda builder, node, groups, output: {"space": node.space, "name": DEFAULT_UV},
    "TEX_VORONOI": read_voronoi,
    "TEX_IES": read_luminaire,
}
