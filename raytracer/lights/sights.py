"""Sights: small light that the camera may see straight, and points on it for camera rays to be aimed at.

Emissive geometry, triangle by triangle (or, where those are not listed, instance by instance), and lights with extent.
A sample of a pixel that meets one of the radiance L and of a pixels' size adds L^2 a to the sum of the squares of a
sweep, however it is blurred: so sights are picked in proportion to that. Sights of one radiance that are larger than
LARGE pixels together are left out: two samples of each pixel meet some of it for certain. Where a large emitter is
hidden but for a small part, that part is left out with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from raytracer.arrays.rows import join_columns, make_zeros
from raytracer.arrays.types import Booleans, Floats, Indices, Integers
from raytracer.arrays.vectors import normalize, to_world
from raytracer.casting.geometry import Kind
from raytracer.casting.rays import Hits
from raytracer.film.aiming import find_camera_points, find_through_lens, measure_blur
from raytracer.lecture import length
from raytracer.lights.area_lights import area_of, unit_axes
from raytracer.lights.emitter_table import Emitters, find_spheres, locate_emitters
from raytracer.lights.emitters import find_picked_materials, pick_emitters, place_on_triangles
from raytracer.lights.glints import describe_light
from raytracer.lights.instanced_emitters import find_materials
from raytracer.lights.light_shapes import divide_rows
from raytracer.sampling.warps import sample_disk
from raytracer.scene.camera import Camera
from raytracer.scene.lights import AreaLight, Light, SunLight

# Pixels of one radiance, of which half may face away: two samples of each miss the other half with e^-16, 1e-7.
LARGE = 16.0
# Steps of radiance that a factor of 2 is divided into.
STEPS_OF_TWO = 2
# Metres at which a sun is aimed at: as far as makes no difference from where on a lens it is seen.
FAR = 2.0**40
# The uniform numbers of a triangle's middle.
MIDDLE = (4.0 / 9.0, 0.5)


@dataclass(frozen=True, eq=False)
class Sights:
    """What camera rays can be aimed at: units of emitters, and after them lights.

    emitters : None where no geometry shines
    lights : that the camera sees
    begin, share : (units,) float64, of each unit its part of the power of all emitters
    cumulative : (units + lights,) float64, running sum of the chances to be picked; ends at 1
    has_sides : True where a ray may go through several sights of one object: the triangles of a mesh
    """

    emitters: Emitters | None
    lights: tuple[Light, ...]
    begin: Floats
    share: Floats
    cumulative: Floats
    has_sides: bool

    def pick(self, choice: Floats) -> tuple[Indices, Floats, Floats]:
        """Return what is picked by uniform numbers (n,), with what chance, and what is left of the numbers (n,)."""
        picked = np.searchsorted(self.cumulative, choice, side="right").clip(max=len(self.cumulative) - 1)
        below = np.append(0.0, self.cumulative)[picked]
        chance = self.cumulative[picked] - below
        return picked, chance, np.clip((choice - below) / chance, 0.0, np.nextafter(1.0, 0.0))


@dataclass(frozen=True, eq=False)
class SightPoints:
    """Points of sights.

    position, normal : (n, 3) float64, world; the normal is a unit vector of either side
    area : (n,) float64, metres^2, one over the density of the points
    instance, primitive : (n,) int32, as in Hits; -1 of lights
    """

    position: Floats
    normal: Floats
    area: Floats
    instance: Integers
    primitive: Integers


def find_sights(
    emitters: Emitters | None,
    hidden: Integers | None,
    lights: Sequence[Light],
    camera: Camera,
    width: int,
    height: int,
) -> Sights | None:
    """Return what a camera may see of small light; None where there is nothing.

    emitters : may be empty
    hidden : (h,) the instances and groups that the camera does not see; None where it sees all
    lights : with extent, that the camera sees
    width, height : of the full picture, pixels
    """
    if emitters is not None and emitters.is_empty:
        emitters = None
    eye = find_eye(camera)
    begin, share, middle, radiance, area = _describe_units(emitters, hidden, eye)
    glints = [describe_light(light) for light in lights]
    middles = [eye + FAR * glint.centre if glint.is_far else glint.centre for glint in glints]
    middle = np.concatenate([middle, np.reshape(middles, (-1, 3))])
    radiance = np.concatenate([radiance, [glint.radiance for glint in glints]])
    area = np.concatenate([area, [_measure_light(light) for light in lights]])
    weight = _weigh(camera, width, height, middle, radiance, area)
    total = float(weight.sum())
    if not 0.0 < total < np.inf:
        return None
    return Sights(emitters, tuple(lights), begin, share, np.cumsum(weight) / total, _has_sides(emitters))


def _has_sides(emitters: Emitters | None) -> bool:
    """True where triangles shine."""
    if emitters is None or emitters.instanced is not None:
        return emitters is not None
    return bool(emitters.tables.geometry.belongs_to_kind(emitters.instance, Kind.TRIANGLE).any())


def find_eye(camera: Camera) -> Floats:
    """Return (3,) where a camera looks from, FAR behind it where its rays are parallel."""
    behind = FAR if camera.projection == "orthographic" else 0.0
    return camera.world_from_camera[:3, 3] + behind * camera.world_from_camera[:3, 2]


def _describe_units(emitters: Emitters | None, hidden: Integers | None, eye: Floats) -> tuple[Floats, ...]:
    """Return begin, share, middle (units, 3), radiance and area (units,) of what emitters are picked by."""
    if emitters is None:
        none = np.zeros(0)
        return none, none, np.zeros((0, 3)), none, none
    begin = np.append(0.0, emitters.cumulative[:-1])
    share = emitters.cumulative - begin
    first = pick_emitters(emitters, np.minimum(begin, np.nextafter(1.0, 0.0)))
    points = _place_emitters(emitters, first, share, np.full((len(first), 2), MIDDLE), eye)
    area = points.area
    if hidden is not None:
        area[np.isin(locate_emitters(emitters, first)[0], hidden)] = 0.0
    radiance = emitters.power_density[find_picked_materials(emitters, first)] * emitters.power
    return begin, share, points.position, radiance, area


def _measure_light(light: Light) -> float:
    """Return the area, metres^2, that a light is seen with from before it."""
    if isinstance(light, AreaLight):
        return float(area_of(light))
    return np.pi * _measure_radius(light) ** 2


def _measure_radius(light: Light) -> float:
    """Return the radius, metres, of the disk that a light is seen as."""
    if isinstance(light, SunLight):
        return FAR * float(np.tan(light.angle / 2.0))
    assert not isinstance(light, AreaLight)
    return float(light.radius)


def _weigh(camera: Camera, width: int, height: int, middle: Floats, radiance: Floats, area: Floats) -> Floats:
    """Return L^2 a (k,) of what may be in the picture, a in pixels; 0 of what is not, or certain to be met."""
    facing = normalize(find_eye(camera) - middle)
    seen = find_through_lens(camera, width, height, middle, facing, None)
    depth = -find_camera_points(camera, middle)[:, 2]
    reach = measure_blur(camera, width, height, np.where(seen.scale > 0, depth, camera.focus_distance))
    reach += np.sqrt(area * seen.scale)
    inside = (seen.x > -reach) & (seen.x < width + reach) & (seen.y > -reach) & (seen.y < height + reach)
    size = np.where(inside, area * seen.scale, 0.0)
    step = np.round(STEPS_OF_TWO * np.log2(np.where(radiance > 0, radiance, 1.0))).astype(np.int64)
    step -= step.min(initial=0)
    size[np.bincount(step, size)[step] > LARGE] = 0.0
    relative = radiance / radiance.max(initial=np.finfo(np.float64).tiny)  # whose squares do not overflow
    return relative * relative * size


def find_other_emitters(sights: Sights, points: SightPoints, hits: Hits) -> Booleans:
    """Return which rays (n,), aimed at points, meet another emitter first: that is seen instead, and aimed at as well.

    hits : the first of each ray
    """
    other = np.zeros(len(points.area), dtype=np.bool_)
    if sights.emitters is not None:
        rows = np.flatnonzero(hits.hit)
        instance, primitive = hits.instance[rows], hits.primitive[rows]
        shines = sights.emitters.power_density[find_materials(sights.emitters.tables, instance, primitive)] > 0
        is_itself = (instance == points.instance[rows]) & (primitive == points.primitive[rows])
        other[rows] = shines & ~is_itself
    return other


def place_sights(sights: Sights, picked: Indices, rest: Floats, pair: Floats, camera: Camera) -> SightPoints:
    """Return points on the sights `picked` (n,).

    rest : (n,) uniform numbers, which of a unit's primitives; pair : (n, 2) uniform numbers, where on it
    """
    eye, units = find_eye(camera), len(sights.begin)
    points = _make_points(len(picked))
    for number in np.unique(picked[picked >= units]):
        rows = np.flatnonzero(picked == number)
        _put(points, rows, _place_light(sights.lights[number - units], pair[rows], eye))
    rows = np.flatnonzero(picked < units)
    if len(rows):
        assert sights.emitters is not None
        begin, share = sights.begin[picked[rows]], sights.share[picked[rows]]
        choice = np.clip(begin + rest[rows] * share, begin, np.nextafter(begin + share, 0.0))
        number = pick_emitters(sights.emitters, choice)
        _put(points, rows, _place_emitters(sights.emitters, number, share, pair[rows], eye))
    return points


def _make_points(count: int) -> SightPoints:
    nothing = np.full((2, count), -1, dtype=np.int32)
    return SightPoints(make_zeros(count), make_zeros(count), np.zeros(count), *nothing)


def _put(points: SightPoints, rows: Indices, some: SightPoints) -> None:
    for item in fields(SightPoints):
        getattr(points, item.name)[rows] = getattr(some, item.name)


def _place_emitters(emitters: Emitters, number: Indices, share: Floats, pair: Floats, eye: Floats) -> SightPoints:
    """Return points on emitters by their numbers (n,), each picked from a unit with a share (n,) of all power."""
    instance, primitive = locate_emitters(emitters, number)
    round_ = emitters.tables.geometry.belongs_to_kind(instance, Kind.SPHERE)
    points = _make_points(len(number))
    flat, spheres = np.flatnonzero(~round_), np.flatnonzero(round_)
    if len(flat):
        placed = place_on_triangles(emitters, number[flat], pair[flat])
        points.position[flat], points.normal[flat] = placed.position, placed.normal
        points.area[flat] = divide_rows(share[flat], placed.density)
    if len(spheres):
        geometry = emitters.tables.geometry
        row = find_spheres(emitters.tables, instance[spheres], primitive[spheres])
        _put(points, spheres, _place_disks(geometry.centres[row], geometry.radii[row], pair[spheres], eye))
    points.instance[:], points.primitive[:] = instance, primitive
    return points


def _place_light(light: Light, pair: Floats, eye: Floats) -> SightPoints:
    """Return points (n,) on a light."""
    count = len(pair)
    if not isinstance(light, AreaLight):
        centre = eye + FAR * light.direction if isinstance(light, SunLight) else light.position
        return _place_disks(np.tile(centre, (count, 1)), np.full(count, _measure_radius(light)), pair, eye)
    u, v, axis = unit_axes(light)
    half = np.array([length(light.axis_u), length(light.axis_v)]) / 2.0
    place = (sample_disk(pair) if light.shape == "ellipse" else 2.0 * pair - 1.0) * half
    position = light.position + place[:, :1] * u + place[:, 1:] * v
    nothing = np.full((2, count), -1, dtype=np.int32)
    return SightPoints(position, np.tile(axis, (count, 1)), np.full(count, float(area_of(light))), *nothing)


def _place_disks(centres: Floats, radii: Floats, pair: Floats, eye: Floats) -> SightPoints:
    """Return points on disks (n,) that face the eye, which balls are seen as from afar."""
    normal = normalize(eye - centres)
    place = sample_disk(pair) * radii[:, np.newaxis]
    flat = join_columns(place[:, 0], place[:, 1], np.zeros(len(radii)))
    nothing = np.full((2, len(radii)), -1, dtype=np.int32)
    return SightPoints(centres + to_world(flat, normal), normal, np.pi * radii * radii, *nothing)
