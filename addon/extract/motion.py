"""What moves while the shutter is open: Blender's frames in between, as Cycles reads them.

The scene is read in the middle of the shutter's time. Then the depsgraph is set to each time at which something has a
step, and only matrices, and the corners and normals of meshes and the strands that deform, are read there. An object
with s Motion Steps has 2^s + 1 of them, so that objects with others share most times. Lights stay where they are, as in
Cycles.

References
----------
Blender, intern/cycles/blender/sync.cpp (sync_motion), blender/object.cpp (object_motion_steps, sync_object),
blender/mesh.cpp (sync_mesh_motion), blender/curves.cpp (sync_hair_motion), blender/camera.cpp (sync_camera_motion),
scene/object.cpp (motion_time).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

import raytracer

from .. import versions
from .camera import find_camera, make_camera_motion, read_camera
from .dicing import Diced, carry_shape
from .meshes import Points, extract_points, has_points, has_shape, open_mesh, read_corners, read_shape
from .shutter import SetFrame, Shutter, list_times, read_curve
from .strand_motion import FollowedStrands, PlacedStrands, StrandTrack, make_curves_motion, read_shapes, start_track
from .strands import Strands
from .velocities import move_points, read_velocity
from .warnings import WarningList

# Cycles takes no more steps of an object.
MOST_STEPS = 129
# Of what the Vector pass tells: the frame before, this one and the next.
STEPS_OF_NEIGHBORS = 3

# What moves; voxels do so as a whole.
MOVING_TYPES = ("MESH", "POINTCLOUD", "VOLUME", "CURVES")
# `session_uid` of the object, its instancer, the kind of data, and which of the instancer's instances it is.
TrackKey = tuple[int, int, str, tuple[int, ...]]


@dataclass
class Track:
    """An instance that may move.

    steps : of its motion; matrices : (4, 4) by time
    deforms : True where its mesh, or its points, may change their shape
    is_diced : True where its mesh is what it was before its subdivision
    clouds : its points by time, where they may
    corners : (triangles, 3) corners of faces, where the mesh has normals of its own there
    velocity : (v, 3) float64, metres per second, of vertices or points, whose shapes do not count then; or None
    strands : of hair that may change its shape, or None
    """

    steps: int
    deforms: bool
    name: str
    is_mesh: bool
    is_diced: bool = False
    corners: NDArray[np.int32] | None = None
    velocity: NDArray[np.float64] | None = None
    matrices: dict[float, NDArray[np.float64]] = field(default_factory=dict)
    shapes: dict[float, tuple[NDArray[Any], NDArray[Any] | None]] = field(default_factory=dict)
    clouds: dict[float, Points | None] = field(default_factory=dict)
    strands: StrandTrack | None = None


@dataclass(frozen=True)
class PlacedPoints:
    """A point cloud: the placement that it is, its points in its own space, and the matrix (4, 4) that places them."""

    row: int
    points: Points
    world_from_object: NDArray[np.float64]


@dataclass
class Tracks:
    """The instances of one extraction that may move.

    steps : of all; None takes those of each object, and leaves out those that shall not be blurred
    keys : of each placement, or None; rows : the placement that each of the scene's instances is
    groups, hair : what the scene's groups of spheres and of curves are
    base, undisplaced : the scene's meshes before they are diced, and before they are displaced; diced : by number
    """

    scene: Any
    frame: int
    steps: int | None = None
    tracks: dict[TrackKey, Track] = field(default_factory=dict)
    keys: list[TrackKey | None] = field(default_factory=list)
    rows: tuple[int, ...] = ()
    groups: tuple[PlacedPoints, ...] = ()
    hair: tuple[PlacedStrands, ...] = ()
    base: tuple[raytracer.Mesh, ...] = ()
    undisplaced: tuple[raytracer.Mesh, ...] = ()
    diced: Mapping[int, Diced] = field(default_factory=dict)
    deforming: set[int] = field(default_factory=set)

    def note(self, instance: Any, source: Any, instancer: Any, mesh: int | None, is_diced: bool = False) -> None:
        """Note an instance; mesh : the number of its mesh among the scene's, or None; is_diced : as in Track."""
        shown = instance.object
        steps = self.steps or count_steps(shown, instancer)
        if not steps or shown.type not in MOVING_TYPES:
            self.keys.append(None)
            return
        key = find_key(instance, source, instancer)
        track = Track(steps, False, source.name, mesh is not None, is_diced)
        may_deform = mesh not in self.deforming and (self.steps is not None or use_deformation(shown, instancer))
        if may_deform and shown.type in ("MESH", "POINTCLOUD"):
            note_shape(track, shown, source, self.scene)
        if mesh is not None and (track.deforms or track.velocity is not None):
            self.deforming.add(mesh)
        self.tracks[key] = track
        self.keys.append(key)

    @property
    def is_blur(self) -> bool:
        """True where the shutter shows motion, False where only the Vector pass tells of it."""
        return self.steps is None

    def note_strands(self, instance: Any, source: Any, instancer: Any, mesh: int | None) -> None:
        """Note strands, which move with the object that they are or grow on, and may change their shape."""
        shown = instance.object
        steps = self.steps or count_steps(shown, instancer)
        key = find_key(instance, source, instancer)
        self.keys.append(key if steps else None)
        if not steps:
            return
        track = self.tracks.setdefault(key, Track(steps, False, source.name, True))
        if track.strands is None and (self.steps is not None or use_deformation(shown, instancer)):
            track.strands = start_track(shown, source.is_deform_modified(self.scene, "RENDER"))

    def list_times(self) -> set[float]:
        """Return all times at which something has a step, but for the middle."""
        return {time for track in self.tracks.values() for time in list_times(track.steps)} - {0.0}

    def list_matrices(self, row: int, middle: NDArray[np.float64]) -> list[NDArray[np.float64]] | None:
        """Return the places of a placement at its steps, None where it does not move; a step at which it is not there
        is as the middle."""
        key = self.keys[row]
        if key is None:
            return None
        track = self.tracks[key]
        matrices = [track.matrices.get(time, middle) for time in list_times(track.steps)]
        return matrices if any((matrix != middle).any() for matrix in matrices) else None

    def follow_hair(self) -> Iterator[FollowedStrands]:
        """Yield what is known of the motion of each group of curves."""
        for number, group in enumerate(self.hair):
            key = self.keys[group.row]
            if key is not None:
                track, matrices = self.tracks[key], self.list_matrices(group.row, group.world_from_object)
                yield FollowedStrands(number, group, track.strands, list_times(track.steps), matrices, track.name)

    def read(self, depsgraph: Any, time: float) -> None:
        """Read matrices and shapes as the depsgraph shows them at a time."""
        strands: dict[tuple[int, int], dict[str, Strands]] = {}  # by object and data, once for all of its instances
        for instance in depsgraph.object_instances:
            shown = instance.object
            if shown.type not in MOVING_TYPES or not (instance.show_self or instance.show_particles):
                continue
            source = instance.instance_object if instance.is_instance else shown
            instancer = instance.parent if instance.is_instance else shown
            track = self.tracks.get(find_key(instance, source, instancer))
            if track is None or time not in list_times(track.steps):
                continue
            matrix = np.array(instance.matrix_world, dtype=np.float64)
            matrix[3] = (0.0, 0.0, 0.0, 1.0)
            if np.isfinite(matrix).all():
                track.matrices[time] = matrix
            if track.strands is not None and track.strands.changes:
                of = source.original.session_uid, shown.data.as_pointer()
                if of not in strands:
                    strands[of] = read_shapes(shown, source, depsgraph.mode == "RENDER")
                track.strands.shapes[time] = strands[of]
            if track.deforms and track.is_mesh:
                with open_mesh(source, shown.data, track.is_diced) as mesh:
                    shape = read_shape(mesh, track.corners)
                if shape is not None:
                    track.shapes[time] = shape
            elif track.deforms and shown.type == "POINTCLOUD":
                track.clouds[time] = extract_points(shown.data, track.name, WarningList())


def note_shape(track: Track, shown: Any, source: Any, scene: Any) -> None:
    """Note what the shape of a mesh or of points does: has velocities, or may change."""
    is_mesh = shown.type == "MESH"
    with open_mesh(source, shown.data, track.is_diced) if is_mesh else nullcontext(shown.data) as data:
        track.velocity = read_velocity(data)
        track.deforms = track.velocity is None and source.is_deform_modified(scene, "RENDER")
        if track.deforms and is_mesh and data.normals_domain == "CORNER":
            track.corners = read_corners(data)


def count_steps(shown: Any, instancer: Any) -> int:
    """Return how many steps the motion of an object has; 0 where it or its instancer shall not be blurred."""
    owners = (shown,) if shown.original == instancer.original else (shown, instancer)
    settings = [getattr(owner, "cycles", None) for owner in owners]
    if not all(getattr(each, "use_motion_blur", True) for each in settings):
        return 0
    steps = max(getattr(each, "motion_steps", 1) for each in settings)
    return min((2 << (max(steps, 1) - 1)) + 1, MOST_STEPS)


def use_deformation(shown: Any, instancer: Any) -> bool:
    """Return whether an object's deformation shall be blurred."""
    return all(getattr(getattr(each, "cycles", None), "use_deform_motion", True) for each in (shown, instancer))


def find_key(instance: Any, source: Any, instancer: Any) -> TrackKey:
    """Return what an instance is called at all times."""
    identity = tuple(instance.persistent_id) if instance.is_instance else ()
    return source.original.session_uid, instancer.original.session_uid, instance.object.type, identity


def read_motion(
    depsgraph: Any,
    tracks: Tracks,
    scene: raytracer.Scene,
    shutter: Shutter,
    set_frame: SetFrame,
    warnings: WarningList,
    seen_from: Any = None,
) -> raytracer.Motion | None:
    """Return how a scene moves, that was read in the middle of the shutter's time; None where nothing does."""
    camera = find_camera(depsgraph, seen_from)
    camera_times, camera = list_times(tracks.steps or count_steps(camera, camera)), camera.original
    cameras = {0.0: scene.camera}
    for time in sorted(tracks.list_times() | set(camera_times) - {0.0}):
        set_frame(*shutter.find_frame(time))
        tracks.read(depsgraph, time)
        if time in camera_times:
            cameras[time] = read_camera(camera.evaluated_get(depsgraph), depsgraph.scene_eval.render, WarningList())
    moving = make_camera_motion([cameras[time] for time in camera_times])
    seconds = shutter.length * depsgraph.scene.render.fps_base / depsgraph.scene.render.fps
    instances, meshes = make_instance_motion(tracks, scene), make_mesh_motion(tracks, scene, seconds, warnings)
    curves = make_curves_motion(tracks.follow_hair(), seconds, warnings)
    spheres = make_spheres_motion(tracks) if tracks.is_blur else []
    warn_points(tracks, warnings)
    if not (moving or instances or meshes or spheres or curves):
        return None
    if tracks.steps is not None:
        return raytracer.Motion(moving, instances, meshes, curves=curves)
    shutter_curve, rolling = read_curve(depsgraph.scene.render), versions.read_rolling_shutter(depsgraph.scene)
    return raytracer.Motion(moving, instances, meshes, spheres, curves, shutter_curve, rolling)


def make_instance_motion(tracks: Tracks, scene: raytracer.Scene) -> list[raytracer.InstanceMotion]:
    """Return the motion of the instances that move; a step at which one is not there is as the middle."""
    by_steps: dict[int, tuple[list[int], list[list[NDArray[np.float64]]]]] = {}
    assert scene.instances is not None
    for number, row in enumerate(tracks.rows):
        key = tracks.keys[row]
        if key is None:
            continue
        track, middle = tracks.tracks[key], scene.instances.world_from_object[number]
        matrices = [track.matrices.get(time, middle) for time in list_times(track.steps)]
        if any((matrix != middle).any() for matrix in matrices):
            numbers, found = by_steps.setdefault(track.steps, ([], []))
            numbers.append(number)
            found.append(matrices)
    return [
        raytracer.InstanceMotion(numbers, np.swapaxes(np.array(found), 0, 1)) for numbers, found in by_steps.values()
    ]


def make_spheres_motion(tracks: Tracks) -> list[raytracer.SpheresMotion]:
    """Return the motion of the point clouds that move."""
    motion = []
    for number, group in enumerate(tracks.groups):
        matrices = tracks.list_matrices(group.row, group.world_from_object)
        if matrices is not None:
            motion.append(raytracer.SpheresMotion(number, group.points.centres, group.points.radii, matrices))
    return motion


def make_mesh_motion(
    tracks: Tracks, scene: raytracer.Scene, seconds: float, warnings: WarningList
) -> list[raytracer.MeshMotion]:
    """Return the motion of meshes that deform, in the seconds that the shutter is open."""
    motion: dict[int, raytracer.MeshMotion] = {}
    assert scene.instances is not None
    for number, row in enumerate(tracks.rows):
        key, index = tracks.keys[row], int(scene.instances.mesh[number])
        if key is None or index in motion:
            continue
        base, plain = tracks.base[index], tracks.undisplaced[index]
        shapes = list_shapes(tracks.tracks[key], base, seconds, warnings)
        if any((shape[0] != base.positions).any() for shape in shapes):
            if index in tracks.diced:
                shapes = [carry_shape(tracks.diced[index], shape) for shape in shapes]
            motion[index] = displace_steps(index, scene.meshes[index], plain, shapes)
    return list(motion.values())


def list_shapes(
    track: Track, base: raytracer.Mesh, seconds: float, warnings: WarningList
) -> list[tuple[NDArray[Any], NDArray[Any] | None]]:
    """Return positions and normals of a mesh at each step; where the number of vertices changes, as in the middle."""
    middle = base.positions, base.normals
    if track.velocity is not None:
        steps = move_points(base.positions, track.velocity, seconds)
        if steps is None:
            warnings.add("velocities of others, or that are not finite: it keeps its shape in motion", track.name)
        return [(step, base.normals) for step in steps or ()]
    shapes = [track.shapes.get(time, middle) for time in list_times(track.steps)] if track.shapes else []
    fitting = [shape if has_shape(shape, middle) else middle for shape in shapes]
    if any(one is not other for one, other in zip(fitting, shapes, strict=True)):
        warnings.add("its number of vertices changes while the shutter is open: it keeps its shape there", track.name)
    return fitting


def displace_steps(
    index: int, mesh: raytracer.Mesh, plain: raytracer.Mesh, shapes: list[tuple[Any, Any]]
) -> raytracer.MeshMotion:
    """Return the motion of a mesh of these shapes, each displaced as the middle is: from `plain` to `mesh`.

    Normals of a displaced mesh stay those of the middle.
    """
    positions = np.array([shape[0] for shape in shapes], dtype=np.float64)
    if mesh is plain:
        normals = None if mesh.normals is None else np.array([shape[1] for shape in shapes], dtype=np.float64)
        return raytracer.MeshMotion(index, positions, normals)
    normals = None if mesh.normals is None else np.array([mesh.normals] * len(shapes))
    return raytracer.MeshMotion(index, positions + (mesh.positions - plain.positions), normals)


def warn_points(tracks: Tracks, warnings: WarningList) -> None:
    """Name point clouds that change their shape, or that the Vector pass would show in motion."""
    for group in tracks.groups:
        key = tracks.keys[group.row]
        if key is None:
            continue
        track = tracks.tracks[key]
        changes = any(not has_points(cloud, group.points) for cloud in track.clouds.values())
        changes |= track.velocity is not None and bool(track.velocity.any())
        if tracks.is_blur and changes:
            warnings.add("motion blur of point clouds that change their shape is not supported", track.name)
        moves = changes or any((matrix != group.world_from_object).any() for matrix in track.matrices.values())
        if not tracks.is_blur and moves:
            warnings.add("the Vector pass of point clouds is not supported: its points stand still", track.name)
