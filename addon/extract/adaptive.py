"""Adaptive subdivision as Blender describes it: what a modifier asks for, what the scene adds, and the polygons.

The mesh before its last modifier is read where Blender hands it out (`GeometrySet.mesh_base`), and nothing of the file
is changed for it. The scene's dicing camera, or else its camera, decides, in the viewport as well: so a view that turns
leaves the mesh as it is.

References
----------
Blender, intern/cycles/blender/util.h (object_subdivision_to_mesh), blender/mesh.cpp (create_subd_mesh) and
subd/osd.cpp (sharpness of creases).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.shading.site_tables import UNDEFORMED
from raytracer.subdivision.cage import Cage, Polygons
from raytracer.subdivision.diced import Base
from raytracer.subdivision.pixel_size import View

from .. import versions
from .camera import read_camera
from .meshes import Geometry, read_array, read_attribute, read_corners
from .shaders.node_settings import GENERATED
from .warnings import WarningList

# What Cycles takes where its add-on is off.
DEFAULTS: dict[str, Any] = {
    "dicing_rate": 1.0,
    "preview_dicing_rate": 8.0,
    "max_subdivisions": 12,
    "offscreen_dicing_scale": 4.0,
    "dicing_camera": None,
}
SMALLEST_PIXELS = 0.1
# Attributes that follow the limit surface as positions do.
PLACES = (GENERATED, UNDEFORMED)
CREASE_SCALE = 10.0  # the sharpness of what is creased wholly, which OpenSubdiv takes for ever
MAP_RULES = {
    "NONE": "none",
    "PRESERVE_CORNERS": "corners",
    "PRESERVE_CORNERS_AND_JUNCTIONS": "junctions",
    "PRESERVE_CORNERS_JUNCTIONS_AND_CONCAVE": "concave",
    "PRESERVE_BOUNDARIES": "boundaries",
    "SMOOTH_ALL": "all",
}


class Dicing(NamedTuple):
    """What a scene says of dicing.

    view : what meshes are diced for; None without a camera that sees
    rate : how much longer edges may be than modifiers ask
    rounds : how often the edges of polygons are halved at most, but for the first time
    is_render : the depsgraph's mode
    """

    view: View | None
    rate: float
    rounds: int
    is_render: bool


@dataclass(frozen=True)
class Adaptive:
    """What a modifier asks for.

    in_pixels : True where `size`, of edges, is in pixels, False in metres of the object
    creases : False where the creases of its mesh do not count
    """

    in_pixels: bool
    size: float
    is_smooth: bool
    keeps_corners: bool
    map_rule: str
    creases: bool = True


@dataclass(frozen=True, eq=False)
class AdaptiveBase:
    """A mesh to be diced: the polygons it is made of, and how fine."""

    base: Base
    adaptive: Adaptive

    def equals(self, other: AdaptiveBase | None) -> bool:
        """True where both say the same of meshes with the same triangles."""
        return (
            other is not None
            and self.adaptive == other.adaptive
            and all(
                np.array_equal(one, another)
                for one, another in zip(self.list_arrays(), other.list_arrays(), strict=True)
            )
        )

    def list_arrays(self) -> tuple[NDArray[Any], ...]:
        """Return all arrays."""
        cage = self.base.cage
        polygons = cage.polygons.vertex, cage.polygons.start, self.base.corners, self.base.flat
        return *polygons, cage.creases, cage.crease_sharpness, cage.vertex_sharpness


def read_dicing(depsgraph: Any, seen_from: Any = None) -> Dicing:
    """Return what a depsgraph's scene says of dicing.

    seen_from : as of `extract_scene`
    """
    scene, is_render = depsgraph.scene, depsgraph.mode == "RENDER"  # the evaluated one lacks what scripts set in Cycles
    cycles = getattr(scene, "cycles", None)
    settings = {name: getattr(cycles, name, value) for name, value in DEFAULTS.items()}
    camera, render = settings["dicing_camera"] or seen_from or scene.camera, scene.render
    view = None
    if camera is not None:
        width, height = (
            max(side * render.resolution_percentage // 100, 1) for side in (render.resolution_x, render.resolution_y)
        )
        evaluated = camera.evaluated_get(depsgraph)
        with suppress(ValueError):  # views that do not look through it go on
            lens = read_camera(evaluated, render, WarningList())
            view = View(lens, width, height, settings["offscreen_dicing_scale"])
    rate = settings["dicing_rate" if is_render else "preview_dicing_rate"]
    return Dicing(view, rate, max(settings["max_subdivisions"] - 1, 0), is_render)


def read_adaptive(source: Any, shown: Any, dicing: Dicing | None, warnings: WarningList) -> Adaptive | None:
    """Return what is asked for an evaluated object's mesh, or None: nothing, or it cannot be had.

    source : the object; shown : as an instance shows it, perhaps with another mesh
    """
    if dicing is None or source.type != "MESH" or source.data != shown.data or shown.data.is_editmode:
        return None
    modifier = versions.find_adaptive(source, dicing.is_render)
    if modifier is None:
        return None
    if not hasattr(modifier, "adaptive_space"):
        warnings.add("adaptive subdivision needs Blender 5.0 or later, the modifier's own levels are used", source.name)
        return None
    in_pixels = modifier.adaptive_space == "PIXEL"
    if in_pixels and dicing.view is None:
        warnings.add("adaptive subdivision has no camera to go by, the modifier's own levels are used", source.name)
        return None
    size = modifier.adaptive_pixel_size if in_pixels else modifier.adaptive_object_edge_length
    return Adaptive(
        in_pixels,
        max(size * dicing.rate, SMALLEST_PIXELS) if in_pixels else size * dicing.rate,
        modifier.subdivision_type == "CATMULL_CLARK",
        modifier.boundary_smooth == "PRESERVE_CORNERS",
        MAP_RULES[modifier.uv_smooth],
        modifier.use_creases,
    )


def attach_base(geometry: Geometry, mesh: Any, adaptive: Adaptive | None) -> Geometry:
    """Return a mesh's Geometry with what it is to be diced from; the same one where it had that already."""
    base = None if adaptive is None else read_base(mesh, geometry, adaptive)
    if geometry.base is None if base is None else base.equals(geometry.base):
        return geometry
    return replace(geometry, base=base)


def read_base(mesh: Any, geometry: Geometry, adaptive: Adaptive) -> AdaptiveBase | None:
    """Return the polygons of a mesh before its subdivision; None where some are left out, being nowhere.

    geometry : the same mesh in triangles
    """
    if geometry.kept is not None:
        return None
    vertex = read_array(mesh.loops, "vertex_index", np.intc).astype(np.intp)
    start = np.append(read_array(mesh.polygons, "loop_start", np.intc), len(vertex)).astype(np.intp)
    count = len(mesh.vertices)
    edges, creases = np.zeros((0, 2), np.intp), np.zeros(0)
    sharpness, found = (
        read_attribute(mesh, name, "value", np.float32) if adaptive.creases else None
        for name in ("crease_vert", "crease_edge")
    )
    if found is not None and found.any():
        ends = read_array(mesh.attributes[".edge_verts"].data, "value", np.intc, 2)
        edges, creases = ends[found > 0].astype(np.intp), CREASE_SCALE * found[found > 0].astype(np.float64)
    of_vertex = np.zeros(count) if sharpness is None else CREASE_SCALE * sharpness.astype(np.float64)
    sharp = read_attribute(mesh, "sharp_face", "value", np.bool_)
    flat = np.zeros(len(start) - 1, np.bool_) if sharp is None else sharp
    cage = Cage(Polygons(vertex, start), count, edges, creases, of_vertex, adaptive.keeps_corners)
    corners = read_corners(mesh).astype(np.intp)
    base = Base(cage, corners, adaptive.is_smooth, flat, adaptive.map_rule, PLACES)
    return AdaptiveBase(base, adaptive)
