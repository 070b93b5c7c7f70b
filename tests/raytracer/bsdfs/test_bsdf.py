"""Materials: Fresnel's formulas, reciprocity, energy, and sampling against quadrature of what it samples."""

import functools
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

import raytracer.bsdfs.microfacet_albedo as albedo
from raytracer.arrays.vectors import reflect
from raytracer.bsdfs.bsdf import evaluate_lobes, lobe_probabilities
from raytracer.bsdfs.bsdf_samples import sample_bsdf
from raytracer.bsdfs.fresnel import (
    dielectric_reflectance,
    metal_coefficient,
    metal_reflectance,
    refract,
    transmitted_cosine,
)
from raytracer.bsdfs.lobes import SMALLEST_PICK
from raytracer.bsdfs.microfacet import SMALLEST_ALPHA
from raytracer.bsdfs.tilted_normals import tilt_to_reflect
from raytracer.integrator.direct_light import reflect_light
from raytracer.lecture import dot
from raytracer.lights.light_shapes import LightSamples
from raytracer.sampling.warps import power_heuristic
from raytracer.scene.materials import Closure, Material
from raytracer.scene.scene import Scene
from raytracer.shading.materials import make_material_table, make_shading
from raytracer.surfaces.surface import Surface

# What the tables of energy promise, see `microfacet_albedo`: the nodes' own error, and that of reading between them.
TABLE_ERROR = 5e-3
READING_ERROR = 1e-2

CLOSURES = {
    "glossy": Closure("glossy", color=(1.0, 0.5, 0.2), roughness=0.5),
    "smooth glossy": Closure("glossy", color=1.0, roughness=0.3),
    "rough glossy": Closure("glossy", color=1.0, roughness=1.0),
    "glass": Closure("glass", color=1.0, roughness=0.5, ior=1.5),
    "rough glass": Closure("glass", color=(1.0, 0.9, 0.5), roughness=0.9, ior=1.33),
    "refraction": Closure("refraction", color=1.0, roughness=0.4, ior=1.5),
    "thin refraction": Closure("refraction", color=1.0, roughness=0.4, ior=0.8),
    "plastic": Closure("principled", color=0.8, roughness=0.4),
    "metal": Closure("principled", color=(0.9, 0.5, 0.1), metallic=1.0, roughness=0.5, specular_tint=(0.5, 1.0, 1.0)),
    "principled glass": Closure("principled", color=0.9, transmission=1.0, roughness=0.5),
    "all": Closure("principled", color=0.7, transmission=0.4, metallic=0.3, roughness=0.5, alpha=0.7, specular=0.8),
}


class Scattering(NamedTuple):
    """f |cos| of the Lambertian part and of all lobes, (n, 3), and the density of `sample_bsdf`, (n,)."""

    diffuse: np.ndarray
    specular: np.ndarray
    density: np.ndarray


def evaluate_scattering(shading, probabilities, incoming):
    """What each point sends back of a unit of light from `incoming`."""
    count = len(shading)
    unit = LightSamples(incoming, np.full(count, np.inf), np.ones((count, 3)), np.full(count, np.inf))
    diffuse = reflect_light(replace(shading, lobes=()), probabilities, unit)
    return Scattering(diffuse, *evaluate_lobes(shading, probabilities, incoming))


def shade(closures, outgoing, front=True, normal=(0.0, 0.0, 1.0)):
    """Shading of one material at points that are all seen from `outgoing`, (n, 3); the normal points to the viewer."""
    closures = closures if isinstance(closures, tuple) else (closures,)
    outgoing = np.atleast_2d(np.asarray(outgoing, float))
    count = len(outgoing)
    facing = np.broadcast_to(np.asarray(normal, float), (count, 3)) * (1.0 if front else -1.0)
    index = np.zeros(count, np.int32)
    surface = Surface(
        np.zeros((count, 3)), np.zeros(count), facing, facing, outgoing, np.full(count, front), index, index, index
    )
    return make_shading(make_material_table(Scene(materials=[Material(closures)])), surface)


def view(cosine, count=1):
    return np.tile([np.sqrt(1 - cosine * cosine), 0.0, cosine], (count, 1))


@functools.cache
def sphere_quadrature(cosines=400, angles=200):
    """Directions (k, 3) and weights (k,) over the unit sphere, Gauss in each half of the cosine."""
    nodes, weights = np.polynomial.legendre.leggauss(cosines)
    height = np.concatenate([(nodes + 1) / 2, -(nodes + 1) / 2])
    angle = (np.arange(angles) + 0.5) / angles * 2 * np.pi
    sine = np.sqrt(1 - height**2)
    directions = np.stack(
        [
            np.outer(sine, np.cos(angle)).ravel(),
            np.outer(sine, np.sin(angle)).ravel(),
            np.repeat(height, angles),
        ],
        axis=1,
    )
    weights = np.repeat(np.tile(weights / 2, 2), angles) * 2 * np.pi / angles
    return freeze(directions, weights)


def freeze(*arrays):
    """Return arrays that many tests share, so that none can write to them."""
    for array in arrays:
        array.flags.writeable = False
    return arrays


def integrate_lobes(closure, cosine, front, directions, weights):
    """Return the integrals of f cos, (3,), and of the density over all directions."""
    shading = shade(closure, view(cosine, len(directions)), front)
    scattering = evaluate_scattering(shading, lobe_probabilities(shading), directions)
    return (scattering.specular * weights[:, None]).sum(axis=0), (scattering.density * weights).sum()


# Fresnel -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("eta", [1.2, 1.5, 2.4, 1 / 1.5])
def test_dielectric_reflectance_at_normal_incidence_and_at_grazing(eta):
    assert dielectric_reflectance(np.array([1.0]), np.array([eta]))[0] == pytest.approx(((eta - 1) / (eta + 1)) ** 2)
    assert dielectric_reflectance(np.array([0.0]), np.array([eta]))[0] == 1


def test_dielectric_reflectance_at_brewsters_angle_is_half_the_crossed_part():
    """tan b = eta: the parallel part vanishes, the crossed part is ((1 - eta^2) / (1 + eta^2))^2."""
    eta = np.array([1.5])
    cosine = 1 / np.sqrt(1 + eta**2)
    expected = ((1 - eta**2) / (1 + eta**2)) ** 2 / 2
    np.testing.assert_allclose(dielectric_reflectance(cosine, eta), expected, rtol=1e-14)


def test_dielectric_reflectance_is_total_beyond_the_critical_angle():
    eta = np.array([1 / 1.5])
    critical = np.sqrt(1 - eta**2)
    assert dielectric_reflectance(critical - 1e-9, eta)[0] == 1
    assert dielectric_reflectance(critical + 1e-3, eta)[0] < 1


def test_dielectric_reflectance_is_the_same_from_both_sides():
    cosine = np.linspace(0.01, 1, 50)
    eta = np.full(50, 1.5)
    behind = transmitted_cosine(cosine, eta)
    np.testing.assert_allclose(dielectric_reflectance(cosine, eta), dielectric_reflectance(behind, 1 / eta), rtol=1e-12)


def test_metal_reflectance_is_tinted_at_82_degrees():
    f0, tint = np.array([[0.9, 0.5, 0.1]]), np.array([[1.0, 0.5, 0.25]])
    cosine = np.array([[1 / 7]])
    plain = f0 + (1 - f0) * (6 / 7) ** 5
    np.testing.assert_allclose(metal_reflectance(cosine, f0, metal_coefficient(f0, tint)), plain * tint, rtol=1e-14)
    np.testing.assert_allclose(metal_reflectance(np.array([[1.0]]), f0, metal_coefficient(f0, tint)), f0)


def test_metal_mean_reflectance_is_the_integral():
    nodes, weights = np.polynomial.legendre.leggauss(20)
    cosine = (nodes + 1) / 2
    f0, tint = np.array([[0.6]]), np.array([[0.9]])
    b = metal_coefficient(f0, tint)
    total = (weights * cosine * metal_reflectance(cosine[:, None], f0, b)[:, 0]).sum()
    np.testing.assert_allclose(total, (f0 + (1 - f0) / 21 - b / 126)[0, 0], rtol=1e-13)


@pytest.mark.parametrize("eta", [1.3, 1.5, 0.7])
def test_refract_obeys_snells_law(eta):
    rng = np.random.default_rng(1)
    normals = np.tile([0, 0, 1.0], (100, 1))
    outgoing = rng.normal(size=(100, 3)) * 0.3
    outgoing[:, 2] = np.abs(outgoing[:, 2]) + 2  # below the critical angle of all
    outgoing /= np.linalg.norm(outgoing, axis=1)[:, None]
    through = refract(outgoing, normals, np.full(100, eta))
    np.testing.assert_allclose(eta * through[:, :2], -outgoing[:, :2], atol=1e-15)
    assert (through[:, 2] < 0).all()


def test_tilt_to_reflect_keeps_mirror_directions_above_the_surface():
    rng = np.random.default_rng(2)
    axis = np.tile([0, 0, 1.0], (2000, 1))
    outgoing, normal = rng.normal(size=(2, 2000, 3))
    outgoing[:, 2], normal[:, 2] = np.abs(outgoing[:, 2]) * 0.2, np.abs(normal[:, 2])
    outgoing /= np.linalg.norm(outgoing, axis=1)[:, None]
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    tilted = tilt_to_reflect(normal, axis, outgoing)
    limit = np.minimum(0.9 * outgoing[:, 2], 0.01)
    height = reflect(outgoing, tilted)[:, 2]
    assert (height >= limit - 1e-14).all()
    changed = (tilted != normal).any(axis=1)
    assert 0.1 < changed.mean() < 0.9
    np.testing.assert_allclose(height[changed], limit[changed], atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(tilted, axis=1), 1, atol=1e-14)


# Lobes ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["glossy", "rough glossy", "plastic", "metal", "glass"])
def test_reflection_is_reciprocal_but_for_the_compensation(name):
    """f(o, i) = f(i, o) for what a single facet reflects; the added bounces depend on o alone, as in Cycles."""
    rng = np.random.default_rng(3)
    a, b = rng.normal(size=(2, 200, 3))
    for v in (a, b):
        v[:, 2] = np.abs(v[:, 2]) + 0.05
        v /= np.linalg.norm(v, axis=1)[:, None]
    values = []
    for outgoing, incoming in ((a, b), (b, a)):
        shading = shade(CLOSURES[name], outgoing)
        scattering = evaluate_scattering(shading, lobe_probabilities(shading), incoming)
        weight = sum(lobe.weight for lobe in shading.lobes)
        values.append(scattering.specular / incoming[:, 2:3] / weight)
    np.testing.assert_allclose(values[0], values[1], rtol=1e-10)


def test_refraction_is_reciprocal_up_to_the_squared_index():
    """eta^2 f(i, o) from behind equals f(o, i): radiance is transported without the factor 1 / eta^2."""
    rng = np.random.default_rng(4)
    outgoing = rng.normal(size=(400, 3))
    outgoing[:, 2] = np.abs(outgoing[:, 2]) + 0.1
    incoming = rng.normal(size=(400, 3))
    incoming[:, 2] = -np.abs(incoming[:, 2]) - 0.5
    for v in (outgoing, incoming):
        v /= np.linalg.norm(v, axis=1)[:, None]
    closure = CLOSURES["refraction"]
    enter, leave = shade(closure, outgoing), shade(closure, incoming, front=False, normal=(0, 0, -1.0))
    into = evaluate_scattering(enter, lobe_probabilities(enter), incoming).specular
    back = evaluate_scattering(leave, lobe_probabilities(leave), outgoing).specular
    into, back = into / np.abs(incoming[:, 2:3]), back / np.abs(outgoing[:, 2:3])
    assert (into > 0).mean() > 0.2
    np.testing.assert_allclose(into, back * 1.5**2, rtol=1e-9)


@pytest.mark.parametrize("cosine", [0.95, 0.6, 0.3])
@pytest.mark.parametrize("front", [True, False])
@pytest.mark.parametrize("name", CLOSURES)
def test_sample_continuation_agrees_with_quadrature(name, front, cosine):
    """Mean weight = integral of f cos; share of valid rough samples = integral of the density; both by z bound."""
    rng = np.random.default_rng(5)
    count = 50_000
    shading = shade(CLOSURES[name], view(cosine, count), front)
    probabilities = lobe_probabilities(shading)
    way = sample_bsdf(shading, probabilities, rng.random(count), rng.random((count, 2)))
    straight = way.goes_straight
    directions, weights = sphere_quadrature()
    total, density = integrate_lobes(CLOSURES[name], cosine, front, directions, weights)
    coarse, coarse_density = integrate_lobes(CLOSURES[name], cosine, front, *sphere_quadrature(200, 100))
    values = np.where(straight[:, None], 0.0, way.weight)
    error = np.sqrt(values.var(axis=0) / count)
    # 4.5 standard errors for about 200 comparisons, and the share below which nothing may have been drawn at all; the
    # quadrature adds what halving its nodes changes.
    assert (np.abs(values.mean(axis=0) - total) < 4.5 * error + 5 / count + np.abs(coarse - total)).all()
    taken = (~straight & way.alive).mean()
    assert abs(taken - density) < 4.5 * np.sqrt(0.25 / count) + abs(coarse_density - density)
    finite = np.isfinite(way.density)
    assert (finite | straight | ~way.alive).all()


@pytest.mark.parametrize("name", CLOSURES)
def test_sample_continuation_reports_the_density_and_value_it_evaluates(name):
    rng = np.random.default_rng(6)
    shading = shade(CLOSURES[name], view(0.6, 500))
    probabilities = lobe_probabilities(shading)
    way = sample_bsdf(shading, probabilities, rng.random(500), rng.random((500, 2)))
    again = evaluate_scattering(shading, probabilities, way.direction)
    rough = way.alive & ~way.goes_straight
    np.testing.assert_array_equal(way.density[rough], again.density[rough])
    np.testing.assert_allclose(way.weight[rough] * way.density[rough, None], again.specular[rough], rtol=1e-12)


@pytest.mark.parametrize("cosine", [0.9, 0.5, 0.2])
@pytest.mark.parametrize("front", [True, False])
@pytest.mark.parametrize("name", ["rough glossy", "smooth glossy", "glass"])
def test_white_lobes_send_on_all_light_in_a_furnace(name, front, cosine):
    directions, weights = sphere_quadrature()
    shading = shade(CLOSURES[name], view(cosine, len(directions)), front)
    scattering = evaluate_scattering(shading, lobe_probabilities(shading), directions)
    total = (scattering.specular * weights[:, None]).sum(axis=0)
    np.testing.assert_allclose(total, 1.0, atol=READING_ERROR)


@pytest.mark.parametrize("cosine", [0.95, 0.6, 0.25])
@pytest.mark.parametrize("roughness", [0.0, 0.2, 0.6, 1.0])
@pytest.mark.parametrize("specular", [0.0, 0.5, 1.0])
def test_white_plastic_sends_on_all_light_and_no_more(roughness, specular, cosine):
    closure = Closure("principled", color=1.0, roughness=roughness, specular=specular)
    rng = np.random.default_rng(7)
    count = 100_000
    shading = shade(closure, view(cosine, count))
    way = sample_bsdf(shading, lobe_probabilities(shading), rng.random(count), rng.random((count, 2)))
    specular_part = way.weight[:, 0]
    total = specular_part.mean() + shading.diffuse[0, 0]
    noise = 4.5 * specular_part.std() / np.sqrt(count)
    # The layer's albedo is read from Cycles' coarse grid over the cosine.
    assert abs(total - 1.0) < noise + READING_ERROR


@pytest.mark.parametrize("kind", ["glossy", "glass", "refraction"])
def test_roughness_zero_is_a_perfect_lobe(kind):
    shading = shade(Closure(kind, color=(0.9, 0.8, 0.7), roughness=0.0, ior=1.5), view(0.6, 64))
    probabilities = lobe_probabilities(shading)
    nothing = evaluate_scattering(shading, probabilities, reflect(shading.outgoing, shading.normal))
    assert not nothing.specular.any()
    assert not nothing.density.any()
    choice = (np.arange(64) + 0.5) / 64
    way = sample_bsdf(shading, probabilities, choice, np.zeros((64, 2)))
    mirror, through = (
        reflect(shading.outgoing, shading.normal),
        refract(shading.outgoing, shading.normal, np.full(64, 1.5)),
    )
    reflected = dot(way.direction, mirror) > 1 - 1e-12
    assert (reflected | (dot(way.direction, through) > 1 - 1e-12)).all()
    np.testing.assert_allclose(way.weight, np.tile([0.9, 0.8, 0.7], (64, 1)), rtol=1e-14)
    assert np.isinf(way.density).all()
    share = dielectric_reflectance(np.array([0.6]), np.array([1.5]))[0]
    expected = {"glossy": 1.0, "refraction": 0.0, "glass": share}[kind]
    assert abs(reflected.mean() - expected) <= 1 / 64


def test_glass_reflects_totally_from_inside():
    shading = shade(Closure("glass", color=1.0, roughness=0.0, ior=1.5), view(0.3, 50), front=False)
    way = sample_bsdf(shading, lobe_probabilities(shading), np.linspace(0, 0.999, 50), np.zeros((50, 2)))
    np.testing.assert_allclose(way.direction, reflect(shading.outgoing, shading.normal), atol=1e-15)
    np.testing.assert_array_equal(way.weight, 1.0)


def test_rough_refraction_is_picked_in_total_reflection_of_the_smooth_normal():
    """Facets turned to the viewer still let light out: the lobe must not be starved."""
    shading = shade((CLOSURES["refraction"], Closure("transparent", color=0.5)), view(0.6), front=False)
    assert lobe_probabilities(shading)[0, 1] > SMALLEST_PICK


def test_glass_of_index_one_lets_everything_pass_straight():
    shading = shade(Closure("glass", color=1.0, roughness=0.5, ior=1.0), view(0.5, 100))
    rng = np.random.default_rng(8)
    way = sample_bsdf(shading, lobe_probabilities(shading), rng.random(100), rng.random((100, 2)))
    np.testing.assert_allclose(way.direction, -shading.outgoing, atol=1e-12)
    assert np.isinf(way.density).all()
    np.testing.assert_allclose(way.weight, 1.0, atol=READING_ERROR)


def test_principled_at_full_metallic_or_transmission_has_no_diffuse_part():
    for closure in (CLOSURES["metal"], CLOSURES["principled glass"]):
        assert not shade(closure, view(0.5)).diffuse.any()


def test_specular_level_half_is_neutral_and_zero_is_lambert():
    matte = shade(Closure("principled", color=0.8, specular=0.0, roughness=0.3), view(0.4))
    assert not matte.lobes
    np.testing.assert_array_equal(matte.diffuse, 0.8)
    neutral = shade(Closure("principled", color=0.8, specular=0.5, ior=1.5, roughness=0.0), view(1.0))
    np.testing.assert_allclose(neutral.lobes[0].f0, 0.04, rtol=1e-12)
    double = shade(Closure("principled", color=0.8, specular=1.0, ior=1.5, roughness=0.0), view(1.0))
    np.testing.assert_allclose(double.lobes[0].f0, 0.08, rtol=1e-12)


def test_alpha_weighs_everything_but_the_passage():
    solid = Closure("principled", color=0.8, emission=2.0, roughness=0.3)
    thin = Closure("principled", color=0.8, emission=2.0, roughness=0.3, alpha=0.25)
    a, b = shade(solid, view(0.5)), shade(thin, view(0.5))
    np.testing.assert_allclose(b.transparency, 0.75)
    np.testing.assert_allclose(b.radiance, 0.25 * a.radiance)
    np.testing.assert_allclose(b.diffuse, 0.25 * a.diffuse)
    np.testing.assert_allclose(b.lobes[0].weight, 0.25 * a.lobes[0].weight)


def test_closures_of_a_material_add_up():
    mixed = shade(
        (Closure("diffuse", color=(1, 0, 0), weight=0.5), Closure("diffuse", color=(0, 1, 0), weight=0.25)), view(0.5)
    )
    np.testing.assert_allclose(mixed.diffuse, [[0.5, 0.25, 0]])
    lit = shade((Closure("emission", color=2.0, weight=0.5), Closure("transparent", color=0.4, weight=0.5)), view(0.5))
    np.testing.assert_allclose(lit.radiance, 1.0)
    np.testing.assert_allclose(lit.transparency, 0.2)


def test_material_without_closures_is_black_and_ends_paths():
    shading = shade((), view(0.5, 3))
    probabilities = lobe_probabilities(shading)
    assert not probabilities.any()
    assert not sample_bsdf(shading, probabilities, np.full(3, 0.9), np.zeros((3, 2))).alive.any()


def test_power_heuristic_shares_sum_to_one():
    p, q = np.array([1.0, 2.0, 0.0, np.inf, 3.0]), np.array([1.0, 5.0, 2.0, 4.0, 0.0])
    np.testing.assert_allclose(power_heuristic(p, q), [0.5, 4 / 29, 0.0, 1.0, 1.0])
    np.testing.assert_allclose(power_heuristic(p, q)[:2] + power_heuristic(q, p)[:2], 1.0)


# Tables --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "integral", [albedo.integrate_reflection, albedo.integrate_glass, albedo.integrate_schlick_share]
)
@pytest.mark.parametrize("eta", [1.5, 1 / 1.5])
def test_energy_quadrature_agrees_with_far_more_nodes(monkeypatch, integral, eta):
    rng = np.random.default_rng(9)
    roughness, cosine = rng.uniform(0.02, 1, 60), rng.uniform(0.02, 1, 60)
    arguments = () if integral is albedo.integrate_reflection else (eta,)
    coarse = integral(roughness, cosine, *arguments)
    monkeypatch.setattr(albedo, "ANGLE_NODES", 96)
    monkeypatch.setattr(albedo, "HEIGHT_NODES", 320)
    np.testing.assert_allclose(coarse, integral(roughness, cosine, *arguments), atol=TABLE_ERROR)


def test_smooth_lobes_lose_no_energy():
    share, mean = albedo.read_reflection(np.array([0.0]), np.array([0.7]))
    np.testing.assert_allclose(share, 1.0, atol=1e-6)
    np.testing.assert_allclose(mean, 1.0, atol=1e-3)
    assert pytest.approx(0.003761**2, rel=1e-3) == SMALLEST_ALPHA  # the roughness at which Cycles turns to a mirror


def test_compensate_of_white_is_the_inverse_of_the_single_bounce():
    share, mean = np.array([0.4, 0.9]), np.array([0.5, 0.95])
    np.testing.assert_allclose(albedo.compensate(share, mean, np.ones((2, 3))), np.repeat(1 / share, 3).reshape(2, 3))
    np.testing.assert_array_equal(albedo.compensate(share, mean, np.zeros((2, 3))), 1.0)


@pytest.mark.parametrize("eta", [1.1, 1.5, 2.5, 1 / 1.5])
def test_mean_dielectric_reflectance_fits_the_integral(eta):
    # So many are right to 2e-4, beyond whose critical angle all is reflected; of the others to 1e-14.
    nodes, weights = np.polynomial.legendre.leggauss(400)
    cosine = (nodes + 1) / 2
    exact = (weights * cosine * dielectric_reflectance(cosine, np.full(400, eta))).sum()
    assert albedo.mean_dielectric_reflectance(np.array([eta]))[0] == pytest.approx(exact, abs=6e-3)  # Kulla and Conty
