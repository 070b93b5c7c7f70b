"""Adaptive samples: where they go, that nothing they count decides of them, and that the picture stays right."""

import numpy as np
import pytest

import raytracer
from raytracer.film.film import Film
from raytracer.film.sums import PILOT
from raytracer.integrator.settings import Settings
from raytracer.processes.workers import Workers
from raytracer.rendering import adaptive, allocation
from raytracer.rendering.adaptive import AdaptivePlan, cut_lists, list_sweep
from raytracer.rendering.allocation import (
    LARGEST_DENSITY,
    ONE_BLOCK,
    Scatter,
    allocate,
    choose_pilot,
    choose_share,
    measure_scatter,
)
from raytracer.rendering.block_plan import USUAL_BLOCK
from raytracer.rendering.blocks import BlockResult, make_window
from raytracer.rendering.render import begin_film, render
from tests.raytracer.rendering.error_scenes import SCENES

SCENE = SCENES["glossy"][0]()
PASSES = ("Combined", "Normal", "Depth", "Error", "Sample Count")
pytestmark = pytest.mark.usefixtures("adaptive_in_any_size")


def see(**keywords):
    return render(SCENE, 24, 16, 64, adaptive=True, **keywords)


def test_adaptive_samples_go_where_the_noise_is():
    """Less noise than evenly, at a cost that is about the same."""
    even, film = render(SCENE, 24, 16, 64, passes=PASSES), see(passes=PASSES)
    assert film.error < even.error / 1.5
    assert film.statistics.rays == pytest.approx(even.statistics.rays, rel=0.15)
    count = film["Sample Count"][..., 0]
    # The sky has its pilot, and half of the rest.
    assert (count[0] == 16 + 24).all()
    assert count.max() > 150
    assert (film.samples, film.ended_by, int(film["Sample Count"].min())) == (64, "samples", 40)


def test_an_adaptive_picture_is_the_same_for_any_number_of_workers_and_any_block_size():
    expected = see(passes=PASSES)
    with Workers(2) as workers:
        for keywords in ({"block_size": 333}, {"workers": workers}, {"workers": workers, "block_size": 5000}):
            film = see(passes=PASSES, **keywords)
            for name in PASSES:
                assert np.array_equal(film[name], expected[name]), (name, keywords)


def test_an_adaptive_picture_ends_at_an_error():
    film = render(SCENE, 24, 16, 4096, adaptive=True, error=0.05)
    assert film.ended_by == "error"
    assert film.error <= 0.05
    same = render(SCENE, 24, 16, 4096, adaptive=True, error=0.05, block_size=700)
    assert np.array_equal(film["Combined"], same["Combined"])


def test_pilot_is_even_and_too_few_samples_are_all_of_it():
    few = render(SCENE, 24, 16, 31, adaptive=True)
    assert PILOT not in few.arrays
    assert np.array_equal(few["Combined"], render(SCENE, 24, 16, 31)["Combined"])
    assert not render(SCENE, 6, 4, 64, adaptive=True, passes=("Normal",)).pilot
    assert [choose_pilot(samples, 4096) for samples in (1, 31, 32, 100, 4096)] == [0, 0, 16, 24, 64]


def test_a_picture_that_is_one_block_stays_even_and_its_tiles_with_it(monkeypatch):
    """Of 24 x 16 pixels 64 samples: bit for bit, in no more blocks; a sample more in all, and there is a pilot."""
    monkeypatch.setattr(allocation, "ONE_BLOCK", 24 * 16 * 64)
    even, film = render(SCENE, 24, 16, 64), see()
    assert film.pilot == 0
    assert np.array_equal(film["Combined"], even["Combined"])
    for samples, border, pilot in ((64, None, 0), (65, None, 16), (65, (0, 0, 23, 16), 0)):
        for tile in (None, (1, 3)):
            settings = Settings(samples=samples, adaptive=True, border=border, tile=tile)
            film = begin_film(SCENE, make_window(SCENE, 24, 16, settings), settings)
            assert film.pilot == pilot, settings
    assert ONE_BLOCK == USUAL_BLOCK


def test_where_nothing_is_gained_the_rest_is_as_even_as_the_pilot(monkeypatch):
    """Whole sweeps, not lists, also where a film goes on; pixels still share points of lights."""

    def fail(*_):
        raise AssertionError("lists")

    monkeypatch.setattr(adaptive.AdaptivePlan, "_list_blocks", fail)
    scene, options = SCENES["room"][0](), {"integrator": "path", "interleaving": 2}
    even = render(scene, 12, 8, 40, **options)
    film = render(scene, 12, 8, 40, adaptive=True, **options)
    assert film.pilot == 16
    # The mean of both replications' means is rounded elsewhere than the mean of all.
    np.testing.assert_allclose(film["Combined"], even["Combined"], rtol=2 * np.finfo(np.float32).eps)
    parts = render(scene, 12, 8, 40, adaptive=True, until=23, **options)
    assert np.array_equal(render(scene, 12, 8, 40, adaptive=True, film=parts, **options)["Combined"], film["Combined"])


def test_cancelling_the_pilot_leaves_it():
    seen = []
    film = see(block_size=24 * 16, on_progress=seen.append, is_cancelled=lambda: len(seen) >= 5)
    assert (film.samples, film.ended_by) == (5, "cancelled")
    assert PILOT in film.arrays


@pytest.mark.parametrize("stops", [(5,), (16, 17), (40,)])
def test_an_adaptive_film_goes_on_where_it_stopped(stops):
    """Between sweeps of the pilot, at its end, after it; and once in the middle of a sweep."""
    film = None
    for until in stops:
        film = see(film=film, until=until)
        seen = []
        film = see(film=film, block_size=100, on_progress=seen.append, is_cancelled=lambda seen=seen: len(seen) >= 2)
        assert film.ended_by == "cancelled"
    assert film.ahead > 0
    film, whole = see(film=film), see()
    for name, array in whole.arrays.items():
        assert np.array_equal(film.arrays[name], array), name


def see_tiles(**keywords):
    return [see(tile=(number, 3), **keywords) for number in (1, 2, 3)]


def test_tiles_that_are_merged_in_their_pilot_go_on_as_the_whole():
    """Up to the last sweep of the pilot, all samples are even: bit for bit."""
    for until in (7, 16):
        film = see(film=raytracer.merge(see_tiles(until=until)))
        assert np.array_equal(film["Combined"], see()["Combined"]), until


def test_tiles_that_time_has_ended_in_their_pilot_cannot_go_on_as_one():
    """Some of their samples would be taken twice."""
    tiles = [see(tile=(number, 2), until=6 + number) for number in (1, 2)]
    for tile in tiles:
        tile.ended_by = "time"
    with pytest.raises(ValueError, match="cannot go on: its tiles were ended at different numbers of samples"):
        see(film=raytracer.merge(tiles))


def test_adaptive_tiles_of_different_pilots_are_no_parts_of_one_picture():
    """What an even one holds is too little for means of replications."""
    tiles = [render(SCENE, 24, 16, samples, adaptive=True, tile=(1 + k, 2)) for k, samples in enumerate((31, 64))]
    tiles[0].ended_by = "time"
    for order in (tiles, tiles[::-1]):
        with pytest.raises(ValueError, match=r"film 2 is no part of .* film 1: its adaptive samples follow the first"):
            raytracer.merge(order)


def test_an_adaptive_film_of_another_pilot_is_refused_with_what_it_was_begun_for():
    reason = "its adaptive samples follow the first 16, as those of 64 do, and not the first 64, as those of 256"
    with pytest.raises(ValueError, match=reason):
        render(SCENE, 24, 16, 256, adaptive=True, film=see(until=2))


def test_a_film_in_a_sweep_of_more_samples_than_pixels_comes_back(tmp_path, monkeypatch):
    """Where noise is cheap: 1.5 samples of each pixel, in some six blocks, of which five are done."""
    monkeypatch.setattr(adaptive, "decide_density", lambda film: np.full((384, 2), 1.5))
    film, seen = see(until=16), []
    film = see(film=film, block_size=100, on_progress=seen.append, is_cancelled=lambda: len(seen) >= 5)
    raytracer.save_film(film, tmp_path / "film.npz")
    assert raytracer.load_film(tmp_path / "film.npz").ahead == film.ahead > 384


def test_merged_adaptive_tiles_are_their_pixels_and_cannot_go_on(tmp_path):
    """Each tile has spread its own samples: 64 of them are shown, 17 are refused with one sentence."""
    tiles = see_tiles()
    film = raytracer.merge(tiles)
    assert np.array_equal(film["Combined"], np.concatenate([tile["Combined"] for tile in tiles[::-1]]))
    early = raytracer.merge(see_tiles(until=17))
    raytracer.save_film(early, tmp_path / "early.npz")
    for merged in (early, raytracer.load_film(tmp_path / "early.npz")):
        with pytest.raises(ValueError, match=r"(film|early.npz) cannot go on: .* adaptive tiles that were merged"):
            see(film=merged)


def test_tiles_of_adaptive_pictures_are_the_same_for_any_workers_and_blocks():
    expected = raytracer.merge(see_tiles())
    with Workers(2) as workers:
        for keywords in ({"block_size": 77}, {"workers": workers, "block_size": 500}):
            assert np.array_equal(raytracer.merge(see_tiles(**keywords))["Combined"], expected["Combined"])


def test_samples_of_a_replication_follow_the_pilot_of_the_other_alone():
    """What makes the mean unbiased: the first replication may have seen anything, its own numbers stay the same."""
    window, settings = make_window(SCENE, 6, 12, Settings(samples=64)), Settings(samples=64, adaptive=True)
    densities = []
    for seen in (1.0, 5.0):
        film = Film(6, 12, ("Combined",), pilot=16, total=64)
        film.arrays[PILOT][:] = np.random.default_rng(3).random((72, 12)) + np.tile([4, 5, 4], 4)
        film.arrays[PILOT][54:, 1::3] += 99.0  # a quarter of the picture has noise
        film.arrays[PILOT][7, :2] = 4 * seen, 5 * seen**2
        densities.append(adaptive.decide_density(film))
        assert adaptive.AdaptivePlan(film, window, settings, 1000).pixels == 72
    assert np.array_equal(densities[0][:, 0], densities[1][:, 0])
    assert (densities[0][:, 1] != densities[1][:, 1]).any()


def test_a_pixel_is_the_mean_of_its_replications_whatever_their_numbers():
    film = Film(1, 1, ("Combined", "Normal"), pilot=16)
    pixel = np.zeros(1, np.intp)
    for replication, values in ((0, [2.0]), (1, [8.0, 4.0, 6.0])):
        for value in values:
            seen = {"Combined": np.full((1, 4), value), "Normal": np.full((1, 3), value)}
            film.add(pixel, {**seen, "Path Length": np.ones((1, 1))}, replication)
    assert film["Combined"][0, 0, 0] == film["Normal"][0, 0, 0] == 4.0
    assert film.error == 2.0 / 4.0  # half of the difference of 2 and 6


def test_a_pixel_of_one_sample_leaves_its_neighbors_as_they_are():
    """As of a tile that time has ended at once, beside others."""
    film = Film(2, 1, ("Combined",), pilot=16)
    for replication, value, count in ((0, 2.0, 2), (1, 8.0, 1), (1, 4.0, 1)):
        seen = {"Combined": np.full((count, 4), value), "Path Length": np.ones((count, 1))}
        film.add(slice(0, count), seen, replication)
    assert film["Combined"][0, :, 0].tolist() == [4.0, 2.0]  # of 2 and 6, and of 2


def allocate_evenly_told(scatter, shape, pilot):
    """Return the densities where both parts of a pilot say the same as the whole."""
    return allocate(scatter, (scatter, scatter), shape, pilot)


def test_parts_of_a_pilot_are_its_first_samples_and_its_last():
    """Of a pilot of 18 sweeps 4 and 5 of each replication; both together are the whole."""
    film, values = Film(1, 1, ("Combined",), pilot=18, total=64), np.arange(18.0)
    for sweep, value in enumerate(values):
        seen = {"Combined": np.full((1, 4), value), "Path Length": np.full((1, 1), value + 1.0)}
        film.add(slice(0, 1), seen, sweep % 2)
        film.samples += 1
    for replication in range(2):
        own = values[replication::2]
        whole, parts = adaptive.measure_parts(film.arrays[PILOT].reshape(1, 2, 2, 3)[:, replication], 18)
        for scatter, part in zip((whole, *parts), (own, own[:4], own[4:]), strict=True):
            assert scatter.variance[0] == pytest.approx(part.var(ddof=1), rel=1e-13)  # sums of 9 numbers below 400
            assert scatter.cost[0] == pytest.approx(part.mean() + 1.0, rel=1e-15)


def test_allocation_is_neymans_at_the_cost_of_even_samples():
    """Two halves of the picture, away from their border: n is as sqrt(v / c), half of it, and the rest is even."""
    variance, cost = np.repeat([1.0, 90.0], 32 * 16), np.repeat([4.0, 1.0], 32 * 16)
    density = allocate_evenly_told(Scatter(variance, cost), (32, 32), 16)
    wanted = np.sqrt(variance / cost) * cost.sum() / np.sqrt(variance * cost).sum()
    inside = np.r_[0 : 32 * 15, 32 * 17 : 32 * 32]
    np.testing.assert_allclose(density[inside], (0.5 + 0.5 * wanted)[inside], rtol=0.03)
    assert density @ cost == pytest.approx(cost.sum(), rel=1e-12)  # sums of 1024 numbers


def test_a_patch_of_much_noise_shares_with_its_neighbors_and_takes_no_more_than_there_is():
    variance = np.zeros((400, 400))
    variance[200:202, 200:202] = 1.0
    scatter = Scatter(variance.ravel(), np.ones(variance.size))
    density = allocate_evenly_told(scatter, variance.shape, 64).reshape(variance.shape)
    assert density[200, 200] == LARGEST_DENSITY
    assert density[199, 199] > 1.0
    assert density[0, 0] == pytest.approx(0.25)


def test_noise_of_which_the_other_part_knows_nothing_leaves_samples_even(rng):
    """Fireflies: one pixel, or a twentieth of them anywhere. Those that have met one say nothing of the others."""
    one, none = np.zeros(400), np.zeros(400)
    one[210] = 1.0
    many = [np.where(rng.random(1600) < 0.05, 100.0, 1.0) for _ in range(2)]
    for parts in ((one, none), many):
        first, last = (Scatter(variance, np.ones(variance.size)) for variance in parts)
        side = int(np.sqrt(first.variance.size))
        whole = Scatter((first.variance + last.variance) / 2.0, first.cost)
        assert (allocate(whole, (first, last), (side, side), 16) == 1.0).all()


def test_noise_that_is_a_pixel_wide_is_told_by_the_pixel_itself(rng):
    """Edges in a mirror: neighbors alone know nothing of them, and the pixel's other samples do."""
    variance = np.where(rng.random(1600) < 0.05, 100.0, 1.0)
    density = allocate_evenly_told(Scatter(variance, np.ones(1600)), (40, 40), 16)
    assert density[variance > 1].min() > 2.0 * density.min()
    assert (variance / density).sum() < variance.sum() / 1.5


def test_a_share_is_chosen_by_what_is_foretold():
    """Twice as much where there is 25 times the noise: the largest share. Little noise, or nothing known: none."""
    variance, told = np.array([1.0, 25.0]), np.array([0.4, 1.6])
    assert choose_share(variance, told, 0.75) == 0.75
    assert choose_share(variance, told[::-1], 0.75) == 0.0
    assert choose_share(np.array([1.0, 1.4]), np.array([0.9, 1.1]), 0.75) == 0.0
    assert choose_share(variance, np.array([1.0, np.nan]), 0.75) == 0.0
    # Of a forecast that is too sure of itself, a part: 1 / (1 - 0.99 s) + 25 / (1 + 0.99 s) is least at s = 0.67.
    assert choose_share(variance, np.array([0.01, 1.99]), 0.75) == 0.75
    assert choose_share(variance, np.array([0.01, 1.99]), 1.0) == 0.75


def test_a_pilot_of_infinite_light_and_of_paths_that_are_none_leaves_samples_even():
    """Without a warning. Outside the lens of a panorama a path has no cast at all."""
    sums = np.zeros((12, 3))
    assert (measure_scatter(sums, 8).cost == 1.0).all()
    sums[5] = np.inf, np.inf, 8.0
    assert (allocate_evenly_told(measure_scatter(sums, 8), (3, 4), 16) == 1.0).all()


def test_an_adaptive_picture_without_noise_has_no_error():
    """What sums of a constant are off by is no noise."""
    film = render(
        raytracer.Scene(camera=raytracer.Camera(np.eye(4)), world=raytracer.World((0.1, 0.2, 0.3))),
        6,
        4,
        50,
        adaptive=True,
    )
    assert film.pilot
    told = film.measure_error()
    assert (told.error, told.interval, told.note) == (0.0, (0.0, 0.0), "")


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("replication", [0, 1])
def test_light_that_is_none_leaves_the_error_of_an_adaptive_pixel_unknown(value, replication):
    film = Film(1, 1, ("Combined",), pilot=16, samples=16)
    for number in range(2):
        seen = np.full((1, 4), value if number == replication else 1.0)
        film.add(slice(0, 1), {"Combined": seen, "Path Length": np.ones((1, 1))}, number)
    assert film.square_errors().tolist() == [np.inf]


def test_without_noise_samples_are_even():
    for variance in (0.0, np.inf):
        assert (allocate_evenly_told(Scatter(np.full(6, variance), np.ones(6)), (2, 3), 16) == 1.0).all()


def test_a_pilot_tells_variance_and_cost(rng):
    values = rng.random((8, 5))
    sums = np.stack([values.sum(axis=0), (values**2).sum(axis=0), np.full(5, 24.0)], axis=1)
    scatter = measure_scatter(sums, 8)
    np.testing.assert_allclose(scatter.variance, values.var(axis=0, ddof=1), rtol=1e-12)  # of sums of 8 numbers
    assert (scatter.cost == 3.0).all()


def test_sweeps_list_each_sample_once_and_in_order(rng):
    density, offset = rng.random((20, 2)) * 4.0, rng.random(20)
    seen = [[] for _ in range(20)]
    for sweep in range(16, 80):
        pixels, numbers = list_sweep(density, offset, sweep, 16)
        assert (np.diff(pixels) >= 0).all()
        assert (numbers % 2 == sweep % 2).all()
        for pixel, number in zip(pixels.tolist(), numbers.tolist(), strict=True):
            seen[pixel].append(number)
    for pixel, numbers in enumerate(seen):
        for replication in range(2):
            own = [number // 2 for number in numbers if number % 2 == replication]
            assert own == list(range(8, 8 + len(own)))
            assert abs(len(own) - 32 * density[pixel, replication]) < 1.0


@pytest.mark.parametrize("even", [True, False])
def test_what_follows_a_pilot_is_one_block_where_there_is_room(monkeypatch, even):
    """As many blocks as even samples take that are more than one; they begin with no small ones again."""
    pixels, sweeps = 72 * 48, 100
    density = np.full((pixels, 2), 1.0)
    density[:2] = (1.0, 1.0) if even else (0.5, 1.5)
    monkeypatch.setattr(adaptive, "decide_density", lambda film: density)
    film = Film(72, 48, ("Combined",), pilot=24, total=sweeps)
    plan = AdaptivePlan(film, make_window(SCENE, 72, 48, Settings()), Settings(samples=sweeps), sweeps)
    sizes = []
    for blocks in plan.phases():
        for block in blocks:
            sizes.append(len(block) * block.samples)
            plan.observe(BlockResult(block, {}, None, 0, 1.0))
        film.samples = film.pilot
    assert sizes[0] == 24 * pixels
    assert len(sizes) == 2
    assert sizes[1] == pytest.approx(76 * pixels, abs=2 * pixels)


@pytest.mark.parametrize("size", [1, 7, 10, 1000])
def test_lists_are_cut_into_even_blocks_that_know_where_sweeps_end(size):
    lists = [(np.full(n, k), np.arange(n, dtype=np.uint32)) for k, n in enumerate((4, 0, 9, 5))]
    cut = list(cut_lists(30, lists, size))
    assert sum(len(block) for block in cut) == 18
    assert max(len(block) for block in cut) <= size
    assert np.array_equal(np.concatenate([block.chosen for block in cut]), np.repeat([0, 2, 3], [4, 9, 5]))
    starts = np.cumsum([0, *(len(block) for block in cut)])
    ends = [start + end for start, block in zip(starts, cut, strict=False) for end in block.ends]
    assert ends == [4, 4, 13, 18]
    assert [block.sample for block in cut] == [30 + sum(end <= start for end in ends) for start in starts[:-1]]


def test_lists_of_whole_sweeps_fill_their_blocks(rng):
    """All but the last have no room for another sweep, of at most 3 samples of each pixel."""
    film, settings = Film(6, 12, ("Combined",), samples=16, pilot=16, total=64), Settings(samples=64, block_size=1000)
    plan = adaptive.AdaptivePlan(film, make_window(SCENE, 6, 12, settings), settings, 64)
    plan.sweeps = 64
    counts = [len(block) for block in plan._list_blocks(2.0 * rng.random((72, 2)))]
    assert max(counts) <= 1000
    assert min(counts[:-1]) > 1000 - 3 * 72


@pytest.mark.parametrize("workers", [2, 5])
def test_lists_have_work_for_all_workers(workers):
    """None takes more of what is left than its part, and the last ones are small: nobody waits long for another."""
    pixels, film = 72 * 48, Film(72, 48, ("Combined",), samples=24, pilot=24, total=100)
    settings = Settings(samples=100, workers=workers)
    plan = AdaptivePlan(film, make_window(SCENE, 72, 48, settings), settings, 100)
    plan.sweeps = 100
    sizes = [len(block) for block in plan._list_blocks(np.full((pixels, 2), 1.0))]
    assert sum(sizes) == 76 * pixels
    assert len(sizes) > workers
    assert max(sizes) <= -(-76 * pixels // workers)
    assert sizes[-1] <= pixels


@pytest.mark.parametrize(("name", "bar"), [("room", 0.95), ("glossy", 1.5)])
def test_adaptive_samples_are_never_much_worse_than_even_ones(name, bar):
    """The variance that 64 even samples have over that of as many adaptive ones, as the pilots of 10 seeds spread them.

    A pixel's own variance comes from the other seeds; that a sample counts as much among many is left out.
    """
    make, integrator = SCENES[name]
    scene, densities, scatters = make(), [], []
    for seed in range(10):
        film = render(scene, 24, 16, 64, until=16, adaptive=True, seed=seed, integrator=integrator)
        densities.append(adaptive.decide_density(film))
        sums = film.arrays[PILOT].reshape(-1, 2, 2, 3).sum(axis=2)
        scatters.append([measure_scatter(sums[:, replication], 8) for replication in range(2)])
    variances = np.array([[scatter.variance for scatter in pair] for pair in scatters]).mean(axis=1)
    even = adapted = 0.0
    for seed, density in enumerate(densities):
        variance = np.delete(variances, seed, axis=0).mean(axis=0)
        even += (variance / 64).sum()
        adapted += (variance[:, np.newaxis] / (4 * (8 + 24 * density))).sum()
    assert even / adapted > bar
    # And their cost is that of even ones, to what a pilot does not know of it.
    cost = np.mean([[scatter.cost for scatter in pair] for pair in scatters], axis=(0, 1))
    taken = np.mean([(8 + 24 * density).sum(axis=1) @ cost for density in densities])
    assert taken == pytest.approx(64 * cost.sum(), rel=0.02)


def compare_means(name, seeds, size=(8, 5)):
    """Return the mean difference of adaptive pictures from even ones over its standard error, and the gain in
    variance."""
    make, integrator = SCENES[name]
    scene, pictures = make(), []
    for adaptive_ in (False, True):
        options = {"integrator": integrator, "adaptive": adaptive_}
        films = (render(scene, *size, 32, seed=seed, **options) for seed in range(seeds))
        pictures.append(np.stack([film["Combined"][..., :3].reshape(-1, 3).astype(float) for film in films]))
    even, adapted = pictures
    difference = (adapted - even).mean(axis=(1, 2))
    if not difference.any():  # where nothing promises a gain, samples are even, to the last bit
        return 0.0, 1.0
    score = difference.mean() / (difference.std(ddof=1) / np.sqrt(seeds))
    return score, even.var(axis=0).sum() / adapted.var(axis=0).sum()


@pytest.mark.parametrize(("name", "is_even"), [("penumbra", True), ("glossy", False)])
def test_adaptive_pictures_are_right_on_average(name, is_even):
    score, _ = compare_means(name, 60)
    assert abs(score) < 4
    assert (score == 0) == is_even


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_adaptive_pictures_are_right_on_average_of_a_thousand(name):
    """Of six scenes, with fireflies; one of 60 would miss three standard errors by chance."""
    score, _ = compare_means(name, 1000)
    assert abs(score) < 3
