"""Holdout closures: shares of alpha in closed form, and what is behind and beside them."""

import numpy as np
import pytest

import raytracer
from raytracer import Camera, Closure, Material, Mesh, Scene, World

SHINE, BACKGROUND = 0.75, 0.25


def render(closures, transparent, passes=("Combined",)):
    quad = Mesh([(-9, -9, -1), (9, -9, -1), (9, 9, -1), (-9, 9, -1)], [(0, 1, 2), (0, 2, 3)])
    scene = Scene(
        meshes=[quad], materials=[Material(closures)], world=World((BACKGROUND,) * 3), camera=Camera(np.eye(4))
    )
    return raytracer.render(scene, 4, 4, 2, transparent=transparent, passes=passes)


@pytest.mark.parametrize("share", [0.0, 0.25, 1.0])
def test_alpha_is_what_the_holdout_leaves(share):
    closures = [Closure("holdout", weight=share), Closure("emission", color=SHINE, weight=1.0 - share)]
    picture = render(closures, transparent=True)["Combined"]
    np.testing.assert_allclose(picture[..., 3], 1.0 - share, rtol=1e-6)
    np.testing.assert_allclose(picture[..., :3], SHINE * (1.0 - share), rtol=1e-6)


def test_holes_are_black_and_holes_in_a_picture_with_a_background_too():
    picture = render([Closure("holdout")], transparent=False)["Combined"]
    assert (picture == 0).all()


def test_holes_and_what_is_transparent_share_the_background():
    closures = [Closure("holdout", weight=0.25), Closure("transparent", color=1.0, weight=0.5)]
    picture = render(closures, transparent=True)["Combined"]
    np.testing.assert_allclose(picture[..., 3], 0.25, rtol=1e-6)
    picture = render(closures, transparent=False)["Combined"]
    np.testing.assert_allclose(picture[..., :3], 0.5 * BACKGROUND, rtol=1e-6)


@pytest.mark.parametrize(("share", "seen"), [(1.0, False), (0.5, True)])
def test_what_is_nothing_but_a_hole_is_in_no_pass(share, seen):
    closures = [Closure("holdout", weight=share), Closure("diffuse", weight=1.0 - share)]
    film = render(closures, True, ("Combined", "Depth", "Normal"))
    assert (np.isfinite(film["Depth"]) & (film["Depth"] < 1e9)).all() == seen
    assert (film["Normal"] != 0).any() == seen
