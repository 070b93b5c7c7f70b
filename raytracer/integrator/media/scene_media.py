"""The media of a scene, as the integrator takes them: values, bounds, and what a camera ray starts inside of.

As in Cycles a path starts inside of an object if a ray from there straight up first meets the object's back: for a
closed mesh whose normals point outward that is where it is inside, and for others it is what Cycles takes for inside.

References
----------
Blender, intern/cycles/kernel/integrator/intersect_volume_stack.h.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from raytracer.arrays.rows import largest_column
from raytracer.arrays.types import Booleans, Floats, Integers, Masks, Vectors
from raytracer.casting.caster import Caster, build
from raytracer.casting.inside import list_closed
from raytracer.casting.layers import iterate_layers
from raytracer.casting.ray_visibility import SceneCaster
from raytracer.casting.rays import Hits, Rays, make_rays
from raytracer.casting.subset_caster import take_part
from raytracer.integrator.paths import Paths
from raytracer.integrator.scene_records import gather_records
from raytracer.media.majorants import Majorants, make_majorants, place_majorants
from raytracer.media.mixtures import Mixture
from raytracer.media.stack import NOTHING, MediaStack, start_outside
from raytracer.media.tracking import SumMedia
from raytracer.scene.fields import SEEN_BY, SEEN_BY_ALL
from raytracer.scene.scene import Scene
from raytracer.shading.media import MediaTable, evaluate_media, make_media_table, sum_media
from raytracer.surfaces.surface import make_surface
from raytracer.surfaces.surface_tables import SurfaceTables

UPWARD = (0.0, 0.0, 1.0)
# A world's volume that varies is looked at, and bounded, so far from the middle of the scene, in half diagonals of the
# box around the scene and the camera; beyond it there is none.
WORLD_REACH = 16.0


@dataclass(frozen=True, eq=False)
class SceneMedia:
    """The media of a scene.

    table : their values
    majorants : bounds of those that vary
    tables : of the scene's surfaces
    caster : of the objects that have media, and their numbers in the scene (objects,)
    closed : (media + 2,) bool, True where the object has an inside: no ray gets away from there without crossing it
    seen_by : (media + 2,) uint8, bits of SEEN_BY, the classes of rays that meet the object; None where all meet all
    middle, reach : (3,) and metres, of the world's volume where that varies
    emits : True where a medium shines
    """

    table: MediaTable
    majorants: Majorants
    tables: SurfaceTables
    caster: Caster | None
    number: Integers
    closed: Booleans
    seen_by: Masks | None
    middle: Floats
    reach: float
    emits: bool

    @property
    def sum_media(self) -> SumMedia:
        """What sums media by number at points."""
        return partial(sum_media, self.table)

    def list_inside(self, stack: MediaStack) -> Integers:
        """Return the numbers (k, d) of all media that paths are in, the world's too; the last of all where none."""
        inside = stack.inside
        if self.table.fills:
            inside = np.column_stack([inside, np.full(len(inside), self.table.world, np.int32)])
        return np.where(inside == NOTHING, self.table.world + 1, inside).astype(np.int32)

    def list_met(self, stack: MediaStack, cast_as: Masks) -> Integers:
        """Return what `list_inside` does, without the media of objects that rays of the classes (k,) do not meet: they
        would never come to the border."""
        inside = self.list_inside(stack)
        if self.seen_by is None:
            return inside
        return np.where(self.seen_by[inside] & cast_as[:, np.newaxis], inside, self.table.world + 1).astype(np.int32)

    def find_varying(self, inside: Integers) -> Booleans:
        """Return (k,) True where any of media (k, d) varies."""
        varies: Booleans = self.table.varies[inside].any(axis=1)
        return varies

    def find_reach(self, inside: Integers, origin: Vectors, end: Floats) -> Floats:
        """Return how far (k,) rays are looked at of lengths `end`: a world that varies ends somewhere."""
        if not self.table.varies[self.table.world]:
            return end
        offset = np.sqrt(((origin - self.middle) ** 2).sum(axis=1))
        return np.minimum(end, offset + self.reach)


def make_scene_media(
    scene: Scene,
    caster: SceneCaster,
    tables: SurfaceTables,
    resolution: tuple[int, int] | None,
    majorants: Majorants | None = None,
) -> SceneMedia:
    """Return the media of a scene that has any.

    resolution : of the full picture, pixels
    majorants : of the same media at another moment; None looks at them
    """
    table = make_media_table(scene, tables, resolution)
    present = np.zeros(scene.instance_count + len(scene.groups), dtype=np.bool_)
    present[table.instance[:-2]] = True
    middle, reach = _measure_scene(scene, table)
    boxes, matrices = _list_boxes(scene, table, middle, reach)
    if majorants is not None:
        majorants = place_majorants(majorants, matrices)
    else:
        even = largest_column(table.constant.extinction)
        majorants = make_majorants(even, table.varies, boxes, matrices, partial(evaluate_media, table))
    closed = np.append(list_closed(scene)[table.instance[:-2]], (False, False))
    seen_by = gather_records(scene, "seen_by", np.int32)[table.instance[:-2]]
    hides = bool((seen_by != SEEN_BY_ALL).any())
    classes = np.append(seen_by, (SEEN_BY_ALL, SEEN_BY_ALL)).astype(np.uint8) if hides else None
    part = build(take_part(scene, present), caster.primitives.precision) if present.any() else None
    number = np.flatnonzero(present).astype(np.int32)
    emits = bool(table.constant.emission.any()) or bool(table.varies.any())
    return SceneMedia(table, majorants, tables, part, number, closed, classes, middle, reach, emits)


def keep_media(media: SceneMedia, present: Booleans) -> SceneMedia | None:
    """Return the media of the objects that are present (instances + groups,) alone, None where they have none.

    Of the world's nothing stays: it is no part of what shadow catchers stand for, as in Cycles.
    """
    if not present[media.number].any():
        return None
    return replace(media, table=replace(media.table, fills=False))


def leave_media(media: SceneMedia | None, paths: Paths, present: Booleans) -> Paths:
    """Return paths that are inside of nothing but objects that are present.

    media : of those objects, None where they have none
    """
    if media is None or paths.media is None:
        return replace(paths, media=None)
    inside = paths.media.inside
    stays = (inside != NOTHING) & present[media.table.instance[inside]]
    return replace(paths, media=MediaStack(paths.media.index, np.where(stays, inside, NOTHING)))


def _measure_scene(scene: Scene, table: MediaTable) -> tuple[Floats, float]:
    """Return the middle (3,) of the scene and its camera, and how far the world's volume reaches, metres."""
    matrices = _list_matrices(scene)
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    low, high = table.bounds[:, 0], table.bounds[:, 1]
    local = np.where(corners[:, np.newaxis], high, low)
    points = [((matrices[:, :3, :3] * local[:, :, np.newaxis]).sum(axis=3) + matrices[:, :3, 3]).reshape(-1, 3)]
    if scene.camera is not None:
        points.append(scene.camera.world_from_camera[np.newaxis, :3, 3])
    found = np.concatenate(points)
    if not len(found):
        return np.zeros(3), WORLD_REACH
    lowest, highest = found.min(axis=0), found.max(axis=0)
    half = 0.5 * float(np.sqrt(((highest - lowest) ** 2).sum()))
    return 0.5 * (lowest + highest), WORLD_REACH * (half if half > 0 else 1.0)


def _list_matrices(scene: Scene) -> Floats:
    """Return the matrices (instances + groups, 4, 4) of all objects."""
    matrices = np.broadcast_to(np.eye(4), (scene.instance_count + len(scene.spheres), 4, 4)).copy()
    if scene.instances is not None:
        matrices[: scene.instance_count] = scene.instances.world_from_object
    return matrices


def _list_boxes(scene: Scene, table: MediaTable, middle: Floats, reach: float) -> tuple[Floats, Floats]:
    """Return the boxes (media + 2, 2, 3) that media are in, and the matrices (media + 2, 4, 4) of their spaces."""
    world = np.stack([middle - reach, middle + reach])
    boxes = np.concatenate([table.bounds[table.instance[:-2]], [world, world]])
    matrices = np.concatenate([_list_matrices(scene)[table.instance[:-2]], [np.eye(4), np.eye(4)]])
    return boxes, matrices


def start_inside(media: SceneMedia, rays: Rays) -> MediaStack:
    """Return what camera rays start inside of, where their range begins: of objects that the camera sees."""
    stack = start_outside(media.table.index, len(rays))
    valid = np.flatnonzero(rays.valid())
    if media.caster is None or not len(valid):
        return stack
    inside = stack.inside.copy()
    origins = rays.origins[valid]
    alike = bool((origins == origins[0]).all())
    found = find_around(media, origins[:1] if alike else origins)
    inside[valid] = found.inside
    stack = MediaStack(stack.index, inside)
    if (rays.t_min[valid] > 0).any():
        inside[valid] = _go_ahead(media, stack.select(valid), rays.select(valid)).inside
    if media.seen_by is not None:
        inside = np.where(media.seen_by[inside] & SEEN_BY["camera"], inside, np.int32(NOTHING))
    return MediaStack(stack.index, inside)


def immerse_paths(media: SceneMedia, paths: Paths, is_baked: bool) -> Paths:
    """Return camera paths with what they start inside of.

    is_baked : True for paths that start at surfaces, outside of all objects
    """
    stack = start_outside(media.table.index, len(paths)) if is_baked else start_inside(media, paths.rays)
    return replace(paths, media=stack)


def find_around(media: SceneMedia, points: Vectors) -> MediaStack:
    """Return what points (n, 3) are inside of: objects whose back a ray straight up meets first."""
    assert media.caster is not None
    count = len(points)
    stack, known = start_outside(media.table.index, count), np.zeros(0, np.int64)
    rays = make_rays(points, UPWARD)
    for layer in iterate_layers(media.caster, points, UPWARD):
        rows = np.flatnonzero(layer.hit)
        hits = _renumber(media, layer.select(rows))
        surface = make_surface(media.tables, rays.select(rows), hits)
        pair = hits.instance.astype(np.int64) * count + rows
        first = ~np.isin(pair, known)
        known = np.concatenate([known, pair])
        rows, surface = rows[first], surface.select(first)
        behind = np.ones(len(rows), np.bool_)
        entered = stack.select(rows).cross(surface.instance, surface.material, behind, ~surface.front)
        inside = stack.inside.copy()
        inside[rows] = entered.inside
        stack = MediaStack(stack.index, inside)
    return stack


def _go_ahead(media: SceneMedia, stack: MediaStack, rays: Rays) -> MediaStack:
    """Return what rays are inside of at the start of their range: they cross what lies before it."""
    assert media.caster is not None
    inside = stack.inside.copy()
    t_max = np.maximum(rays.t_min, 0.0)
    for layer in iterate_layers(media.caster, rays.origins, rays.directions, 0.0, t_max):
        rows = np.flatnonzero(layer.hit)
        surface = make_surface(media.tables, rays.select(rows), _renumber(media, layer.select(rows)))
        crosses = np.ones(len(rows), np.bool_)
        crossed = MediaStack(stack.index, inside[rows]).cross(
            surface.instance, surface.material, surface.front, crosses
        )
        inside[rows] = crossed.inside
    return MediaStack(stack.index, inside)


def _renumber(media: SceneMedia, hits: Hits) -> Hits:
    """Return hits of the objects that have media with the numbers of the whole scene."""
    return replace(hits, instance=media.number[hits.instance])


def sum_even(media: SceneMedia, inside: Integers) -> Mixture:
    """Return the sums of media (k, d) that are the same everywhere."""
    return sum_media(media.table, inside, np.zeros((len(inside), 3)))
