"""How much light a single bounce off the facets sends on, and what is added for the bounces after it.

A microfacet lobe follows light to its second facet only to drop it. The share E of light that gets out after one bounce
is computed here, once per process and only for the indices of refraction in use, by quadrature of the lobe itself; the
lobe is then scaled so that what is missing, 1 - E, leaves in the shape of the first bounce, with the color of the
further ones ("Multiscatter GGX" in Blender). Values stand on the grid that Cycles uses (roughness by cosine by index of
refraction, linear in between), so that both renderers interpolate alike.

References
----------
C. Kulla, A. Conty, "Revisiting Physically Based Shading at Imageworks", 2017: the compensation, and the fit of the mean
    Fresnel reflectance.
Blender, intern/cycles/app/cycles_precompute.cpp: the grids.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, wraps

import numpy as np

from raytracer.arrays.types import Floats
from raytracer.arrays.vectors import reflect
from raytracer.bsdfs.distributions import sample_visible_normals, shadowing
from raytracer.bsdfs.fresnel import dielectric_reflectance, refract, schlick_share
from raytracer.lecture import dot

# The sizes of Cycles' grids.
REFLECTION_SIZE, GLASS_SIZE = 32, 16
# Cycles' end points (cycles_precompute.cpp): of roughness, cosine and z, where 0 would divide by 0, and of z, where 1
# is an infinite index of refraction. A table is linear between nodes, so an end moved by 1e-4 moves what is read
# there by at most 1e-4 of a step, below the quadrature's 1e-3.
SMALLEST, LARGEST_INDEX = 1e-4, 0.99
# Nodes of the quadrature over facets (angle around the normal, height) and over the cosine of the view. E is then right
# to 5e-3 where total reflection cuts the integrand off and to 1e-3 elsewhere, which a test checks with far more nodes.
ANGLE_NODES, HEIGHT_NODES, COSINE_NODES = 24, 64, 16
# Pairs of roughness and cosine whose facets are integrated at a time; all at once would take 400 MB.
BLOCK_PAIRS = 16


@lru_cache(maxsize=4)
def _facet_square(angle_nodes: int, height_nodes: int) -> tuple[Floats, Floats]:
    """Return nodes (k, 2) of the unit square of `sample_visible_normals` and their weights (k,), which sum to 1.

    The view lies in the plane y = 0: half the angles do. Heights crowd where the cap ends, v = 1 - (1 - t)^2, since
    there GGX has its long tail.
    """
    angle = (np.arange(angle_nodes) + 0.5) / (2 * angle_nodes)
    nodes, weights = np.polynomial.legendre.leggauss(height_nodes)
    rest = (1.0 - nodes) / 2.0
    pairs = np.stack(np.meshgrid(angle, 1.0 - rest * rest, indexing="ij"), axis=-1).reshape(-1, 2)
    return pairs, np.tile(weights * rest / angle_nodes, angle_nodes)


def _grid(size: int) -> Floats:
    return np.clip(np.linspace(0.0, 1.0, size), SMALLEST, 1.0)


def _facets(roughness: Floats, cosine: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the view (p k, 3), visible facet normals (p k, 3) and alpha (p k,) of p pairs of roughness and cosine."""
    square, _ = _facet_square(ANGLE_NODES, HEIGHT_NODES)
    view = np.stack([np.sqrt(1.0 - cosine**2), np.zeros_like(cosine), cosine], axis=1)
    view, alpha = np.repeat(view, len(square), axis=0), np.repeat(roughness**2, len(square))
    return view, sample_visible_normals(view, alpha, np.tile(square, (len(roughness), 1))), alpha


def _mean(values: Floats) -> Floats:
    """Average over the facets of each pair: (p k,) -> (p,)."""
    weights = _facet_square(ANGLE_NODES, HEIGHT_NODES)[1]
    return (values.reshape(-1, len(weights)) * weights).sum(axis=-1)


def _by_blocks(integrate: Callable[..., Floats]) -> Callable[..., Floats]:
    """Make an integral over p pairs of roughness and cosine run on a cacheful of them at a time."""

    @wraps(integrate)
    def integrate_blocks(roughness: Floats, cosine: Floats, *eta: float) -> Floats:
        blocks = range(0, len(roughness), BLOCK_PAIRS)
        return np.concatenate(
            [integrate(roughness[k : k + BLOCK_PAIRS], cosine[k : k + BLOCK_PAIRS], *eta) for k in blocks]
        )

    return integrate_blocks


def _visible_share(alpha: Floats, cos_out: Floats, cos_in: Floats) -> Floats:
    """G2 / G1: the share of light leaving a facet that the others do not block."""
    shadow_out = shadowing(alpha, cos_out)
    return (1.0 + shadow_out) / (1.0 + shadow_out + shadowing(alpha, cos_in))


@_by_blocks
def integrate_reflection(roughness: Floats, cosine: Floats) -> Floats:
    """Return E (p,) of a lobe that reflects everything, for pairs of roughness and cosine of the view."""
    view, half, alpha = _facets(roughness, cosine)
    height = reflect(view, half)[:, 2]
    share = np.where(height > 0, _visible_share(alpha, view[:, 2], height), 0.0)
    return _mean(share)


@_by_blocks
def integrate_glass(roughness: Floats, cosine: Floats, eta: float) -> Floats:
    """Return E (p,) of clear glass: reflection above plus refraction below the surface."""
    view, half, alpha = _facets(roughness, cosine)
    etas = np.full(len(view), eta)
    reflectance = dielectric_reflectance(np.clip(dot(view, half), 0.0, 1.0), etas)
    above, below = reflect(view, half)[:, 2], refract(view, half, etas)[:, 2]
    reflected = np.where(above > 0, reflectance * _visible_share(alpha, view[:, 2], above), 0.0)
    passed = np.where(below < 0, (1.0 - reflectance) * _visible_share(alpha, view[:, 2], below), 0.0)
    return _mean(reflected + passed)


@_by_blocks
def integrate_schlick_share(roughness: Floats, cosine: Floats, eta: float) -> Floats:
    """Return (p,) how far the mean reflectance of the visible facets has come from F0 to 1.

    Facets that reflect into the surface count as 0, as in Cycles.
    """
    view, half, _ = _facets(roughness, cosine)
    share = schlick_share(np.clip(dot(view, half), 0.0, 1.0), np.full(len(view), eta))
    share = np.where(reflect(view, half)[:, 2] > 0, share, 0.0)
    return _mean(share)


def _pairs(size: int) -> tuple[Floats, Floats]:
    roughness, cosine = np.meshgrid(_grid(size), _grid(size), indexing="ij")
    return roughness.ravel(), cosine.ravel()


def _cosine_nodes() -> tuple[Floats, Floats]:
    """Return nodes and weights (COSINE_NODES,) for 2 integral_0^1 E(c) c dc."""
    nodes, weights = np.polynomial.legendre.leggauss(COSINE_NODES)
    nodes = (nodes + 1.0) / 2.0
    return nodes, weights * nodes


@lru_cache(maxsize=1)
def reflection_tables() -> tuple[Floats, Floats]:
    """Return E (roughness, cosine) and its cosine-weighted mean (roughness,)."""
    table = integrate_reflection(*_pairs(REFLECTION_SIZE)).reshape(REFLECTION_SIZE, REFLECTION_SIZE)
    nodes, weights = _cosine_nodes()
    roughness = np.repeat(_grid(REFLECTION_SIZE), len(nodes))
    values = integrate_reflection(roughness, np.tile(nodes, REFLECTION_SIZE))
    return table, (values.reshape(REFLECTION_SIZE, -1) * weights).sum(axis=-1)


def _eta_of_node(node: int) -> float:
    """Return the index of refraction of a node z: F0 = z^4, most nodes between 1 and 2."""
    z = min(max(node / (GLASS_SIZE - 1), SMALLEST), LARGEST_INDEX)
    return (1.0 + z * z) / (1.0 - z * z)


@lru_cache(maxsize=2 * GLASS_SIZE)
def glass_tables(node: int, inverse: bool) -> tuple[Floats, Floats]:
    """Return E (roughness, cosine) and its mean (roughness,) for one index of refraction, or its inverse."""
    eta = 1.0 / _eta_of_node(node) if inverse else _eta_of_node(node)
    table = integrate_glass(*_pairs(GLASS_SIZE), eta).reshape(GLASS_SIZE, GLASS_SIZE)
    nodes, weights = _cosine_nodes()
    values = integrate_glass(np.repeat(_grid(GLASS_SIZE), len(nodes)), np.tile(nodes, GLASS_SIZE), eta)
    return table, (values.reshape(GLASS_SIZE, -1) * weights).sum(axis=-1)


@lru_cache(maxsize=GLASS_SIZE)
def schlick_table(node: int) -> Floats:
    """Return the mean Fresnel share (roughness, cosine) for one index of refraction."""
    return integrate_schlick_share(*_pairs(GLASS_SIZE), _eta_of_node(node)).reshape(GLASS_SIZE, GLASS_SIZE)


# Reading -------------------------------------------------------------------------------------------------------------


def _split(coordinate: Floats, size: int) -> tuple[np.ndarray, Floats]:
    scaled = np.clip(coordinate, 0.0, 1.0) * (size - 1)
    low = np.minimum(scaled.astype(np.intp), size - 2)
    return low, scaled - low


def _read_row(table: Floats, x: Floats) -> Floats:
    low, part = _split(x, len(table))
    return table[low] * (1.0 - part) + table[low + 1] * part


def read_plane(table: Floats, x: Floats, y: Floats) -> Floats:
    low, part = _split(x, len(table))
    column, share = _split(y, table.shape[1])
    first = table[low, column] * (1.0 - share) + table[low, column + 1] * share
    second = table[low + 1, column] * (1.0 - share) + table[low + 1, column + 1] * share
    return first * (1.0 - part) + second * part


def read_reflection(roughness: Floats, cosine: Floats, eta: Floats | None = None) -> tuple[Floats, Floats]:
    """Return E and its mean, each (m,), of reflecting lobes; the same for all indices of refraction."""
    table, mean = reflection_tables()
    return read_plane(table, roughness, cosine), _read_row(mean, roughness)


def _index_coordinate(eta: Floats) -> Floats:
    return np.sqrt(np.abs((eta - 1.0) / (eta + 1.0)))


def read_glass(roughness: Floats, cosine: Floats, eta: Floats) -> tuple[Floats, Floats]:
    """Return E and its mean, each (m,), of glass; only tables of the indices of refraction that occur are computed."""
    low, part = _split(_index_coordinate(eta), GLASS_SIZE)
    share, mean = np.empty(len(eta)), np.empty(len(eta))
    for node, inverse in set(zip(low.tolist(), (eta < 1.0).tolist(), strict=True)):
        rows = np.flatnonzero((low == node) & ((eta < 1.0) == inverse))
        (e0, m0), (e1, m1) = glass_tables(node, inverse), glass_tables(node + 1, inverse)
        x, y, z = roughness[rows], cosine[rows], part[rows]
        share[rows] = read_plane(e0, x, y) * (1.0 - z) + read_plane(e1, x, y) * z
        mean[rows] = _read_row(m0, x) * (1.0 - z) + _read_row(m1, x) * z
    return share, mean


def read_schlick_share(roughness: Floats, cosine: Floats, eta: Floats) -> Floats:
    """Return the mean Fresnel share (m,) of reflecting dielectric lobes."""
    low, part = _split(_index_coordinate(eta), GLASS_SIZE)
    share = np.empty(len(eta))
    for node in set(low.tolist()):
        rows = np.flatnonzero(low == node)
        x, y, z = roughness[rows], cosine[rows], part[rows]
        share[rows] = read_plane(schlick_table(node), x, y) * (1.0 - z) + read_plane(schlick_table(node + 1), x, y) * z
    return share


def mean_dielectric_reflectance(eta: Floats) -> Floats:
    """Return 2 integral_0^1 F(c, eta) c dc by Kulla and Conty's fit."""
    rising = (eta - 1.0) / (4.08567 + 1.00071 * eta)
    falling = 0.997118 + eta * (0.1014 - eta * (0.965241 + eta * 0.130607))
    return np.where(eta < 1.0, falling, rising)


def compensate(share: Floats, mean: Floats, color: Floats) -> Floats:
    """Return 1 + C (1 - E) / E with C = F Em / (1 - F (1 - Em)): the factor (m, 3) that adds the further bounces.

    share, mean : (m,), E and its mean Em; color : (m, 3), F, the mean reflectance of one bounce
    """
    share, mean = share[:, np.newaxis], mean[:, np.newaxis]
    further = color * mean / (1.0 - color * (1.0 - mean))
    return 1.0 + further * (1.0 - share) / share
