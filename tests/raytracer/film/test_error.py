"""What a film says of its error, against errors that are known."""

import numpy as np
import pytest

from raytracer.film.error import (
    PictureError,
    count_freedom,
    count_holders,
    find_deviations,
    measure_error,
    share_with_neighbors,
    spread_ratio,
    spread_samples,
    student_quantile,
)
from raytracer.film.film import Film
from raytracer.film.pixel_parts import Parts, sum_squares
from raytracer.film.unmet import add_near_misses, count_near_misses, find_unmet

WIDTH, HEIGHT = 40, 30
PIXELS = WIDTH * HEIGHT


def fill(means, names=("Combined",), **fields) -> Film:
    """Return a film of WIDTH x HEIGHT whose samples (k, pixels, 4) are given."""
    film = Film(WIDTH, HEIGHT, names, **fields)
    for number, values in enumerate(means):
        film.add(slice(0, PIXELS), {"Combined": values}, number % 2)
    return film


def scatter(rng, count, sigma=1.0):
    """Return samples (count, pixels, 4) around 5, normal, the channels alike; sigma : () or (pixels,)."""
    noise = rng.normal(size=(count, PIXELS)) * sigma
    return np.repeat(5.0 + noise[..., np.newaxis], 4, axis=2)


def measure_truth(film: Film) -> float:
    colors = film.arrays["Combined"][:, :3] / film.sums.counts.read(slice(None)).sum(axis=1)[:, np.newaxis]
    return float(np.sqrt(((colors - 5.0) ** 2).mean()) / colors.mean())


@pytest.mark.parametrize("count", [2, 3, 7, 16])
def test_error_is_that_of_the_mean_of_all_samples(rng, count):
    """Also where one replication has a sample more. Its square is within six standard deviations of sigma^2 / n."""
    film = fill(scatter(rng, count))
    assert abs(film.error**2 * 25.0 * count - 1.0) < 6 * np.sqrt(2 / PIXELS)


@pytest.mark.parametrize("uneven", [False, True])
def test_interval_holds_the_error_of_the_picture(rng, uneven):
    """95% of 600 pictures, give or take 3.4 standard deviations; all pixels of one noise, or most of a little."""
    sigma = rng.random(PIXELS) ** 4 if uneven else 1.0
    held = 0
    for _ in range(600):
        film = fill(scatter(rng, 4, sigma))
        low, high = film.error_interval
        held += low <= measure_truth(film) <= high
    assert abs(held / 600 - 0.95) < 3.4 * np.sqrt(0.95 * 0.05 / 600)


@pytest.mark.parametrize("pixels", [1, 2, 4])
def test_interval_holds_the_error_of_few_pixels(rng, pixels):
    """At least 95% of 500 pictures, give or take three deviations: each pixel is one degree of freedom, no more."""
    held = 0
    for values in rng.normal(size=(500, 2, pixels)):
        film = Film(pixels, 1, ("Combined",))
        for number, row in enumerate(values):
            film.add(slice(0, pixels), {"Combined": np.repeat(1000.0 + row[:, np.newaxis], 4, axis=1)}, number)
        low, high = film.error_interval
        held += low <= np.sqrt((values.mean(axis=0) ** 2).mean()) / 1000.0 <= high
    assert held / 500 > 0.95 - 3 * np.sqrt(0.95 * 0.05 / 500)


def test_nothing_is_known_of_the_error_of_one_sample(rng):
    film = fill(scatter(rng, 1), names=("Combined", "Error"))
    assert (film.error, film.error_interval) == (np.inf, (0.0, np.inf))
    assert (film["Error"] == np.finfo(np.float32).max).all()


def test_a_picture_without_noise_has_no_error():
    film = fill(np.full((4, PIXELS, 4), 3.0))
    assert (film.error, film.error_interval, film.measure_error().note) == (0.0, (0.0, 0.0), "")
    assert fill(np.zeros((4, PIXELS, 4))).error == 0.0


def test_noise_around_black_has_no_relative_error():
    assert measure_error(Parts(4, np.ones(4).__getitem__), 0.0, 2).error == np.inf


def test_what_is_too_large_to_be_counted_leaves_the_error_unknown():
    samples = np.ones((2, PIXELS, 4))
    samples[:, 7] = np.inf
    assert fill(samples).error == np.inf


def test_a_film_without_combined_says_so():
    with pytest.raises(KeyError, match="no pass 'Combined', which has an error; it has Normal"):
        assert Film(1, 1, ("Normal",)).error


def test_error_of_one_sample_of_each_replication_by_hand():
    """Differences of 2 in one of two pixels: d = 1 there, so the root mean square is sqrt(1 / 2); the level is 2.5."""
    film = Film(2, 1, ("Combined", "Error", "Sample Count"))
    film.add(slice(0, 2), {"Combined": np.array([[1.0] * 4, [3.0] * 4])}, 0)
    film.add(slice(0, 2), {"Combined": np.array([[3.0] * 4, [3.0] * 4])}, 1)
    assert film.error == pytest.approx(np.sqrt(0.5) / 2.5, rel=4 * np.finfo(float).eps)
    # A pixel at the edge shares as 3/4 (itself and its mirror) to 1/4, twice: 9/16 + 1/16 stay.
    np.testing.assert_allclose(film["Error"][0, :, 0], np.sqrt([0.625, 0.375]), rtol=np.finfo(np.float32).eps)
    assert film["Sample Count"][0, :, 0].tolist() == [2.0, 2.0]


def test_error_of_some_pixels_is_asked_for_without_combined(rng):
    samples = scatter(rng, 6)
    film = fill(samples, names=("Error",))
    assert list(film.passes) == ["Error"]
    np.testing.assert_array_equal(film["Error"], fill(samples, names=("Combined", "Error"))["Error"])


def test_pixels_with_more_samples_have_less_error(rng):
    film = fill(scatter(rng, 4), names=("Combined", "Error", "Sample Count"))
    left = np.flatnonzero(np.arange(PIXELS) % WIDTH < WIDTH // 2)
    for number, values in enumerate(scatter(rng, 60)):
        film.add(left, {"Combined": values[left]}, number % 2)
    errors = film["Error"][..., 0]
    assert np.unique(film["Sample Count"]).tolist() == [4.0, 64.0]
    # Away from the border between them: 16 times the samples, a quarter of the error.
    ratio = np.sqrt((errors[:, 2 : WIDTH // 2 - 2] ** 2).mean() / (errors[:, WIDTH // 2 + 2 : -2] ** 2).mean())
    assert ratio == pytest.approx(0.25, rel=0.15)


def test_few_pixels_that_hold_the_noise_are_named(rng):
    samples = scatter(rng, 4, 0.01)
    samples[:2, 3 * WIDTH + 11] += 9.0 * np.array([1, -1])[:, np.newaxis]
    assert fill(scatter(rng, 4)).measure_error().note == ""
    found = fill(samples).measure_error()
    assert (found.few, found.worst) == (1, (11, 3))
    assert (
        found.note
        == "1 pixel holds 90% of the noise, the worst at (11, 3) from the lower left: the error can be underestimated"
    )
    assert found.error_p99 < found.error / 20
    assert fill(scatter(rng, 4)).measure_error().note == ""


def test_the_noisiest_pixel_of_a_border_is_counted_in_the_full_picture(rng):
    """As the ray inspector counts them."""
    samples = scatter(rng, 4, 0.01)
    samples[:2, 3 * WIDTH + 11] += 9.0 * np.array([1, -1])[:, np.newaxis]
    assert fill(samples, left=100, bottom=20).measure_error().worst == (111, 23)


def test_few_pixels_are_named_where_both_replications_met_as_much(rng):
    """One bright sample of either replication in one pixel: d is 0 there, and the scatter of its samples is not."""
    samples = scatter(rng, 8, 0.01)
    plain = fill(samples).measure_error()
    samples[[2, 5], 3 * WIDTH + 11] += 80.0
    found = fill(samples).measure_error()
    assert plain.note == ""
    assert (found.few, found.worst) == (1, (11, 3))
    # The interval reaches to what independent samples would have: two of 80 among eight, 1200 / 7 squared around 25.
    assert found.error < 0.01
    assert found.interval[1] == pytest.approx(np.sqrt(80.0**2 * 2 * 6 / 8 / 7 / 8 / PIXELS) / 5.0, rel=0.02)


def test_scatter_is_that_of_independent_samples(rng):
    """s^2 (1 / m + 1 / n) / 4 of m and n samples; and none of a constant, however large, nor of sums that overflow."""
    values = rng.random((7, 5))
    counts = np.tile([5, 2], (5, 1))
    found = spread_samples(find_deviations(values.sum(axis=0), (values**2).sum(axis=0), counts), counts)
    np.testing.assert_allclose(found, values.var(axis=0, ddof=1) * (1 / 5 + 1 / 2) / 4, rtol=1e-13)  # sums of 7 numbers
    constant = np.full(5, 1.1e5)
    assert not find_deviations(7 * constant, 7 * constant**2, counts).any()


def test_light_that_no_sample_has_met_widens_the_interval_and_is_named(rng):
    """50 near misses of a light of 1000, of which 0.65 may have been met: 650 / 4 in one pixel of four samples."""
    samples = scatter(rng, 4, 0.01)
    plain, film = fill(samples).measure_error(), fill(samples)
    film.near_misses = count_near_misses(np.full(50, 1000.0))
    found = film.measure_error()
    assert found.note == "no reflection has met the brightest light yet: the error can be underestimated"
    assert (found.error, found.interval[0]) == (plain.error, plain.interval[0])
    expected = (np.sqrt(50) + 1) ** 2 / 100 * 1024 / 4
    assert found.interval[1] == pytest.approx(expected / np.sqrt(PIXELS) / 5.0, rel=1e-3)
    samples[1, 5] += 200.0  # by way of a grey mirror
    film = fill(samples)
    film.near_misses = count_near_misses(np.full(50, 1000.0))
    assert not film.measure_error().is_unmet


def test_light_that_many_samples_come_near_to_and_none_meets_is_out_of_reach():
    assert find_unmet(count_near_misses(np.full(100, 8.0)), 0.0) > 0
    assert find_unmet(count_near_misses(np.full(400, 8.0)), 0.0) == 0.0
    # Of the brightest, no matter how many come near to one that is dim.
    assert find_unmet(count_near_misses(np.r_[np.full(400, 8.0), 800.0]), 0.0) > 8
    assert find_unmet((), 0.0) == find_unmet(count_near_misses(np.zeros(3)), 0.0) == 0.0


def test_near_misses_add_up_in_any_order(rng):
    seen = np.exp(rng.normal(size=100) * 20)
    parts = [count_near_misses(part) for part in (seen[:30], seen[30:31], seen[31:])]
    for order in ((0, 1, 2), (2, 0, 1)):
        total = ()
        for number in order:
            total = add_near_misses(total, parts[number])
        assert total == count_near_misses(seen)
    assert sum(total) == 100


def test_noisiest_pixels_are_left_out_of_the_second_number():
    squares = np.r_[np.full(98, 4.0), 100.0, 0.0]
    found = measure_error(Parts(100, squares.__getitem__), 2.0, 10)
    assert found.error == pytest.approx(np.sqrt(squares.mean()) / 2)
    assert found.error_p99 == pytest.approx(np.sqrt(squares[squares < 100].mean()) / 2)


def test_holders_are_counted_from_the_noisiest():
    assert count_holders(np.array([1.0, 50.0, 41.0]), 100.0) == 2
    assert count_holders(np.array([1.0, 50.0, 38.0]), 100.0) == 0


@pytest.mark.parametrize("freedom", [4, 10, 100, 10_000])
def test_ratio_of_two_root_mean_squares_is_within_its_quantiles(rng, freedom):
    ratios = np.sqrt(rng.chisquare(freedom, 100_000) / rng.chisquare(freedom, 100_000))
    limit = spread_ratio(freedom)
    for share in ((ratios > limit).mean(), (ratios < 1 / limit).mean()):
        assert share == pytest.approx(0.025, abs=0.003)


def test_one_pixel_alone_says_nothing_of_the_interval():
    assert spread_ratio(1.0) == np.inf


def test_degrees_of_freedom_are_the_number_of_even_pixels(rng):
    squares = rng.chisquare(1, PIXELS)
    assert count_freedom(sum_squares(Parts(PIXELS, squares.__getitem__), WIDTH)) == pytest.approx(PIXELS, rel=0.25)


@pytest.mark.parametrize("side", [2, 3, 4])
def test_pixels_that_are_wrong_together_count_less(rng, side):
    """Sets of pixels, each of which shares one error: about as many degrees of freedom as sets, not as pixels."""
    row, column = np.divmod(np.arange(PIXELS), WIDTH)
    member = row % side * side + column % side

    def count(squares):
        return count_freedom(sum_squares(Parts(PIXELS, squares.__getitem__), WIDTH, side))

    freedoms = [count(rng.chisquare(1, side**2)[member]) for _ in range(200)]
    assert np.median(freedoms) < 3 * side**2
    assert np.median([count(rng.chisquare(1, PIXELS)) for _ in range(200)]) > PIXELS / 4


@pytest.mark.parametrize("side", [1, 2, 3, 4])
def test_interval_holds_the_error_of_pixels_that_are_wrong_together(rng, side):
    """At least 93% of 400 pictures, give or take three deviations: no less can be known than one number of a set."""
    row, column = np.divmod(np.arange(PIXELS), WIDTH)
    member, held = row % side * side + column % side, 0
    for _ in range(400):
        noise = rng.normal(size=(2, side**2))[:, member]
        film = fill(np.repeat(5.0 + noise[..., np.newaxis], 4, axis=2), interleaving=side)
        low, high = film.error_interval
        held += low <= measure_truth(film) <= high
    assert held / 400 > 0.93 - 3 * np.sqrt(0.93 * 0.07 / 400)


def test_an_error_that_all_pixels_share_has_no_upper_bound_and_says_so(rng):
    found = fill(scatter(rng, 4), interleaving=1).measure_error()
    assert found.interval == (0.0, np.inf)
    assert found.note == "all pixels take the same points of lights (interleaving 1): the error has no upper bound"
    assert 0 < found.error < np.inf
    even = fill(np.full((4, PIXELS, 4), 3.0), interleaving=1).measure_error()
    assert (even.interval, even.note) == ((0.0, 0.0), "")


@pytest.mark.parametrize(("width", "height"), [(1, 1), (1, 7), (7, 1), (3, 2)])
def test_pictures_smaller_than_the_sets_of_pixels_have_an_interval(rng, width, height):
    film = Film(width, height, ("Combined",), interleaving=4)
    for number in range(4):
        film.add(slice(0, width * height), {"Combined": rng.random((width * height, 4))}, number % 2)
    low, high = film.error_interval
    assert 0 <= low < film.error < high


@pytest.mark.parametrize(("freedom", "quantile"), [(3, 3.1824463), (8, 2.3060041), (15, 2.1314495), (255, 1.9693105)])
def test_students_quantiles_are_those_of_the_tables(freedom, quantile):
    assert student_quantile(freedom) == pytest.approx(quantile, rel=0.01 if freedom < 8 else 0.001)


def test_neighbors_share_what_they_know():
    values = np.zeros((4, 5))
    values[1, 2] = 16.0
    shared = share_with_neighbors(values)
    assert shared[0:3, 1:4].tolist() == [[1.0, 2.0, 1.0], [2.0, 4.0, 2.0], [1.0, 2.0, 1.0]]
    assert shared.sum() == 16.0
    assert (share_with_neighbors(np.ones((3, 3))) == 1.0).all()


def test_an_unknown_error_has_no_note():
    assert PictureError().note == ""


def test_shadow_catchers_change_the_error(rng):
    """Each replication's light over its own shadow: the background behind it shows through by what is caught."""
    film = Film(WIDTH, HEIGHT, ("Combined",), catches=True)
    for number in range(2):
        caught = np.zeros((PIXELS, 11))
        caught[:, 0:3], caught[:, 3:6], caught[:, 6], caught[:, 7:] = 0.5 + 0.25 * number, 1.0, 1.0, 1.0
        film.add(slice(0, PIXELS), {"Combined": np.zeros((PIXELS, 4)), "Caught": caught}, number)
    # Shadows of 1/2 and 1/4 over white: 0.5 and 0.75, whose half difference is 1/8, around 5/8.
    assert film.error == pytest.approx(0.125 / 0.625, rel=8 * np.finfo(float).eps)
