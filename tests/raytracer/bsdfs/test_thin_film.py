"""Thin films against Airy's closed sum, wavelength by wavelength, in complex amplitudes."""

from dataclasses import replace

import numpy as np
import pytest

from raytracer.bsdfs import microfacet
from raytracer.bsdfs.fresnel import (
    CONDUCTOR,
    DIELECTRIC,
    METAL,
    conductor_reflectance,
    dielectric_reflectance,
    metal_coefficient,
    normal_reflectance,
)
from raytracer.bsdfs.thin_film import (
    Film,
    estimate_index,
    film_reflectance,
    interfere,
    read_sensitivity,
    tint_reflectance,
)
from raytracer.scene.materials import Closure
from raytracer.textures.color_matching import RGB_FROM_XYZ, SHORTEST, STEP, read_color_matching
from tests.forbidding import forbid
from tests.raytracer.bsdfs.test_bsdf import shade, view

COSINES = np.linspace(0.02, 1.0, 23)
THICKNESSES = (30.0, 110.0, 300.0, 550.0, 900.0, 2500.0)
GLASS, SILVER, COPPER = 1.5, 0.15 + 3.3j, 0.6 + 2.6j


def integrate_airy(cosine, thickness, ior, substrate):
    """Return (3,) |r|^2, r = (r12 + r23 e) / (1 + r12 r23 e), e = exp(2 pi i D / w), seen by the observer."""
    rows = SHORTEST + STEP * np.arange(81)
    wavelengths = np.linspace(380.0, 780.0, 8001)
    weights = np.stack([np.interp(wavelengths, rows, column) for column in read_color_matching().T], axis=1)
    weights = weights @ RGB_FROM_XYZ.T
    below = np.sqrt(1 - (1 - cosine**2) / ior**2 + 0j)
    deeper = np.sqrt(1 - (1 - cosine**2) / substrate**2 + 0j)
    delay = np.exp(4j * np.pi * ior * thickness * below / wavelengths)
    total = 0.0
    for p in (False, True):

        def amplitude(n, c, m, d, p=p):
            return (m * c - n * d) / (m * c + n * d) if p else (n * c - m * d) / (n * c + m * d)

        upper, lower = amplitude(1.0, cosine, ior, below), amplitude(ior, below, substrate, deeper)
        total = total + np.abs((upper + lower * delay) / (1 + upper * lower * delay)) ** 2 / 2
    return (total[:, None] * weights).sum(axis=0) / weights.sum(axis=0)


def cut_off(cosine, ior, substrate):
    """Return a bound on the terms that are left out, 2 sum_{m > 3} |Rs - T| r^m, of either polarization."""
    below = np.sqrt(max(1 - (1 - cosine**2) / ior**2, 0.0))
    deeper = np.sqrt(1 - (1 - cosine**2) / substrate**2 + 0j)
    bounds = []
    for p in (False, True):
        upper = (
            (ior * cosine - below) / (ior * cosine + below) if p else (cosine - ior * below) / (cosine + ior * below)
        )
        m = substrate / ior
        lower = (m * below - deeper) / (m * below + deeper) if p else (below - m * deeper) / (below + m * deeper)
        r12, r23 = upper**2, abs(lower) ** 2
        root, through = np.sqrt(r12 * r23), 1 - r12
        bounds.append(2 * abs(through**2 * r23 / (1 - r12 * r23) - through) * root**4 / (1 - root))
    return sum(bounds) / 2


@pytest.mark.parametrize("substrate", [1.0, 1.2, GLASS, SILVER, COPPER])
@pytest.mark.parametrize("ior", [1.05, 1.33, 2.0])
def test_a_film_reflects_what_airys_sum_gives_for_all_wavelengths_together(ior, substrate):
    # The table is linear over 2 nm of path difference: 1.3e-4 of a cosine that counts 2 r at most, three times.
    for thickness in THICKNESSES:
        film = Film(np.full(len(COSINES), thickness), np.full(len(COSINES), ior))
        found = interfere(COSINES, film, np.full((len(COSINES), 1), complex(substrate)))
        for cosine, color in zip(COSINES, found, strict=True):
            expected = np.clip(integrate_airy(cosine, thickness, ior, substrate), 0.0, 1.0)
            np.testing.assert_allclose(color, expected, atol=1e-3 + cut_off(cosine, ior, substrate))


def test_a_film_of_the_index_of_what_is_under_it_or_around_it_is_not_seen():
    count = np.ones(len(COSINES))
    for kind, f0, f82 in ((DIELECTRIC, normal_reflectance(np.array(GLASS)), 0.0), (CONDUCTOR, 0.15, 3.3)):
        described = (np.full((len(COSINES), 3), f0), np.full((len(COSINES), 3), f82), GLASS * count)
        plain = dielectric_reflectance(COSINES, GLASS * count)
        if kind == CONDUCTOR:
            plain = conductor_reflectance(COSINES, np.array(0.15), np.array(3.3))
        around = film_reflectance(kind, COSINES, Film(400.0 * count, count), *described)
        np.testing.assert_allclose(around, np.repeat(plain[:, None], 3, axis=1), atol=1e-12)
    glass = Film(400.0 * count, GLASS * count)
    alike = interfere(COSINES, glass, np.full((len(COSINES), 1), GLASS + 0j))
    np.testing.assert_allclose(alike[:, 0], dielectric_reflectance(COSINES, GLASS * count), atol=1e-12)


def test_total_reflection_is_that_without_a_film():
    """From glass to air, the film has the index 0.8 of the glass: at one angle light is turned back below it, at
    another above it."""
    cosine = np.array([0.1, 0.7, 0.99])
    found = interfere(cosine, Film(np.full(3, 300.0), np.full(3, 0.8)), np.full((3, 1), 1.0 / GLASS + 0j))
    np.testing.assert_allclose(found[:2], 1.0, atol=1e-12)
    assert (found[2] < 0.2).all()


def test_the_index_of_a_metal_reflects_its_color():
    color = np.array([[0.95, 0.6, 0.3]])
    index = estimate_index(color, np.array([[0.9, 0.5, 0.2]]))
    np.testing.assert_allclose(conductor_reflectance(np.array(1.0), index.real, index.imag), color, atol=1e-12)


def test_a_metal_under_a_film_that_is_not_seen_is_its_own_curve():
    """With a film of the index around it, what is left is the metal's curve, of the color of its index."""
    color = np.full((len(COSINES), 3), (0.95, 0.6, 0.3))
    coefficient = metal_coefficient(color, np.full_like(color, 0.9))
    film = Film(np.full(len(COSINES), 400.0), np.ones(len(COSINES)))
    found = film_reflectance(METAL, COSINES, film, color, coefficient, np.ones(len(COSINES)))
    np.testing.assert_allclose(found, microfacet.metal_reflectance(COSINES[:, None], color, coefficient), atol=1e-12)


def test_a_tint_scales_what_a_film_reflects_at_normal_incidence_and_leaves_total_reflection():
    own = np.array([[0.04]])
    np.testing.assert_allclose(tint_reflectance(np.full((1, 3), 0.04), 0.5 * own, own), 0.02)
    np.testing.assert_allclose(tint_reflectance(np.ones((1, 3)), 0.5 * own, own), 1.0)


def test_nothing_interferes_at_the_end_of_the_table():
    assert np.abs(read_sensitivity(np.array([3e4, 1e9]))).max() < 1e-3
    np.testing.assert_allclose(read_sensitivity(np.zeros(1)), np.ones((1, 3)), atol=1e-12)


CLOSURES = {
    "principled": Closure("principled", roughness=0.0, color=0.0),
    "metallic": Closure("principled", roughness=0.0, metallic=1.0, color=(0.9, 0.6, 0.3)),
    "transmission": Closure("principled", roughness=0.0, transmission=1.0, color=1.0),
    "glass": Closure("glass", roughness=0.0, color=1.0),
    "metal": Closure("metal", roughness=0.0, color=(0.9, 0.6, 0.3)),
    "conductor": Closure("conductor", roughness=0.0, color=0.15, extinction=3.3),
}


def sum_fresnel(lobes):
    """Return what is reflected and transmitted of light at one angle."""
    reflected, transmitted = microfacet.evaluate_fresnel(lobes, np.array([0.6]))
    return reflected if transmitted is None else reflected + transmitted


@pytest.mark.parametrize("name", CLOSURES)
def test_closures_send_on_at_most_what_they_get(name):
    """And films of 0 nm are none."""
    closure = CLOSURES[name]
    (plain, *_), (none, *_), (covered, *_) = (
        shade(replace(closure, film_thickness=thickness), view(0.6)).lobes for thickness in (0.0, 0.1, 400.0)
    )
    bare, unseen, coated = (sum_fresnel(lobes) for lobes in (plain, none, covered))
    np.testing.assert_array_equal(unseen, bare)
    assert (coated <= 1.0 + 1e-12).all()
    if name in ("glass", "transmission"):
        np.testing.assert_allclose(coated, 1.0, atol=1e-12)
    else:
        assert not np.allclose(coated, bare, atol=1e-3)


def test_older_blenders_leave_films_off_metals():
    bare = replace(CLOSURES["metallic"], film_thickness=400.0, bare_metal=1.0)
    assert shade(bare, view(0.6)).lobes[0].film is None


def test_without_films_nothing_interferes(monkeypatch):
    forbid(monkeypatch, "film_reflectance", "read_sensitivity")
    for closure in CLOSURES.values():
        assert all(lobes.film is None for lobes in shade(closure, view(0.6)).lobes)
