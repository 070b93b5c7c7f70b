"""Panoramic projections: poles, seams and rims by hand, lengths in exact arithmetic, and the way back."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

import raytracer
from raytracer.film.camera import find_on_film, primary_rays
from raytracer.film.panorama import PROJECTIONS, find_directions, normalize_exactly, place_eye
from raytracer.rendering.progressive import coarsen
from raytracer.scene.camera import PANORAMAS, Camera, Panorama

WIDTH, HEIGHT = 48, 30
EPSILON = float(np.finfo(np.float64).eps)
# cos = 0.6, sin = 0.8.
TURNED = np.array([[0.6, 0.0, 0.8, 10.0], [0.0, 1.0, 0.0, -20.0], [-0.8, 0.0, 0.6, 30.0], [0.0, 0.0, 0.0, 1.0]])


def make_camera(kind: str, **fields: Any) -> Camera:
    names = {"longitude", "latitude", "field_of_view", "lens", "polynomial", "cylinder", "span"}
    panorama = Panorama(kind, **{name: fields.pop(name) for name in names & set(fields)})
    return Camera(**{"world_from_camera": np.eye(4), **fields}, projection="panorama", panorama=panorama)


def look(camera: Camera, u: float, v: float) -> np.ndarray:
    """Return the direction at a place of the picture, 0 to 1."""
    return find_directions(camera, WIDTH, HEIGHT, np.array([u * WIDTH]), np.array([v * HEIGHT]))[0]


def make_pixels() -> tuple[np.ndarray, np.ndarray]:
    """Points all over the picture, its corners, edges and middle among them."""
    x, y = np.meshgrid(np.linspace(0, WIDTH, 33), np.linspace(0, HEIGHT, 21))
    return x.ravel(), y.ravel()


def test_every_kind_has_its_projection() -> None:
    assert set(PROJECTIONS) == set(PANORAMAS)


@pytest.mark.parametrize("kind", PANORAMAS)
def test_middle_of_the_picture_looks_along_the_axis(kind: str) -> None:
    np.testing.assert_allclose(look(make_camera(kind), 0.5, 0.5), (0, 0, -1), atol=EPSILON)


AHEAD, BACK, LEFT, RIGHT, UP, DOWN = (0, 0, -1), (0, 0, 1), (-1, 0, 0), (1, 0, 0), (0, 1, 0), (0, -1, 0)
SQUARE = {"sensor_width": 20.0, "lens": 10.0 / (2.0 * np.sin(np.pi / 4)), "field_of_view": np.pi}


@pytest.mark.parametrize(
    ("kind", "fields", "u", "v", "direction"),
    [
        ("equirectangular", {}, 0.0, 0.5, BACK),
        ("equirectangular", {}, 1.0, 0.5, BACK),  # the seam
        ("equirectangular", {}, 0.75, 0.5, RIGHT),
        ("equirectangular", {}, 0.3, 1.0, UP),  # the poles, all along the edge
        ("equirectangular", {}, 0.9, 0.0, DOWN),
        ("equirectangular", {"longitude": (0.0, np.pi / 2)}, 1.0, 0.5, RIGHT),
        ("cylinder", {}, 0.25, 0.5, LEFT),
        ("cylinder", {"cylinder": (-1.0, 1.0, 0.0, 1.0)}, 0.5, 1.0, (0, np.sqrt(0.5), -np.sqrt(0.5))),
        ("cube_face", {}, 1.0, 0.5, (np.sqrt(0.5), 0, -np.sqrt(0.5))),
        ("cube_face", {}, 1.0, 1.0, (np.sqrt(1 / 3), np.sqrt(1 / 3), -np.sqrt(1 / 3))),
        ("mirror_ball", {}, 0.5 + np.sqrt(0.125), 0.5, RIGHT),  # a normal of 45 degrees
        ("mirror_ball", {}, 0.5, 1.0, BACK),  # the rim
        ("fisheye_equidistant", {}, 1.0, 0.5, RIGHT),
        ("fisheye_equidistant", {}, 0.5, 0.75, (0, np.sqrt(0.5), -np.sqrt(0.5))),
        ("fisheye_equidistant", {"field_of_view": 2 * np.pi}, 0.5, 0.0, BACK),
        ("fisheye_polynomial", {"polynomial": (0, -np.pi / 36, 0, 0, 0)}, 1.0, 0.5, RIGHT),  # 18 mm from the middle
        ("fisheye_polynomial", {"polynomial": (0, np.pi / 36, 0, 0, 0)}, 1.0, 0.5, LEFT),
    ],
)
def test_poles_seams_and_rims_are_where_they_belong(
    kind: str, fields: dict[str, Any], u: float, v: float, direction: tuple[float, ...]
) -> None:
    np.testing.assert_allclose(look(make_camera(kind, **fields), u, v), direction, atol=4 * EPSILON)


def test_equal_areas_of_an_equisolid_picture_are_equal_solid_angles() -> None:
    """A cap of the angle theta has the solid angle 2 pi (1 - cos theta) = 4 pi sin^2(theta / 2), here pi r^2 / f^2."""
    camera = make_camera("fisheye_equisolid", lens=10.0, sensor_width=40.0, field_of_view=2.0 * np.pi)
    radius = np.linspace(0.0, 0.499, 40)
    directions = find_directions(camera, 100, 100, 100 * (0.5 + radius), np.full(40, 50.0))
    solid_angle = 2.0 * np.pi * (1.0 + directions[:, 2])
    np.testing.assert_allclose(solid_angle, np.pi * (40.0 * radius / 10.0) ** 2, rtol=1e-12, atol=16 * EPSILON)


@pytest.mark.parametrize("kind", PANORAMAS)
def test_directions_have_a_length_of_one_to_an_ulp(kind: str) -> None:
    """In exact arithmetic, of rays in world space too, whose matrix is rounded."""
    x, y = make_pixels()
    camera = make_camera(kind, world_from_camera=TURNED)
    for directions in (
        find_directions(camera, WIDTH, HEIGHT, x, y),
        primary_rays(camera, WIDTH, HEIGHT, x, y).directions,
    ):
        for direction in directions[directions.any(axis=1)]:
            square = sum(Fraction(value) ** 2 for value in direction.tolist())
            assert abs(square - 1) <= 2 * Fraction(EPSILON)  # |d|^2 is off by twice as much as |d|


def test_lengths_come_out_right_from_any_length() -> None:
    random = np.random.default_rng(5)
    vectors = random.normal(size=(500, 3)) * 10.0 ** random.uniform(-100, 100, size=(500, 1))
    vectors[:10, 0] = 0.0
    vectors[10] = 0.0
    unit = normalize_exactly(vectors)
    assert not unit[10].any()
    worst = max(abs(sum(Fraction(value) ** 2 for value in one) - 1) for one in np.delete(unit, 10, axis=0).tolist())
    assert worst <= 2 * Fraction(EPSILON)


LENSES = {"fisheye_polynomial": {"polynomial": (-1e-5, -0.06, 0.0, 2e-5, 0.0)}, "equirectangular": {"shift_x": 0.1}}


@pytest.mark.parametrize("kind", PANORAMAS)
def test_what_a_point_shows_is_found_there_again(kind: str) -> None:
    x, y = make_pixels()
    inside = (x > 6) & (x < WIDTH - 6) & (y > 0) & (y < HEIGHT)
    camera = make_camera(kind, **LENSES.get(kind, {}))
    directions = find_directions(camera, WIDTH, HEIGHT, x[inside], y[inside])
    seen = directions.any(axis=1)
    assert seen.mean() > 0.4
    found = find_on_film(camera, WIDTH, HEIGHT, 7.0 * directions[seen])
    # Near the rim of a ball a picture's point moves as the square root of its direction.
    bound = 1e-6 if kind == "mirror_ball" else 1e-9
    np.testing.assert_allclose(found, (x[inside][seen], y[inside][seen]), atol=bound)


@pytest.mark.parametrize("kind", PANORAMAS)
def test_a_point_is_found_with_the_same_bits_among_others(kind: str) -> None:
    camera = make_camera(kind, **LENSES.get(kind, {}))
    points = np.random.default_rng(7).normal(size=(300, 3))
    alone = [find_on_film(camera, WIDTH, HEIGHT, points[row : row + 1]) for row in range(len(points))]
    found = find_on_film(camera, WIDTH, HEIGHT, points)
    np.testing.assert_array_equal(found, np.concatenate(alone, axis=1))


@pytest.mark.parametrize("kind", PANORAMAS)
def test_coarse_pixels_look_where_the_fine_ones_look(kind: str) -> None:
    camera = make_camera(kind, shift_y=0.1, sensor_height=20.0)
    coarse = coarsen(camera, WIDTH, HEIGHT, 7)
    x, y = (place + 0.0123 for place in make_pixels())  # none on a rim, where rounding decides
    fine = find_directions(camera, WIDTH, HEIGHT, x, y)
    np.testing.assert_allclose(find_directions(coarse, 7, 5, x / 7, y / 7), fine, atol=1e-12)


def test_rays_start_behind_the_near_clip_and_count_metres() -> None:
    camera = make_camera("equirectangular", world_from_camera=TURNED, clip_start=0.5, clip_end=20.0)
    wall = raytracer.Mesh([(10 - 9, -29, 25), (10 + 9, -29, 25), (10, -2, 25)], [(0, 1, 2)])
    scene = raytracer.Scene(meshes=[wall], camera=camera)
    film = raytracer.render(scene, 32, 16, 1, passes=("Depth", "Position"))
    seen = film["Depth"][..., 0] < 1e9
    distance = np.linalg.norm(film["Position"].astype(float) - TURNED[:3, 3], axis=-1)
    assert 20 < seen.sum() < 200
    np.testing.assert_allclose(film["Depth"][seen][:, 0], distance[seen], rtol=1e-6)
    assert distance[seen].max() <= 20.0 + 1e-5


def test_rays_through_a_lens_meet_at_the_distance_of_focus() -> None:
    camera = make_camera("equirectangular", aperture_radius=0.3, focus_distance=4.0)
    random = np.random.default_rng(7)
    x, y = np.full(200, 9.0), np.full(200, 22.0)
    rays = primary_rays(camera, WIDTH, HEIGHT, x, y, random.random((200, 2)))
    middle = find_directions(camera, WIDTH, HEIGHT, x[:1], y[:1])[0]
    focus = 4.0 * middle
    along = np.linalg.norm(focus - rays.origins, axis=1)
    np.testing.assert_allclose(
        rays.origins + along[:, np.newaxis] * rays.directions, np.tile(focus, (200, 1)), atol=1e-14
    )
    assert 0.25 < np.linalg.norm(rays.origins, axis=1).max() <= 0.3
    np.testing.assert_allclose(rays.origins @ middle, 0.0, atol=1e-15)


def test_picture_outside_of_the_lens_is_black_and_opaque_and_casts_nothing() -> None:
    camera = make_camera("fisheye_equidistant", field_of_view=1.0)
    scene = raytracer.Scene(camera=camera, world=raytracer.World((1.0, 1.0, 1.0)))
    film = raytracer.render(scene, 20, 20, 2, pixel_filter="box", filter_width=0.5, passes=("Combined", "Depth"))
    row, column = np.mgrid[0:20, 0:20] + 0.5
    radius = np.hypot(row - 10, column - 10)
    outside, inside = radius > 11, radius < 9
    np.testing.assert_array_equal(film["Combined"][outside], np.tile((0, 0, 0, 1), (outside.sum(), 1)))
    np.testing.assert_array_equal(film["Combined"][inside], np.ones((inside.sum(), 4)))
    assert (film["Depth"] == np.float32(1e10)).all()
    assert film.statistics.rays < 3 * 0.85 * 400


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"kind": "square"}, "Panorama: kind: expected one of"),
        ({"field_of_view": 0.0}, "Panorama: field_of_view: expected"),
        ({"polynomial": (0.0, 1.0)}, "Panorama: polynomial: expected"),
        ({"latitude": (0.0, np.inf)}, "Panorama: latitude: expected"),
        ({"span": (0.0, 1.0)}, "Panorama: span: expected"),
    ],
)
def test_bad_panoramas_are_refused_by_name(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Panorama(**fields)


def test_panorama_belongs_to_a_panoramic_camera() -> None:
    for camera in (make_camera("cube_face"), Camera(np.eye(4))):
        other = None if camera.panorama else Panorama()
        with pytest.raises(ValueError, match=r"^Camera: panorama: expected a Panorama where"):
            replace(camera, panorama=other)


def test_panoramic_camera_leaves_and_enters_a_file(tmp_path: Any) -> None:
    camera = make_camera("fisheye_polynomial", polynomial=(0.1, -0.05, 0.01, 0.0, 0.0), field_of_view=2.5)
    raytracer.save(raytracer.Scene(camera=camera), tmp_path / "scene.npz")
    panorama = raytracer.load(tmp_path / "scene.npz").camera.panorama
    assert (panorama.kind, panorama.polynomial, panorama.field_of_view) == (
        "fisheye_polynomial", (0.1, -0.05, 0.01, 0.0, 0.0), 2.5,
    )  # fmt: skip


# Eyes that turn with the direction they look in ----------------------------------------------------------------------


def look_with_eyes(offset=0.3, **fields):
    """Return the rays of an equirectangular picture without an eye's offset, and with it."""
    x, y = (values.ravel() for values in np.meshgrid(np.linspace(0.5, 31.5, 32), np.linspace(0.5, 15.5, 16)))
    panoramas = (raytracer.Panorama(), raytracer.Panorama(eye_offset=offset, **fields))
    return [
        primary_rays(raytracer.Camera(np.eye(4), projection="panorama", panorama=panorama), 32, 16, x, y)
        for panorama in panoramas
    ]


def test_an_eye_stands_beside_the_camera_square_to_what_it_looks_at():
    middle, eye = look_with_eyes()
    np.testing.assert_array_equal(eye.directions, middle.directions)
    np.testing.assert_allclose(np.linalg.norm(eye.origins, axis=1), 0.3, rtol=1e-14)
    np.testing.assert_array_equal(eye.origins[:, 1], 0.0)
    np.testing.assert_allclose((eye.origins * middle.directions).sum(axis=1), 0.0, atol=1e-15)
    ahead = np.argmin(middle.directions[:, 2])
    assert eye.origins[ahead, 0] > 0.29


def test_eyes_that_converge_look_at_the_point_at_that_distance():
    middle, eye = look_with_eyes(convergence=2.0)
    distance = np.sqrt(2.0**2 + 0.3**2)
    np.testing.assert_allclose(eye.origins + distance * eye.directions, 2.0 * middle.directions, atol=1e-14)


def test_towards_the_poles_eyes_come_to_the_cameras_place():
    middle, eye = look_with_eyes(pole_merge=(0.4, 1.0))
    altitude = np.abs(np.arcsin(middle.directions[:, 1]))
    offset = np.linalg.norm(eye.origins, axis=1)
    np.testing.assert_allclose(offset[altitude < 0.4], 0.3, rtol=1e-14)
    np.testing.assert_allclose(offset[altitude > 1.0], 0.0, atol=1e-16)
    between = (altitude > 0.4) & (altitude < 1.0)
    np.testing.assert_allclose(offset[between], 0.3 * np.cos((altitude[between] - 0.4) / 0.6 * np.pi / 2), rtol=1e-12)


def test_straight_up_an_eye_has_no_side():
    eye, direction = place_eye(raytracer.Panorama(eye_offset=0.3, convergence=2.0), np.array([[0.0, 1.0, 0.0]]))
    np.testing.assert_array_equal(eye, np.zeros((1, 3)))
    np.testing.assert_array_equal(direction, [[0.0, 1.0, 0.0]])
