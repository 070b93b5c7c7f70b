"""The world: light from every direction that hits nothing, and how surfaces aim at it.

A constant world is sampled around the normal with density cos / pi. One with a program is sampled once so and once
after a map of its own brightness over directions, less the mean, which the first sample takes care of already (MIS
compensation): a sun of one pixel is found as surely as an even sky. Both are weighed by the sum of their densities (the
balance heuristic), which is at least that of the first, so that the estimate is unbiased whatever the map misses.

Where reflected rays find other light than samples do (`integrator.told_apart`), a world with a program is sampled as in
Cycles, after a map of all its brightness alone: what the map misses is for reflected rays to find.

To programs the world is a unit sphere around the camera, seen from inside, in world space: position is the direction,
normal and view point back to the centre, as in Cycles (shader_setup_from_background).

References
----------
E. Veach, "Robust Monte Carlo Methods for Light Transport Simulation", 1997, chapter 9: the balance heuristic.
O. Karlik, M. Sik, P. Vevoda, T. Skrivan, J. Krivanek, "MIS Compensation: Optimizing Sampling Techniques in Multiple
Importance Sampling", 2019.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from raytracer.arrays.types import Floats
from raytracer.arrays.vectors import normalize, to_world
from raytracer.casting.geometry import pack_geometry
from raytracer.lecture import dot
from raytracer.sampling.direction_map import (
    DirectionMap,
    make_direction_map,
    map_density,
    place_equirectangular,
    sample_map,
)
from raytracer.sampling.warps import sample_cosine_hemisphere
from raytracer.scene.camera import Camera
from raytracer.scene.fields import SEEN_BY_ALL
from raytracer.scene.lights import World
from raytracer.scene.programs import Image, Program, Register
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Spheres
from raytracer.shading.evaluate import evaluate, find_needed, list_attributes, list_steps, reads_place
from raytracer.shading.light_path import LightPath
from raytracer.shading.site import Site
from raytracer.shading.site_tables import SiteTables, make_site_tables
from raytracer.surfaces.surface import imagine_surface
from raytracer.surfaces.surface_tables import make_surface_tables

# Unit directions (n, 3) to the world from points with shading normals (n, 3), for uniform numbers (n, 2).
WorldSampler = Callable[[Floats, Floats], Floats]
# Cells of the map along the horizon: as many as the widest image has pixels, within these limits.
SMALLEST_WIDTH, LARGEST_WIDTH = 512, 2048
# Directions evaluated at a time, to bound memory.
DIRECTIONS_AT_ONCE = 1 << 16


@dataclass(frozen=True, eq=False)
class Environment:
    """The world as the integrator takes it.

    color : (3,) float64, or the Register of the program that computes it
    program, needed, tables : of `evaluate.evaluate`, None, () and None for a constant world
    grid : the map that samples follow; None where the world is constant, or even, or nothing stands out
    by_map_alone : True where samples follow the map and nothing else
    is_even : True where it is the same in all directions, though its program may ask how the ray came
    brightest : the mean size of the channels in the brightest direction of the map, 0 without one
    seen_by, max_bounces : as of World
    """

    color: Floats | Register
    program: Program | None = None
    needed: tuple[int, ...] = ()
    tables: SiteTables | None = None
    grid: DirectionMap | None = None
    is_even: bool = True
    by_map_alone: bool = False
    brightest: float = 0.0
    seen_by: int = SEEN_BY_ALL
    max_bounces: int | None = None


def make_environment(
    world: World, camera: Camera | None, resolution: tuple[int, int], by_map_alone: bool = False
) -> Environment:
    """Return the environment of a world.

    resolution : of the full picture, pixels
    by_map_alone : as of Environment, for a world that varies
    """
    if world.program is None or not isinstance(world.color, Register):
        return Environment(world.color, seen_by=world.seen_by)
    program = world.program
    needed = find_needed(program, [world.color])
    tables, even = make_sky_tables(program, camera, resolution), not reads_place(program, needed)
    environment = Environment(world.color, program, needed, tables, is_even=even, seen_by=world.seen_by)
    if even:
        return environment
    environment = replace(environment, by_map_alone=by_map_alone, max_bounces=world.max_bounces)
    grid, brightest = _make_map(environment)
    return replace(environment, grid=grid, brightest=brightest)


def turn_environment(environment: Environment, camera: Camera | None, resolution: tuple[int, int]) -> Environment:
    """Return an environment as programs see it through another camera.

    It is sampled after the map that it has: the estimate is unbiased whatever the map, which costs more to make.
    """
    if environment.program is None:
        return environment
    return replace(environment, tables=make_sky_tables(environment.program, camera, resolution))


def make_sky_tables(program: Program, camera: Camera | None, resolution: tuple[int, int]) -> SiteTables:
    """Return what programs read on the sphere of directions, the camera at its centre."""
    if camera is not None:
        matrix = camera.world_from_camera.copy()
        matrix[:3, 3] = 0.0
        camera = replace(camera, world_from_camera=matrix)
    sphere = Scene(spheres=Spheres(np.zeros((1, 3)), np.ones(1)), camera=camera)
    surface = make_surface_tables(sphere, pack_geometry(sphere), smooth_normals=False, uvs=False)
    return make_site_tables(sphere, surface, list_attributes(program), resolution)


# Radiance


def evaluate_environment(environment: Environment, directions: Floats, path: LightPath | None = None) -> Floats:
    """Return what arrives from directions (n, 3) of any length: (3,) or (n, 3).

    path : how rays came that left into them; None where light is sampled, as in Cycles
    """
    if not isinstance(environment.color, Register):
        return environment.color
    assert environment.program is not None
    assert environment.tables is not None
    site = make_sky_site(environment.tables, normalize(directions), path)
    found = evaluate(environment.program, site, environment.needed)[environment.color]
    return np.nan_to_num(found, nan=0.0, posinf=0.0, neginf=0.0)


def make_sky_site(tables: SiteTables, directions: Floats, path: LightPath | None) -> Site:
    """Return unit directions (n, 3) to the world as programs see them."""
    count = len(directions)
    surface = imagine_surface(directions, directions, -directions, is_front=False, weights=np.zeros((count, 2)))
    return Site(surface, tables, path, np.zeros(count))


# Sampling


def list_world_samplers(environment: Environment) -> list[WorldSampler]:
    """Return the ways in which light from the world is sampled, each once: around the normal, and after the map.

    None at all where samples follow the map alone and it is black.
    """

    def sample_around(normal: Floats, pair: Floats) -> Floats:
        return to_world(sample_cosine_hemisphere(pair), normal)

    def sample_brightness(normal: Floats, pair: Floats) -> Floats:
        assert environment.grid is not None
        return sample_map(environment.grid, pair)

    after_map: list[WorldSampler] = [] if environment.grid is None else [sample_brightness]
    return after_map if environment.by_map_alone else [sample_around, *after_map]


def environment_density(environment: Environment, normal: Floats, directions: Floats) -> Floats:
    """Return the density (n,) per solid angle with which all ways together take unit directions (n, 3): their sum.

    Camera rays, of other lengths, were never scattered: what they get here counts for nothing.
    """
    if environment.by_map_alone:
        return np.zeros(len(directions)) if environment.grid is None else map_density(environment.grid, directions)
    density = np.maximum(dot(normal, directions), 0.0) / np.pi
    return density if environment.grid is None else density + map_density(environment.grid, directions)


def density_everywhere(environment: Environment, directions: Floats) -> Floats:
    """Return what `environment_density` does from points in space, which have no normal: directions are taken evenly
    there, in place of around it."""
    even = 0.0 if environment.by_map_alone else 1.0 / (4.0 * np.pi)
    density = np.full(len(directions), even)
    return density if environment.grid is None else density + map_density(environment.grid, directions)


# The map


def _make_map(environment: Environment) -> tuple[DirectionMap | None, float]:
    """Return the map of an environment's brightness beyond its mean, of all of it where samples follow nothing else;
    and how bright it is where it is brightest.

    A cell's brightness is the mean of its corners', which is exact for an image of as many pixels, linear in between.
    """
    assert environment.program is not None
    steps = [_reduce_images(step) for step in environment.program.steps]
    reduced = replace(environment, program=Program(steps))
    images = [step.settings.get("image") for step in list_steps(reduced.program or Program())]
    widest = max([image.pixels.shape[1] for image in images if isinstance(image, Image)], default=0)
    has_sun = any(step.settings.get("sun_size", 0.0) > 0 for step in list_steps(environment.program))
    width = LARGEST_WIDTH if has_sun else min(max(widest, SMALLEST_WIDTH), LARGEST_WIDTH)
    corners = _evaluate_corners(reduced, width // 2, width)
    corners = np.concatenate([corners, corners[:, :1]], axis=1)
    cells = (corners[1:, 1:] + corners[1:, :-1] + corners[:-1, 1:] + corners[:-1, :-1]) / 4.0
    if has_sun:
        cells = _spread_bright(cells)
    lower = np.sin((np.arange(width // 2 + 1) / (width // 2) - 0.5) * np.pi)
    mean = 0.0 if environment.by_map_alone else np.average(cells.mean(axis=1), weights=np.diff(lower))
    return make_direction_map(np.maximum(cells - mean, 0.0)), float(corners.max())


def _spread_bright(cells: Floats) -> Floats:
    """Return for each cell the brightest of itself and its eight neighbours: the border of a disc runs through cells
    none of whose corners lies in it."""
    padded = np.pad(np.pad(cells, ((1, 1), (0, 0)), mode="edge"), ((0, 0), (1, 1)), mode="wrap")
    rows = np.maximum(np.maximum(padded[:-2], padded[1:-1]), padded[2:])
    return np.maximum(np.maximum(rows[:, :-2], rows[:, 1:-1]), rows[:, 2:])


def _evaluate_corners(environment: Environment, height: int, width: int) -> Floats:
    """Return the mean size of the channels at the corners of a grid, (h + 1, w)."""
    corners = np.empty((height + 1, width))
    rows = max(1, DIRECTIONS_AT_ONCE // width)
    u = np.arange(width) / width
    for first in range(0, height + 1, rows):
        v = np.arange(first, min(first + rows, height + 1)) / height
        directions = place_equirectangular(u, v[:, np.newaxis]).reshape(-1, 3)
        # Its program is told what samples are that a path without bounces takes, where that makes a difference.
        path = LightPath({"depth": np.ones(len(directions))}) if environment.by_map_alone else None
        radiance = np.broadcast_to(evaluate_environment(environment, directions, path), directions.shape)
        corners[first : first + len(v)] = np.abs(radiance).mean(axis=1).reshape(len(v), width)
    return corners


def _reduce_images(step: Any) -> Any:
    """Return a step whose image is no wider than a map, each pixel the mean of those that it stands for."""
    image = step.settings.get("image")
    if not isinstance(image, Image) or image.pixels.shape[1] <= LARGEST_WIDTH:
        return step
    pixels = image.pixels
    for axis in (0, 1):
        count = pixels.shape[axis]
        kept = max(1, -(-count * LARGEST_WIDTH // image.pixels.shape[1]))
        starts = np.arange(kept) * count // kept
        sizes = np.diff(np.append(starts, count)).astype(np.float32)
        sums = np.add.reduceat(pixels, starts, axis=axis, dtype=np.float32)
        pixels = sums / sizes[(slice(None), None, None) if axis == 0 else (None, slice(None), None)]
    if image.pixels.dtype == np.uint8:
        pixels = np.rint(pixels).astype(np.uint8)
    return replace(step, settings={**step.settings, "image": replace(image, pixels=pixels)})
