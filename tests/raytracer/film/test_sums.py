"""What a film holds: as little as it can, and what it tells the error from, against float64."""

import tracemalloc

import numpy as np
import pytest

from raytracer.film import film as film_module
from raytracer.film import film_error, pixel_parts
from raytracer.film.error import find_deviations
from raytracer.film.film import Film
from raytracer.film.film_error import read_deviations
from raytracer.film.film_picture import save_picture
from raytracer.film.pixel_parts import Parts, keep_largest, mean_without, sum_squares, tally_parts
from raytracer.film.sums import ALPHA, DEVIATIONS, DIFFERENCE

UNIT = 2.0**-24


def fill(samples, **fields) -> Film:
    """Return a film a pixel high, whose samples (k, pixels, 4) are given."""
    film = Film(samples.shape[1], 1, ("Combined",), **fields)
    for number, values in enumerate(samples):
        film.add(slice(None), {"Combined": values}, number % 2)
    return film


def draw(rng, *shape):
    """Return samples of light, of which a few are bright, opaque."""
    samples = rng.random((*shape, 4)) ** 4 * 10.0 ** rng.integers(-3, 3, (*shape, 1))
    samples[..., 3] = 1.0
    return samples


def measure_memory(side, count):
    """Return the bytes that a film of side x side holds after so many samples, and those that reading it takes at most
    beside."""
    rows, block = np.random.default_rng(0).random((1 << 14, 4)), 1 << 14
    rows[:, 3] = 1.0
    tracemalloc.start()
    film = Film(side, side, ("Combined",))
    for number in range(count):
        for start in range(0, side * side, block):
            film.add(slice(start, start + block), {"Combined": rows}, number % 2)
        film.samples += 1
    held, peak = tracemalloc.get_traced_memory()
    tracemalloc.reset_peak()
    film.measure_error()
    film.open_pass("Combined")(slice(0, block))
    beside = tracemalloc.get_traced_memory()[1] - held
    tracemalloc.stop()
    return held, peak - held, beside


@pytest.mark.parametrize(("count", "expected"), [(1, 24), (2, 36), (3, 40)])
def test_a_pixel_takes_no_more_bytes_than_its_colors_and_their_error(count, expected):
    """Three colors in float64; in float32 their difference from the second sample on, and how samples scatter from the
    third. What adding, the error and a strip of the picture take beside does not grow with the picture, but for its
    noisiest 1%."""
    small, large = measure_memory(512, count), measure_memory(768, count)
    pixels = 768 * 768 - 512 * 512
    assert (large[0] - small[0]) / pixels == pytest.approx(expected, abs=0.05)
    assert (large[1] - small[1]) / pixels < 0.1
    assert (large[2] - small[2]) / pixels < 3 * 8 * 0.01 + 0.1


def test_a_picture_is_written_a_few_lines_at_a_time(tmp_path):
    """Of 10 channels of 4 bytes no pixel is held beside the sums."""
    film = Film(64, 4096, ("Combined", "Normal", "UV"))
    save_picture(Film(64, 16, film.names), tmp_path / "first.exr")  # what is imported stays
    tracemalloc.start()
    save_picture(film, tmp_path / "picture.exr")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 64 * 4096 * 4


def test_alpha_is_held_where_a_sample_is_not_opaque(rng):
    samples = draw(rng, 6, 9)
    opaque = fill(samples)
    assert ALPHA not in opaque.arrays
    assert (opaque["Combined"][..., 3] == 1.0).all()
    samples[3:, 4, 3] = rng.random(3)
    film = fill(samples)
    expected = samples[0].copy()
    for values in samples[1:]:
        expected += values
    np.testing.assert_array_equal(film["Combined"][0], (expected / 6.0).astype(np.float32))
    assert ALPHA in film.arrays
    # Of the colors nothing changes.
    np.testing.assert_array_equal(film["Combined"][..., :3], opaque["Combined"][..., :3])


@pytest.mark.parametrize("catches", [False, True])
@pytest.mark.parametrize("pilot", [0, 4])
def test_alpha_of_each_replication_is_that_of_its_samples(rng, catches, pilot):
    """Where the picture is made of both: opaque till the third sample."""
    film, samples = Film(5, 1, ("Combined",), catches=catches, pilot=pilot), draw(rng, 5, 5)
    samples[3:, 2, 3] = 0.25
    for number, values in enumerate(samples):
        seen = {"Combined": values, "Caught": np.ones((5, 11)), "Path Length": np.ones((5, 1))}
        film.add(slice(None), seen, number % 2)
    for second, rows in ((False, samples), (True, samples[1::2])):
        if second and not (catches or pilot):
            continue
        found = film.sums.read_sums("Combined", slice(None), second)
        np.testing.assert_allclose(found, rows.sum(axis=0), rtol=1e-15)  # a few roundings of float64


@pytest.mark.parametrize("count", [1, 2, 5, 64])
def test_difference_of_replications_is_within_its_bound(rng, count):
    """u sum_k (|v_k| + |D_k|), of partial differences D_k; and a hundredth of that does not hold."""
    samples = draw(rng, count, 500)[..., :3]
    film = fill(np.concatenate([samples, np.ones((count, 500, 1))], axis=2))
    signed = samples * np.where(np.arange(count) % 2, -1.0, 1.0)[:, np.newaxis, np.newaxis]
    partial = np.cumsum(signed, axis=0)
    bound = UNIT * (np.abs(samples) + np.abs(partial)).sum(axis=0)
    wrong = np.abs(film.sums.read(DIFFERENCE, slice(None)) - partial[-1])
    assert (wrong <= bound * (1.0 + count * UNIT)).all()
    assert (wrong > 0.01 * bound).any()


@pytest.mark.parametrize("count", [2, 3, 4, 7, 100])
def test_pixels_without_noise_have_no_error(count):
    values = np.full((count, 3, 4), [0.1, 1e5 / 3.0, 7e-9, 1.0])
    film = fill(values)
    assert (film.error, film.error_interval, film.measure_error().note) == (0.0, (0.0, 0.0), "")
    assert not read_deviations(film.sums, slice(None)).any()


@pytest.mark.parametrize("count", [2, 3, 8, 31])
def test_error_of_pixels_is_that_of_float64(rng, count):
    """The difference of means is known to u |T| N / (m n), as the head of `sums` says."""
    samples = draw(rng, count, 400)
    film = fill(samples)
    m, n = (count + 1) // 2, count // 2
    first, second = samples[0::2, :, :3].sum(axis=0) / m, samples[1::2, :, :3].sum(axis=0) / n
    weight = m * n / (m + n) ** 2
    expected = np.sqrt(((first - second) ** 2 * weight).mean(axis=1))
    off = 2.0 * UNIT * np.abs(samples[..., :3]).sum(axis=0).max(axis=1) * count / (m * n) * np.sqrt(weight)
    assert (np.abs(np.sqrt(film.square_errors()) - expected) <= off).all()


@pytest.mark.parametrize("count", [2, 3, 16, 200])
def test_deviations_are_those_of_all_samples(rng, count):
    """float32 sums of what is no less than 0: N roundings; begun with the difference of two samples, as it is known."""
    samples = draw(rng, count, 300)
    values = samples[..., :3].mean(axis=2)
    found = fill(samples).sums.read(DEVIATIONS, slice(None))[:, 0]
    expected = ((values - values.mean(axis=0)) ** 2).sum(axis=0)
    apart, off = np.abs(values[0] - values[1]), 4.0 * UNIT * samples[:2, :, :3].sum(axis=0).max(axis=1)
    assert (np.abs(found - expected) <= (count + 1) * UNIT * expected + apart * off + off**2).all()


def test_a_film_added_to_pixel_by_pixel_holds_the_same(rng):
    """Also in lists in which a pixel is several times: its samples count in order."""
    samples = draw(rng, 4, 6)
    whole, listed = fill(samples), Film(6, 1, ("Combined",))
    for replication in range(2):
        pixels = np.tile(np.arange(6), 2)
        listed.add(pixels, {"Combined": samples[replication::2].reshape(-1, 4)}, replication, repeated=True)
    np.testing.assert_array_equal(listed.sums.counts.read(slice(None)), whole.sums.counts.read(slice(None)))
    for name in (DIFFERENCE, DEVIATIONS, "Combined"):
        np.testing.assert_allclose(listed.arrays[name], whole.arrays[name], rtol=1e-5, atol=8 * UNIT * samples.max())


def test_a_film_cut_off_is_one_of_its_lower_rows(rng):
    film, samples = Film(4, 5, ("Combined", "Sample Count")), draw(rng, 3, 20)
    for number, values in enumerate(samples):
        film.add(slice(None), {"Combined": values}, number % 2)
    before = {name: film[name] for name in film.names}
    tracemalloc.start()
    film.cut_off(2)
    tracemalloc.stop()
    for name, pixels in before.items():
        np.testing.assert_array_equal(film[name], pixels[3:])
    assert {len(array) for array in film.arrays.values()} == {8}
    film.cut_off(0)
    assert film["Combined"].shape == (0, 4, 4)


@pytest.mark.parametrize("part", [7, 64, 1000])
def test_numbers_in_parts_are_told_as_all_at_once(rng, monkeypatch, part):
    monkeypatch.setattr(pixel_parts, "PART", part)
    values = np.round(rng.chisquare(1, 300), 1)  # with equal ones
    parts, ordered = Parts(300, values.__getitem__), np.sort(values)
    found = tally_parts(parts, 40)
    assert found.total == pytest.approx(values.sum())
    assert (found.largest, found.worst) == (ordered[-1], int(values.argmax()))
    np.testing.assert_array_equal(np.sort(found.most), ordered[-40:])
    for count in (1, 3, 40):
        quiet = mean_without(parts, keep_largest(found.most, count))
        assert quiet == pytest.approx(ordered[:-count].mean())
    spread = sum_squares(parts, 20, 3, largest=2.0)
    row, column = np.divmod(np.arange(300), 20)
    sets = [values[(row % 3 == k // 3) & (column % 3 == k % 3)].sum() / 2.0 for k in range(9)]
    np.testing.assert_allclose(spread.of_sets, sets)
    assert (spread.total, spread.of_squares) == pytest.approx((values.sum() / 2.0, (values**2).sum() / 4.0))


def test_a_film_in_parts_has_the_error_that_it_has_at_once(rng, monkeypatch):
    film = Film(20, 15, ("Combined",), interleaving=2)
    for number in range(5):
        film.add(slice(None), {"Combined": draw(rng, 300)}, number % 2)
    whole = film.measure_error()
    for module in (pixel_parts, film_module, film_error):
        monkeypatch.setattr(module, "PART", 7)
    parts = film.measure_error()
    assert (parts.few, parts.worst, parts.note) == (whole.few, whole.worst, whole.note)
    assert (parts.error, parts.error_p99) == pytest.approx((whole.error, whole.error_p99), rel=1e-13)
    assert parts.interval == pytest.approx(whole.interval, rel=1e-12)


def test_squares_of_a_pilot_tell_the_same_deviations(rng):
    samples = draw(rng, 6, 50)
    values = samples[..., :3].mean(axis=2)
    counts = np.full((50, 2), 3)
    found = find_deviations(values.sum(axis=0), (values**2).sum(axis=0), counts)
    plain = read_deviations(fill(samples).sums, slice(None))
    np.testing.assert_allclose(found, plain, rtol=1e-5)
