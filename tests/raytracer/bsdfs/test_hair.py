"""Lobes of hair: white furnaces, densities against what is sampled, closed forms of their parts."""

import functools
from dataclasses import replace

import numpy as np
import pytest

from raytracer.bsdfs.bounce_kinds import GLOSSY, TRANSMITTED
from raytracer.bsdfs.bsdf import evaluate_bsdf, lobe_probabilities
from raytracer.bsdfs.bsdf_samples import sample_bsdf
from raytracer.bsdfs.closures import Shading
from raytracer.bsdfs.hair import (
    absorb_by_color,
    absorb_by_melanin,
    find_tangents,
    longitudinal,
    make_strand_frame,
    scaled_bessel,
)
from raytracer.bsdfs.hair_cauchy import CauchyHair
from raytracer.bsdfs.hair_chiang import ChiangHair, find_angles, find_scale, find_variance
from raytracer.integrator.passes.denoising import sum_normals
from raytracer.lecture import dot
from tests.raytracer.bsdfs.test_bsdf import freeze, sphere_quadrature

TILT = np.radians(2.0)


def repeat(values, count):
    return np.repeat(np.atleast_2d(np.asarray(values, float)), count, axis=0)


def make_chiang(
    count, across=0.4, absorption=0.0, roughness=0.3, radial=0.3, coat=0.0, tilt=0.0, ior=1.55, tangent=(1.0, 0.0, 0.0)
):
    def spread(value):
        return np.broadcast_to(np.asarray(value, float), (count,)).copy()

    return ChiangHair(
        hit=np.arange(count),
        weight=np.ones((count, 3)),
        normal=repeat((0.0, 0.0, 1.0), count),
        tangent=repeat(tangent, count),
        across=spread(across),
        absorption=repeat(np.broadcast_to(absorption, (3,)), count),
        variance=find_variance(spread(roughness)),
        reflected_variance=find_variance((1.0 - coat) * spread(roughness)),
        scale=find_scale(spread(radial)),
        tilt=spread(tilt),
        ior=spread(ior),
    )


def make_cauchy(count, passes, along=0.2, around=0.4, offset=0.0):
    return CauchyHair(
        hit=np.arange(count),
        weight=np.ones((count, 3)),
        normal=repeat((0.0, 0.0, 1.0), count),
        tangent=repeat((1.0, 0.0, 0.0), count),
        along=np.full(count, along),
        around=np.full(count, around),
        offset=np.full(count, offset),
        passes=np.full(count, float(passes)),
    )


def view(theta, count):
    """Seen from theta above the plane across a strand along x, over its normal, z."""
    return repeat((np.sin(theta), 0.0, np.cos(theta)), count)


@functools.cache
def around_strand(count=300, angles=240):
    """Directions and weights of a quadrature whose poles lie along x: even in sin theta, and around the strand.

    Smooth lobes are right to 1e-6; those that are cut, or counted in cells, take `FINE`.
    """
    nodes, weights = np.polynomial.legendre.leggauss(count)
    angle = (np.arange(angles) + 0.5) / angles * 2 * np.pi
    cosine = np.sqrt(1 - nodes**2)
    directions = np.stack(
        [np.repeat(nodes, angles), np.outer(cosine, np.cos(angle)).ravel(), np.outer(cosine, np.sin(angle)).ravel()], 1
    )
    return freeze(directions, np.repeat(weights, angles) * 2 * np.pi / angles)


FINE = (600, 480)


def integrate(make, theta, quadrature):
    """Return the integrals of the value (3,) and of the density."""
    directions, weights = quadrature
    value, density = make(len(directions)).evaluate(view(theta, len(directions)), directions)
    return (value * weights[:, None]).sum(axis=0), (density * weights).sum()


@pytest.mark.parametrize("theta", [0.0, 0.7, -1.3])
@pytest.mark.parametrize(("roughness", "radial"), [(0.3, 0.3), (0.15, 0.2), (0.9, 1.0)])
@pytest.mark.parametrize(("across", "ior"), [(0.0, 1.55), (0.6, 1.55), (-0.98, 1.2)])
def test_hair_that_absorbs_nothing_sends_on_all_light(theta, roughness, radial, across, ior):
    total, density = integrate(
        lambda count: make_chiang(count, across, 0.0, roughness, radial, ior=ior), theta, around_strand()
    )
    np.testing.assert_allclose(total, 1.0, atol=2e-5)
    assert density == pytest.approx(1.0, abs=2e-5)


@pytest.mark.parametrize("theta", [0.0, 0.7, -1.3, 1.56])
def test_tilted_scales_lose_nothing(theta):
    """Beyond the strand's own direction the cone is folded back."""
    total, density = integrate(lambda count: make_chiang(count, tilt=4 * TILT, coat=0.3), theta, around_strand())
    np.testing.assert_allclose(total, 1.0, atol=2e-5)
    assert density == pytest.approx(1.0, abs=2e-5)


def test_absorption_dims_each_color_as_its_way_through_the_strand_says():
    """Head on, h = 0, without reflection inside: R + TT = F + (1 - F)^2 exp(-2 absorption)."""
    absorption, f = np.array([0.1, 1.0, 5.0]), ((1.55 - 1) / (1.55 + 1)) ** 2
    passed = np.exp(-2.0 * absorption)
    expected = f + (1 - f) ** 2 * passed / (1 - f * passed)
    total, _ = integrate(lambda count: make_chiang(count, 0.0, absorption), 0.0, around_strand())
    np.testing.assert_allclose(total, expected, rtol=2e-5)


SAMPLED = {
    "chiang": lambda count: make_chiang(count, 0.5, (0.2, 0.7, 1.5)),
    "tilted and coated": lambda count: make_chiang(count, -0.7, 0.3, 0.4, 0.5, coat=0.6, tilt=2 * TILT),
    "narrow": lambda count: make_chiang(count, 0.2, 0.1, 0.1, 0.15, tilt=TILT),
    "reflection": lambda count: make_cauchy(count, passes=False),
    "wide reflection": lambda count: make_cauchy(count, passes=False, along=0.5, around=1.0, offset=0.2),
    "transmission": lambda count: make_cauchy(count, passes=True, offset=-0.3),
}


def shade(lobes, outgoing):
    count, black = len(lobes), np.zeros((len(lobes), 3))
    normal = repeat((0.0, 0.0, 1.0), count)
    return Shading(normal, normal, outgoing, black, black, black, (lobes,))


@pytest.mark.parametrize("theta", [0.2, -1.1])
@pytest.mark.parametrize("name", SAMPLED)
def test_what_is_sampled_has_its_density(name, theta):
    """Shares of samples in 6 x 8 cells of sin theta and phi are the density's integrals over them, by chi square; their
    mean weight is the integral of the value."""
    count, bins = 60_000, (6, 8)
    rng = np.random.default_rng(17)
    shading = shade(SAMPLED[name](count), view(theta, count))
    probabilities = lobe_probabilities(shading)
    sample = sample_bsdf(shading, probabilities, rng.random(count), rng.random((count, 2)))
    assert np.abs(np.linalg.norm(sample.direction, axis=1) - 1).max() < 1e-12

    directions, weights = around_strand(*FINE)
    value, density = SAMPLED[name](len(directions)).evaluate(view(theta, len(directions)), directions)

    def cells(found):
        rows = np.clip(((found[:, 0] + 1) / 2 * bins[0]).astype(int), 0, bins[0] - 1)
        return rows * bins[1] + ((np.arctan2(found[:, 2], found[:, 1]) / (2 * np.pi) % 1) * bins[1]).astype(int)

    expected = np.bincount(cells(directions), density * weights, bins[0] * bins[1]) * count
    alive = sample.density < np.inf
    seen = np.bincount(cells(sample.direction[alive]), minlength=bins[0] * bins[1])
    full = expected > 20
    deviation = ((seen - expected)[full] ** 2 / expected[full]).sum()
    # The quadrature is off by some thousandths of a cell where the density jumps; mean and spread of chi square.
    noise = ((3e-3 * expected[full]) ** 2 / expected[full]).sum()
    assert deviation < full.sum() + 4.5 * np.sqrt(2 * full.sum()) + noise
    mean = (value * weights[:, None]).sum(axis=0)
    error = 4.5 * np.sqrt(sample.weight.var(axis=0) / count) + 2e-3
    assert (np.abs(sample.weight.mean(axis=0) - mean) < error).all()


def test_passes_show_the_axis_across_strand_and_view_of_chiang_and_the_normal_of_others():
    outgoing = view(0.3, 4)
    chiang, cauchy = make_chiang(4), make_cauchy(4, passes=False)
    across = np.cross(chiang.tangent, outgoing)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    np.testing.assert_allclose(shade(chiang, outgoing).average_normal(), across, atol=1e-15)
    np.testing.assert_allclose(sum_normals(shade(chiang, outgoing)), chiang.albedo[:, None] * across, atol=1e-15)
    np.testing.assert_array_equal(shade(cauchy, outgoing).average_normal(), cauchy.normal)


def test_samples_of_white_hair_all_weigh_one():
    count = 20_000
    rng = np.random.default_rng(3)
    theta = rng.uniform(-1.57, 1.57, count)
    outgoing = np.stack([np.sin(theta), 0 * theta, np.cos(theta)], axis=1)
    shading = shade(make_chiang(count, rng.uniform(-1, 1, count), tilt=2 * TILT), outgoing)
    sample = sample_bsdf(shading, lobe_probabilities(shading), rng.random(count), rng.random((count, 2)))
    np.testing.assert_allclose(sample.weight, 1.0, rtol=1e-9)


def test_kinds_say_what_came_back():
    count = 1000
    rng = np.random.default_rng(5)
    for lobes, allowed in (
        (make_chiang(count), {GLOSSY, GLOSSY | TRANSMITTED}),
        (make_cauchy(count, passes=False), {GLOSSY}),
        (make_cauchy(count, passes=True), {GLOSSY | TRANSMITTED}),
    ):
        shading = shade(lobes, view(0.3, count))
        sample = sample_bsdf(shading, lobe_probabilities(shading), rng.random(count), rng.random((count, 2)))
        assert set(sample.kind[sample.alive].tolist()) == allowed


def test_turning_all_turns_the_light():
    """A strand, its normal and both directions turned alike see the same."""
    rng = np.random.default_rng(11)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    incoming = rng.normal(size=(200, 3))
    incoming /= np.linalg.norm(incoming, axis=1)[:, None]
    outgoing = view(0.4, 200)
    for lobes in (make_chiang(200, 0.3, 0.4, tilt=TILT), make_cauchy(200, False), make_cauchy(200, True)):
        turned = replace(lobes, normal=lobes.normal @ turn.T, tangent=lobes.tangent @ turn.T)
        for first, second in zip(
            lobes.evaluate(outgoing, incoming), turned.evaluate(outgoing @ turn.T, incoming @ turn.T), strict=True
        ):
            np.testing.assert_allclose(first, second, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("passes", "around", "expected"), [(False, 0.4, 1.0), (False, 1.0, np.sin(np.pi / 4)), (True, 0.3, 1.0)]
)
def test_cauchy_lobes_send_on_all_light_but_what_is_cut(passes, around, expected):
    """Reflection within a right angle around a strand that its normal looks over: all where around <= 1/2, else
    sin(pi / (4 around)); transmission all."""
    total, _ = integrate(lambda count: make_cauchy(count, passes, 0.3, around), 0.0, around_strand(*FINE))
    # Within a milliradian of the strand nothing is sent.
    assert total[0] == pytest.approx(expected, abs=2e-3)


def test_cauchy_lobes_stay_on_their_side():
    incoming, _ = around_strand()
    for passes in (False, True):
        value, density = make_cauchy(len(incoming), passes).evaluate(view(0.3, len(incoming)), incoming)
        wrong = (incoming[:, 2] < 0) != passes
        assert not value[wrong].any()
        assert not density[wrong].any()
        assert density[~wrong].any()


def test_mixed_with_others_the_density_is_the_mixture():
    count = 500
    directions, _ = around_strand()
    outgoing, incoming = view(0.3, count), directions[:: len(directions) // count][:count]
    first, second = make_chiang(count, absorption=0.3), make_cauchy(count, False)
    shading = replace(shade(first, outgoing), lobes=(first, second))
    probabilities = lobe_probabilities(shading)
    value, density = evaluate_bsdf(shading, probabilities, incoming)
    parts = [lobes.evaluate(outgoing, incoming) for lobes in (first, second)]
    np.testing.assert_allclose(value, parts[0][0] + parts[1][0], rtol=1e-12)
    expected = probabilities[:, 1] * parts[0][1] + probabilities[:, 2] * parts[1][1]
    np.testing.assert_allclose(density, expected, rtol=1e-12)


# Parts ---------------------------------------------------------------------------------------------------------------


def test_scaled_bessel_is_its_series_and_its_integral():
    """I0(x) = 1/pi int exp(x cos t) dt, by the midpoint rule, which is exact for periodic functions."""
    angle = (np.arange(4000) + 0.5) / 4000 * np.pi
    for x in (0.0, 0.3, 5.0, 80.0, 499.0, 501.0, 5e4):
        exact = np.exp(x * (np.cos(angle) - 1)).mean()
        assert scaled_bessel(np.array([x]))[0] == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("roughness", [0.001, 0.02, 0.3, 1.0])
def test_longitudinal_scattering_is_a_density(roughness):
    variance = find_variance(np.array([roughness]))
    sine_out, cosine_out = np.array([np.sin(0.6)]), np.array([np.cos(0.6)])
    width = np.sqrt(variance[0])
    theta = np.linspace(max(-np.pi / 2, -0.6 - 12 * width), min(np.pi / 2, -0.6 + 12 * width), 20001)
    values = longitudinal(np.sin(theta), np.cos(theta), sine_out, cosine_out, variance) * np.cos(theta)
    assert (values[1:] + values[:-1]).sum() / 2 * (theta[1] - theta[0]) == pytest.approx(1.0, abs=1e-6)


def test_absorption_by_color_and_melanin():
    """ln c = -sqrt(absorption) p(radial), with p(0) = 5.969; half melanin is a concentration of ln 2."""
    color = np.array([0.9, 0.5, 0.0])
    found = absorb_by_color(color, 0.0)
    np.testing.assert_allclose(np.exp(-np.sqrt(found[:2]) * 5.969), color[:2], rtol=1e-12)
    assert np.isfinite(found).all()
    np.testing.assert_allclose(absorb_by_melanin(0.5, 0.0), np.log(2) * np.array([0.506, 0.841, 1.653]))
    np.testing.assert_allclose(absorb_by_melanin(0.5, 1.0), np.log(2) * np.array([0.343, 0.733, 1.924]))
    assert not absorb_by_melanin(0.0, 0.7).any()
    assert (absorb_by_melanin(1.0, 0.0) < 20).all()


def test_frames_stand_even_where_a_strand_is_seen_from_its_end():
    tangent, normal = repeat((0.0, 0.0, 1.0), 1), repeat((0.0, 0.0, 1.0), 1)
    y, z = make_strand_frame(tangent, tangent)
    np.testing.assert_allclose([dot(y, y)[0], dot(z, z)[0], dot(y, z)[0]], [1, 1, 0], atol=1e-15)
    missing = find_tangents(np.zeros((1, 3)), normal)
    assert dot(missing, normal)[0] == 0
    assert dot(missing, missing)[0] == pytest.approx(1)
    for lobes in (make_chiang(1, tangent=(0, 0, 1)), replace(make_cauchy(1, True), tangent=tangent)):
        value, density = lobes.evaluate(normal, repeat((0.6, 0.0, -0.8), 1))
        assert np.isfinite(value).all()
        assert np.isfinite(density).all()


def test_angles_are_those_of_the_view():
    """Seen from o, its azimuth is -90 degrees: the frame's z points into the strand."""
    hair = make_chiang(1)
    angles = find_angles(hair, view(0.5, 1), view(0.5, 1))
    assert angles.sine[0] == pytest.approx(np.sin(0.5))
    assert angles.azimuth[0] == pytest.approx(-np.pi / 2)


def test_sphere_quadratures_agree():
    total, density = integrate(lambda count: make_chiang(count, 0.4, 0.2, 0.5, 0.5), 0.4, around_strand())
    other, _ = integrate(lambda count: make_chiang(count, 0.4, 0.2, 0.5, 0.5), 0.4, sphere_quadrature())
    np.testing.assert_allclose(total, other, rtol=1e-5)
    assert density == pytest.approx(1.0, abs=1e-6)
