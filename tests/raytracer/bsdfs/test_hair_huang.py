"""Hair after Huang: energies of smooth strands by ray tracing, values against samples and quadrature, mixtures."""

from dataclasses import replace

import numpy as np
import pytest

from raytracer.bsdfs.bounce_kinds import GLOSSY
from raytracer.bsdfs.bsdf import evaluate_bsdf, lobe_probabilities
from raytracer.bsdfs.bsdf_samples import sample_bsdf
from raytracer.bsdfs.distributions import facet_density, shadowing
from raytracer.bsdfs.fresnel import dielectric_reflectance, refract
from raytracer.bsdfs.hair_huang import HuangHair
from raytracer.bsdfs.microfacet_albedo import read_glass
from raytracer.lecture import dot
from tests.raytracer.bsdfs.test_hair import FINE, around_strand, make_chiang, repeat, shade, view

IOR = 1.55


def make_huang(count, roughness=0.3, absorption=0.0, aspect=1.0, tilt=0.0, gains=1.0, across=0.0, coverage=1.0):
    """Strands along x that are looked at from above; elliptic ones have their longer axis halfway between y and z."""

    def spread(value):
        return np.full(count, float(value))

    return HuangHair(
        hit=np.arange(count),
        weight=np.ones((count, 3)),
        normal=repeat((0.0, 0.0, 1.0), count),
        tangent=repeat((1.0, 0.0, 0.0), count),
        absorption=repeat(np.broadcast_to(absorption, (3,)), count),
        gains=repeat(np.broadcast_to(gains, (3,)), count),
        axis=repeat((0.0, 1.0, 1.0) if aspect < 1 else (0.0, 0.0, 0.0), count),
        across=spread(across),
        coverage=spread(coverage),
        roughness=spread(roughness),
        aspect=spread(aspect),
        tilt=spread(tilt),
        ior=spread(IOR),
        chance=np.random.default_rng(count).random(count),
    )


def sample(hair, theta, seed=1):
    rng = np.random.default_rng(seed)
    return hair.sample(view(theta, len(hair)), rng.random(len(hair)), rng.random((len(hair), 2)))


def find_cells(directions):
    """One of 16 cells: 2 along the strand, 8 around it."""
    around = (np.arctan2(directions[:, 2], directions[:, 1]) / (2 * np.pi) % 1) * 8
    return np.minimum(around.astype(int), 7) + 8 * (directions[:, 0] > 0)


@pytest.mark.parametrize("theta", [0.0, 0.9])
@pytest.mark.parametrize(("roughness", "aspect"), [(0.05, 1.0), (0.3, 1.0), (0.8, 1.0), (0.3, 0.6)])
def test_hair_that_absorbs_nothing_sends_on_all_light(roughness, aspect, theta):
    """But for what facets' tables give back too much of: a hundredth, of rough ones some more."""
    weight = sample(make_huang(40_000, roughness, aspect=aspect), theta).weight.mean(axis=1)
    error = 4.5 * weight.std() / np.sqrt(len(weight))
    assert 0.985 - error < weight.mean() < 1.01 + 0.1 * roughness + error


def trace_smooth(across, theta, aspect, absorption):
    """Trace a smooth strand by geometry alone: energies and directions of R, TT and TRT, for h in -1 to 1.

    In the plane of the cross section, x along the longer axis; seen from (sin a, cos a), a = 135 degrees.
    """
    a = 3 * np.pi / 4 if aspect < 1 else 0.0
    to_viewer = np.array([np.sin(a) * np.cos(theta), np.sin(theta), np.cos(a) * np.cos(theta)])
    side = np.array([np.cos(a), 0.0, -np.sin(a)])
    radius = np.sqrt((side[0]) ** 2 + (aspect * side[2]) ** 2)
    squeeze = np.array([1.0, 0.0, 1.0 / aspect])
    point = np.outer(across * radius, side)

    def meet(point, direction, last):
        """Where a line meets x^2 + (z / b)^2 = 1, first or last; and the normal there."""
        p, d = point * squeeze, direction * squeeze
        half, square = dot(p, d) / dot(d, d), (1.0 - dot(p, p)) / dot(d, d)
        step = -half + (1 if last else -1) * np.sqrt(np.maximum(half**2 + square, 0.0))
        place = point + step[:, None] * direction
        normal = place * squeeze**2
        return place, normal / np.linalg.norm(normal, axis=1)[:, None]

    view_many = np.broadcast_to(to_viewer, point.shape)
    eta = np.full(len(point), IOR)
    place, normal = meet(point, -view_many, last=False)
    f = dielectric_reflectance(np.clip(dot(view_many, normal), 0, 1), eta)
    inner = refract(view_many, normal, eta)
    results = [(f, 2 * dot(view_many, normal)[:, None] * normal - view_many)]
    light = 1 - f
    for _ in range(2):
        end, normal = meet(place, inner, last=True)
        light = light * np.exp(-absorption * np.linalg.norm(end - place, axis=1))
        cosine = dot(inner, normal)
        f = dielectric_reflectance(np.clip(cosine, 0, 1), 1 / eta)
        results.append((light * (1 - f), refract(-inner, -normal, 1 / eta)))
        light, inner, place = light * f, inner - 2 * cosine[:, None] * normal, end
    return results


@pytest.mark.parametrize("aspect", [1.0, 0.6])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_smooth_strands_send_light_where_rays_go(order, aspect):
    """Each way by itself, over the whole width, against rays that are traced through the cross section."""
    theta, absorption, count = 0.4, 0.3, 60_000
    energy, direction = trace_smooth(np.linspace(-1, 1, 40_001)[1::2], theta, aspect, absorption)[order]
    # The frame: x across the strand, y along it, z up; strands here lie along x, their longer axis along (0, 1, 1).
    z = np.array([0.0, 1.0, -1.0]) / np.sqrt(2) if aspect < 1 else np.array([0.0, 0.0, 1.0])
    x = np.array([0.0, 1.0, 1.0]) / np.sqrt(2) if aspect < 1 else np.array([0.0, -1.0, 0.0])
    axes = np.array([x, [1.0, 0.0, 0.0], np.cross(x, [1.0, 0.0, 0.0])])
    assert abs(axes[2] @ z) == pytest.approx(1)
    expected = np.bincount(find_cells(direction @ axes), energy, 16) / len(energy)
    gains = np.eye(3)[order]
    found = sample(make_huang(count, 0.002, absorption, aspect, gains=gains), theta)
    # What leaves later has no gain: it is taken away.
    rest = sample(make_huang(count, 0.002, absorption, aspect, gains=0.0), theta, seed=2)
    cells = [np.bincount(find_cells(each.direction), each.weight[:, 0], 16) / count for each in (found, rest)]
    noise = [np.bincount(find_cells(each.direction), each.weight[:, 0] ** 2, 16) / count**2 for each in (found, rest)]
    assert (np.abs(cells[0] - cells[1] - expected) < 4.5 * np.sqrt(sum(noise)) + 3e-3).all()
    assert expected.sum() == pytest.approx((found.weight[:, 0].mean() - rest.weight[:, 0].mean()), abs=3e-3)


@pytest.mark.parametrize(
    ("roughness", "aspect", "theta"), [(0.3, 1.0, 0.5), (0.6, 1.0, -0.9), (0.3, 0.6, 0.4), (0.15, 1.0, 0.0)]
)
def test_values_are_the_means_of_samples(roughness, aspect, theta):
    """In each of 16 cells of directions, where scales do not tilt."""
    count, rng = 60_000, np.random.default_rng(4)
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    hair = make_huang(count, roughness, (0.1, 0.6, 2.0), aspect)
    value = 4 * np.pi * hair.evaluate(view(theta, count), direction)[0]
    found = sample(hair, theta)
    for cell in range(16):
        one, other = (
            value * (find_cells(direction) == cell)[:, None],
            found.weight * (find_cells(found.direction) == cell)[:, None],
        )
        error = np.sqrt((one.var(axis=0) + other.var(axis=0)) / count)
        assert (np.abs(one.mean(axis=0) - other.mean(axis=0)) < 4.5 * error + 1e-4).all()


@pytest.mark.parametrize("tilt", [0.0, 0.1])
def test_reflection_is_its_integral(tilt):
    """F D G / 4 over the angles that are seen, by the midpoint rule, over the cosine of the view and the width."""
    theta, alpha, count = 0.5, 0.3, 4000
    incoming = np.array([-0.3, 0.4, 0.8]) / np.linalg.norm([-0.3, 0.4, 0.8])
    o = np.array([np.sin(theta), 0.0, np.cos(theta)])
    angle = (np.arange(4000) + 0.5) / 4000 * np.pi - np.pi / 2
    # The node's tilt leans scales to the root.
    facets = np.stack([np.full(4000, -np.sin(tilt)), np.sin(angle) * np.cos(tilt), np.cos(angle) * np.cos(tilt)], 1)
    half = (o + incoming) / np.linalg.norm(o + incoming)
    before, behind = facets @ o, facets @ incoming
    plain = facets * [0, 1, 1]
    seen = (before > 0) & (behind > 0) & (plain @ o > 0) & (plain @ incoming > 0)
    g = 1 / (1 + shadowing(np.full(4000, alpha), before) + shadowing(np.full(4000, alpha), behind))
    scale = 1 / read_glass(np.full(4000, np.sqrt(alpha)), np.clip(before, 0, 1), np.full(4000, IOR))[0]
    f = dielectric_reflectance(np.array([half @ o]), np.array([IOR]))[0]
    exact = (seen * facet_density(alpha, facets @ half) * g * scale).mean() * np.pi * f / 4 / (2 * np.cos(theta))
    hair = make_huang(count, alpha, 50.0, tilt=tilt, gains=(1, 0, 0))
    value = hair.evaluate(repeat(o, count), repeat(incoming, count))[0][:, 0]
    assert abs(value.mean() - exact) < 4.5 * value.std() / np.sqrt(count) + 1e-4 * exact


def test_reflection_is_reciprocal():
    """Where little is lost between facets, the value times the cosine of the view is the same both ways."""
    count = 3000
    one, other = view(0.6, count), repeat(np.array([-0.2, 0.6, 0.5]) / np.linalg.norm([-0.2, 0.6, 0.5]), count)
    hair = make_huang(count, 0.1, 50.0, gains=(1, 0, 0))
    there = hair.evaluate(one, other)[0][:, 0] * np.sqrt(1 - one[:, 0] ** 2)
    back = hair.evaluate(other, one)[0][:, 0] * np.sqrt(1 - other[:, 0] ** 2)
    assert there.mean() == pytest.approx(back.mean(), rel=0.01)


def test_near_strands_make_up_far_ones():
    """The mean over the places across a strand, each a hundredth of its width, is the strand seen from afar."""
    count = 20_000
    across = (np.arange(count) + 0.5) / count * 2 - 1
    outgoing, incoming = view(0.3, count), repeat((0.2, 0.9, -0.4), count)
    incoming /= np.linalg.norm(incoming, axis=1)[:, None]
    near = replace(make_huang(count, 0.3, 0.4, coverage=0.01), across=across)
    far = make_huang(count, 0.3, 0.4)
    values = [hair.evaluate(outgoing, incoming)[0][:, 0] for hair in (near, far)]
    error = np.sqrt(sum(value.var() for value in values) / count)
    assert abs(values[0].mean() - values[1].mean()) < 4.5 * error + 0.005 * values[1].mean()
    taken = sample(near, 0.3)
    sides = np.where(taken.direction[:, 1] * across < 0, 1, 0)
    assert 0.2 < sides.mean() < 0.8


@pytest.mark.parametrize("tilt", [-0.3, 0.3])
def test_tilted_scales_lean_the_highlight(tilt):
    """Mirrors that lean by -a at the angle g around a strand, seen across it, send light to 2 cos g cos a sin -a along
    it: the mean, weighed by what they reflect, over the width."""
    found = sample(make_huang(20_000, 0.005, 50.0, tilt=tilt, gains=(1, 0, 0)), 0.0)
    mean = (found.direction[:, 0] * found.weight[:, 0]).sum() / found.weight[:, 0].sum()
    cosine = np.sqrt(1 - ((np.arange(4000) + 0.5) / 2000 - 1) ** 2)
    f = dielectric_reflectance(cosine * np.cos(tilt), np.full(4000, IOR))
    expected = -2 * np.sin(tilt) * np.cos(tilt) * (cosine * f).sum() / f.sum()
    assert mean == pytest.approx(expected, rel=0.02)


def test_mixed_with_others_samples_are_right_on_average():
    """With Chiang's hair and a matte part: the mean weight is all that the surface sends on."""
    count, rng = 60_000, np.random.default_rng(9)
    outgoing = view(0.3, count)
    huang, chiang = make_huang(count, 0.4, 0.5), make_chiang(count, absorption=0.3)
    shading = replace(shade(huang, outgoing), lobes=(huang, chiang), diffuse=np.full((count, 3), 0.4))
    probabilities = lobe_probabilities(shading, with_diffuse=True)
    found = sample_bsdf(shading, probabilities, rng.random(count), rng.random((count, 2)))
    directions, weights = around_strand(*FINE)
    part = make_chiang(len(directions), absorption=0.3).evaluate(view(0.3, len(directions)), directions)[0]
    expected = (part * weights[:, None]).sum(axis=0)[0] + 0.4 + sample(huang, 0.3).weight[:, 0].mean()
    weight = found.weight[:, 0]
    assert abs(weight.mean() - expected) < 6 * weight.std() / np.sqrt(count) + 1e-3
    assert np.isfinite(found.density).all()
    # Against light that is looked for, both ways tell the same density.
    alive = found.alive
    _, density = evaluate_bsdf(shading, probabilities, found.direction)
    np.testing.assert_allclose(found.density[alive], density[alive], rtol=1e-12)


def test_walks_are_reflections_of_density_one():
    found = sample_bsdf(
        shading := shade(make_huang(500), view(0.2, 500)),
        lobe_probabilities(shading),
        np.random.default_rng(1).random(500),
        np.random.default_rng(2).random((500, 2)),
    )
    assert set(found.kind[found.alive].tolist()) == {GLOSSY}
    assert (found.density[found.alive] == 1.0).all()
    np.testing.assert_allclose(np.linalg.norm(found.direction, axis=1), 1.0, rtol=1e-12)


def test_values_do_not_depend_on_their_batch():
    hair = make_huang(300, 0.2, 0.3)
    directions, _ = around_strand()
    outgoing, incoming = view(0.3, 300), directions[:: len(directions) // 300][:300]
    together, _ = hair.evaluate(outgoing, incoming)
    rows = np.arange(17, 60)
    alone, _ = hair.select(rows).evaluate(outgoing[rows], incoming[rows])
    np.testing.assert_array_equal(alone, together[rows])


def test_strands_seen_from_their_end_are_finite():
    hair = make_huang(200, 0.3, 0.2, tilt=0.1)
    along = repeat((1.0, 0.0, 0.0), 200)
    directions, _ = around_strand()
    directions = directions[:: len(directions) // 200][:200]
    for outgoing, incoming in ((along, directions), (directions, along), (along, along)):
        assert np.isfinite(hair.evaluate(outgoing, incoming)[0]).all()
    found = hair.sample(along, np.linspace(0, 1, 200, endpoint=False), np.full((200, 2), 0.3))
    assert np.isfinite(found.direction).all()
    assert np.isfinite(found.weight).all()


def test_blur_makes_hair_rougher_and_only_rougher():
    hair = make_huang(3, 0.3)
    np.testing.assert_array_equal(hair.blur(np.array([0.1, 0.3, 0.6])).roughness, [0.3, 0.3, 0.6])
