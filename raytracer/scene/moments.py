"""The scene at one time of its motion: a scene like any other, in which nothing moves.

The true triangle at a time has corners that are interpolated in float64 as `rigid_motion.interpolate` says, and placed
by an interpolated matrix like any instance's: for these, hits are as exact as for what stands still. Normals are
interpolated likewise, as in Cycles; lights stay where they are.

References
----------
Blender, intern/cycles/kernel/geom/motion_triangle.h, scene/camera.cpp, kernel/camera/camera.h.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from raytracer.arrays.types import Floats
from raytracer.arrays.vectors import transform
from raytracer.scene.camera import Camera
from raytracer.scene.curves import Curves
from raytracer.scene.motion import CameraMotion, CurvesMotion, InstanceMotion, MeshMotion, Motion, SpheresMotion
from raytracer.scene.rigid_motion import find_step, interpolate, interpolate_matrices
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Instances, Mesh, Spheres


def find_moment(scene: Scene, time: float) -> Scene:
    """Return a scene as it is at a time, 0 where the shutter opens to 1 where it closes.

    What does not move is the same record.
    """
    motion = scene.motion
    if motion is None:
        return scene
    camera = scene.camera
    if camera is not None and motion.camera is not None:
        camera = move_camera(camera, motion.camera, time)
    instances = scene.instances
    if instances is not None and motion.instances:
        instances = move_instances(instances, motion.instances, time)
    meshes = list(scene.meshes)
    for part in motion.meshes:
        meshes[part.mesh] = deform_mesh(meshes[part.mesh], part, time)
    spheres = list(scene.spheres)
    for group in motion.spheres:
        spheres[group.group] = move_spheres(spheres[group.group], group, time)
    curves = list(scene.curves)
    for strands in motion.curves:
        curves[strands.group] = move_curves(curves[strands.group], strands, time)
    return replace(
        scene,
        meshes=meshes,
        spheres=spheres,
        curves=curves,
        instances=instances,
        camera=camera,
        motion=None,
        neighbors=None,
    )


def moves_geometry(motion: Motion) -> bool:
    """Return whether more moves than the camera."""
    return bool(motion.instances or motion.meshes or motion.spheres or motion.curves)


def move_camera(camera: Camera, motion: CameraMotion, time: float) -> Camera:
    """Return the camera at a time; the extent of its film, not the focal length, changes linearly, as in Cycles."""
    matrix = interpolate_matrices(motion.world_from_camera[:, None], time)[0]
    focal_length = camera.focal_length
    if motion.extent is not None:
        focal_length /= float(_interpolate_steps(motion.extent, time))
    return replace(camera, world_from_camera=matrix, focal_length=focal_length)


def move_instances(instances: Instances, motion: Sequence[InstanceMotion], time: float) -> Instances:
    """Return the instances at a time."""
    matrices = instances.world_from_object.copy()
    for part in motion:
        matrices[part.instances] = interpolate_matrices(part.world_from_object, time)
    return replace(instances, world_from_object=matrices)


def deform_mesh(mesh: Mesh, motion: MeshMotion, time: float) -> Mesh:
    """Return a mesh at a time."""
    normals = None if motion.normals is None else _interpolate_steps(motion.normals, time)
    return replace(mesh, positions=_interpolate_steps(motion.positions, time), normals=normals)


def move_spheres(spheres: Spheres, motion: SpheresMotion, time: float) -> Spheres:
    """Return a group of spheres at a time; where its object is scaled to nothing, of the smallest radius there is."""
    matrix = interpolate_matrices(motion.world_from_object[:, None], time)[0]
    centres = transform(matrix[:3, :3], motion.centres) + matrix[:3, 3]
    radii = motion.radii * abs(np.linalg.det(matrix[:3, :3])) ** (1 / 3)
    return replace(spheres, centres=centres, radii=np.maximum(radii, np.finfo(np.float64).tiny))


def move_curves(curves: Curves, motion: CurvesMotion, time: float) -> Curves:
    """Return a group of curves at a time."""
    matrix = interpolate_matrices(motion.world_from_object[:, None], time)[0]
    points, radii = motion.points[0], motion.radii[0]
    if len(motion.points) > 1:
        points, radii = _interpolate_steps(motion.points, time), _interpolate_steps(motion.radii, time)
    points = transform(matrix[:3, :3], points) + matrix[:3, 3]
    radii = radii * abs(np.linalg.det(matrix[:3, :3])) ** (1 / 3)
    return replace(curves, points=points, radii=radii, world_from_object=matrix)


def _interpolate_steps(steps: Floats, time: float) -> Floats:
    """Return the arrays (...) of (steps, ...) at a time."""
    step, share = find_step(time, len(steps))
    return interpolate(steps[step], steps[step + 1], share)
