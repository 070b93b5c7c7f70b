"""An isotropic half space in closed form: Chandrasekhar's H function, by quadrature."""

from functools import cache

import numpy as np

from raytracer.bsdfs.subsurface import fit_albedo, invert_by_similarity

NODES, WEIGHTS = (values / 2 for values in np.polynomial.legendre.leggauss(200))
NODES = NODES + 0.5


@cache
def solve_h(albedo):
    """Return H at the nodes: 1 / H(m) = sqrt(1 - a) + a / 2 int n H(n) / (m + n) dn, by iteration to rounding."""
    h = np.ones_like(NODES)
    for _ in range(20000):
        last, h = h, 1 / divide_by_h(NODES, albedo, h)
        if np.abs(h - last).max() < 1e-14 * h.max():
            break
    return h


def divide_by_h(cosine, albedo, h):
    sums = (WEIGHTS * NODES * h / (np.reshape(cosine, (-1, 1)) + NODES)).sum(axis=1)
    return np.sqrt(1 - albedo) + albedo / 2 * sums


def invert(color, similar):
    """Return the single scattering albedo of a color, without anisotropy."""
    color = np.array([[color]])
    return float((invert_by_similarity if similar else fit_albedo)(color, np.zeros((1, 1)))[0, 0])


def normal_albedo(color, similar):
    """Return what a half space sends back straight up of even light: 1 - H(1) sqrt(1 - a)."""
    albedo = invert(float(color), similar)
    return 1 - np.sqrt(1 - albedo) / divide_by_h(1.0, albedo, solve_h(albedo))[0]


def diffuse_albedo(color, similar):
    """Return what it sends back of light that enters as through a matte surface: 1 - sqrt(1 - a) 2 int m H."""
    albedo = invert(float(color), similar)
    return 1 - np.sqrt(1 - albedo) * 2 * (WEIGHTS * NODES * solve_h(albedo)).sum()
