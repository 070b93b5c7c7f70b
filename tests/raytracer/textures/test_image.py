"""Image textures against plain loops over pixels, and tangents against what they are by definition."""

import numpy as np
import pytest

from raytracer import Image, Mesh, TiledImage
from raytracer.shading.nodes.images import weigh_sides
from raytracer.surfaces.tangents import make_tangents
from raytracer.textures.image import EXTENSIONS, decode_srgb, encode_srgb, find_tiles, read_image, sample_image

KERNELS = {
    "Closest": (lambda x: np.where((x >= -0.5) & (x < 0.5), 1.0, 0.0), 1),
    "Linear": (lambda x: np.maximum(1.0 - np.abs(x), 0.0), 2),
    # The uniform cubic B-spline.
    "Cubic": (
        lambda x: np.where(np.abs(x) < 1, 2 / 3 - x**2 + np.abs(x) ** 3 / 2, np.clip(2 - np.abs(x), 0, 2) ** 3 / 6),
        3,
    ),
}


def fold(index, size, extension):
    """Return the pixel that stands for a pixel outside, or None for nothing."""
    if 0 <= index < size:
        return index
    if extension == "REPEAT":
        return index % size
    if extension == "EXTEND":
        return 0 if index < 0 else size - 1
    if extension == "CLIP":
        return None
    while not 0 <= index < size:
        index = -1 - index if index < 0 else 2 * size - 1 - index
    return index


def read_slowly(pixels, u, v, interpolation, extension):
    """Sum all pixels of the endless picture, weighed by the kernel around the point."""
    kernel, reach = KERNELS[interpolation]
    height, width = pixels.shape[:2]
    x, y = u * width - 0.5, v * height - 0.5
    total = np.zeros(4)
    for row in range(int(np.floor(y)) - reach, int(np.floor(y)) + reach + 2):
        for column in range(int(np.floor(x)) - reach, int(np.floor(x)) + reach + 2):
            at = fold(row, height, extension), fold(column, width, extension)
            if None not in at:
                total += kernel(np.float64(column - x)) * kernel(np.float64(row - y)) * pixels[at]
    return total


@pytest.mark.parametrize("interpolation", KERNELS)
@pytest.mark.parametrize("extension", EXTENSIONS)
@pytest.mark.parametrize("size", [(4, 3), (1, 1), (2, 5)])
def test_images_are_read_as_a_loop_over_pixels_says(interpolation, extension, size, rng):
    pixels = rng.random((size[1], size[0], 4)).astype(np.float32)
    uv = rng.uniform(-2.5, 3.5, (200, 2))
    wanted = [read_slowly(pixels.astype(np.float64), u, v, interpolation, extension) for u, v in uv]
    np.testing.assert_allclose(read_image(Image(pixels), uv, interpolation, extension), wanted, atol=1e-14)


@pytest.mark.parametrize("interpolation", ["Closest", "Linear", "Cubic"])
def test_interpolation_of_a_constant_is_that_constant(interpolation, rng):
    image = Image(np.full((3, 4, 4), 51, np.uint8))
    np.testing.assert_allclose(read_image(image, rng.random((50, 2)), interpolation, "EXTEND"), 0.2, rtol=1e-14)


def test_far_and_broken_coordinates_are_read_without_complaint():
    uv = np.array([(1e300, -1e300), (np.nan, 0.5), (np.inf, -np.inf), (-1e-300, 1e-300)])
    for extension in EXTENSIONS:
        assert np.isfinite(read_image(Image(np.ones((2, 2, 4), np.float32)), uv, "Cubic", extension)).all()


def test_bytes_are_blended_before_they_are_decoded():
    image = Image(np.array([[[0, 0, 0, 255], [255, 255, 255, 255]]], np.uint8), "srgb")
    found = sample_image(image, np.array([(0.5, 0.5)]), "Linear", "EXTEND")
    np.testing.assert_allclose(found[0, :3], ((0.5 + 0.055) / 1.055) ** 2.4, rtol=1e-14)
    assert found[0, 3] == 1.0


def test_colors_are_divided_by_alpha_before_they_are_decoded():
    image = Image(np.array([[[51, 0, 0, 102], [10, 20, 30, 0]]], np.uint8), "srgb")
    uv = np.array([(0.25, 0.5), (0.75, 0.5)])
    found = sample_image(image, uv, "Closest", "REPEAT", unassociate=True)
    np.testing.assert_allclose(found[0], (decode_srgb(np.array(0.5)), 0.0, 0.0, 0.4))
    np.testing.assert_allclose(found[1, :3], decode_srgb(np.array((10, 20, 30)) / 255))


def test_srgb_is_continuous_and_keeps_0_and_1():
    np.testing.assert_allclose(decode_srgb(np.array((-1.0, 0.0, 1.0))), (0, 0, 1), atol=1e-15)
    below, above = decode_srgb(np.array((np.nextafter(0.04045, 0.0), 0.04045)))
    assert abs(above - below) < 1e-7


def test_weights_of_the_sides_of_a_box_add_up_to_one(rng):
    normals = np.abs(rng.normal(size=(500, 3)))
    for blend in (0.0, 0.2, 0.7, 1.0):
        weights = weigh_sides(normals, blend)
        np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-12)
        assert (weights >= -1e-12).all()
    np.testing.assert_array_equal(weigh_sides(np.eye(3), 0.5), np.eye(3))


# Tiles ---------------------------------------------------------------------------------------------------------------


def make_tiles(rng, numbers=(1001, 1002, 1011, 1012)):
    """Return tiles of different sizes, two by two unless told."""
    sizes = [(2, 3), (4, 1), (5, 2), (1, 1)][: len(numbers)]
    return TiledImage(numbers, [Image(rng.random((*size, 4)).astype(np.float32)) for size in sizes])


@pytest.mark.parametrize("interpolation", KERNELS)
@pytest.mark.parametrize("extension", EXTENSIONS)
def test_a_tile_is_read_alone_by_the_rest_of_the_coordinates(interpolation, extension, rng):
    """Cycles cuts off towards 0: the squares at -1 belong to those at 0, so that 3 x 3 are not magenta."""
    image = make_tiles(rng)
    uv = rng.uniform(-1.9, 2.9, (600, 2))
    wanted = []
    for u, v in uv:
        column, row = int(u), int(v)  # Python's int cuts off as C's does
        if min(u, v) <= -1 or max(u, v) >= 2:
            wanted.append((1, 0, 1, 1))
            continue
        pixels = image.tiles[column + 2 * row].pixels.astype(np.float64)
        wanted.append(read_slowly(pixels, u - column, v - row, interpolation, extension))
    found = sample_image(image, uv, interpolation, extension)
    np.testing.assert_allclose(found, wanted, atol=1e-14)


def test_the_tile_of_a_corner_is_the_one_above_and_to_the_right(rng):
    uv = np.array([(0, 0), (1, 0), (0, 1), (1, 1), (np.nextafter(1, 0), 0), (9.5, 3.5), (10, 0), (-1, 0), (0, -1)])
    numbers, corners = find_tiles(uv)
    np.testing.assert_array_equal(numbers, (1001, 1002, 1011, 1012, 1001, 1040, 0, 0, 0))
    np.testing.assert_array_equal(corners[:6], ((0, 0), (1, 0), (0, 1), (1, 1), (0, 0), (9, 3)))


def test_far_and_broken_coordinates_of_tiles_are_read_without_complaint(rng):
    uv = np.array([(1e300, -1e300), (np.nan, 0.5), (np.inf, -np.inf), (0.5, 1e300), (-1e-300, 1e-300)])
    found = sample_image(make_tiles(rng), uv, "Cubic")
    assert np.isfinite(found).all()
    np.testing.assert_array_equal(found[[0, 2, 3]], np.tile((1.0, 0.0, 1.0, 1.0), (3, 1)))


def test_each_tile_is_decoded_by_its_own_curve():
    pixels = np.full((1, 1, 4), 51, np.uint8)
    image = TiledImage((1001, 1002), (Image(pixels, "srgb"), Image(pixels, "linear")))
    found = sample_image(image, np.array([(0.5, 0.5), (1.5, 0.5)]), unassociate=True)
    np.testing.assert_allclose(found[:, 0], (decode_srgb(np.array(1.0)), 1.0), rtol=1e-14)


@pytest.mark.parametrize("interpolation", KERNELS)
def test_an_image_is_read_to_the_bit_as_the_only_tile_of_its_square(interpolation, rng):
    image, uv = Image(rng.random((3, 4, 4)).astype(np.float32), "srgb"), rng.random((200, 2))
    found = sample_image(image, uv, interpolation, "MIRROR", unassociate=True)
    tiled = sample_image(TiledImage((1001,), (image,)), uv, interpolation, "MIRROR", unassociate=True)
    np.testing.assert_array_equal(found, tiled)


def test_an_image_without_tiles_looks_for_none(rng, monkeypatch):
    monkeypatch.setattr("raytracer.textures.image.find_tiles", None)
    image, uv = Image(rng.random((3, 4, 4)).astype(np.float32)), rng.uniform(-2.0, 3.0, (50, 2))
    np.testing.assert_array_equal(sample_image(image, uv), read_image(image, uv))


# Tangents ------------------------------------------------------------------------------------------------------------


def test_tangents_of_a_flat_sheet_point_along_u(rng):
    """uv = A (x, y) + b: u grows fastest along A's first row, within the sheet along the column of its inverse."""
    positions = np.column_stack([rng.random((30, 2)), np.zeros(30)])
    triangles = rng.permutation(30).reshape(10, 3)
    turn = np.array(((0.8, -0.7), (0.5, 1.1)))
    mesh = Mesh(positions, triangles, normals=np.tile((0.0, 0.0, 1.0), (30, 1)))
    tangents = make_tangents(mesh, positions[:, :2] @ turn.T + 0.3)
    along = np.append(np.linalg.inv(turn)[:, 0], 0.0)
    np.testing.assert_allclose(tangents[..., :3], np.broadcast_to(along / np.linalg.norm(along), (10, 3, 3)), atol=1e-9)


def test_a_mirrored_map_turns_the_bitangent():
    positions = np.array([(0.0, 0, 0), (1, 0, 0), (0, 1, 0)])
    for mirror, sign in ((1.0, 1.0), (-1.0, -1.0)):
        mesh = Mesh(positions, [(0, 1, 2)])
        tangent = make_tangents(mesh, positions[:, :2] * (mirror, 1.0))[0, 0]
        np.testing.assert_allclose(tangent, (mirror, 0, 0, sign), atol=1e-15)


def test_tangents_are_shared_where_position_normal_and_uv_are():
    """Two triangles bent at their common edge, smooth: the corners on it have one tangent, orthogonal to the normal."""
    positions = np.array([(0.0, 0, 0), (0, 1, 0), (1, 0, 0.5), (-1, 0, 0.5)])
    normals = np.tile((0.0, 0.0, 1.0), (4, 1))
    uvs = np.array([(0.5, 0), (0.5, 1), (1, 0), (0, 0)])
    tangents = make_tangents(Mesh(positions, [(0, 2, 1), (0, 1, 3)], normals=normals), uvs)
    np.testing.assert_allclose(tangents[0, 0], tangents[1, 0], atol=1e-15)
    np.testing.assert_allclose(tangents[0, 2], tangents[1, 1], atol=1e-15)
    np.testing.assert_allclose(tangents[0, 0], (1, 0, 0, 1), atol=1e-12)


def test_encoding_undoes_decoding() -> None:
    """Both pieces of the curve, beyond 1 as well; the standard rounds where they meet to 0.04045, which leaves 1e-8."""
    encoded = np.linspace(0.0, 1.5, 1001)
    np.testing.assert_allclose(encode_srgb(decode_srgb(encoded)), encoded, atol=1e-7)
    assert encode_srgb(np.array(-1.0)) == 0.0
