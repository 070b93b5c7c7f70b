"""Instances that share their mesh's tree: a ray enters one as a row in the frame of the mesh.

The true triangles are the rounded world triangles (`geometry.world_corners`); the tree holds the object's. The pad of
a row (`culling`) therefore covers, per axis of object space,

    the rounding of world corners, brought back:   |M^-1| gamma(4) (|M| |v| + |translation|)
    the inverse itself:                            2 ||M^-1 M - I|| per unit of the largest coordinate involved
    the rounding of M^-1 (o - translation):        gamma(5) |M^-1| (|o| + |translation|), plus the error of o
    the direction's error, over the way:           gamma(4) |M^-1| |d| t, t up to the far side of the mesh

Matrices that cannot be inverted well are not placed: their instances are flattened (`can_be_placed`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import largest_column
from raytracer.arrays.types import Booleans, Floats
from raytracer.casting.bvh.culling import CullingRays, largest_component, make_rows
from raytracer.casting.bvh.tree import Frame
from raytracer.casting.geometry import Geometry
from raytracer.predicates.filtered import cross, dot
from raytracer.predicates.rounding import gamma

# ||M^-1 M - I|| beyond this, or scales beyond 2^EXPONENT_RANGE of the world's, make the pad useless.
WORST_RESIDUAL = 2.0**-20
EXPONENT_RANGE = 60
# Matrices inverted together: what they need stays within the cache.
BLOCK = 1 << 13
# Cofactors of columns that are nearly dependent lose more digits than elimination, which leaves a residual of the size
# of gamma(4) |X| |M|. Where theirs is more than so many times that, LAPACK is asked, ten times slower.
WELL_INVERTED = 2.0


@dataclass(frozen=True, eq=False)
class MeshTree:
    """The tree of a mesh that instances share.

    root : node where it begins
    largest : (3,) the largest coordinates of its corners, without their signs
    """

    root: int
    frame: Frame
    largest: Floats


@dataclass(frozen=True, eq=False)
class PlacedTrees:
    """Per instance (i,), rows of instances that are not placed hold no meaning; and per mesh (m,).

    mesh : (i,) int32, the row of the instance's mesh
    first_id : (i,) int64, primitive id of the instance's first triangle
    inverse : (i, 3, 3), translation : (i, 3) float64
    residual : (i,) ||M^-1 M - I||
    corner_error : (i,) float64, object units, the rounding of world corners brought back, largest coordinate
    root : (m,) int32, node where the mesh's tree begins
    centre, exponent : (m, 3), (m,) the mesh's frame
    """

    mesh: NDArray[np.int32]
    first_id: NDArray[np.int64]
    inverse: Floats
    translation: Floats
    residual: Floats
    corner_error: Floats
    root: NDArray[np.int32]
    centre: Floats
    exponent: NDArray[np.int32]


def place_trees(geometry: Geometry, meshes: Sequence[MeshTree], mesh: NDArray[np.int32]) -> PlacedTrees:
    """Return the trees as all instances place them; mesh : (i,) int32, the number of each instance's among `meshes`."""
    matrices = geometry.world_from_object
    inverse, residual = invert(matrices)
    largest, corner_error = np.array([each.largest for each in meshes]), np.empty(len(mesh))
    for start in range(0, len(mesh), BLOCK):
        part = slice(start, start + BLOCK)
        linear, translation = np.abs(matrices[part, :3, :3]), np.abs(matrices[part, :3, 3])
        sizes = _apply(linear, largest.take(mesh[part], axis=0)) + translation
        corner_error[part] = largest_column(_apply(np.abs(inverse[part]), gamma(4) * sizes))
    return PlacedTrees(
        mesh=mesh,
        first_id=geometry.first_id[: len(mesh)],
        inverse=inverse,
        translation=matrices[:, :3, 3],
        residual=residual,
        corner_error=corner_error,
        root=np.array([each.root for each in meshes], np.int32),
        centre=np.array([each.frame.centre for each in meshes]),
        exponent=np.array([each.frame.exponent for each in meshes], np.int32),
    )


def invert(world_from_object: Floats) -> tuple[Floats, Floats]:
    """Inverses (i, 3, 3) of the linear parts and their residuals (i,); singular ones get an infinite residual.

    The residual is measured, by `_measure_residual`, so it bounds what it says however an inverse came about.
    """
    inverse, residual = np.empty((len(world_from_object), 3, 3)), np.empty(len(world_from_object))
    with np.errstate(all="ignore"):
        for start in range(0, len(residual), BLOCK):
            part = slice(start, start + BLOCK)
            linear = np.ascontiguousarray(world_from_object[part, :3, :3].transpose(1, 2, 0))  # (3, 3, k)
            found = _invert_closely(linear)
            residual[part], rounding = _measure_residual(found, linear)
            inverse[part] = found.transpose(2, 0, 1)
            poor = start + np.flatnonzero(~(residual[part] < WELL_INVERTED * rounding))
            if not len(poor):
                continue
            linear = world_from_object[poor, :3, :3]
            singular = ~(np.abs(np.linalg.det(linear)) > 0)
            inverse[poor] = found = np.linalg.inv(np.where(singular[:, None, None], np.eye(3), linear))
            measured, _ = _measure_residual(found.transpose(1, 2, 0), linear.transpose(1, 2, 0))
            residual[poor] = np.where(singular | ~np.isfinite(measured), np.inf, measured)
    return inverse, residual


def _invert_closely(matrix: Floats) -> Floats:
    """Return the inverses of matrices (3, 3, k) by Cramer's rule: the rows b x c, c x a and a x b over a . (b x c).

    a, b, c : the columns, each scaled by the power of two that brings it near one, so that only the angles between
        them matter, and neither the object's size nor the stretch along its axes
    """
    exponent = np.frexp(np.abs(matrix).max(axis=0))[1]
    a, b, c = np.ldexp(matrix, -exponent).transpose(1, 0, 2)
    rows = np.stack([cross(b, c), cross(c, a), cross(a, b)])
    volume = dot(a, rows[0])
    # A determinant that underflows counts as zero, here as in `invert`.
    volume = np.where(np.ldexp(volume, exponent.sum(axis=0)) == 0.0, 0.0, volume)
    return np.asarray(np.ldexp(rows / volume, -exponent[:, None]))


def _measure_residual(inverse: Floats, matrix: Floats) -> tuple[Floats, Floats]:
    """Return (k,) bounds of ||X M - I||, the largest sum of a row, for (3, 3, k) X and M: as computed, and with
    gamma(4) |X| |M| for the rounding of two sums and the difference; and what that rounding is of them."""
    largest, most_rounding = np.zeros((2, matrix.shape[2]))
    for row in range(3):
        found, rounding = np.zeros((2, matrix.shape[2]))
        for column in range(3):
            terms = inverse[row] * matrix[:, column]
            found += np.abs(terms[0] + terms[1] + terms[2] - float(row == column))
            np.abs(terms, out=terms)
            rounding += terms[0] + terms[1] + terms[2]
        rounding *= gamma(4)
        np.maximum(largest, found + rounding, out=largest)
        np.maximum(most_rounding, rounding, out=most_rounding)
    return largest, most_rounding


def can_be_placed(world_from_object: Floats, mesh_exponent: NDArray, world_exponent: int) -> Booleans:
    """(i,) True where an instance's matrix is well enough conditioned for rays to be brought into object space."""
    inverse, residual = invert(world_from_object)
    size = np.frexp(np.abs(inverse).max(axis=(1, 2)))[1] + mesh_exponent - world_exponent
    return np.asarray((residual < WORST_RESIDUAL) & (np.abs(size) < EXPONENT_RANGE))


def place_rays(
    placed: PlacedTrees, frame: Frame, rays: CullingRays, ray: NDArray, instance: NDArray
) -> NDArray[np.float32]:
    """Return the (14, k) rows of rays in the frames of the instances' meshes; t_row is the ray's own."""
    # World frame to world units relative to the instance: exact but for one rounding of each difference.
    origin = np.ldexp(rays.origin[ray], -frame.exponent) + (frame.centre - placed.translation[instance])
    direction = np.ldexp(rays.direction[ray], -frame.exponent)
    mesh, inverse = placed.mesh[instance], placed.inverse[instance]
    local = _apply(inverse, origin)
    slope = _apply(inverse, direction)
    size = np.abs(inverse)
    reach = np.abs(frame.centre) + np.abs(placed.translation[instance]) + np.abs(origin)
    error = _apply(size, np.ldexp(rays.error[ray], -frame.exponent)[:, None] + gamma(8) * reach)
    # The way to the far side of the mesh, in units of t_row.
    middle, exponent = placed.centre[mesh], placed.exponent[mesh][:, None]
    half = np.ldexp(1.0, -exponent)
    extent = largest_component(local - middle) + 2 * half
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        way = extent / largest_component(slope)
        error += gamma(8) * _apply(size, np.abs(direction)) * way
        largest = extent + largest_component(middle) + largest_component(local)
        error += 4 * placed.residual[instance][:, None] * largest + placed.corner_error[instance][:, None]
        return make_rows(
            np.ldexp(local - middle, exponent), np.ldexp(slope, exponent), np.ldexp(error, exponent) + gamma(4) * 2
        )


def _apply(matrix: Floats, vector: Floats) -> Floats:
    """(k, 3, 3) times (k, 3)."""
    columns = matrix * vector[:, None, :]
    return np.add(np.add(columns[:, :, 0], columns[:, :, 1]), columns[:, :, 2])
