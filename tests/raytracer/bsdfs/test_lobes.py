"""Diffuse shapes and stretched or Beckmann lobes: reciprocity, energy, closed forms; absent layers cost nothing."""

from dataclasses import replace

import numpy as np
import pytest

import raytracer.bsdfs.sheen_table as sheen_table
from raytracer.bsdfs import principled
from raytracer.bsdfs.bsdf import lobe_probabilities
from raytracer.bsdfs.bsdf_samples import sample_bsdf
from raytracer.bsdfs.closures import Closures, TiltedDiffuse
from raytracer.bsdfs.diffuse import Toon, Velvet, make_rough_matte, make_sheen
from raytracer.bsdfs.distributions import (
    beckmann_density,
    beckmann_shadowing,
    make_stretch,
    rotate,
    sample_beckmann_normals,
)
from raytracer.bsdfs.fresnel import conductor_reflectance, metal_mean, metal_slope
from raytracer.bsdfs.lobes import Grain, stretch_grain
from raytracer.bsdfs.microfacet import evaluate_microfacets, sample_microfacets
from raytracer.bsdfs.terminator import evaluate_tilted
from raytracer.scene.materials import DISTRIBUTIONS, Closure
from tests.raytracer.bsdfs.test_bsdf import integrate_lobes, shade, sphere_quadrature, view

UP = np.array([[0.0, 0.0, 1.0]])


def hemisphere():
    directions, weights = sphere_quadrature()
    upper = directions[:, 2] > 0
    return directions[upper], weights[upper]


def random_directions(count, seed):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    vectors[:, 2] = np.abs(vectors[:, 2]) + 0.05
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def repeat(values, count):
    return np.repeat(np.atleast_2d(values), count, axis=0)


SHAPES = {
    "matte": lambda n, o, r: make_rough_matte(n, o, r, np.ones_like(n), np.ones_like(r)),
    "matte once": lambda n, o, r: make_rough_matte(n, o, r, np.ones_like(n), np.zeros_like(r)),
    "sheen": lambda n, o, r: make_sheen(n, o, r)[0],
    "velvet": Velvet,
    "toon": lambda n, o, r: Toon(n, n, r, 0.0 * r),
}


def integrate_shape(name, roughness, cosine):
    directions, weights = hemisphere()
    count = len(directions)
    shape = SHAPES[name](repeat(UP, count), view(cosine, count), np.full(count, roughness))
    return float((shape.evaluate(directions)[:, 0] * weights).sum())


@pytest.mark.parametrize("name", ["matte", "matte once", "velvet"])
def test_shapes_are_reciprocal(name):
    a, b = random_directions(500, 1), random_directions(500, 2)
    roughness = np.linspace(0.05, 1.0, 500)
    normal = repeat(UP, 500)
    there = SHAPES[name](normal, a, roughness).evaluate(b) / b[:, 2:3]
    back = SHAPES[name](normal, b, roughness).evaluate(a) / a[:, 2:3]
    np.testing.assert_allclose(there, back, rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize("cosine", [0.95, 0.5, 0.1])
@pytest.mark.parametrize("roughness", [0.0, 0.4, 1.0])
def test_white_matte_sends_on_all_light(roughness, cosine):
    """Fujii's mean albedo is a fit (5.6 for 2 pi - 3 G): a thousandth of the light is missing or too much."""
    assert integrate_shape("matte", roughness, cosine) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("roughness", [0.1, 0.5, 1.0])
def test_matte_without_roughness_or_further_bounces_is_less(roughness):
    assert integrate_shape("matte once", roughness, 0.5) < integrate_shape("matte once", 0.0, 0.5)
    directions = random_directions(50, 3)
    plain = SHAPES["matte"](repeat(UP, 50), directions[::-1], np.zeros(50)).evaluate(directions)
    np.testing.assert_allclose(plain, np.repeat(directions[:, 2:3] / np.pi, 3, axis=1), rtol=1e-14)


@pytest.mark.parametrize("cosine", [0.9, 0.3])
@pytest.mark.parametrize("roughness", [0.3, 0.7, 1.0])
def test_sheen_is_a_density(roughness, cosine):
    """A linear map that keeps z moves the cosine lobe within the hemisphere: its integral stays 1."""
    assert integrate_shape("sheen", roughness, cosine) == pytest.approx(1.0, abs=1e-6)


def test_sheen_is_brighter_at_grazing_and_its_table_is_packed():
    _, albedo = make_sheen(repeat(UP, 2), np.concatenate([view(0.9), view(0.1)]), np.full(2, 0.5))
    assert 0 < albedo[0] < albedo[1] < 1
    assert sheen_table.pack_table(sheen_table.sheen_table()) == sheen_table.PACKED


@pytest.mark.parametrize("size", [0.3, 0.9])
def test_toon_without_smoothing_sends_on_all_light(size):
    # The quadrature resolves the edge of the cone to one part in its 400 cosines.
    assert integrate_shape("toon", size, 0.5) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("roughness", [0.2, 0.6, 1.0])
def test_velvet_sends_on_no_more_than_arrives(roughness):
    for cosine in (0.9, 0.4, 0.1):
        assert 0 <= integrate_shape("velvet", roughness, cosine) < 1


# Lobes ---------------------------------------------------------------------------------------------------------------

LOBES = {
    "beckmann": Closure("glossy", color=(1.0, 0.5, 0.2), roughness=0.6, distribution="beckmann"),
    "beckmann glass": Closure("glass", color=1.0, roughness=0.5, ior=1.4, distribution="beckmann"),
    "coat": Closure(
        "principled", color=0.8, roughness=0.6, coat_weight=0.7, coat_roughness=0.4, coat_tint=(1, 0.5, 0.2)
    ),
    "conductor": Closure("conductor", color=(0.2, 0.9, 1.3), extinction=(3.9, 2.4, 2.1), roughness=0.5),
}


@pytest.mark.parametrize("front", [True, False])
@pytest.mark.parametrize("name", LOBES)
def test_sampling_agrees_with_quadrature(name, front):
    """Mean weight = integral of f cos; share of valid samples = integral of the density; both by z bound."""
    rng = np.random.default_rng(5)
    count = 50_000
    shading = shade(LOBES[name], view(0.6, count), front)
    probabilities = lobe_probabilities(shading)
    way = sample_bsdf(shading, probabilities, rng.random(count), rng.random((count, 2)))
    total, density = integrate_lobes(LOBES[name], 0.6, front, *sphere_quadrature())
    coarse, coarse_density = integrate_lobes(LOBES[name], 0.6, front, *sphere_quadrature(200, 100))
    error = 4.5 * np.sqrt(way.weight.var(axis=0) / count)  # for about 30 comparisons
    assert (np.abs(way.weight.mean(axis=0) - total) < error + np.abs(coarse - total)).all()
    assert abs(way.alive.mean() - density) < 4.5 * np.sqrt(0.25 / count) + abs(coarse_density - density)


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_stretched_lobes_are_reciprocal_and_their_density_sums_to_what_is_sampled(distribution):
    closure = Closure("glossy", color=1.0, roughness=0.7, distribution=distribution, multiscatter=0.0)
    directions, weights = hemisphere()
    values = []
    for outgoing, incoming in ((view(0.6, len(directions)), directions), (directions, view(0.6, len(directions)))):
        (lobes,) = shade(closure, outgoing).lobes
        normal, tangent = lobes.normal, repeat((0.6, 0.8, 0.0), len(lobes))
        stretched = replace(lobes, stretch=make_stretch(normal, tangent, lobes.alpha * 1.5, lobes.alpha / 1.5))
        values.append(evaluate_microfacets(stretched, outgoing, incoming, normal))
    (there, density), (back, _) = values
    np.testing.assert_allclose(there[:, 0] / directions[:, 2], back[:, 0] / 0.6, rtol=1e-9, atol=1e-13)
    assert (there[:, 0] * weights).sum() < 1
    numbers = np.random.default_rng(9).random((3, len(directions)))
    (lobes,) = shade(closure, view(0.6, len(directions))).lobes
    stretched = replace(lobes, stretch=make_stretch(normal, tangent, lobes.alpha * 1.5, lobes.alpha / 1.5))
    sampled = sample_microfacets(stretched, view(0.6, len(directions)), normal, numbers[0], numbers[1:].T)
    # Beckmann's facets are sampled whether they are seen or not; those turned away reflect to nowhere.
    valid = evaluate_microfacets(stretched, view(0.6, len(directions)), sampled.direction, normal)[1] > 0
    share = (valid & sampled.valid).mean()
    assert share == pytest.approx((density * weights).sum(), abs=4.5 * np.sqrt(0.25 / len(directions)) + 1e-3)


def test_a_lobe_stretched_by_nothing_is_even():
    incoming, outgoing = random_directions(200, 6), random_directions(200, 7)
    for distribution in DISTRIBUTIONS:
        (lobes,) = shade(Closure("glossy", roughness=0.6, distribution=distribution), outgoing).lobes
        stretch = make_stretch(lobes.normal, incoming, lobes.alpha, lobes.alpha)
        even = evaluate_microfacets(lobes, outgoing, incoming, lobes.normal)
        same = evaluate_microfacets(replace(lobes, stretch=stretch), outgoing, incoming, lobes.normal)
        for first, second in zip(even, same, strict=True):
            np.testing.assert_allclose(first, second, rtol=1e-10)


def test_beckmann_facets_cover_the_surface_once():
    """integral D cos = 1; the mean of tan^2 of sampled facets is alpha^2."""
    directions, weights = hemisphere()
    cosine = directions[:, 2]
    assert (beckmann_density(np.array(0.5), cosine) * cosine * weights).sum() == pytest.approx(1.0, rel=1e-6)
    normals = sample_beckmann_normals(np.full(100_000, 0.5), np.random.default_rng(8).random((100_000, 2)))
    tangent = 1 / normals[:, 2] ** 2 - 1  # exponential: its spread is its mean
    assert tangent.mean() == pytest.approx(0.25, abs=4.5 * 0.25 / np.sqrt(100_000))
    assert beckmann_shadowing(np.array([0.5, 0.5]), np.array([1.0, 0.01]))[0] == 0


def test_conductor_without_extinction_is_a_dielectric_and_at_normal_incidence_the_known_form():
    index, extinction = np.array([[0.5, 1.5, 2.0]]), np.array([[3.0, 0.0, 1.0]])
    head_on = conductor_reflectance(np.array([[1.0]]), index, extinction)
    known = ((index - 1) ** 2 + extinction**2) / ((index + 1) ** 2 + extinction**2)
    np.testing.assert_allclose(head_on, known, rtol=1e-12)
    np.testing.assert_allclose(conductor_reflectance(np.array([[0.0]]), index, extinction), 1.0)
    assert metal_mean(np.array(1.0), metal_slope(np.array(1.0), np.array(1.0))) == pytest.approx(1.0)


def test_rotate_turns_around_the_axis():
    x = np.array([[1.0, 0.0, 0.0]])
    np.testing.assert_allclose(rotate(x, UP, np.array([np.pi / 2])), [[0, 1, 0]], atol=1e-15)
    np.testing.assert_allclose(rotate(UP, UP, np.array([1.0])), UP)


# Costs ---------------------------------------------------------------------------------------------------------------


def test_layers_that_no_material_has_are_not_made(monkeypatch):
    for name in ("_add_sheen", "_make_coat", "make_rough_matte", "make_sheen"):
        monkeypatch.setattr(principled, name, None)
    assert len(shade(Closure("principled", roughness=0.4), view(0.5)).lobes) == 1
    with pytest.raises(TypeError):
        shade(Closure("principled", coat_weight=0.5), view(0.5))


def test_only_parameters_that_a_kind_has_are_gathered(monkeypatch):
    asked, gather = set(), Closures.__getattr__

    def record(self, name):
        asked.add(name)
        return gather(self, name)

    monkeypatch.setattr(Closures, "__getattr__", record)
    shade(Closure("diffuse", color=0.5), view(0.5))
    assert asked == {"weight", "color"}
    asked.clear()
    shade(Closure("principled"), view(0.5))
    layers = ("coat", "sheen", "diffuse_", "anisotropy", "rotation", "size", "smooth", "extinction")
    assert not [name for name in asked if name.startswith(layers)]


def test_a_coat_dims_and_tints_what_lies_under_it():
    plain = shade(Closure("principled", color=0.8, specular=0.0), view(0.5))
    coated = shade(Closure("principled", color=0.8, specular=0.0, coat_weight=1.0), view(0.5))
    tinted = shade(Closure("principled", color=0.8, specular=0.0, coat_weight=1.0, coat_tint=(1, 0.5, 0.25)), view(0.5))
    assert (coated.diffuse < plain.diffuse).all()
    depth = 1 / np.sqrt(1 - (1 - 0.25) / 1.5**2)
    np.testing.assert_allclose(tinted.diffuse, coated.diffuse * np.array([1, 0.5, 0.25]) ** depth, rtol=1e-12)


def test_sheen_lies_over_everything_and_translucence_on_the_far_side():
    sheen = shade(Closure("principled", color=0.8, metallic=1.0, sheen_weight=1.0), view(0.3))
    (part,) = sheen.tilted
    assert (
        sheen.lobes[0].weight[0, 0]
        < shade(Closure("principled", color=0.8, metallic=1.0), view(0.3)).lobes[0].weight[0, 0]
    )
    assert not part.transmits
    (behind,) = shade(Closure("translucent", color=0.5), view(0.3)).tilted
    np.testing.assert_allclose(evaluate_tilted(behind, UP, -UP), 0.5 / np.pi)
    np.testing.assert_array_equal(evaluate_tilted(behind, UP, UP), 0.0)
    assert behind.transmits


def test_a_normal_at_a_right_angle_faces_either_side():
    """Light at 60 degrees from both: a = 1 there, and tan^2 = 3, so that 2 / (1 + sqrt(1 + 3)) arrives."""
    part = TiltedDiffuse(np.zeros(1, int), np.array([(1.0, 0.0, 0.0)]), np.ones((1, 3)))
    incoming = np.array([(0.5, np.sqrt(0.5), 0.5)])
    np.testing.assert_allclose(evaluate_tilted(part, UP, incoming), 0.5 / np.pi * 2.0 / 3.0)
    np.testing.assert_allclose(evaluate_tilted(part, -UP, incoming), 0.5 / np.pi * 2.0 / 3.0)


def test_bumps_fade_only_where_they_are_to():
    """Light at 60 degrees from the surface's normal and 30 from its own: undimmed, and by a^2 = tan^2(60) / 8."""
    own = np.array([(np.sqrt(0.75), 0.0, 0.5)] * 2)
    part = TiltedDiffuse(np.arange(2), own, np.ones((2, 3)))
    incoming = np.array([(0.0, np.sqrt(0.75), 0.5)] * 2)
    found = evaluate_tilted(part, UP.repeat(2, axis=0), incoming, np.array([False, True]))
    np.testing.assert_allclose(found[0], 0.25 / np.pi)
    np.testing.assert_allclose(found[1], 0.25 / np.pi * 2.0 / (1.0 + np.sqrt(1.0 + 9.0 / 8.0)))
    behind = evaluate_tilted(part, UP.repeat(2, axis=0), np.array([(1.0, 0.0, -0.1)] * 2), np.array([False, True]))
    np.testing.assert_array_equal(behind != 0, 0)


def test_anisotropy_keeps_the_mean_roughness_unless_it_is_cut():
    closures = Closures({"anisotropy": np.array([0.5])}, np.zeros(1, int))
    grain = Grain(np.array([0.5]), np.ones(1))

    class Stretched:
        vectors = {"tangent": UP}  # noqa: RUF012

    for glossy in (True, False):
        stretched = stretch_grain(grain, closures, Stretched, glossy)
        np.testing.assert_allclose(stretched.roughness, 0.5)
    expected = [[0.25 / np.sqrt(0.55)], [0.25 * np.sqrt(0.55)]]
    np.testing.assert_allclose((stretched.along, stretched.across), expected)
