"""What light enters surfaces by, and the media below them."""

import numpy as np
import pytest

from raytracer.bsdfs.subsurface import (
    LARGEST_ALBEDO,
    SKIN_SEARCH_STEPS,
    SMALLEST_ALBEDO,
    Subsurface,
    enter,
    find_medium,
    find_skin_radius,
    split_radii,
)
from raytracer.lecture import dot
from tests.raytracer.bsdfs.half_space import diffuse_albedo


def make_part(count=1, **fields):
    """Return a part of `count` points that face up."""
    values = {"weight": 0.5, "albedo": 0.5, "radius": 1.0, "anisotropy": 0.0, "ior": 1.4, "roughness": 0.3} | fields
    rows = {name: np.full(count, values.get(name, 0.0)) for name in ("anisotropy", "ior", "roughness")}
    colors = {
        name: np.broadcast_to(np.asarray(values[name], float), (count, 3)).copy()
        for name in ("weight", "albedo", "radius")
    }
    flags = {name: np.full(count, bool(fields.get(name))) for name in ("is_skin", "is_similar")}
    return Subsurface(hit=np.arange(count), normal=np.tile([0.0, 0, 1], (count, 1)), **colors, **rows, **flags)


@pytest.mark.parametrize(("similar", "error"), [(False, 0.04), (True, 0.002)])
@pytest.mark.parametrize("color", [0.1, 0.3, 0.5, 0.7, 0.9])
def test_a_thick_slab_has_about_the_color_that_was_asked_for(color, similar, error):
    """Of light that enters as through a matte surface; the fit is off by up to 0.04 where colors are bright."""
    assert abs(diffuse_albedo(color, similar) - color) < error


@pytest.mark.parametrize("is_similar", [False, True])
@pytest.mark.parametrize("anisotropy", [-0.9, 0.0, 0.5, 0.9])
def test_media_stay_within_their_ranges_and_brighter_colors_scatter_more(is_similar, anisotropy):
    color = np.linspace(0.0, 1.0, 60)
    part = make_part(60, albedo=color[:, np.newaxis], weight=1.0, anisotropy=anisotropy, is_similar=is_similar)
    medium, factor = find_medium(part)
    assert (medium.albedo >= SMALLEST_ALBEDO).all()
    assert (medium.albedo <= LARGEST_ALBEDO).all()
    assert (np.diff(medium.albedo[:, 0]) >= 0).all()
    assert (factor >= 0).all()
    assert factor[0, 0] == 0


def test_a_dark_color_has_no_step():
    """Below SMALLEST_ALBEDO it is what enters that is dimmed: light scattered once is as bright on both sides."""
    color = np.linspace(0.01, 0.1, 400)[:, np.newaxis]
    medium, factor = find_medium(make_part(400, albedo=color, weight=color))
    once = (medium.albedo * factor)[:, 0]
    assert medium.albedo.min() == SMALLEST_ALBEDO < medium.albedo.max()
    assert np.abs(np.diff(once)).max() < 0.002


def test_a_reduced_mean_free_path_stays_the_same_in_the_fit_and_the_path_by_similarity():
    for is_similar, stretched in ((False, 1 / (1 - 0.8)), (True, 1.0)):
        plain, sharp = (find_medium(make_part(anisotropy=g, is_similar=is_similar))[0] for g in (0.0, 0.8))
        np.testing.assert_allclose(sharp.extinction, stretched * plain.extinction)


@pytest.mark.parametrize("ior", [1.01, 1.4, 3.8])
def test_skin_has_the_albedo_of_its_dipole(ior):
    color = np.linspace(0.05, 0.95, 19)[:, np.newaxis]
    reduced = 1.0 - find_skin_radius(color, np.full(19, ior)) ** 2 / 3.0
    ends = reduced - 2.0**-SKIN_SEARCH_STEPS, reduced + 2.0**-SKIN_SEARCH_STEPS
    reflected = -1.440 / ior**2 + 0.710 / ior + 0.668 + 0.0636 * ior
    slope = 4 / 3 * (1 + reflected) / (1 - reflected)
    low, high = (
        0.5 * end * (1 + np.exp(-slope * np.sqrt(3 * (1 - end)))) * np.exp(-np.sqrt(3 * (1 - end)))
        for end in (ends[0], np.minimum(ends[1], 1.0))
    )
    assert ((low <= color) & (color <= high)).all()


def test_channels_without_a_radius_stay_at_the_surface():
    inside, matte = split_radii(make_part(2, radius=[[0.0, 1.0, 1e-9], [0.0, 0.0, 0.0]], weight=[0.1, 0.2, 0.3]))
    np.testing.assert_array_equal(matte, [[0.1, 0, 0.3], [0.1, 0.2, 0.3]])
    np.testing.assert_array_equal(inside.hit, [0])
    np.testing.assert_array_equal(inside.weight, [[0, 0.2, 0]])


@pytest.mark.parametrize("ior", [1.01, 1.4, 3.0])
def test_light_enters_a_smooth_surface_by_snells_law(ior):
    outgoing = np.array([[0.6, 0.0, 0.8]])
    direction, enters = enter(
        make_part(ior=ior, roughness=0.0), outgoing, np.array([[0.0, 0, 1]]), np.full((1, 2), 0.3)
    )
    assert enters.all()
    np.testing.assert_allclose(direction[0, :2], [-0.6 / ior, 0.0], atol=1e-12)
    assert direction[0, 2] < 0


def test_half_of_what_enters_skin_is_spread_evenly():
    """Rough facets spread about the refracted direction; of the matte half the mean cosine is 2/3."""
    count, rng = 40000, np.random.default_rng(3)
    part = make_part(count, is_skin=True, roughness=1.0, ior=1.01)
    pair = rng.random((count, 2))
    up = np.tile([0.0, 0, 1], (count, 1))
    direction, enters = enter(part, up, up, pair)
    assert enters.all()
    np.testing.assert_allclose(dot(direction, direction), 1.0, atol=1e-12)
    matte = pair[:, 0] < 0.5
    assert abs(-direction[matte, 2].mean() - 2 / 3) < 4.5 * 0.236 / np.sqrt(matte.sum())
    assert (-direction[~matte, 2]).min() > 0.98
