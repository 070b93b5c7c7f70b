"""Test meshes as (positions (v, 3) float64, triangles (t, 3) int32), and rays aimed at them; NumPy only.

All closed meshes are wound counter-clockwise seen from outside. Random numbers come from a Generator that is passed in.
"""

from __future__ import annotations

import numpy as np


def make_quad(size=1.0):
    """A square of two triangles in z = 0 around the origin; its diagonal runs from corner 0 to corner 2."""
    h = size / 2
    positions = np.array([(-h, -h, 0), (h, -h, 0), (h, h, 0), (-h, h, 0)], dtype=np.float64)
    return positions, np.array([(0, 1, 2), (0, 2, 3)], dtype=np.int32)


def make_cube(half_size=1.0, centre=(0.0, 0.0, 0.0)):
    """A cube of twelve triangles; vertex i has the signs of the bits of i (x lowest)."""
    bits = (np.arange(8)[:, np.newaxis] >> np.arange(3)) & 1
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    triangles = [corner for a, b, c, d in quads for corner in ((a, b, c), (a, c, d))]
    return (2 * bits - 1) * float(half_size) + np.asarray(centre), np.array(triangles, dtype=np.int32)


def make_icosphere(level=3, radius=1.0, centre=(0.0, 0.0, 0.0)):
    """An icosahedron subdivided `level` times: 20 * 4^level triangles (1280 at level 3)."""
    golden = (1 + np.sqrt(5)) / 2
    rows = [(s, t * golden, 0) for t in (1, -1) for s in (-1, 1)]
    positions = np.array(rows + [np.roll(row, 1) for row in rows] + [np.roll(row, 2) for row in rows])
    triangles = _icosahedron_faces(positions)
    for _ in range(level):
        positions, triangles = _subdivide(positions, triangles)
    unit = positions / np.linalg.norm(positions, axis=1, keepdims=True)
    return unit * radius + np.asarray(centre), triangles


def _icosahedron_faces(positions):
    """All triples of vertices at edge length 2 from each other, wound outwards."""
    near = np.isclose(np.linalg.norm(positions[:, np.newaxis] - positions, axis=-1), 2)
    n = len(positions)
    faces = [
        (i, j, k) for i in range(n) for j in range(i) for k in range(j) if near[i, j] and near[j, k] and near[i, k]
    ]
    outward = [np.linalg.det(positions[list(face)]) > 0 for face in faces]
    return np.array([f if out else f[::-1] for f, out in zip(faces, outward, strict=True)], dtype=np.int32)


def _subdivide(positions, triangles):
    """Split each triangle into four at the midpoints of its edges, pushed out to the unit sphere."""
    positions = positions / np.linalg.norm(positions, axis=1, keepdims=True)
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, place = np.unique(edges, axis=0, return_inverse=True)
    ab, bc, ca = (place.reshape(-1, 3) + len(positions)).T
    a, b, c = triangles.T
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    middle = positions[unique].mean(axis=1)
    return np.concatenate([positions, middle]), np.concatenate([np.stack(part, axis=1) for part in parts]).astype(
        np.int32
    )


def make_grid(count=16, size=16.0, height=None):
    """A grid of count x count quads in z = 0 around the origin, or at z = height(x, y)."""
    line = np.linspace(-size / 2, size / 2, count + 1)
    x, y = (axis.ravel() for axis in np.meshgrid(line, line))
    z = np.zeros_like(x) if height is None else height(x, y)
    corner = (np.arange(count)[:, np.newaxis] * (count + 1) + np.arange(count)).ravel()
    a, b, c, d = corner, corner + 1, corner + count + 2, corner + count + 1
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return np.stack([x, y, z], axis=1), triangles.astype(np.int32)


def make_heightfield(count=32, size=2.0):
    """A wavy grid; with count 32 it has 961 interior and 128 boundary vertices."""
    return make_grid(count, size, lambda x, y: 0.2 * np.sin(3 * x) * np.cos(5 * y))


def make_torus(rings=24, sides=16, major=1.0, minor=0.4):
    """A torus around the z axis."""
    ring, side = (np.arange(n) for n in (rings, sides))
    u, v = np.meshgrid(2 * np.pi * ring / rings, 2 * np.pi * side / sides, indexing="ij")
    reach = major + minor * np.cos(v)
    positions = np.stack([reach * np.cos(u), reach * np.sin(u), minor * np.sin(v)], axis=-1).reshape(-1, 3)
    i, j = (axis.ravel() for axis in np.meshgrid(ring, side, indexing="ij"))
    a, b = i * sides + j, (i + 1) % rings * sides + j
    c, d = (i + 1) % rings * sides + (j + 1) % sides, i * sides + (j + 1) % sides
    return positions, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]).astype(np.int32)


def make_needle_lens(aspect=1e7, needles=32, thickness=0.3):
    """A closed lens: a rim of radius 1 fanned to two poles, where most of the rim's vertices lie 1 / aspect apart.

    Triangle i of the upper fan (and needles + 5 + i of the lower one) is a sliver for i < needles; five wide
    triangles close each fan.
    """
    angle = np.concatenate([np.arange(needles + 1) / aspect, 2 * np.pi * np.arange(1, 5) / 5])
    count = len(angle)
    rim = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
    positions = np.concatenate([rim, [(0.0, 0.0, thickness), (0.0, 0.0, -thickness)]])
    this, following = np.arange(count), (np.arange(count) + 1) % count
    upper = np.stack([this, following, np.full(count, count)], axis=1)
    lower = np.stack([following, this, np.full(count, count + 1)], axis=1)
    return positions, np.concatenate([upper, lower]).astype(np.int32)


def make_nested_shells(count=8, half_size=1.0):
    """Cubes inside each other, each half size one ulp larger than the one before; the innermost comes last."""
    sizes = [half_size]
    for _ in range(count - 1):
        sizes.append(np.nextafter(sizes[-1], np.inf))
    return join_meshes([make_cube(size) for size in reversed(sizes)])


def make_soup(generator, count=500, size=1.0):
    """Unconnected random triangles in a box of side 2, each about `size` large."""
    centres = generator.uniform(-1, 1, (count, 1, 3))
    positions = centres + generator.normal(scale=size / 2, size=(count, 3, 3))
    return positions.reshape(-1, 3), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def join_meshes(meshes):
    """Put several meshes into one."""
    first = np.cumsum([0, *(len(positions) for positions, _ in meshes)])
    triangles = [part + np.int32(start) for (_, part), start in zip(meshes, first[:-1], strict=True)]
    return np.concatenate([positions for positions, _ in meshes]), np.concatenate(triangles)


def unique_edges(triangles):
    """(e, 2) vertex indices of every edge, once."""
    return np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)


# Rays ---------------------------------------------------------------------------------------------------------------


def aim(origins, targets):
    """Origins (n, 3) and directions (n, 3) from each origin to its target; a single origin serves all targets."""
    origins, targets = np.broadcast_arrays(np.asarray(origins, dtype=np.float64), targets)
    return origins.copy(), targets - origins


def rays_at_vertices(mesh, origin):
    """One ray from `origin` (3,) to each vertex."""
    return aim(origin, mesh[0])


def rays_at_edges(mesh, origin, generator, count):
    """`count` rays from `origin` to random points of random edges (as near as float64 comes to the edge)."""
    positions, triangles = mesh
    edges = unique_edges(triangles)
    chosen = edges[generator.integers(len(edges), size=count)]
    share = generator.random((count, 1))
    return aim(origin, positions[chosen[:, 0]] * (1 - share) + positions[chosen[:, 1]] * share)


def random_rays(generator, count, size=2.0):
    """`count` rays from points of a box of side 2 size into directions uniform on the sphere."""
    return generator.uniform(-size, size, (count, 3)), generator.normal(size=(count, 3))
