"""Puts a scene together from what the modules of this room read of Blender's depsgraph."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing, nullcontext, suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import raytracer
from raytracer.film.passes import list_aovs

from .. import versions
from ..voxels.process import VoxelReader
from .adaptive import read_dicing
from .camera import extract_camera, find_camera
from .caustics import warn_caustics
from .custom_properties import read_layer_of
from .dicing import dice_meshes
from .displacing import displace_meshes
from .instance_order import Shapes
from .instances import walk_instances
from .kept import Kept
from .left_out import warn_missing, warn_transparent_film, warn_working_space
from .mesh_table import MeshTable
from .motion import STEPS_OF_NEIGHBORS, Tracks, read_motion
from .parts import Context, ObjectKey
from .placing import place_parts
from .shaders.material_table import MaterialTable
from .shaders.trees import hold_trees
from .shutter import SetFrame, is_blurred, opened_shutter, read_shutter, span_neighbors
from .strands import shows_thick
from .warnings import Warning, WarningList
from .world import extract_world


@dataclass(frozen=True)
class Extraction:
    """A scene, and how its numbers lead back to Blender.

    scene : raytracer.Scene
    objects : the object of each instance, numbered as `Hits.instance`: mesh instances, groups of spheres, of curves
    lights : the object of each light
    instancers, light_instancers : `session_uid` of what shows each of these, which may be itself
    polygons : for each mesh of the scene (t,) int32, the Blender polygon of each triangle
    warnings : what could not be honoured
    """

    scene: raytracer.Scene
    objects: tuple[ObjectKey, ...]
    lights: tuple[ObjectKey, ...]
    instancers: tuple[int, ...]
    light_instancers: tuple[int, ...]
    polygons: tuple[NDArray[np.int32], ...]
    warnings: tuple[Warning, ...]


def extract_scene(
    depsgraph: Any,
    passes: Sequence[str] = ("Combined",),
    geometry_only: bool = False,
    space: Any = None,
    kept: Kept | None = None,
    set_frame: SetFrame | None = None,
    needs_camera: bool = True,
    seen_from: Any = None,
) -> Extraction:
    """Return all that a depsgraph shows, in the depsgraph's own mode (render or viewport).

    Parameters
    ----------
    depsgraph : bpy.types.Depsgraph
    passes : the tracer's pass names; UV coordinates are read for the pass "UV" only, and what
        shaders write for those that it is written to
    geometry_only : True leaves out camera, lights, world and materials, for casting rays
    space : bpy.types.SpaceView3D, which may hide objects and has a view of its own, so that no camera is read; None for
        renders

    kept : what the last extraction of this view layer in this mode left, with the `changes` since; afterwards what this
        one leaves. The result is the same without
    set_frame : has the depsgraph show another frame, for motion blur or the pass Vector where they are asked for; None
        leaves both out
    needs_camera : False for bakes, which show surfaces, without a camera too
    seen_from : the object that is looked through in place of the scene's camera, or None

    Raises
    ------
    ValueError
        If the scene has no usable camera and one is needed.
    """
    seen_from = seen_from and seen_from.original  # evaluated ones may not outlive a change of frames
    with read_layer_of(depsgraph), hold_trees():
        if set_frame is None or not (is_blurred(depsgraph) or "Vector" in passes):
            return _extract_scene(depsgraph, passes, geometry_only, space, kept, needs_camera, seen_from)
        return extract_moving(depsgraph, passes, kept, set_frame, seen_from)


def extract_moving(
    depsgraph: Any, passes: Sequence[str], kept: Kept | None, set_frame: SetFrame, seen_from: Any = None
) -> Extraction:
    """Return the scene in the middle of the shutter's time, with its motion; without a shutter, with its motion from
    the frame before to the next."""
    source, blurs = depsgraph.scene, is_blurred(depsgraph)
    shutter = read_shutter(source) if blurs else span_neighbors(source)
    tracks = Tracks(source, shutter.frame, None if blurs else STEPS_OF_NEIGHBORS)
    warnings = WarningList()
    with opened_shutter(shutter, set_frame):
        still = _extract_scene(depsgraph, passes, False, None, kept, True, seen_from, tracks)
        motion = read_motion(depsgraph, tracks, still.scene, shutter, set_frame, warnings, seen_from)
    if blurs and "Vector" in passes:
        warnings.add("the Vector pass is empty with motion blur: the picture has the motion already")
    scene = still.scene
    if motion is not None:
        scene = replace(scene, motion=motion) if blurs else replace(scene, neighbors=motion)
    return replace(still, scene=scene, warnings=(*still.warnings, *warnings.records))


def _extract_scene(
    depsgraph: Any,
    passes: Sequence[str],
    geometry_only: bool,
    space: Any,
    kept: Kept | None,
    needs_camera: bool,
    seen_from: Any,
    tracks: Tracks | None = None,
) -> Extraction:
    """Return what `extract_scene` does, while the view layer's properties can be found.

    tracks : notes what may move; None where nothing shall
    """
    warnings = WarningList()
    scene, view_layer = depsgraph.scene_eval, depsgraph.view_layer_eval
    camera, seen_from = None, find_camera(depsgraph, seen_from)
    if not (geometry_only or space) and (needs_camera or seen_from is not None):
        with nullcontext() if needs_camera else suppress(ValueError):
            camera = extract_camera(scene, warnings, seen_from)
    last = kept or Kept()
    frame = tracks.frame if tracks else scene.frame_current
    materials = None if geometry_only else MaterialTable(warnings, last, frame, list_aovs(passes))
    meshes = MeshTable("UV" in passes, warnings, last)
    warn_missing(depsgraph, warnings)
    if materials is not None:
        warn_working_space(warnings)
        warn_transparent_film(scene, warnings)
    dicing = read_dicing(depsgraph, seen_from) if needs_camera and not geometry_only else None
    with closing(VoxelReader()) as voxels:
        context = Context(
            *(view_layer, meshes, materials, warnings, space, last),
            tracks=tracks,
            is_render=depsgraph.mode == "RENDER",
            thick_strands=shows_thick(scene),
            voxels=voxels,
            dicing=dicing,
            is_bake=not needs_camera,
        )
        placements = walk_instances(depsgraph, context)
    images = materials.images if materials else None
    with_info, shapes = materials is not None and materials.read_object_info, None
    if materials is not None and len(placements.part) > 1:
        extents = np.array([geometry.extent for geometry in meshes.geometries]).reshape(-1, 3)
        shapes = Shapes(meshes.records, extents, materials.records)
    placed = place_parts(placements, warnings, with_info, shapes)
    if tracks is not None:
        tracks.rows, tracks.groups, tracks.hair = placed.rows, placed.groups, placed.hair
        tracks.base = tuple(meshes.records)
    records, diced = meshes.records, {}
    bases = [geometry.base for geometry in meshes.geometries]
    if dicing is not None and any(bases):
        diced = dice_meshes(records, bases, placed.instances, dicing, last.diced, warnings)
        records = [diced[number].found.mesh if number in diced else mesh for number, mesh in enumerate(records)]
    last.diced = list(diced.values())
    if tracks is not None:
        tracks.undisplaced, tracks.diced = tuple(records), diced
    if materials is not None and materials.displacements:
        records, displaced = displace_meshes(records, placed.instances, materials.displacements, last.displaced)
        last.displaced = displaced
    world = None
    if view_layer.use_sky and not geometry_only:
        world = extract_world(versions.find_world(scene, view_layer), warnings, images, list_aovs(passes))
    if kept is not None and materials is not None:
        kept.replace(context.entries, meshes.finish(), materials)
    record = raytracer.Scene(
        meshes=records,
        spheres=placed.spheres,
        curves=placed.curves,
        instances=placed.instances,
        materials=materials.records if materials else (),
        lights=placed.lights,
        world=world,
        camera=camera,
        name=scene.name,
    )
    if not geometry_only:
        warned = versions.find_world(scene, view_layer)
        warn_caustics(record, placed.objects, placed.light_objects, placements.parts, warned, warnings)
    polygons = tuple(
        diced[number].found.polygons.astype(np.int32) if number in diced else geometry.polygons
        for number, geometry in enumerate(meshes.geometries)
    )
    shown = placed.objects, placed.light_objects, placed.instancers, placed.light_instancers
    return Extraction(record, *shown, polygons, warnings.records)
