"""Shader nodes to the fields of closures: one reader for each node, listed in `CLOSURE_READERS`.

Stand-ins, each with a warning: a shader that reflects colored light in a way we lack becomes diffuse of its own color;
any other becomes the default grey diffuse. Inputs that have no effect are named (`UNSUPPORTED_INPUTS`). A new
node is one function and one row of the table.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ... import versions
from .hair import read_hair, read_principled_hair
from .node_inputs import LARGEST_IOR, SMALLEST_IOR, NodeInputs

GREY = 0.8  # what Cycles gives an object without a material
# As in Cycles: the largest anisotropy below surfaces.
SHARPEST, SHARPEST_OF_SKIN = 0.99, 0.9


STAND_IN_COLORS = {
    "EEVEE_SPECULAR": "Base Color",
}

# Inputs that change the picture and that we do not honour, by node.
UNSUPPORTED_INPUTS = {
    "BSDF_PRINCIPLED": ("Thin Wall",),
}


Fields = dict[str, Any]


def read_principled(inputs: NodeInputs) -> Fields:
    builder = inputs.builder
    fields = {
        "kind": "principled",
        "color": inputs.color("Base Color"),
        "metallic": inputs.number("Metallic", high=1.0),
        "roughness": inputs.number("Roughness", high=1.0),
        "ior": inputs.limited("IOR", SMALLEST_IOR, LARGEST_IOR),
        "transmission": inputs.number("Transmission Weight", high=1.0),
        "specular": inputs.number("Specular IOR Level"),
        "specular_tint": inputs.color("Specular Tint"),
        # As in Cycles, a constant strength below 0 is none, while one that nodes compute takes light away.
        "emission": builder.scale(inputs.color("Emission Color"), inputs.number("Emission Strength")),
        "alpha": inputs.number("Alpha", high=1.0),
        "normal": inputs.normal(),
        **inputs.facets(),
    }
    if inputs.is_used("Diffuse Roughness"):  # not in Blender 4.2
        fields["diffuse_roughness"] = inputs.number("Diffuse Roughness", high=1.0)
    if inputs.is_used("Anisotropic"):
        fields["anisotropy"] = inputs.number("Anisotropic", high=1.0)
        fields["rotation"] = inputs.number("Anisotropic Rotation", low=-np.inf)
        fields["tangent"] = inputs.tangent("Anisotropic")
    fields |= read_layers(inputs) | read_film(inputs)
    if inputs.is_used("Thin Film Thickness"):
        fields["bare_metal"] = float(not versions.lays_films_on_metals())
    if inputs.is_used("Subsurface Weight"):
        fields["subsurface"] = inputs.number("Subsurface Weight", high=1.0)
        fields |= read_walk(inputs, inputs.node.subsurface_method, "Subsurface ")
    return fields


def read_walk(inputs: NodeInputs, method: str, prefix: str = "") -> Fields:
    """Return how light is scattered below a surface.

    Cycles' ranges (kernel/closure/bssrdf.h): up to 5.1 it knows no scattering backwards, and none sharper than that of
    skin.
    """
    if method == "BURLEY":
        inputs.place.warn(f"node '{inputs.node.name}': Christensen-Burley is not supported, Random Walk is used")
    skin, similar = method == "RANDOM_WALK_SKIN", versions.inverts_by_similarity()
    lowest = -SHARPEST if similar else 0.0
    fields: Fields = {
        "radius": inputs.builder.scale(inputs.color(f"{prefix}Radius"), inputs.number(f"{prefix}Scale")),
        "subsurface_anisotropy": inputs.limited(
            f"{prefix}Anisotropy", lowest, SHARPEST if similar and not skin else SHARPEST_OF_SKIN
        ),
        "skin": float(skin),
        "similar": float(similar and not skin),
    }
    if skin or not prefix:
        fields["subsurface_ior"] = inputs.number(f"{prefix}IOR")
    return fields


def read_subsurface(inputs: NodeInputs) -> Fields:
    fields = {"kind": "subsurface", "color": inputs.color("Color"), "normal": inputs.normal()}
    if inputs.node.falloff != "RANDOM_WALK_SKIN":
        fields["roughness"] = inputs.number("Roughness", high=1.0)
    return fields | read_walk(inputs, inputs.node.falloff)


def read_layers(inputs: NodeInputs) -> Fields:
    """Return the coat and the sheen of a Principled BSDF, where it has any."""
    fields: Fields = {}
    if inputs.is_used("Coat Weight"):
        fields |= {
            "coat_weight": inputs.number("Coat Weight"),
            "coat_roughness": inputs.number("Coat Roughness", high=1.0),
            "coat_ior": inputs.limited("Coat IOR", 1.0, LARGEST_IOR),
            "coat_tint": inputs.color("Coat Tint"),
            "coat_normal": inputs.normal("Coat Normal"),
            "simple_coat": float(versions.has_simple_coats()),
        }
        if fields["coat_normal"] is None and inputs.normal() is not None:
            fields["coat_normal"] = np.zeros(3)  # flat: what bends the base does not bend its coat
    if inputs.is_used("Sheen Weight"):
        fields |= {
            "sheen_weight": inputs.number("Sheen Weight"),
            "sheen_roughness": inputs.number("Sheen Roughness", high=1.0),
            "sheen_tint": inputs.color("Sheen Tint"),
        }
    if fields and inputs.is_used("Emission Strength") and inputs.is_used("Emission Color"):
        inputs.place.warn(f"node '{inputs.node.name}': Coat and Sheen do not dim its emission")
    return fields


def read_film(inputs: NodeInputs) -> Fields:
    """Return the thin film on top, where there is one."""
    if not inputs.is_used("Thin Film Thickness"):  # Glass and Metallic BSDF have none in Blender 4.2
        return {}
    return {
        "film_thickness": inputs.number("Thin Film Thickness"),
        "film_ior": inputs.limited("Thin Film IOR", SMALLEST_IOR, LARGEST_IOR),
    }


def read_diffuse(inputs: NodeInputs) -> Fields:
    fields = {"kind": "diffuse", "color": inputs.color("Color"), "normal": inputs.normal()}
    if inputs.is_used("Roughness"):
        fields["diffuse_roughness"] = inputs.number("Roughness", high=1.0)
        fields["multiscatter"] = float(versions.returns_lost_light())
    return fields


def read_glossy(inputs: NodeInputs) -> Fields:
    fields = {
        "kind": "glossy",
        "color": inputs.color("Color"),
        "roughness": inputs.number("Roughness", high=1.0),
        "normal": inputs.normal(),
        **inputs.facets(),
    }
    return fields | read_anisotropy(inputs, lowest=-1.0)


def read_anisotropy(inputs: NodeInputs, lowest: float = 0.0) -> Fields:
    if not inputs.is_used("Anisotropy"):
        return {}
    return {
        "anisotropy": inputs.number("Anisotropy", lowest, high=1.0),
        "rotation": inputs.number("Rotation", low=-np.inf),
        "tangent": inputs.tangent("Anisotropy"),
    }


def read_metallic(inputs: NodeInputs) -> Fields:
    """Read a metal, by its colors at 0 and 82 degrees or by its index of refraction."""
    fields = {"roughness": inputs.number("Roughness", high=1.0), "normal": inputs.normal(), **inputs.facets()}
    if inputs.node.fresnel_type == "F82":
        fields |= {"kind": "metal", "color": inputs.color("Base Color"), "specular_tint": inputs.color("Edge Tint")}
    else:
        fields |= {"kind": "conductor", "color": inputs.color("IOR"), "extinction": inputs.color("Extinction")}
    return fields | read_anisotropy(inputs) | read_film(inputs)


def read_dielectric(inputs: NodeInputs) -> Fields:
    fields = {
        "kind": "glass" if inputs.node.type == "BSDF_GLASS" else "refraction",
        "color": inputs.color("Color"),
        "roughness": inputs.number("Roughness", high=1.0),
        "ior": inputs.limited("IOR", SMALLEST_IOR, LARGEST_IOR),
        "normal": inputs.normal(),
        **inputs.facets(),
    }
    return fields | read_film(inputs)


def read_translucent(inputs: NodeInputs) -> Fields:
    return {"kind": "translucent", "color": inputs.color("Color"), "normal": inputs.normal()}


def read_sheen(inputs: NodeInputs) -> Fields:
    return {
        "kind": "sheen" if inputs.node.distribution == "MICROFIBER" else "velvet",
        "color": inputs.color("Color"),
        "roughness": inputs.number("Roughness", high=1.0),
        "normal": inputs.normal(),
    }


def read_toon(inputs: NodeInputs) -> Fields:
    return {
        "kind": "toon" if inputs.node.component == "DIFFUSE" else "glossy_toon",
        "color": inputs.color("Color"),
        "size": inputs.number("Size", high=1.0),
        "smooth": inputs.number("Smooth", high=1.0),
        "normal": inputs.normal(),
    }


def read_transparent(inputs: NodeInputs) -> Fields:
    return {"kind": "transparent", "color": inputs.color("Color")}


def read_portal(inputs: NodeInputs) -> Fields:
    """Read a portal: an unlinked position is that of the surface, a direction of 0 goes straight on."""
    return {
        "kind": "portal",
        "color": inputs.color("Color"),
        "position": inputs.vector("Position"),
        "direction": inputs.normal("Direction"),
    }


def read_emission(inputs: NodeInputs) -> Fields:
    return {
        "kind": "emission",
        "color": inputs.builder.scale(inputs.color("Color"), inputs.number("Strength", low=-np.inf)),
    }


def read_holdout(inputs: NodeInputs) -> Fields:
    return {"kind": "holdout"}


def read_stand_in(inputs: NodeInputs) -> Fields:
    node = inputs.node
    inputs.place.warn(f"node '{node.name}' ({node.bl_label}) is not supported, treated as diffuse")
    name = STAND_IN_COLORS.get(node.type)
    return {"kind": "diffuse", "color": inputs.color(name) if name else GREY}


CLOSURE_READERS: dict[str, Callable[[NodeInputs], Fields]] = {
    "BSDF_PRINCIPLED": read_principled,
    "BSDF_DIFFUSE": read_diffuse,
    "BSDF_GLOSSY": read_glossy,
    "BSDF_METALLIC": read_metallic,
    "BSDF_GLASS": read_dielectric,
    "BSDF_REFRACTION": read_dielectric,
    "BSDF_TRANSLUCENT": read_translucent,
    "SUBSURFACE_SCATTERING": read_subsurface,
    "BSDF_SHEEN": read_sheen,
    "BSDF_TOON": read_toon,
    "BSDF_HAIR_PRINCIPLED": read_principled_hair,
    "BSDF_HAIR": read_hair,
    "BSDF_TRANSPARENT": read_transparent,
    "BSDF_RAY_PORTAL": read_portal,
    "EMISSION": read_emission,
    "BACKGROUND": read_emission,
    "HOLDOUT": read_holdout,
}


def warn_unsupported(inputs: NodeInputs) -> None:
    """Name the inputs of a shader that are set and have no effect."""
    node = inputs.node
    ignored = [name for name in UNSUPPORTED_INPUTS.get(node.type, ()) if inputs.is_used(name)]
    if ignored:
        inputs.place.warn(f"node '{node.name}': {', '.join(ignored)} not supported, left out")
