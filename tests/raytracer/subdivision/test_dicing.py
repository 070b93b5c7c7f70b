"""Dicing: no crack, no edge too long, and the bounds that are kept instead."""

from __future__ import annotations

import itertools
from functools import partial

import numpy as np
import pytest

from raytracer import Camera, Instances, Material, Mesh, Scene, build
from raytracer.scene.programs import Program, Register, Step
from raytracer.shading.displacement import Displacement, displace
from raytracer.subdivision.diced import Base, dice_mesh
from raytracer.subdivision.pixel_size import View, is_longer, is_wider
from tests.raytracer.subdivision.shapes import CAGES, GRID, GRID_FACES, make_cage, make_grid, make_prism

MOST = 1 << 20
NEAR = np.array([(1.0, 0, 0, 0.3), (0, 1, 0, 0.2), (0, 0, 1, 1.6), (0, 0, 0, 1)])


def cut_polygons(cage):
    """The corners (t, 3) of polygons cut into fans."""
    start = cage.polygons.start
    return np.array([(a, k, k + 1) for a, b in itertools.pairwise(start) for k in range(a + 1, b - 1)])


def dice_cage(cage, positions, is_long, is_smooth=True, rounds=20, most=MOST, **fields):
    corners = cut_polygons(cage)
    mesh = Mesh(positions, cage.polygons.vertex[corners], **fields)
    base = Base(cage, corners, is_smooth, np.zeros(len(cage.polygons.start) - 1, np.bool_))
    return dice_mesh(mesh, base, is_long, rounds, most)


def count_edges(triangles):
    """All edges (e, 2), lower vertex first, and of how many triangles each is."""
    ends = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    return np.unique(ends, axis=0, return_counts=True)


def measure_edges(mesh):
    edges, _ = count_edges(mesh.triangles)
    return np.linalg.norm(mesh.positions[edges[:, 0]] - mesh.positions[edges[:, 1]], axis=1)


@pytest.mark.parametrize("is_smooth", [True, False])
@pytest.mark.parametrize("name", CAGES)
def test_there_is_no_crack(name, is_smooth):
    """A camera so near that edges are halved unevenly: still all edges but those of the cage's border have as many
    triangles as the cage's edges have polygons, and no two vertices are at one place."""
    cage, values = CAGES[name]
    view = View(Camera(NEAR), 60, 40)
    found = dice_cage(cage, values, partial(is_wider, view, np.eye(4)[np.newaxis], 4.0), is_smooth)
    _, count = count_edges(found.mesh.triangles)
    _, edge = cage.polygons.sides
    border = np.flatnonzero(np.bincount(edge) != 2)
    on_border = set(np.unique(np.bincount(edge)[border]))
    assert set(np.unique(count)) == on_border | {2}
    assert len(np.unique(found.mesh.positions, axis=0)) == len(found.mesh.positions)
    lengths = measure_edges(found.mesh)
    assert lengths.min() < 0.4 * lengths.max()


def test_a_crack_would_be_seen(monkeypatch):
    """Edges that are split by what one triangle beside them is, not by what they are themselves."""

    def split_by_triangle(pairs):
        return pairs, np.arange(len(pairs))

    monkeypatch.setattr("raytracer.subdivision.dicing.unique_pairs", split_by_triangle)
    cage, values = CAGES["cube"]
    found = dice_cage(cage, values, partial(is_longer, 0.5))
    assert (count_edges(found.mesh.triangles)[1] == 1).any()


@pytest.mark.parametrize("size", [0.5, 0.11, 0.05])
@pytest.mark.parametrize("name", CAGES)
def test_no_edge_is_longer_than_asked(name, size):
    cage, values = CAGES[name]
    lengths = measure_edges(dice_cage(cage, values, partial(is_longer, size)).mesh)
    assert lengths.max() <= size
    assert lengths.max() > 0.5 * size


def test_a_plane_seen_straight_is_diced_by_its_pixels():
    """f = 50 mm on 36 mm: a pixel of 360 is 1/500 of the distance; 2 m away, three pixels are 12 mm, and a square of
    1 m needs halves of 1/128: 7.8 mm, with diagonals of 11 mm."""
    faces, places = make_grid(1, 1)
    above = np.eye(4)
    above[:3, 3] = (0.5, 0.5, 2.0)
    view = View(Camera(above), 360, 240)
    found = dice_cage(make_cage(faces, 4), places, partial(is_wider, view, np.eye(4)[np.newaxis], 3.0), is_smooth=False)
    assert len(found.mesh.triangles) == 2 * 128 * 128
    lengths = measure_edges(found.mesh)
    np.testing.assert_allclose(np.unique(lengths.round(12)), (1 / 128, np.sqrt(2) / 128))
    finer = dice_cage(make_cage(faces, 4), places, partial(is_wider, view, np.eye(4)[np.newaxis], 2.0), is_smooth=False)
    assert measure_edges(finer.mesh).max() < 2.0 * np.hypot(2.0, np.sqrt(0.5)) / 500


def test_edges_are_halved_no_more_often_than_asked():
    found = dice_cage(make_cage(GRID_FACES, len(GRID)), GRID, partial(is_longer, 1e-3), is_smooth=False, rounds=3)
    lengths = measure_edges(found.mesh)
    np.testing.assert_allclose(np.unique(lengths.round(12)), (0.5 / 8, np.sqrt(0.5) / 8))


def test_more_triangles_than_allowed_are_none():
    cage, values = CAGES["cube"]
    whole = dice_cage(cage, values, partial(is_longer, 0.1))
    count = len(whole.mesh.triangles)
    assert dice_cage(cage, values, partial(is_longer, 0.1), most=count) is not None
    assert dice_cage(cage, values, partial(is_longer, 0.1), most=count - 1) is None


def test_what_is_fine_enough_stays():
    cage, values = CAGES["prism"]
    assert len(dice_cage(cage, values, partial(is_longer, 9.0)).mesh.triangles) == 2 * len(cage.polygons.vertex)


def test_values_are_carried_along():
    """Corners, vertices, polygons, maps and materials of a flat grid: linear ones stay so, constant ones are kept."""
    cage = make_cage(GRID_FACES, len(GRID))
    corners = cut_polygons(cage)
    places = GRID[cage.polygons.vertex][corners]
    polygon = cage.polygons.face[corners[:, 0]]
    number = np.random.default_rng(2).random(len(GRID_FACES))
    attributes = {
        "place": GRID,
        "corner": places,
        "map": places[:, :, :2],
        "number": np.repeat(number[polygon], 3).reshape(-1, 3, 1),
    }
    flat = partial(is_longer, 0.2)
    for is_smooth in (True, False):
        found = dice_cage(
            cage,
            GRID,
            flat,
            is_smooth,
            attributes=attributes,
            material=polygon,
            uvs=places[:, :, :2],
            normals=GRID * 0 + (0, 0, 1),
        )
        mesh = found.mesh
        inner = (np.abs(mesh.positions[:, :2] - (1.5, 1.0)) < (0.4, 0.1)).all(axis=1)
        limits = mesh.positions if not is_smooth else mesh.attributes["place"]
        np.testing.assert_allclose(mesh.attributes["place"], limits, atol=1e-14)
        at_corners = mesh.attributes["place"][mesh.triangles]
        np.testing.assert_allclose(mesh.attributes["corner"], at_corners, atol=1e-14)
        np.testing.assert_array_equal(mesh.attributes["number"][:, 0, 0], number[found.polygons])
        np.testing.assert_array_equal(mesh.material, found.polygons)
        np.testing.assert_array_equal(mesh.uvs, mesh.attributes["map"])
        np.testing.assert_allclose(mesh.normals, np.broadcast_to((0.0, 0, 1), mesh.normals.shape), atol=1e-14)
        assert inner.any()
        middle = mesh.triangles[inner[mesh.triangles].all(axis=1)]
        np.testing.assert_allclose(
            mesh.attributes["map"][inner[mesh.triangles].all(axis=1)], mesh.positions[middle][..., :2], atol=1e-14
        )


def test_a_displaced_plane_is_the_height_field_within_the_bound_of_its_dice():
    """z = A sin(k x): what is linear over a triangle of edges up to h differs by max |f''| h^2 / 6 at most.

    Every point of a triangle is within h / sqrt(3) of the middle of the smallest circle around it.
    """
    amplitude, k, size = 0.1, 6.0, 0.05
    faces, places = make_grid(2, 2)
    flat = dice_cage(make_cage(faces, len(places)), places, partial(is_longer, size), is_smooth=False).mesh
    steps = [
        Step("NEW_GEOMETRY Position"),
        Step("SEPXYZ", (Register(0, "Position"),)),
        Step("MATH", (Register(1, "X"), k, 0.0), {"operation": "MULTIPLY"}),
        Step("MATH", (Register(2, "Value"), 0.0, 0.0), {"operation": "SINE"}),
        Step("MATH", (Register(3, "Value"), amplitude, 0.0), {"operation": "MULTIPLY"}),
        Step("COMBXYZ", (0.0, 0.0, Register(4, "Value"))),
    ]
    displacement = Displacement(Program(steps), Register(5, "Vector"), True)
    scene = Scene(meshes=[flat], instances=Instances([0], [np.eye(4)]), materials=[Material(())])
    up = np.broadcast_to((0.0, 0.0, 1.0), flat.positions.shape)
    moved = displace(scene, {0: displacement}, up, np.ones(len(flat.triangles), np.bool_))
    generator = np.random.default_rng(0)
    origins = np.append(0.01 + 1.98 * generator.random((4000, 2)), np.ones((4000, 1)), axis=1)
    hits = build(Scene(meshes=[moved])).closest_hit(origins, np.broadcast_to((0.0, 0.0, -1.0), origins.shape))
    error = np.abs(1.0 - hits.distance - amplitude * np.sin(k * origins[:, 0]))
    bound = amplitude * k * k * size * size / 6.0
    assert error.max() <= bound
    assert error.max() > bound / 10.0


def test_numbers_of_polygons_are_kept_to_the_last_bit():
    """Programs make random numbers of them: those of a mean of 49 equal numbers may be others."""
    faces, values = make_prism(49)
    cage = make_cage(faces, len(values))
    number = np.random.default_rng(3).random(len(cage.polygons.start) - 1)
    corners = cut_polygons(cage)
    attributes = {"number": np.repeat(number[cage.polygons.face[corners[:, 0]]], 3).reshape(-1, 3, 1)}
    found = dice_cage(cage, values, partial(is_longer, 0.1), attributes=attributes)
    of_triangles = np.broadcast_to(number[found.polygons, np.newaxis, np.newaxis], (len(found.polygons), 3, 1))
    np.testing.assert_array_equal(found.mesh.attributes["number"], of_triangles)
